"""The documents: what they show, and how their commands are run here, small.

They are README, the pages of the site and the files beside README. They are read for commands, so
that a new one is run as well: every line of a fenced `sh` block, every indented line that starts
like a command, every `run:` of a workflow. Renders are made tiny and long suites are replaced by
`quick`; a command that this file does not know how to run fails. A block that cannot be run says
why in the line above it: `<!-- not run: REASON -->`.
"""

from __future__ import annotations

import re
import runpy
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from click.testing import CliRunner
from runs import no_worker_process

from malus.bench.cli import cli
from malus.scenes import suite_names

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "reports" / "docs"
README, FILES = ROOT / "README.md", DOCS / "files.md"
METHODS = DOCS / "guides" / "methods.md"
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md"))]

TINY = ["--resolution", "12", "--samples", "4"]
TINY_BENCH = {
    "cores": ["--most", "1", "--every", "24", *TINY],
    "reconstruct": ["--megapixels", "0.01"],
    "scaling": ["--most", "48"],
    "paper": ["--every", "24", "--resolution", "12"],
    "separation": ["--every", "24", "--resolution", "12"],
}
STAND_IN = dict.fromkeys(suite_names(), "quick")
"""At a tiny size too, the large suites take minutes: what is tested here is the command."""

NOT_RUN = {
    "python -m pip install": "needs a network",
    "sudo apt-get": "needs a network and changes the machine",
    'cat gate.md >> "$GITHUB_STEP_SUMMARY"': "a variable of the CI service",
}
"""Commands that are documented and cannot be run here, with the reason."""

FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MARKED = re.compile(r"^<!-- not run: [^\n]+ -->\n```.*?^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(
    r"^ {4}((?:malus|make|python|pip|git|\.ci/run|sudo|apt-get)\b.*)$", re.MULTILINE
)
WORKFLOW = re.compile(r"^ *- run: (.*)$", re.MULTILINE)


class Block(NamedTuple):
    """A fenced block; an indented command is a block of its own."""

    language: str
    text: str


def blocks(document: Path) -> Iterator[Block]:
    text = MARKED.sub(blanked, document.read_text("utf-8"))
    found = [(m.start(), Block(m[1], m[2])) for m in FENCE.finditer(text)]
    plain = FENCE.sub(blanked, text)
    found += [(m.start(), Block("sh", m[1])) for m in INDENTED.finditer(plain)]
    yield from (block for _, block in sorted(found))


def blanked(found: re.Match[str]) -> str:
    """Blanks in its place, so that places in the text stay what they are."""
    return re.sub(r"[^\n]", " ", found[0])


def name_of(document: Path) -> str:
    return document.relative_to(ROOT).as_posix()


def commands(block: Block) -> list[str]:
    if block.language in ("yaml", "yml"):
        return WORKFLOW.findall(block.text)
    lines = block.text.replace("\\\n", " ").splitlines()
    return [bare for line in lines if (bare := re.sub(r"(^|\s+)#.*$", "", line).strip())]


def all_commands() -> list[str]:
    shell = ("sh", "bash", "console", "yaml", "yml")
    return [c for d in DOCUMENTS for b in blocks(d) if b.language in shell for c in commands(b)]


def prose(document: Path) -> str:
    return FENCE.sub("", document.read_text("utf-8"))


def code_spans(document: Path) -> list[str]:
    return [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose(document))]


def execute(command: str) -> None:
    words = shlex.split(command)
    if any(command.startswith(known) for known in NOT_RUN):
        return
    if words[0] == "make":
        assert set(words[1:]) <= set(make_targets()), command
    elif words[0] == "python" and words[1].endswith(".py"):
        runpy.run_path(words[1], run_name="__main__")
    elif words[0] == "malus":
        in_process(command, tiny(words[1:]))
    else:
        pytest.fail(f"documented, but this test does not know how to run it: {command}")


def make_targets() -> list[str]:
    return re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)


def tiny(words: list[str]) -> list[str]:
    if words[0] == "bench":
        return [*words[:2], *TINY_BENCH[words[1]]]
    if words[0] not in ("run", "render"):
        return words
    renamed = [STAND_IN.get(word, word) if at == 1 else word for at, word in enumerate(words)]
    return [*renamed, *TINY]


def in_process(command: str, words: list[str]) -> None:
    """In this process: a fresh one would spend its time on imports."""
    assert words[0] in cli.commands, command
    with no_worker_process():
        result = CliRunner().invoke(cli, words)
    assert result.exit_code == 0, f"{command}: {result.exception!r}\n{result.output}"
