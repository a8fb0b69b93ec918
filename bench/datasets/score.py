"""Score methods, or images that were made elsewhere, on a stored dataset."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from malus.bench.datasets.convention_check import ConventionSums
from malus.bench.datasets.layouts import layout_predictions
from malus.bench.datasets.maps_and_frames import SENSOR, sensor_truth, well_lit
from malus.bench.datasets.picture_check import PictureCheck
from malus.bench.datasets.predictions import (
    PredictionErrors,
    Predictions,
    find_predictions,
    problems_of,
)
from malus.bench.running.output_folder import check_holds, prepare_folder
from malus.bench.running.progress import Progress, silent
from malus.bench.running.results import (
    Record,
    Results,
    describe,
    inapplicable,
    origin,
    record,
    table_of,
    write_results,
)
from malus.bench.scoring.extra_metrics import (
    GUESS,
    get_metrics,
    polarisation_error,
    with_guess,
)
from malus.bench.scoring.judge import Judge, Metric
from malus.bench.scoring.score import as_method
from malus.reconstruct import Components, Inapplicable, Method, get_method
from malus.reconstruct.methods import by_name, guarded
from malus.reconstruct.photos.sensor_stokes import demosaiced_stokes
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import FloatArray
from malus.scenes.core.errors import InputError, printable
from malus.scenes.core.registry import several
from malus.scenes.core.remote import as_path
from malus.scenes.core.versions import versions
from malus.scenes.sensor_frame import SensorFrame


def score_dataset(
    dataset: Dataset | Path | str,
    methods: Sequence[Method | str] = (),
    predictions: Predictions | Path | str | None = None,
    name: str = "predictions",
    progress: Progress = silent,
    *,
    metrics: Sequence[str] = (),
    layout: str | None = None,
    split: str | None = None,
    out: Path | str | None = None,
) -> Results:
    """Score methods, and images that were predicted elsewhere, on every scene of a dataset.

    Parameters
    ----------
    dataset : Dataset, or the path or URL of its folder
    methods : sequence of Method, or of their names
        `"sensor"` scores the raw frames of a dataset's polarisation camera, demosaiced and nothing
        else, in the camera's channels against the very light that it saw: what the sensor alone
        costs. It has errors of DoLP, AoLP, s1 and s2 too, over pixels with light for a hundredth
        of the full well in every channel.
    predictions : path or URL of a folder, optional
        One prediction a scene, as `malus.bench.datasets.predictions` describes. All of them are
        checked before anything is scored.
    name : str
        What the predictions are called in the column `method`.
    progress : function of (scenes done, scenes in all, label of the next)
    metrics : sequence of str
        Further metrics. With a profile, such as `profile:polarscale`, the trivial guess is scored
        too.
    layout : str, optional
        Layout of the predictions where it is a published project's: rgb2pol, polaranything or
        pol, as `malus.bench.datasets.layouts` describes.
    split : 'train', 'val' or 'test', optional
        Only the scenes of this split are scored, and no prediction of others is wanted.
    out : path or URL of a folder, optional
        Where the results are written; by default nowhere.

    Returns
    -------
    Results
        A table like that of a run. `run["predictions"]["suspicions"]` tells what looks as if the
        predictions counted angles otherwise, had another scale, or were of another picture.

    Raises
    ------
    PredictionErrors
        An InputError whose `problems` are those of all predictions.
    InputError
        Nothing to score, an unknown method or metric, a method's name for the predictions, a
        dataset that is damaged or has no scene or no such split, a folder that cannot be written
        or that holds something else.

    Examples
    --------
    >>> import tempfile
    >>> from malus.bench.datasets.render import render_dataset
    >>> folder = tempfile.mkdtemp()
    >>> done = render_dataset("quick", folder, resolution=8, samples=2)
    >>> results = score_dataset(folder, ["eq8"])
    >>> sorted(results.table.method.unique())
    ['eq8']
    """
    whole, opened = _opened(dataset, split)
    methods = (methods,) if isinstance(methods, Method) else several(methods)
    metrics = tuple(dict.fromkeys(several(metrics)))
    names = [method if isinstance(method, str) else method.name for method in methods]
    _check_request(opened, names, predictions is not None, name)
    by_name(
        (each.name, repr(each)) if isinstance(each, Method) else (get_method(each).name, each)
        for each in methods
        if each != SENSOR
    )
    own = {m.name: guarded(m) for m in methods if isinstance(m, Method)}
    asked = [each for each in dict.fromkeys(with_guess(names, metrics)) if each != SENSOR]
    chosen = [own.get(each) or get_method(each) for each in asked]
    measured = get_metrics(metrics)
    if out is not None:  # which is made only when the predictions are found to be whole
        check_holds(as_path(out), "scores")
    if predictions is not None and not isinstance(predictions, Predictions):
        predictions = _checked(whole, opened, as_path(predictions), layout, progress)
    folder = None if out is None else prepare_folder(as_path(out), "scores")
    sensor = SENSOR in names
    results = _score(opened, chosen, measured, predictions, name, progress, sensor)
    results.run["suite"]["metrics"] = list(metrics)
    results.run["scenes_missing"] = max(whole.record.planned - len(whole), 0)
    if opened.part_of is not None:
        (results.run["dataset"]["split"],) = opened.splits
    if folder is not None:
        write_results(folder, results)
    return results


def _check_request(dataset: Dataset, names: Sequence[str], predicted: bool, name: str) -> None:
    if not names and not predicted:
        expected, hint = "`methods` NAME or `predictions` DIR", "`malus list methods` shows methods"
        raise InputError("score", expected, "neither", hint)
    if name in (*names, GUESS):  # a profile scores the guess, asked for or not
        raise InputError("name", "another name than a method's", name, "choose another name")
    if SENSOR in names and dataset.scene(dataset.scenes[0]).sensor is None:
        hint = "add [sensor] to its suite and render it again, or leave this method out"
        raise InputError("method sensor", "a dataset with frames of a sensor", "none", hint)


def _opened(dataset: Dataset | Path | str, split: str | None) -> tuple[Dataset, Dataset]:
    """A dataset that has scenes, and the part of it that is asked for."""
    opened = dataset if isinstance(dataset, Dataset) else open_folder(as_path(dataset))
    opened.check_begun()
    return opened.whole, opened if split is None else opened.of_split(split)


def _checked(
    whole: Dataset, chosen: Dataset, folder: Path, layout: str | None, progress: Progress
) -> Predictions:
    """The predictions of the chosen scenes; raises one exception that lists all problems.

    The whole dataset tells which scenes a folder may have, and the number of each.
    """
    found: Predictions
    problems: list[InputError] = []
    if layout is None:
        found, problems = find_predictions(folder, whole)
    else:
        found = layout_predictions(whole, folder, layout)
    predictions = found.of(chosen.scenes)
    problems += problems_of(chosen, predictions, progress)
    if problems:
        raise PredictionErrors.of(folder, len(chosen), problems)
    return predictions


def _score(
    dataset: Dataset,
    methods: Sequence[Method],
    metrics: Sequence[Metric],
    predictions: Predictions | None,
    name: str,
    progress: Progress,
    sensor: bool,
) -> Results:
    started = time.perf_counter()
    tables: list[pd.DataFrame] = []
    sums, pictures, worst, unknown = ConventionSums(), PictureCheck(), 0.0, 0
    for done, scene_id in enumerate(dataset.scenes):
        progress(done, len(dataset), scene_id)
        truth = dataset.truth(scene_id)
        scored = list(methods)
        if predictions is not None:
            stokes = predictions.stokes(dataset.scene(scene_id))
            sums += ConventionSums.of(stokes, truth)
            pictures.add(stokes[..., 0], truth)
            scored.append(as_method(name, _components(stokes), truth))
        records = list(_records(truth, scored, metrics)) if scored else []
        if sensor:
            records.append(_sensor_record(truth, dataset.frame(scene_id), metrics))
        tables.append(table_of(records))
        worst = max(worst, truth.interpolation_error.get("rms", 0.0))
        unknown += truth.normal_spread is None
    names = [*(method.name for method in methods), *([SENSOR] if sensor else [])]
    run = _run_record(dataset, names, time.perf_counter() - started, worst)
    run["scenes_without_normal_spread"] = unknown
    if predictions is not None:
        run["suite"]["methods"] = [*names, name]
        run["predictions"] = {
            "name": name,
            "folder": str(predictions.folder),
            "sha256": predictions.sha256(),
            "suspicions": [*pictures.suspicions(), *sums.suspicions()],
        }
    return Results(pd.concat(tables, ignore_index=True), run)


def _components(stokes: FloatArray) -> Components:
    return Components(stokes[..., 0], stokes[..., 1], stokes[..., 2])


def _records(
    truth: Truth, methods: Sequence[Method], metrics: Sequence[Metric]
) -> Iterator[Record]:
    judge, about = Judge(truth), describe(truth.scene)
    for method in methods:
        try:
            yield record(about, method.name, judge.score(method, metrics).values())
        except Inapplicable as reason:
            yield inapplicable(about, method.name, str(reason))


def _sensor_record(truth: Truth, frame: SensorFrame, metrics: Sequence[Metric]) -> Record:
    """Scores of what a polarisation camera makes of a scene.

    Errors of DoLP, AoLP, s1 and s2 are those of well-lit pixels: in the dark they tell nothing.
    """
    ideal, stokes = sensor_truth(truth, frame), demosaiced_stokes(frame)
    values = list(
        Judge(ideal).score(as_method(SENSOR, _components(stokes), ideal), metrics).values()
    )
    lit = truth.mask & well_lit(ideal, frame)
    if lit.any():
        values += polarisation_error(replace(ideal, mask=lit))(stokes[lit])
    return record(describe(truth.scene), SENSOR, values)


def _run_record(
    dataset: Dataset, methods: list[str], seconds: float, interpolation_error: float
) -> dict[str, Any]:
    """Content of `run.json`: where the truths come from, and how they were scored."""
    record = dataset.record
    suite = dict(record.suite or {"name": printable(dataset.path.name)})
    return origin() | {
        "suite": suite | {"methods": methods},
        "dataset": {"folder": str(dataset.path), "sha256": dataset.sha256},
        # Nothing was rendered here: the renderer's version is that of the dataset.
        "versions": record.versions | versions("malus", "numpy", "scipy", "pandas"),
        "variant": record.variant,
        "seconds": {"total": round(seconds, 3)},
        "families": 0,
        "families_taken_over": 0,
        "scenes": len(dataset),
        "interpolation_rms": interpolation_error,
    }
