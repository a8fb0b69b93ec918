"""Fit and score the captures of a suite, and write results like those of a run."""

from __future__ import annotations

import json
import math
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from malus.bench.running.capture_suite import CaptureEntry, CaptureSuite
from malus.bench.running.family_task import raise_what_stops
from malus.bench.running.output_folder import CAPTURES, prepare_folder
from malus.bench.running.parts import Failure
from malus.bench.running.progress import Progress, silent
from malus.bench.running.results import (
    Record,
    Results,
    inapplicable,
    origin,
    read_results,
    record,
    table_of,
    write_results,
)
from malus.bench.scoring.calibration import calibration_values
from malus.bench.scoring.capture_metrics import CapturedPixels
from malus.bench.scoring.metric_value import MetricValue
from malus.reconstruct import Components, Inapplicable, Method, Observation, get_method
from malus.reconstruct.image import joined_deviation
from malus.reconstruct.methods import TRIVIAL, by_name
from malus.reconstruct.photos.angle_convention import check_outlines
from malus.reconstruct.photos.capture import Capture
from malus.reconstruct.photos.capture_fit import CaptureFit, capture_summary, fit_capture
from malus.reconstruct.photos.capture_levels import dark_frames
from malus.reports.tables.rows import CAPTURED
from malus.reports.viewer.pack import BUDGET
from malus.scenes.core.arrays import BoolArray, Float32Array
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import replace_text, write_whole
from malus.scenes.core.model import content_id
from malus.scenes.core.named_file import digest_of
from malus.scenes.core.result_files import EXAMPLES

EXAMPLE_SIDE = 256
"""Pixels of the longer side of images kept for the page at most: every k-th one is kept."""
_CHARACTERS = 8
"""Of a page for the Stokes vector of one pixel and channel."""


def run_suite(suite: CaptureSuite, out: Path, progress: Progress = silent) -> Results:
    """Fit and score every capture by every method, and write the results to `out`.

    Raises
    ------
    InputError
        An unknown method, a folder that cannot be written or that holds something else, or not a
        single capture that can be scored.
    """
    started = time.perf_counter()
    by_name((get_method(reference).name, reference) for reference in suite.methods)
    methods = with_the_guess([get_method(reference) for reference in suite.methods])
    is_new = [each for each in (out, *out.parents) if not each.exists()]
    folder = prepare_folder(out, "captures")
    run = _Run(folder, methods, len(suite.capture))
    for number, entry in enumerate(suite.capture):
        progress(number, len(suite.capture), entry.called)
        run.score(entry)
    progress(len(suite.capture), len(suite.capture), "writing")
    if not run.records:
        first = run.failures[0] if run.failures else "nothing"
        expected, found = "a capture that can be scored", f"{len(run.failures)} that failed"
        with suppress(OSError):  # something else was written into one of them
            for each in is_new:
                each.rmdir()
        raise InputError(f"captures {suite.name}", expected, found, f"the first says: {first}")
    run.seconds["total"] = time.perf_counter() - started
    content = json.dumps(suite.model_dump(mode="json", exclude_defaults=True), indent=1) + "\n"
    if not (folder / CAPTURES).exists():  # marks a new folder; an older one tells of its results
        replace_text(folder / CAPTURES, content)
    write_results(folder, Results(table_of(run.records), run.about(suite)))
    replace_text(folder / CAPTURES, content)
    for path in (folder / EXAMPLES).glob("*.npz"):  # of captures that are no longer asked for
        if path.stem not in {about["scene"] for about in run.captures}:
            path.unlink()
    return read_results(folder)


def with_the_guess(methods: Sequence[Method]) -> list[Method]:
    """The methods, each once, after the guess that skill is measured against.

    Examples
    --------
    >>> [method.name for method in with_the_guess([get_method("eq8"), get_method("eq8")])]
    ['unpolarised', 'eq8']
    """
    return list({method.name: method for method in (TRIVIAL, *methods)}.values())


@dataclass
class _Run:
    """Results of the captures so far."""

    folder: Path
    methods: Sequence[Method]
    count: int
    records: list[Record] = field(default_factory=list)
    captures: list[dict[str, Any]] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))

    def score(self, entry: CaptureEntry) -> None:
        """Score one capture; what fails is named and left out."""
        with self._guard(entry.called), self._stage("read and fit"):
            photographed = Photographed.of(entry, self.count * (1 + len(self.methods)))
            for method in self.methods:
                with self._guard(f"{entry.called}, {method.name}"):
                    self._score_method(photographed, method)
            self.captures.append(photographed.about)
            content = photographed.example()
            path = self.folder / EXAMPLES / f"{photographed.about['scene']}.npz"
            write_whole(path, lambda temporary: np.savez_compressed(temporary, **content))

    def _score_method(self, photographed: Photographed, method: Method) -> None:
        columns = photographed.columns
        try:
            with self._stage("reconstruct"):
                image, objects = photographed.image, photographed.objects
                estimate = reconstruct(method, image, objects, photographed.wavelengths_nm)
        except Inapplicable as reason:
            self.records.append(inapplicable(columns, method.name, str(reason)))
            return
        with self._stage("score"):
            values = list(photographed.values(estimate))
        self.records.append(record(columns, method.name, values, estimate.note))
        step = photographed.step
        photographed.estimates[method.name] = estimate.stokes[::step, ::step].copy()

    def about(self, suite: CaptureSuite) -> dict[str, Any]:
        """Content of `run.json`."""
        names = [method.name for method in self.methods]
        return origin() | {
            "suite": {"name": suite.name, "description": suite.description, "methods": names},
            "captures": self.captures,
            "captures_failed": len(suite.capture) - len(self.captures),
            "failures": self.failures,
            "seconds": {name: round(value, 3) for name, value in self.seconds.items()},
        }

    @contextmanager
    def _guard(self, name: str) -> Iterator[None]:
        """Record an exception in one line, and go on, unless it means that all has to stop."""
        try:
            yield
        except Exception as error:
            raise_what_stops(error)
            self.failures.append(f"{name}: {Failure.of(error).reason}")

    @contextmanager
    def _stage(self, name: str) -> Iterator[None]:
        started, inside = time.perf_counter(), sum(self.seconds.values())
        try:
            yield
        finally:
            nested = sum(self.seconds.values()) - inside
            self.seconds[name] += time.perf_counter() - started - nested


@dataclass(frozen=True)
class Estimate:
    """Stokes image (height, width, channels, 3) of a method.

    `refused` are numbers of objects, from 1, that it left unpolarised; `note` says why.
    `deviation` (height, width, channels) is what it states of its own error, if it does.
    """

    stokes: Float32Array
    refused: tuple[int, ...]
    note: str
    invalid: int
    converged: bool | None
    deviation: Float32Array | None = None


def reconstruct(
    method: Method,
    image: Float32Array,
    objects: Sequence[BoolArray],
    wavelengths_nm: tuple[float, ...] | None = None,
) -> Estimate:
    """Let a method see the picture (height, width, channels), one object after the other.

    Objects on which it cannot work stay unpolarised, as what is around them does, and are noted.
    Three channels without wavelengths are red, green and blue.

    Raises
    ------
    Inapplicable
        If it can work on none, or asks for more than the picture and a mask.

    Examples
    --------
    >>> image, left = np.ones((1, 2, 1), np.float32), np.array([[True, False]])
    >>> estimate = reconstruct(TRIVIAL, image, [left])
    >>> estimate.stokes[0, 0, 0].tolist(), estimate.note
    ([1.0, 0.0, 0.0], '')
    """
    if method.needs:
        listed = ", ".join(sorted(method.needs))
        raise Inapplicable(f"needs {listed}, which a photograph does not tell")
    stokes = np.zeros((*image.shape, 3), dtype=np.float32)
    stokes[..., 0] = image
    reasons: dict[int, str] = {}
    parts: list[tuple[BoolArray, Components]] = []
    for number, mask in enumerate(objects, start=1):
        try:
            components = method.reconstruct(Observation(image, mask, wavelengths_nm=wavelengths_nm))
        except Inapplicable as reason:
            reasons[number] = str(reason) if len(objects) == 1 else f"object {number}: {reason}"
            continue
        stokes[mask] = components.stokes[mask]
        parts.append((mask, components))
    if len(reasons) == len(objects):
        raise Inapplicable("; ".join(reasons.values()))
    told = [found.converged for _, found in parts if found.converged is not None]
    note = f"left unpolarised: {'; '.join(reasons.values())}" if reasons else ""
    is_converged = all(told) if told else None
    invalid = sum(found.invalid(mask) for mask, found in parts)
    deviation = joined_deviation(image, np.any(objects, axis=0), parts)
    return Estimate(stokes, tuple(reasons), note, invalid, is_converged, deviation)


@dataclass
class Photographed:
    """A capture that is read and fitted, with the masks of its objects and the estimates so far.

    Of `estimates`, the Stokes images of methods, every `step`-th row and column is kept. Bands of a
    spectrum have `wavelengths_nm`; other channels have none.
    """

    fit: CaptureFit
    image: Float32Array
    objects: tuple[BoolArray, ...]
    scored: BoolArray
    pixels: CapturedPixels
    about: dict[str, Any]
    step: int
    wavelengths_nm: tuple[float, ...] | None = None
    estimates: dict[str, Float32Array] = field(default_factory=dict)

    @classmethod
    def of(cls, entry: CaptureEntry, images: int) -> Photographed:
        """Read and fit a capture; `images` of it and the others share a page.

        Raises
        ------
        InputError
            Where it or its masks cannot be read, or all of its object is clipped.
        """
        capture = entry.read()
        fit = fit_capture(capture)
        objects = entry.objects(capture.clipped.shape)
        scored = np.any(objects, axis=0) & ~capture.clipped
        image = np.maximum(fit.stokes[..., 0], 0)
        if not image[scored].any():
            hint = "mask what is lit and not clipped"
            raise InputError(entry.folder, "a lit pixel of the object", "none", hint)
        about = {
            "name": entry.called,
            "group": entry.group,
            "folder": entry.folder,
            "scene": scene_id(entry, capture),
            "objects": [int((mask & scored).sum()) for mask in objects],
            "fit": capture_summary(capture, fit),
            "convention": check_outlines(fit, objects, ~capture.clipped).doubt,
        }
        pixels = CapturedPixels.of(capture, fit, scored)
        step = _step(scored, image.shape[2] * images)
        return cls(fit, image, objects, scored, pixels, about, step, capture.wavelengths_nm)

    @property
    def columns(self) -> dict[str, Any]:
        """Columns of the results table that say what was captured: its index is not known."""
        name = self.about["name"]
        return {
            "scene": self.about["scene"],
            "shape": name,
            "material": "unknown",
            "eta": math.nan,
            "surface": name,
            "alpha": math.nan,
            "body": CAPTURED,
            "light": self.about["group"],
            "incidence_deg": None,
        }

    def values(self, estimate: Estimate) -> Iterator[MetricValue]:
        """Rows of the table: over all objects, and NMSE and skill of each of several."""
        estimated = estimate.stokes[self.scored].astype(np.float64) / self.pixels.peak
        yield from self.pixels.values(estimated)
        yield MetricValue("invalid", float(estimate.invalid))
        yield from self._calibration(estimate)
        if estimate.converged is not None:
            yield MetricValue("converged", float(estimate.converged))
        for number, mask in enumerate(self.objects if len(self.objects) > 1 else (), start=1):
            chosen = mask[self.scored]
            if chosen.any() and number not in estimate.refused:
                nmse, skill = self.pixels.part(chosen).errors(estimated[chosen])
                yield MetricValue(f"nmse_object_{number}", nmse)
                yield MetricValue(f"skill_object_{number}", skill)

    def _calibration(self, estimate: Estimate) -> Iterator[MetricValue]:
        """Stated against actual errors, with the pictures' noise in them."""
        told = [mask for n, mask in enumerate(self.objects, 1) if n not in estimate.refused]
        chosen = np.any(told, axis=0) & self.scored if told else self.scored
        if estimate.deviation is not None and chosen.any():
            fields = [np.moveaxis(s[chosen], -1, 0) for s in (self.fit.stokes, estimate.stokes)]
            (image, *true), (_, *estimated) = fields
            deviation = estimate.deviation[chosen]
            yield from calibration_values(image, np.stack(true), np.stack(estimated), deviation)

    def example(self) -> dict[str, Any]:
        """Arrays of the file for the viewer: every `step`-th row and column."""
        meta: dict[str, Any] = {
            "scene": self.about["scene"],
            "label": f"{self.about['name']}, {self.about['group']}",
            "step": self.step,
        }
        if self.wavelengths_nm is None:
            meta["channels"] = list(self.pixels.channels)
        else:
            meta["wavelengths_nm"] = list(self.wavelengths_nm)
        content: dict[str, Any] = {
            "truth": self.fit.stokes[:: self.step, :: self.step],
            "mask": self.scored[:: self.step, :: self.step],
            "meta": np.array(json.dumps(meta)),
        }
        return content | {f"method.{name}": stokes for name, stokes in self.estimates.items()}


def _step(scored: BoolArray, planes: int) -> int:
    """Every how many rows and columns of a mask so many planes of all captures fit one page."""
    pixels = 0.9 * BUDGET / _CHARACTERS / planes
    fitting = math.ceil(math.sqrt(np.count_nonzero(scored) / pixels))
    return max(1, fitting, -(-max(scored.shape) // EXAMPLE_SIDE))


def scene_id(entry: CaptureEntry, capture: Capture) -> str:
    """Hash of the files of a capture, its dark frames and masks, and how they are read."""
    folder = Path(entry.folder)
    files = [folder] if folder.is_file() else [folder / name for name in capture.names]
    if not any(file.is_file() for file in files):  # a scene of an export, in folders of its bands
        files = sorted([folder / "truth.npz", *folder.glob("*nm/*")])
    files += [Path(file) for file in (entry.mask, entry.labels) if file is not None]
    dark = dark_frames(entry.black)
    digests = [digest_of(file, "picture") for file in (*files, *dark) if file.is_file()]
    apart = {"folder", "mask", "labels", "name", "group"} | ({"black"} if dark else set())
    told = entry.model_dump(mode="json", exclude=apart)
    angles = [round(angle, 6) for angle in capture.angles_deg]
    return content_id([entry.called, digests, told, angles])
