"""Standard errors of gain, rotation, signal and skill, from the noise of the sums behind them."""

from __future__ import annotations

import numpy as np
import pytest

from malus.bench.scoring.field_agreement import Agreement

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
