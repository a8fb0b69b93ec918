"""A run, a dataset and scores in a store that is no folder of this machine."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import fsspec
import pandas as pd
import pytest
from fsspec.implementations.memory import MemoryFileSystem
from runs import NOBODY, SUITE, run_malus

import malus
from malus.bench import read_results, run
from malus.bench.datasets.export import export
from malus.bench.datasets.render import render_dataset
from malus.bench.running.status import status
from malus.renderers.datasets.dataset import open_folder
from malus.reports.figures.drawings import drawings
from malus.scenes import InputError
from malus.scenes.core.files import digest, replace_file
from malus.scenes.core.remote import as_path, is_here


@pytest.fixture
def store() -> Iterator[str]:
    """The URL of an empty store in memory."""
    MemoryFileSystem.store.clear()
    MemoryFileSystem.pseudo_dirs[:] = [""]
    yield "memory://bucket"
    MemoryFileSystem.store.clear()


def names(below: str = "/bucket/") -> set[str]:
    return {name.removeprefix(below) for name in MemoryFileSystem.store}


def invoke(*arguments: str) -> str:
    done = run_malus(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_everything_works_on_a_url_as_in_a_folder(
    tmp_path: Path, store: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # One figure is a file like all others.
    first = "malus.reports.write.drawings"
    monkeypatch.setattr(first, lambda table: islice(drawings(table), 1))
    arguments = ("--resolution", "8", "--samples", "2", "--json")
    for out in (f"{store}/run", str(tmp_path / "run")):
        numbers = json.loads(invoke("run", "quick", *arguments, "--out", out))
        assert numbers["out"] == out
        assert json.loads(invoke("status", out, "--json"))["finished"]
        invoke("report", out)
        baseline = str(tmp_path / "baseline.toml")
        invoke("gate", out, "--baseline", baseline, "--update")
        invoke("gate", out, "--baseline", baseline)
        invoke("render", "quick", *arguments, "--out", f"{out}-data")
        assert json.loads(invoke("status", f"{out}-data", "--json"))["finished"]
        invoke("score", f"{out}-data", "--method", "eq8", "--out", f"{out}-scores")
    pd.testing.assert_frame_equal(
        read_results(as_path(f"{store}/run")).table, read_results(tmp_path / "run").table
    )
    pd.testing.assert_frame_equal(
        read_results(as_path(f"{store}/run-scores")).table,
        read_results(tmp_path / "run-scores").table,
    )
    files = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()}
    assert names() == files - {"baseline.toml"}
    one, other = open_folder(f"{store}/run-data"), open_folder(tmp_path / "run-data")
    assert [entry.sha256 for entry in one.record.scenes] == [
        entry.sha256 for entry in other.record.scenes
    ]


def test_a_store_that_fails_loses_nothing_and_is_gone_on_with(
    store: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A put that fails puts nothing, as in an object store."""
    put, left = MemoryFileSystem.put_file, [4]

    def fails(self: Any, *arguments: Any, **options: Any) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError("connection lost")
        put(self, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(MemoryFileSystem, "put_file", fails)
        with pytest.raises(InputError, match="found connection lost"):
            run(SUITE, f"{store}/run", NOBODY)
    assert status(f"{store}/run").left == 1
    assert not [name for name in names() if ".part-" in name]
    again = run(SUITE, f"{store}/run", NOBODY)
    assert again.run["families_taken_over"] == 1
    # A scene of six files of which only some arrived is no scene.
    left[0] = 10
    with monkeypatch.context() as patch:
        patch.setattr(MemoryFileSystem, "put_file", fails)
        with pytest.raises((InputError, OSError), match="connection lost"):
            render_dataset(SUITE, f"{store}/data", NOBODY)
    done = render_dataset(SUITE, f"{store}/data", NOBODY)
    assert (done["taken_over"], done["rendered"]) == (1, 3)
    assert len(list(open_folder(f"{store}/data"))) == 4
    assert export(open_folder(f"{store}/data"), "numpy", f"{store}/numpy") == 4
    assert sum(name.endswith("truth.npz") for name in names()) == 4


CHILD = """
import shutil, sys, uuid
from pathlib import Path
import fsspec
from fsspec.implementations.local import LocalFileSystem

class Atomic(LocalFileSystem):  # what is put is there as a whole or not at all
    protocol = "objects"
    @classmethod
    def _strip_protocol(cls, path):
        return str(path).replace("objects://", sys.argv[1] + "/").rstrip("/")
    def put_file(self, source, target, **options):
        target = Path(self._strip_protocol(target))
        target.parent.mkdir(parents=True, exist_ok=True)
        part = Path(sys.argv[1]) / uuid.uuid4().hex
        shutil.copy(source, part); part.rename(target)

fsspec.register_implementation("objects", Atomic)
from malus.bench import run
from malus.renderers.variant import choose
from malus.scenes import load_suite
suite = load_suite("quick")
suite = suite.model_copy(update={
    "camera": suite.camera.model_copy(update={"resolution": 8}),
    "sampling": suite.sampling.model_copy(update={"samples": 2})})
run(suite, "objects://run", choose())
"""


def test_kills_on_an_object_store_lose_nothing(tmp_path: Path) -> None:
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    for folder in (killed, whole):
        folder.mkdir()
        for parts in (1, 3, 5) if folder == killed else ():
            process = subprocess.Popen([sys.executable, "-c", CHILD, str(folder)])
            while process.poll() is None:
                if len(list(folder.glob("run/parts/*.parquet"))) >= parts:
                    os.kill(process.pid, signal.SIGKILL)
                    break
                time.sleep(0.01)
            process.wait()
        subprocess.run([sys.executable, "-c", CHILD, str(folder)], check=True)
    found, expected = read_results(killed / "run"), read_results(whole / "run")
    assert found.run["families_taken_over"] > 0
    pd.testing.assert_frame_equal(found.table, expected.table, check_exact=True)
    listed = [{p.name for p in f.glob("run/**/*") if p.is_file()} for f in (killed, whole)]
    assert listed[0] == listed[1]


def test_whole_objects_or_none(store: str) -> None:
    file = as_path(f"{store}/a.txt")
    replace_file(file, lambda path: path.write_text("whole"))

    def breaks(path: Path) -> None:
        path.write_text("half")
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        replace_file(file, breaks)
    assert file.read_bytes() == b"whole"
    assert digest(file)[0] == 5
    with pytest.raises(InputError, match="no such file"):
        digest(as_path(f"{store}/b.txt"))


@pytest.mark.parametrize(
    ("url", "says"),
    [("nonsense://a", "a URL that fsspec knows"), ("s3://bucket/run", "pip install .*s3fs")],
)
def test_a_protocol_without_its_package_is_one_line(url: str, says: str) -> None:
    if url.startswith("s3"):
        try:
            fsspec.get_filesystem_class("s3")
        except ImportError:
            pass
        else:
            pytest.skip("s3fs is installed here")
    with pytest.raises(InputError, match=says) as caught:
        as_path(url)
    assert len(str(caught.value).splitlines()) == 1


def test_a_file_url_is_a_folder_of_this_machine(tmp_path: Path) -> None:
    assert as_path(f"file://{tmp_path}/a%20b") == tmp_path / "a b"
    assert is_here(as_path(f"file://{tmp_path}"))


def test_a_store_that_does_not_answer_is_no_empty_folder(
    store: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fsspec says of a server that refuses a connection that it has no such file; so did malus."""

    def refused(self: MemoryFileSystem, path: str, *_: object, **__: object) -> None:
        raise FileNotFoundError(path) from ConnectionRefusedError(111, "Connection refused")

    with pytest.raises(InputError, match=r"dataset\.h5, found none of them"):
        malus.open_dataset(store)
    monkeypatch.setattr(MemoryFileSystem, "_open", refused)
    with pytest.raises(InputError, match=r"dataset\.json: .*, found Connection refused"):
        malus.open_dataset(store)
