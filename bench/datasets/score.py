"""`malus score`: methods, or images that were made elsewhere, on a stored dataset."""

from __future__ import annotations

import platform
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from typing import Any

import pandas as pd

from malus.bench.datasets.convention_check import Fit
from malus.bench.datasets.predictions import Image, Predictions
from malus.bench.running.progress import Progress, silent
from malus.bench.running.results import (
    Record,
    Results,
    describe,
    inapplicable,
    record,
    table_of,
)
from malus.bench.scoring.judge import Judge
from malus.reconstruct import Components, Inapplicable, Method, Observation
from malus.renderers.datasets.dataset import Dataset
from malus.renderers.truth import Truth
from malus.scenes.core.errors import printable


def score_dataset(
    dataset: Dataset,
    methods: Sequence[Method],
    predictions: Predictions | None = None,
    label: str = "predictions",
    progress: Progress = silent,
) -> Results:
    """Scores of methods and predictions on every scene, as a table like that of a run.

    Raises
    ------
    InputError
        A damaged dataset or prediction.
    """
    started = time.perf_counter()
    parts: list[pd.DataFrame] = []
    fit, worst = Fit(), 0.0
    for done, scene_id in enumerate(dataset.scenes):
        progress(done, len(dataset), scene_id)
        truth = dataset.truth(scene_id)
        chosen = list(methods)
        if predictions is not None:
            stokes = predictions.stokes(dataset.scene(scene_id))
            fit += Fit.of(stokes, truth)
            chosen.append(_as_method(label, stokes, truth))
        parts.append(_scene_table(truth, chosen))
        worst = max(worst, truth.interpolation_error.get("rms", 0.0))
    names = [method.name for method in methods]
    run = _record(dataset, names, time.perf_counter() - started, worst)
    if predictions is not None:
        run["suite"]["methods"] = [*names, label]
        run["predictions"] = {
            "name": label,
            "folder": str(predictions.folder),
            "sha256": predictions.sha256(),
            "suspicions": list(fit.suspicions()),
        }
    return Results(pd.concat(parts, ignore_index=True), run)


def _as_method(label: str, stokes: Image, truth: Truth) -> Method:
    """A prediction in the form of a method, for the judge that scores methods.

    The judge also asks what a method makes of the picture with another draw of the noise. What a
    prediction would have made of it is unknown; its intensity at least is taken to follow the
    picture, as that of every method does, and its s1 and s2 to stay.
    """
    function = partial(_predicted, stokes=stokes, seen=truth.image)
    return Method(label, frozenset(), function, "images that were made elsewhere")


def _predicted(observation: Observation, stokes: Image, seen: Image) -> Components:
    intensity = stokes[..., 0] + (observation.image - seen)
    return Components(intensity, stokes[..., 1], stokes[..., 2])


def _scene_table(truth: Truth, methods: Sequence[Method]) -> pd.DataFrame:
    judge, about = Judge(truth), describe(truth.scene)
    records: list[Record] = []
    for method in methods:
        try:
            records.append(record(about, method.name, judge.score(method).values()))
        except Inapplicable as reason:
            records.append(inapplicable(about, method.name, str(reason)))
    return table_of(records)


def _record(
    dataset: Dataset, methods: list[str], seconds: float, interpolation_error: float
) -> dict[str, Any]:
    """The record of a run, with where its truths come from."""
    record = dataset.record
    suite = dict(record.suite or {"name": printable(dataset.path.name)})
    packages = ("malus", "numpy", "scipy", "pandas")
    return {
        "suite": suite | {"methods": methods},
        "dataset": {"folder": str(dataset.path), "sha256": dataset.sha256},
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": record.versions
        | {name: version(name) for name in packages}
        | {"python": platform.python_version()},
        "machine": {"system": platform.platform(), "processor": platform.machine()},
        "variant": record.variant,
        "seconds": {"total": round(seconds, 3)},
        "families": 0,
        "families_taken_over": 0,
        "scenes": len(dataset),
        "interpolation_rms": interpolation_error,
    }
