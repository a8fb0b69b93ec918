"""Patterns: which of several surfaces each point of an object has.

A pattern is a function of the position in space (x right, y up, z towards the viewer; shapes fit
the unit sphere), as if the object were carved out of a patterned block: there are no seams, and no
texture coordinates are needed. Only a picture may use those of a mesh.
"""

from __future__ import annotations

import math
import random
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from malus.scenes.core.arrays import Float32Array, Float64Array
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.model import Model
from malus.scenes.core.named_file import NamedFile
from malus.scenes.lights.environment import check_size, read_grey

if TYPE_CHECKING:
    import PIL.Image

Size = Annotated[float, Field(ge=1e-3, le=10)]

GRAIN = 6.0
"""How many times longer the waves of a noise are along its grain."""

_OCTAVES = (0.0, 0.0, 0.0, 0.5, 0.5, 1.0, 1.5)
"""Binary logarithms of the size over the length of each wave of a noise."""


class Checker(Model):
    """Cubes of edge `size`, of which neighbours have different surfaces in turn.

    Examples
    --------
    >>> Checker(size=0.4).label
    'checker'
    """

    kind: Literal["checker"] = "checker"
    size: Size = 0.5

    @property
    def label(self) -> str:
        """Name in tables."""
        return "checker"


class Stripes(Model):
    """Slabs across `axis`, `width` thick, which have the surfaces in turn.

    Examples
    --------
    >>> Stripes(width=0.1, axis="x").label
    'stripes x'
    """

    kind: Literal["stripes"] = "stripes"
    width: Size = 0.25
    axis: Literal["x", "y", "z"] = "y"

    @property
    def label(self) -> str:
        """Name in tables."""
        return f"stripes {self.axis}"


class Spots(Model):
    """Balls of the second surface in the first, on a cubic lattice; further surfaces in turn.

    Examples
    --------
    >>> Spots(spacing=0.4, radius=0.1).label
    'spots'
    """

    kind: Literal["spots"] = "spots"
    spacing: Size = 0.5
    radius: Size = 0.2

    @property
    def label(self) -> str:
        """Name in tables."""
        return "spots"


class Noise(Model):
    """Patches of a smooth random field, of equal area on average: marble, speckles, wood.

    The field is a sum of waves whose lengths are between `size` and a third of it; along `grain`
    they are six times as long. Where it is `soft`, a place between is a fine mixture of both
    neighbours; else patches have sharp edges.

    Examples
    --------
    >>> Noise(seed=3).label
    'noise'
    """

    kind: Literal["noise"] = "noise"
    seed: int = Field(default=0, ge=0)
    size: Size = 0.5
    grain: Literal["none", "x", "y", "z"] = "none"
    soft: bool = False

    @property
    def label(self) -> str:
        """Name in tables."""
        return "noise" if self.grain == "none" else f"noise {self.grain}"

    def waves(self) -> Float64Array:
        """Wave vectors, phases and amplitudes of the field, (waves, 5); its variance is 1.

        The field at a point p is the sum of a sin(k · p + φ) over the rows (k, φ, a).

        Examples
        --------
        >>> round(float((Noise().waves()[:, 4] ** 2).sum() / 2), 9)
        1.0
        """
        # The standard library promises the same random() for a seed in every version.
        draw = random.Random(self.seed).random
        rows = [self._wave(draw, octave) for octave in _OCTAVES]
        waves = np.array(rows)
        waves[:, 4] *= math.sqrt(2.0 / (waves[:, 4] ** 2).sum())
        return waves

    def _wave(self, draw: Callable[[], float], octave: float) -> tuple[float, ...]:
        """A wave vector of random direction, its phase and its amplitude, before scaling."""
        z, azimuth = 2.0 * draw() - 1.0, 2.0 * math.pi * draw()
        ring, length = math.sqrt(max(0.0, 1.0 - z * z)), self.size * 2.0**-octave
        toward = np.array([ring * math.cos(azimuth), ring * math.sin(azimuth), z])
        if self.grain != "none":
            toward["xyz".index(self.grain)] /= GRAIN
        wave = toward * (2.0 * math.pi / length)
        return (*map(float, wave), 2.0 * math.pi * draw(), 2.0**-octave)


class ImageTexture(NamedFile):
    """A grey PNG or EXR file: black is the first surface, white the last.

    A grey between is a fine mixture of both neighbours. It is projected along z (`planar`: the
    square −1..1 of x and y; it lies on a plane's own face, upright on a wall), or from the centre
    (`spherical`: columns by atan2(−x, −z) from 0 to 2π, rows from +y, upright as seen from
    outside); or it follows a mesh file's own texture coordinates (`uv`: from the lower left corner,
    repeated beyond 0..1). `digest` is the file's hash, which a suite fills in.

    Examples
    --------
    >>> ImageTexture(path="leaf.png", projection="spherical").file_name
    'leaf.png'
    """

    kind: Literal["image"] = "image"
    path: str = Field(min_length=1, max_length=4096)
    projection: Literal["planar", "spherical", "uv"] = "planar"
    file_kind: ClassVar[str] = "picture"

    @property
    def file_name(self) -> str:
        """The file's path."""
        return self.path

    @property
    def label(self) -> str:
        """Name in tables."""
        return Path(self.path).stem

    def grey(self) -> Float32Array:
        """Grey values (rows, columns) in 0..1, rows from the top; a PNG is not linearised.

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


Pattern = Annotated[Checker | Stripes | Spots | Noise | ImageTexture, Field(discriminator="kind")]


_PNG_DEPTH = 24
"""Place of the bits a channel in a PNG file."""
_LUMA = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in grey, as Pillow has them for 8 bits (ITU-R 601-2)."""


def _read_png(path: Path) -> Float32Array:
    from PIL import Image

    with reading(str(path), "a PNG or EXR file", "check the path"), warnings.catch_warnings():
        # Of a size that is refused here anyway, and of odd chunks.
        warnings.simplefilter("ignore")
        return _grey(path, Image.open(path, formats=["PNG"]))


def _grey(path: Path, opened: PIL.Image.Image) -> Float32Array:
    """Grey values in 0..1 of an opened PNG, of 8 or 16 bits."""
    with opened as picture:
        check_size(path, *picture.size)
        content = path.read_bytes()
        if content[_PNG_DEPTH] == 16:
            return _deep(content)
        values = np.asarray(picture.convert("L"), dtype=np.float32)
    return values / np.float32(255)


def _deep(content: bytes) -> Float32Array:
    """The same of 16 bits, of which Pillow reads colours and opacity with 8."""
    import imagecodecs

    codes = np.atleast_3d(imagecodecs.png_decode(content))
    is_colour = codes.shape[2] > 2
    grey = codes[..., :3] @ np.array(_LUMA) if is_colour else codes[..., 0]
    return np.asarray(grey, dtype=np.float32) / np.float32(65535)
