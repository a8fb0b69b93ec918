"""The summary of a run in Markdown: errors and skill beside the paper's, and what was run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd

from malus.reports.tables import sentences, text_tables
from malus.reports.tables.colour_errors import table1, table1_text
from malus.reports.tables.formats import markdown
from malus.reports.tables.paired import ranked_pairs
from malus.reports.tables.rows import PAPER_METHOD
from malus.reports.tables.skills import negative_skills
from malus.reports.tables.text_tables import as_markdown
from malus.scenes.core.errors import counted


def summary(
    table: pd.DataFrame,
    run: dict[str, Any],
    figures: Sequence[str] = (),
    colours: pd.DataFrame | None = None,
) -> str:
    """The summary of a run as Markdown text.

    Parameters
    ----------
    table, run
        Of the results.
    figures : sequence of str
        Names of image files beside the summary.
    colours : DataFrame, optional
        Table I, where it is known already.

    Examples
    --------
    >>> from malus.reports.tables import sample
    >>> summary(sample.table(), sample.run()).splitlines()[0]
    '# Results of the suite sample'
    """
    blocks = [
        f"# Results of the suite {markdown(run['suite']['name'])}",
        markdown(run["suite"].get("description", "")),
        *(f"**{markdown(sentence)}**" for sentence in sentences.failures(run)),
        *(f"![{markdown(name)}]({name})" for name in figures),
        "## Beside the paper",
        sentences.PAPER,
        as_markdown(text_tables.beside_paper(table)),
        sentences.SKILL,
        *_colours(table1(table) if colours is None else colours),
        "## Errors and skill",
        as_markdown(text_tables.errors(table)),
        sentences.NOISE,
        sentences.UNMIXED,
        *_left_out(table),
        *_pairs(table),
        f"## Where the skill of {PAPER_METHOD} is negative",
        *_negative(table),
        "## Where there is no skill to report",
        *_without_skill(table),
        "## What was run",
        "\n".join(f"- {markdown(fact)}" for fact in sentences.what_was_run(table, run)),
        as_markdown(text_tables.stages(run)),
    ]
    return "\n\n".join(filter(None, blocks)) + "\n"


def _colours(errors: pd.DataFrame) -> Iterator[str]:
    colours = table1_text(errors)
    if colours:
        yield "## Table I: colour differences"
        yield sentences.TABLE1
        yield as_markdown(colours)


def _left_out(table: pd.DataFrame) -> Iterator[str]:
    for method, reason, scenes in text_tables.left_out(table).lines:
        yield f"- {markdown(method)} left out {counted(int(scenes), 'scene')}: {markdown(reason)}."


def _pairs(table: pd.DataFrame) -> Iterator[str]:
    pairs = ranked_pairs(table)
    if pairs:
        yield "## Differences between methods"
        yield sentences.PAIRS
        yield as_markdown(pairs)


def _negative(table: pd.DataFrame) -> Iterator[str]:
    groups = negative_skills(table, PAPER_METHOD)
    if groups.empty:
        yield sentences.no_negative_skill(table)
        return
    scenes = counted(int(groups["negative"].sum()), "scene")
    yield f"{scenes} in {counted(len(groups), 'place')}: there the model is worse than no model."
    yield as_markdown(text_tables.negatives(table, PAPER_METHOD))


def _without_skill(table: pd.DataFrame) -> Iterator[str]:
    without = text_tables.without_skill(table)
    if without:
        yield sentences.NO_SKILL
        yield as_markdown(without)
    else:
        yield sentences.no_scene_without_skill(table)
