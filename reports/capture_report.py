"""The page and summary of real captures; Table I, Figure 9 and error maps are those of a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd

from malus.reports.page import Section
from malus.reports.sections import colour, figures, image_viewer, made_by, maps, of_run
from malus.reports.source import Source
from malus.reports.tables import captures, sentences, text_tables
from malus.reports.tables.colour_errors import table1, table1_text
from malus.reports.tables.formats import markdown
from malus.reports.tables.text_tables import as_markdown
from malus.reports.templates.render import render


def of_captures(source: Source) -> list[Section]:
    """All sections of the page of captures that have data, then the studies given with it."""
    return of_run(source, (_headline, image_viewer, maps, figures, colour, _errors, _provenance))


def _headline(source: Source) -> Section:
    content = render(
        "captures.html",
        explanation=[sentences.CAPTURES, sentences.SKILL],
        tables=[("Errors by group", captures.by_group(source.table))],
        lines=[],
        doubts=list(captures.doubts(source.run)),
    )
    return Section("headline", "In short", content)


def _errors(source: Source) -> Section:
    tables = [("Errors by capture", captures.by_capture(source.table))]
    if objects := captures.by_object(source.table):
        tables.append(("Skill by object", objects))
    content = render(
        "captures.html",
        explanation=[],
        tables=tables,
        lines=[*captures.agreements(source.table), *captures.notes(source.table)],
        doubts=[],
    )
    return Section("errors", "Every capture", content)


def _provenance(source: Source) -> Section:
    content = made_by(source.run) + render(
        "captures.html",
        explanation=[],
        tables=[
            ("How the pictures fit", captures.fits(source.run)),
            ("Seconds of every stage", text_tables.stages(source.run)),
        ],
        lines=list(captures.what_was_run(source.run)),
        doubts=[],
    )
    return Section("provenance", "How this came about", content)


def capture_summary(
    table: pd.DataFrame,
    run: dict[str, Any],
    figures: Sequence[str] = (),
    colours: pd.DataFrame | None = None,
) -> str:
    """The summary of captures as Markdown text; `figures` are names of image files beside it.

    `colours` are those of `table1`, where they are known.
    """
    known = table1(table) if colours is None else colours
    return "\n\n".join(filter(None, _blocks(table, run, figures, known))) + "\n"


def _blocks(
    table: pd.DataFrame, run: dict[str, Any], figures: Sequence[str], known: pd.DataFrame
) -> Iterator[str]:
    yield f"# Real captures: {markdown(run['suite']['name'])}"
    yield markdown(run["suite"].get("description", ""))
    yield from (f"![{markdown(name)}]({name})" for name in figures)
    yield sentences.CAPTURES
    yield sentences.SKILL
    yield as_markdown(captures.by_group(table))
    yield _list(captures.doubts(run))
    if colours := table1_text(known):
        yield "## Table I: colour differences"
        yield sentences.CAPTURED_TABLE1
        yield as_markdown(colours)
    yield "## Every capture"
    yield as_markdown(captures.by_capture(table))
    if objects := captures.by_object(table):
        yield as_markdown(objects)
    yield _list((*captures.agreements(table), *captures.notes(table)))
    yield "## How this came about"
    yield _list(captures.what_was_run(run))
    yield as_markdown(captures.fits(run))
    yield as_markdown(text_tables.stages(run))


def _list(lines: Iterator[str] | Sequence[str]) -> str:
    return "\n".join(f"- {markdown(line)}" for line in lines)
