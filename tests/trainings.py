"""Data to train on within seconds, and networks of which no weight is zero.

Import it after `pytest.importorskip("jax")`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest

from malus.bench.learning import network, training
from malus.bench.learning.examples import Examples
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


def steps_on_two_devices() -> Iterator[tuple[list[tuple[str, int, str]], bytes]]:
    """Who made how many pictures of a step with which key, and the weights that follow: of two
    devices, and of one that has both parts. To be called in a new process.
    """
    import jax

    jax.config.update("jax_num_cpu_devices", 2)
    random = np.random.default_rng(0)
    light = random.uniform(0, 0.3, (5, 16, 16, 3, 3)).astype(np.float16) + np.float16([1, 0, 0])
    train = Examples(light, np.ones((5, 16, 16), bool), np.zeros(5))
    own, devices = training.augmented, training.sharing(QUICK.batch)
    for those in (devices, devices[:1] * 2):
        seen: list[tuple[str, int, str]] = []

        def noted(key: Any, light: Any, *rest: Any, seen: list[tuple[str, int, str]] = seen) -> Any:
            seen.append((str(light.device), len(light), str(jax.random.key_data(key))))
            return own(key, light, *rest)

        with pytest.MonkeyPatch.context() as changed:
            changed.setattr(training, "augmented", noted)
            changed.setattr(training, "sharing", lambda _, those=those: those)
            state = training.start(QUICK)
            for number in range(2):
                state, _ = training.take_step(train, QUICK, state, number, 1e-2, 0.9)
        yield seen, b"".join(np.asarray(w).tobytes() for w in state.weights.values())


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
