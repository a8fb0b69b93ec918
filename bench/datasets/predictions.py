"""Read, check and hash images that were predicted elsewhere for the scenes of a dataset.

A folder of predictions has one of these for every scene of the dataset:

- `<scene>.npz` with `stokes` (height, width, bands, 3), or with `i_max`, `i_min` and `phase`
  (height, width, bands). Phase is the polariser angle of I_max in radians, anticlockwise from the
  vertical as displayed; Stokes vectors have their axis along +x and s2 > 0 at +45°.
- `<scene>.exr` in the spectral layout, as `stokes.exr` of the dataset.
- a folder `<scene>/` with `<degrees>.npy` (height, width, bands) for three or more polariser
  angles, anticlockwise from the vertical: `0.npy`, `45.npy`, `90.npy`.

Arrays are finite float32 or float64, rows from the top, radiance in the unit of the dataset.
Nothing is pickled, and no array is allocated before its size is known to be right.
"""

from __future__ import annotations

import hashlib
import math
import re
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from malus.renderers.datasets.dataset import Dataset
from malus.renderers.datasets.scene_folder import SceneRecord
from malus.renderers.datasets.spectral_exr import read_spectral
from malus.scenes import polarisation
from malus.scenes.core.arrays import FloatArray
from malus.scenes.core.errors import InputError, first_line
from malus.scenes.core.files import digest, open_regular

Shape = tuple[int, ...]

EXTREMES = ("i_max", "i_min", "phase")
_ID = re.compile(r"[0-9a-f]{16}")
_DAMAGED = (
    zipfile.BadZipFile, zlib.error, ValueError, RuntimeError, EOFError, KeyError, OSError,
    NotImplementedError, MemoryError, tokenize.TokenError,
)  # fmt: skip
_HINT = "the help of `malus score` tells what is expected"


@dataclass(frozen=True)
class Predictions:
    """Files of predictions by scene id.

    Attributes
    ----------
    folder : Path
    paths : dict of scene id to file or folder
    """

    folder: Path
    paths: dict[str, Path]

    def stokes(self, record: SceneRecord) -> FloatArray:
        """The predicted Stokes image (height, width, bands, 3) of a scene.

        Raises
        ------
        InputError
            The first problem of this prediction.
        """
        arrays: dict[str, FloatArray] = {}
        problems = list(_read(self.paths[record.scene.id], record, arrays))
        if problems:
            raise problems[0]
        return arrays["stokes"]

    def problems(self, record: SceneRecord) -> list[InputError]:
        """Everything that is wrong with the prediction of a scene."""
        if record.scene.id not in self.paths:
            expected = f"{record.scene.id}.npz, {record.scene.id}.exr or {record.scene.id}/"
            return [InputError(str(self.folder), expected, "nothing", _HINT)]
        return list(_read(self.paths[record.scene.id], record, {}))

    def of(self, scenes: Collection[str]) -> Predictions:
        """Those of some scenes."""
        chosen = {scene: path for scene, path in self.paths.items() if scene in scenes}
        return replace(self, paths=chosen)

    def sha256(self) -> str:
        """Hash of the names and contents of all files."""
        total = hashlib.sha256()
        for file in self._every_file():
            total.update(f"{file.relative_to(self.folder)} {digest(file)[1]}\n".encode())
        return total.hexdigest()

    def _every_file(self) -> Iterator[Path]:
        for path in sorted(self.paths.values()):
            yield from sorted(path.glob("*.npy")) if path.is_dir() else [path]


class PredictionErrors(InputError):
    """Predictions that cannot be scored; `problems` lists what is wrong, one InputError each.

    A traceback shows all of them, as notes.

    Examples
    --------
    >>> problem = InputError("a.npz", "finite values", "3 that are not", "zero off the object")
    >>> print(PredictionErrors.of(Path("mine"), 4, [problem]))
    mine: expected a good prediction for each of 4 scenes, found 1 problem(s); correct them all,
    then score again
    """

    problems: tuple[InputError, ...] = ()

    @classmethod
    def of(cls, folder: Path, scenes: int, problems: Sequence[InputError]) -> PredictionErrors:
        """The error that lists all problems of a folder of predictions for that many scenes."""
        expected = f"a good prediction for each of {scenes} scenes"
        hint = "correct them all, then score again"
        error = cls(str(folder), expected, f"{len(problems)} problem(s)", hint)
        error.problems = tuple(problems)
        for problem in problems:
            error.add_note(str(problem))
        return error


def find_predictions(folder: Path, dataset: Dataset) -> tuple[Predictions, list[InputError]]:
    """Predictions in a folder, and problems: files that belong to no scene, or a second of one.

    Raises
    ------
    InputError
        If the folder cannot be read.
    """
    scenes, paths = set(dataset.scenes), dict[str, Path]()
    problems = []
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(str(folder), "a folder of predictions", reason, _HINT) from None
    for path in entries:
        name = path.stem if path.suffix in (".npz", ".exr") else path.name
        if name in paths:
            problems.append(InputError(str(path), "one prediction a scene", "a second", _HINT))
        elif name in scenes:
            paths[name] = path
        elif path.suffix in (".npz", ".exr") or _ID.fullmatch(name):
            problems.append(InputError(str(path), "a scene of the dataset", name, _HINT))
    return Predictions(folder, paths), problems


def problems_of(
    dataset: Dataset, predictions: Predictions, progress: Callable[[int, int, str], None]
) -> list[InputError]:
    """Every problem of the prediction of every scene."""
    problems = []
    for done, scene_id in enumerate(dataset.scenes):
        progress(done, len(dataset), f"checking {scene_id}")
        problems += predictions.problems(dataset.scene(scene_id))
    return problems


def _read(path: Path, record: SceneRecord, out: dict[str, FloatArray]) -> Iterator[InputError]:
    """Yield the problems of a prediction; where there is none, `out` gets its Stokes image."""
    shape = (*record.shape, len(record.scene.wavelengths_nm))
    if path.is_symlink():
        yield InputError(str(path), "a file or a folder", "a link", "copy the file")
    elif path.is_dir():
        yield from _read_angles(path, shape, out)
    elif path.suffix == ".npz":
        yield from _read_npz(path, shape, out)
    elif path.suffix == ".exr":
        try:
            out["stokes"] = read_spectral(path, record.shape, record.scene.wavelengths_nm)
            yield from _not_finite(str(path), out["stokes"])
        except InputError as problem:
            yield problem
    else:
        yield InputError(str(path), "a .npz, a .exr or a folder", "another file", _HINT)


def _read_npz(path: Path, shape: Shape, out: dict[str, FloatArray]) -> Iterator[InputError]:
    expected = "arrays stokes, or i_max, i_min and phase"
    arrays: dict[str, FloatArray] = {}
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            names = {name.removesuffix(".npy") for name in archive.namelist()[:100]}
            wanted = ("stokes",) if "stokes" in names else EXTREMES
            if set(wanted) - names:
                yield InputError(str(path), expected, ", ".join(sorted(names)), _HINT)
                return
            for name in wanted:
                size = (*shape, 3) if name == "stokes" else shape
                with archive.open(f"{name}.npy") as member:
                    yield from _array(member, f"{path}, array {name}", size, arrays, name)
    except InputError as problem:
        yield problem
    except _DAMAGED as error:
        yield InputError(str(path), "an .npz file", first_line(error), "write it again")
    if "stokes" in arrays:
        out["stokes"] = arrays["stokes"]
    elif len(arrays) == len(EXTREMES):
        yield from _in_degrees(path, arrays["phase"])
        out["stokes"] = polarisation.stokes_from_extremes(*(arrays[name] for name in EXTREMES))


def _read_angles(folder: Path, shape: Shape, out: dict[str, FloatArray]) -> Iterator[InputError]:
    """A folder of images by polariser angle; least squares where there are more than three."""
    arrays: dict[str, FloatArray] = {}
    angles: list[float] = []
    clean = True
    for path in sorted(folder.glob("*.npy")):
        angle = _angle(path.stem)
        problems = [InputError(str(path), "a name in degrees, as 45.npy", path.stem, _HINT)]
        if angle is not None:
            try:
                with open_regular(path) as file:
                    problems = list(_array(file, str(path), shape, arrays, path.stem))
            except InputError as problem:
                problems = [problem]
            angles.append(angle)
        clean = clean and not problems
        yield from problems
    if not polarisation.tell_stokes(angles):
        listed = ", ".join(f"{angle:g}" for angle in angles) or "none"
        yield InputError(str(folder), "three different polariser angles", listed, _HINT)
    elif clean:
        images = np.stack(list(arrays.values()), axis=-1)
        out["stokes"] = images @ np.linalg.pinv(polarisation.analyser(angles)).T


def _angle(text: str) -> float | None:
    try:
        angle = float(text)
    except ValueError:
        return None
    return angle if math.isfinite(angle) else None


def _array(
    stream: IO[bytes], where: str, shape: Shape, arrays: dict[str, FloatArray], name: str
) -> Iterator[InputError]:
    """Read one .npy of a known shape; its header is judged before its data are read."""
    try:
        readers = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }
        written, fortran, dtype = readers[np.lib.format.read_magic(stream)](stream)
        if dtype.kind != "f" or dtype.itemsize not in (4, 8):
            yield InputError(where, "float32 or float64", str(dtype), "convert it")
            return
        if written != shape:
            yield InputError(where, f"shape {shape}", str(written), "height, width, bands")
            return
        raw = stream.read(math.prod(shape) * dtype.itemsize)
        flat = np.frombuffer(raw, dtype)
        array: FloatArray = flat.reshape(shape, order="F" if fortran else "C")
    except _DAMAGED as error:
        yield InputError(where, "an .npy array", first_line(error), "write it again")
        return
    yield from _not_finite(where, array)
    arrays[name] = array


def _not_finite(where: str, array: FloatArray) -> Iterator[InputError]:
    wrong = int(np.size(array) - np.isfinite(array).sum())
    if wrong:
        yield InputError(where, "finite values", f"{wrong} that are not", "zero off the object")


def _in_degrees(path: Path, phase: FloatArray) -> Iterator[InputError]:
    largest = float(np.abs(phase).max())
    if largest > 2 * math.pi + 0.1:
        where = f"{path}, array phase"
        yield InputError(where, "radians", f"up to {largest:.4g}", "are these degrees?")
