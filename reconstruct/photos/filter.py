"""A virtual polarising filter on an ordinary picture: `malus filter`."""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct import Components
from malus.reconstruct.photos.contact_sheet import SHEET_SIDE, reduced, sheet, thumbnail
from malus.reconstruct.photos.estimate import Estimate, Knowledge, estimate
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.png16 import aolp_16bit, save_16bit, to_16bit
from malus.reconstruct.photos.write_picture import write_picture
from malus.scenes import polarisation
from malus.scenes.core.errors import InputError

Progress = Callable[[str, float], None]
"""Told what is being done, and the share that is done."""

SWEEP_SIDE = 512
SWEEP_FRAMES = 36
_UNPOLARISED = 0.002
"""DoLP below which the contact sheet shows no angle."""
_CLIPPED = 0.001
"""Share of clipped pixels from which their loss is worth a line."""


@dataclass(frozen=True)
class Output:
    """What is written: I(ϑ) at `angles_deg`, and an animation where `sweep`.

    `physical` keeps the stop of light that a real filter takes away; otherwise the exposure makes
    up for it, so that unpolarised light looks as before.
    """

    angles_deg: Sequence[float] = (0.0, 45.0, 90.0, 135.0)
    sweep: bool = False
    physical: bool = False


@dataclass(frozen=True)
class Filtered:
    """Files that were written, in words what they rest on, and why not to believe them."""

    files: tuple[Path, ...]
    statements: tuple[str, ...]
    warnings: tuple[str, ...]


def filter_picture(
    picture: Picture,
    stem: str,
    out: Path,
    known: Knowledge,
    output: Output | None = None,
    progress: Progress | None = None,
) -> Filtered:
    """Estimate the polarisation of a picture and write it through a virtual polariser.

    Writes STEM_angle000 …, STEM_imax and STEM_imin in the picture's own form; STEM_dolp.png (0
    to 1) and STEM_aolp.png (180° are 65536, from +x) with 16 bits; STEM_sheet.png, STEM_sweep.gif.

    Parameters
    ----------
    picture : Picture, from `read_picture`
    stem : name that files start with, and errors
    out : folder, made if it is missing
    known : what is known besides

    Returns
    -------
    Filtered

    Raises
    ------
    InputError
        An angle that is no number, a picture that nothing can be told from, a folder that cannot
        be written. Then nothing is.
    """
    output, tell = output or Output(), progress or (lambda _what, _share: None)
    _check_angles(output.angles_deg)
    tell("separating light and estimating polarisation", 0.05)
    where = f"{stem}{picture.suffix}"
    if picture.clipped == 1.0:
        raise InputError(where, "light that is not clipped", "none", "expose it again")
    found = estimate(picture.linear, known, where)
    with all_or_nothing(out) as folder:
        _write(folder, stem, picture, found.components, output, tell)
        names = sorted(path.name for path in folder.iterdir())
    tell("done", 1.0)
    files = tuple(out / name for name in names)
    return Filtered(files, _statements(picture, found, output), _warnings(picture, found))


def _check_angles(angles_deg: Sequence[float]) -> None:
    for angle in angles_deg:
        if not math.isfinite(angle):
            raise InputError("--angle", "degrees from the vertical", f"{angle}", "correct it")


def _statements(picture: Picture, found: Estimate, output: Output) -> tuple[str, ...]:
    said = [picture.assumption, *found.statements]
    if not output.physical:
        said.append("exposure makes up for the filter's one stop; --physical leaves it out")
    return tuple(said)


def _warnings(picture: Picture, found: Estimate) -> tuple[str, ...]:
    if picture.clipped <= _CLIPPED:
        return found.warnings
    clipped = f"{picture.clipped:.1%} of the pixels are clipped: their highlights are too weak"
    return (*found.warnings, clipped)


def _write(
    folder: Path, stem: str, picture: Picture, found: Components, output: Output, tell: Progress
) -> None:
    gain = np.float32(1.0 if output.physical else 2.0)
    half_field = 0.5 * np.hypot(found.s1, found.s2)
    views: list[tuple[str, Callable[[], NDArray[Any]]]] = [
        (_name(angle), _view(found, angle)) for angle in output.angles_deg
    ]
    views += [
        ("imax", lambda: 0.5 * found.image + half_field),
        ("imin", lambda: 0.5 * found.image - half_field),
    ]
    shown = []
    for i, (name, view) in enumerate(views):
        tell(f"writing {name}", 0.3 + 0.6 * i / len(views))
        seen = picture.showing(np.maximum(gain * view(), 0))
        write_picture(folder / f"{stem}_{name}{picture.suffix}", seen)
        shown.append((name, thumbnail(seen.linear, picture, SHEET_SIDE)))
    tell("writing maps", 0.92)
    shown += _maps(folder, stem, found)
    sheet(folder / f"{stem}_sheet.png", shown)
    if output.sweep:
        tell("writing the sweep", 0.95)
        _sweep(folder / f"{stem}_sweep.gif", picture, found, gain)


def _view(found: Components, angle_deg: float) -> Callable[[], NDArray[Any]]:
    return lambda: polarised(found, angle_deg)


def polarised(found: Components, angle_deg: float) -> NDArray[Any]:
    """I(ϑ) without stacking the three planes, which for a large picture would be copies."""
    stokes = np.eye(3, dtype=np.float64)
    c0, c1, c2 = (found.image.dtype.type(w) for w in polarisation.polarised(stokes, angle_deg))
    result: NDArray[Any] = c0 * found.image + c1 * found.s1 + c2 * found.s2
    return result


def _name(angle_deg: float) -> str:
    return f"angle{round(angle_deg, 2) % 180.0:06.2f}".rstrip("0").rstrip(".")


def _maps(folder: Path, stem: str, found: Components) -> list[tuple[str, NDArray[np.uint8]]]:
    """DoLP and AoLP of the sum over the bands, as 16-bit grey and as thumbnails."""
    from matplotlib import colormaps

    stokes = np.stack([a.sum(axis=-1) for a in (found.image, found.s1, found.s2)], axis=-1)
    dolp = np.clip(polarisation.dolp(stokes), 0, 1)
    aolp = polarisation.aolp(stokes) / np.pi
    save_16bit(folder / f"{stem}_dolp.png", to_16bit(dolp))
    save_16bit(folder / f"{stem}_aolp.png", aolp_16bit(stokes))
    shown = []
    for name, values, colours in (("dolp", dolp, "viridis"), ("aolp", aolp, "twilight")):
        small = reduced(values[..., None], SHEET_SIDE)[..., 0]
        picture = (colormaps[colours](small)[..., :3] * 255).astype(np.uint8)
        if name == "aolp":
            # Light that is not polarised has no angle.
            picture[reduced(dolp[..., None], SHEET_SIDE)[..., 0] < _UNPOLARISED] = 128
        shown.append((f"{name} 0 to {'1' if name == 'dolp' else '180'}", picture))
    return shown


def _sweep(path: Path, picture: Picture, found: Components, gain: np.float32) -> None:
    """An animation through 180° of the polariser."""
    import PIL.Image

    image, s1, s2 = (reduced(a, SWEEP_SIDE) for a in (found.image, found.s1, found.s2))
    small = Components(image, s1, s2)
    angles = np.arange(SWEEP_FRAMES) * (180.0 / SWEEP_FRAMES)
    frames = [
        PIL.Image.fromarray(thumbnail(gain * polarised(small, float(a)), picture, SWEEP_SIDE))
        for a in angles
    ]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=80, loop=0)


@contextlib.contextmanager
def all_or_nothing(out: Path) -> Iterator[Path]:
    """A folder beside `out` whose files move into it when all of them are whole."""
    made = False
    try:
        made = not out.exists()
        out.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(dir=out, prefix=".part-"))
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(str(out), "a folder to write to", reason, "choose another --out") from None
    try:
        yield folder
        for path in folder.iterdir():
            os.replace(path, out / path.name)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        if made:
            with contextlib.suppress(OSError):
                out.rmdir()
        raise
    shutil.rmtree(folder, ignore_errors=True)
