"""Worker processes start from every kind of program, and say in one line why where they cannot."""

from __future__ import annotations

import multiprocessing.spawn
import os
import subprocess
import sys
from pathlib import Path

import pytest
from runs import one_line

from malus.bench.running.worker_process import Died, WorkerProcess

WORK = """
from malus.bench.running.worker_process import WorkerProcess
with WorkerProcess(timeout=60) as worker:
    print(list(worker.stream(range, 3)))
"""
OWN = """
from malus.bench.running.worker_process import WorkerProcess
def squares(n):
    for k in range(n):
        yield k * k
if __name__ == "__main__":
    with WorkerProcess(timeout=60) as worker:
        try:
            print(list(worker.stream(squares, 3)))
        except Exception as error:
            print(type(error).__name__, error)
"""


def told(folder: Path, *command: str, program: str = "") -> str:
    """What a program prints, errors too."""
    done = subprocess.run(
        [sys.executable, *command],
        input=program,
        capture_output=True,
        text=True,
        cwd=folder,
        timeout=120,
        check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    return done.stdout + done.stderr


def script(folder: Path, text: str) -> str:
    (folder / "program.py").write_text(text, "utf-8")
    return "program.py"


def test_a_program_from_standard_input_has_workers(tmp_path: Path) -> None:
    assert told(tmp_path, "-", program=WORK) == "[0, 1, 2]\n"


def test_a_program_without_a_guard_is_not_run_again(tmp_path: Path) -> None:
    assert told(tmp_path, script(tmp_path, "print('once')" + WORK)) == "once\n[0, 1, 2]\n"


def test_a_cell_of_a_notebook_has_workers(tmp_path: Path) -> None:
    cell = f"exec(compile({WORK!r}, '<cell 1>', 'exec'), {{'__name__': '__main__'}})"
    assert told(tmp_path, "-c", cell) == "[0, 1, 2]\n"


def test_files_of_the_working_folder_do_not_keep_a_worker_from_starting(tmp_path: Path) -> None:
    """As of a command: it imports nothing from there, and its workers do not either."""
    room, work = tmp_path / "room", tmp_path / "work"
    room.mkdir()
    work.mkdir()
    for name in ("types", "pickle", "socket", "malus", "numpy"):
        (work / f"{name}.py").write_text("raise SystemExit('imported')")
    program = room / script(room, WORK + "import os\nprint(os.environ.get('PYTHONSAFEPATH'))")
    assert told(work, str(program)) == "[0, 1, 2]\nNone\n"  # as it was, for its own processes


def test_a_program_under_a_debugger_has_workers(tmp_path: Path) -> None:
    name = script(tmp_path, WORK)
    assert "[0, 1, 2]\n" in told(tmp_path, "-m", "pdb", "-c", "continue", name, program="q\n")


def test_what_a_program_defines_is_found_by_running_it_again(tmp_path: Path) -> None:
    assert told(tmp_path, script(tmp_path, OWN)) == "[0, 1, 4]\n"


def test_what_cannot_be_found_again_is_told_in_one_line(tmp_path: Path) -> None:
    lines = told(tmp_path, "-", program=OWN).splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("InputError methods: expected methods that a worker process can")
    assert "define them in a module of their own" in lines[0]


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("exit 1", "could not start: it ended with"),
        ("echo Traceback >&2; echo no memory left >&2; exit 3", "could not start: no memory left"),
    ],
)
def test_a_process_that_cannot_start_says_why(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    body: str,
    says: str,
) -> None:
    python = tmp_path / "python"
    tracker = f'case "$*" in *resource_tracker*) exec {sys.executable} "$@";; esac'
    python.write_text(f"#!/bin/sh\n{tracker}\n{body}\n")
    python.chmod(0o755)
    monkeypatch.setattr(multiprocessing.spawn, "_python_exe", os.fsencode(python))
    with WorkerProcess(timeout=60) as worker, pytest.raises(Died, match=says):
        list(worker.stream(range, 3))
    assert capfd.readouterr().err == ""


def test_a_worker_writes_to_the_error_stream_once_it_runs(tmp_path: Path) -> None:
    program = WORK.replace("range, 3", "print_error, 'seen'").replace(
        "from malus", "from helper import print_error\nfrom malus", 1
    )
    (tmp_path / "helper.py").write_text(
        "import os\ndef print_error(text):\n    os.write(2, text.encode())\n    return []\n"
    )
    assert told(tmp_path, script(tmp_path, program)) == "[]\nseen"


def test_the_package_is_a_program() -> None:
    command = [sys.executable, "-m", "malus", "status", "nowhere"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("malus: nowhere: expected")


@pytest.mark.parametrize("arguments", [["list", "shapes"], ["doctor", "--json"]])
def test_a_closed_standard_output_is_told(arguments: list[str]) -> None:
    """The next file that is opened would take its place and get what libraries print."""
    command = ["sh", "-c", 'exec "$@" >&-', "sh", sys.executable, "-m", "malus", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("malus: expected standard output, found it closed")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_what_an_encoding_lacks_is_a_question_mark(encoding: str) -> None:
    """Old locales have no dashes; the table ended in a traceback."""
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    command = [sys.executable, "-m", "malus", "list", "materials"]
    done = subprocess.run(command, capture_output=True, env=environment, check=True)
    assert b"?" in done.stdout


def test_the_drawing_window_of_a_notebook_is_not_asked_for() -> None:
    """Programs that a notebook starts inherit its backend, which their environment may not have."""
    program = "import sys, malus.bench.cli as cli\nsys.argv[1:] = ['list', 'shapes']\ncli.main()\n"
    program += "import matplotlib; print(matplotlib.__name__)"
    environment = os.environ | {"MPLBACKEND": "module://matplotlib_inline.backend_inline"}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert (done.returncode, done.stdout.split()[-1]) == (0, "matplotlib"), done.stderr


def test_a_working_folder_that_is_gone_is_told(tmp_path: Path) -> None:
    """No worker process starts there: all families were recorded as failed for good."""
    gone = tmp_path / "gone"
    gone.mkdir()
    command = 'rmdir "$PWD"; exec "$0" -m malus run quick --out "$1"'
    done = subprocess.run(
        ["sh", "-c", command, sys.executable, str(tmp_path / "out")],
        cwd=gone,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert "working folder: expected a folder, found a removed one" in one_line(done.stderr)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("threads", ["0", "-2", "abc", "2.5", " "])
def test_no_threads_are_told(threads: str) -> None:
    """Numba ended in a traceback, or printed one where it was no number, and went on."""
    done = subprocess.run(
        [sys.executable, "-m", "malus", "list", "methods"],
        env=os.environ | {"NUMBA_NUM_THREADS": threads},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    told = repr(threads) if threads == " " else threads
    assert f"NUMBA_NUM_THREADS: expected a number above 0, found {told}; " in one_line(done.stderr)
    assert done.stderr.count("\n") == 1


def test_threads_set_to_nothing_are_as_many_as_without() -> None:
    """Numba printed a traceback of them, and took as many."""
    script = (
        "import sys; sys.argv = ['malus', 'list', 'methods']\n"
        "from malus.bench.cli import main; main(); import numba"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"NUMBA_NUM_THREADS": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
