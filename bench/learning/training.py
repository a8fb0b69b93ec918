"""The training itself: steps of gradient descent on new examples, validated as it goes.

The best weights are those of the highest median skill over the scenes of the split `val`, those
before the first step among them: a training never ends worse than it began. All of a
training's state is kept at every validation, and what is drawn at random depends on the seed and
the number of the step alone: a training that was stopped goes on as if it had not been.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from malus.bench.learning.arrays import JaxArray, Weights
from malus.bench.learning.augment import Batch, augmented
from malus.bench.learning.devices import mean_on_first, sharing
from malus.bench.learning.examples import Examples
from malus.bench.learning.network import STRIDE, Architecture, forward, initial_weights
from malus.bench.learning.objective import loss
from malus.bench.learning.options import TrainingOptions
from malus.bench.learning.validation import Measured, measured
from malus.bench.running.progress import Progress
from malus.scenes.core.errors import InputError

VALIDATIONS = 20
"""Times that the weights are validated and kept."""

_WARM_UP = 0.04
_LARGEST_SIDE = 128
_TIMED_STEPS = 4
_WEIGHT_DECAY = 0.05
_TOGETHER = 10
"""Steps that are under way at once."""


class State(NamedTuple):
    """What changes from step to step; `average` are the mean weights of the last steps."""

    weights: Weights
    average: Weights
    optimiser: Any


class Progressed(NamedTuple):
    """A training up to a step, as it is kept on disk.

    `steps` is the number that there will be; `history` has one row a validation, the first before
    any step.
    """

    state: State
    best: Weights
    step: int
    steps: int
    history: list[dict[str, float]]


Keep = Callable[[Progressed], None]
"""Keeps a training, so that it can go on after it was stopped."""


def start(options: TrainingOptions, weights: Weights | None = None) -> State:
    """The state before the first step, of weights that are given or drawn at random."""
    if weights is None:
        weights = initial_weights(options.seed, Architecture(options.width, options.prior))
    return State(weights, weights, _optimiser().init(weights))


def fit(
    train: Examples,
    val: Examples,
    options: TrainingOptions,
    progress: Progress,
    keep: Keep,
    kept: Progressed | None = None,
    begin: Weights | None = None,
) -> Progressed:
    """Train from the start, or on from what was kept.

    Parameters
    ----------
    train, val : Examples
    options : TrainingOptions
    progress : function of (steps done, steps in all, label)
    keep : function that keeps the training, called at every validation
    kept : Progressed, optional
    begin : dict of arrays, optional
        Weights to begin with, where nothing was kept, in place of random ones.
    """
    began = time.monotonic()
    one_step = partial(take_step, train, options)
    if kept is None:
        state = start(options, begin)
        steps = options.steps or _affordable(one_step, val, state, options, began)
        first_row = _row(0, [], measured(state.average, val, options.prior))
        if not np.isfinite(first_row["skill"]):
            expected, hint = "scenes polarised beyond their noise", "render them with more samples"
            raise InputError("split val", expected, "none", hint)
        kept = Progressed(state, state.average, 0, steps, [first_row])
    state, best, first, steps, history = kept
    every = max(1, steps // VALIDATIONS)
    losses = []
    for step in range(first, steps):
        state, error = one_step(state, step, *_rates(step, steps, options.rate))
        losses.append(error)
        if step % _TOGETHER == 0:
            error.block_until_ready()
            progress(step, steps, _label(history))
        if (step + 1) % every == 0 or step + 1 == steps:
            found = measured(state.average, val, options.prior)
            if found.skill >= max((row["skill"] for row in history), default=-np.inf):
                best = state.average
            history.append(_row(step + 1, losses, found))
            keep(Progressed(state, best, step + 1, steps, history))
            losses = []
    return Progressed(state, best, steps, steps, history)


def _row(step: int, losses: list[JaxArray], found: Measured) -> dict[str, float]:
    """A row of the history; without losses, before the first step, it has none."""
    row = {"step": step, "skill": found.skill, "calibration": found.calibration}
    if losses:
        row["loss"] = float(np.mean([float(one) for one in losses]))
    return row


def _label(history: list[dict[str, float]]) -> str:
    return f"steps, skill {history[-1]['skill']:.3f}" if history else "steps"


def _rates(step: int, steps: int, largest: float) -> tuple[float, float]:
    """Learning rate of a step, warmed up and then a cosine; and decay of the mean weights."""
    share = (step + 0.5) / steps
    rate = largest * min(share / _WARM_UP, 1.0) * 0.5 * (1 + np.cos(np.pi * share))
    return float(rate), min(0.999, (1 + step) / (10 + step))


def _optimiser() -> Any:
    """Adam with gradients of bounded length and decaying weights; the rate is applied outside."""
    return optax.chain(
        optax.clip_by_global_norm(1.0),
        optax.scale_by_adam(b2=0.99),
        optax.add_decayed_weights(_WEIGHT_DECAY),
    )


def side_of(examples: Examples) -> int:
    """Pixels a side of the pictures that the network is trained on."""
    return min(_LARGEST_SIDE, max(STRIDE, min(examples.mask.shape[1:]) // STRIDE * STRIDE))


def take_step(
    train: Examples,
    options: TrainingOptions,
    state: State,
    number: int,
    rate: float,
    decay: float,
) -> tuple[State, JaxArray]:
    """The state after one more step, and the error on its examples before it."""
    # The pictures stay in the memory of the machine: of many devices each would need all of them.
    random = np.random.default_rng((options.seed, number))
    chosen = random.integers(len(train.mask), size=options.batch)
    key = jax.random.fold_in(jax.random.key(options.seed), number)
    devices = sharing(options.batch)
    found = []
    for own, indices, device in zip(
        jax.random.split(key, len(devices)), np.split(chosen, len(devices)), devices, strict=True
    ):
        given = (own, train.light[indices], train.mask[indices], state.weights)
        own, light, mask, weights = jax.device_put(given, device)
        examples = augmented(own, light, mask, options.turn_deg, side_of(train))
        found.append(_error_and_gradient(options.prior, weights, examples))
    error, gradient = mean_on_first(found)
    return _descended(state, gradient, rate, decay), error


@partial(jax.jit, static_argnums=0)
def _error_and_gradient(prior: str, weights: Weights, examples: Batch) -> tuple[JaxArray, Weights]:
    # Half the memory traffic, where the device has units for it.
    dtype = jnp.bfloat16 if jax.default_backend() == "gpu" else jnp.float32

    def error(weights: Weights) -> JaxArray:
        return loss(*forward(weights, examples.picture, prior, dtype), examples)

    found: tuple[JaxArray, Weights] = jax.value_and_grad(error)(weights)
    return found


@partial(jax.jit)
def _descended(state: State, gradient: Weights, rate: float, decay: float) -> State:
    change_by, memory = _optimiser().update(gradient, state.optimiser, state.weights)
    weights = jax.tree.map(lambda w, u: w - rate * u, state.weights, change_by)
    average = jax.tree.map(lambda a, w: decay * a + (1 - decay) * w, state.average, weights)
    return State(weights, average, memory)


def _affordable(
    one_step: Any, val: Examples, state: State, options: TrainingOptions, began: float
) -> int:
    """Number of steps in the time that is given, from the speed of a few that are thrown away."""
    assert options.seconds is not None
    trial = one_step(state, 0, *_rates(0, 100, options.rate))[1].block_until_ready()  # compiles
    measured(state.average, val, options.prior)
    started = time.monotonic()
    for number in range(_TIMED_STEPS):
        trial = one_step(state, number, *_rates(number, 100, options.rate))[1]
    trial.block_until_ready()
    a_step = (time.monotonic() - started) / _TIMED_STEPS
    started = time.monotonic()
    measured(state.average, val, options.prior)
    validating = (1 + VALIDATIONS) * (time.monotonic() - started)
    left = options.seconds - (time.monotonic() - began) - validating
    return max(VALIDATIONS, int(left / a_step))
