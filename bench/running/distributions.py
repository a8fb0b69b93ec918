"""How the values of a suite's scenes are distributed, as small histograms of text."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from malus.scenes.scene import Scene

BARS = "▁▂▃▄▅▆▇█"
BINS = 16
SHOWN = 8
"""Most values of a choice that are told."""

_ORDER = ("shape", "surface", "light", "camera", "surroundings", "around")
_SHORT = {"surroundings.objects": "around"}
_LEFT_OUT = ("digest", "found_in", "wavelengths_nm")


@dataclass(frozen=True)
class ValueDistribution:
    """How one key of the scenes is distributed.

    Attributes
    ----------
    key : str
        Such as `light.incidence_deg`; `around` stands for all objects of the surroundings.
    count : int
        Number of values; a scene has none, one or several.
    low, high : float or None
        Ends of the numbers; None for a key that has names.
    shown : str
        Histogram of numbers, or names and how often each occurs, the most frequent first.

    Examples
    --------
    >>> from malus.scenes import Dielectric, Scene, Sphere, Uniform
    >>> scenes = [Scene(shape=Sphere(), surface=Dielectric(eta=eta, alpha=0.3), light=Uniform())
    ...           for eta in (1.3, 1.4, 1.5)]
    >>> [(d.key, d.low, d.high) for d in value_distributions(scenes)]
    [('surface.eta', 1.3, 1.5)]
    """

    key: str
    count: int
    low: float | None
    high: float | None
    shown: str


def value_distributions(scenes: Iterable[Scene]) -> list[ValueDistribution]:
    """Distributions of all keys that differ between scenes."""
    values: defaultdict[str, list[Any]] = defaultdict(list)
    for scene in scenes:
        for key, value in _values(scene.model_dump(mode="json"), ""):
            values[key].append(value)
    result: list[ValueDistribution] = []
    for key, every in sorted(values.items(), key=lambda item: _place(item[0])):
        if len(set(every)) > 1:
            result += _distributions(key, every)
    return result


def _place(key: str) -> int:
    """Place of a key in the order of the axes; those of one axis stay in theirs."""
    axis = key.split(".", maxsplit=1)[0]
    return _ORDER.index(axis) if axis in _ORDER else len(_ORDER)


def _distributions(key: str, every: list[Any]) -> Iterator[ValueDistribution]:
    numbers = [value for value in every if isinstance(value, float)]
    names = [value for value in every if not isinstance(value, float)]
    if numbers:
        low, high = min(numbers), max(numbers)
        yield ValueDistribution(key, len(numbers), low, high, histogram(numbers))
    if len(set(names)) > 1 or (names and numbers):
        yield ValueDistribution(key, len(names), None, None, _counts(names))


def _values(content: Any, key: str) -> Iterator[tuple[str, Any]]:
    """Key and value of everything in a scene's content."""
    if isinstance(content, dict):
        for name, part in content.items():
            if name not in _LEFT_OUT:
                inner = f"{key}.{name}" if key else name
                yield from _values(part, _SHORT.get(inner, inner))
    elif isinstance(content, list):
        # Objects and parts of one kind together; the three numbers of a position apart.
        for place, part in enumerate(content):
            yield from _values(part, key if isinstance(part, dict) else f"{key}.{place}")
    elif isinstance(content, bool):
        yield key, str(content).lower()
    elif isinstance(content, int | float):
        yield key, float(content)
    elif isinstance(content, str):
        yield key, content.rsplit("/", 1)[-1]


def histogram(numbers: Iterable[float]) -> str:
    """A bar for each of equal parts of the numbers' range, or of its logarithm.

    The logarithm is taken where its middle is nearer to the median.

    Examples
    --------
    >>> histogram([0, 1, 1, 2, 2, 2])
    '▃       ▆      █'
    """
    values = np.array(list(numbers), dtype=np.float64)
    low, high = float(values.min()), float(values.max())
    if high <= low:
        return BARS[-1]
    middle = float(np.median(values))
    if low > 0 and abs(middle - math.sqrt(low * high)) < abs(middle - 0.5 * (low + high)):
        values, low, high = np.log(values), math.log(low), math.log(high)
    counts = np.histogram(values, BINS, (low, high))[0]
    heights = np.ceil(counts / counts.max() * len(BARS)).astype(int)
    return "".join(BARS[height - 1] if height else " " for height in heights)


def _counts(names: list[str]) -> str:
    counts = Counter(names).most_common()
    shown = ", ".join(f"{name} {count}" for name, count in counts[:SHOWN])
    return shown + (f", and {len(counts) - SHOWN} more" if len(counts) > SHOWN else "")
