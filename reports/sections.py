"""The page's sections. Each is a function of the source and gives None without its data.

To add one, write such a function (over the table, or over a file in `source.folder`) and name it
in `SECTIONS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pandas as pd

from malus.reports.html import folded, join, table, tag
from malus.reports.section import Section, figure
from malus.reports.skill_map import maps as skill_maps
from malus.reports.source import Source
from malus.reports.studies import read_study
from malus.reports.tables import sentences, text_tables
from malus.reports.tables.colour_errors import table1_text
from malus.reports.tables.formats import counted, duration, scientific, skill_text
from malus.reports.tables.rows import (
    PAPER_BODY,
    PAPER_METHOD,
    PAPER_RANGE,
    TRIVIAL,
    distinct,
    overall_rows,
    rows_of_body,
)
from malus.reports.tables.text_tables import range_of_means
from malus.reports.viewer.error_maps import WHITE, gallery
from malus.reports.viewer.viewer import place_of_scenes, viewer


def headline(source: Source) -> Section:
    """The numbers of the paper's method beside the paper's own."""
    body = PAPER_BODY if PAPER_BODY in distinct(source.table["body"]) else ""
    rows = rows_of_body(source.table, body) if body else source.table
    tiles = [tag("li", tag("b", number), label) for number, label in _tiles(rows)]
    paper = f"the paper’s method, {PAPER_METHOD}" + (f"; {body} body" if body else "")
    return Section(
        "headline",
        "In short",
        join(
            tag("p", f"Everything known to the method: {paper}.", class_="note"),
            tag("ul", *tiles, class_="tiles"),
            tag("p", sentences.SKILL),
            *(tag("p", fact, class_="warning") for fact in sentences.doubts(source.table)),
        ),
    )


def _tiles(rows: pd.DataFrame) -> Iterator[tuple[str, str]]:
    error, skill = (_of(overall_rows(rows, metric), PAPER_METHOD) for metric in ("nmse", "skill"))
    trivial = _of(overall_rows(rows, "nmse"), TRIVIAL)
    if len(error):
        for by in ("material", "surface"):
            yield range_of_means(error, by), f"mean NMSE by {by}. The paper: {PAPER_RANGE}"
    if len(trivial):
        yield range_of_means(trivial, "material"), "the same of the trivial guess I(ϑ) = I/2"
    if len(skill):
        values = skill["value"]
        yield skill_text(float(values.median())), "median skill; the paper reports none"
        share = f"{int((values < 0).sum())} of {len(values)}"
        yield share, "scenes with negative skill: worse than no model"
        without = int(values.isna().sum())
        yield str(without), "scenes without a skill: trivial guess inside the noise"
    if len(error):
        yield scientific(float(error["noise"].mean())), "Monte Carlo noise in the mean NMSE"


def _of(rows: pd.DataFrame, method: str) -> pd.DataFrame:
    return rows[rows["method"] == method]


def look(source: Source) -> Section | None:
    """The viewer, where the run kept images."""
    if not any(example.methods for example in source.examples):
        return None
    content = viewer(source.examples, source.table)
    return Section("look", "Turn the polariser", content)


def maps(source: Source) -> Section | None:
    """The error maps of the scenes whose images the run kept."""
    shown = gallery([example for example in source.examples if example.methods])
    if shown is None:
        return None
    legend = tag(
        "div", "ΔE76: 0", tag("span", class_="grey-bar", role="img", aria_label="black to white"),
        f"{WHITE:g} (10 JND) and more", class_="legend",
    )  # fmt: skip
    return Section("maps", "Error maps", join(tag("p", sentences.ERROR_MAPS), legend, shown))


def figures(source: Source) -> Section | None:
    """Every figure with the numbers behind it."""
    if not source.drawings:
        return None
    return Section("figures", "Errors", join(*map(figure, source.drawings)))


def ladder(source: Source) -> Section | None:
    """The error budget, where methods were told less than everything."""
    if not source.ladders:
        return None
    content = join(tag("p", sentences.LADDER), *map(figure, source.ladders))
    return Section("ladder", "Where the error comes from", content)


def colour(source: Source) -> Section | None:
    """Table I, where the run scored colours."""
    found = table1_text(source.table)
    if not found:
        return None
    content = join(tag("p", sentences.TABLE1), table(found, "Table I: colour differences"))
    return Section("colour", "Table I", content)


def skill(source: Source) -> Section:
    """The skill map and where the paper's method is worse than no model."""
    note = (
        "Median over shapes and materials. Blue is better than the trivial guess, orange worse;"
        " a dash: no skill to report or not applicable."
    )
    places = place_of_scenes(source.examples, source.table)
    more = " A framed number opens an example in the viewer." if places else ""
    negative = text_tables.negatives(source.table, PAPER_METHOD)
    without = text_tables.without_skill(source.table)
    title = f"Where the skill of {PAPER_METHOD} is negative"
    content = join(
        tag("p", note + more, class_="note"),
        tag("div", *skill_maps(source.table, places), class_="maps"),
        folded(f"{title}: {counted(len(negative.lines), 'place')}", table(negative, title))
        if negative
        else tag("p", sentences.NEVER_NEGATIVE),
        table(without, sentences.NO_SKILL) if without else tag("p", sentences.ALL_SKILLS),
    )
    return Section("skill", "Skill", content)


def noise(source: Source) -> Section:
    """Errors of every method with the noise in them, and the interpolation error."""
    title = "NMSE, Monte Carlo noise and skill of every method per light and body"
    rms = scientific(source.run["interpolation_rms"])
    content = join(
        tag("p", sentences.NOISE),
        tag("p", f"Interpolation in η adds at most {rms} of the peak (rms, measured)."),
        table(text_tables.errors(source.table), title),
        *(
            tag("p", f"{method} left out {counted(int(scenes), 'scene')}: {reason}.")
            for method, reason, scenes in text_tables.left_out(source.table).lines
        ),
    )
    return Section("noise", "All errors, and the noise in them", content)


def savings(source: Source) -> Section | None:
    """What the plan left out and what that saved, where the run recorded it."""
    plan = source.run.get("plan")
    if not plan:
        return None
    tiles = (
        (f"{plan['renders']:,} of {plan['without_plan']:,}", "renders that were done"),
        (duration(plan["seconds"]), "rendering, measured"),
        (duration(plan["seconds_without"]), "the same without a plan, estimated"),
    )
    content = join(
        tag("p", sentences.PLAN),
        tag("ul", *(tag("li", tag("b", value), label) for value, label in tiles), class_="tiles"),
        table(text_tables.savings(plan), "What was left out"),
    )
    return Section("plan", "What the plan saved", content)


def provenance(source: Source) -> Section:
    """What was run, where, and how long it took."""
    machine = source.run["machine"]
    about = f"Machine: {', '.join(str(value) for value in machine.values())}."
    lines = [*sentences.what_was_run(source.table, source.run), about]
    content = join(
        tag("ul", *(tag("li", line) for line in lines)),
        table(text_tables.stages(source.run), "Seconds of every stage"),
    )
    return Section("provenance", "How this came about", content)


def of_run(source: Source) -> list[Section]:
    """All sections of a run's page: those that have data, then the studies given with it."""
    made = (make(source) for make in SECTIONS)
    found = [section for section in made if section]
    studies = [section for folder in source.beside for section in read_study(folder).sections]
    return [*found[:-1], *studies, found[-1]]


SECTIONS: tuple[Callable[[Source], Section | None], ...] = (
    headline, look, maps, figures, colour, ladder, skill, noise, savings, provenance,
)  # fmt: skip
