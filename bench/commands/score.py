"""`malus score`: methods, or images that were made elsewhere, on a stored dataset."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from malus.bench.commands.options import (
    FOLDER,
    METHOD,
    asked_metrics,
    command,
    json_option,
    metric_options,
    split_option,
)

if TYPE_CHECKING:
    from malus.bench.running.results import Results


@command("score")
@click.argument("dataset", type=FOLDER, required=False)
@click.option("--method", "methods", multiple=True, help=f"{METHOD}.")
@metric_options
@click.option("--predictions", type=FOLDER, help="Folder of somebody else's images.")
@click.option(
    "--layout",
    type=click.Choice(("rgb2pol", "polaranything", "pol")),
    help="Layout of --predictions, where it is a published project's.",
)
@click.option(
    "--truth",
    type=FOLDER,
    help="Folder of a published test set in the --layout; DATASET then holds predictions of it.",
)
@click.option(
    "--range",
    "component_range",
    type=float,
    nargs=2,
    help="Of a test set in the layout rgb2pol: what the codes of s1 and s2 stand for, as -1 1.",
)
@split_option
@click.option("--name", help="What the predictions are called in tables [default: predictions].")
@click.option("--out", type=FOLDER, help="Folder of the results [default: results/scores].")
@json_option
def score_command(dataset: Path | None, out: Path | None, as_json: bool, **options: Any) -> None:
    """Score methods, or images that were made elsewhere, on a stored DATASET.

    Predictions are one file a scene, <scene>.npz: `stokes` (height, width, bands, 3), or `i_max`,
    `i_min` and `phase` (height, width, bands), phase in radians anticlockwise from the vertical.
    Also <scene>.exr in the spectral layout of the dataset, or a folder <scene>/ with one
    <degrees>.npy (height, width, bands) for each of three or more polariser angles.

    \b
    With --layout, NAME a scene's id or its number (0000, 0001, …):
      rgb2pol        NAME/s1.png, s2.png: codes between the truth's smallest and largest value
      polaranything  AoLP_16bit/NAME.png from -90 to 90 degrees, DoLP_16bit/NAME.png from 0 to 1
      pol            pol000/NAME.png, pol045, pol090, pol135: intensities, linear

    \b
    Example:
      malus score quick-dataset --method eq8 --method shadowed+body
      malus score quick-dataset --predictions my-network --name mine
      malus score drawn --predictions my-network --split test
      malus score quick-dataset --method blind --profile polarscale
      malus score my-network --layout pol --truth test-set --method blind --profile polarscale
    """
    from malus.bench.commands.console import plain_console
    from malus.bench.commands.export import not_rendered

    folder = out if out is not None else Path("results") / "scores"
    console = plain_console(stderr=True, soft_wrap=True)
    options["metrics"] = asked_metrics(options["metrics"], options.pop("profiles"))
    _check_of_predictions(options)
    options["name"] = options["name"] or "predictions"
    if options["truth"] is not None:
        _tell(_score_published(dataset, folder, console, options), folder, console, as_json)
        return
    if dataset is None or options.pop("component_range") is not None:
        raise click.UsageError("DATASET is missing" if dataset is None else "--range is of --truth")
    del options["truth"]
    results = _score(dataset, folder, console, options)
    for suspicion in results.run.get("predictions", {}).get("suspicions", []):
        name = options["name"]
        console.print(f"{name}: {suspicion}", style="yellow")
    missing = results.run["scenes_missing"]
    if missing and not as_json:
        console.print(not_rendered(missing, dataset))
    _tell(results, folder, console, as_json)


def _check_of_predictions(options: dict[str, Any]) -> None:
    """Refuse options of predictions where there are none."""
    if options["predictions"] is None and options["truth"] is None:
        for key in ("name", "layout"):
            if options[key] is not None:
                raise click.UsageError(f"--{key} is of --predictions, or of --truth")


def _score(dataset: Path, folder: Path, console: Any, options: dict[str, Any]) -> Results:
    """Score with a bar of progress; all problems of predictions are told before the error."""
    from malus.bench.datasets.predictions import PredictionErrors
    from malus.bench.datasets.score import score_dataset
    from malus.bench.running.progress import with_progress

    try:
        return with_progress(
            console,
            "scenes",
            lambda show: score_dataset(dataset, progress=show, out=folder, **options),
        )
    except PredictionErrors as error:
        for problem in error.problems:
            console.print(str(problem))
        raise


def _score_published(
    predictions: Path | None, folder: Path, console: Any, options: dict[str, Any]
) -> Results:
    """Score on a published test set with a bar of progress."""
    from malus.bench.datasets.published_sets import score_published
    from malus.bench.running.progress import with_progress

    if options.pop("predictions") is not None or options["layout"] is None:
        raise click.UsageError("beside --truth, DATASET is the predictions, and --layout is needed")
    if options.pop("split") is not None:
        raise click.UsageError("--split is of DATASET, a published test set has none")
    return with_progress(
        console,
        "pictures",
        lambda show: score_published(predictions=predictions, progress=show, out=folder, **options),
    )


def _tell(results: Results, folder: Path, console: Any, as_json: bool) -> None:
    """Print what came of it, and what is not in the numbers."""
    from malus.bench.commands.printing import print_json, print_results
    from malus.bench.running.results import headline

    if as_json:
        print_json({"out": str(folder), "methods": headline(results), "run": results.run})
        return
    print_results(results, console)
    invalid = results.table.loc[results.table.metric == "invalid", "value"].sum()
    if invalid > 0:
        console.print(f"{invalid:.0f} pixels with invalid inputs: see the metric `invalid`")
    unknown = results.run.get("scenes_without_normal_spread", 0)
    if unknown:
        scenes = f"{unknown} of {results.run['scenes']} scenes"
        console.print(
            f"{scenes} do not tell which pixels see more than one normal: no skill without them;"
            " `malus render` of this version into a new folder does"
        )
    console.print(f"written to {folder}")
