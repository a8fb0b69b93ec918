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


@pytest.fixture(scope="session")
def spheres(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set with splits, of formulas and without noise."""
    from trainings import CONTENT

    from malus.bench.datasets.render import render_dataset
    from malus.renderers.variant import Variant
    from malus.scenes import Suite

    folder = tmp_path_factory.mktemp("spheres")
    render_dataset(Suite.parse(CONTENT, "test"), folder, Variant("none", "not used"))
    return folder


@pytest.fixture(scope="session")
def trained(spheres: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model file, with its recipe and loss curve beside it."""
    from runs import run_malus

    model = tmp_path_factory.mktemp("trained") / "net.onnx"
    done = run_malus(
        "train", str(spheres), "--out", str(model), "--steps", "150", "--batch", "8", "--width", "4"
    )
    assert done.returncode == 0, done.stderr
    assert "median skill val" in done.stdout
    return model
