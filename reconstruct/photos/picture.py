"""A picture in linear light, and what is needed to write another one like it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from malus.reconstruct.photos.tone_curves import (
    Transfer,
    icc_transfer,
    linear_transfer,
    power_transfer,
    srgb_transfer,
)
from malus.scenes.core.arrays import AnyArray, Float32Array, FloatArray
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.errors import InputError

MAX_PIXELS = 64_000_000
"""Largest picture: about 13 GB of working memory for its light and polarisation, measured at
2.1 GB for 10 megapixels."""

ORIENTATION = 274
"""The tag of EXIF and TIFF that says how a picture is to be turned."""


SUFFIX_OF = {
    "PNG": ".png", "JPEG": ".jpg", "TIFF": ".tif", "EXR": ".exr", "WEBP": ".webp",
    "JPEG2000": ".jp2", "AVIF": ".avif", "HEIF": ".heic", "BMP": ".bmp", "PPM": ".ppm",
    "PFM": ".pfm",
}  # fmt: skip
"""Suffix of the files of each kind that is written."""


@dataclass(frozen=True)
class Picture:
    """A picture in linear light, and what is needed to write another one like it.

    Attributes
    ----------
    linear : (height, width, channels) float32
        1 is the largest value of the file, channels are 1 or 3.
    alpha : (height, width) codes or None
        Opacity, as it was.
    premultiplied : bool
        The file's values are multiplied by its opacity; `linear` is not.
    kind : str
        Format of its file, one of `SUFFIX_OF`.
    transfer : Transfer or None
        None where the file holds linear floats.
    metadata : dict
        What the format's writer puts back.
    notes : tuple of str
        What of the file is left out or changed.
    others : dict
        Further channels of an OpenEXR file by name, which go out as they came in.
    turned : bool
        It was turned or mirrored, as an orientation tag of the file says.

    Examples
    --------
    >>> grey = Picture(np.full((2, 3, 1), 0.5, np.float32), "EXR", None)
    >>> grey.suffix, grey.linear.shape
    ('.exr', (2, 3, 1))
    """

    __repr__ = brief_repr

    linear: Float32Array
    kind: str
    transfer: Transfer | None
    alpha: AnyArray | None = None
    metadata: dict[str, Any] = field(default_factory=dict)
    premultiplied: bool = False
    notes: tuple[str, ...] = ()
    others: dict[str, AnyArray] = field(default_factory=dict)
    turned: bool = False

    @property
    def suffix(self) -> str:
        """Suffix of files of this kind."""
        return SUFFIX_OF[self.kind]

    @property
    def assumption(self) -> str:
        """A sentence on how the file's values were turned into light."""
        if self.transfer is None or self.transfer.source == "linear":
            return "values are linear light"
        if self.transfer.source == "sRGB":
            return "no colour profile is embedded: values are taken for sRGB"
        return f"tone curves: {self.transfer.source}"

    @property
    def full_scale(self) -> float:
        """Linear light of the file's largest value; infinite for floats, which have none."""
        return np.inf if self.transfer is None else float(self.transfer.table.max())

    @property
    def clipped(self) -> float:
        """Share of the pixels with a channel at the file's largest value."""
        return float(np.mean(np.any(self.linear >= self.full_scale, axis=-1)))

    def with_light(self, linear: FloatArray) -> Picture:
        """A picture of the same form with other light (height, width, channels)."""
        return replace(self, linear=linear.astype(np.float32, copy=False))


def check_size(path: Path, width: int, height: int) -> None:
    """Refuse pictures that are too large, or empty, before a pixel is decoded."""
    if min(width, height) < 1:
        expected, found = "a pixel or more a side", f"{width} x {height}"
        raise InputError(str(path), expected, found, "correct its size")
    if width * height > MAX_PIXELS:
        raise InputError(
            str(path),
            f"at most {MAX_PIXELS / 1e6:g} megapixels",
            f"{width} x {height} = {width * height / 1e6:.0f} megapixels",
            "make it smaller or cut it",
        )


def transfer_of(
    profile: bytes | None, bits: int, linear: bool, path: Path, gamma: float | None = None
) -> Transfer:
    """Tone curves of a file of integers: none for linear light, its profile's, gamma, or sRGB's."""
    if linear:
        return linear_transfer(bits)
    if profile:
        return icc_transfer(profile, bits, str(path))
    return srgb_transfer(bits) if gamma is None else power_transfer(gamma, bits)


UPRIGHT = 1
"""Value of the EXIF tag Orientation of a picture that is not to be turned."""


def upright(codes: AnyArray, orientation: int) -> AnyArray:
    """A picture as it is displayed, for a value of the EXIF tag Orientation (1 to 8).

    Examples
    --------
    >>> upright(np.array([[1, 2]]), 6).tolist()
    [[1], [2]]
    """
    if orientation in (5, 6, 7, 8):
        codes = np.swapaxes(codes, 0, 1)
    if orientation in (3, 4, 7, 8):
        codes = codes[::-1]
    if orientation in (2, 3, 6, 7):
        codes = codes[:, ::-1]
    return np.ascontiguousarray(codes)


def from_codes(
    codes: AnyArray,
    kind: str,
    transfer: Transfer,
    metadata: dict[str, Any],
    premultiplied: bool = False,
    notes: tuple[str, ...] = (),
) -> Picture:
    """A picture from codes (height, width) or (height, width, channels), alpha last if any."""
    planes = codes if codes.ndim == 3 else codes[..., None]
    colours = 3 if planes.shape[-1] >= 3 else 1
    alpha = planes[..., -1] if planes.shape[-1] in (2, 4) else None
    if premultiplied and alpha is not None:
        largest = transfer.table.shape[1] - 1
        linear = transfer.linear_between(divided_by_alpha(planes[..., :colours], alpha, largest))
    else:
        linear = transfer.linear(planes[..., :colours])
    is_premultiplied = premultiplied and alpha is not None
    return Picture(linear, kind, transfer, alpha, metadata, is_premultiplied, notes)


def divided_by_alpha(values: AnyArray, alpha: AnyArray, opaque: float = 1.0) -> Float32Array:
    """Values (height, width, channels) without the opacity that they were multiplied by.

    Where a pixel is wholly transparent they are what they are: light that glows without covering.

    Examples
    --------
    >>> values, alpha = np.array([[[50.0]], [[7.0]]]), np.array([[128], [0]])
    >>> [round(value, 3) for value in divided_by_alpha(values, alpha, 255).ravel().tolist()]
    [99.609, 7.0]
    """
    share = np.where(alpha > 0, alpha, opaque).astype(np.float32) / np.float32(opaque)
    return values.astype(np.float32) / share[..., None]


def times_alpha(values: AnyArray, alpha: AnyArray, opaque: float = 1.0) -> Float32Array:
    """The inverse of `divided_by_alpha`."""
    share = np.where(alpha > 0, alpha, opaque).astype(np.float32) / np.float32(opaque)
    return values.astype(np.float32) * share[..., None]
