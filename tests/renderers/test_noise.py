"""Standard errors of both lobes together, which share their samples."""

from __future__ import annotations

import numpy as np
import pytest

from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.lobe_samples import HALVES
from malus.renderers.mitsuba.rays import stream_number, streams
from malus.renderers.mitsuba.stokes_integrator import BATCHES
from malus.renderers.variant import Variant, choose, mitsuba
from malus.scenes import Camera, Dielectric, Distant, Sampling, Scene, Sphere


@pytest.mark.skipif(not choose().vectorised, reason="without LLVM or CUDA lobes share no samples")
def test_noise_that_both_lobes_share_is_in_the_standard_error() -> None:
    """A sample nearer to the lamp has more of both: half of the variance is their covariance."""
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.6, albedo=0.05, body="unpolarised"),
        light=Distant(incidence_deg=30),
        camera=Camera(resolution=6),
    )
    truths = [render_family([scene], Sampling(samples=64, seed=k)).truth(scene) for k in range(64)]
    mask = truths[0].mask
    images = np.stack([truth.image[mask] for truth in truths]).astype(np.float64)
    told = np.stack([truth.standard_error[mask][..., 0] for truth in truths]).astype(np.float64)
    ratio = images.var(axis=0, ddof=1).sum() / np.square(told).mean(axis=0).sum()
    assert mask.sum() == 16
    # Variances of 16 pixels over 64 seeds: their mean is known to 4.5 %. Five of those.
    assert abs(ratio - 1) < 0.22


def test_renders_of_one_lobe_and_of_the_other_have_seeds_of_their_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where lobes are rendered apart, without LLVM, their covariance is told as zero."""
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.6, albedo=0.5, body="unpolarised"),
        light=Distant(incidence_deg=30),
        camera=Camera(resolution=6),
    )
    scalar = Variant("scalar_spectral_polarized", "asked for")
    mi, seeds = mitsuba(scalar), list[int]()
    plain = mi.render

    def render(*parts: object, spp: int, seed: int) -> object:
        seeds.extend([seed] * (spp == 2))  # a batch of one lobe; others have other samples
        return plain(*parts, spp=spp, seed=seed)

    monkeypatch.setattr(mi, "render", render)
    for seed in (1, 2):
        render_family([scene], Sampling(samples=16, seed=seed), scalar)
    # Nor do renders of another seed share any: their truths would hardly differ.
    assert len(seeds) == 4 * BATCHES
    assert len(set(seeds)) == len(seeds)


@pytest.mark.skipif(not choose().vectorised, reason="random numbers of arrays of rays")
def test_rays_and_light_have_random_numbers_of_their_own() -> None:
    """And so has every pixel and half: else where a ray falls would decide where light comes from.

    Correlations of 4096 pairs of independent numbers spread by 1/64; five of these.
    """
    mi = mitsuba(choose())
    pixel, seed = np.arange(4096, dtype=np.uint32), mi.UInt32(1)
    drawn = []
    for half in range(HALVES):
        for stream in streams(mi, stream_number(mi.UInt32(pixel), mi.UInt32(half)), seed):
            drawn += [np.array(stream.next_float32()) for _ in range(4)]
    correlation = np.corrcoef(drawn) - np.eye(len(drawn))
    assert np.abs(correlation).max() < 5 / 64
