"""The ladder of knowledge: what every rung tells, and what it puts in place of the rest."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from malus.bench.running.scene_scores import SceneResult, ScoringPlan
from malus.bench.scoring.judge import Judge
from malus.bench.scoring.knowledge_ladder import EVERYTHING, GIVEN_RUNGS, RUNGS, rungs
from malus.bench.scoring.masked_pixels import MaskedPixels
from malus.bench.scoring.observe import observe
from malus.reconstruct import Inapplicable, Method, Observation, get_method
from malus.reconstruct.methods import _methods
from malus.reconstruct.observation import INPUTS
from malus.renderers import Truth, render
from malus.reports.tables.figure_numbers import MODEL, NOISE, ladder_numbers
from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere

SCENE = Scene(
    shape=Sphere(),
    surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    light=Distant(incidence_deg=60),
    camera=Camera(resolution=16),
    wavelengths_nm=(450.0, 650.0),
)


@pytest.fixture
def truth() -> Truth:
    """Without noise: its draw is shared out among the lobes as the picture is, on every rung."""
    return render(SCENE, renderer="torrance-sparrow")


def scored(truth: Truth, names: tuple[str, ...]) -> dict[tuple[str, str], dict[str, float]]:
    result = SceneResult(SCENE)
    plan = ScoringPlan([get_method(name) for name in names], ladder=True)
    result.score("render", lambda scene: truth, plan, keep_example=False)
    assert not result.outcome.failures
    return {
        (record.common["method"], record.common["knowledge"]): {
            value.metric: value.value
            for value in record.values.each()
            if value.band_nm is None and value.angle_deg is None
        }
        for record in result.records
    }


def test_a_chain_that_is_right_costs_nothing(truth: Truth, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the truth in place of what is estimated every rung scores as the first."""
    asked: list[Observation] = []

    def perfect(observation: Observation) -> SimpleNamespace:
        asked.append(observation)
        return SimpleNamespace(observation=observe(truth, INPUTS))

    monkeypatch.setattr("malus.reconstruct.single_image.blind.run_chain", perfect)
    scores = scored(truth, ("eq8", "half_vector"))
    assert [rung for method, rung in scores if method == "eq8"] == [EVERYTHING, *RUNGS]
    for (method, rung), values in scores.items():
        # The lobes come back as shares of the picture: a few roundings of float64.
        expected = pytest.approx(scores[method, EVERYTHING], rel=1e-6, abs=1e-9)
        assert values == expected, (method, rung)
    untold: set[str] = set()
    for observation, more in zip(asked, RUNGS.values(), strict=True):
        untold |= more
        assert {name for name in INPUTS if getattr(observation, name) is None} == untold


def misled(truth: Truth) -> Observation:
    """All of it wrong, and of every thing another value."""
    true = observe(truth, INPUTS)
    return Observation(
        image=true.image,
        mask=true.mask,
        specular=0.25 * true.image,
        diffuse=0.75 * true.image,
        normals=true.require("normals")[..., [1, 0, 2]],
        eta=np.array([1.7, 1.8]),
        alpha=0.1,
        light=Distant(incidence_deg=10),
    )


def test_a_rung_changes_only_what_it_does_not_tell(
    truth: Truth, monkeypatch: pytest.MonkeyPatch
) -> None:
    pixels, wrong = MaskedPixels.of(truth), misled(truth)
    told = pixels.observation
    monkeypatch.setattr(
        "malus.reconstruct.single_image.blind.run_chain",
        lambda observation: SimpleNamespace(observation=wrong),
    )
    by_rung = dict(rungs(pixels))
    first, second, third, last = (by_rung[name] for name in RUNGS)
    assert all(isinstance(rung, Observation) for rung in by_rung.values())
    np.testing.assert_allclose(first.specular, 0.25 * told.image, rtol=1e-6)
    np.testing.assert_allclose(first.specular + first.diffuse, told.image, rtol=1e-6)
    np.testing.assert_array_equal(first.normals, told.normals)
    np.testing.assert_array_equal(second.normals, told.normals[..., [1, 0, 2]])
    assert (second.alpha, third.alpha, last.alpha) == (0.3, 0.1, 0.1)
    np.testing.assert_array_equal(second.eta, told.eta)
    np.testing.assert_array_equal(third.eta, [1.7, 1.8])
    assert third.light == SCENE.light
    assert last.light == wrong.light


def test_methods_are_given_what_a_rung_tells(truth: Truth, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that work a pixel at a time: the others have knowledge of their own."""
    monkeypatch.setattr(
        "malus.reconstruct.single_image.blind.run_chain",
        lambda observation: SimpleNamespace(observation=misled(truth)),
    )
    whole = Method("whole", frozenset(), get_method("unpolarised").reconstruct, "needs a picture")
    monkeypatch.setitem(_methods(), "whole", whole)
    scores = scored(truth, ("eq8", "half_vector", "whole"))
    assert [rung for method, rung in scores if method == "whole"] == [EVERYTHING]
    judge = Judge(truth)
    for method in ("eq8", "half_vector"):
        for rung, observation in rungs(judge.pixels):
            assert isinstance(observation, Observation)
            estimate = judge.pixels.estimate(get_method(method), observation)
            assert scores[method, rung]["nmse"] == judge.score_estimate(estimate).nmse
            assert scores[method, rung]["nmse"] > 1.1 * scores[method, EVERYTHING]["nmse"]


def test_a_chain_that_finds_nothing_is_told(truth: Truth, monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(observation: Observation) -> SimpleNamespace:
        raise Inapplicable("no outline")

    monkeypatch.setattr("malus.reconstruct.single_image.blind.run_chain", lost)
    scores = scored(truth, ("eq8",))
    assert "nmse" in scores["eq8", EVERYTHING]
    assert all(scores["eq8", rung] == {"inapplicable": 1.0} for rung in RUNGS)


def test_the_papers_chain_climbs_to_equation_8(truth: Truth) -> None:
    """From the picture alone, one stage after another given; the last rung is the oracle's."""
    scores = scored(truth, ("eq8", "paper"))
    assert [rung for method, rung in scores if method == "paper"] == [EVERYTHING, *GIVEN_RUNGS]
    top, eq8 = scores["paper", list(GIVEN_RUNGS)[-1]], scores["eq8", EVERYTHING]
    # The same tables on the same numbers, gathered before or after: roundings of single precision.
    for name in ("nmse", "skill", "gain", "rotation"):
        assert top[name] == pytest.approx(eq8[name], rel=1e-6), name
    assert scores["paper", EVERYTHING]["nmse"] != pytest.approx(eq8["nmse"], rel=1e-3)


def test_a_rung_of_a_chain_gives_one_thing_more(truth: Truth) -> None:
    asked: list[set[str]] = []

    def watching(observation: Observation) -> Any:
        asked.append({name for name in INPUTS if getattr(observation, name) is not None})
        return get_method("unpolarised").reconstruct(observation)

    chain = Method("chain", frozenset(), watching, "a chain", optional=INPUTS)
    result, plan = SceneResult(SCENE), ScoringPlan([chain], ladder=True)
    result.score("render", lambda scene: truth, plan, keep_example=False)
    expected = list(itertools.accumulate(GIVEN_RUNGS.values(), set.union, initial=set[str]()))
    # Twice on every rung: as rendered, and with a draw of the noise.
    assert asked == [given for given in expected for _ in range(2)]


def test_parts_of_a_chain_that_climbs_add_up_from_its_last_rung() -> None:
    errors = dict(zip((EVERYTHING, *GIVEN_RUNGS), (9.0, 8.0, 6.0, 5.0, 3.0, 2.0), strict=True))
    rows = [
        {"scene": "a", "body": "unpolarised", "method": "paper", "knowledge": rung, "noise": 0.5,
         "metric": "nmse", "band_nm": None, "angle_deg": None, "value": error}
        for rung, error in errors.items()
    ]  # fmt: skip
    parts = ladder_numbers(pd.DataFrame(rows))
    assert parts["source"].tolist() == [
        NOISE, MODEL, "index and roughness estimated", "normals estimated", "lobes estimated",
        "light estimated", "illuminant estimated",
    ]  # fmt: skip
    assert parts["increment"].tolist() == [0.5, 1.5, 1.0, 2.0, 1.0, 2.0, 1.0]
    assert parts["nmse"].tolist()[-1] == 9.0


def test_rungs_keep_their_order_where_the_first_scene_lacks_some() -> None:
    """A method that did not apply there has no error on them, but a reason."""
    common = {"body": "unpolarised", "method": "paper", "noise": 0.0, "band_nm": None,
              "angle_deg": None}  # fmt: skip
    rows = [
        common | {"scene": scene, "knowledge": rung, "metric": metric, "value": 1.0}
        for scene, missing in (("a", {EVERYTHING, "light given"}), ("b", set()))
        for rung in (EVERYTHING, *GIVEN_RUNGS)
        for metric in ("inapplicable" if rung in missing else "nmse",)
    ]
    sources = ladder_numbers(pd.DataFrame(rows))["source"].tolist()
    assert sources[2:] == [name.replace("given", "estimated") for name in reversed(GIVEN_RUNGS)]
