"""Standard errors and noise of light that is traced along paths, s3 among it."""

from __future__ import annotations

import numpy as np
import pytest
from plain import GOLD, LAMP, RING, scene_of
from rooms import needs_arrays

from malus.renderers import render
from malus.renderers.truth import Truth
from malus.scenes import (
    Area,
    Conductor,
    Dielectric,
    Placed,
    Polariser,
    Sampling,
    Scene,
    Sphere,
    Surroundings,
)

SEEDS = 16
WIDE = Area(incidence_deg=50, half_angle_deg=40, polarised=Polariser(angle_deg=30))
GOLDEN = Conductor(**GOLD, alpha=0.4)
BESIDE = Placed(shape=Sphere(), surface=GOLDEN, position=(1.2, 0.6, 0.8), scale=0.5)
SCENES = {
    "polarised light that bounces in gold": (scene_of(GOLDEN, WIDE, RING), 3),
    "light that bounces in plastic": (
        scene_of(Dielectric(eta=1.5, alpha=0.3, albedo=0.9, body="polarised"), LAMP, RING),
        4,
    ),
    "polarised light on gold": (scene_of(GOLDEN, WIDE, Sphere()), 2),
    "polarised light between gold": (
        scene_of(GOLDEN, WIDE, Sphere()).model_copy(
            update={"surroundings": Surroundings(name="ball", objects=(BESIDE,))}
        ),
        3,
    ),
}


def squares(truths: list[Truth], value: str, error: str, noise: str) -> np.ndarray:
    """Sums of squares over the pixels: of the spread over seeds, stated errors, and noise."""

    def of(name: str) -> np.ndarray:
        found = [sum(getattr(truth, part) for part in name.split()) for truth in truths]
        return np.stack([image[truths[0].mask] for image in found]).astype(float)

    spread = of(value).var(axis=0, ddof=1).sum(axis=(0, 1))
    return np.stack(
        [spread, *((of(name) ** 2).mean(axis=0).sum(axis=(0, 1)) for name in (error, noise))]
    )


@needs_arrays
@pytest.mark.parametrize("name", SCENES)
def test_spread_errors_and_noise_are_the_same(name: str) -> None:
    """Over seeds, what is rendered spreads as far as each render says, and as its halves differ."""
    scene, depth = SCENES[name]
    assert isinstance(scene, Scene)
    truths = [
        render(scene, Sampling(samples=64, max_depth=depth, seed=seed)) for seed in range(SEEDS)
    ]
    found = squares(truths, "specular diffuse", "standard_error", "specular_noise diffuse_noise")
    if truths[0].s3 is not None:
        of_s3 = squares(truths, "s3", "s3_standard_error", "s3_noise")
        found = np.concatenate([found, of_s3[:, None]], axis=-1)
    # Sixteen seeds of some hundred pixels, of which a few have most of the noise: ratios scatter by
    # up to a third. The logarithm of 2, of twice a variance, is 0.7; of noise not halved it is 1.4.
    assert np.abs(np.log(found[1:] / found[0])).max() < 0.5
