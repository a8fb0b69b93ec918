"""Pictures made smaller or larger for a network, and its maps brought back.

Light is averaged over area, of the valid pixels alone; maps are interpolated bilinearly between
valid pixels, so that nothing from off the mask comes in.
"""

from __future__ import annotations

import numpy as np

from malus.scenes.core.arrays import BoolArray, Float32Array, FloatArray

Size = tuple[int, int]
"""Height and width."""


def working_size(shape: Size, side: int) -> Size:
    """Size of a picture whose longer side is `side` at most; smaller ones stay as they are.

    Examples
    --------
    >>> working_size((3000, 4000), 512), working_size((96, 128), 512), working_size((1, 9000), 256)
    ((384, 512), (96, 128), (1, 256))
    """
    longest = max(shape)
    if longest <= side:
        return shape
    height, width = (max(1, round(length * side / longest)) for length in shape)
    return height, width


def resized(image: FloatArray, valid: BoolArray, size: Size) -> tuple[Float32Array, BoolArray]:
    """Light (height, width, channels) of the valid pixels at another size, 0 where nothing is seen.

    The second value tells what is seen there: in a larger picture what the mask has half of.

    Examples
    --------
    >>> light, kept = resized(np.array([[[2.0], [6.0]]]), np.array([[True, False]]), (1, 4))
    >>> light[..., 0].tolist(), kept.tolist()
    ([[2.0, 2.0, 0.0, 0.0]], [[True, True, False, False]])
    """
    if size == valid.shape:
        return np.where(valid[..., None], image, 0).astype(np.float32), valid
    if size[0] * size[1] < valid.size:
        return smaller(image, valid, size)
    light, kept = interpolated(image, valid, size), _resized(valid, size, "BILINEAR") >= 0.5
    light[~kept] = 0
    return light, kept


def smaller(image: FloatArray, valid: BoolArray, size: Size) -> tuple[Float32Array, BoolArray]:
    """Mean light (height, width, channels) of the valid pixels in each pixel of a smaller picture.

    The second value tells which pixels hold any valid one; the others are 0.

    Examples
    --------
    >>> image = np.array([[[2.0], [4.0], [9.0], [9.0]]])
    >>> valid = np.array([[True, True, True, False]])
    >>> light, kept = smaller(image, valid, (1, 2))
    >>> light[..., 0].tolist(), kept.tolist()
    ([[3.0, 9.0]], [[True, True]])
    """
    share = None if valid.all() else _resized(valid, size, "BOX")
    light = np.empty((*size, image.shape[2]), np.float32)
    for channel in range(image.shape[2]):
        light[..., channel] = _resized(np.where(valid, image[..., channel], 0), size, "BOX")
    if share is None:
        return light, np.ones(size, dtype=bool)
    kept = share > _NOTHING
    light /= np.where(kept, share, 1)[..., None]
    light[~kept] = 0
    return light, kept


def interpolated(maps: FloatArray, valid: BoolArray, size: Size) -> Float32Array:
    """Maps (height, width, channels) brought to another size, from their valid pixels alone.

    Examples
    --------
    >>> maps, valid = np.array([[[1.0], [7.0]]]), np.array([[True, False]])
    >>> interpolated(maps, valid, (1, 4))[0, :3, 0].tolist()
    [1.0, 1.0, 1.0]
    """
    share = None if valid.all() else np.maximum(_resized(valid, size, "BILINEAR"), _NOTHING)
    large = np.empty((*size, maps.shape[2]), np.float32)
    for channel in range(maps.shape[2]):
        plane = _resized(np.where(valid, maps[..., channel], 0), size, "BILINEAR")
        large[..., channel] = plane if share is None else plane / share
    return large


_NOTHING = 1e-6
"""Share of a pixel's area that is rounding; one valid pixel of the largest picture has more."""


def _resized(plane: FloatArray | BoolArray, size: Size, how: str) -> Float32Array:
    """One plane (height, width) at another size, by Pillow's filter of that name."""
    import PIL.Image

    whole = PIL.Image.fromarray(np.ascontiguousarray(plane, dtype=np.float32))
    resized = whole.resize(size[::-1], PIL.Image.Resampling[how])
    return np.asarray(resized, dtype=np.float32)
