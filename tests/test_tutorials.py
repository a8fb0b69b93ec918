"""The tutorials run, at small sizes, and draw the pictures that their pages show."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

import matplotlib as mpl
import pytest
from runs import no_worker_process

TUTORIALS = Path(__file__).parents[1] / "reports" / "docs" / "tutorials"
SCRIPTS = sorted(TUTORIALS.glob("*.py"))

SMALL = {"RESOLUTION": 24, "SAMPLES": 16, "COUNT": 8}
"""What the constants at the top of a script become."""


def small(script: str) -> str:
    """The script with its sizes replaced; a size that is not found would make the test slow."""
    line = re.search(r"^((?:[A-Z]+, )*[A-Z]+) = [\d, ]+$", script, re.MULTILINE)
    assert line, "RESOLUTION, SAMPLES = …, at the start of a line"
    values = ", ".join(str(SMALL[name]) for name in line[1].split(", "))
    return script.replace(line[0], f"{line[1]} = {values}")


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_tutorial_runs_and_draws_what_its_page_shows(
    path: Path, tmp_path: Path, stand_in_net: Path
) -> None:
    """With a network of closed form: its own quality is tested elsewhere."""
    script = path.read_text("utf-8")
    with mpl.rc_context({"backend": "agg"}), contextlib.chdir(tmp_path), no_worker_process():
        exec(compile(small(script), path.name, "exec"), {"__name__": "__main__"})
    shown = re.findall(r"\]\((\w+\.png)\)", script)
    assert shown
    for picture in shown:
        assert (tmp_path / picture).is_file(), "the script draws it"
        assert (TUTORIALS / picture).is_file(), "the page shows it: run the script and keep it"


def test_there_are_four_tutorials() -> None:
    assert len(SCRIPTS) == 4


def test_every_picture_of_the_glossary_can_be_drawn() -> None:
    from malus.bench.documents.glossary_pictures import FOLDER, PICTURES, balls

    shown = balls(resolution=16, samples=4)
    for name, draw in PICTURES.items():
        assert draw(shown).axes, name
        assert (FOLDER / f"{name}.png").is_file(), "run the script and keep it"
    page = (FOLDER.parent / "glossary.md").read_text("utf-8")
    assert set(re.findall(r"\(glossary/(\w+)\.png\)", page)) == set(PICTURES)


def test_every_word_of_the_glossary_has_a_line_and_a_picture() -> None:
    page = (TUTORIALS.parent / "start" / "glossary.md").read_text("utf-8")
    rows = re.findall(r"^\| \*\*.*$", page, re.MULTILINE)
    assert len(rows) >= 20
    for row in rows:
        word, picture, meaning = (cell.strip() for cell in row.strip("|").split("|"))
        assert picture.startswith("!["), word
        assert meaning.endswith("."), word
