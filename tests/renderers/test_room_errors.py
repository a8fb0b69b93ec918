"""Standard errors of scenes whose objects light each other: what they say, and what they pool."""

from __future__ import annotations

import numpy as np
import pytest
from plain import scene_of
from rooms import needs_arrays, table

from malus.renderers import render
from malus.renderers.mitsuba.path_traced import Room
from malus.renderers.mitsuba.pooled import OBJECT_WEIGHT, pooled, pooled_where_rare
from malus.renderers.truth import Truth
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Area,
    Camera,
    Conductor,
    Dielectric,
    Distant,
    Light,
    Patterned,
    Placed,
    Polariser,
    Sampling,
    Scene,
    Sphere,
    Stripes,
    Surroundings,
)

SEEDS = 20
PAINT = Dielectric(eta=1.5, alpha=0.3, body="polarised")


def truths(light: Light, body: str, samples: int) -> list[Truth]:
    """One scene from independent samples; the room is kept, so that its kernel is."""
    room = Room(mitsuba(choose()), table(light, body), Sampling(samples=samples))
    found = []
    for seed in range(SEEDS):
        room.sampling = Sampling(samples=samples, seed=seed)
        found.append(room.truth())
    return found


def scaled_squares(found: list[Truth]) -> np.ndarray:
    """Squares (seeds, pixels, 3) of residuals over their own errors, of mean 1."""
    mask = found[0].mask
    stokes = np.stack([truth.stokes[mask][:, 0] for truth in found]).astype(np.float64)
    error = np.stack([truth.standard_error[mask][:, 0] for truth in found])
    assert (error > 0).all()
    return (stokes - stokes.mean(axis=0)) ** 2 / error**2 * SEEDS / (SEEDS - 1)


@needs_arrays
@pytest.mark.parametrize(
    ("light", "body", "samples", "components"),
    [
        (Distant(incidence_deg=60, azimuth_deg=60), "unpolarised", 256, 1),
        (Area(incidence_deg=60, azimuth_deg=60), "polarised", 64, 2),
    ],
    ids=["distant", "area"],
)
def test_standard_errors_of_rooms_are_honest(
    light: Light, body: str, samples: int, components: int
) -> None:
    """Twenty seeds: residuals over each seed's own error have a mean square of 1, and few outliers.

    Under the distant light the floor's own light is the same in all samples, so that what comes
    from other objects, rarely, is all its noise: errors from a pixel's own samples are zero there
    in many seeds. Components that come to most pixels by such ways only are no test.
    """
    found = truths(light, body, samples)
    squares = scaled_squares(found)
    for component in range(components):
        square = squares[:, :, component]
        # 6500 squares of heavy tails, of 327 independent pixels: one deviation of the mean is
        # 0.03. The weight of the object's mean makes errors larger by up to a tenth.
        assert 0.82 < square.mean() < 1.12
        # Of Gaussian noise 0.046 lie beyond two errors and 0.0027 beyond three. What comes rarely
        # is not Gaussian, and a pixel's neighbours are not quite like it.
        assert 0.03 < (square > 4).mean() < 0.06
        assert (square > 9).mean() < 0.01
    # The half differences say the same. Sums of 6500 squares that bright paths lead: a few
    # times 2 %.
    mask = found[0].mask
    noise = np.stack([(t.specular_noise + t.diffuse_noise)[mask] for t in found])[..., :components]
    error = np.stack([t.standard_error[mask] for t in found])[..., :components]
    expected = pytest.approx((error**2).mean(axis=(0, 1, 2)), rel=0.12)
    assert (noise**2).mean(axis=(0, 1, 2)) == expected


@needs_arrays
@pytest.mark.parametrize("light", [Distant(incidence_deg=50), Area(incidence_deg=50)])
def test_errors_of_light_that_comes_directly_are_each_pixels_own(light: Distant | Area) -> None:
    """Light that is polarised by next to nothing has the errors of unpolarised light.

    A metal in it is rendered as rooms are, for its s3, but no path of it is rare.
    """
    hardly = light.model_copy(update={"polarised": Polariser(degree=1e-6)})
    unpolarised, polarised = (
        render(
            Scene(
                shape=Sphere(),
                surface=Conductor(material="gold", alpha=0.2),
                light=lamp,
                camera=Camera(resolution=24),
            ),
            Sampling(samples=1024),
        )
        for lamp in (light, hardly)
    )
    assert unpolarised.s3 is None
    assert polarised.s3 is not None
    lit = unpolarised.mask & (unpolarised.image[..., 0] > 0.01 * unpolarised.image.max())
    assert lit.sum() > 60
    ratio = polarised.standard_error[lit][:, 0] / unpolarised.standard_error[lit][:, 0]
    # Under the distant light the samples are the same, and so are errors but for float32. Under the
    # lamp they are others, 1024 whose errors are wrong by 7 %; the median of 90 pixels by 1 %.
    # Means over neighbours and the object are 1.2 in the median, and up to 3.
    assert np.abs(np.median(ratio, axis=0) - 1).max() < 0.05
    assert (np.abs(ratio - 1) < 0.25).mean() > 0.95


def test_variances_are_pooled_over_neighbours_of_one_object() -> None:
    """Against a loop over the pixels."""
    random = np.random.default_rng(1)
    variance = random.exponential(size=(6, 7, 2, 3)).astype(np.float32)
    owner = random.integers(-1, 3, size=(6, 7))
    found = pooled(variance, owner)
    assert found.dtype == variance.dtype
    for y, x in np.ndindex(owner.shape):
        if owner[y, x] < 0:
            assert (found[y, x] == variance[y, x]).all()
            continue
        window = [
            variance[j, i]
            for j in range(max(y - 1, 0), min(y + 2, 6))
            for i in range(max(x - 1, 0), min(x + 2, 7))
            if owner[j, i] == owner[y, x]
        ]
        whole = variance[owner == owner[y, x]].mean(axis=0)
        mean = (np.sum(window, axis=0) + OBJECT_WEIGHT * whole) / (len(window) + OBJECT_WEIGHT)
        assert found[y, x] == pytest.approx(mean, rel=1e-6)  # float32 sums of nine


def test_only_pixels_that_few_samples_light_share_their_variances() -> None:
    """Against a loop over the pixels, with 2 of 64 samples lit in some and all in others."""
    random = np.random.default_rng(2)
    owner = random.integers(-1, 2, size=(6, 7))
    lit = random.choice([0, 2, 32, 64], size=(6, 7, 2))
    samples = random.uniform(0.9, 1.1, size=(6, 7, 2, 64)) * (np.arange(64) < lit[..., None])
    s0, variance = samples.mean(axis=-1), samples.var(axis=-1, ddof=1)[..., None] / 64
    found = pooled_where_rare(variance, s0, owner, samples=64)
    for y, x, band in np.ndindex(lit.shape):
        if owner[y, x] < 0 or lit[y, x, band] > 8:
            assert found[y, x, band] == variance[y, x, band]
            continue
        around = slice(max(y - 1, 0), y + 2), slice(max(x - 1, 0), x + 2)
        same = owner[around] == owner[y, x]
        expected = variance[around][same][:, band].mean()
        assert found[y, x, band] == pytest.approx(expected, rel=1e-12)  # sums of nine


@needs_arrays
def test_a_lamp_that_is_hardly_met_is_no_exact_darkness() -> None:
    """At the terminator of a wide lamp, behind a ball and in a ring's shadow few samples are lit.

    Their own errors were 0 in 3 % of these pixels, and a tenth of what they should be in others:
    squared residuals were 3.6, 10 and 2 times squared errors in the mean.
    """
    wide, behind = (Area(incidence_deg=i, half_angle_deg=h) for i, h in ((120, 60), (170, 20)))
    paints = PAINT, PAINT.model_copy(update={"eta": 1.6})
    striped = Patterned(pattern=Stripes(), surfaces=paints)
    beside = Surroundings(
        name="ball",
        objects=(Placed(shape=Sphere(), surface=PAINT, position=(1.2, 0.6, 0.8), scale=0.5),),
    )
    for scene in (
        scene_of(PAINT, wide, Sphere(), 32),
        scene_of(PAINT, behind, Sphere(), 32),
        scene_of(striped, wide, Sphere(), 32),
        scene_of(PAINT, wide, Sphere(), 32).model_copy(update={"surroundings": beside}),
    ):
        exact = render(scene, Sampling(samples=4096, seed=9, max_depth=2))
        mask, squares = exact.mask, []
        for seed in range(1, 5):
            truth = render(scene, Sampling(samples=64, seed=seed, max_depth=2))
            off = (truth.image - exact.image)[mask]
            errors = np.hypot(truth.standard_error, exact.standard_error)[mask][..., 0]
            certain = truth.standard_error[mask][..., 0] == 0
            # Some pixels are met by less than a hundredth of a sample, as those around them.
            assert (certain & (off != 0)).mean() < 0.01
            squares.append((off / np.maximum(errors, 1e-30))[~certain] ** 2)
        # Heavy tails: over seeds their mean spreads by 0.1.
        assert 0.7 < np.concatenate(squares).mean() < 1.4
