"""Write a dataset in the formats of other tools, with their conventions spelled out.

Every format here is a folder a scene, named by its id; `conventions.json` is beside them.

- `numpy`: `truth.npz` with the arrays of a Truth, `scene.json`.
- `png`: `aolp_550nm.png` and `dolp_550nm.png`, 16 bits, a pair for every band.
- `polanalyser`: a folder a band, `550nm/`, with `image00000.exr` (or .png) and a JSON of the same
  name for every polariser angle, as `polanalyser.imreadMultiple` reads them.

Formats of few files, or of folders that all scenes share, are in `export_training` and
`export_networks`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from malus.bench.datasets.card import keep_splits
from malus.bench.datasets.export_networks import LAYOUTS, NAMES, check_bands
from malus.bench.datasets.export_training import (
    HDF5_WORDS,
    SHARDS_WORDS,
    check_alike,
    write_one_hdf5,
    write_webdataset,
)
from malus.bench.datasets.export_views import WORDS as NEISF_WORDS
from malus.bench.datasets.export_views import objects_of, view_names, write_neisf
from malus.bench.datasets.layouts import FROM_HORIZONTAL_DEG, scene_numbers
from malus.bench.running.output_folder import prepare_folder
from malus.bench.running.progress import Progress, silent
from malus.reconstruct.photos.png16 import aolp_16bit, save_16bit, to_16bit
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.datasets.dataset_record import CONVENTIONS, MAX_DATASET_BYTES
from malus.renderers.datasets.planes import S3, S3_ERRORS
from malus.renderers.datasets.spectral_exr import write_exr
from malus.renderers.truth import Truth
from malus.scenes import polarisation
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import read_json, replace_folder, replace_text
from malus.scenes.core.model import content_id
from malus.scenes.core.registry import lookup
from malus.scenes.core.remote import as_path
from malus.scenes.sensor_frame import SensorFrame

WriteScene = Callable[[Path, Truth], None]
"""Writes one scene to a folder."""

WriteAll = Callable[[Dataset, Path, Progress], None]
"""Writes all scenes of a dataset to a folder."""

WORDS, MAX_WORDS_BYTES = "conventions.json", 1 << 20
_OF_SCENES = " of the scenes "
_ID = re.compile(r"[0-9a-f]{16}")
PIXELS = ("exr", "png")
"""Forms of the images for polanalyser."""

NUMPY_WORDS = CONVENTIONS | {
    "truth.npz": "stokes, specular, diffuse (where the lobes are known),"
    " standard_error, specular_noise, diffuse_noise"
    " (height, width, bands, 3); image (height, width, bands); normals (height, width, 3); mask"
    " and normal_spread (degrees; missing in older datasets) (height, width); wavelengths_nm, eta"
    " (bands,); alpha; s3 (height, width, bands) where it can be non-zero; read with"
    " allow_pickle=False; s3_noise and s3_standard_error likewise",
    "maps.npz": "the dataset's maps by name, where it has some",
    "sensor.npz": "where there is a polarisation camera: raw (frames, height, width), digital"
    " numbers; stokes (height, width, channels, 3) that demosaicing makes of them; electrons ="
    " (raw - dark_level) / gain, radiance = electrons / (exposure x responses of the channel);"
    " weights (channels, bands)",
}
PNG_WORDS = {
    "aolp_<band>nm.png": "angle of linear polarisation, from +x (horizontal), anticlockwise as"
    " displayed; value = angle / 180 degrees * 65536, modulo 65536 because 180 degrees are 0",
    "dolp_<band>nm.png": "degree of linear polarisation; value = dolp * 65535, clipped to 1",
    "background": "pixels off the object are 0 in both",
}
POLANALYSER_WORDS = {
    "angle": "radians; transmission axis from +x (HORIZONTAL), anticlockwise as displayed, as"
    " polanalyser counts: I(angle) = (s0 + s1 cos 2 angle + s2 sin 2 angle) / 2",
    "malus_angle_deg": "the same axis as malus counts, from the VERTICAL: angle - 90 degrees,"
    " modulo 180",
    "full_scale": "radiance of the value 65535 of a .png, the same for all angles and bands of a"
    " scene; 1 for .exr, whose only channel Y is the radiance",
}


def export(
    dataset: Dataset | Path | str,
    layout: str,
    out: Path | str,
    pixels: str = "exr",
    progress: Progress = silent,
) -> int:
    """Write every scene of a dataset in another format, and conventions.json beside them.

    `splits.json` is kept where the dataset has one.

    Parameters
    ----------
    dataset : Dataset, of a split too (`Dataset.of_split`), or the path or URL of its folder
    layout : one of `FORMATS`:
        numpy: one .npz a scene; png: angle and degree of polarisation; polanalyser: one image a
        polariser angle; webdataset: shards; hdf5: one file; rgb2pol, pol, polaranything: the
        layouts of networks; neisf: objects from many sides, with poses.
    out : path or URL of a folder
    pixels : 'exr' or 'png'
        Of polanalyser's images: lossless floats, or 16 bits.
    progress : function of (scenes done, scenes in all, id of the next)

    Returns
    -------
    int
        The number of scenes.

    Raises
    ------
    InputError
        An unknown layout or form of the pixels, a damaged or empty dataset, scenes that the layout
        cannot have, a folder that cannot be written
        or that holds something else.

    Examples
    --------
    >>> import tempfile
    >>> from malus.bench.datasets.render import render_dataset
    >>> folder = Path(tempfile.mkdtemp())
    >>> done = render_dataset("quick", folder / "dataset", resolution=8, samples=2)
    >>> export(folder / "dataset", "numpy", folder / "numpy")
    16
    """
    lookup(layout, dict.fromkeys(FORMATS), "layout", f"one of {', '.join(FORMATS)}")
    opened = dataset if isinstance(dataset, Dataset) else open_folder(as_path(dataset))
    opened.check_begun()
    if layout in _WHOLE:
        check, write_all, words = _WHOLE[layout]
        check(opened)  # before anything is written
        write_all(opened, _prepared(opened, out, words, layout), progress)
    elif layout in LAYOUTS:
        for scene in opened.scenes:
            check_bands(opened.scene(scene).scene)
        _numbered(opened, layout, _prepared(opened, out, LAYOUTS[layout].words, layout), progress)
    else:
        _one_by_one(opened, layout, out, pixels, progress)
    return len(opened)


def _prepared(opened: Dataset, out: Path | str, words: Mapping[str, str], layout: str) -> Path:
    """The folder, with the words on what is in it, and the splits of a dataset that has them.

    A folder with an older export is refused where files of it would stay: readers would mix both.
    """
    # The folder of a scene takes the place of an older one of any format.
    kind = "a folder for each" if layout in _LAYOUTS else layout
    scenes = content_id(sorted(opened.scenes))
    of_these = layout if layout in _REPLACED else f"{kind}{_OF_SCENES}{scenes}"
    folder = as_path(out)
    found = _export_in(folder)
    if found not in (None, of_these):
        same_kind = f"{found}".partition(_OF_SCENES)[0] == kind
        other = _in_the_way(opened, layout, folder) if same_kind else "another export"
        if other:
            expected, hint = "a new folder, or an export of these scenes", "choose another `out`"
            raise InputError(f"output folder {folder}", expected, other, hint)
    prepare_folder(folder, "an export")
    if found is None and layout in _LAYOUTS:
        own = {entry.name for entry in folder.iterdir()} & set(opened.scenes)
        if own:  # predictions, for example, which lie in folders of the same names
            other, hint = f"{min(own)}, a folder of something else", "choose another `out`"
            raise InputError(f"output folder {folder}", "a new folder, or an export", other, hint)
    keep_splits(opened, folder)
    replace_text(folder / WORDS, json.dumps({**words, "export": of_these}, indent=1) + "\n")
    return folder


def _in_the_way(opened: Dataset, layout: str, folder: Path) -> str:
    """What an export of the same kind has that would not be replaced; empty where nothing."""
    names = {scene: scene for scene in opened.scenes}
    if layout in _LAYOUTS:
        entries = [entry.name for entry in folder.iterdir()]
        earlier = {name: name for name in entries if _ID.fullmatch(name)}
    elif (layout in LAYOUTS or layout == "neisf") and (folder / NAMES).exists():
        names = view_names(opened) if layout == "neisf" else _names(opened)
        earlier = dict(read_json(folder / NAMES, MAX_DATASET_BYTES)[0])
    else:
        return "an export of other scenes"
    others = len(earlier.keys() - names.keys())
    if others:
        return f"an export of {others} other scene{'s' if others > 1 else ''}"
    if earlier.items() - names.items():
        return "an export of some of them, by other numbers"
    return _foreign(folder, earlier) if layout in _LAYOUTS else ""


def _foreign(folder: Path, names: Iterable[str]) -> str:
    """A folder of those names that no export made; empty where there is none."""
    foreign = [name for name in names if not (folder / name / "scene.json").exists()]
    return f"{min(foreign)}, a folder of something else" if foreign else ""


def _export_in(folder: Path) -> str | None:
    """Which export a folder holds, empty where an earlier version did not say; None without one."""
    if not (folder / WORDS).exists():
        return None
    return str(read_json(folder / WORDS, MAX_WORDS_BYTES)[0].get("export", ""))


def _one_by_one(
    opened: Dataset, layout: str, out: Path | str, pixels: str, progress: Progress
) -> None:
    """Formats of a folder a scene."""
    write, words = _LAYOUTS[layout]
    if layout == "polanalyser":
        if pixels not in PIXELS:
            raise InputError("pixels", "exr or png", repr(pixels), "choose one of them")
        write = partial(write_polanalyser, pixels=pixels)
    folder = _prepared(opened, out, words, layout)
    for done, scene_id in enumerate(opened.scenes):
        progress(done, len(opened), scene_id)
        truth = opened.truth(scene_id)
        if layout == "numpy":
            has_frame = opened.scene(scene_id).sensor is not None
            frame = opened.frame(scene_id) if has_frame else None
            truth = replace(truth, maps=opened.maps(scene_id), frame=frame)
        replace_folder(folder / scene_id, partial(_write, write, truth))


def _numbered(opened: Dataset, layout: str, folder: Path, progress: Progress) -> None:
    """Layouts of networks: scenes by number, which `names.json` resolves."""
    names = _names(opened)
    replace_text(folder / NAMES, json.dumps(names, indent=1) + "\n")
    for done, (scene_id, name) in enumerate(names.items()):
        progress(done, len(opened), scene_id)
        LAYOUTS[layout].write(folder, name, opened.truth(scene_id))


def _names(opened: Dataset) -> dict[str, str]:
    """The number of every scene in the whole dataset, by which `malus score` finds it."""
    numbers = scene_numbers(opened.whole)
    return {scene: numbers[scene] for scene in opened.scenes}


def write_numpy(folder: Path, truth: Truth) -> None:
    """The arrays of a truth as `truth.npz`, without pickle; lobes where they are known.

    Maps and what a polarisation camera makes of the scene are in files of their own.
    """
    known: dict[str, Any] = {}
    if truth.scene.lobes_known:
        known |= {"specular": truth.specular, "diffuse": truth.diffuse}
    if truth.normal_spread is not None:
        known["normal_spread"] = truth.normal_spread
    for name in (S3, *S3_ERRORS):
        if getattr(truth, name) is not None:
            known[name] = getattr(truth, name)
    if truth.maps:
        np.savez(folder / "maps.npz", **cast(dict[str, Any], dict(truth.maps)))
    if truth.frame is not None:
        _write_sensor(folder / "sensor.npz", truth.frame)
    np.savez(
        folder / "truth.npz",
        stokes=truth.stokes,
        image=truth.image,
        **known,
        standard_error=truth.standard_error,
        specular_noise=truth.specular_noise,
        diffuse_noise=truth.diffuse_noise,
        normals=truth.normals,
        mask=truth.mask,
        wavelengths_nm=np.array(truth.scene.wavelengths_nm),
        eta=truth.eta,
        alpha=np.array(truth.alpha),
    )


def _write_sensor(path: Path, frame: SensorFrame) -> None:
    """Digital numbers, Stokes image, and what turns the numbers into radiance."""
    stokes: dict[str, Any] = {} if frame.stokes is None else {"stokes": frame.stokes}
    np.savez(
        path,
        raw=frame.raw,
        exposure=frame.exposure,
        responses=np.array(frame.channels.responses),
        weights=np.array(frame.channels.weights),
        dark_level=frame.sensor.dark_level,
        gain=frame.sensor.digital_gain,
        **stokes,
    )


def write_png(folder: Path, truth: Truth) -> None:
    """Angle and degree of linear polarisation as pairs of 16-bit images."""
    stokes = np.where(truth.mask[..., None, None], truth.stokes, 0)
    for band, wavelength in enumerate(truth.scene.wavelengths_nm):
        name = f"{wavelength:.10g}nm.png"
        save_16bit(folder / f"aolp_{name}", aolp_16bit(stokes[:, :, band]))
        save_16bit(folder / f"dolp_{name}", to_16bit(polarisation.dolp(stokes[:, :, band])))


def write_polanalyser(folder: Path, truth: Truth, pixels: str = "exr") -> None:
    """One image and one JSON for every band and polariser angle."""
    stokes, brightest = truth.stokes, float(truth.image.max())
    full_scale = brightest if pixels == "png" and brightest > 0 else 1.0
    for band, wavelength in enumerate(truth.scene.wavelengths_nm):
        images = folder / f"{wavelength:.10g}nm"
        images.mkdir()
        for index, angle in enumerate(FROM_HORIZONTAL_DEG):
            radiance = polarisation.polarised(
                stokes[:, :, band], angle + polarisation.FROM_VERTICAL_DEG
            )
            path = images / f"image{index:05d}.{pixels}"
            if pixels == "png":
                save_16bit(path, to_16bit(radiance / full_scale))
            else:
                write_exr(path, {"Y": radiance})
            facts = {
                "angle": math.radians(angle),
                "malus_angle_deg": (angle + polarisation.FROM_VERTICAL_DEG) % 180.0,
                "full_scale": full_scale,
            }
            path.with_suffix(".json").write_text(json.dumps(facts, indent=1), encoding="utf-8")


def _write(write: WriteScene, truth: Truth, folder: Path) -> None:
    write(folder, truth)
    record = truth.scene.model_dump(mode="json")
    (folder / "scene.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


_LAYOUTS: dict[str, tuple[WriteScene, dict[str, str]]] = {
    "numpy": (write_numpy, NUMPY_WORDS),
    "png": (write_png, PNG_WORDS),
    "polanalyser": (write_polanalyser, POLANALYSER_WORDS),
}

_WHOLE: dict[str, tuple[Callable[[Dataset], object], WriteAll, dict[str, str]]] = {
    "webdataset": (len, write_webdataset, SHARDS_WORDS),
    "hdf5": (check_alike, write_one_hdf5, HDF5_WORDS),
    "neisf": (objects_of, write_neisf, NEISF_WORDS),
}
"""Formats of a few files for all scenes: what refuses a dataset, what writes it, and words."""

_REPLACED = ("webdataset", "hdf5")
"""Formats whose files, of any scenes, replace those of an older export."""

FORMATS = (*_LAYOUTS, *_WHOLE, *LAYOUTS)
"""Names of all formats."""
