"""Patterns: where on an object each of several surfaces is.

A pattern is a function of the place in space (x right, y up, z towards the viewer; shapes fit the
unit sphere), as if the object were carved out of it: no seams, and no texture coordinates needed.
Only a picture may follow those of a mesh.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from malus.scenes.core.errors import InputError
from malus.scenes.core.model import Model
from malus.scenes.core.named_file import NamedFile
from malus.scenes.lights.environment import LARGEST_PIXELS, read_grey

if TYPE_CHECKING:
    import PIL.Image

Size = Annotated[float, Field(ge=1e-3, le=10)]


class Checker(Model):
    """Cubes of edge `size`, of one surface after the other."""

    kind: Literal["checker"] = "checker"
    size: Size = 0.5

    @property
    def label(self) -> str:
        """Name in tables."""
        return "checker"


class Stripes(Model):
    """Slabs across `axis`, `width` thick, of one surface after the other."""

    kind: Literal["stripes"] = "stripes"
    width: Size = 0.25
    axis: Literal["x", "y", "z"] = "y"

    @property
    def label(self) -> str:
        """Name in tables."""
        return f"stripes {self.axis}"


class Spots(Model):
    """Balls of the second surface in the first, on a cubic lattice; further surfaces take turns."""

    kind: Literal["spots"] = "spots"
    spacing: Size = 0.5
    radius: Size = 0.2

    @property
    def label(self) -> str:
        """Name in tables."""
        return "spots"


class ImageTexture(NamedFile):
    """A grey PNG or EXR file: black is the first surface, white the last.

    A grey between is a fine mixture of both neighbours. It is projected along z (`planar`: the
    square −1..1 of x and y), or from the centre (`spherical`: columns by atan2(−x, −z) from 0 to
    2π, rows from +y, upright as seen from outside); or it lies where a mesh file's own texture
    coordinates put it (`uv`: from the lower left corner, repeated beyond 0..1). `digest` is the
    file's hash, which a suite fills in.
    """

    kind: Literal["image"] = "image"
    path: str = Field(min_length=1, max_length=4096)
    projection: Literal["planar", "spherical", "uv"] = "planar"
    what: ClassVar[str] = "picture"

    @property
    def file_name(self) -> str:
        """The file's path."""
        return self.path

    @property
    def label(self) -> str:
        """Name in tables."""
        return Path(self.path).stem

    def grey(self) -> NDArray[np.float32]:
        """Values (rows, columns) in 0..1, rows from the top; PNG's are taken as they are stored.

        Raises
        ------
        InputError
            A file that is missing, malformed or larger than 64 megapixels, a value outside 0..1.
        """
        path = self.checked()
        values = read_grey(path) if path.suffix.lower() == ".exr" else _read_png(path)
        if not np.isfinite(values).all() or values.min() < 0 or values.max() > 1:
            found = f"values from {values.min():g} to {values.max():g}"
            raise InputError(str(path), "values in 0..1", found, "scale the image")
        return values


Pattern = Annotated[Checker | Stripes | Spots | ImageTexture, Field(discriminator="kind")]


def _read_png(path: Path) -> NDArray[np.float32]:
    from PIL import Image

    try:
        with warnings.catch_warnings():
            # Of a size that is refused here anyway, and of odd chunks.
            warnings.simplefilter("ignore")
            return _grey(path, Image.open(path, formats=["PNG"]))
    except InputError:
        raise
    except Exception as error:  # a foreign parser raises anything on a broken file
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(str(path), "a PNG or EXR file", reason, "check the path") from None


def _grey(path: Path, opened: PIL.Image.Image) -> NDArray[np.float32]:
    with opened as picture:
        width, height = picture.size
        if width * height > LARGEST_PIXELS:
            hint = "make it smaller"
            raise InputError(str(path), "at most 64 megapixels", f"{width} x {height}", hint)
        deep = picture.mode.startswith("I")
        values = np.asarray(picture if deep else picture.convert("L"), dtype=np.float32)
    return values / np.float32(65535 if deep else 255)
