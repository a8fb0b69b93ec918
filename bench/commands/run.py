"""`malus run`: the suite with the user's overrides, progress, the report and the final table."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from malus.bench.running.cluster import engine
from malus.bench.running.progress import with_progress
from malus.bench.running.results import Results, read_results
from malus.bench.running.runner import run
from malus.bench.running.worker_process import TIMEOUT_SECONDS
from malus.renderers.variant import Variant, choose
from malus.scenes.suite import Suite, load_suite


@dataclass(frozen=True)
class How:
    """How a run shall be done: where the work goes, whether earlier failures are tried, seconds
    that a family may take.
    """

    workers: int | None = None
    scheduler: str | None = None
    retry_failed: bool = False
    timeout: float = TIMEOUT_SECONDS


def run_command(
    name: str,
    out: Path | None,
    overrides: dict[str, Any],
    backend: str,
    as_json: bool,
    how: How = How(),
) -> int:
    """Run a suite for the command line; the number of families of which something failed."""
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
    with engine(variant, how.workers, how.scheduler, how.timeout) as chosen:
        results = with_progress(
            console,
            "families",
            lambda show: run(suite, folder, variant, show, chosen, how.retry_failed),
        )
    from malus.reports.write import write_report

    write_report(results, folder)
    failed = int(results.run["families_failed"])
    if as_json:
        numbers = {"out": str(folder), "methods": headline(results), "families_failed": failed}
        sys.stdout.write(json.dumps(numbers) + "\n")
    else:
        Console().print(final_table(results))
        console.print(f"written to {folder}", highlight=False)
    if failed:
        _tell_failed(failed, results, folder, console)
    return failed


def _tell_failed(failed: int, results: Results, folder: Path, console: Console) -> None:
    console.print(
        f"{failed} of {results.run['families']} families failed, wholly or for a method; the first:"
        f" {results.run['failures'][0]}. `malus status {folder}` tells all; a next run leaves them"
        " out, with --retry-failed it tries them again",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )


def report_again(folder: Path, beside: Sequence[Path] = ()) -> None:
    """Write the report of finished results or of a study again, with the studies in `beside`."""
    from malus.reports.studies import is_study
    from malus.reports.write import write_report, write_study

    if is_study(folder):
        written = write_study(folder)
    else:
        written = write_report(read_results(folder), folder, beside)
    Console().print(f"{len(written)} files written to {folder}", highlight=False)


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


def headline(results: Results) -> list[dict[str, Any]]:
    """NMSE and skill of every method, body and kind of light, as plain numbers.

    Skill is the median over scenes that have one; `without_skill` counts the others.
    """
    table = results.headlines
    table = table[table.knowledge == "everything"]
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
