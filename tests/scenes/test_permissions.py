"""What is written has the permissions that the user's umask leaves, as what `open` makes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

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
