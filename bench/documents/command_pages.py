"""The reference of the commands, from the command line itself."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

import click

from malus.bench.cli import cli

INTRODUCTION = """# Commands

Made from the command line itself: `malus COMMAND --help` says the same. Exit codes: 0 done; 1 a
render or a method failed for part of the work, or a gate or check failed; 2 bad input, or no room
to work in; 130, 143 and 129 stopped by Ctrl-C, SIGTERM and SIGHUP. A method that does not apply is
no failure.
"""


def command_page() -> str:
    """Markdown of all commands: what each does, its examples, arguments and options.

    Examples
    --------
    >>> "## malus run" in command_page()
    True
    """
    sections = [INTRODUCTION, _overview()]
    for name, command in sorted(cli.commands.items()):
        sections += _sections(f"malus {name}", command, level=2)
    return "\n".join(sections)


def _overview() -> str:
    rows = [
        f"| [`malus {name}`](#malus-{name}) | {command.get_short_help_str(200)} |"
        for name, command in sorted(cli.commands.items())
    ]
    return "\n".join(["| command | does |", "|---|---|", *rows, ""])


def _sections(path: str, command: click.Command, level: int) -> Iterator[str]:
    yield f"{'#' * level} {path}\n"
    context = click.Context(command, info_name=path)
    yield f"    {' '.join(command.get_usage(context).removeprefix('Usage: ').split())}\n"
    yield from _paragraphs(inspect.cleandoc(command.help or ""))
    rows = [_row(option, context) for option in command.params if isinstance(option, click.Option)]
    if rows:
        yield "\n".join(["| option | what it does |", "|---|---|", *rows, ""])
    if isinstance(command, click.Group):
        for name, inner in sorted(command.commands.items()):
            yield from _sections(f"{path} {name}", inner, level + 1)


def _paragraphs(text: str) -> Iterator[str]:
    """Paragraphs of a help text; what click is told not to rewrap is an example."""
    for paragraph in re.split(r"\n\s*\n", text):
        if paragraph.startswith("\b"):
            head, _, rest = paragraph.removeprefix("\b").strip("\n").partition("\n")
            yield f"{head}\n"
            yield f"```text\n{inspect.cleandoc(rest)}\n```\n"
        else:
            yield f"{' '.join(paragraph.split())}\n"


def _row(option: click.Option, context: click.Context) -> str:
    names, told = option.get_help_record(context) or ("", "")
    told = " ".join(told.split()).replace("|", ", ")
    return f"| `{names.replace('|', ', ')}` | {told} |"  # a bar would end the cell
