"""What several modules of these tests compare with, made once."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an uninterrupted run."""
    from runs import TINY, run_malus

    out = tmp_path_factory.mktemp("robust") / "whole"
    done = run_malus(*TINY, "--out", str(out))
    assert done.returncode == 0, done.stderr
    return out
