"""What every test may ask for, and how tests share a machine."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

BESIDE_OTHERS = "PYTEST_XDIST_WORKER" in os.environ
"""Whether this is one of several processes that share the tests."""

if BESIDE_OTHERS:
    # As many processes as cores: more threads would only wait for each other. Set before NumPy
    # is imported, and inherited by the processes that tests start.
    for library in ("OPENBLAS", "OMP", "MKL", "NUMBA"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def pytest_runtest_setup() -> None:
    """Render on one thread as well, once something has loaded the renderer."""
    if BESIDE_OTHERS and "mitsuba" in sys.modules:
        import drjit

        if drjit.thread_count() > 1:
            drjit.set_thread_count(1)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference data beside the checkout; it is not part of the project."""
    folder = Path(__file__).resolve().parents[2] / "shared"
    if not folder.is_dir():
        message = f"no reference data at {folder}"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)
    return folder


@pytest.fixture
def stand_in_net(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small network of closed form in place of the trained one that method `net` runs."""
    from networks import edges

    from malus.reconstruct.learned import network

    path = edges(tmp_path / "stand_in.onnx")
    monkeypatch.setattr(network, "WEIGHTS", path)
    return path
