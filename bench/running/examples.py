"""Example scenes of a run, kept with every method's images for people to look at."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from malus.bench.running.plan import FamilyPlan
from malus.bench.scoring.observe import observe
from malus.reconstruct import Inapplicable, Method
from malus.renderers.truth import Truth
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import open_regular, write_whole
from malus.scenes.core.result_files import EXAMPLES
from malus.scenes.materials.surface import body_text
from malus.scenes.scene import Scene

_OF = "method."
"""Before the name of a method: the name of its image in the file."""
MOST_EXAMPLES = 24
"""Largest number of example scenes; each is from another family, spread evenly over the suite."""


def example_ids(families: Sequence[FamilyPlan]) -> frozenset[str]:
    """Ids of the example scenes: the material of middle index of families spread over the suite.

    Examples
    --------
    >>> from malus.bench.running.plan import plan
    >>> from malus.scenes import load_suite
    >>> len(example_ids(plan(load_suite("quick"))))
    8
    """
    step = max(1.0, len(families) / MOST_EXAMPLES)
    picks = {int(k * step) for k in range(min(MOST_EXAMPLES, len(families)))}
    return frozenset(_of_middle_index(families[k].scenes).id for k in sorted(picks))


def _of_middle_index(scenes: Sequence[Scene]) -> Scene:
    ordered = sorted(scenes, key=lambda scene: float(scene.eta.real.mean()))
    return ordered[len(ordered) // 2]


def write_example(folder: Path, truth: Truth, methods: Sequence[Method], part: str = "") -> None:
    """Write `examples/<scene id>.npz`: truth, masks, one Stokes image a method, and a label.

    `part` is the id of the part of the run that the scene belongs to.
    """
    from malus.bench.scoring.unmixed_pixels import mixed_pixels  # with what scores: numba

    path = folder / EXAMPLES / f"{truth.scene.id}.npz"
    images: dict[str, Any] = {
        "truth": truth.stokes.astype(np.float32),
        "mask": truth.mask,
        "meta": np.array(json.dumps(_meta(truth.scene) | {"part": part})),
    }
    mixed = mixed_pixels(truth)
    if mixed is not None:
        images["mixed"] = mixed
    for method in methods:
        try:
            estimate = method.reconstruct(observe(truth, method.needs))
        except Inapplicable:
            continue
        images[f"{_OF}{method.name}"] = estimate.stokes.astype(np.float32)
    write_whole(path, lambda temporary: np.savez_compressed(temporary, **images))


def is_example_of(part: str, path: Path) -> bool:
    """Whether the example in a file is of a part: of the same renders, at as many samples."""
    try:
        with open_regular(path) as stored, np.load(stored) as file:
            return bool(json.loads(str(file["meta"])).get("part") == part)
    except (InputError, OSError, ValueError, KeyError, zipfile.BadZipFile):
        return False


def with_images_of(methods: Iterable[str], path: Path, content: bytes) -> bytes:
    """An example with the images that the file at `path` has of these methods too.

    A file of another truth, and one that is damaged, is left out.
    """
    if not path.exists():
        return content
    images = dict(np.load(io.BytesIO(content)))
    try:
        with open_regular(path) as stored, np.load(stored) as file:
            kept = {f"{_OF}{name}" for name in methods} & set(file.files) - images.keys()
            if not kept or not np.array_equal(file["truth"], images["truth"]):
                return content
            images |= {name: file[name] for name in kept}
    except (InputError, OSError, ValueError, KeyError, zipfile.BadZipFile):
        return content
    merged = io.BytesIO()
    np.savez_compressed(merged, **images)
    return merged.getvalue()


def _meta(scene: Scene) -> dict[str, Any]:
    """Description of the scene that stands in the file: id, label for people, wavelengths."""
    surface = scene.surface
    parts = (
        scene.label,
        surface.material_label,
        surface.label,
        body_text(surface.body),
        scene.light.label,
    )
    return {
        "scene": scene.id,
        "label": ", ".join(parts),
        "wavelengths_nm": list(scene.wavelengths_nm),
    }
