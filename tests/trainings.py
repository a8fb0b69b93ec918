"""Data to train on within seconds, and networks of which no weight is zero.

Import it after `pytest.importorskip("jax")`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime

from malus.bench.learning import network
from malus.bench.learning.model_file import read_model, write_model
from malus.bench.learning.network import Architecture
from malus.bench.learning.options import TrainingOptions

CONTENT: dict[str, Any] = {
    "name": "drawn",
    "description": "Spheres at random",
    "wavelengths_nm": [450, 550, 650],
    "methods": ["unpolarised"],
    "renderer": "torrance-sparrow",
    "camera": {"resolution": 32},
    "random": {
        "count": 40,
        "seed": 1,
        "shapes": [{"kind": "sphere"}],
        "materials": [{"eta": {"uniform": [1.3, 1.8]}}],
        "surfaces": [{"alpha": {"uniform": [0.2, 0.4]}, "albedo": [0.05, 0.1, 0.2]}],
        "lights": [{"kind": "distant", "incidence_deg": {"uniform": [40, 80]}}],
    },
    "splits": {"train": 0.7, "val": 0.2, "test": 0.1, "disjoint": ["material", "light"]},
}
QUICK = TrainingOptions(steps=150, batch=8, width=4)


def random_weights(architecture: Architecture, seed: int = 0) -> dict[str, Any]:
    """Weights of which none is zero: every part of the network has a say."""
    random = np.random.default_rng(seed)
    weights = network.initial_weights(seed, architecture)
    return {
        name: (w + random.normal(0, 0.03, w.shape)).astype(np.float32)
        for name, w in weights.items()
    }


def answers(model: Path) -> list[np.ndarray]:
    """What a model says of one picture: `stokes` and `deviation`."""
    picture = np.random.default_rng(2).uniform(0, 3, (1, 3, 32, 32)).astype(np.float32)
    return onnxruntime.InferenceSession(model).run(None, {"image": picture})


def rewritten(model: Path, other: Path, factor: float, **options: object) -> Path:
    """The same network with its deviations times a factor, and another story of its options."""
    read, facts = read_model(model), json.loads(model.with_suffix(".json").read_text("utf-8"))
    del facts["history"]
    facts["calibration"] *= factor
    facts["recipe"]["options"] |= options
    write_model(other, read.weights, read.architecture, facts["calibration"], facts)
    return other
