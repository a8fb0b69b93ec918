"""Study of what each assumption costs: skill where it holds, and where the truth breaks it.

A method that otherwise has the renderer's own physics is scored on pairs: once the truth, or what
the method is told, is as it assumes, and once not. The difference is the price of the assumption.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np
import pandas as pd

from malus.bench.scoring.judge import Judge
from malus.bench.scoring.knowledge_ladder import EVERYTHING, rungs
from malus.bench.studies.study import Findings
from malus.reconstruct import Inapplicable, Observation, get_method
from malus.renderers.families.family import render_family
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, choose
from malus.reports.tables.formats import as_csv
from malus.reports.tables.prices import price_cells, prices
from malus.scenes import (
    Blob,
    Camera,
    Conductor,
    Dielectric,
    Distant,
    Placed,
    Plane,
    Scene,
    Sky,
    Sphere,
    Superquadric,
    Surroundings,
    Torus,
    Uniform,
)
from malus.scenes.core.arrays import FloatArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import write_text
from malus.scenes.lights.lights import Light
from malus.scenes.materials.surface import Distribution
from malus.scenes.scene import Sampling
from malus.scenes.shapes.shapes import Shape

METHODS = ("lights+body", "shadowed+body", "eq8+body")
"""Methods that are scored; the figure shows the first, which has all of the renderer's physics."""

UNSHADOWED = "visible+body"
"""`shadowed+body` but for one thing: its facets take no light from each other."""

SHAPES: tuple[Shape, ...] = (Sphere(), Blob(seed=1))
LIGHTS: tuple[Light, ...] = (Uniform(), Distant(incidence_deg=60))
ALPHAS = (0.15, 0.3)
ETA, ALBEDO = 1.5, 0.2
ETA_OFF, ALPHA_OFF, LIGHT_OFF_DEG, NORMALS_OFF_DEG = 0.05, 0.2, 10.0, 5.0
_STUDY = "study mismatch"

COARSE = 2
"""How many times fewer pixels a side there are where pixels see several normals."""


@dataclass(frozen=True)
class Effort:
    """Pixels a side, samples a pixel, and the variant that renders."""

    resolution: int
    sampling: Sampling
    variant: Variant

    @classmethod
    def of(cls, resolution: int, samples: int, backend: str) -> Self:
        """The effort that options ask for.

        Raises
        ------
        InputError
            An odd number of samples, and a backend that traces no paths of light.
        """
        sampling = Sampling.parse({"samples": samples}, _STUDY)
        variant = choose(backend)
        if not variant.vectorised:
            hint = "install LLVM 17 or later (`malus doctor` says how)"
            expected = "LLVM or CUDA for light that bounces or is polarised"
            raise InputError(_STUDY, expected, variant.name, hint)
        return cls(resolution, sampling, variant)

    def truth(self, scene: Scene, max_depth: int | None = None) -> Truth:
        """The truth of one scene."""
        sampling = self.sampling.model_copy(update={"max_depth": max_depth})
        return render_family([scene], sampling, self.variant).truth(scene)

    def scene(
        self,
        shape: Shape,
        alpha: float,
        light: Light,
        side: int | None = None,
        distribution: Distribution = "beckmann",
    ) -> Scene:
        """A scene of one dielectric."""
        surface = Dielectric(
            eta=ETA, alpha=alpha, body="polarised", albedo=ALBEDO, distribution=distribution
        )
        camera = Camera(resolution=side or self.resolution)
        return Scene(shape=shape, surface=surface, light=light, camera=camera)


Skills = tuple[str, str, float, float]
"""Scene, method, skill where the assumption holds, skill where it does not."""


@dataclass(frozen=True)
class Assumption:
    """Something that methods assume, and pairs of scenes or inputs that keep and break it.

    `kind` is 'truth' where the scene breaks it, 'input' where a wrong input does, 'ladder' where an
    input is estimated from the picture.
    """

    name: str
    kind: str
    skills: Callable[[Effort], Iterator[Skills]]


def findings(folder: Path, resolution: int, samples: int, backend: str) -> Findings:
    """Run the study and write its table into a folder."""
    table = mismatch_table(Effort.of(resolution, samples, backend))
    write_text(folder / "mismatch.csv", as_csv(table))
    cells = price_cells(prices(table))
    lines = (f"{line[0]}, {line[1]}: {line[4]} (pairs: {line[6]})" for line in cells.lines)
    return Findings(("price of each assumption, loss of skill:", *lines, f"written to {folder}"))


def mismatch_table(effort: Effort) -> pd.DataFrame:
    """Skills with and without every assumption.

    Returns
    -------
    DataFrame
        Columns assumption, kind, scene, method, holds, broken: skills, NaN where the guess is
        within the noise.
    """
    rows = [
        (assumption.name, assumption.kind, *skills)
        for assumption in ASSUMPTIONS
        for skills in assumption.skills(effort)
    ]
    columns = ["assumption", "kind", "scene", "method", "holds", "broken"]
    return pd.DataFrame(rows, columns=columns)


def _of_truths(holds: Truth, broken: Truth) -> Iterator[Skills]:
    """Skills on two truths, of which the first is as methods assume."""
    judges = Judge(holds), Judge(broken)
    for name in METHODS:
        method = get_method(name)
        try:
            first, second = (judge.score(method).skill for judge in judges)
        except Inapplicable:
            continue
        yield holds.scene.id, name, first, second


def _of_inputs(
    truth: Truth, changed: str, *wrong: Callable[[Observation], Observation]
) -> Iterator[Skills]:
    """Skills with the right inputs, and with each of several wrong ones, `changed` in them.

    Methods that do not use this input are left out: that they lose nothing is no price.
    """
    judge = Judge(truth)
    right = judge.pixels.observation
    for name in METHODS:
        method = get_method(name)
        if changed not in method.needs:
            continue
        try:
            first = judge.score(method).skill
            for change in wrong:
                estimate = judge.pixels.estimate(method, change(right))
                yield truth.scene.id, name, first, judge.score_estimate(estimate).skill
        except Inapplicable:
            continue


def _plain_truths(effort: Effort, distribution: Distribution = "beckmann") -> Iterator[Truth]:
    """Truths of every shape, roughness and light."""
    for shape in SHAPES:
        for alpha in ALPHAS:
            for light in LIGHTS:
                yield effort.truth(effort.scene(shape, alpha, light, distribution=distribution))


def _untold(observation: Observation) -> Observation:
    return replace(observation, distribution=None)


def _ggx(effort: Effort) -> Iterator[Skills]:
    for truth in _plain_truths(effort, "ggx"):
        yield from _of_inputs(truth, "distribution", _untold)


def _anisotropic(effort: Effort) -> Iterator[Skills]:
    """Brushed gold against gold of the same mean roughness."""
    for light in LIGHTS:
        scenes = [
            Scene(
                shape=Sphere(),
                surface=Conductor(material="gold", alpha=alpha),
                light=light,
                camera=Camera(resolution=effort.resolution),
            )
            for alpha in (0.2, (0.1, 0.4))
        ]
        yield from _of_truths(*(effort.truth(scene) for scene in scenes))


def _bounces(effort: Effort) -> Iterator[Skills]:
    """A ring that lights its own hollow, once reflected and up to four times more."""
    gold = Conductor(material="gold", alpha=ALPHAS[0])
    for light in LIGHTS:
        scenes = [effort.scene(Torus(tilt_deg=50), alpha, light) for alpha in ALPHAS]
        for scene in (*scenes, scenes[0].model_copy(update={"surface": gold})):
            yield from _of_truths(effort.truth(scene, 2), effort.truth(scene, 6))


def _sky(effort: Effort) -> Iterator[Skills]:
    for shape in SHAPES:
        for alpha in ALPHAS:
            plain = Sky(sun=False)
            polarised = Sky.parse({"sun": False, "polarised": {"degree": 0.8}}, _STUDY)
            scenes = (effort.scene(shape, alpha, light) for light in (plain, polarised))
            yield from _of_truths(*(effort.truth(scene) for scene in scenes))


def _mixed(effort: Effort) -> Iterator[Skills]:
    """Rounded cubes on few pixels, against the pixels of theirs that see one normal."""
    for alpha in ALPHAS:
        for light in LIGHTS:
            shape = Superquadric(e1=0.3, e2=0.3)
            coarse = max(12, effort.resolution // COARSE)
            truth = effort.truth(effort.scene(shape, alpha, light, coarse))
            judge = Judge(truth)
            for name in METHODS:
                try:
                    score = judge.score(get_method(name))
                except Inapplicable:
                    continue
                yield truth.scene.id, name, score.skill_unmixed, score.skill


def _several_objects(effort: Effort) -> Iterator[Skills]:
    """A floor and a ball beside the object, against the object alone."""
    floor = Dielectric(eta=ETA, alpha=0.3, albedo=0.4)
    ball = Dielectric(eta=ETA, alpha=0.15, albedo=0.6)
    around = Surroundings(
        name="floor and ball",
        objects=(
            Placed(shape=Plane(), position=(0, -1, 0), scale=12, surface=floor),
            Placed(shape=Sphere(), position=(1.5, -0.5, 0.5), scale=0.5, surface=ball),
        ),
    )
    for shape in SHAPES:
        for light in LIGHTS:
            alone = effort.scene(shape, ALPHAS[0], light)
            among = alone.model_copy(update={"surroundings": around})
            yield from _of_truths(effort.truth(alone), effort.truth(among))


def _masking(effort: Effort) -> Iterator[Skills]:
    """The facets that the viewer sees, against those of them that the light reaches too."""
    for shape in SHAPES:
        for alpha in ALPHAS:
            judge = Judge(effort.truth(effort.scene(shape, alpha, Uniform())))
            holds, broken = (
                judge.score(get_method(n)).skill for n in ("shadowed+body", UNSHADOWED)
            )
            yield judge.truth.scene.id, UNSHADOWED, holds, broken


def _scaled(observation: Observation, name: str, factor: float) -> Observation:
    return replace(observation, **{name: getattr(observation, name) * factor})


def _shifted_eta(observation: Observation, by: float) -> Observation:
    assert observation.eta is not None
    return replace(observation, eta=observation.eta + by)


def _turned_light(observation: Observation, by_deg: float) -> Observation:
    assert isinstance(observation.light, Distant)
    incidence = observation.light.incidence_deg + by_deg
    return replace(
        observation, light=observation.light.model_copy(update={"incidence_deg": incidence})
    )


def tilted(normals: FloatArray, by_deg: float) -> FloatArray:
    """Unit normals (..., 3), each turned by an angle about a random axis in its own plane.

    None is turned away from the viewer, z > 0: it keeps the z that it has, if it would be.

    Examples
    --------
    >>> up = np.array([[0.0, 0.0, 1.0]])
    >>> round(float(np.degrees(np.arccos(tilted(up, 5.0)[0, 2]))), 9)
    5.0
    """
    rng = np.random.default_rng(0)
    across = np.cross(normals, rng.normal(size=normals.shape))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.radians(by_deg)
    turned = np.cos(angle) * normals + np.sin(angle) * across
    return np.where(turned[..., 2:] > 0, turned, normals).astype(normals.dtype)


def _wrong_normals(observation: Observation) -> Observation:
    assert observation.normals is not None
    # Both rows, as rendered and with noise, are given the same normals.
    one = tilted(observation.normals[0], NORMALS_OFF_DEG)
    return replace(observation, normals=np.stack([one, one]))


def _wrong(
    changed: str, *changes: Callable[[Observation], Observation]
) -> Callable[[Effort], Iterator[Skills]]:
    def skills(effort: Effort) -> Iterator[Skills]:
        for truth in _plain_truths(effort):
            yield from _of_inputs(truth, changed, *changes)

    return skills


def _wrong_light(effort: Effort) -> Iterator[Skills]:
    changes = [partial(_turned_light, by_deg=sign * LIGHT_OFF_DEG) for sign in (-1, 1)]
    for truth in _plain_truths(effort):
        if isinstance(truth.scene.light, Distant):
            yield from _of_inputs(truth, "light", *changes)


def _rung(number: int) -> Callable[[Effort], Iterator[Skills]]:
    """Skill on one rung of the ladder, and on the next one down."""

    def skills(effort: Effort) -> Iterator[Skills]:
        for truth in _plain_truths(effort):
            judge = Judge(truth)
            observations = [(EVERYTHING, judge.pixels.observation), *rungs(judge.pixels)]
            above, below = observations[number][1], observations[number + 1][1]
            if isinstance(above, Inapplicable) or isinstance(below, Inapplicable):
                continue
            for name in METHODS:
                method = get_method(name)
                try:
                    estimates = [judge.pixels.estimate(method, o) for o in (above, below)]
                except Inapplicable:
                    continue
                first, second = (judge.score_estimate(e).skill for e in estimates)
                yield truth.scene.id, name, first, second

    return skills


ASSUMPTIONS = (
    Assumption("Beckmann facets (truth: GGX)", "truth", _ggx),
    Assumption("isotropic facets (truth: brushed gold)", "truth", _anisotropic),
    Assumption("one reflection (truth: up to five)", "truth", _bounces),
    Assumption("unpolarised light (truth: polarised sky)", "truth", _sky),
    Assumption("one normal a pixel (truth: edges)", "truth", _mixed),
    Assumption("one object (truth: floor and ball)", "truth", _several_objects),
    Assumption("facets that shadow none (truth: Smith)", "truth", _masking),
    Assumption(
        "index known (off by 0.05)",
        "input",
        _wrong("eta", *(partial(_shifted_eta, by=sign * ETA_OFF) for sign in (-1, 1))),
    ),
    Assumption(
        "roughness known (off by 20 %)",
        "input",
        _wrong(
            "alpha",
            *(partial(_scaled, name="alpha", factor=1 + s * ALPHA_OFF) for s in (-1, 1)),
        ),
    ),
    Assumption("light known (off by 10°)", "input", _wrong_light),
    Assumption("normals known (off by 5°)", "input", _wrong("normals", _wrong_normals)),
    Assumption("lobes known (estimated)", "ladder", _rung(0)),
    Assumption("normals known too (estimated)", "ladder", _rung(1)),
    Assumption("index, roughness known too (estimated)", "ladder", _rung(2)),
    Assumption("light known too (estimated)", "ladder", _rung(3)),
)
"""Everything that is assumed: what scenes break, what inputs do, and the ladder's rungs, which
follow one another."""
