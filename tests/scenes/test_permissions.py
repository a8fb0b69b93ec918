"""Folders are written whole or not at all, with the permissions that the user's umask leaves."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from malus.scenes.core.errors import InputError
from malus.scenes.core.files import add_to_folder, replace_file, replace_folder, write_whole


@pytest.fixture(params=[0o077, 0o002, 0o022, 0o027])
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_whole_files_and_folders_follow_the_umask(umask: int, tmp_path: Path) -> None:
    """A private umask keeps them private; in a group's folder the group may go on with them."""
    (tmp_path / "plain").write_text("")
    (tmp_path / "folder").mkdir()

    def write(path: Path) -> None:
        path.write_text("")

    def fill(folder: Path) -> None:
        write(folder / "in")

    replace_file(tmp_path / "a.txt", write)
    write_whole(tmp_path / "above" / "b.txt", write)
    replace_folder(tmp_path / "whole", fill)
    add_to_folder(tmp_path / "added", fill)

    def mode(name: str) -> int:
        return (tmp_path / name).stat().st_mode & 0o777

    files = {mode(n) for n in ("plain", "a.txt", "above/b.txt", "whole/in", "added/in")}
    folders = {mode(n) for n in ("folder", "above", "whole", "added")}
    assert files == {0o666 & ~umask}
    assert folders == {0o777 & ~umask}


@pytest.mark.parametrize("stopped_by", [KeyboardInterrupt(), SystemExit(143), OSError(5, "I/O")])
def test_a_folder_is_not_lost_where_its_replacement_is_stopped(
    stopped_by: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between two renames the old folder stood aside, and was removed with all that was left."""
    final, rename = tmp_path / "scene", os.rename
    replace_folder(final, lambda folder: (folder / "old").touch())

    def stopped(source: Path, target: Path) -> None:
        if target == final and not (Path(source) / "old").exists():
            raise stopped_by
        rename(source, target)

    monkeypatch.setattr(os, "rename", stopped)
    with pytest.raises((type(stopped_by), InputError)):
        replace_folder(final, lambda folder: (folder / "new").touch())
    assert [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")] == [
        "scene",
        "scene/old",
    ]


def test_all_files_are_added_to_a_folder_or_none(tmp_path: Path) -> None:
    """Those before the name of a folder were replaced, and then it failed."""
    (tmp_path / "b").mkdir()
    (tmp_path / "a").write_text("mine")

    def write(folder: Path) -> None:
        for name in "ab":
            (folder / name).write_text("new")

    with pytest.raises(InputError, match="b: expected a file"):
        add_to_folder(tmp_path, write)
    assert (tmp_path / "a").read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]
