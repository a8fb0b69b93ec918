"""Write a trained network as one ONNX file, with its recipe in the metadata, and read it back.

Input `image`: float32 (1, 3, height, width), sides multiples of 16; red, green, blue in linear
light, over the mean of the valid pixels of the whole picture. Outputs `stokes` (1, 6, height,
width): s1/s0 of red, green, blue, then s2/s0; `deviation` (1, 3, height, width): their standard
deviations. Weights are stored in half precision and used in single.
"""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx
from numpy.typing import ArrayLike
from onnx import TensorProto, helper, numpy_helper

from malus.bench.learning.arrays import Weights
from malus.bench.learning.network import (
    DIM,
    FOLD,
    LEAST_DEVIATION,
    MOST,
    SLOPE,
    Architecture,
    layers,
)
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.files import replace_file

KEY = "malus"
"""Name of the metadata that holds the facts."""

_OPSET = 18
_IR_VERSION = 8
"""Versions that runtimes since 2023 read."""


def write_model(
    path: Path,
    weights: Weights,
    architecture: Architecture,
    calibration: float,
    facts: dict[str, Any],
) -> None:
    """Write a network to a file, whole or not at all.

    Parameters
    ----------
    weights : dict of arrays, see `network.initial_weights`
    architecture : Architecture
    calibration : float
        Factor on the deviations.
    facts : dict
        Written as JSON into the metadata `malus`.
    """
    graph = _Graph()
    graph.write(weights, architecture, calibration)
    sides = ["height", "width"]
    model = helper.make_model(
        helper.make_graph(
            graph.nodes,
            "malus",
            [_tensor("image", 3, sides)],
            [_tensor("stokes", 6, sides), _tensor("deviation", 3, sides)],
            graph.constants,
        ),
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
        producer_name="malus",
    )
    helper.set_model_props(model, {KEY: json.dumps(facts, sort_keys=True)})
    onnx.checker.check_model(model, full_check=True)
    replace_file(path, lambda temporary: temporary.write_bytes(model.SerializeToString()))


class Model(NamedTuple):
    """A network that was read back; its weights are those before the factor on the deviations.

    `sha256` is that of the file, `recipe` what the network was made by.
    """

    weights: Weights
    architecture: Architecture
    sha256: str
    recipe: dict[str, Any]


def read_model(path: Path) -> Model:
    """Read a file of `write_model`.

    Raises
    ------
    InputError
        A file that cannot be read, or of which this version would not write every node and number.
    """
    expected, hint = "a model of malus train", "give a file that malus train has written"
    with reading(str(path), expected, hint):
        content = path.read_bytes()
        model = onnx.load_from_string(content)
        facts = {entry.key: entry.value for entry in model.metadata_props}
        if KEY not in facts:
            raise InputError(str(path), expected, f"no recipe (metadata {KEY})", hint)
        told = json.loads(facts[KEY])
        options = told["recipe"]["options"]
        architecture = Architecture(options["width"], options["prior"])
        weights = _stored_weights(model.graph, architecture)
        again = _Graph()
        again.write(weights, architecture, told["calibration"])
        same = again.nodes == list(model.graph.node)
        same = same and again.constants == list(model.graph.initializer)
    if not same or not all(np.isfinite(w).all() for w in weights.values()):
        raise InputError(str(path), expected, "another network than its recipe tells", hint)
    return Model(weights, architecture, hashlib.sha256(content).hexdigest(), told["recipe"])


def facts_in(path: Path) -> dict[str, Any] | None:
    """Facts of a file of `write_model`; None of any other file."""
    with suppress(Exception):
        model = onnx.load_from_string(path.read_bytes())
        facts = {entry.key: entry.value for entry in model.metadata_props}
        told = json.loads(facts[KEY])
        return told if isinstance(told, dict) else None
    return None


def _stored_weights(graph: Any, architecture: Architecture) -> Weights:
    """Weights by layer, of what a graph holds in half precision, in the order of the layers."""
    stored = [c for c in graph.initializer if c.data_type == TensorProto.FLOAT16]
    weights: Weights = {}
    for layer, kernel, bias in zip(layers(architecture), stored[::2], stored[1::2], strict=True):
        shape = [layer.outputs, layer.inputs, layer.kernel, layer.kernel]
        if list(kernel.dims) != shape or list(bias.dims) != shape[:1]:
            raise ValueError(f"{layer.name} of shape {list(kernel.dims)} instead of {shape}")
        turned = numpy_helper.to_array(kernel).transpose(2, 3, 1, 0)
        weights[f"{layer.name}.kernel"] = turned.astype(np.float32)
        weights[f"{layer.name}.bias"] = numpy_helper.to_array(bias).astype(np.float32)
    return weights


def _tensor(name: str, channels: int, sides: list[str]) -> Any:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, channels, *sides])


class _Graph:
    """Nodes and constants of a graph; every method adds one operation and returns its result."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def write(self, weights: Weights, architecture: Architecture, calibration: float) -> None:
        """Add the whole network, as `network.forward` has it."""
        self._weights = weights
        squares = self._call("SpaceToDepth", self._features(architecture), blocksize=FOLD)
        values = self._conv("stem", squares)
        levels = [values]
        for layer in list(layers(architecture))[1:-1]:
            if layer.step == 2:
                values = self._conv(layer.name, values, 2)
            elif layer.name.startswith("up") and layer.kernel == 1:
                level = int(layer.name.removeprefix("up"))
                values = self._enlarged(self._conv(layer.name, values))
                values = self._call("Add", levels[level], values)
            elif layer.name.endswith("a"):
                inner = self._conv(layer.name, self._activated(values))
            else:
                inner = self._conv(layer.name, self._activated(inner))
                values = self._call("Add", values, inner)
                self._keep(levels, layer.name, values)
        head = self._conv("head", self._activated(values))
        pixels = self._call("DepthToSpace", head, blocksize=FOLD, mode="DCR")
        self._answers(pixels, calibration)

    @staticmethod
    def _keep(levels: list[str], name: str, values: str) -> None:
        """Remember what the last block on the way down made of its level."""
        if name.startswith("down"):
            level = int(name.removeprefix("down")[0])
            levels[level:] = [values]

    def _call(self, operation: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        output = name or f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(operation, list(inputs), [output], **attributes))
        return output

    def _constant(self, values: ArrayLike, dtype: Any = np.float32) -> str:
        name = f"c{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(values, dtype), name))
        return name

    def _conv(self, name: str, values: str, step: int = 1) -> str:
        kernel = np.asarray(self._weights[f"{name}.kernel"]).transpose(3, 2, 0, 1)
        side = kernel.shape[-1]
        stored = [self._constant(kernel, np.float16)]
        stored.append(self._constant(self._weights[f"{name}.bias"], np.float16))
        used = [self._call("Cast", constant, to=TensorProto.FLOAT) for constant in stored]
        pads, steps = [side // 2] * 4, [step, step]
        return self._call(
            "Conv", values, *used, kernel_shape=[side, side], pads=pads, strides=steps
        )

    def _activated(self, values: str) -> str:
        return self._call("LeakyRelu", values, alpha=SLOPE)

    def _enlarged(self, values: str) -> str:
        scales = self._constant([1.0, 1.0, 2.0, 2.0])
        how = {"coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"}
        return self._call("Resize", values, "", scales, mode="nearest", **how)

    def _features(self, architecture: Architecture) -> str:
        channels = self._constant([1], np.int64)
        light = self._call("Max", "image", self._constant(0.0))
        bright = self._call("Log", self._call("Add", light, self._constant(DIM)))
        lifted = self._call("Add", light, self._constant(DIM / 3))
        total = self._call("ReduceSum", lifted, channels, keepdims=1)
        tripled = self._call("Mul", lifted, self._constant(3.0))
        shares = self._call("Sub", self._call("Div", tripled, total), self._constant(1.0))
        parts = [bright, shares]
        if architecture.prior == "lobes":
            parts.append(self._call("ReduceMin", shares, channels, keepdims=1))
            parts.append(self._call("ReduceMax", shares, channels, keepdims=1))
        return self._call("Concat", *parts, axis=1)

    def _answers(self, raw: str, calibration: float) -> None:
        sizes = self._constant([3, 3, 3], np.int64)
        parts = [f"raw{k}" for k in range(3)]
        self.nodes.append(helper.make_node("Split", [raw, sizes], parts, axis=1))
        squares = [self._call("Mul", part, part) for part in parts[:2]]
        length = self._call("Add", self._call("Add", *squares), self._constant(1.0))
        scale = self._call("Div", self._constant(MOST), self._call("Sqrt", length))
        self._call(
            "Concat", *(self._call("Mul", p, scale) for p in parts[:2]), name="stokes", axis=1
        )
        soft = self._call("Softplus", self._call("Sub", parts[2], self._constant(2.0)))
        above = self._call("Add", soft, self._constant(LEAST_DEVIATION))
        self._call("Mul", above, self._constant(calibration), name="deviation")
