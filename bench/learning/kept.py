"""Keep a training beside its model, so that the same command goes on after it was stopped."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

from malus.bench.learning.options import kept_state
from malus.bench.learning.training import Progressed, State
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.files import replace_file


class KeptTraining:
    """The folder MODEL.training, which is there while a training is not finished.

    Parameters
    ----------
    model : Path
        Of the model file.
    about : dict
        What makes the training this one: data, options, versions and device.
    began : float
        When this session began, by `time.monotonic`.
    """

    def __init__(self, model: Path, about: dict[str, Any], began: float) -> None:
        self._state = kept_state(model)
        self.folder = self._state.parent
        self._about = json.dumps(about, sort_keys=True)
        self._began = began

    @property
    def seconds(self) -> float:
        """Time that the training has taken, in all its sessions."""
        return time.monotonic() - self._began

    def write(self, training: Progressed) -> None:
        """Keep a training, whole or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        leaves = jax.tree.leaves((training.state, training.best))
        arrays: dict[str, Any] = {f"a{number}": np.asarray(a) for number, a in enumerate(leaves)}
        numbers = {"step": training.step, "steps": training.steps, "history": training.history}
        numbers["seconds"] = self.seconds
        texts = {"about": self._about, "numbers": json.dumps(numbers)}
        arrays |= {name: np.array(text) for name, text in texts.items()}
        replace_file(self._state, lambda path: np.savez(path, **arrays))

    def read(self, start: State) -> Progressed | None:
        """The training that was kept, if there is one; `start` is a state of the same network.

        Raises
        ------
        InputError
            One with other data, options, versions or device, or a damaged one.
        """
        path = self._state
        if not path.exists():
            return None
        again = f"remove the folder {self.folder} to begin anew"
        with reading(str(path), "the state of a training", again), np.load(path) as stored:
            arrays = {name: stored[name] for name in stored.files}
            about, numbers = str(arrays.pop("about")), json.loads(str(arrays.pop("numbers")))
        if about != self._about:
            expected, found = "the data, options, versions and device of that training", "others"
            raise InputError(str(self.folder), expected, found, f"give those, or {again}")
        structure = jax.tree.structure((start, start.average))
        with reading(str(path), "the state of a training", again):
            leaves = [arrays[f"a{number}"] for number in range(structure.num_leaves)]
            state, best = jax.tree.unflatten(structure, leaves)
        self._began -= numbers["seconds"]
        return Progressed(state, best, numbers["step"], numbers["steps"], numbers["history"])

    def remove(self) -> None:
        """Remove the folder: the training is finished."""
        shutil.rmtree(self.folder, ignore_errors=True)
