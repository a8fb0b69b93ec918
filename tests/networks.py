"""Small networks in ONNX files whose output has a closed form, for tests of the learned method.

`edges` is a convolution: s1/s0 = a (x[v+r] − x[v−r]) down the rows, s2/s0 likewise along the
columns (so that a picture in a mirror has the mirrored polarisation), with an `a` of its own for
every channel, and a deviation of b x + c, with x the normalised picture. So every output follows by
a subtraction of shifted pictures, and depends on pixels up to REACH away. `blocks` pools: its
squares lie where the picture's corner says.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from skimage.transform import resize

REACH = 5
"""How far a pixel's output depends on others."""
SLOPE = 0.1
OF_CHANNEL = np.array([1.0, 0.8, 0.5], np.float32)
"""Factor on the slope of red, green and blue, so that none can be taken for another."""
SURE = (0.05, 0.02)
"""The deviation is SURE[0] + SURE[1] times the normalised light."""
FLOAT = TensorProto.FLOAT


def describe(**changes: object) -> dict[str, object]:
    told = {"format": 1, "recipe": {"of": "a test"}, "validation_skill": 0.5, "stride": 16}
    return told | {"receptive_radius": REACH, "resolution": 32} | changes


def edges(path: Path, slope: float = SLOPE, **changes: object) -> Path:
    """Write that network; `changes` are of its description."""
    across = np.zeros((3, 1, 1, 2 * REACH + 1), np.float32)
    across[..., -1] = slope * OF_CHANNEL[:, None, None]
    across[..., 0] = -across[..., -1]
    constants = {"across": across, "down": np.swapaxes(across, 2, 3), **_SURE}
    nodes = [
        helper.make_node("Conv", ["image", "across"], ["s2"], group=3, pads=[0, REACH, 0, REACH]),
        helper.make_node("Conv", ["image", "down"], ["s1"], group=3, pads=[REACH, 0, REACH, 0]),
    ]
    return _written(path, nodes, constants, changes)


BLOCK = 16
"""Side of the squares of `blocks`."""


def blocks(path: Path, **changes: object) -> Path:
    """Write a network that pools, as one with several scales does: s1/s0 is SLOPE times the mean
    of the square of BLOCK x BLOCK pixels, counted from the corner, s2/s0 its negative."""
    constants = {
        "spread": np.full((3, 1, BLOCK, BLOCK), SLOPE, np.float32),
        "minus": np.float32(-1),
        **_SURE,
    }
    sides = [BLOCK, BLOCK]
    nodes = [
        helper.make_node("AveragePool", ["image"], ["mean"], kernel_shape=sides, strides=sides),
        helper.make_node("ConvTranspose", ["mean", "spread"], ["s1"], group=3, strides=sides),
        helper.make_node("Mul", ["s1", "minus"], ["s2"]),
    ]
    return _written(path, nodes, constants, {"receptive_radius": BLOCK - 1} | changes)


def blocks_by_hand(normalised: np.ndarray) -> np.ndarray:
    """s1/s0 of that network for sides that are multiples of BLOCK."""
    rows, columns = (side // BLOCK for side in normalised.shape[:2])
    mean = normalised.reshape(rows, BLOCK, columns, BLOCK, 3).mean(axis=(1, 3))
    return SLOPE * mean.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)


def magnified(maps: np.ndarray, magnification: float) -> np.ndarray:
    """Maps (height, width, channels) at a larger size, interpolated between pixel centres."""
    height, width = (round(magnification * length) for length in maps.shape[:2])
    return resize(maps, (height, width, maps.shape[2]), order=1, mode="edge")


def brought_back(maps: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Such maps at the size they had before: means under a triangle two of its pixels wide."""
    down, across = (_triangles(*each) for each in zip(maps.shape[:2], size, strict=True))
    return np.einsum("ri,ijc,kj->rkc", down, maps, across)


def _triangles(length: int, wanted: int) -> np.ndarray:
    step = length / wanted
    centres = step * (np.arange(wanted) + 0.5) - 0.5
    weights = np.maximum(0, 1 - np.abs(np.arange(length) - centres[:, None]) / step)
    return weights / weights.sum(axis=1, keepdims=True)


_SURE = {"b": np.float32(SURE[1]), "c": np.float32(SURE[0])}


def _written(
    path: Path, nodes: list[Any], constants: dict[str, Any], changes: dict[str, object]
) -> Path:
    """Write nodes that make s1 and s2 of the image, with the deviation, as a whole network."""
    nodes = [
        *nodes,
        helper.make_node("Concat", ["s1", "s2"], ["stokes"], axis=1),
        helper.make_node("Mul", ["image", "b"], ["scaled"]),
        helper.make_node("Add", ["scaled", "c"], ["deviation"]),
    ]
    sides = [("stokes", 6), ("deviation", 3)]
    graph = helper.make_graph(
        nodes,
        "stand-in",
        [helper.make_tensor_value_info("image", FLOAT, [1, 3, "h", "w"])],
        [helper.make_tensor_value_info(name, FLOAT, [1, n, "h", "w"]) for name, n in sides],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    entry = model.metadata_props.add()
    entry.key, entry.value = "malus", json.dumps(describe(**changes))
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return path


def edges_by_hand(normalised: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What that network makes of a normalised picture (height, width, 3), by shifted pictures."""
    height, width = normalised.shape[:2]
    around = np.zeros((height + 2 * REACH, width + 2 * REACH, 3))
    around[REACH:-REACH, REACH:-REACH] = normalised
    inner = slice(REACH, -REACH)
    slope = SLOPE * OF_CHANNEL
    s1 = slope * (around[2 * REACH :, inner] - around[: -2 * REACH, inner])
    s2 = slope * (around[inner, 2 * REACH :] - around[inner, : -2 * REACH])
    return s1, s2, SURE[0] + SURE[1] * normalised
