"""`malus train`: a network that tells polarisation from one picture, from a dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from malus.bench.commands.options import LOCAL, command, json_option


@command("train")
@click.argument("dataset", type=LOCAL)
@click.option("--out", type=LOCAL, help="The model, an ONNX file [default: net.onnx].")
@click.option(
    "--from",
    "begin_from",
    type=LOCAL,
    help="Model to go on from, its --width and --prior too.",
)
@click.option("--seconds", type=float, help="Time to train for, after reading [default: 600].")
@click.option("--steps", type=int, help="Steps to train for, instead: repeats a training exactly.")
@click.option("--batch", type=int, default=32, help="Pictures a step [32].")
@click.option(
    "--rate", type=float, help="Largest learning rate [0.001]; with --from, 3e-4 is enough."
)
@click.option("--turn", "turn_deg", type=float, default=20, help="Largest turn in degrees [20].")
@click.option(
    "--prior",
    type=click.Choice(["none", "lobes"]),
    help="lobes: further inputs that tell glare from the body's colour [none].",
)
@click.option("--width", type=int, help="Channels of the network's first level [32].")
@click.option(
    "--side",
    type=int,
    help="Pixels a side to reduce pictures to [as rendered]: faster, less noise.",
)
@click.option("--seed", type=int, default=0, help="Of weights and examples [0].")
@click.option("--ablate", "ablates", is_flag=True, help="Compare priors instead; writes no model.")
@json_option
def train_command(
    dataset: Path,
    out: Path | None,
    begin_from: Path | None,
    ablates: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Train a small network on DATASET: from one picture to its polarisation.

    DATASET has three bands and splits, as random suites have. Beside the model are its recipe
    (.json) and its loss curve (.svg). Needs: pip install "malus[learn]"

    \b
    Example:
      malus render random --out random-dataset
      malus train random-dataset --out net.onnx --seconds 600
      malus train more-scenes --from net.onnx --out better.onnx --rate 3e-4
    """
    from malus.bench.commands.console import plain_console
    from malus.bench.commands.printing import print_json
    from malus.bench.learning.options import DEFAULT_MODEL, TrainingOptions
    from malus.bench.public.train import ablate, shape_of, train
    from malus.bench.running.progress import with_progress
    from malus.scenes.core.errors import InputError

    for name, value in (("begin_from", begin_from), ("out", out)):
        if value and ablates:
            raise InputError(f"{name}, ablates", "one of them", "both", "leave one out")
    given = {name: value for name, value in given.items() if value is not None}
    options = TrainingOptions(**(shape_of(begin_from) if begin_from else {}) | given)
    console = plain_console(stderr=True)
    if ablates:
        rows = with_progress(console, "reading", lambda show: ablate(dataset, options, show))
        print_json(rows) if as_json else plain_console().print(_table(rows))
        return
    model = out or DEFAULT_MODEL
    done = with_progress(
        console, "reading", lambda show: train(dataset, model, options, show, begin_from)
    )
    if as_json:
        print_json(done.facts)
        return
    steps, test = done.facts["recipe"]["steps"], done.facts["test_skill"]
    others = "" if test is None else f", test {test:.3f}"
    click.echo(f"{done.model}: median skill val {done.skill:.3f}{others} after {steps} steps")


def _table(rows: list[dict[str, Any]]) -> Any:
    from malus.bench.commands.printing import plain_table

    table = plain_table("network", "steps", "skill val", "skill test", "scenes above 0")
    for row in rows:
        skills = ("–" if row[name] is None else f"{row[name]:.3f}" for name in ("val", "test"))
        table.add_row(row["row"], f"{row['steps']}", *skills, f"{row['above_guess']:.0%}")
    return table
