"""The documents of a dataset: a card for people, Croissant metadata, and its splits."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Literal

from pydantic import Field

from malus.bench.datasets.croissant import croissant
from malus.bench.running.distributions import value_distributions
from malus.renderers.datasets.dataset import Dataset
from malus.renderers.datasets.dataset_record import MAX_DATASET_BYTES, DatasetRecord, read_dataset
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import read_json, replace_file, replace_text
from malus.scenes.core.model import Model
from malus.scenes.random_suite.splits import Disjoint, SplitName, check_leaks
from malus.scenes.scene import Scene
from malus.scenes.suite import Suite

CARD, PICTURE, CROISSANT, SPLITS = "README.md", "conventions.png", "croissant.json", "splits.json"

IMAGES = {
    "scene.json": "The scene, and size and SHA-256 of every image.",
    "stokes.exr": "Stokes image: what a polarisation camera sees, in spectral bands.",
    "specular.exr": "Stokes image of the light that facets of the surface mirror.",
    "diffuse.exr": "Stokes image of the light that left the body below the surface.",
    "geometry.exr": "Normals, and the mask of pixels that the object covers.",
    "error.exr": "Standard error of the Stokes image, and one draw of the noise of its parts.",
}
"""Files of a scene; a measured material has no lobes."""

MAPS_FILE = {"maps.exr": "Maps that the suite asks for: depth, normals, ids and others."}
SENSOR_FILES = {
    "raw.tiff": "Raw frame of the suite's polarisation camera, in digital numbers.",
    "sensor.exr": "Stokes image that demosaicing makes of the raw frame.",
}

CITE = (
    "@software{malus, title = {malus: synthetic ground truth for methods that tell polarisation"
    " from one unpolarised image}, author = {{The malus developers}}, version = {VERSION}}"
)

LIMITS = """\
- The images are rendered, not measured. Surfaces are random facets with Fresnel's equations; what
  real objects have besides (coats, dirt, birefringence, fluorescence) is missing.
- Each image has the noise of its samples. `error.exr` tells how much; that of the two halves of a
  scene is independent, and that of two scenes {NOISE}.
- Bands are narrow: radiances are those at one wavelength each. R, G, B are a preview.
- Distributions are those above, and not those of the world: a method that does well here has been
  shown nothing else.
"""


NOISE_OF_TWO = {
    True: "is so too",
    False: "is not: all have the same random numbers, and scenes that are alike have like noise",
}
"""How the noise of two scenes is related, by whether the suite is random."""


def write_documents(folder: Path, suite: Suite) -> None:
    """Write a dataset's card, its Croissant metadata, and the splits of a random suite.

    Nothing is written while parts are missing: only who has all scenes can tell of all.

    Raises
    ------
    InputError
        If a scene, or a value of a disjoint axis, is in two splits.
    """
    record, sha256 = read_dataset(folder)
    if len(record.scenes) + len(record.failed) < record.planned:
        return
    listed = {entry.scene for entry in record.scenes}
    scenes = [(scene, name) for scene, name in _scenes(suite) if name in listed]
    if suite.splits is not None:
        _write_splits(folder, record, suite, scenes)
    else:
        (folder / SPLITS).unlink(missing_ok=True)  # of another suite that was rendered here
    text = card(record, suite, [scene for scene, _ in scenes])
    source = resources.files("malus.reports") / "docs" / PICTURE
    with resources.as_file(source) as picture:
        replace_file(folder / PICTURE, lambda copy: shutil.copyfile(picture, copy))
    replace_text(folder / CARD, text)
    version = record.versions.get("malus", "")
    content = croissant(record, sha256, _images(record, suite), _about(suite), _cite(version))
    replace_text(folder / CROISSANT, json.dumps(content, indent=1) + "\n")


def remove_documents(folder: Path) -> None:
    """Remove what tells of all scenes: it is wrong while more are rendered, and written again."""
    for name in (CARD, CROISSANT, SPLITS):
        (folder / name).unlink(missing_ok=True)


def _scenes(suite: Suite) -> Iterator[tuple[Scene, str]]:
    for scene in suite.scenes():
        yield scene, scene.id


class SplitsRecord(Model):
    """Content of `splits.json`: scenes of each split, and the split of each disjoint value."""

    format: Literal["malus splits 1"] = "malus splits 1"
    disjoint: tuple[Disjoint, ...] = ()
    splits: dict[SplitName, tuple[str, ...]]
    values: dict[Disjoint, dict[str, SplitName]] = Field(default_factory=dict)


def keep_splits(dataset: Dataset, folder: Path) -> None:
    """Copy a dataset's `splits.json`, if it has one, beside an export of it.

    Of a dataset that was reduced to a split, with the scenes of that split alone.

    Raises
    ------
    InputError
        If a scene is in two splits, in none, or none of the dataset's.
    """
    path = dataset.path / SPLITS
    if not path.exists():
        (folder / SPLITS).unlink(missing_ok=True)
        return
    content = read_json(path, MAX_DATASET_BYTES)[0]
    splits = SplitsRecord.parse(content, str(path)).splits
    counts = Counter(name for names in splits.values() for name in names)
    wrong = sorted({name for name, count in counts.items() if count > 1})
    wrong += sorted(set(counts) ^ set(dataset.whole.scenes))
    if wrong:
        expected = "every scene of the dataset in one split"
        raise InputError(str(path), expected, f"scene {wrong[0]} not so", "render it again")
    chosen = set(dataset.scenes)
    own = {split: [name for name in names if name in chosen] for split, names in splits.items()}
    replace_text(folder / SPLITS, json.dumps(content | {"splits": own}, indent=1) + "\n")


def _write_splits(
    folder: Path, record: DatasetRecord, suite: Suite, scenes: list[tuple[Scene, str]]
) -> None:
    """Write the scenes of each split, and the split of each value of a disjoint axis."""
    assert suite.splits is not None
    split_of = {entry.scene: entry.split for entry in record.scenes if entry.split is not None}
    values = check_leaks(
        ((scene, name, split_of[name]) for scene, name in scenes if name in split_of), suite.splits
    )
    content = SplitsRecord(
        disjoint=suite.splits.disjoint,
        splits={
            split: tuple(entry.scene for entry in record.scenes if entry.split == split)
            for split in suite.splits.shares
        },
        values=values,
    )
    replace_text(folder / SPLITS, content.model_dump_json(indent=1) + "\n")


def card(record: DatasetRecord, suite: Suite, scenes: list[Scene]) -> str:
    """The card of a dataset, in Markdown."""
    parts = [
        f"# {suite.name}\n\n{_about(suite)}\n",
        _how(record, suite, scenes),
        _files(record, suite),
        _splits(record, suite),
        _distributions(scenes),
        _conventions(record),
        f"## Limits\n\n{LIMITS.replace('{NOISE}', NOISE_OF_TWO[suite.random is not None])}",
        _licence(record, suite),
    ]
    return "\n".join(part for part in parts if part)


def _about(suite: Suite) -> str:
    about = suite.description or f"Scenes of the suite {suite.name}"
    return (
        f"{about.rstrip('.')}. Stokes images with known normals, materials and lights, rendered for"
        " methods that tell polarisation from one unpolarised image."
    )


def _how(record: DatasetRecord, suite: Suite, scenes: Sequence[Scene]) -> str:
    sampling, sides = suite.sampling, sorted({scene.camera.resolution for scene in scenes})
    least, side = (sides[0], sides[-1]) if sides else 2 * (suite.camera.resolution,)
    smallest = "" if least == side else f"{least} × {least} to "
    bands = ", ".join(f"{nm:g}" for nm in suite.wavelengths_nm)
    versions = ", ".join(f"{name} {version}" for name, version in record.versions.items())
    samples = f"{sampling.samples} samples a pixel"
    if sampling.target is not None:
        samples = f"at most {samples}, until the noise is {sampling.target:g} of the peak"
    how = (
        f"drawn at random with seed {suite.random.seed}, each by its number alone: a larger count"
        " adds scenes and changes none"
        if suite.random is not None
        else "every combination of the suite's shapes, materials, surfaces and lights"
    )
    failed = f"; {len(record.failed)} could not be rendered" if record.failed else ""
    return (
        f"## How it was made\n\n{len(record.scenes)} scenes{failed}: {how}.\n"
        f"{smallest}{side} × {side} pixels, bands at {bands} nm, {samples}, seed {sampling.seed}.\n"
        f"Rendered with {versions} ({record.variant.get('name', suite.renderer)}). The whole suite,"
        f" with every range, is the key `suite` of `dataset.json`; `malus render` of the same suite"
        " makes the same scenes.\n"
    )


def _images(record: DatasetRecord, suite: Suite) -> dict[str, str]:
    """Image files of the scenes; without lobes where no scene has them."""
    known = any(entry.body != "unknown" for entry in record.scenes)
    unknown = () if known else ("specular.exr", "diffuse.exr")
    files = IMAGES | (MAPS_FILE if suite.maps else {}) | (SENSOR_FILES if suite.sensor else {})
    return {name: text for name, text in files.items() if name not in unknown}


def _files(record: DatasetRecord, suite: Suite) -> str:
    rows = [f"| `<scene>/{name}` | {text} |" for name, text in _images(record, suite).items()]
    rows.insert(0, "| `dataset.json` | suite, versions, conventions, every scene and its hash |")
    if suite.splits is not None:
        rows.insert(1, "| `splits.json` | scenes of each split, values of each disjoint axis |")
    return "## What is in it\n\n| file | what it is |\n|---|---|\n" + "\n".join(rows) + "\n"


def _splits(record: DatasetRecord, suite: Suite) -> str:
    if suite.splits is None:
        return ""
    counts = {
        name: sum(entry.split == name for entry in record.scenes) for name in suite.splits.shares
    }
    told = ", ".join(f"{name} {count}" for name, count in counts.items())
    axes = suite.splits.disjoint
    apart = f" No {' and no '.join(axes)} is in two of them." if axes else ""
    return f"## Splits\n\n{told} scenes.{apart}\n"


def _distributions(scenes: list[Scene]) -> str:
    rows = []
    for row in value_distributions(scenes):
        ends = "" if row.low is None else f"{row.low:.4g} to {row.high:.4g}"
        rows.append(f"| `{row.key}` | {row.count} | {ends} | {row.shown} |")
    if not rows:
        return ""
    head = "| key | values | range | how often |\n|---|---|---|---|\n"
    return (
        "## Distributions\n\nA bar is a sixteenth of the range (of its logarithm where the values"
        f" lie so), names have their number.\n\n{head}" + "\n".join(rows) + "\n"
    )


def _conventions(record: DatasetRecord) -> str:
    words = "\n".join(f"- **{name}**: {text}." for name, text in record.conventions.items())
    return f"## Conventions\n\n![axes and signs of the Stokes images]({PICTURE})\n\n{words}\n"


def _licence(record: DatasetRecord, suite: Suite) -> str:
    stated = suite.licence or (
        "Not stated: who publishes the data set states it (`licence` in the suite)"
    )
    version = record.versions.get("malus", "")
    return (
        f"## Licence\n\n{stated}. Copies of meshes, maps, pictures and measured materials that the"
        " scenes name keep their own.\n\n## How to cite\n\n"
        f"```bibtex\n{_cite(version)}\n```\n\n"
        "and the paper whose model it serves: L. Gu, C. P. Huynh, A. Robles-Kelly, *Reconstructing"
        " Polarisation Components from Unpolarised Images*.\n"
    )


def _cite(version: str) -> str:
    return CITE.replace("VERSION", version)
