"""Where tests of suites write theirs."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def suite_file(tmp_path: Path) -> Path:
    return tmp_path / "mine.toml"
