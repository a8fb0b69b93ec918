"""One number of a results table, for what scores and for what only reads tables."""

from __future__ import annotations

from typing import NamedTuple


class MetricValue(NamedTuple):
    """One number of a results table; band and angle are None where it is over all of them."""

    metric: str
    value: float
    noise: float = 0.0
    band_nm: float | None = None
    angle_deg: float | None = None
