"""`malus score`: methods, or images that were made elsewhere, on a stored dataset."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from malus.bench.commands.results_table import final_table
from malus.bench.datasets.predictions import Predictions, check_predictions
from malus.bench.datasets.score import score_dataset
from malus.bench.running.output_folder import prepare_folder
from malus.bench.running.progress import with_progress
from malus.bench.running.results import (
    headline,
    write_results,
)
from malus.reconstruct import get_method
from malus.renderers.datasets.dataset import Dataset, open_dataset
from malus.scenes.core.errors import InputError


def score_for_command_line(
    path: Path,
    names: Sequence[str],
    folder: Path | None,
    label: str,
    out: Path,
    as_json: bool,
) -> None:
    """Score for the command line: problems and suspicions on stderr, one a line."""
    console = Console(stderr=True, soft_wrap=True)
    dataset = open_dataset(path)
    methods = [get_method(name) for name in names]
    _check_request(dataset, names, folder, label)
    prepare_folder(out, "scores")
    predictions = None if folder is None else _checked(dataset, folder, console)
    results = with_progress(
        console,
        "scenes",
        lambda show: score_dataset(dataset, methods, predictions, label, show),
    )
    write_results(out, results)
    for suspicion in results.run.get("predictions", {}).get("suspicions", []):
        console.print(f"{label}: {suspicion}", style="yellow", highlight=False, markup=False)
    if as_json:
        found = {"out": str(out), "methods": headline(results)}
        sys.stdout.write(json.dumps(found | {"run": results.run}) + "\n")
        return
    Console().print(final_table(results))
    invalid = results.table.loc[results.table.metric == "invalid", "value"].sum()
    if invalid > 0:
        console.print(f"{invalid:.0f} pixels with invalid inputs: see the metric `invalid`")
    console.print(f"written to {out}", highlight=False)


def _check_request(dataset: Dataset, names: Sequence[str], folder: Path | None, label: str) -> None:
    if not names and folder is None:
        expected, hint = "--method NAME or --predictions DIR", "`malus list methods` shows methods"
        raise InputError("malus score", expected, "neither", hint)
    if label in names:
        raise InputError("--name", "another name than a method's", label, "choose another name")
    if len(dataset) == 0:
        hint = "`malus render SUITE --out DIR` goes on with it"
        raise InputError(str(dataset.path), "a dataset with scenes", "none", hint)


def _checked(dataset: Dataset, folder: Path, console: Console) -> Predictions:
    """Predictions without a problem; all problems are printed before the first is raised."""
    predictions, problems = with_progress(
        console, "checking", lambda show: check_predictions(dataset, folder, show)
    )
    for problem in problems:
        console.print(str(problem), highlight=False, markup=False)
    if problems:
        expected = f"a good prediction for each of {len(dataset)} scenes"
        found = f"{len(problems)} problem(s), listed above"
        raise InputError(str(folder), expected, found, "correct them all, then score again")
    return predictions
