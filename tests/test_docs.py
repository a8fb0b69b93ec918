"""The documents say what is true: their links lead somewhere, and what they name is there.

What they show is run in `test_followed_pages.py`, and `files.md` is held against a run in
`test_files_page.py`. The built site is tested in `test_site.py`, the tutorials in
`test_tutorials.py`.
"""

from __future__ import annotations

import re
import runpy
import tomllib
from pathlib import Path

import click
import pytest
from documents import (
    DOCS,
    DOCUMENTS,
    METHODS,
    README,
    ROOT,
    blocks,
    code_spans,
    make_targets,
    name_of,
    prose,
)

from malus.bench.cli import cli
from malus.bench.documents.site_hooks import generated_pages, heading_anchor
from malus.bench.gates.baseline import DEFAULT_RULES
from malus.reconstruct import methods

WORDS_OF_THE_README = 1000
"""More than a newcomer reads; the rest belongs into the pages of the site."""


def test_names_in_contributing_exist() -> None:
    """Functions, classes and constants in backticks are those of the sources."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    sources = "".join(
        path.read_text("utf-8")
        for folder in ("scenes", "renderers", "reconstruct", "reports", "bench", "tests")
        for path in (ROOT / folder).rglob("*.py")
    )
    for name in re.findall(r"`(?:\w+\.)*(_\w+|[a-z]+_\w+|[A-Z]\w+)`", text):
        assert re.search(rf"\b{name}\b", sources), name


def test_readme_is_short() -> None:
    assert len(README.read_text("utf-8").split()) <= WORDS_OF_THE_README


def test_the_guide_has_all_that_needs_llvm() -> None:
    """What renderers refuse in the scalar variant, by the key of a suite that asks for it."""
    keys = {
        "maps": "maps",
        "polarised light": "polarised",
        "several surfaces on one object": "pattern",
        "light that bounces": "max_depth",
        "a scene of several objects": "surroundings",
    }
    refused = [
        word
        for path in (ROOT / "renderers").rglob("*.py")
        for word in re.findall(
            r'(?:LLVM or CUDA for|\{expected\}) ([^"{]+)"', path.read_text("utf-8")
        )
    ]
    assert sorted(refused) == sorted(keys)
    text = (DOCS / "guides" / "gpu.md").read_text("utf-8")
    section = text.partition("## Without LLVM\n")[2].partition("\n## ")[0]
    for key in keys.values():
        assert f"`{key}`" in section, key


def test_the_guide_has_what_the_gate_guards() -> None:
    text = (DOCS / "guides" / "gates.md").read_text("utf-8")
    for rule in DEFAULT_RULES:
        assert f"| `{rule.metric}` | {rule.tolerance:g} |" in text, rule.metric


def test_what_networks_train_on_has_polarised_bodies() -> None:
    """Suites of documents that draw scenes say which body: left out, it is the paper's."""
    texts = [b.text for d in DOCUMENTS for b in blocks(d) if b.language == "toml"]
    texts += [p.read_text("utf-8") for p in (DOCS / "tutorials").glob("*.py")]
    drawn = [text for text in texts if "[random]\n" in text]
    assert len(drawn) >= 2
    for text in drawn:
        assert 'bodies = ["polarised"]' in text, text


def test_commands_in_running_text_exist() -> None:
    for document in DOCUMENTS:
        for span in code_spans(document):
            words = span.split()
            if words[0] == "make" and len(words) > 1:
                assert set(words[1:]) <= set(make_targets()), f"{document.name}: {span}"
            if words[0] != "malus" or len(words) == 1 or words[1].startswith("-"):
                continue
            assert words[1] in cli.commands, f"{document.name}: no command {span}"
            command = cli.commands[words[1]]
            known = {o for p in command.params for o in p.opts} | {"--help"}
            if isinstance(command, click.Group):
                assert len(words) == 2 or words[2] in {*command.commands, "STUDY"}, span
                known |= {o for c in command.commands.values() for p in c.params for o in p.opts}
            options = set(re.findall(r"--[\w-]+", span))
            assert options <= known, f"{document.name}: {span} has no {options - known}"


def test_every_command_is_shown_somewhere() -> None:
    shown = "".join(document.read_text("utf-8") for document in DOCUMENTS)
    for name in cli.commands:
        assert f"malus {name} " in shown, f"no page shows malus {name}"


def test_a_guide_has_every_method() -> None:
    named = set(code_spans(METHODS))
    for name in methods():
        assert name in named or name.removesuffix("+body") in named, f"the guide names no {name}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_links_and_pictures_exist(document: Path) -> None:
    text = prose(document)
    for target in re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'src="([^"]+)"', text):
        if target.startswith("https://"):
            continue
        path, _, anchor = target.partition("#")
        linked = (document.parent / path).resolve() if path else document
        if linked.is_relative_to(DOCS) and linked.relative_to(DOCS).as_posix() in MADE:
            continue  # the site has it: test_site.py follows the link
        assert linked.is_file(), f"{document.name}: {target}"
        if anchor:
            headings = re.findall(r"^#+ (.*)$", linked.read_text("utf-8"), re.MULTILINE)
            anchors = [heading_anchor(heading, "-") for heading in headings]
            assert anchor in anchors, f"{document.name}: {target}"


MADE = generated_pages()
"""Pages that no file holds."""


def test_the_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE)
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert cited
    assert newest
    assert project["version"] == cited[1] == newest[1]


def test_pictures_are_small() -> None:
    pictures = [
        *(ROOT / "reports" / "gallery").iterdir(),
        *DOCS.rglob("*.png"),
        *DOCS.rglob("*.svg"),
    ]
    assert pictures
    for picture in pictures:
        assert picture.stat().st_size < 500_000, picture


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_files_that_are_named_exist(document: Path) -> None:
    folders = r"(?:scenes|renderers|reconstruct|bench|reports|tests)/[\w./-]+"
    for span in code_spans(document):
        if re.fullmatch(folders, span):
            assert (ROOT / span).exists(), f"{document.name}: no {span}"


def test_no_machine_path_stands_in_a_document() -> None:
    for document in DOCUMENTS:
        assert not re.search(r"(?<![\w.])/(home|root|tmp|work|opt)/", document.read_text("utf-8"))


def test_the_picture_of_the_conventions_can_be_drawn() -> None:
    script = runpy.run_path(
        str(ROOT / "bench" / "documents" / "conventions_picture.py"), run_name="picture"
    )
    figure = script["picture"](script["mirror_ball"](resolution=16, samples=4))
    assert len(figure.axes) >= 8
    cameras = script["camera_picture"](script["lit_ball"](resolution=16, samples=4))
    assert len(cameras.axes) == 2


def test_the_help_of_every_command_is_short_of_nothing() -> None:
    for name, command in cli.commands.items():
        assert command.help, name
        undocumented = [
            p.name for p in command.params if isinstance(p, click.Option) and not p.help
        ]
        assert not undocumented, f"malus {name}: {undocumented}"
