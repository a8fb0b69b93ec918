"""Raw files of cameras, DNG among them, developed by LibRaw through rawpy, where that is installed.

Their values are proportional to light. Whatever LibRaw would choose from a picture itself (white
level, brightness, the white balance of the shot) is switched off: pictures through a polariser must
keep their relation to each other.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from malus.reconstruct.photos.picture import Picture, check_size, from_codes
from malus.reconstruct.photos.tone_curves import linear_transfer
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.quiet import quiet

RAW_SUFFIXES = frozenset(
    {".dng", ".cr2", ".cr3", ".nef", ".nrw", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw"}
)
_NOTE = (
    "a camera's raw file, developed: colours are the camera's own, in its white balance for"
    " daylight, and written as a TIFF of linear light"
)


def read_camera_raw(path: Path) -> Picture:
    """A raw file as linear light of 16 bits in the camera's own colours, upright.

    Raises
    ------
    InputError
        Without rawpy, and for a file that LibRaw cannot read.
    """
    try:
        rawpy: Any = importlib.import_module("rawpy")
    except ImportError:
        hint = "pip install rawpy, or develop it to a linear 16-bit TIFF with dcraw or darktable"
        raise InputError(
            str(path), "the package rawpy for a camera's raw file", "nothing", hint
        ) from None
    with (
        reading(str(path), "a raw file that LibRaw reads", "develop it to a 16-bit TIFF"),
        quiet(),
        rawpy.imread(str(path)) as raw,
    ):
        check_size(path, raw.sizes.width, raw.sizes.height)
        daylight = [float(value) for value in raw.daylight_whitebalance[:3]]
        balance = [*daylight, daylight[1]] if min(daylight) > 0 else [1.0] * 4
        codes = raw.postprocess(
            gamma=(1, 1),
            output_bps=16,
            output_color=rawpy.ColorSpace.raw,
            no_auto_bright=True,
            adjust_maximum_thr=0.0,  # by default the brightest pixel moves the white level
            user_wb=balance,
        )
    return from_codes(codes, "TIFF", linear_transfer(16), {}, notes=(_NOTE,))
