"""Samples until a target: it is met, costs no more than it must, and biases nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from made_up import made_up_truth

from malus.bench.running.plan import plan
from malus.bench.running.runner import run
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.families.adaptive import RepeatedRenders, relative_error
from malus.renderers.families.family import render_family
from malus.renderers.truth import Truth
from malus.scenes import Area, Camera, Dielectric, Sampling, Scene, Sphere, load_suite

LIT = {"shape": Sphere(), "light": Area(incidence_deg=45), "camera": Camera(resolution=10)}
ONE = Scene(surface=Dielectric(eta=1.5, alpha=0.3), **LIT)
TWO = Scene(surface=Dielectric(eta=1.7, alpha=0.3, albedo=0.1), **LIT)


def until(
    target: float, seed: int = 1, samples: int = 256, scenes: object = (ONE,)
) -> RepeatedRenders:
    renders = render_family(scenes, Sampling(samples=samples, seed=seed, target=target))
    assert isinstance(renders, RepeatedRenders)
    return renders


def test_without_a_target_nothing_changes() -> None:
    assert "target" not in Sampling().model_dump()
    assert Sampling().id == Sampling(target=None).id != Sampling(target=1e-3).id
    assert not isinstance(render_family([ONE], Sampling(samples=4)), RepeatedRenders)


def test_the_target_is_met_with_few_more_samples_than_needed() -> None:
    first = relative_error(until(0.9, scenes=(ONE, TWO)), [ONE, TWO])
    target = first / 2
    found = until(target, scenes=(ONE, TWO))
    assert relative_error(found, [ONE, TWO]) <= target
    # A quarter of the variance takes four times the samples; the noise of the noise may cost a few.
    assert 3 * 16 <= found.samples <= 7 * 16
    truth = found.truth(ONE)
    assert truth.samples == found.samples
    # The error that the samples themselves tell, of s1 and s2: a second estimate of the same.
    told = truth.standard_error[truth.mask][..., 1:]
    told = np.sqrt(np.mean(told.astype(float) ** 2)) / truth.image[truth.mask].max()
    assert told == pytest.approx(relative_error(found, [ONE]), rel=0.35)


def test_what_cannot_be_met_ends_at_the_most_samples() -> None:
    assert until(1e-9, samples=64).samples == 64
    assert until(0.9, samples=64).samples == 16


def test_the_samples_are_kept_in_a_dataset(tmp_path: Path) -> None:
    truth = until(0.9).truth(ONE)
    with DatasetWriter(tmp_path) as writer:
        writer.add(truth)
    assert open_folder(tmp_path).truth(ONE.id).samples == truth.samples == 16


def test_it_is_deterministic() -> None:
    one, other = until(5e-3), until(5e-3)
    assert one.samples == other.samples
    np.testing.assert_array_equal(one.truth(ONE).stokes, other.truth(ONE).stokes)
    assert until(5e-3, seed=2).truth(ONE).stokes.tobytes() != one.truth(ONE).stokes.tobytes()


def test_passes_are_independent_and_average() -> None:
    found = until(1e-9, samples=64)
    assert found.counts == (16, 48)
    first, second = (one.truth(ONE) for one in found.passes)
    mean = 0.25 * first.stokes + 0.75 * second.stokes
    np.testing.assert_allclose(found.truth(ONE).stokes, mean, atol=1e-6)
    reference = render_family([ONE], Sampling(samples=2048, seed=99)).truth(ONE).stokes
    noise = [(part.stokes - reference)[part.mask].ravel() for part in (first, second)]
    # Some 50 pixels: the correlation of independent noises strays by 0.15.
    assert abs(np.corrcoef(noise)[0, 1]) < 0.4
    errors = np.hypot(0.25 * first.standard_error, 0.75 * second.standard_error)
    np.testing.assert_allclose(found.truth(ONE).standard_error, errors, rtol=1e-4)


@dataclass(frozen=True)
class Rendered:
    """Renders of one scene, as a family has them."""

    one: Truth

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        del scene, standard_error
        return self.one


def test_a_pixel_is_covered_where_it_is_in_every_pass() -> None:
    truths = [
        replace(made_up_truth(seed), normal_spread=np.zeros((6, 6), np.float32)) for seed in (0, 1)
    ]
    both = RepeatedRenders(tuple(map(Rendered, truths)), (16, 48)).truth(truths[0].scene)
    first, second = (truth.mask for truth in truths)
    assert (first & ~second).any()
    assert (second & ~first).any()
    assert both.mask.tolist() == (first & second).tolist()


def test_stopping_biases_nothing() -> None:
    """A target that some seeds meet a pass sooner than others; their mean against many samples."""
    reference = render_family([ONE], Sampling(samples=4096, seed=99)).truth(ONE)
    target = relative_error(until(1e-9, samples=48, seed=5), [ONE])
    truths, samples = [], set()
    for seed in range(24):
        found = until(target, seed=seed + 10)
        samples.add(found.samples)
        truths.append(found.truth(ONE))
    assert len(samples) > 1, "no choice was made: this test sees nothing"
    mask = reference.mask
    residual = np.mean([t.stokes for t in truths], axis=0) - reference.stokes
    error = np.sqrt(np.mean([t.standard_error**2 for t in truths], axis=0) / len(truths))
    error = np.hypot(error, reference.standard_error)
    z = residual[mask] / np.maximum(error[mask], 1e-7)
    # Some 60 pixels of 3 components; s0, s1, s2 of a pixel move together.
    assert 0.6 < np.mean(z**2) < 1.5
    # The image's sum moves by less than 3 of its standard errors.
    total = residual[mask][..., 0].sum() / np.sqrt(np.sum(error[mask][..., 0] ** 2))
    assert abs(total) < 3


def test_a_plan_keeps_the_target() -> None:
    suite = load_suite("quick").model_copy(update={"sampling": Sampling(samples=256, target=1e-3)})
    plain = load_suite("quick").model_copy(update={"sampling": Sampling(samples=256)})
    assert plan(suite)[0].id != plan(plain)[0].id


def test_a_run_tells_how_many_samples_it_took(tmp_path: Path) -> None:
    sampling = Sampling(samples=64, target=0.02)
    suite = load_suite("quick").model_copy(
        update={
            "sampling": sampling, "camera": LIT["camera"], "methods": ("unpolarised",),
            "surfaces": ("carbon",), "bodies": ("unpolarised",), "materials": ("water",),
        }
    )  # fmt: skip
    least, most = run(suite, tmp_path).run["samples"].values()
    assert 16 <= least <= most <= 64
    # A distant light is nearly free of noise, light from all around is not.
    wanted = [render_family(f.scenes, f.sampling).samples for f in plan(suite)]
    assert [least, most] == sorted(wanted)
