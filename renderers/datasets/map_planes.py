"""Maps of `scenes.maps` as named planes (height, width) of an image file, and back to the bit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np

from malus.renderers.datasets.stokes_channels import Channels, band_name
from malus.scenes.core.arrays import AnyArray
from malus.scenes.maps import MapName

Bands = tuple[float, ...]
MapType = Literal["float32", "complex64", "uint16"]

_AXES: dict[MapName, str] = {
    "position": "XYZ",
    "shading_normals": "XYZ",
    "geometric_normals": "XYZ",
    "uv": "UV",
}


def map_channels(name: MapName, bands: Bands, dtype: MapType) -> list[str]:
    """Names of the planes of a map.

    Examples
    --------
    >>> map_channels("uv", (550.0,), "float32"), map_channels("eta", (550.0,), "float32")
    (['uv.U', 'uv.V'], ['eta.n.550,000000nm'])
    """
    if name in _AXES:
        return [f"{name}.{axis}" for axis in _AXES[name]]
    if name == "albedo":
        return [f"albedo.{band_name(band)}" for band in bands]
    if name == "eta":
        parts = ("n", "k") if dtype == "complex64" else ("n",)
        return [f"eta.{part}.{band_name(band)}" for part in parts for band in bands]
    return [name]


def map_planes(maps: Mapping[MapName, AnyArray], bands: Bands) -> Channels:
    """Planes of 32-bit floats of all maps by channel name; ids are whole numbers."""
    planes: Channels = {}
    for name, values in maps.items():
        parts = [values.real, values.imag] if np.iscomplexobj(values) else [values]
        flat = [part[..., None] if part.ndim == 2 else part for part in parts]
        whole = np.concatenate(flat, axis=-1).astype(np.float32)
        names = map_channels(name, bands, _type_of(name, values))
        planes |= {channel: whole[..., k] for k, channel in enumerate(names)}
    return planes


def map_types(maps: Mapping[MapName, AnyArray]) -> dict[MapName, MapType]:
    """Type of every map's array.

    Raises
    ------
    ValueError
        If an array has a type that no map has.
    """
    return {name: _type_of(name, values) for name, values in maps.items()}


def maps_from_planes(
    planes: Mapping[str, AnyArray], types: Mapping[MapName, MapType], bands: Bands
) -> dict[MapName, AnyArray]:
    """The maps whose planes are given."""
    maps: dict[MapName, AnyArray] = {}
    for name, dtype in types.items():
        channels = [planes[channel] for channel in map_channels(name, bands, dtype)]
        if len(channels) == 1 and name not in ("albedo", "eta"):
            maps[name] = channels[0].astype(dtype)
            continue
        values = np.stack(channels, axis=-1)
        if dtype == "complex64":
            index = np.empty((*values.shape[:2], len(bands)), np.complex64)
            index.real, index.imag = values[..., : len(bands)], values[..., len(bands) :]
            values = index
        maps[name] = values
    return maps


def all_channels(types: Mapping[MapName, MapType], bands: Bands) -> Iterable[str]:
    """Names of the planes of several maps."""
    return (channel for name in types for channel in map_channels(name, bands, types[name]))


def _type_of(name: MapName, values: AnyArray) -> MapType:
    for kind in ("float32", "complex64", "uint16"):
        if values.dtype == kind:
            return kind
    raise ValueError(f"map {name}: expected float32, complex64 or uint16, found {values.dtype}")
