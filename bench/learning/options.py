"""What a training is told, and the package that it needs."""

from __future__ import annotations

import importlib.util
import math
from dataclasses import dataclass
from pathlib import Path

from malus.scenes.core.errors import InputError

PRIORS = ("none", "lobes")
"""Inputs beside colour and brightness: none, or cheap signs of which lobe a pixel shows."""

PACKAGES = ("jax", "optax", "onnx", "onnxruntime")
"""Packages of the extra `learn`."""

SECONDS = 600.0
"""Time that a training takes by default."""

DEFAULT_MODEL = Path("net.onnx")
"""File that `malus train` writes where none is named."""

SMALLEST = 16
"""Fewest pixels a side of pictures to train on: the network's coarsest level has one."""


def kept_state(model: Path) -> Path:
    """File in which a training that is not finished is kept, beside its model.

    Examples
    --------
    >>> kept_state(Path("nets/net.onnx")).as_posix()
    'nets/net.onnx.training/state.npz'
    """
    return model.with_name(f"{model.name}.training") / "state.npz"


@dataclass(frozen=True)
class TrainingOptions:
    """Options of a training; every one is written into the recipe beside the weights.

    Attributes
    ----------
    seconds : float or None
        Time for everything after reading the data; the number of steps follows from the speed.
    steps : int or None
        Number of steps, in place of `seconds`: the same seed and machine give the same weights.
    batch : int
        Pictures a step.
    turn_deg : float
        Largest angle by which pictures are turned; small ones keep the prior of upright cameras.
    prior : str
        One of `PRIORS`.
    width : int
        Channels of the network's first level, at half the resolution; the others grow with it.
    seed : int
        Of the first weights, the order of the scenes and how they are varied.
    rate : float
        Largest learning rate; to go on from a trained model less is enough, such as 3e-4.
    side : int or None
        Pixels a side that pictures are reduced to, a divisor of theirs; None for as rendered. The
        mean of four pixels has half the noise, and a step takes a quarter of the time.

    Raises
    ------
    InputError
        A value that is not valid.

    Examples
    --------
    >>> TrainingOptions(steps=100).seconds is None
    True
    """

    seconds: float | None = None
    steps: int | None = None
    batch: int = 32
    turn_deg: float = 20.0
    prior: str = "none"
    width: int = 32
    seed: int = 0
    rate: float = 1e-3
    side: int | None = None

    def __post_init__(self) -> None:
        """Check the values; without seconds and steps it takes `SECONDS`."""
        if self.seconds is not None and self.steps is not None:
            raise InputError("seconds, steps", "one of them", "both", "leave one out")
        if self.seconds is None and self.steps is None:
            object.__setattr__(self, "seconds", SECONDS)
        if self.seconds is not None and not 0 < self.seconds < math.inf:
            raise InputError("seconds", "a time above 0", f"{self.seconds:g}", "choose another")
        if self.prior not in PRIORS:
            raise InputError("prior", " or ".join(PRIORS), repr(self.prior), "choose one of them")
        if not 0 <= self.turn_deg <= 180:
            expected = "degrees from 0 to 180"
            raise InputError("turn_deg", expected, f"{self.turn_deg:g}", "choose another angle")
        if not 0 <= self.rate <= 1:
            raise InputError("rate", "a number from 0 to 1", f"{self.rate:g}", "choose another")
        for name, least, most in (("batch", 1, 4096), ("width", 4, 128), ("seed", 0, 2**28)):
            _check_whole(name, getattr(self, name), least, most)
        if self.side is not None:
            _check_whole("side", self.side, SMALLEST, 4096)
        if self.steps is not None:
            _check_whole("steps", self.steps, 1, 10**9)


def _check_whole(name: str, value: int, least: int, most: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        expected = f"a whole number from {least} to {most}"
        raise InputError(name, expected, f"{value}", f"choose another {name}")


def check_packages() -> None:
    """Raise InputError that says what to install where a package of the extra is missing."""
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        found, hint = f"no {', '.join(missing)}", 'pip install "malus[learn]"'
        raise InputError("training", f"the packages {', '.join(PACKAGES)}", found, hint)
