"""Benchmark of reconstruction: pixels a second, beside copying the same bytes."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from malus.bench.studies.study import Findings
from malus.bench.studies.timing import Seconds, timed
from malus.reconstruct import Components, Observation, get_method
from malus.scenes import Distant
from malus.scenes.core.arrays import AnyArray

METHODS = ("eq8", "eq8+body", "shadowed+body", "half_vector+body")
BANDS_NM = (450.0, 550.0, 650.0)
ETAS = (1.525, 1.519, 1.514)  # BK7: every band has tables of its own


@dataclass(frozen=True)
class ReconstructSpeed:
    """Time and memory of one method on one image; seconds are medians.

    `memory_ratio` is the largest memory held during a run, inputs included, over the bytes of
    inputs and outputs.
    """

    method: str
    megapixels: float
    seconds: float
    cpu_seconds: float
    copy_seconds: float
    copy_cpu_seconds: float
    memory_ratio: float

    @property
    def pixels_a_second(self) -> float:
        """Pixels a second by the clock."""
        return self.megapixels * 1e6 / self.seconds

    @property
    def times_copy(self) -> float:
        """Seconds by the clock, over those of copying everything that is read and written."""
        return self.seconds / self.copy_seconds


def findings(folder: Path | None, megapixels: float, repeats: int) -> Findings:
    """Run the benchmark on an image of so many megapixels."""
    speeds = measure(megapixels, repeats)
    figures = [
        asdict(speed) | {"pixels_a_second": speed.pixels_a_second, "times_copy": speed.times_copy}
        for speed in speeds
    ]
    return Findings(tuple(report_lines(speeds)), figures)


def photograph(megapixels: float) -> Observation:
    """A sphere that fills a square float32 RGB image, with random intensities."""
    side = max(2, round((megapixels * 1e6) ** 0.5))
    axis = np.linspace(-0.7, 0.7, side, dtype=np.float32)
    x, y = axis[None, :], -axis[:, None]
    normals = np.empty((side, side, 3), np.float32)
    normals[..., 0], normals[..., 1] = x, y
    normals[..., 2] = np.sqrt(1.0 - np.minimum(x * x + y * y, 1.0))
    random = np.random.default_rng(0)
    specular, diffuse = (random.random((side, side, 3), dtype=np.float32) for _ in range(2))
    return Observation(
        image=specular + diffuse,
        mask=np.ones((side, side), dtype=bool),
        wavelengths_nm=BANDS_NM,
        specular=specular,
        diffuse=diffuse,
        normals=normals,
        eta=np.array(ETAS),
        alpha=0.3,
        light=Distant(incidence_deg=60),
    )


def _read(observation: Observation) -> list[AnyArray]:
    """Arrays that a reconstruction reads; it writes as many bytes: three images and a mask."""
    names = ("specular", "diffuse", "normals", "mask")
    return [getattr(observation, name) for name in names]


def _copy(observation: Observation) -> list[AnyArray]:
    return [values.copy() for values in _read(observation)]


def _memory_ratio(work: Callable[[], Components], read: list[AnyArray]) -> float:
    """Largest memory during the work, inputs included, over that of inputs and outputs."""
    inputs = sum(values.nbytes for values in read)
    tracemalloc.start()
    try:
        result = work()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    written = [result.image, result.s1, result.s2, result.valid]
    outputs = sum(values.nbytes for values in written if values is not None)
    return float((inputs + peak) / (inputs + outputs))


def measure(megapixels: float, repeats: int) -> list[ReconstructSpeed]:
    """Time every method and copying in turns, so that a busy machine slows all of them alike."""
    observation = photograph(megapixels)
    works: dict[str, Callable[[], Any]] = {
        name: lambda name=name: get_method(name).reconstruct(observation)  # type: ignore[misc]
        for name in METHODS
    }
    works["copy"] = lambda: _copy(observation)
    seconds: dict[str, list[Seconds]] = {name: [] for name in works}
    for turn in range(repeats + 1):
        for name, work in works.items():
            duration = timed(work)
            if turn:  # the first one builds the tables
                seconds[name].append(duration)
    median = {name: np.median(durations, axis=0) for name, durations in seconds.items()}
    pixels = observation.mask.size / 1e6
    return [
        ReconstructSpeed(
            name,
            pixels,
            float(median[name][0]),
            float(median[name][1]),
            float(median["copy"][0]),
            float(median["copy"][1]),
            _memory_ratio(works[name], _read(observation)),
        )
        for name in METHODS
    ]


def report_lines(speeds: list[ReconstructSpeed]) -> list[str]:
    """One line a method, for people."""
    first = speeds[0]
    lines = [
        f"{first.megapixels:.3g} megapixels, RGB, float32; copying what is read and written: "
        f"{first.copy_seconds * 1e3:.1f} ms ({first.copy_cpu_seconds * 1e3:.1f} ms of processor)"
    ]
    lines += [
        f"  {speed.method}: {speed.pixels_a_second / 1e6:.1f} Mpixel/s, "
        f"{speed.seconds * 1e3:.1f} ms ({speed.cpu_seconds * 1e3:.1f} ms of processor), "
        f"{speed.times_copy:.1f}x copying, "
        f"memory {speed.memory_ratio:.2f}x inputs plus outputs"
        for speed in speeds
    ]
    return lines
