"""The sections of a page. Those of a run are functions of its source; None without their data.

To add one, write such a function (over the table, or over a file in `source.folder`), its
template in `templates/`, and name the function in `SECTIONS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup

from malus.reports.figures.drawings import Drawing
from malus.reports.page import Section
from malus.reports.source import Source, StudyTables, read_study
from malus.reports.tables import sentences, text_tables
from malus.reports.tables.colour_errors import table1_text
from malus.reports.tables.compared_runs import RunComparison
from malus.reports.tables.formats import duration, listed
from malus.reports.tables.headline import headline_body, headline_tiles, price_tiles
from malus.reports.tables.paired import ranked_pairs
from malus.reports.tables.readings import by_dataset, verdicts
from malus.reports.tables.rows import PAPER_METHOD, is_of_captures
from malus.reports.tables.skills import mapped, skill_maps
from malus.reports.templates.render import render
from malus.reports.viewer.error_maps import gallery
from malus.reports.viewer.viewer import example_scenes, viewer
from malus.scenes.core.errors import counted
from malus.scenes.materials.surface import body_text


def headline(source: Source) -> Section:
    """The numbers that the suite asks for."""
    body = headline_body(source.table)
    suite = source.run["suite"]["name"]
    content = render(
        "headline.html",
        body=body_text(body),
        tiles=list(headline_tiles(source.table, source.colours, suite)),
        explanation=sentences.SKILL,
        doubts=[*sentences.failures(source.run), *sentences.doubts(source.table)],
    )
    return Section("headline", "In short", content)


def image_viewer(source: Source) -> Section | None:
    """The viewer, where the run kept images."""
    if not any(example.methods for example in source.examples):
        return None
    return Section("look", "Turn the polariser", viewer(*source.shown, source.table))


def maps(source: Source) -> Section | None:
    """The error maps of the scenes whose images the run kept."""
    content = gallery([example for example in source.examples if example.methods])
    return Section("maps", "Error maps", content) if content else None


def figures(source: Source) -> Section | None:
    """Every figure with the numbers behind it."""
    return _figures("figures", "Errors", source.drawings) if source.drawings else None


def ladder(source: Source) -> Section | None:
    """The error budget, where methods were told less than everything."""
    if not source.ladders:
        return None
    return _figures("ladder", "Where the error comes from", source.ladders, sentences.LADDER)


def colour(source: Source) -> Section | None:
    """Table I, where the run scored colours."""
    colours = table1_text(source.colours)
    if not colours:
        return None
    is_captured = is_of_captures(source.table)
    explanation = sentences.CAPTURED_TABLE1 if is_captured else sentences.TABLE1
    content = render("colour.html", explanation=explanation, colours=colours)
    return Section("colour", "Table I", content)


def pairs(source: Source) -> Section | None:
    """Whether each method is better than the next beyond chance, where scenes suffice."""
    table = ranked_pairs(source.table)
    if not table:
        return None
    content = render("pairs.html", explanation=sentences.PAIRS, pairs=table)
    return Section("pairs", "Differences between methods", content)


def skill(source: Source) -> Section:
    """Maps of the skill, and where that of the paper's method is negative."""
    table, told = mapped(source.table)
    examples = example_scenes(source.shown[0], table)
    negative = text_tables.negatives(source.table, PAPER_METHOD)
    content = render(
        "skill.html",
        examples=examples,
        maps=skill_maps(table, examples),
        told=told,
        method=PAPER_METHOD,
        negative=negative,
        negative_count=counted(len(negative.lines), "place"),
        never_negative=sentences.no_negative_skill(source.table),
        without_skill=text_tables.without_skill(source.table),
        no_skill=sentences.NO_SKILL,
        all_skills=sentences.no_scene_without_skill(source.table),
    )
    return Section("skill", "Skill", content)


def noise(source: Source) -> Section:
    """Errors of every method, the Monte Carlo noise in them, and the interpolation error."""
    content = render(
        "noise.html",
        explanations=[sentences.NOISE, sentences.UNMIXED],
        interpolation=sentences.interpolation(source.run),
        errors=text_tables.errors(source.table),
        circular=text_tables.circular(source.table),
        circular_explanation=sentences.CIRCULAR,
        left_out=[
            f"{method} left out {counted(int(scenes), 'scene')}: {reason}."
            for method, reason, scenes in text_tables.left_out(source.table).lines
        ],
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
    content = render(
        "plan.html",
        explanation=sentences.PLAN,
        tiles=tiles,
        savings=text_tables.savings(plan),
    )
    return Section("plan", "What the plan saved", content)


def provenance(source: Source) -> Section:
    """What was run, where, and how long it took."""
    machine = f"Machine: {_machine(source.run)}."
    content = render(
        "provenance.html",
        made_by=made_by(source.run),
        lines=[*sentences.what_was_run(source.table, source.run), machine],
        stages=text_tables.stages(source.run),
    )
    return Section("provenance", "How this came about", content)


def made_by(run: dict[str, Any]) -> Markup:
    """The command that made the results, to copy, and a link to the data set that they are of."""
    folder = str(run.get("dataset", {}).get("folder", ""))
    return render(
        "made_by.html",
        command=run.get("command", ""),
        folder=folder,
        address=_address(folder) if folder else "",
    )


def _address(folder: str) -> str:
    """Where a browser finds a folder; empty for what it cannot open, such as a bucket."""
    scheme, separator, _ = folder.partition("://")
    if separator:
        return folder if scheme in ("http", "https") else ""
    return Path(folder).absolute().as_uri() if Path(folder).is_dir() else ""


MakeSection = Callable[[Source], Section | None]
"""Makes a section of a run's page; None without its data."""


def of_run(source: Source, makers: Sequence[MakeSection] = ()) -> list[Section]:
    """All sections of a page that have data, by default `SECTIONS`; studies before the last."""
    sections = [section for make in makers or SECTIONS if (section := make(source))]
    studies = [section for folder in source.beside for section in of_study(read_study(folder))]
    return [*sections[:-1], *studies, sections[-1]]


def of_study(study: StudyTables) -> list[Section]:
    """The sections of a study: one for each table that it wrote."""
    sections = []
    if study.precision is not None:
        text = sentences.PRECISION
        sections.append(_of_study(study, "precision", "Error against run time", text))
    if study.readings is not None:
        first, *others = verdicts(by_dataset(study.readings))
        sections.append(_of_study(study, "readings", "The paper's numbers", first, lines=others))
    if study.mismatch is not None:
        text, tiles = sentences.PRICES, price_tiles(study.mismatch)
        sections.append(_of_study(study, "prices", "What assumptions cost", text, tiles=tiles))
    if study.separation is not None:
        text = sentences.SEPARATION
        sections.append(_of_study(study, "separation", "Separation of the lobes", text))
    if study.stress is not None:
        sections.append(_stress(study.stress, study.run))
    return sections


def _of_study(study: StudyTables, name: str, title: str, text: str, **more: Any) -> Section:
    """A section of a study that has a figure; `more` are further parts of `_figures`."""
    return _figures(name, title, study.drawings, text, origin=_origin(study.run), **more)


def _figures(
    name: str,
    title: str,
    drawings: Sequence[Drawing],
    explanation: str = "",
    lines: Sequence[str] = (),
    tiles: Iterable[tuple[str, str]] = (),
    origin: str = "",
) -> Section:
    """A section of figures, each with the numbers behind it."""
    content = render(
        "figures.html",
        explanation=explanation,
        tiles=list(tiles),
        lines=lines,
        drawings=drawings,
        origin=origin,
    )
    return Section(name, title, content)


def _stress(cases: pd.DataFrame, run: dict[str, Any]) -> Section:
    failed = cases[~cases["passed"]]
    content = render(
        "stress.html",
        explanation=sentences.STRESS,
        verdict=f"{counted(len(cases), 'case')}, {len(failed)} failed.",
        groups=text_tables.stress_groups(cases),
        failed=text_tables.stress_cases(failed),
        cases=text_tables.stress_cases(cases),
        origin=_origin(run),
    )
    return Section("stress", "Stress", content)


def comparison(runs: RunComparison) -> Section:
    """What changed between runs beyond chance."""
    content = render(
        "comparison.html",
        explanation=sentences.COMPARISON,
        headline=f"{runs.headline}.",
        differing=runs.differing,
        means=runs.means,
        changed=runs.changed,
    )
    return Section("comparison", "What changed", content)


def _origin(run: dict[str, Any]) -> str:
    versions = listed([f"{name} {version}" for name, version in run["versions"].items()])
    return f"Finished {run['finished']} on {_machine(run)}; {versions}."


def _machine(run: dict[str, Any]) -> str:
    return ", ".join(str(value) for value in run["machine"].values())


SECTIONS: tuple[MakeSection, ...] = (
    headline, image_viewer, maps, figures, colour, ladder, skill, noise, pairs, savings, provenance,
)  # fmt: skip
"""Functions of the sections of a run, in the order of the page; the last one comes last of all."""
