"""Standard errors of both lobes together, which share their samples."""

from __future__ import annotations

import numpy as np
import pytest

from malus.renderers.families.family import render_family
from malus.renderers.variant import choose
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
