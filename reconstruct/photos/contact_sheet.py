"""Small sRGB copies of pictures, side by side on one sheet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.photos.picture import Picture
from malus.scenes.core.arrays import AnyArray

SHEET_SIDE = 320
"""Pixels of the longer side of a thumbnail."""
_FILES = "malus filter"
"""Key of the text that tells which files were written together with a sheet."""


def reduced(values: AnyArray, side: int) -> AnyArray:
    """Every n-th pixel of an image (height, width, channels): its longer side is at most `side`."""
    step = max(1, math.ceil(max(values.shape[:2]) / side))
    return values[::step, ::step]


def thumbnail(linear: AnyArray, picture: Picture, side: int) -> NDArray[np.uint8]:
    """A small sRGB copy of light (height, width, channels) that belongs to a picture.

    Pictures of floats have no white: theirs is the light that one pixel in a hundred exceeds.
    """
    from malus.reconstruct.photos.tone_curves import srgb_transfer

    small = reduced(linear, side)
    white = 1.0 if picture.transfer is not None else float(np.quantile(picture.linear, 0.99)) or 1.0
    codes = srgb_transfer(8).encoded(small / white)
    return np.asarray(np.repeat(codes, 3, axis=-1) if codes.shape[-1] == 1 else codes)


def write_sheet(
    path: Path, thumbnails: Sequence[tuple[str, NDArray[np.uint8]]], files: Sequence[str]
) -> None:
    """Write one PNG of named thumbnails (height, width, 3), side by side under their names.

    It keeps the names of the `files` that are written beside it, for `files_beside`.
    """
    import PIL.Image
    import PIL.ImageDraw
    import PIL.PngImagePlugin

    height, width = thumbnails[0][1].shape[:2]
    columns = min(4, len(thumbnails))
    rows = math.ceil(len(thumbnails) / columns)
    cell = max(width, 90) + 8, height + 24
    sheet = PIL.Image.new("RGB", (columns * cell[0], rows * cell[1]), "white")
    draw = PIL.ImageDraw.Draw(sheet)
    for i, (name, picture) in enumerate(thumbnails):
        corner = (i % columns) * cell[0] + 4, (i // columns) * cell[1] + 18
        sheet.paste(PIL.Image.fromarray(picture), corner)
        draw.text((corner[0], corner[1] - 14), name, fill="black")
    told = PIL.PngImagePlugin.PngInfo()
    told.add_itxt(_FILES, "\n".join(files))
    sheet.save(path, pnginfo=told)


def files_beside(sheet: Path) -> set[str]:
    """Names of the files that were written beside a sheet; none where it tells none."""
    import PIL.Image

    with suppress(Exception), PIL.Image.open(sheet, formats=("PNG",)) as image:
        text = str(getattr(image, "text", {}).get(_FILES, ""))
        return {name for name in text.splitlines() if Path(name).name == name}
    return set()
