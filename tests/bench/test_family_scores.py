"""Scenes that are scored side by side get the scores that each gets on its own."""

from __future__ import annotations

import errno
from typing import Any

import numpy as np
import pytest

from malus.bench.running import scene_scores
from malus.bench.running.family_task import FamilyTask
from malus.bench.running.plan import plan
from malus.bench.running.scene_scores import SceneResult, ScoringPlan, score_together
from malus.bench.running.truths import Renders
from malus.bench.running.work import work
from malus.bench.scoring import family_scores
from malus.bench.scoring.family_scores import FamilyJudge, FamilyPixels, NotTogether, groups
from malus.bench.scoring.judge import Judge
from malus.reconstruct import Components, Inapplicable, Method, Observation, get_method
from malus.renderers.families.family import render_family
from malus.renderers.families.interpolated import Family
from malus.renderers.variant import choose
from malus.scenes import Camera, Dielectric, Distant, Sampling, Scene, Sphere
from malus.scenes.suite import Suite

METHODS = ("unpolarised", "eq8", "shadowed+body", "half_vector+body", "lights+body")
ALBEDOS = (0.1, 0.5, 0.9)


@pytest.fixture(scope="module")
def scenes() -> tuple[Scene, ...]:
    return tuple(
        Scene(
            shape=Sphere(),
            surface=Dielectric(material=material, alpha=0.3, albedo=albedo, body="polarised"),
            light=Distant(incidence_deg=60, azimuth_deg=20),
            camera=Camera(resolution=16, projection="perspective", fov_deg=50, distance=3),
            wavelengths_nm=(450.0, 550.0, 650.0),
        )
        for material, albedo in zip(("water", "pmma", "polystyrene"), ALBEDOS, strict=True)
    )


@pytest.fixture(scope="module")
def family(scenes: tuple[Scene, ...]) -> Family:
    rendered = render_family(scenes, Sampling(samples=16, seed=2), choose(), errors=False)
    assert isinstance(rendered, Family)
    return rendered


@pytest.mark.parametrize("method", METHODS)
def test_scores_are_those_of_each_scene(
    method: str, family: Family, scenes: tuple[Scene, ...]
) -> None:
    pixels = FamilyPixels.of(family, scenes, family.truth(scenes[0], False))
    together = FamilyJudge(pixels).scores(pixels.estimate(get_method(method)))
    for scene, score in zip(scenes, together, strict=True):
        alone = Judge(family.truth(scene, standard_error=False)).score(get_method(method))
        for one, other in zip(score.values(), alone.values(), strict=True):
            assert (one.metric, *one[3:]) == (other.metric, *other[3:])
            # Interpolation adds float32 numbers in another order, a few 1e-7 of a radiance. An
            # error that is a small difference of those keeps fewer digits.
            assert one.value == pytest.approx(other.value, rel=1e-4, abs=1e-7, nan_ok=True), one
            assert one.noise == pytest.approx(other.noise, rel=1e-4, abs=1e-7, nan_ok=True), one


def test_pixels_are_those_of_the_truths(family: Family, scenes: tuple[Scene, ...]) -> None:
    pixels = FamilyPixels.of(family, scenes, family.truth(scenes[0], False))
    for number, scene in enumerate(scenes):
        truth, own = family.truth(scene, standard_error=False), slice(3 * number, 3 * number + 3)
        inside = truth.mask
        peak = truth.image.max()
        expected = truth.stokes[inside]
        read = np.stack([pixels.observation.image[0], *pixels.true], axis=-1)[:, own]
        np.testing.assert_allclose(read, expected, atol=1e-6 * peak)  # float32
        noise = (truth.specular_noise + truth.diffuse_noise)[inside]
        np.testing.assert_allclose(pixels.draw[0][:, own], noise[..., 1], atol=1e-6 * peak)


def test_what_one_scene_refuses_is_scored_scene_by_scene(
    family: Family, scenes: tuple[Scene, ...]
) -> None:
    def dislikes_water(observation: Observation) -> Components:
        if np.min(observation.require("eta")) < 1.4:
            raise ValueError("too thin")
        return Components(observation.image, observation.image * 0, observation.image * 0)

    def needs_a_lamp(observation: Observation) -> Components:
        raise Inapplicable("needs a lamp")

    pixels = FamilyPixels.of(family, scenes, family.truth(scenes[0], False))
    with pytest.raises(NotTogether):
        pixels.estimate(Method("a", frozenset({"eta"}), dislikes_water, "", True, True))
    with pytest.raises(Inapplicable):
        pixels.estimate(Method("b", frozenset(), needs_a_lamp, "", True, True))


def test_results_are_the_same_for_any_number_of_threads(
    monkeypatch: pytest.MonkeyPatch, scenes: tuple[Scene, ...]
) -> None:
    monkeypatch.setattr(family_scores, "BANDS_AT_ONCE", 3)
    assert len(list(groups(scenes))) == 3
    suite = Suite.parse(
        {
            "name": "threads",
            "shapes": [{"kind": "sphere"}],
            "materials": ["water", "pmma", "polystyrene"],
            "surfaces": ["carbon"],
            "bodies": ["polarised"],
            "lights": [{"kind": "uniform"}],
            "wavelengths_nm": [450, 550],
            "methods": list(METHODS),
            "camera": {"resolution": 12},
            "sampling": {"samples": 8},
        },
        "here",
    )
    (planned,) = plan(suite)
    # A fault of the common pass would be hidden by scoring each scene on its own.
    monkeypatch.setattr(scene_scores.SceneResult, "score", lambda *_: pytest.fail("one by one"))
    names = {name: name for name in METHODS}
    tables = [
        work(FamilyTask("id", planned, "mitsuba", names), choose(), threads).table
        for threads in (1, 2, 5)
    ]
    for table in tables:
        assert table is not None
        assert table.equals(tables[0])


@pytest.mark.parametrize("said", [{"converged": True}, {"deviation": 0.1}])
def test_what_a_method_says_of_itself_is_scored(
    said: dict[str, Any], family: Family, scenes: tuple[Scene, ...]
) -> None:
    """The common pass does not score it: it must not be left out in silence."""

    def sure(observation: Observation) -> Components:
        nothing = np.zeros_like(observation.image)
        told = {key: nothing + v if key == "deviation" else v for key, v in said.items()}
        return Components(observation.image, nothing, nothing, **told)

    pixels = FamilyPixels.of(family, scenes, family.truth(scenes[0], False))
    with pytest.raises(NotTogether):
        pixels.estimate(Method("sure", frozenset(), sure, "", True, True))


def test_methods_of_whole_pictures_are_given_pictures(
    family: Family, scenes: tuple[Scene, ...]
) -> None:
    shapes = set()

    def looks(observation: Observation) -> Components:
        shapes.add(observation.image.shape)
        nothing = np.zeros_like(observation.image)
        return Components(observation.image, nothing, nothing)

    method = Method("looks", frozenset(), looks, "", per_pixel=False, per_band=True)
    results = [SceneResult(scene) for scene in scenes]
    plan_of = ScoringPlan([method])
    assert not score_together(results, renders(family, scenes), plan_of, frozenset())
    results[0].score("render", lambda scene: family.truth(scene, False), plan_of, False)
    assert shapes == {(16, 16, 3)}


def renders(family: Family, scenes: tuple[Scene, ...]) -> Renders:
    return Renders("render", lambda scene: family.truth(scene, False), scenes[0], family)


def test_a_fault_in_the_common_pass_costs_no_scene(
    monkeypatch: pytest.MonkeyPatch, family: Family, scenes: tuple[Scene, ...]
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no memory for so many bands")

    monkeypatch.setattr(FamilyPixels, "of", broken)
    results = [SceneResult(scene) for scene in scenes]
    scoring = ScoringPlan([get_method(name) for name in METHODS])
    assert not score_together(results, renders(family, scenes), scoring, frozenset())
    assert not any(result.records or result.outcome.failures for result in results)


@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError(errno.ENOSPC, "full")])
def test_what_stops_a_run_stops_the_common_pass(
    monkeypatch: pytest.MonkeyPatch, family: Family, scenes: tuple[Scene, ...], stop: Any
) -> None:
    def stopped(*_: object) -> None:
        raise stop

    monkeypatch.setattr(FamilyPixels, "of", stopped)
    scoring = ScoringPlan([get_method("eq8")])
    with pytest.raises((KeyboardInterrupt, OSError)):
        score_together([SceneResult(scenes[0])], renders(family, scenes), scoring, frozenset())
