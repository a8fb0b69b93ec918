"""The arrays of a truth as named planes (height, width) of an image file, and back to the bit.

Stokes images and maps of the index have a plane a band, named as the spectral layout names it; a
complex index has two, n and k. Arrays in double precision are stored once more as pairs of 32-bit
words, because the layout knows 32-bit floats only.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal, cast, get_args

import numpy as np

from malus.renderers.datasets.stokes_channels import (
    Channels,
    band_name,
    stokes_channels,
    stokes_from_channels,
)
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import AnyArray

Bands = tuple[float, ...]
FieldName = Literal[
    "specular", "diffuse", "standard_error", "specular_noise", "diffuse_noise",
    "normals", "eta_map", "alpha_map",
]  # fmt: skip
DType = Literal["float32", "float64", "complex64", "complex128"]

LOBES: tuple[FieldName, ...] = ("specular", "diffuse")
ERRORS: tuple[FieldName, ...] = ("standard_error", "specular_noise", "diffuse_noise")
MAPS: tuple[FieldName, ...] = ("eta_map", "alpha_map")
"""What a truth has only where it varies over the image."""
FIELDS: tuple[FieldName, ...] = (*LOBES, *ERRORS, "normals")
"""What every truth has."""


def dtypes_of(truth: Truth) -> dict[FieldName, DType]:
    """Types of the arrays that a truth has.

    Raises
    ------
    ValueError
        If an array has another shape or type than a truth has.
    """
    found: dict[FieldName, DType] = {}
    for name in (*FIELDS, *(name for name in MAPS if getattr(truth, name) is not None)):
        array = getattr(truth, name)
        expected = (*truth.mask.shape, *_trailing(name, len(truth.scene.wavelengths_nm)))
        allowed = get_args(DType) if name == "eta_map" else get_args(DType)[:2]
        kind = str(array.dtype)
        if array.shape != expected or kind not in allowed:
            raise ValueError(f"{name}: expected floats {expected}, found {kind} {array.shape}")
        found[name] = cast(DType, kind)
    return found


def _trailing(name: FieldName, bands: int) -> tuple[int, ...]:
    """What follows (height, width) in an array's shape."""
    special: dict[FieldName, tuple[int, ...]] = {
        "normals": (3,),
        "eta_map": (bands,),
        "alpha_map": (),
    }
    return special.get(name, (bands, 3))


def planes(name: FieldName, array: AnyArray, bands: Bands) -> Channels:
    """Planes of an array by channel name, the array's name first.

    Examples
    --------
    >>> list(planes("eta_map", np.full((2, 2, 1), 0.2 + 3j), (550.0,)))
    ['eta.n.550,000000nm', 'eta.k.550,000000nm']
    """
    if name == "normals":
        return {f"normals.{axis}": array[..., index] for index, axis in enumerate("XYZ")}
    if name == "alpha_map":
        return {"alpha": array}
    if name == "eta_map":
        parts = {"n": array.real, "k": array.imag} if np.iscomplexobj(array) else {"n": array}
        return {
            f"eta.{part}.{band_name(band)}": values[..., index]
            for part, values in parts.items()
            for index, band in enumerate(bands)
        }
    return dict(stokes_channels(array, bands, prefix=f"{name}."))


def assembled(
    name: FieldName, channels: Mapping[str, AnyArray], bands: Bands, dtype: DType
) -> AnyArray:
    """The array of `planes`; `dtype` tells whether it is complex, the channels its precision."""
    if name == "normals":
        return np.stack([channels[f"normals.{axis}"] for axis in "XYZ"], axis=-1)
    if name == "alpha_map":
        return channels["alpha"]
    if name == "eta_map":
        n = np.stack([channels[f"eta.n.{band_name(band)}"] for band in bands], axis=-1)
        if not dtype.startswith("complex"):
            return n
        index = np.empty(n.shape, np.result_type(n.dtype, np.complex64))
        index.real = n
        index.imag = np.stack([channels[f"eta.k.{band_name(band)}"] for band in bands], axis=-1)
        return index
    return stokes_from_channels(channels, bands, prefix=f"{name}.")


def channel_names(name: FieldName, bands: Bands, dtype: DType) -> list[str]:
    """Names of the planes of an array of this type."""
    empty = np.empty((0, 0, *_trailing(name, len(bands))), dtype)
    return list(planes(name, empty, bands))


def is_double(dtype: DType) -> bool:
    """Whether 32 bits a number do not hold it."""
    return dtype in ("float64", "complex128")


def words(channels: Channels) -> Channels:
    """The bits of planes in double precision as pairs of planes of 32-bit words.

    Examples
    --------
    >>> list(words({"alpha": np.zeros((2, 2))}))
    ['alpha.low', 'alpha.high']
    """
    found: Channels = {}
    for channel, plane in channels.items():
        pair = np.ascontiguousarray(plane, dtype="<f8").view("<u4").reshape(*plane.shape, 2)
        found |= {f"{channel}.low": pair[..., 0], f"{channel}.high": pair[..., 1]}
    return found


def word_names(channels: Iterable[str]) -> list[str]:
    """Names of the planes of `words`."""
    return [f"{channel}.{word}" for channel in channels for word in ("low", "high")]


def doubles(stored: Channels, channels: Iterable[str]) -> Channels:
    """The planes in double precision whose `words` were stored."""
    found: Channels = {}
    for channel in channels:
        pair = np.stack([stored[f"{channel}.low"], stored[f"{channel}.high"]], axis=-1)
        found[channel] = pair.astype("<u4").view("<f8")[..., 0]
    return found
