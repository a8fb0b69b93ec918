"""Standard errors of gain, rotation, signal and skill, from the noise of the sums behind them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from malus.bench.scoring.field_agreement import Agreement
from malus.bench.scoring.metrics import LEAST_ERROR

TOTALS = np.array([-0.4, 0.2, 0.3, 2.0, 1.5])
DRAWS, COUNT = 20_000, 50


@pytest.mark.parametrize("name", ["gain", "rotation", "signal", "facing_skill"])
def test_errors_are_the_spread_of_the_values(name: str) -> None:
    """The sums vary together: of a ratio, what both have in common cancels or adds up."""
    random = np.random.default_rng(1)
    root = 0.01 * random.normal(size=(5, 5))
    covariance = root @ root.T
    drawn = TOTALS + random.normal(size=(DRAWS, 5)) @ root.T
    values = [getattr(Agreement(totals, covariance, COUNT), name)[0] for totals in drawn]
    told = getattr(Agreement(TOTALS, covariance, COUNT), name)[1]
    # A spread of 20000 is known to 0.5 %; what is not linear in noise of a hundredth adds 0.1 %.
    assert told == pytest.approx(np.std(values), rel=0.02)


@pytest.mark.parametrize("copies", [1, 1000])
@pytest.mark.parametrize("name", ["gain", "rotation", "facing_skill"])
def test_whether_light_is_rounding_does_not_depend_on_the_size_of_a_picture(
    name: str, copies: int
) -> None:
    """A picture many times side by side has the same light, and the same ratios."""
    for light, is_told in ((0.5 * LEAST_ERROR, False), (2.0 * LEAST_ERROR, True)):
        totals = light * COUNT * copies * np.array([-0.1, 0.1, 0.1, 1.0, 1.0])
        value, _ = getattr(Agreement(totals, np.zeros((5, 5)), COUNT * copies), name)
        assert math.isfinite(value) == is_told
