"""A trained network is a file that does what it did, and no pixel sees farther than it says."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from runs import one_line, run_malus

jax = pytest.importorskip("jax", reason="no jax; pip install jax optax onnx onnxruntime")

import onnx  # noqa: E402
import onnxruntime  # noqa: E402
from trainings import QUICK, random_weights, rewritten  # noqa: E402

import malus  # noqa: E402
from malus.bench.learning import network  # noqa: E402
from malus.bench.learning.camera import in_blocks  # noqa: E402
from malus.bench.learning.model_file import read_model, write_model  # noqa: E402
from malus.bench.learning.network import Architecture  # noqa: E402
from malus.bench.learning.objective import sums  # noqa: E402
from malus.scenes import InputError  # noqa: E402

TINY = Architecture(width=4, prior="lobes")
CODES, STEP = np.zeros((8, 8, 3), np.float32), np.float32(1)
LIGHT, MASK = np.ones((1, 16, 16, 3, 3), np.float32), np.ones((1, 16, 16), bool)
RATIOS, DEVIATIONS = LIGHT[..., 1:], LIGHT[..., 0]


def products(jaxpr: Any) -> Iterator[Any]:
    """The products of matrices and the convolutions of a function, and of those it calls."""
    for step in jaxpr.eqns:
        if step.primitive.name in ("dot_general", "conv_general_dilated"):
            yield step
        for part in step.params.values():
            if hasattr(part, "jaxpr") or hasattr(part, "eqns"):
                yield from products(getattr(part, "jaxpr", part))


@pytest.mark.parametrize(
    ("function", "arguments", "least"),
    [
        (in_blocks, (CODES, STEP), 4),
        (sums, (LIGHT, MASK, RATIOS, DEVIATIONS), 4),
        (partial(network.forward, prior="lobes"), (random_weights(TINY), LIGHT[..., 0]), 20),
    ],
    ids=["in_blocks", "sums", "forward"],
)
def test_products_have_all_digits_on_a_graphics_card_too(
    function: Callable[..., Any], arguments: tuple[Any, ...], least: int
) -> None:
    """A card takes ten bits of their factors, unless each product asks for more."""
    found = list(products(jax.make_jaxpr(function)(*arguments).jaxpr))
    assert len(found) >= least
    assert {step.params["precision"] for step in found} == {(jax.lax.Precision.HIGHEST,) * 2}


@pytest.mark.parametrize("prior", ["none", "lobes"])
def test_the_file_agrees_with_the_network(prior: str, tmp_path: Path) -> None:
    architecture = Architecture(width=4, prior=prior)
    weights = network.rounded(random_weights(architecture))
    write_model(tmp_path / "net.onnx", weights, architecture, 1.5, {"format": 1})
    picture = np.random.default_rng(0).uniform(0, 3, (1, 48, 64, 3)).astype(np.float32)
    expected, deviations = network.forward(weights, picture, prior)
    session = onnxruntime.InferenceSession(tmp_path / "net.onnx")
    stokes, deviation = session.run(None, {"image": picture.transpose(0, 3, 1, 2)})
    # Single precision through 30 convolutions of up to 360 products, in another order.
    np.testing.assert_allclose(stokes[0, :3], np.moveaxis(expected[0, ..., 0], -1, 0), atol=1e-4)
    np.testing.assert_allclose(stokes[0, 3:], np.moveaxis(expected[0, ..., 1], -1, 0), atol=1e-4)
    np.testing.assert_allclose(
        deviation[0], 1.5 * np.moveaxis(deviations[0], -1, 0), rtol=1e-3, atol=1e-4
    )
    assert np.hypot(stokes[0, :3], stokes[0, 3:]).max() <= 1.0
    assert deviation.min() > 0


@pytest.mark.parametrize("prior", ["none", "lobes"])
def test_a_model_is_read_back_as_it_was_written(prior: str, tmp_path: Path) -> None:
    architecture, path = Architecture(width=8, prior=prior), tmp_path / "net.onnx"
    weights = network.rounded(random_weights(architecture))
    recipe = {"options": architecture._asdict()}
    write_model(path, weights, architecture, 1.5, {"recipe": recipe, "calibration": 1.5})
    read = read_model(path)
    assert read.architecture == architecture
    assert read.recipe == recipe
    assert read.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert read.weights.keys() == weights.keys()
    assert all(np.array_equal(read.weights[name], w) for name, w in weights.items())


def test_what_is_no_model_of_this_network_is_refused(
    trained: Path, spheres: Path, tmp_path: Path
) -> None:
    wide = run_malus("train", str(spheres), "--from", str(trained), "--width", "8")
    assert wide.returncode == 2
    assert "--width: expected 4, as the model to begin from has, found 8" in one_line(wide.stderr)
    both = run_malus("train", str(spheres), "--from", str(trained), "--ablate")
    assert "--from, --ablate: expected one of them" in one_line(both.stderr)
    text = run_malus("train", str(spheres), "--from", str(trained.with_suffix(".json")))
    assert text.returncode == 2
    assert "net.json: expected a model of malus train" in one_line(text.stderr)
    with pytest.raises(InputError, match="prior: expected none, as the model"):
        malus.train(spheres, "net.onnx", replace(QUICK, prior="lobes"), begin_from=trained)
    bare = onnx.load(trained)
    del bare.metadata_props[:]
    onnx.save(bare, tmp_path / "bare.onnx")
    moved = onnx.load(trained)
    moved.graph.node[-1].input[1] = "c0"
    onnx.save(moved, tmp_path / "moved.onnx")
    rewritten(trained, tmp_path / "told.onnx", 1.0, width=8)
    for name in ("bare", "moved", "told", "missing"):
        with pytest.raises(InputError, match=f"{name}.onnx: expected a model of malus train"):
            read_model(tmp_path / f"{name}.onnx")


def test_the_default_network_is_small_enough() -> None:
    weights = network.initial_weights(0, Architecture(32, "none"))
    assert 2 * sum(w.size for w in weights.values()) < 3.9e6  # bytes; the file has at most 4 MB


def test_ratios_stay_within_all_light() -> None:
    raw = np.full((1, 1, 1, 9), 1e6, np.float32)
    ratios, deviations = network._answers(raw)
    assert float(np.linalg.norm(ratios, axis=-1).max()) <= 1.0
    assert np.isfinite(deviations).all()


def reached(place: int, side: int) -> np.ndarray:
    """Pixels of a line that a change at `place` reaches through the network, by brute force."""

    def convolved(line: np.ndarray) -> np.ndarray:
        return line | np.append(line[1:], False) | np.insert(line[:-1], 0, False)

    def blocks(line: np.ndarray, count: int) -> np.ndarray:
        for _ in range(2 * count):
            line = convolved(line)
        return line

    squares = (np.arange(side) == place).reshape(-1, 2).any(axis=1)
    line = convolved(squares)
    lines = [line]
    for count in (1, 1, 2):
        line = blocks(convolved(line)[::2], count)
        lines.append(line)
    for finer in lines[-2::-1]:
        line = blocks(finer | np.repeat(line, 2), 1)
    return np.repeat(line, 2)


def test_nothing_farther_than_the_radius_has_an_influence() -> None:
    reach = network.radius(TINY)
    side = 16 * ((2 * reach + 48) // 16)
    farthest = [
        np.abs(np.nonzero(reached(place, side))[0] - place).max()
        for place in range(side // 2 - 8, side // 2 + 8)
    ]
    assert max(farthest) == reach
    weights = random_weights(TINY)
    picture = np.random.default_rng(1).uniform(0.5, 1.5, (1, side, side, 3)).astype(np.float32)
    changed = picture.copy()
    place = side // 2
    changed[0, place, place] *= 30.0
    one, two = (np.asarray(network.forward(weights, p, "lobes")[0]) for p in (picture, changed))
    rows, columns = np.nonzero((np.abs(one - two) > 1e-6).any(axis=(-1, -2))[0])  # rounding
    seen = max(np.abs(rows - place).max(), np.abs(columns - place).max())
    assert reach / 4 < seen <= reach
