"""The weights that malus brings, on scenes that they never saw: skill, honesty, and no seam."""

from __future__ import annotations

import functools
import os

import numpy as np
import pytest

from malus.bench.scoring.judge import Judge, Score
from malus.bench.scoring.observe import observe
from malus.reconstruct import get_method
from malus.reconstruct.learned.network import WEIGHTS, network
from malus.renderers import Truth, render
from malus.scenes import Area, Blob, Camera, Dielectric, Scene, Sphere, Torus, Uniform

MOST_BYTES = 4_000_000
pytestmark = pytest.mark.skipif(
    not WEIGHTS.is_file() and os.environ.get("CI") != "true", reason="no trained weights here"
)


@functools.cache
def truths() -> dict[str, Truth]:
    """Scenes with one object each: three shapes, two lights, two bodies."""
    camera, wavelengths = Camera(resolution=64), (450.0, 550.0, 650.0)
    lights = {"lamp": Area(incidence_deg=45, half_angle_deg=20), "uniform": Uniform()}
    scenes = {
        f"{shape.kind}, {light}": Scene(
            shape=shape,
            surface=Dielectric(eta=1.5, alpha=0.2, body="polarised", albedo=albedo),
            light=lights[light],
            camera=camera,
            wavelengths_nm=wavelengths,
        )
        for shape, albedo in ((Sphere(), "blue"), (Torus(), "red"), (Blob(seed=7), "neutral_5"))
        for light in lights
    }
    return {name: render(scene) for name, scene in scenes.items()}


@functools.cache
def scores() -> dict[str, Score]:
    return {name: Judge(truth).score(get_method("net")) for name, truth in truths().items()}


def values(metric: str) -> list[float]:
    rows = [row for score in scores().values() for row in score.values()]
    return [row.value for row in rows if row.metric == metric and row.angle_deg is None]


def test_the_file_is_small_and_says_what_it_is() -> None:
    about = network().about
    assert WEIGHTS.stat().st_size <= MOST_BYTES
    assert about.validation_skill is not None
    assert about.validation_skill > 0


def test_it_beats_the_guess_on_most_scenes_that_it_never_saw() -> None:
    assert np.median([score.skill for score in scores().values()]) > 0


def test_its_error_grows_with_the_uncertainty_that_it_states() -> None:
    """Within most pictures: the stated deviation and the error rise together."""
    ranks = values("deviation_rank")
    assert len(ranks) == len(scores())
    assert np.median(ranks) > 0.1


def test_where_it_is_less_sure_it_errs_more() -> None:
    """The pixels of all scenes in five classes by stated deviation: errors rise with it."""
    stated, erred = [], []
    for truth in truths().values():
        estimate = get_method("net").reconstruct(observe(truth, frozenset()))
        light = truth.image[..., None]
        field = np.stack([estimate.s1, estimate.s2], axis=-1)
        lit = truth.mask[..., None] & (truth.image > 0.01 * truth.image[truth.mask].max())
        erred.append(((field - truth.stokes[..., 1:]) / np.where(light > 0, light, 1))[lit])
        stated.append(estimate.deviation[lit])
    deviation, error = np.concatenate(stated), np.concatenate(erred)
    order = np.array_split(np.argsort(deviation), 5)
    rms = [float(np.sqrt(np.mean(np.square(error[part])))) for part in order]
    assert rms[-1] > 1.5 * rms[0]
    assert np.corrcoef(rms, [deviation[part].mean() for part in order])[0, 1] > 0.7


def test_no_seam() -> None:
    model = network()
    light = np.random.default_rng(0).uniform(0, 2, (160, 176, 3)).astype(np.float32)
    for one, other in zip(model.run(light, 4096), model.run(light, 32), strict=True):
        # Hundreds of products of single precision are added in another order.
        np.testing.assert_allclose(one, other, atol=2e-5)


def test_training_taught_the_mirror_before_answers_are_averaged() -> None:
    """One pass of the network alone, over all scenes: s2 changes its sign in a mirror, s1 not."""
    fields: dict[str, list[np.ndarray]] = {"s1": [], "s2": []}
    for truth in truths().values():
        light = np.where(truth.mask[..., None], truth.image, 0)[..., ::-1]  # red first
        picture = (light / light[truth.mask].mean()).astype(np.float32)
        one, other = network().run(picture), network().run(picture[:, ::-1].copy())
        for name, sign in (("s1", 1), ("s2", -1)):
            pair = getattr(one, name), sign * getattr(other, name)[:, ::-1]
            fields[name].append(np.stack(pair)[:, truth.mask])
    for pairs in fields.values():
        there, back = np.concatenate(pairs, axis=1)
        # Fields that know nothing of each other differ by √2 of their size, a wrong sign by 2.
        assert np.sqrt(np.mean((there - back) ** 2)) < np.sqrt(np.mean(there**2))
