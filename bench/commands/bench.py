"""`malus bench`: a command for each study of the registry."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from malus.bench.commands.options import FOLDER, LOCAL_FILE, Command, Group
from malus.bench.studies.registry import STUDIES, run_study
from malus.bench.studies.study import Findings, Study, StudyOption


@click.group("bench", cls=Group)
def bench_command() -> None:
    """Run a study: a benchmark beside doing the same without malus, or a table of fixed cases.

    \b
    Example:
      malus bench reconstruct --megapixels 2
    """


def print_findings(findings: Findings) -> None:
    """Print the table of a study, where it has one, and its figures in words."""
    if findings.table is not None and findings.cells is not None:
        from malus.bench.commands.console import plain_console
        from malus.bench.commands.printing import plain_table

        table = plain_table(*map(str, findings.table.columns))
        for _, row in findings.table.iterrows():
            table.add_row(*findings.cells(row))
        plain_console().print(table)
    for line in findings.lines:
        click.echo(line)


def _study_command(study: Study) -> Command:
    """The command of a study, with its options."""

    def run(out: Path | None, **options: Any) -> None:
        findings = run_study(study.name, out, **options)
        print_findings(findings)
        if not findings.passed:
            sys.exit(1)

    where = f"[default: results/{study.name}]" if study.has_page else "[default: nowhere]"
    written = "tables and a page" if study.has_page else "a JSON file with the figures"
    out = click.Option(["--out"], type=FOLDER, help=f"Write {written} into this folder {where}.")
    options = [f"--{name} {value}" for name, value in study.example.items()]
    example = " ".join(["malus bench", study.name, *options])
    paragraphs = [f"{study.description}.", study.details, f"\b\nExample:\n  {example}"]
    return Command(
        study.name,
        params=[*map(_click_option, study.options), out],
        callback=run,
        help="\n\n".join(paragraph for paragraph in paragraphs if paragraph),
    )


def _click_option(option: StudyOption) -> click.Option:
    flag = f"--{option.flag or option.name.replace('_', '-')}"
    multiple = isinstance(option.default, tuple)
    return click.Option(
        [flag, option.name],
        type=_click_type(option),
        default=option.default,
        multiple=multiple,
        is_flag=option.default is False,
        required=option.required,
        show_default=option.default not in (None, False),
        help=option.help,
    )


def _click_type(option: StudyOption) -> click.ParamType[Any] | type | None:
    if option.choices:
        return click.Choice(option.choices)
    if option.is_file:
        return LOCAL_FILE
    if isinstance(option.default, bool):
        return None
    if isinstance(option.default, int) and option.least is not None:
        most = None if option.most is None else int(option.most)
        return click.IntRange(int(option.least), most)
    if isinstance(option.default, int):
        return int
    # A float's range is checked by the study: click's would let NaN through.
    return float if isinstance(option.default, float) else str


for _study in STUDIES.values():
    bench_command.add_command(_study_command(_study))
