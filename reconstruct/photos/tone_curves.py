"""From the codes of a picture to linear light and back, through the curves of its own profile.

A polarising filter scales light. So the picture is taken to linear light in its own primaries, by
the tone curves of the embedded ICC profile, or sRGB's where there is none, and back by the same
curves: colours keep their meaning and the profile stays valid, and no gamut is ever converted.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from malus.scenes.core.arrays import Float32Array, Float64Array, FloatArray
from malus.scenes.core.colour_science import colour_science
from malus.scenes.core.errors import InputError

Codes = NDArray[np.integer[Any]]

_SIGNATURE = slice(36, 40)
_TAG_TABLE = 128
_COARSE = 256
"""Codes of an 8-bit picture, which is encoded through a table instead of interpolation."""
_PARAMETRIC_LENGTHS = (1, 3, 4, 5, 7)


class Transfer(NamedTuple):
    """Linear light (channels, codes) of every code, and where the curves come from.

    Examples
    --------
    >>> srgb = srgb_transfer(8)
    >>> codes = np.array([[[0, 128, 255]]], dtype=np.uint8)
    >>> bool((srgb.encoded(srgb.linear(codes)) == codes).all())
    True
    """

    table: Float64Array
    source: str

    def linear(self, codes: Codes) -> Float32Array:
        """Linear light (height, width, channels) of codes of that shape, 0 to 1."""
        light = np.empty(codes.shape, dtype=np.float32)
        for i, curve in enumerate(self._curves(codes.shape[-1])):
            light[..., i] = curve.astype(np.float32)[codes[..., i]]
        return light

    def linear_between(self, codes: FloatArray) -> Float32Array:
        """Linear light of codes (height, width, channels) that need not be whole numbers.

        Beyond the largest code light goes on in proportion, as glow over a transparent pixel does.
        """
        levels = np.arange(self.table.shape[1], dtype=np.float64)
        light = np.empty(codes.shape, dtype=np.float32)
        for i, curve in enumerate(self._curves(codes.shape[-1])):
            over = np.maximum(codes[..., i] / levels[-1], 1.0)
            light[..., i] = np.interp(codes[..., i], levels, curve) * over
        return light

    def encoded_between(self, linear: FloatArray) -> FloatArray:
        """The inverse of `linear_between`: codes that need not be whole numbers."""
        levels = np.arange(self.table.shape[1], dtype=np.float64)
        codes = np.empty(linear.shape, dtype=np.float32)
        for i, curve in enumerate(self._curves(linear.shape[-1])):
            over = np.maximum(linear[..., i] / curve[-1], 1.0)
            codes[..., i] = np.interp(linear[..., i], curve, levels) * over
        return codes

    def light_of(self, code: float) -> float:
        """Linear light of one code, mean over the channels."""
        levels = np.arange(self.table.shape[1], dtype=np.float64)
        return float(np.mean([np.interp(code, levels, curve) for curve in self.table]))

    def _curves(self, channels: int) -> list[Float64Array]:
        """The curve of every channel; a profile of one curve has it for all."""
        return [self.table[min(i, len(self.table) - 1)] for i in range(channels)]

    def encoded(self, linear: FloatArray) -> Codes:
        """Codes of linear light; what is brighter than white is clipped."""
        levels = np.arange(self.table.shape[1], dtype=np.float64)
        if len(levels) != _COARSE:
            return self._interpolated(linear, levels).astype(np.uint16)
        result = np.empty(linear.shape, dtype=np.uint8)
        for i, curve in enumerate(self._curves(linear.shape[-1])):
            result[..., i] = _nearest_codes(np.asarray(linear[..., i], np.float32), curve)
        return result

    def _interpolated(self, linear: FloatArray, levels: Float64Array) -> Float64Array:
        """Codes + ½, so that truncation rounds; interpolation never leaves the range of levels."""
        curves = self._curves(linear.shape[-1])
        planes = [np.interp(linear[..., i], curve, levels) for i, curve in enumerate(curves)]
        return np.stack(planes, axis=-1) + 0.5


def _nearest_codes(light: Float32Array, curve: Float64Array) -> Codes:
    """8-bit codes, each of the light (256,) that is nearest: halfway it is the brighter one.

    The leading 16 bits of a float stand for a hundredth of its value or less, near black too, where
    a power curve has many codes in one even step of light. They give a first code, which is at most
    a few too low: on curves of pictures one.
    """
    exact = curve.astype(np.float32)
    middle = (0.5 * (curve[:-1] + curve[1:])).astype(np.float32)
    # Between neighbours in single precision there is no middle.
    middle = np.append(np.where(middle > exact[:-1], middle, exact[1:]), np.float32(np.nan))
    lowest = (np.arange(1 << 15, dtype=np.uint32) << 16).view(np.float32)
    first = np.searchsorted(middle[:-1], lowest, side="right")
    table = np.concatenate([first, np.zeros_like(first)]).astype(np.uint8)  # below zero: black
    codes = table[light.view(np.uint32) >> 16]
    for _ in range(int(np.diff(first).max())):
        codes += light >= middle[codes]
    return codes


def srgb_transfer(bits: int) -> Transfer:
    """The curve of sRGB (IEC 61966-2-1) for codes of that many bits."""
    return srgb_codes((1 << bits) - 1)


def srgb_codes(largest: int) -> Transfer:
    """The curve of sRGB for codes from 0 to `largest`."""
    codes = np.linspace(0.0, 1.0, largest + 1)
    return Transfer(np.asarray(colour_science().models.eotf_sRGB(codes))[None], "sRGB")


def linear_transfer(bits: int) -> Transfer:
    """Codes of that many bits that are proportional to light.

    Examples
    --------
    >>> linear_transfer(8).table[0, 255].item()
    1.0
    """
    return linear_codes((1 << bits) - 1)


def linear_codes(largest: int) -> Transfer:
    """Codes from 0 to `largest` that are proportional to light."""
    return Transfer(np.linspace(0.0, 1.0, largest + 1)[None], "linear")


def power_transfer(gamma: float, bits: int) -> Transfer:
    """Codes whose power `gamma` is light, which a file declares without a profile.

    Examples
    --------
    >>> round(power_transfer(2.0, 8).light_of(127.5), 4)
    0.25
    """
    source = f"the file's gamma of {gamma:.4g}"
    return Transfer(np.linspace(0.0, 1.0, 1 << bits)[None] ** gamma, source)


_ROUNDED = 1e-4
"""How much a curve may fall at a joint: that of Rec. 709, of rounded constants, falls by 5e-5."""


def icc_transfer(profile: bytes, bits: int, where: str) -> Transfer:
    """The tone curves of an ICC profile, for codes of that many bits.

    Source: ICC.1:2022, types curveType and parametricCurveType.

    Raises
    ------
    InputError
        If the profile is damaged, or a table of colours without tone curves.
    """
    try:
        tags = _tags(profile)
        names = (b"rTRC", b"gTRC", b"bTRC") if b"rTRC" in tags else (b"kTRC",)
        if not all(name in tags for name in names):
            raise InputError(
                where,
                "a colour profile with tone curves, as sRGB or Adobe RGB have",
                "a profile that is a table of colours",
                "convert the picture to sRGB, Display P3 or Adobe RGB first",
            )
        x = np.linspace(0.0, 1.0, 1 << bits)
        with np.errstate(all="ignore"):  # what is not finite is refused below
            table = np.stack([_curve(tags[name], x) for name in names])
    except (struct.error, IndexError, KeyError, ValueError, ArithmeticError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            where, "a readable colour profile", "a damaged one", "remove or replace it"
        ) from None
    if not np.all(np.isfinite(table)) or np.any(np.diff(table, axis=1) < -_ROUNDED):
        raise InputError(where, "rising tone curves", "others", "convert the picture to sRGB")
    return Transfer(np.maximum.accumulate(table, axis=1), "the embedded profile")


def _tags(profile: bytes) -> dict[bytes, bytes]:
    """Content of a profile's tags by their four letters."""
    if profile[_SIGNATURE] != b"acsp":
        raise ValueError("not a profile")
    (count,) = struct.unpack_from(">I", profile, _TAG_TABLE)
    tags = {}
    for i in range(min(count, 1000)):
        name, start, length = struct.unpack_from(">4sII", profile, _TAG_TABLE + 4 + 12 * i)
        tags[name] = profile[start : start + length]
    return tags


def _curve(tag: bytes, x: Float64Array) -> Float64Array:
    """Light for the codes x in 0 to 1, by a tag that holds a tone curve."""
    if tag[:4] == b"para":
        return _parametric(tag, x)
    if tag[:4] != b"curv":
        raise ValueError("unknown type of curve")
    (count,) = struct.unpack_from(">I", tag, 8)
    if count == 0:
        return x
    values = np.frombuffer(tag, dtype=">u2", count=count, offset=12).astype(np.float64)
    if count == 1:
        return np.asarray(x ** (values[0] / 256.0))
    return np.interp(x, np.linspace(0.0, 1.0, count), values / 65535.0)


def _parametric(tag: bytes, x: Float64Array) -> Float64Array:
    """Light for the codes x in 0 to 1, by one of the five formulas of ICC profiles."""
    (kind,) = struct.unpack_from(">H", tag, 8)
    count = _PARAMETRIC_LENGTHS[kind]
    stored = np.frombuffer(tag, dtype=">i4", count=count, offset=12) / 65536.0
    g, a, b, c, d, e, f = np.concatenate([stored, np.zeros(7 - count)]).tolist()
    if kind == 0:
        return np.asarray(x**g)
    if kind < 3:
        # Types 1 and 2 break at −b/a and are the constant c below.
        d, e, f, c = -b / a, c, c, 0.0
        e, f = (e, f) if kind == 2 else (0.0, 0.0)
    power = np.maximum(a * x + b, 0.0) ** g + e
    return np.asarray(np.where(x >= d, power, c * x + f))
