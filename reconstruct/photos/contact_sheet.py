"""Small sRGB copies of pictures, side by side on one sheet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.photos.picture import Picture

SHEET_SIDE = 320


def reduced(values: NDArray[Any], side: int) -> NDArray[Any]:
    """Every n-th pixel, so that the longer side has at most `side`."""
    step = max(1, math.ceil(max(values.shape[:2]) / side))
    return values[::step, ::step]


def thumbnail(linear: NDArray[Any], picture: Picture, side: int) -> NDArray[np.uint8]:
    """A small sRGB copy; float pictures are scaled to their brightest percent."""
    from malus.reconstruct.photos.tone_curves import srgb_transfer

    small = reduced(linear, side)
    white = 1.0 if picture.transfer is not None else float(np.quantile(picture.linear, 0.99)) or 1.0
    codes = srgb_transfer(8).encoded(small / white)
    return np.asarray(np.repeat(codes, 3, axis=-1) if codes.shape[-1] == 1 else codes)


def sheet(path: Path, shown: Sequence[tuple[str, NDArray[np.uint8]]]) -> None:
    """All pictures side by side with their names."""
    import PIL.Image
    import PIL.ImageDraw

    height, width = shown[0][1].shape[:2]
    columns = min(4, len(shown))
    rows = math.ceil(len(shown) / columns)
    cell = max(width, 90) + 8, height + 24
    sheet = PIL.Image.new("RGB", (columns * cell[0], rows * cell[1]), "white")
    draw = PIL.ImageDraw.Draw(sheet)
    for i, (name, picture) in enumerate(shown):
        corner = (i % columns) * cell[0] + 4, (i // columns) * cell[1] + 18
        sheet.paste(PIL.Image.fromarray(picture), corner)
        draw.text((corner[0], corner[1] - 14), name, fill="black")
    sheet.save(path)
