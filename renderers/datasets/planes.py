"""Convert the arrays of a truth to named planes (height, width) of an image file, and back.

Stokes images and maps of the index have a plane a band, named as in the spectral layout; a complex
index has two, n and k. Arrays in double precision are stored once more as pairs of 32-bit words,
because the layout has 32-bit floats only; so every array comes back to the bit.
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
    "normals", "eta_map", "alpha_map", "normal_spread", "s3", "s3_noise", "s3_standard_error",
]  # fmt: skip
DType = Literal["float32", "float64", "complex64", "complex128"]

LOBES: tuple[FieldName, ...] = ("specular", "diffuse")
ERRORS: tuple[FieldName, ...] = ("standard_error", "specular_noise", "diffuse_noise")
MAPS: tuple[FieldName, ...] = ("eta_map", "alpha_map", "normal_spread")
"""Arrays that some truths have: index and roughness where they vary over the image, and how far the
normals in a pixel differ, which older datasets do not tell."""
_SINGLE: dict[FieldName, str] = {"alpha_map": "alpha", "normal_spread": "normal_spread"}
"""Channel of an array (height, width)."""
S3: FieldName = "s3"
S3_ERRORS: tuple[FieldName, ...] = ("s3_noise", "s3_standard_error")
"""The fourth Stokes component and its errors, which a truth has where it can be non-zero."""
FIELDS: tuple[FieldName, ...] = (*LOBES, *ERRORS, "normals")
"""Arrays that every truth has."""


def dtypes_of(truth: Truth) -> dict[FieldName, DType]:
    """Types of a truth's arrays by name.

    Raises
    ------
    ValueError
        If an array has a shape or type that no truth has.
    """
    dtypes: dict[FieldName, DType] = {}
    optional = (name for name in (*MAPS, S3, *S3_ERRORS) if getattr(truth, name) is not None)
    for name in (*FIELDS, *optional):
        array = getattr(truth, name)
        expected = (*truth.mask.shape, *_trailing(name, len(truth.scene.wavelengths_nm)))
        allowed = get_args(DType) if name == "eta_map" else get_args(DType)[:2]
        kind = str(array.dtype)
        if array.shape != expected or kind not in allowed:
            raise ValueError(f"{name}: expected floats {expected}, found {kind} {array.shape}")
        dtypes[name] = cast(DType, kind)
    return dtypes


def _trailing(name: FieldName, bands: int) -> tuple[int, ...]:
    """Sizes after (height, width) in an array's shape."""
    special: dict[FieldName, tuple[int, ...]] = {
        "normals": (3,),
        "eta_map": (bands,),
        "alpha_map": (),
        "normal_spread": (),
        **dict.fromkeys((S3, *S3_ERRORS), (bands,)),
    }
    return special.get(name, (bands, 3))


def planes(name: FieldName, array: AnyArray, bands: Bands) -> Channels:
    """Planes (height, width) of an array by channel name, which begins with the array's name.

    Examples
    --------
    >>> list(planes("eta_map", np.full((2, 2, 1), 0.2 + 3j), (550.0,)))
    ['eta.n.550,000000nm', 'eta.k.550,000000nm']
    """
    if name == "normals":
        return {f"normals.{axis}": array[..., index] for index, axis in enumerate("XYZ")}
    if name in _SINGLE:
        return {_SINGLE[name]: array}
    if name == "eta_map":
        parts = {"n": array.real, "k": array.imag} if np.iscomplexobj(array) else {"n": array}
        return {
            f"eta.{part}.{band_name(band)}": values[..., index]
            for part, values in parts.items()
            for index, band in enumerate(bands)
        }
    if name in (S3, *S3_ERRORS):
        named = enumerate(map(band_name, bands))
        return {f"{name}.{band}": array[..., index] for index, band in named}
    return dict(stokes_channels(array, bands, prefix=f"{name}."))


def array_from_planes(
    name: FieldName, channels: Mapping[str, AnyArray], bands: Bands, dtype: DType
) -> AnyArray:
    """The array whose `planes` are given, complex if `dtype` is, in the planes' precision."""
    if name == "normals":
        return np.stack([channels[f"normals.{axis}"] for axis in "XYZ"], axis=-1)
    if name in _SINGLE:
        return channels[_SINGLE[name]]
    if name == "eta_map":
        n = np.stack([channels[f"eta.n.{band_name(band)}"] for band in bands], axis=-1)
        if not dtype.startswith("complex"):
            return n
        index = np.empty(n.shape, np.result_type(n.dtype, np.complex64))
        index.real = n
        index.imag = np.stack([channels[f"eta.k.{band_name(band)}"] for band in bands], axis=-1)
        return index
    if name in (S3, *S3_ERRORS):
        return np.stack([channels[f"{name}.{band_name(band)}"] for band in bands], axis=-1)
    return stokes_from_channels(channels, bands, prefix=f"{name}.")


def channel_names(name: FieldName, bands: Bands, dtype: DType) -> list[str]:
    """Names of the planes of an array of this type."""
    empty = np.empty((0, 0, *_trailing(name, len(bands))), dtype)
    return list(planes(name, empty, bands))


def is_double(dtype: DType) -> bool:
    """Whether it needs more than 32 bits a real number."""
    return dtype in ("float64", "complex128")


def words_of_doubles(channels: Channels) -> Channels:
    """Planes in double precision as pairs of planes (height, width) of 32-bit words.

    Examples
    --------
    >>> list(words_of_doubles({"alpha": np.zeros((2, 2))}))
    ['alpha.low', 'alpha.high']
    """
    pairs: Channels = {}
    for channel, plane in channels.items():
        pair = np.ascontiguousarray(plane, dtype="<f8").view("<u4").reshape(*plane.shape, 2)
        pairs |= {f"{channel}.low": pair[..., 0], f"{channel}.high": pair[..., 1]}
    return pairs


def names_of_words(channels: Iterable[str]) -> list[str]:
    """Names of the planes that `words_of_doubles` makes of these channels."""
    return [f"{channel}.{word}" for channel in channels for word in ("low", "high")]


def doubles_of_words(stored: Channels, channels: Iterable[str]) -> Channels:
    """The planes in double precision from their stored `words_of_doubles`."""
    doubles: Channels = {}
    for channel in channels:
        pair = np.stack([stored[f"{channel}.low"], stored[f"{channel}.high"]], axis=-1)
        doubles[channel] = pair.astype("<u4").view("<f8")[..., 0]
    return doubles
