"""Output folders: each holds what one command writes, and nothing else."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

from malus.bench.running.parts import PLAN
from malus.renderers.datasets.dataset_record import DATASET
from malus.scenes.core.errors import InputError, first_line
from malus.scenes.core.files import TEMPORARY, remove_abandoned
from malus.scenes.core.remote import is_here, put_mark
from malus.scenes.core.result_files import EXAMPLES, PARTS, TABLE

CAPTURES = "captures.json"
"""File that marks results of captures, with what was asked for."""

FOLDERS = {
    DATASET: "a dataset",
    PLAN: "a run",
    "conventions.json": "an export",
    "stress.csv": "a study",
    "precision.csv": "a study",
    "readings.csv": "a study",
    "mismatch.csv": "a study",
    "separation.csv": "a study",
    "comparison.json": "a comparison",
    CAPTURES: "captures",
    EXAMPLES: "a run",  # one whose plan is lost, such as half a copy
    TABLE: "scores",
}
"""Content of a folder by the file that marks it, in order: a run has the table of scores, too."""


def prepare_folder(out: Path, content: str = "") -> Path:
    """Make the output folder, check that it can be written, and remove abandoned temporary files.

    `content` is one of the names in `FOLDERS`, or empty for a folder of any kind.

    Raises
    ------
    InputError
        If it cannot be written, or holds something else than `content`.
    """
    check_holds(out, content)
    with _told(out):
        out.mkdir(parents=True, exist_ok=True)
        for folder in (out, out / PARTS, out / EXAMPLES):
            remove_abandoned(folder)
        _try_to_write(out)
    return out


def check_holds(out: Path, content: str) -> None:
    """Refuse a file, and a folder of the files of another command; nothing is made or changed.

    Raises
    ------
    InputError
        If it holds something else than `content`, cannot be read, or has no name in UTF-8.
    """
    try:
        str(out.absolute() if is_here(out) else out).encode()
    except UnicodeEncodeError:  # of an older system: what writes tables and images opens none
        found, hint = "one in another encoding", "choose another `out`"
        raise InputError(f"output folder {out}", "a path in UTF-8", found, hint) from None
    with _told(out):
        held = next((name for mark, name in FOLDERS.items() if (out / mark).exists()), content)
        held = "a file" if out.is_file() else held
    if held == "a file" or (content and held != content):
        expected = f"a new folder, or {content}" if content else "a folder"
        hint = "choose another `out`; nothing was changed"
        raise InputError(f"output folder {out}", expected, held, hint)


@contextlib.contextmanager
def _told(out: Path) -> Iterator[None]:
    """What a folder that cannot be written raises, in one line."""
    try:
        yield
    except Exception as error:
        # A store elsewhere may raise anything, for wrong credentials for example.
        if isinstance(error, InputError) or (is_here(out) and not isinstance(error, OSError)):
            raise
        where, expected = f"output folder {out}", "a folder that can be written"
        raise InputError(where, expected, first_line(error), "choose another `out`") from None


def _try_to_write(out: Path) -> None:
    if is_here(out):
        # Without a name, so that a kill at this moment leaves nothing.
        with tempfile.TemporaryFile(dir=out) as file:
            file.write(bytes(4096))
    else:
        put_mark(out, f"{TEMPORARY}*").unlink()
