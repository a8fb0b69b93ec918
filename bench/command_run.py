"""`malus run`: the suite with the user's overrides, progress, the report and the final table."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from malus.bench.results import Results
from malus.bench.runner import run
from malus.renderers.variant import Variant, choose
from malus.scenes.suite import Suite, load_suite


def run_command(
    name: str, out: Path | None, overrides: dict[str, Any], backend: str, as_json: bool
) -> None:
    """Run a suite for the command line."""
    suite = load_suite(name)
    variant = choose(backend)
    suite = overridden(suite, overrides, variant)
    folder = out if out is not None else Path("results") / suite.name
    console = Console(stderr=True)
    console.print(f"{suite.name}: {suite.description}", highlight=False)
    console.print(
        f"variant {variant.name} ({variant.reason}), {suite.camera.resolution}² pixels, "
        f"{suite.sampling.samples} samples a pixel",
        highlight=False,
    )
    results = _with_progress(suite, folder, variant, console)
    from malus.reports.write import write_report

    write_report(results, folder)
    if as_json:
        sys.stdout.write(json.dumps({"out": str(folder), "methods": headline(results)}) + "\n")
        return
    Console().print(final_table(results))
    console.print(f"written to {folder}", highlight=False)


def overridden(suite: Suite, overrides: dict[str, Any], variant: Variant) -> Suite:
    """The suite with the user's overrides, and its own smaller sizes where no array variant runs.

    Raises
    ------
    InputError
        If a value is not valid.
    """
    data = suite.model_dump(mode="json")
    smaller = suite.scalar if suite.scalar and not variant.vectorised else None
    if smaller:
        data["camera"]["resolution"] = smaller.resolution
        data["sampling"]["samples"] = smaller.samples
        data["description"] += f" ({smaller.note})"
    for section, key in (("sampling", "samples"), ("camera", "resolution"), ("sampling", "seed")):
        if overrides.get(key) is not None:
            data[section][key] = overrides[key]
    if overrides.get("methods"):
        data["methods"] = list(overrides["methods"])
    return Suite.parse(data, "command line")


def _with_progress(suite: Suite, folder: Path, variant: Variant, console: Console) -> Results:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("families", total=None)

        def show(done: int, total: int, label: str) -> None:
            bar.update(task, completed=done, total=total, description=label)

        return run(suite, folder, variant, show)


def headline(results: Results) -> list[dict[str, Any]]:
    """NMSE and skill of every method, body and kind of light, as plain numbers.

    Skill is the median over scenes that have one; `without_skill` counts the others.
    """
    table = results.headlines
    keys = ["body", "light", "method"]
    rows = []
    for group, part in table.groupby(keys, sort=False):
        nmse = part.value[part.metric == "nmse"]
        skill = part.value[part.metric == "skill"]
        if nmse.empty:
            continue
        rows.append(
            dict(zip(keys, group, strict=True))
            | {
                "nmse_mean": float(nmse.mean()),
                "nmse_max": float(nmse.max()),
                "skill_median": _or_none(skill.median()),
                "skill_min": _or_none(skill.min()),
                "scenes": len(nmse),
                "without_skill": int(skill.isna().sum()),
            }
        )
    return rows


def _or_none(value: Any) -> float | None:
    return None if pd.isna(value) else float(value)


def final_table(results: Results) -> Table:
    """One row a light, body and method; narrow enough for 80 columns."""
    title = "skill: 1 is perfect, 0 no better than guessing “unpolarised”"
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name in ("light", "body", "method"):
        table.add_column(name, no_wrap=True)
    for name in ("NMSE", "skill", "worst"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in headline(results):
        numbers = [_skill(row["skill_median"]), _skill(row["skill_min"])]
        nmse = f"{row['nmse_mean']:.1e}"
        table.add_row(row["light"], row["body"], row["method"], nmse, *numbers)
    return table


def _skill(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
