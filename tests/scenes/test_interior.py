"""Rooms drawn at random as radiance maps: their power, their lamps, and what is above."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from numpy.typing import NDArray

from malus.scenes import Interior
from malus.scenes.lights.environment import directions, radiance_map
from malus.scenes.lights.interior import HEIGHT, LEAST_LAMP_RADIUS_DEG, _lamps

SEEDS = range(8)


def solid_angle(values: NDArray[np.float32]) -> NDArray[np.float64]:
    """Solid angle of every pixel, from the sines of the rows' middles."""
    height, width = values.shape
    polar = (np.arange(height) + 0.5) * math.pi / height
    return np.repeat(np.sin(polar)[:, None], width, axis=1) * (math.pi / height) ** 2


@pytest.mark.parametrize("seed", SEEDS)
def test_the_power_is_that_of_uniform_light_of_its_radiance(seed: int) -> None:
    values = radiance_map(Interior(seed=seed, radiance=2.5)).astype(np.float64)
    # The midpoint rule in the polar angle is off by (π / 256)² / 24 ≈ 6e-6.
    power = (values * solid_angle(values)).sum()
    assert power == pytest.approx(4 * math.pi * 2.5, rel=2e-5)
    assert values.min() > 0


@pytest.mark.parametrize("seed", SEEDS)
def test_lamps_are_small_bright_and_overhead(seed: int) -> None:
    values = radiance_map(Interior(seed=seed))
    lamps = values > 40 * np.median(values)
    solid = solid_angle(values)[lamps].sum()
    # At least one lamp, and no more than four of 9° radius with a few bright windows.
    assert solid > 0.5 * math.pi * math.radians(LEAST_LAMP_RADIUS_DEG) ** 2
    assert solid < 0.1 * 4 * math.pi
    assert directions(*values.shape)[values == values.max()][:, 1].mean() > 0


@pytest.mark.parametrize("seed", range(40))
def test_lamps_have_the_sizes_and_levels_that_are_promised(seed: int) -> None:
    level = np.zeros((HEIGHT, 2 * HEIGHT))
    _lamps(random.Random(seed).random, level, directions(*level.shape))
    solid, lit = solid_angle(level), level[level > 0]
    # The edge of a disk of 2°, 2.8 pixels, is drawn to within a pixel's diagonal.
    assert solid[level > 0].sum() > 0.6 * math.pi * math.radians(LEAST_LAMP_RADIUS_DEG) ** 2
    assert solid[level > 0].sum() < 1.1 * 4 * math.pi * math.radians(9) ** 2
    assert 50 <= lit.min() <= lit.max() <= 1000


def test_a_room_is_upright_and_brighter_above_than_below() -> None:
    means = [radiance_map(Interior(seed=seed)) for seed in SEEDS]
    above = np.mean([values[:100].mean() for values in means])
    below = np.mean([values[156:].mean() for values in means])
    assert above > 2 * below
    # Straight up is the ceiling, of 0.5 at least, straight down the floor, of 0.5 at most; both
    # fade by a fifth there. No window is seen in either.
    assert all(np.median(values[:8]) > np.median(values[-8:]) for values in means)


def test_rooms_differ_by_their_seed_alone() -> None:
    assert not np.array_equal(radiance_map(Interior(seed=1)), radiance_map(Interior(seed=2)))
    assert Interior(seed=1, heading_deg=30).unturned == Interior(seed=1)
