"""Small networks in ONNX files whose output has a closed form, for tests of the learned method.

`edges` is a convolution chain: s1/s0 = a (x[u+r] − x[u−r]) of red, likewise down the rows for s2,
channel by channel, and a deviation of b x + c, with x the normalised picture. So every output
follows by a subtraction of shifted pictures, and depends on pixels up to `reach` away.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

REACH = 5
"""How far a pixel's output depends on others."""
SLOPE = 0.1
SURE = (0.05, 0.02)
"""The deviation is SURE[0] + SURE[1] times the normalised light."""
FLOAT = TensorProto.FLOAT


def describe(**changes: object) -> dict[str, object]:
    told = {"format": 1, "recipe": {"of": "a test"}, "validation_skill": 0.5, "stride": 16}
    return told | {"receptive_radius": REACH, "resolution": 32} | changes


def edges(path: Path, slope: float = SLOPE, **changes: object) -> Path:
    """Write that network; `changes` are of its description."""
    across = np.zeros((3, 1, 1, 2 * REACH + 1), np.float32)
    across[..., -1], across[..., 0] = slope, -slope
    down = np.swapaxes(across, 2, 3)
    constants = {"across": across, "down": down, "b": np.float32(SURE[1]), "c": np.float32(SURE[0])}
    nodes = [
        helper.make_node("Conv", ["image", "across"], ["s1"], group=3, pads=[0, REACH, 0, REACH]),
        helper.make_node("Conv", ["image", "down"], ["s2"], group=3, pads=[REACH, 0, REACH, 0]),
        helper.make_node("Concat", ["s1", "s2"], ["stokes"], axis=1),
        helper.make_node("Mul", ["image", "b"], ["scaled"]),
        helper.make_node("Add", ["scaled", "c"], ["deviation"]),
    ]
    sides = [("stokes", 6), ("deviation", 3)]
    graph = helper.make_graph(
        nodes,
        "edges",
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
    s1 = SLOPE * (around[inner, 2 * REACH :] - around[inner, : -2 * REACH])
    s2 = SLOPE * (around[2 * REACH :, inner] - around[: -2 * REACH, inner])
    return s1, s2, SURE[0] + SURE[1] * normalised
