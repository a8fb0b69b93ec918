"""A file of rows, a line of JSON each, with which a measurement that was stopped goes on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from malus.scenes import InputError

Row = dict[str, Any]

_START = b'{"scene": "'
"""Of every row: what is cut off elsewhere is another's file."""


def kept_rows(path: Path) -> dict[tuple[str, str], Row]:
    """Rows of an earlier run by scene and level; a last line that was cut off is taken away.

    Raises
    ------
    InputError
        If another line is not a row.
    """
    if not path.exists():
        return {}
    written = path.read_bytes()
    whole = written[: written.rfind(b"\n") + 1]
    found = {}
    for number, line in enumerate(whole.splitlines(), start=1):
        try:
            row = json.loads(line)
            found[row["scene"], row.get("level", "")] = row
        except (ValueError, TypeError, KeyError) as error:
            raise _foreign(path, number, line) from error
    cut_off = written[len(whole) :]
    if not cut_off.startswith(_START[: len(cut_off)]):
        raise _foreign(path, len(found) + 1, cut_off)
    if cut_off:
        path.write_bytes(whole)
    return found


def _foreign(path: Path, number: int, line: bytes) -> InputError:
    shown = line.decode("utf-8", "replace")
    return InputError(f"{path}, line {number}", "a row of this command", shown, "name a new file")
