"""What fuzzing found stays mended: `python tests/fuzz.py --minutes 10` looks for more."""

from __future__ import annotations

import pytest
from fuzz import SEEDS, changed
from fuzz_readers import READERS, verdict

FOUND = sorted(path.name for path in SEEDS.iterdir())


@pytest.mark.parametrize("name", READERS)
def test_a_valid_file_is_read(name: str) -> None:
    """Else every changed one would be refused for the same reason, and nothing looked at."""
    content = READERS[name].valid()
    assert verdict(name, content) is None
    assert verdict(name, b"") is None


@pytest.mark.parametrize("seed", FOUND)
def test_a_file_that_broke_a_reader_is_refused_in_one_line(seed: str) -> None:
    name = seed.split(".")[0]
    assert verdict(name, (SEEDS / seed).read_bytes()) is None


def test_changes_are_what_they_say() -> None:
    assert changed(b"abcd", [("cut", 0.5, 0)]) == b"ab"
    assert changed(b"abcd", [("flip", 0.0, 0)]) == b"`bcd"
    assert changed(b"abcd", [("drop", 0.25, 2)]) == b"ad"
    assert changed(b"abcd", [("number", 0.0, 7)]) == bytes.fromhex("ffffffff")
