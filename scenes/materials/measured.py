"""Measured materials: tables of polarised BRDFs (pBRDF), as Baek et al. published them.

"Image-Based Acquisition and Modeling of Polarimetric Reflectance", ACM Transactions on Graphics
39(4), 2020. The tables are in Mitsuba's tensor files, which Mitsuba's own plugin evaluates. This
module checks their shape before anything is rendered, and reads the table of one band.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from malus.scenes.core.arrays import AnyArray, Float32Array, Float64Array
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.named_file import NamedFile

AXES = {
    "phi_d": (-math.pi, math.pi),
    "theta_d": (0.0, math.pi / 2),
    "theta_h": (0.0, math.pi / 2),
}
"""Rusinkiewicz' angles in the order of the table's first axes, and their ends in radians."""
AXIS_SLACK = 0.06
"""Radians by which an axis may end elsewhere: beyond its ends the last value counts."""

_MAGIC = b"tensor_file\0\1\0"
_HEADER_BYTES = 1 << 16
_LARGEST_AXIS = 1 << 40
_TYPES = ("none", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")
"""Types of arrays by their number in a tensor file; all are little-endian."""


class Measured(NamedFile):
    """A material whose polarised BRDF was measured.

    Such a table does not tell specular from diffuse light: methods that need both do not apply.
    `eta` and `alpha` are the refractive index and the Beckmann roughness that methods are given,
    known from elsewhere; without them, methods that need them do not apply either. `path` leads to
    a `.pbsdf` file, and `digest` is its hash, which a suite fills in.

    Examples
    --------
    >>> Measured(path="gold.pbsdf", eta=1.5).label
    'measured'
    """

    kind: Literal["measured"] = "measured"
    path: str = Field(min_length=1, max_length=4096)
    eta: float | None = Field(default=None, gt=1, le=4)
    alpha: float | None = Field(default=None, gt=0, le=1)
    file_kind: ClassVar[str] = "pBRDF file"

    @property
    def file_name(self) -> str:
        """The file's path."""
        return self.path

    @property
    def isotropic_alpha(self) -> float | None:
        """`alpha`."""
        return self.alpha

    @property
    def distribution(self) -> None:
        """None: nobody knows how the facets of a measured material are distributed."""

    @property
    def label(self) -> str:
        """The word that stands in tables instead of a roughness."""
        return "measured"

    @property
    def material_label(self) -> str:
        """Name of the material in tables."""
        return Path(self.path).stem

    @property
    def roughness(self) -> None:
        """None: a measured material has no named roughness."""

    @property
    def body(self) -> str:
        """'unknown': a table does not tell how the body scatters."""
        return "unknown"

    def indices(self, wavelengths_nm: tuple[float, ...]) -> Float64Array:
        """Refractive index of every band (bands,), where it was given; NaN elsewhere.

        Examples
        --------
        >>> Measured(path="gold.pbsdf").indices((450.0, 550.0)).tolist()
        [nan, nan]
        """
        return np.full(len(wavelengths_nm), math.nan if self.eta is None else self.eta)

    def albedos(self, wavelengths_nm: tuple[float, ...]) -> Float64Array:
        """Zeros (bands,): diffuse light is not told apart."""
        return np.zeros(len(wavelengths_nm))


@dataclass(frozen=True)
class PBRDF:
    """A table of Mueller matrices over Rusinkiewicz' angles and wavelengths.

    Attributes
    ----------
    axes : dict of (N,)
        By the names of `AXES`, radians, increasing.
    wavelengths_nm : (W,)
        Increasing.
    mueller : (phi_d, theta_d, theta_h, W, 4, 4)
        1/sr, mapped from the file.
    """

    path: Path
    axes: dict[str, Float32Array]
    wavelengths_nm: NDArray[np.uint16]
    mueller: Float32Array

    def check_bands(self, wavelengths_nm: Iterable[float]) -> None:
        """Check that all bands lie within the table.

        Raises
        ------
        InputError
            Names the first band outside.
        """
        low, high = int(self.wavelengths_nm[0]), int(self.wavelengths_nm[-1])
        for wavelength in wavelengths_nm:
            if not low <= wavelength <= high:
                expected = f"bands within its table, {low} to {high} nm"
                hint = "choose other bands"
                raise InputError(str(self.path), expected, f"{wavelength:g} nm", hint)

    def mueller_at(self, wavelength_nm: float) -> Float32Array:
        """Mueller matrices (phi_d, theta_d, theta_h, 4, 4) of one band, linear between two."""
        row = np.interp(wavelength_nm, self.wavelengths_nm, range(len(self.wavelengths_nm)))
        below, weight = int(row), np.float32(row % 1)
        band = f"{wavelength_nm:g} nm"
        lower = self._checked(self.mueller[:, :, :, below], band)
        if weight == 0:  # the next row may hold NaN, which marks invalid entries
            return np.array(lower)
        upper = self._checked(self.mueller[:, :, :, below + 1], band)
        return np.asarray(lower + weight * (upper - lower))

    def _checked(self, values: Float32Array, band: str) -> Float32Array:
        """Raise InputError for what no surface does; noise may leave single values below zero."""
        is_infinite = bool(np.isinf(values).any())
        total = math.nan if is_infinite else float(np.nansum(values[..., 0, 0], dtype=np.float64))
        if not total > 0:
            found = "infinite values" if is_infinite else f"{total:g} in all"
            expected = f"finite values at {band}, a sum of M00 above 0, NaN for what is not known"
            raise _damaged(self.path, expected, found)
        return values


def open_pbrdf(path: Path) -> PBRDF:
    """Open the table in a tensor file; its numbers are read from disk when they are used.

    Raises
    ------
    InputError
        A file that is missing, cut or no tensor file, a field that is missing or of another type
        or shape, an axis that does not increase or that does not hold all directions.
    """
    fields = _fields(path)
    types = dict.fromkeys(AXES, ("float32", 2)) | {"wvls": ("uint16", 1), "M": ("float32", 6)}
    for name, (dtype, dimensions) in types.items():
        field = fields.get(name)
        if field is None:
            expected = f"a polarised BRDF, with the fields {', '.join(types)}"
            raise _damaged(path, expected, ", ".join(fields) or "none")
        if not field.size:
            found = "one that holds no bytes"
            hint = "the program that wrote it left it out: write it with its values"
            raise InputError(str(path), f"field {name} with values", found, hint)
        if field.dtype != np.dtype(dtype) or field.ndim != dimensions:
            expected = f"field {name} as {dtype} of {dimensions} dimensions"
            raise _damaged(path, expected, f"{field.dtype} {field.shape}")
    axes = {name: np.array(fields[name].ravel()) for name in AXES}
    bands = np.array(fields["wvls"])
    for name, axis in {**axes, "wvls": bands}.items():
        if not (np.isfinite(axis).all() and (axis[1:] > axis[:-1]).all()):
            raise _damaged(path, f"field {name} to increase", str(axis.tolist()))
    for name, (first, last) in AXES.items():
        if not np.allclose(axes[name][[0, -1]], (first, last), rtol=0, atol=AXIS_SLACK):
            expected = f"field {name} from {first:.4g} to {last:.4g}, radians"
            found = f"{axes[name][0]:.4g} to {axes[name][-1]:.4g}"
            hint = "write all directions in radians: beyond the ends, the last value would count"
            raise InputError(str(path), expected, found, hint)
    shape = (*(len(axis) for axis in axes.values()), len(bands), 4, 4)
    if fields["M"].shape != shape:
        raise _damaged(path, f"field M of shape {shape}", str(fields["M"].shape))
    return PBRDF(path, axes, bands, fields["M"])


def _fields(path: Path) -> dict[str, AnyArray]:
    """The arrays of a tensor file by name, mapped from it."""
    with reading(str(path), "a readable pBRDF file", "check the path"), path.open("rb") as file:
        head, size = file.read(_HEADER_BYTES), file.seek(0, 2)
    if not head.startswith(_MAGIC):
        raise _damaged(path, "a tensor file (.pbsdf)", "another file")
    try:
        header = _header(head)
    except (struct.error, ValueError, IndexError, TypeError):
        raise _damaged(path, "a whole header of a tensor file", "a damaged one") from None
    for dtype, shape, offset in header.values():
        end = offset + math.prod(shape) * dtype.itemsize
        if end > size:
            raise _damaged(path, f"a file of at least {end} bytes", f"{size} bytes")
    return {
        # Nothing of no bytes can be mapped.
        name: np.memmap(path, dtype, "r", offset, shape)
        if 0 not in shape
        else np.zeros([0] * len(shape), dtype)
        for name, (dtype, shape, offset) in header.items()
    }


def _header(head: bytes) -> dict[str, tuple[np.dtype[Any], tuple[int, ...], int]]:
    """Type, shape and offset of every array by name; raises the errors of `struct` and NumPy."""
    (count,), start = struct.unpack_from("<I", head, len(_MAGIC)), len(_MAGIC) + 4
    arrays = {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", head, start)
        name = head[start + 2 : start + 2 + length].decode()
        dimensions, number, offset = struct.unpack_from("<HBQ", head, start + 2 + length)
        shape = struct.unpack_from(f"<{dimensions}Q", head, start + length + 13)
        if dimensions > 6 or max(shape, default=0) > _LARGEST_AXIS:
            raise ValueError(f"shape {shape}")
        if _TYPES[number] == "none":  # a type without bytes
            number, shape = 1, (*shape, 0)
        arrays[name] = (np.dtype(_TYPES[number]).newbyteorder("<"), shape, offset)
        start += length + 13 + 8 * dimensions
    return arrays


def _damaged(path: Path, expected: str, found: str) -> InputError:
    return InputError(str(path), expected, found, "copy the file again, or choose another")
