"""A trained network in one ONNX file: read, checked, and run on pictures of any size.

Nothing but this module knows the runtime, which is imported when a network is first run.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import Field

from malus.reconstruct.learned.scale import Size, working_size
from malus.reconstruct.observation import Inapplicable
from malus.scenes.core.arrays import Float32Array
from malus.scenes.core.cores import usable_cores
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.model import Model

WEIGHTS = Path(__file__).with_name("weights") / "net.onnx"
"""The network that malus brings."""
INSTALL = "pip install 'malus[net]'"
"""What puts the runtime where it is missing."""
TILE = 512
"""Side of the part of a picture that is kept of one pass of the network: 0.5 GB at most for one of
four megabytes, with the margin around it."""
PROPERTY = "malus"
"""Key of the description among the metadata of the file."""
OUTPUTS = ("stokes", "deviation")
CHANNELS = 3


Magnification = Annotated[float, Field(ge=0.25, le=4)]


class Description(Model):
    """What a file of weights says of itself, of what is used here; `malus train` writes more.

    Attributes
    ----------
    format : 1
    stride : int
        Height and width that the network takes are multiples of it.
    receptive_radius : int
        No output depends on a pixel that is farther away, in rows or columns.
    resolution : int
        Side of the pictures that it was trained on, in pixels.
    magnifications : tuple of float
        Sizes at which it sees a picture, over the working size; the mean of its answers counts.
    validation_skill : float or None
        Median over the validation split.

    Examples
    --------
    >>> Description(stride=16, receptive_radius=40, resolution=128).margin
    48
    """

    format: int = Field(default=1, ge=1, le=1)
    stride: int = Field(ge=1, le=256)
    receptive_radius: int = Field(ge=0, le=4096)
    resolution: int = Field(ge=16, le=16384)
    magnifications: tuple[Magnification, ...] = Field(default=(1.0,), min_length=1, max_length=8)
    validation_skill: float | None = None

    @classmethod
    def of(cls, described: Any, where: str) -> Self:
        """The keys that are used, of all that stand in a file."""
        if not isinstance(described, dict):
            raise InputError(where, "a table of keys", type(described).__name__, "train it again")
        return cls.parse(
            {key: described.get(key) for key in cls.model_fields & described.keys()}, where
        )

    @property
    def margin(self) -> int:
        """Pixels around a tile that reach it: the radius in whole strides."""
        return -(-self.receptive_radius // self.stride) * self.stride

    def sizes(self, shape: Size, side: int | None = None) -> list[Size]:
        """Heights and widths at which the network sees a picture, `side` in place of `resolution`.

        Examples
        --------
        >>> about = Description(
        ...     stride=16, receptive_radius=40, resolution=128, magnifications=(1, 1.5)
        ... )
        >>> about.sizes((3000, 4000)), about.sizes((30, 40)), about.sizes((300, 400), side=64)
        ([(96, 128), (144, 192)], [(30, 40), (45, 60)], [(48, 64), (72, 96)])
        """
        height, width = working_size(shape, side or self.resolution)
        return [(max(1, round(m * height)), max(1, round(m * width))) for m in self.magnifications]


class Output(NamedTuple):
    """s1/s0 and s2/s0, and their standard deviation, each (height, width, 3) for R, G, B.

    Examples
    --------
    >>> Output(*np.zeros((3, 2, 2, 3), np.float32)).s1.shape
    (2, 2, 3)
    """

    s1: Float32Array
    s2: Float32Array
    deviation: Float32Array


@dataclass(frozen=True)
class Network:
    """A network that is ready to run: the same numbers for any number of cores."""

    session: Any
    about: Description

    def run(self, picture: Float32Array, tile: int = TILE) -> Output:
        """Output for a picture (height, width, 3), normalised as in training.

        Sides that are no multiple of the stride are continued by their last pixel. Pictures larger
        than a tile are run in tiles that overlap as far as the network sees, so that no seam can be
        found: only rounding differs.
        """
        height, width = picture.shape[:2]
        stride = self.about.stride
        rest = [(0, -side % stride) for side in (height, width)]
        padded = np.pad(picture, (*rest, (0, 0)), mode="edge").transpose(2, 0, 1)
        whole = np.empty((3 * CHANNELS, *padded.shape[1:]), np.float32)

        def run_tile(parts: _Tile) -> None:
            seen = np.ascontiguousarray(padded[:, parts.seen[0], parts.seen[1]][None])
            outputs = self.session.run(OUTPUTS, {"image": seen})
            joined = np.concatenate([output[0] for output in outputs])
            whole[:, parts.kept[0], parts.kept[1]] = joined[:, parts.inside[0], parts.inside[1]]

        tiles = list(_tiles(padded.shape[1:], tile, stride, self.about.margin))
        # Each pass has one thread, so that sums are formed in one order; tiles are shared out.
        with ThreadPoolExecutor(max_workers=min(len(tiles), usable_cores())) as pool:
            list(pool.map(run_tile, tiles))
        cut = whole[:, :height, :width].transpose(1, 2, 0)
        return Output(cut[..., :3], cut[..., 3:6], cut[..., 6:])


class _Tile(NamedTuple):
    """Rows and columns of a tile: what the network sees, what is kept, and where that lies."""

    seen: tuple[slice, slice]
    kept: tuple[slice, slice]
    inside: tuple[slice, slice]


def _tiles(shape: tuple[int, ...], tile: int, stride: int, margin: int) -> Iterator[_Tile]:
    """Tiles that cover a picture; their corners are multiples of the stride, as the whole's is."""
    step = max(stride, tile // stride * stride)
    spans = [[_span(start, step, side, margin) for start in range(0, side, step)] for side in shape]
    for rows in spans[0]:
        for columns in spans[1]:
            yield _Tile(*zip(rows, columns, strict=True))


def _span(start: int, step: int, side: int, margin: int) -> tuple[slice, slice, slice]:
    """Of one axis: the span that is seen, the span that is kept, and its place in the first."""
    end = min(start + step, side)
    first, last = max(0, start - margin), min(side, end + margin)
    return slice(first, last), slice(start, end), slice(start - first, end - first)


def network(path: Path | None = None) -> Network:
    """The network of a file, or the one that malus brings; kept, as long as the file stays.

    Raises
    ------
    Inapplicable
        Without the runtime, or where malus was installed without its weights: what to do, in words.
    InputError
        If the file is missing, damaged, or no network that `malus train` wrote.
    """
    file = WEIGHTS if path is None else path
    if not file.is_file():
        if path is None:
            raise Inapplicable("this copy of malus has no trained weights; name your own, net:FILE")
        raise InputError(str(path), "a file of trained weights", "no such file", "check the path")
    require_runtime()
    status = file.stat()
    return _loaded(str(file), status.st_mtime_ns, status.st_size)


def require_runtime() -> Any:
    """The runtime's module.

    Raises
    ------
    Inapplicable
        Without it; the message says how to install it.
    """
    try:
        import onnxruntime
    except ImportError:
        raise Inapplicable(f"the network needs onnxruntime: {INSTALL}") from None
    return onnxruntime


@functools.lru_cache(maxsize=4)
def _loaded(file: str, _changed: int, _size: int) -> Network:
    runtime = require_runtime()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.enable_cpu_mem_arena = False  # it would keep the largest tile's memory for good
    options.log_severity_level = 3
    expected = "a network that `malus train` wrote"
    with reading(file, expected, "train it again, or give another file"):
        session = runtime.InferenceSession(file, options, providers=["CPUExecutionProvider"])
        described = session.get_modelmeta().custom_metadata_map.get(PROPERTY)
        if described is None:
            raise InputError(file, expected, "one without a description", "give another file")
        about = Description.of(json.loads(described), f"{file}, description")
        _check_form(file, session)
    return Network(session, about)


def _check_form(file: str, session: Any) -> None:
    """Refuse networks of other inputs and outputs."""
    names = [
        [node.name for node in nodes] for nodes in (session.get_inputs(), session.get_outputs())
    ]
    if names[0] != ["image"] or not set(OUTPUTS) <= set(names[1]):
        found = f"{', '.join(names[0])} to {', '.join(names[1])}"
        raise InputError(file, "image to stokes, deviation", found, "give another file")
