"""Leaving out changes no result: a planned run beside one that leaves nothing out."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from malus.bench import score
from malus.bench.public import suites
from malus.bench.running.examples import MOST_EXAMPLES, example_ids
from malus.bench.running.plan import plan, savings
from malus.bench.running.runner import run
from malus.renderers import Truth
from malus.renderers.families.adaptive import first_samples
from malus.renderers.families.family import render_family
from malus.renderers.mitsuba import wavefront
from malus.renderers.variant import choose
from malus.scenes import Sampling, Scene, Sphere, Suite, Torus, Uniform, load_suite
from malus.scenes.core.result_files import RUN
from malus.scenes.suite_surfaces import Roughness

SUITE = Suite.model_validate(
    {
        "name": "tiny",
        "shapes": [{"kind": "sphere"}],
        "materials": ["water", "pmma", "polystyrene", "carbon_disulfide"],
        "surfaces": ["carbon"],
        "bodies": ["unpolarised", "polarised"],
        "lights": [{"kind": "uniform"}, {"kind": "distant", "incidence_deg": 60}],
        "wavelengths_nm": [450, 550, 650],
        "methods": ["eq8"],
        "camera": {"resolution": 12},
        "sampling": {"samples": 16, "seed": 1},
    }
)

STOKES = ("specular", "diffuse", "specular_noise", "diffuse_noise")


@pytest.fixture
def shadow_rays(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Nothing is taken for convex: every hit is asked whether it lies in shadow."""
    monkeypatch.setattr(wavefront, "CONVEX", frozenset())
    wavefront.cached_stage.cache_clear()
    yield
    wavefront.cached_stage.cache_clear()


def truth_without_a_plan(scene: Scene) -> Truth:
    """Every band rendered by itself at its own index."""
    bands = []
    for nm in scene.wavelengths_nm:
        alone = scene.model_copy(update={"wavelengths_nm": (nm,)})
        bands.append(render_family([alone], SUITE.sampling).truth(alone))
    images = {
        name: np.concatenate([getattr(band, name) for band in bands], axis=2)
        for name in (*STOKES, "standard_error")
    }
    return dataclasses.replace(bands[0], scene=scene, **images)


def test_leaving_out_changes_no_result(shadow_rays: None) -> None:
    seconds = {"planned": 0.0, "everything": 0.0}
    for family in plan(SUITE):
        started = time.perf_counter()
        rendered = render_family(family.scenes, SUITE.sampling)
        truths = [rendered.truth(scene) for scene in family.scenes]
        seconds["planned"] += time.perf_counter() - started
        for truth in truths:
            started = time.perf_counter()
            everything = truth_without_a_plan(truth.scene)
            seconds["everything"] += time.perf_counter() - started
            peak = everything.image.max()
            for name in STOKES:
                difference = getattr(truth, name) - getattr(everything, name)
                # 2e-6 is what the number of nodes aims at, 1e-5 what is promised.
                assert np.sqrt(np.mean(difference.astype(float) ** 2)) <= 1e-5 * peak, name
            np.testing.assert_array_equal(truth.mask, everything.mask)
            ours, theirs = score(truth, "eq8"), score(everything, "eq8")
            # The truth and what the method makes of it move by 1e-5 of the peak each.
            assert abs(np.sqrt(ours.nmse) - np.sqrt(theirs.nmse)) <= 2e-5
    print(seconds)  # noqa: T201


def test_convex_shapes_need_no_shadow_rays(shadow_rays: None) -> None:
    """To the bit, away from the terminator, where a ray that grazes may meet its own surface."""
    scene = next(iter(SUITE.scenes()))
    asked = render_family([scene], SUITE.sampling).truth(scene)
    wavefront.cached_stage.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wavefront, "CONVEX", frozenset({"sphere"}))
        left_out = render_family([scene], SUITE.sampling).truth(scene)
    np.testing.assert_array_equal(asked.stokes, left_out.stokes)


def test_the_formulas_cost_is_that_of_the_formulas(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is asked of Mitsuba where a suite asks nothing of it."""
    monkeypatch.setattr(suites, "render_family", None)
    families = plan(SUITE.model_copy(update={"bodies": ("unpolarised",)}))[1:]
    assert families[0].scenes[0].light.kind == "distant"
    first = suites.predicted_seconds(families, choose(), "torrance-sparrow")
    assert 0 < first < 10  # four scenes of 12² pixels take milliseconds


@pytest.mark.parametrize("backend", ["scalar", "auto"])
def test_what_is_planned_is_what_is_run(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without LLVM a run takes the suite's smaller sizes: the plan told the cost of the others."""
    ran: list[Suite] = []
    monkeypatch.setattr(suites, "predicted_seconds", lambda *_: 1.0)
    monkeypatch.setattr(suites.runner, "run", lambda suite, *_: ran.append(suite))
    suites.run("fig5", backend=backend, report=False)
    assert [suites.plan("fig5", backend).suite] == ran


@pytest.mark.parametrize("random", [False, True])
def test_a_miniature_is_rendered_as_deep_as_the_suite(
    random: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Light that bounces often costs more than light that does not."""
    deep = plan(SUITE.model_copy(update={"sampling": Sampling(samples=64, max_depth=9, seed=3)}))
    used: list[Sampling] = []
    monkeypatch.setattr(
        suites, "render_family", lambda _, sampling, *__, **___: used.append(sampling)
    )
    suites.predicted_seconds(deep, choose(), random=random)
    assert {(few.max_depth, few.seed) for few in used} == {(9, 3)}
    assert min(few.samples for few in used) < 64


def test_samples_of_random_scenes_count_as_they_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each takes 2 s and 0.1 s a sample, once its kernels are there, which many have in common."""
    clock, compiled = [0.0], set[str]()

    def render(scenes: list[Scene], sampling: Sampling, *args: Any, **more: Any) -> None:
        (scene,) = scenes
        clock[0] += 2.0 + 0.1 * sampling.samples + (scene.id not in compiled) * 3.0
        compiled.add(scene.id)

    monkeypatch.setattr(suites, "render_family", render)
    monkeypatch.setattr(suites.time, "perf_counter", lambda: clock[0])
    suite = load_suite("random")
    assert suite.random is not None
    few = suite.model_copy(
        update={
            "random": suite.random.model_copy(update={"count": 24}),
            "sampling": Sampling(samples=64),
        }
    )
    found = suites.predicted_seconds(plan(few), choose(), random=True)
    assert found == pytest.approx(24 * (2.0 + 0.1 * 64))


@pytest.mark.parametrize(("too_large", "times"), [(1.5, 2.25), (100.0, 16.0), (0.01, 1.0)])
def test_noise_falls_as_the_root_of_the_samples(
    monkeypatch: pytest.MonkeyPatch, too_large: float, times: float
) -> None:
    """An error 1.5 times the target takes 2.25 times the samples; limits hold on both sides."""
    sampling = Sampling(samples=16 * 64, target=0.01)
    family = dataclasses.replace(plan(SUITE)[0], sampling=sampling)
    few = Sampling(samples=first_samples(sampling))
    monkeypatch.setattr(suites, "relative_error", lambda *_: 0.01 * too_large)
    expected = min(times * few.samples, sampling.samples)
    assert suites._expected_samples(family, None, few) == pytest.approx(expected)  # type: ignore[arg-type]


def test_a_run_records_what_it_left_out(tmp_path: Path) -> None:
    suite = load_suite("quick").model_copy(
        update={
            "camera": SUITE.camera,
            "sampling": SUITE.sampling,
            "methods": ("unpolarised",),
            "surfaces": ("carbon",),
        }
    )
    first = run(suite, tmp_path).run["plan"]
    # 8 scenes, 3 bands, 5 angles, 2 lobes
    assert first["without_plan"] == 8 * 3 * 5 * 2
    # 4 families: six indices each, no more than nodes would be; half of the bodies need one
    assert first["renders"] == 4 * 6 + 2 * 6 + 2
    left_out = {saving["what"]: saving["renders"] for saving in first["left_out"]}
    assert sum(left_out.values()) == first["without_plan"] - first["renders"]
    assert left_out["polariser images"] == 8 * 3 * 4 * 2
    assert all(saving["why"] for saving in first["left_out"])
    assert first["seconds"] > 0
    each = first["seconds"] / first["renders"]
    # Both are rounded to milliseconds.
    rounding = 1e-3 * first["without_plan"] / first["renders"]
    assert first["seconds_without"] == pytest.approx(each * first["without_plan"], abs=rounding)
    assert json.loads((tmp_path / RUN).read_text("utf-8"))["plan"] == first
    # Taken over, the seconds are still those of the renders.
    assert run(suite, tmp_path).run["plan"] == first


def test_every_saving_says_alone_why_nothing_is_lost() -> None:
    """The page sorts and leaves out lines: none may refer to the one before it."""
    interpolated = load_suite("fig5")
    repeated = SUITE.model_copy(update={"materials": ("pmma",), "bodies": ("polarised",)})
    wanted = {"a render is a smooth function of the index": interpolated,
              "equal indices are rendered once": repeated}  # fmt: skip
    for why, suite in wanted.items():
        omitted = {saving.what: saving.why for saving in savings(suite, plan(suite))}
        assert not any("the same" in text for text in omitted.values())
        assert all(omitted[f"{lobe} images"].startswith(why) for lobe in ("specular", "diffuse"))
    assert not any(family.interpolated for family in plan(repeated))


def test_the_plan_says_whose_light_bounces_and_what_is_interpolated() -> None:
    suite = SUITE.model_copy(
        update={
            "shapes": (Sphere(), Torus()),
            "materials": ("water", "gold"),
            "bodies": ("polarised",),
            "surfaces": (Roughness(alpha=0.2, albedo="red"),),
            "lights": (Uniform(),),
            "sampling": SUITE.sampling.model_copy(update={"max_depth": 4}),
        }
    )
    families = plan(suite)
    omitted = {saving.what: saving for saving in savings(suite, families)}
    bouncing, circular = omitted["families whose light bounces"], omitted["families with s3"]
    assert (bouncing.done, bouncing.instead_of, circular.done) == (2, 4, 1)
    assert "1 of them are interpolated in the index, at every albedo" in bouncing.why
    assert "1 are rendered by band" in bouncing.why
    images = {
        (f.scenes[0].shape.kind, f.scenes[0].surface.kind): f.specular_images for f in families
    }
    # Water in three bands, each of another albedo.
    assert images["torus", "dielectric"] == len(suite.wavelengths_nm)
    assert images["torus", "conductor"] == len(suite.wavelengths_nm)
    once = {saving.what: saving.done for saving in savings(SUITE, plan(SUITE))}
    assert once["families whose light bounces"] == once["families with s3"] == 0


def test_examples_are_spread_over_all_families() -> None:
    """Each is the scene of middle index of its family, from the first families to the last."""
    families = plan(load_suite("fig5"))
    chosen = example_ids(families)
    assert len(chosen) == MOST_EXAMPLES < len(families)
    places = [place for place, family in enumerate(families) if chosen & {*family.scene_ids}]
    assert len(places) == MOST_EXAMPLES
    # As even as whole numbers can be, from the first family to the end.
    assert set(np.diff([*places, len(families)])) <= {3, 4}
    for place in places:
        indices = sorted(float(scene.eta.real.mean()) for scene in families[place].scenes)
        (example,) = (scene for scene in families[place].scenes if scene.id in chosen)
        assert float(example.eta.real.mean()) == indices[len(indices) // 2]
