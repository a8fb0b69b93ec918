"""Names of a user: square brackets are no markup, and an empty one is no folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from runs import run_malus

import malus.scenes
from malus.bench.cli import cli
from malus.bench.commands.options import Folder

QUICK = Path(malus.scenes.__path__[0], "suites", "quick.toml")
NAME = "[red]x[/b]"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a suite whose folder, name and description have brackets."""
    folder = tmp_path_factory.mktemp("names") / NAME
    folder.mkdir(parents=True)
    text = QUICK.read_text("utf-8").replace("A smoke test", "[/i] :smile:")
    small = text.replace("resolution = 48", "resolution = 8").replace("samples = 32", "samples = 2")
    (folder / "s.toml").write_text(small)
    return folder


@pytest.fixture(scope="module")
def finished(folder: Path) -> Path:
    out = folder / "r"
    done = run_malus("run", str(folder / "s.toml"), "--out", str(out))
    assert done.returncode == 0, done.stderr
    assert "quick: [/i] :smile:" in done.stderr
    assert_told(done.stderr, f"written to {out}")
    return out


def assert_told(told: str, expected: str) -> None:
    """Whatever width the lines are broken at."""
    assert "".join(expected.split()) in "".join(told.split())


def test_a_run_and_what_is_made_of_it_tell_their_folders(finished: Path, folder: Path) -> None:
    baseline = folder / "b.toml"
    for arguments, words in (
        (("report", finished), f"files written to {finished}"),
        (("compare", finished, finished, "--out", folder / "c"), f"written to {folder / 'c'}"),
        (("gate", finished, "--baseline", baseline, "--update"), f"values written to {baseline};"),
        (("gate", finished, "--baseline", baseline), "gate passed"),
        (("status", finished), "families"),
    ):
        done = run_malus(*map(str, arguments))
        assert done.returncode == 0, done.stderr
        assert_told(done.stdout, words)


def test_a_dataset_tells_its_folders(folder: Path) -> None:
    data, exported, scores = folder / "d", folder / "e", folder / "p"
    for arguments, words in (
        (("render", folder / "s.toml", "--out", data), f"16 scenes in {data}:"),
        (("export", data, "--format", "numpy", "--out", exported), f"written to {exported}"),
        (("score", data, "--method", "eq8", "--out", scores), f"written to {scores}"),
    ):
        done = run_malus(*map(str, arguments))
        assert done.returncode == 0, done.stderr
        assert_told(done.stderr, words)


def test_defaults_of_suite_keys_stand_in_brackets() -> None:
    assert "radiance [1.0]" in run_malus("list", "lights").stdout


def paths() -> Iterator[tuple[click.Command, click.Parameter]]:
    """Every argument and option of every command that takes a path."""
    groups = [cli, *(each for each in cli.commands.values() if isinstance(each, click.Group))]
    for command in (each for group in groups for each in group.commands.values()):
        for param in command.params:
            if isinstance(param.type, (click.Path, Folder)):
                yield command, param


@pytest.mark.parametrize(
    ("command", "param"),
    [pytest.param(*each, id=f"{each[0].name} {each[1].name}") for each in paths()],
)
def test_an_empty_path_is_not_the_current_folder(
    command: click.Command, param: click.Parameter
) -> None:
    with pytest.raises(click.BadParameter, match="expected a path, found an empty text"):
        param.type.convert("", param, click.Context(command))
