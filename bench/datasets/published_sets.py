"""Published test sets as truths: real pictures in the layouts of networks, without a renderer.

- `pol`: intensities behind a polariser at four angles, the whole truth; `mask/NAME.png` where it
  has one.
- `rgb2pol`: `NAME/s0.png`, `s1.png`, `s2.png`. Their codes are scaled picture by picture, and
  nobody wrote down from what to what: `component_range` has to say what the smallest and the
  largest code of s1 and s2 stand for, in units of the largest code of s0.

Methods see the unpolarised image and the mask, nothing else. No noise is known.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from malus.bench.datasets.layouts import LAYOUTS, Layout, check_is_here
from malus.bench.running.captures import reconstruct, with_the_guess
from malus.bench.running.output_folder import check_holds, prepare_folder
from malus.bench.running.progress import Progress, silent
from malus.bench.running.results import (
    Record,
    Results,
    inapplicable,
    origin,
    record,
    table_of,
    write_results,
)
from malus.bench.scoring.capture_metrics import CapturedPixels
from malus.bench.scoring.metric_value import MetricValue
from malus.bench.scoring.metrics import brightest
from malus.bench.scoring.profiles import PROFILES
from malus.reconstruct import Inapplicable, Method, get_method
from malus.reconstruct.methods import by_name
from malus.reconstruct.photos.masks_and_normals import read_mask
from malus.reconstruct.photos.read_picture import read_picture
from malus.reports.tables.rows import CAPTURED
from malus.scenes.colour import GREY, RGB
from malus.scenes.core.arrays import BoolArray, Float64Array, FloatArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.registry import lookup, several
from malus.scenes.core.remote import as_path

READABLE = ("pol", "rgb2pol")
"""Layouts that hold a picture and its polarisation; degree and angle alone are no truth."""

MOST_BEYOND = 0.5
"""Share of values that noise may polarise beyond all light; more of them are read wrongly."""


@dataclass(frozen=True)
class PublishedTruth:
    """A real picture with its polarisation, in the form of a truth without noise."""

    name: str
    stokes: FloatArray
    mask: BoolArray

    @property
    def image(self) -> FloatArray:
        """Unpolarised image (height, width, channels)."""
        return self.stokes[..., 0]

    @property
    def specular_noise(self) -> FloatArray:
        """No noise is known."""
        return np.zeros_like(self.stokes)

    diffuse_noise = specular_noise

    @property
    def columns(self) -> dict[str, Any]:
        """Columns of the results table that say what was pictured."""
        return {
            "scene": self.name, "shape": self.name, "material": "unknown", "eta": math.nan,
            "surface": self.name, "alpha": math.nan, "body": CAPTURED, "light": "test set",
            "incidence_deg": None,
        }  # fmt: skip


_PROFILE = "the name of a profile, as of a test set"


def score_published(
    truth: Path | str,
    layout: str,
    *,
    methods: Sequence[str] = (),
    predictions: Path | str | None = None,
    metrics: Sequence[str] = (),
    component_range: tuple[float, float] | None = None,
    name: str = "predictions",
    progress: Progress = silent,
    out: Path | str | None = None,
) -> Results:
    """Score predictions, and methods that see a picture alone, on a published test set.

    Parameters
    ----------
    truth : path of the test set's folder
    layout : 'pol' or 'rgb2pol', of the test set and of the predictions
    methods : names of methods
    predictions : path of a folder of the same names, optional
    metrics : names of profiles, such as `profile:polarscale`
    component_range : (smallest, largest), of `rgb2pol`
        What the smallest and largest code of s1 and s2 stand for; 1 is the largest code of s0.
    name : what the predictions are called
    progress : function of (pictures done, pictures in all, name of the next)
    out : path or URL of a folder, optional

    Returns
    -------
    Results
        A row a picture, method and metric. The guess I(ϑ) = I/2 is always among the methods.

    Raises
    ------
    InputError
        Another layout, a range that is none or polarises beyond all light, a folder without its
        files or one that cannot be read, sizes that differ, an unknown method or metric.

    Examples
    --------
    >>> import tempfile
    >>> from malus.bench.datasets.export import export
    >>> from malus.bench.datasets.render import render_dataset
    >>> folder = Path(tempfile.mkdtemp())
    >>> done = render_dataset("quick", folder / "dataset", resolution=8, samples=2)
    >>> export(folder / "dataset", "pol", folder / "set")
    16
    >>> results = score_published(folder / "set", "pol", predictions=folder / "set")
    >>> sorted(set(results.table.method))
    ['predictions', 'unpolarised']
    """
    if out is not None:
        check_holds(as_path(out), "scores")
    folder = as_path(truth)
    for each in (truth, truth if predictions is None else predictions):
        check_is_here(as_path(each))
    chosen = _layout(layout, component_range)
    names = _names(folder, chosen, layout)
    methods, metrics = several(methods), several(metrics)
    by_name((get_method(each).name, each) for each in methods)
    asked = with_the_guess([get_method(each) for each in methods])
    if predictions is not None and name in {method.name for method in asked}:
        raise InputError("name", "another name than a method's", name, "choose another name")
    profiles = [lookup(each, PROFILES, "metric", _PROFILE) for each in dict.fromkeys(metrics)]
    started = time.perf_counter()
    records: list[Record] = []
    for done, called in enumerate(names):
        progress(done, len(names), called)
        pictured = _truth(folder, layout, called, component_range)
        scorer = _Scorer(pictured, [profile(pictured) for profile in profiles])
        records += [scorer.of_method(method) for method in asked]
        if predictions is not None:
            predicted = _predicted(as_path(predictions), chosen, component_range, pictured)
            records.append(scorer.of_stokes(name, predicted))
    listed = [method.name for method in asked] + ([name] if predictions is not None else [])
    results = Results(table_of(records), _about(folder, listed, metrics, layout, started))
    if out is not None:
        write_results(prepare_folder(as_path(out), "scores"), results)
    return results


def _about(
    folder: Path, methods: Sequence[str], metrics: Sequence[str], layout: str, started: float
) -> dict[str, Any]:
    suite = {"name": folder.name, "methods": list(methods), "metrics": list(metrics)}
    seconds = {"total": round(time.perf_counter() - started, 3)}
    about = {"suite": suite, "published": {"folder": str(folder), "layout": layout}}
    return origin() | about | {"seconds": seconds}


@dataclass(frozen=True)
class _Scorer:
    """Scores of several methods on one picture."""

    truth: PublishedTruth
    profiles: Sequence[Any]

    def of_method(self, method: Method) -> Record:
        """Score of a method that sees the picture and the mask."""
        try:
            image = self.truth.image.astype(np.float32)
            estimate = reconstruct(method, image, (self.truth.mask,))
        except Inapplicable as reason:
            return inapplicable(self.truth.columns, method.name, str(reason))
        return self.of_stokes(method.name, estimate.stokes)

    def of_stokes(self, name: str, stokes: FloatArray) -> Record:
        """Score of a Stokes image (height, width, channels, 3)."""
        estimated = stokes[self.truth.mask].astype(np.float64)  # rounded no more than the truth is
        return record(self.truth.columns, name, self._values(estimated))

    def _values(self, estimated: FloatArray) -> Iterator[MetricValue]:
        true = self.truth.stokes[self.truth.mask].astype(np.float64)
        peak = brightest(true[..., 0])
        bands = true.shape[1]
        none, channels = np.zeros(true.shape[:2]), RGB if bands == 3 else GREY
        pixels = CapturedPixels(true / peak, peak, none, np.zeros((3, 3)), channels)
        yield from pixels.values(estimated / peak)
        for profile in self.profiles:
            yield from profile(estimated)


def _layout(layout: str, component_range: tuple[float, float] | None) -> Layout:
    if layout not in READABLE:
        hint = "a truth needs the picture too; convert it to one of these"
        raise InputError("layout", f"one of {', '.join(READABLE)}", layout, hint)
    if (layout == "rgb2pol") != (component_range is not None):
        expected = "what the codes of s1 and s2 stand for, for rgb2pol and no other layout"
        found = "nothing" if component_range is None else "one"
        raise InputError("component_range", expected, found, "such as -1 1")
    if (
        component_range is not None
        and not -math.inf < component_range[0] < component_range[1] < math.inf
    ):
        expected, found = "a smaller and a larger number", "{:g} {:g}".format(*component_range)
        raise InputError("component_range", expected, found, "such as -1 1")
    return LAYOUTS[layout]


def _names(folder: Path, layout: Layout, called: str) -> list[str]:
    """Names of the pictures of a set, in order."""
    first = layout.files[0]
    before, after = first.split("{name}")
    found = sorted(folder.glob(f"{before}*{after}"))
    names = [str(path.relative_to(folder))[len(before) : -len(after)] for path in found]
    if not names:
        where, hint = str(folder), f"`layout` {called} has such files"
        raise InputError(where, first.format(name="NAME"), "none", hint)
    return names


def _light(path: Path) -> Float64Array:
    """Codes over the largest one (height, width, channels)."""
    return np.asarray(read_picture(path, linear=True).linear, dtype=np.float64)


def _truth(
    folder: Path, layout: str, name: str, component_range: tuple[float, float] | None
) -> PublishedTruth:
    if component_range is not None:
        low, high = component_range
        s0, s1, s2 = (_light(folder / name / f"s{k}.png") for k in range(3))
        _check_sizes(folder / name, [s0, s1, s2])
        parts = (s0, low + s1 * (high - low), low + s2 * (high - low))
    else:
        paths = [folder / pattern.format(name=name) for pattern in LAYOUTS[layout].files]
        i0, i45, i90, i135 = pictures = [_light(path) for path in paths]
        _check_sizes(paths[0], pictures)
        parts = ((i0 + i45 + i90 + i135) / 2.0, i0 - i90, i45 - i135)
    stokes = np.stack(parts, axis=-1).astype(np.float32)  # as methods see it: the guess is exact
    path = folder / "mask" / f"{name}.png"
    shape = stokes.shape[0], stokes.shape[1]
    mask = read_mask(path, shape) if path.is_file() else np.ones(shape, dtype=bool)
    beyond = np.mean(np.hypot(*np.moveaxis(stokes[mask], -1, 0)[1:]) > stokes[mask][..., 0])
    if beyond > MOST_BEYOND:
        expected, found = "light polarised by at most all of it", f"more in {beyond:.0%} of values"
        raise InputError(str(folder / name), expected, found, "check `layout` or `component_range`")
    return PublishedTruth(name, stokes, mask)


def _predicted(
    folder: Path,
    layout: Layout,
    component_range: tuple[float, float] | None,
    truth: PublishedTruth,
) -> FloatArray:
    """The predicted Stokes image of a picture; codes mean what those of the test set do."""
    paths = [folder / pattern.format(name=truth.name) for pattern in layout.files]
    for path in paths:
        if not path.is_file():
            hint = "predict every picture of the test set"
            raise InputError(str(folder), str(path.relative_to(folder)), "none", hint)
    pictures = [_light(path) for path in paths]
    _check_sizes(paths[0], [truth.image, *pictures])
    if component_range is None:
        return layout.decode(pictures, truth)
    low, high = component_range
    return np.stack([truth.image, *(low + codes * (high - low) for codes in pictures)], axis=-1)


def _check_sizes(where: Path, pictures: Sequence[FloatArray]) -> None:
    shapes = {picture.shape for picture in pictures}
    if len(shapes) > 1:
        found = " and ".join(sorted("×".join(map(str, shape)) for shape in shapes))
        raise InputError(str(where), "pictures of one size", found, "convert them alike")
