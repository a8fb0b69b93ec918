"""Benchmark of rendering: seconds a polariser image, beside two ways without malus.

It takes the way that `malus run` and `malus render` take: renders at the nodes of every family, the
truth of every scene with its noise, Stokes images of both lobes, and from these the images behind a
polariser.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from malus.bench.running.plan import plan
from malus.bench.studies.study import Findings
from malus.bench.studies.timing import timed
from malus.renderers.comparison.plain_mitsuba import StokesByHand, plate_image
from malus.renderers.comparison.profile import profiled
from malus.renderers.families.family import render_family
from malus.renderers.families.interpolated import Family
from malus.renderers.variant import Variant, choose
from malus.scenes.camera import Camera
from malus.scenes.core.arrays import AnyArray
from malus.scenes.lights.lights import Distant, Light, Uniform
from malus.scenes.materials.materials import materials, surfaces
from malus.scenes.polarisation import PAPER_ANGLES_DEG, polarised
from malus.scenes.scene import Sampling, Scene
from malus.scenes.shapes.shapes import Sphere
from malus.scenes.suite import Suite

ANGLES = PAPER_ANGLES_DEG
LIGHTS: tuple[Light, ...] = (Distant(incidence_deg=60), Uniform())


@dataclass
class Speed:
    """Median seconds a polariser image of one way to render, and the error of its images.

    Attributes
    ----------
    images : int
        Images that were timed.
    parts : dict of part to seconds
        Where the time went, over all turns.
    """

    seconds_an_image: float
    error: float
    images: int
    parts: dict[str, float] = field(default_factory=dict)


def findings(folder: Path | None, resolution: int, samples: int, backend: str) -> Findings:
    """Run the benchmark under each of its lights."""
    camera = Camera.parse({"resolution": resolution}, "study render")
    sampling = Sampling.parse({"samples": samples}, "study render")
    variant = choose(backend)
    lines: list[str] = []
    figures: list[dict[str, Any]] = []
    for light in LIGHTS:
        speeds = compare(variant, camera, sampling, light)
        lines += report_lines(speeds, light)
        figures += [{"light": light.label, "way": way} | asdict(s) for way, s in speeds.items()]
    return Findings(tuple(lines), figures)


def matrix(light: Light, camera: Camera, sampling: Sampling) -> Suite:
    """Suite of 24 materials x 5 surfaces x 8 bands: a sphere under one light, polarised body."""
    return Suite(
        name="speed",
        shapes=(Sphere(),),
        materials=tuple(materials()),
        surfaces=tuple(surfaces()),
        lights=(light,),
        bodies=("polarised",),
        wavelengths_nm=(400, 443, 486, 529, 571, 614, 657, 700),
        methods=("unpolarised",),
        camera=camera,
        sampling=sampling,
    )


def compare(
    variant: Variant, camera: Camera, sampling: Sampling, light: Light, repeats: int = 5
) -> dict[str, Speed]:
    """Time all three ways under one light in turns, so that a busy machine slows all of them alike.

    malus renders the whole matrix in every turn; the other ways are timed on one image of it, as
    they take the same time for every image. A first turn warms up all kernels. The seconds of
    `parts` are summed over all turns.
    """
    suite = matrix(light, camera, sampling)
    scenes = list(suite.scenes())
    reference = _reference(variant, scenes[0], sampling)
    stokes = StokesByHand(variant, scenes[0])
    turns = list(itertools.islice(itertools.cycle(scenes[:: len(scenes) // repeats]), repeats + 1))
    plates, hands, ours = [], [], []
    for scene in turns:
        plates.append(timed(partial(plate_image, variant, scene, 3, 30.0, sampling)).clock)
        hands.append(timed(partial(stokes.images, scene, 3, ANGLES, sampling)).clock)
        ours.append(_whole_matrix(variant, suite))
    count = len(scenes) * len(suite.wavelengths_nm) * len(ANGLES)
    first = scenes[0]
    plate = plate_image(variant, first, 0, 30.0, sampling)
    hand = stokes.images(first, 0, (30.0,), sampling)[0]
    own = _polarised(variant, first, sampling)
    return {
        "plate": Speed(_median(plates), _error(plate, reference), repeats),
        "stokes": Speed(_median(hands) / len(ANGLES), _error(hand, reference), repeats * 5),
        "malus": Speed(
            _median([sum(parts.values()) for parts in ours]) / count,
            _error(own, reference),
            count,
            {part: sum(parts[part] for parts in ours[1:]) for part in ours[0]},
        ),
    }


def _median(seconds: list[float]) -> float:
    """Median of all turns but the first."""
    return float(np.median(seconds[1:]))


RENDERING = ("kernels", "compilation", "copies", "python")
"""Parts of the time of renders; 'python' is what is none of the others, planning too."""
PARTS = (*RENDERING, "interpolation", "polarisers")
"""Parts of the time: renders, then truths from them, then images behind polarisers."""


def _whole_matrix(variant: Variant, suite: Suite) -> dict[str, float]:
    """Render all truths of the suite and all their polariser images; seconds of each of `PARTS`."""
    started = time.perf_counter()
    parts = dict.fromkeys(PARTS, 0.0)
    for family in plan(suite):
        with profiled(variant) as profile:
            renders = render_family(family.scenes, family.sampling, variant, errors=False)
        assert isinstance(renders, Family)
        parts["kernels"] += profile.kernels
        parts["compilation"] += profile.compilation
        parts["copies"] += renders.lobes.copy_seconds
        for scene in family.scenes:
            before = time.perf_counter()
            truth = renders.truth(scene, standard_error=False)
            between = time.perf_counter()
            stokes = truth.stokes
            for angle in ANGLES:
                polarised(stokes, angle)
            parts["interpolation"] += between - before
            parts["polarisers"] += time.perf_counter() - between
    return parts | {"python": time.perf_counter() - started - sum(parts.values())}


def _polarised(variant: Variant, scene: Scene, sampling: Sampling) -> AnyArray:
    """The first band of a scene through a polariser at 30°, (height, width)."""
    truth = render_family([scene], sampling, variant).truth(scene, standard_error=False)
    return truth.polarised(30.0)[:, :, 0]


def _reference(variant: Variant, scene: Scene, sampling: Sampling) -> AnyArray:
    """The same image with 32 times the samples and another seed."""
    many = Sampling(samples=sampling.samples * 32, seed=sampling.seed + 1000)
    return _polarised(variant, scene, many)


def _error(image: AnyArray, reference: AnyArray) -> float:
    """Root mean square difference over the pixels that are lit, over the reference's peak."""
    lit = reference > 0
    return float(np.sqrt(np.mean((image[lit] - reference[lit]) ** 2)) / reference.max())


def report_lines(speeds: dict[str, Speed], light: Light) -> list[str]:
    """One line a way to render, for people."""
    ours = speeds["malus"]
    names = {
        "plate": "a polariser plate, one render an angle, scene reloaded",
        "stokes": "one Stokes render a material, surface and band",
        "malus": "malus: the whole matrix",
    }
    lines = [f"{light.label}:"]
    for key, speed in speeds.items():
        ratio = speed.seconds_an_image / ours.seconds_an_image
        lines.append(
            f"  {names[key]}: {speed.seconds_an_image * 1e3:.4f} ms an image, {ratio:.0f}x ours, "
            f"rms error {speed.error:.2e} of the peak ({speed.images} images timed)"
        )
    return [*lines, f"  where our time goes: {where_time_goes(ours.parts)}"]


def where_time_goes(parts: dict[str, float]) -> str:
    """The share of each stage in the seconds of its parts, and what most of a stage waits for.

    Examples
    --------
    >>> seconds = (1.0, 0.0, 0.5, 0.5, 7.0, 1.0)
    >>> where_time_goes(dict(zip(PARTS, seconds, strict=True))).split("; ")[0]
    'renders 20 %, bound by kernels (kernels 10 %, compilation 0 %, copies 5 %, Python 5 %)'
    """
    share = {name: 100.0 * seconds / sum(parts.values()) for name, seconds in parts.items()}
    renders = {name.replace("python", "Python"): share[name] for name in RENDERING}
    bound = max(renders, key=lambda name: renders[name])
    of_renders = ", ".join(f"{name} {value:.0f} %" for name, value in renders.items())
    return (
        f"renders {sum(renders.values()):.0f} %, bound by {bound} ({of_renders}); truths from them"
        f" {share['interpolation']:.0f} %, bound by one core that interpolates and copies; images"
        f" behind polarisers {share['polarisers']:.0f} %, bound by memory"
    )
