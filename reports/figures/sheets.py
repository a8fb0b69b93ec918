"""Sheets of captioned pictures: one JPEG for a document.

Renders keep some noise, which a PNG of the same look would need five times the bytes for.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from malus.reports.figures.stokes_pictures import Codes, angle_wheel, degree_bar
from malus.scenes.core.files import write_whole

_PAPER, _INK, _SOFT = (255, 255, 255), (35, 35, 43), (98, 98, 110)
_GAP = 8
_LINE = 1.3
"""Height of a line of text over the size of its letters."""


@dataclass(frozen=True)
class Tile:
    """Pictures (height, width, 3) side by side under one caption.

    Attributes
    ----------
    caption : str
    pictures : sequence of arrays of 8-bit codes, all of one height
    most : float or None
        The degree at the right end of a bar of colours below, where there shall be one.
    wheel : bool
        Whether the legend of angles stands below.
    """

    caption: str
    pictures: Sequence[Codes]
    most: float | None = None
    wheel: bool = False


def write_sheet(path: Path, tiles: Sequence[Tile], columns: int, side: int, letters: int) -> None:
    """Write a sheet of tiles as a JPEG, whole or not at all.

    Parameters
    ----------
    path : Path
    tiles : sequence of Tile, row by row
    columns : int
    side : int
        Height of every picture in the sheet, in pixels.
    letters : int
        Size of the captions' letters in pixels.
    """
    sheet = draw_sheet(tiles, columns, side, letters)
    buffer = io.BytesIO()
    sheet.save(buffer, "JPEG", quality=82, subsampling=0, optimize=True, progressive=True)
    write_whole(path, lambda temporary: temporary.write_bytes(buffer.getvalue()))


def draw_sheet(tiles: Sequence[Tile], columns: int, side: int, letters: int) -> Image.Image:
    """The sheet as an image; see `write_sheet`."""
    blocks = [_block(tile, side, letters) for tile in tiles]
    rows = [blocks[start : start + columns] for start in range(0, len(blocks), columns)]
    heights = [max(block.height for block in row) for row in rows]
    widths = [max(block.width for block in blocks[k::columns]) for k in range(len(rows[0]))]
    size = (sum(widths) + _GAP * (len(widths) + 1), sum(heights) + _GAP * (len(rows) + 1))
    sheet = Image.new("RGB", size, _PAPER)
    top = _GAP
    for row, height in zip(rows, heights, strict=True):
        left = _GAP
        for block, width in zip(row, widths, strict=False):
            sheet.paste(block, (left, top))
            left += width + _GAP
        top += height + _GAP
    return sheet


def _block(tile: Tile, side: int, letters: int) -> Image.Image:
    """A tile: its pictures, the caption below, and the legend below that."""
    pictures = [_scaled(codes, side) for codes in tile.pictures]
    width = sum(picture.width for picture in pictures)
    font = _font(letters)
    lines = textwrap.wrap(tile.caption, max(8, int(width / (0.56 * letters)))) or [""]
    text = int(_LINE * letters)
    has_legend = tile.wheel or tile.most is not None
    legend = max(text, 3 * letters if tile.wheel else 0) if has_legend else 0
    block = Image.new("RGB", (width, side + len(lines) * text + legend + 4), _PAPER)
    left = 0
    for picture in pictures:
        block.paste(picture, (left, 0))
        left += picture.width
    draw = ImageDraw.Draw(block)
    for number, line in enumerate(lines):
        draw.text((0, side + 3 + number * text), line, _INK, font)
    if has_legend:
        _legend(block, tile, side + 3 + len(lines) * text, letters)
    return block


def _legend(block: Image.Image, tile: Tile, top: int, letters: int) -> None:
    font, draw = _font(int(0.85 * letters)), ImageDraw.Draw(block)
    if tile.wheel:
        size = 3 * letters - 4
        block.paste(Image.fromarray(angle_wheel(size, _PAPER[0])), (0, top))
        words = "direction of vibration; grey: not polarised"
        draw.text((size + letters // 2, top + size // 2 - letters // 2), words, _SOFT, font)
        return
    ends = ("0", f"{100 * (tile.most or 0):.0f} %")
    first, last = (int(font.getlength(end)) + letters // 2 for end in ends)
    bar = degree_bar(max(1, block.width - first - last), max(4, letters // 2))
    draw.text((0, top), ends[0], _SOFT, font)
    block.paste(Image.fromarray(bar), (first, top + letters // 3))
    draw.text((block.width - last + letters // 2, top), ends[1], _SOFT, font)


def _scaled(codes: Codes, side: int) -> Image.Image:
    """A picture of the height `side`: whole steps where it is enlarged much, smooth otherwise."""
    picture = Image.fromarray(np.ascontiguousarray(codes))
    width = max(1, round(side * picture.width / picture.height))
    return picture.resize((width, side), Image.Resampling.LANCZOS)


def _font(size: int) -> ImageFont.FreeTypeFont:
    from matplotlib.font_manager import findfont

    return ImageFont.truetype(findfont("DejaVu Sans"), size)
