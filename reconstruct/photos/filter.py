"""A virtual polarising filter on an ordinary picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.observation import Components
from malus.reconstruct.photos.contact_sheet import (
    SHEET_SIDE,
    files_beside,
    reduced,
    thumbnail,
    write_sheet,
)
from malus.reconstruct.photos.estimate import Estimate, estimate
from malus.reconstruct.photos.knowledge import Knowledge
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.png16 import aolp_16bit, save_16bit, to_16bit
from malus.reconstruct.photos.read_picture import read_picture
from malus.reconstruct.photos.write_picture import write_picture
from malus.scenes import polarisation
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.cores import usable_cores
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import add_to_folder

Progress = Callable[[str, float], None]
"""Called with the name of the step that begins, and the share that is done."""

Thumbnail = tuple[str, NDArray[np.uint8]]
"""A name and a small sRGB picture (height, width, 3)."""

SWEEP_SIDE = 512
SWEEP_FRAMES = 36
WRITERS = 2
"""Pictures that are encoded at a time: each takes memory for its light."""
_EVERY = 4
"""Every how many rows and columns are enough for a median."""
_NOT_ALWAYS = ("uncertainty.png", "sweep.gif")
"""Files that belong to an estimate, and are written with some only."""
_COMPENSATED = 2.0
"""Gain that makes up for the stop of light that a filter takes from unpolarised light."""
_ROUNDED = 1.005
"""Share of white that is hardly more than the step of 8 bits below it, which rounding may hide."""
_UNPOLARISED = 0.002
"""DoLP below which the contact sheet shows no angle."""
_CLIPPED = 0.001
"""Share of clipped pixels from which their loss is worth a line."""


@dataclass(frozen=True)
class FilterOutput:
    """What a virtual filter shows: I(ϑ) at `angles_deg`, and an animation where `sweep`.

    `physical` keeps the stop of light that a real filter takes away; otherwise the exposure makes
    up for it, so that unpolarised light looks as before.

    Examples
    --------
    >>> FilterOutput(angles_deg=(60.0,)).sweep
    False
    """

    angles_deg: Sequence[float] = (0.0, 45.0, 90.0, 135.0)
    sweep: bool = False
    physical: bool = False


@dataclass(frozen=True)
class FilteredPicture:
    """Estimated polarisation of a picture.

    Attributes
    ----------
    components : Components
        Stokes images s0, s1, s2 (height, width, channels) in the picture's linear light.
    files : tuple of Path
        What was written; empty where no folder was given.
    statements : tuple of str
        What was assumed and estimated.
    warnings : tuple of str
        Reasons not to believe it.

    Examples
    --------
    >>> flat = np.full((2, 2, 1), 0.5, np.float32)
    >>> picture = FilteredPicture(Components(flat, 0 * flat, 0 * flat), (), (), ())
    >>> picture.components.i_max.shape
    (2, 2, 1)
    """

    __repr__ = brief_repr

    components: Components
    files: tuple[Path, ...]
    statements: tuple[str, ...]
    warnings: tuple[str, ...]


def filter_picture(
    picture: Picture | Path | str,
    out: Path | str | None = None,
    knowledge: Knowledge | None = None,
    output: FilterOutput | None = None,
    *,
    stem: str | None = None,
    progress: Progress | None = None,
) -> FilteredPicture:
    """Estimate the polarisation of a picture, and write it through a virtual polariser.

    Into a folder `out` it writes STEM_angle000 …, STEM_imax and STEM_imin in the picture's own
    form; STEM_dolp.png (0 to 1) and STEM_aolp.png (180° are 65536, from +x) with 16 bits;
    STEM_uncertainty.png, likewise, where the method says how sure it is: the standard deviation of
    s1/s0 and of s2/s0, 0 to 1; STEM_sheet.png, STEM_sweep.gif.

    Parameters
    ----------
    picture : Picture, or path of one
    out : path of a folder, made if it is missing; None writes nothing
    knowledge : Knowledge, what is given besides the picture
    output : FilterOutput, angles in degrees from the vertical, anticlockwise
    stem : beginning of the files' names; the picture's name where that is a path
    progress : called with every step

    Returns
    -------
    FilteredPicture
        `components` (height, width, 1 or 3) in the picture's linear light; files, statements and
        warnings.

    Raises
    ------
    InputError
        An unreadable picture, an angle that is no number, a picture that nothing can be told from,
        a folder that cannot be written. Then nothing is.

    Examples
    --------
    A mirror of η = 1.5 seen at 60° polarises nearly all of the light that it reflects:

    >>> normals = np.tile(np.array([0, np.sin(np.pi / 3), 0.5], np.float32), (4, 4, 1))
    >>> mirror = Knowledge(normals, eta=1.5, alpha=0.01, mirror=True)
    >>> grey = Picture(np.full((4, 4, 1), 0.4, np.float32), "EXR", None)
    >>> filtered = filter_picture(grey, knowledge=mirror)
    >>> bool((filtered.components.i_min < 0.1 * filtered.components.i_max).all())
    True
    """
    output, tell = output or FilterOutput(), progress or (lambda _step, _share: None)
    _check_angles(output.angles_deg)
    if not isinstance(picture, (Picture, str, Path)):
        hint = 'make one of an array: malus.Picture(linear, "EXR", None)'
        raise InputError("picture", "a path or a malus.Picture", type(picture).__name__, hint)
    if not isinstance(picture, Picture):
        stem = stem or Path(picture).stem
        picture = read_picture(picture)
    stem = stem or "picture"
    tell("separating light and estimating polarisation", 0.05)
    name = f"{stem}{picture.suffix}"
    if picture.clipped == 1.0:
        raise InputError(name, "light that is not clipped", "none", "expose it again")
    result = estimate(picture.linear, knowledge or Knowledge(), name)
    files: tuple[Path, ...] = ()
    if out is not None:
        earlier = files_beside(Path(out) / f"{stem}_sheet.png")
        names = add_to_folder(
            Path(out), lambda folder: _write(folder, stem, picture, result.components, output, tell)
        )
        earlier |= {f"{stem}_{part}" for part in _NOT_ALWAYS}
        for name in earlier - set(names):
            (Path(out) / name).unlink(missing_ok=True)
        files = tuple(Path(out) / name for name in names)
    tell("done", 1.0)
    warnings = _warnings(picture, result)
    if files and not output.physical:
        warnings += _warnings_of_white(picture, result.components)
    return FilteredPicture(result.components, files, _statements(picture, result, output), warnings)


def _check_angles(angles_deg: Sequence[float]) -> None:
    if np.ndim(angles_deg) != 1:
        raise InputError("angles", "a list of degrees", f"{angles_deg}", "give a list of one")
    for angle in angles_deg:
        if isinstance(angle, str) or not math.isfinite(angle):
            raise InputError("angles", "degrees from the vertical", f"{angle}", "correct it")
    names = [_angle_name(angle) for angle in {angle % 180.0 for angle in angles_deg}]
    if len(set(names)) < len(names):
        found = f"two that are called {max(names, key=names.count)}"
        raise InputError("angles", "a hundredth of a degree between them", found, "leave one out")


def _statements(picture: Picture, result: Estimate, output: FilterOutput) -> tuple[str, ...]:
    statements = [picture.assumption, *picture.notes, *result.statements]
    if (deviation := result.components.deviation) is not None:
        told = deviation[::_EVERY, ::_EVERY]
        median = float(np.median(told[told > 0])) if (told > 0).any() else 0.0
        statements.append(
            f"it expects errors of s1/s0 and s2/s0 of {median:.2g} (standard deviation, median over"
            " pixels): the map of uncertainty tells where"
        )
    if not output.physical:
        statements.append(
            "exposure makes up for the filter's one stop, which `physical` leaves out"
        )
    return tuple(statements)


def _warnings(picture: Picture, result: Estimate) -> tuple[str, ...]:
    if picture.clipped <= _CLIPPED:
        return result.warnings
    clipped = f"{picture.clipped:.1%} of the pixels are clipped: their highlights are too weak"
    return (*result.warnings, clipped)


def _warnings_of_white(picture: Picture, components: Components) -> tuple[str, ...]:
    """A warning where the exposure takes light that was not clipped beyond the largest code."""
    brightest = _COMPENSATED * components.i_max
    over = (brightest > _ROUNDED * picture.full_scale) & (picture.linear < picture.full_scale)
    share = float(np.mean(over.any(axis=-1)))
    if share <= _CLIPPED:
        return ()
    return (
        f"{share:.1%} of the pixels are brighter than white in imax and clipped there, and maybe at"
        " other angles: `physical` keeps all light",
    )


def _write(
    folder: Path,
    stem: str,
    picture: Picture,
    components: Components,
    output: FilterOutput,
    tell: Progress,
) -> None:
    gain = np.float32(1.0 if output.physical else _COMPENSATED)
    half_polarised = 0.5 * np.hypot(components.s1, components.s2)
    images: list[tuple[str, Callable[[], AnyArray]]] = [
        (_angle_name(angle), _image_through(components, angle)) for angle in output.angles_deg
    ]
    images += [
        ("imax", lambda: 0.5 * components.image + half_polarised),
        ("imin", lambda: 0.5 * components.image - half_polarised),
    ]

    # Floats below 0 are noise around black, or colours beyond the primaries: they stay.
    least = 0.0 if picture.transfer is not None else np.minimum(picture.linear, 0)

    def write(image: tuple[str, Callable[[], AnyArray]]) -> Thumbnail:
        name, light = image
        filtered = picture.with_light(np.maximum(gain * light(), least))
        write_picture(folder / f"{stem}_{name}{picture.suffix}", filtered)
        return name, thumbnail(filtered.linear, picture, SHEET_SIDE)

    thumbnails: list[Thumbnail] = []
    with ThreadPoolExecutor(min(WRITERS, usable_cores())) as pool:
        for written in pool.map(write, images):
            thumbnails.append(written)
            tell(f"written {written[0]}", 0.3 + 0.6 * len(thumbnails) / len(images))
    tell("writing maps", 0.92)
    thumbnails += _maps(folder, stem, components)
    names = sorted(path.name for path in folder.iterdir())
    write_sheet(folder / f"{stem}_sheet.png", thumbnails, names)
    if output.sweep:
        tell("writing the sweep", 0.95)
        _sweep(folder / f"{stem}_sweep.gif", picture, components, gain)


def _image_through(components: Components, angle_deg: float) -> Callable[[], AnyArray]:
    return lambda: polarised(components, angle_deg)


def polarised(components: Components, angle_deg: float) -> AnyArray:
    """I(ϑ) without stacking the three planes, which for a large picture would be copies."""
    stokes = np.eye(3, dtype=np.float64)
    dtype = components.image.dtype.type
    c0, c1, c2 = (dtype(weight) for weight in polarisation.polarised(stokes, angle_deg))
    result: AnyArray = c0 * components.image + c1 * components.s1 + c2 * components.s2
    return result


def _angle_name(angle_deg: float) -> str:
    return f"angle{round(angle_deg, 2) % 180.0:06.2f}".rstrip("0").rstrip(".")


def _maps(folder: Path, stem: str, components: Components) -> list[Thumbnail]:
    """Write DoLP, AoLP and uncertainty of the sum over the bands as 16-bit grey.

    Return their thumbnails.
    """
    from matplotlib import colormaps

    planes = (components.image, components.s1, components.s2)
    stokes = np.stack([plane.sum(axis=-1) for plane in planes], axis=-1)
    dolp = np.clip(polarisation.dolp(stokes), 0, 1)
    aolp = polarisation.aolp(stokes) / np.pi
    save_16bit(folder / f"{stem}_dolp.png", to_16bit(dolp))
    save_16bit(folder / f"{stem}_aolp.png", aolp_16bit(stokes))
    coloured = [
        ("dolp", "dolp 0 to 1", dolp, "viridis"),
        ("aolp", "aolp 0 to 180°", aolp, "twilight"),
    ]
    if components.deviation is not None:
        uncertainty = _uncertainty(components)
        save_16bit(folder / f"{stem}_uncertainty.png", to_16bit(uncertainty))
        brightest = max(float(uncertainty.max()), 0.01)
        label = f"uncertainty 0 to {brightest:.2f}"
        coloured.append(("uncertainty", label, uncertainty / brightest, "magma"))
    thumbnails = []
    for name, label, values, colours in coloured:
        small = reduced(values[..., None], SHEET_SIDE)[..., 0]
        picture = (colormaps[colours](small)[..., :3] * 255).astype(np.uint8)
        if name == "aolp":
            # Light that is not polarised has no angle.
            picture[reduced(dolp[..., None], SHEET_SIDE)[..., 0] < _UNPOLARISED] = 128
        thumbnails.append((label, picture))
    return thumbnails


def _uncertainty(components: Components) -> AnyArray:
    """Standard deviation (height, width) of s1/s0 and of s2/s0 of the sum over the bands.

    Errors of neighbouring bands have the same causes, so that deviations add as light does.
    """
    assert components.deviation is not None
    total = components.image.sum(axis=-1)
    weighted = np.einsum("yxb,yxb->yx", components.deviation, components.image)
    return np.divide(weighted, total, out=np.zeros_like(total), where=total > 0)


def _sweep(path: Path, picture: Picture, components: Components, gain: np.float32) -> None:
    """Write an animation through 180° of the polariser."""
    import PIL.Image

    planes = (components.image, components.s1, components.s2)
    image, s1, s2 = (reduced(plane, SWEEP_SIDE) for plane in planes)
    small = Components(image, s1, s2)
    angles = np.arange(SWEEP_FRAMES) * (180.0 / SWEEP_FRAMES)
    frames = [
        PIL.Image.fromarray(thumbnail(gain * polarised(small, float(a)), picture, SWEEP_SIDE))
        for a in angles
    ]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=80, loop=0)
