"""Train a network on a dataset, write its model file, recipe and loss curve; compare priors."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from malus.bench.learning.arrays import Weights
from malus.bench.learning.devices import described, use_cores
from malus.bench.learning.examples import Examples, read_examples, splits_of
from malus.bench.learning.kept import KeptTraining
from malus.bench.learning.model_file import Model, facts_in, read_model, write_model
from malus.bench.learning.network import STRIDE, Architecture, operations, radius, rounded
from malus.bench.learning.options import TrainingOptions
from malus.bench.learning.training import Progressed, fit, start
from malus.bench.learning.validation import MAGNIFICATIONS, measured
from malus.bench.running.progress import Progress
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.reports.figures.learning import figure_learning
from malus.reports.figures.style import svg
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import replace_text
from malus.scenes.core.versions import versions

FORMAT = 1
"""Version of the facts in a model file."""

TEST = "test"
"""Split on which nothing is decided."""


@dataclass(frozen=True)
class Training:
    """A finished training.

    Attributes
    ----------
    model : Path
        The ONNX file.
    facts : dict
        How good it is, and the recipe it was made by; the metadata `malus` of the file, too.
    history : list of dict
        One row a validation: step, loss (but for the first, before any step), skill, calibration.

    Examples
    --------
    >>> Training(Path("net.onnx"), {"validation_skill": 0.5}, []).skill
    0.5
    """

    model: Path
    facts: dict[str, Any]
    history: list[dict[str, float]]

    @property
    def skill(self) -> float:
        """Median skill over the scenes of the split `val`."""
        return float(self.facts["validation_skill"])


class Data(NamedTuple):
    """The pictures of a dataset's splits; `test` is None where there is no such split."""

    dataset: Dataset
    train: Examples
    val: Examples
    test: Examples | None
    counts: dict[str, int]


def read_data(folder: Path, options: TrainingOptions, progress: Progress) -> Data:
    """Read the splits of a dataset.

    Raises
    ------
    InputError
        A dataset without splits train and val, or not of three bands, or damaged; no polarised
        light in the split val; a side that does not divide that of the pictures.
    """
    dataset = open_folder(folder)
    counts = splits_of(dataset)

    def read(split: str) -> Examples:
        return read_examples(dataset, split, options.seed, progress, options.side)

    train, val = read("train"), read("val")
    if not val.light[val.mask][..., 1:].any() or not train.mask.any():
        hint = "render a suite with polarised light"
        raise InputError(str(folder), "polarised light in train and val", "none", hint)
    test = read(TEST) if counts.get(TEST) else None
    return Data(dataset, train, val, test, counts)


def train_model(
    folder: Path,
    model: Path,
    options: TrainingOptions | None,
    progress: Progress,
    begin_from: Path | None = None,
) -> Training:
    """Train on a dataset and write MODEL, and MODEL's name with .json and .svg beside it.

    Raises
    ------
    InputError
        See `read_data`, `read_model` and `KeptTraining.read`; a file of another kind, or that
        cannot be written, or a finished model of other data or options in its place; options of
        another network than that to begin from.
    """
    _check_out(model)
    _check_beside(model)
    use_cores()
    began = time.monotonic()
    parent = None if begin_from is None else read_model(begin_from)
    options = _agreed(options, parent)
    data = read_data(folder, options, progress)
    if begin_from is None or begin_from.resolve() != model.resolve():
        _check_replaced(model, data, options, parent)
    kept = KeptTraining(model, _identity(data, options, parent), began)
    training = fit(
        data.train,
        data.val,
        options,
        progress,
        kept.write,
        kept.read(start(options)),
        parent and parent.weights,
    )
    weights = rounded(training.best)
    facts = _facts(data, options, weights)
    facts["recipe"] = _recipe(data, options, training, kept.seconds)
    if parent is not None:
        facts["recipe"]["from"] = {"sha256": parent.sha256, "recipe": parent.recipe}
    architecture = Architecture(options.width, options.prior)
    write_model(model, weights, architecture, facts["calibration"], facts)
    history = training.history
    text = json.dumps(facts | {"history": history}, indent=1)
    replace_text(model.with_suffix(".json"), text + "\n")
    replace_text(model.with_suffix(".svg"), svg(figure_learning(history, model.stem)))
    kept.remove()
    return Training(model, facts, history)


def _check_out(model: Path) -> None:
    """Refuse, before anything is read, a model file that could not be written after hours."""
    if model.suffix != ".onnx" or model.is_dir():
        raise InputError("out", "the name of a file that ends in .onnx", str(model), "choose one")
    try:
        model.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=model.parent).close()
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError("out", "a folder that can be written", reason, "choose another") from None


def _check_beside(model: Path) -> None:
    """Refuse to replace files that no training has written.

    Raises
    ------
    InputError
        Naming the first of them.
    """
    is_record = _is_record(model.with_suffix(".json"))
    own = {".onnx": facts_in(model) is not None, ".json": is_record, ".svg": is_record}
    for suffix, is_own in own.items():
        path = model.with_suffix(suffix)
        if path.exists() and not is_own:
            hint = "choose another `out`; nothing was changed"
            raise InputError("out", "a new name, or that of a training", str(path), hint)


def _is_record(path: Path) -> bool:
    """Whether a JSON file is the record of a training."""
    with suppress(OSError, ValueError, AttributeError):
        record = json.loads(path.read_text("utf-8"))
        kinds = [type(record.get(key)) for key in ("recipe", "history", "validation_skill")]
        return kinds[:2] == [dict, list] and kinds[2] in (float, int)
    return False


def _check_replaced(
    model: Path, data: Data, options: TrainingOptions, parent: Model | None
) -> None:
    """Refuse to replace a finished model of other data or options: it may have taken hours."""
    facts = facts_in(model)
    if facts is None:
        return
    recipe = facts.get("recipe") or {}
    same = json.loads(json.dumps(asdict(options)))
    dataset, began = ((recipe.get(key) or {}).get("sha256") for key in ("dataset", "from"))
    wanted = (data.dataset.sha256, same, parent and parent.sha256)
    if (dataset, recipe.get("options"), began) != wanted:
        expected, found = "a new name, or the same training", "a model of other data or options"
        raise InputError(f"out {model}", expected, found, "choose another `out`, or remove it")


def _agreed(options: TrainingOptions | None, parent: Model | None) -> TrainingOptions:
    """The options, which must be those of the network to begin from; its own where none are."""
    if parent is None:
        return options or TrainingOptions()
    own = parent.architecture._asdict()
    options = options or TrainingOptions(**own)
    for name, value in own.items():
        given = getattr(options, name)
        if given != value:
            expected = f"{value}, as the model to begin from has"
            raise InputError(name, expected, f"{given}", f"give {value}, or another model")
    return options


def _identity(data: Data, options: TrainingOptions, parent: Model | None) -> dict[str, Any]:
    """What must be the same where a training goes on: else its numbers would be of no recipe."""
    return {
        "dataset": data.dataset.sha256,
        "options": asdict(options),
        "from": parent and parent.sha256,
        "versions": versions("malus", "jax", "optax"),
        "device": described(options.batch),
    }


def _facts(data: Data, options: TrainingOptions, weights: Weights) -> dict[str, Any]:
    """What who runs the network must know: of the stored weights, as method `net` runs them."""
    val = measured(weights, data.val, options.prior, as_run=True)
    test = None if data.test is None else measured(weights, data.test, options.prior, as_run=True)
    usable = np.isfinite(val.calibration) and val.calibration > 0
    architecture = Architecture(options.width, options.prior)
    return {
        "format": FORMAT,
        "validation_skill": round(val.skill, 4),
        "test_skill": None if test is None else round(test.skill, 4),
        "above_guess": round(val.above_guess, 4),
        "calibration": float(np.sqrt(val.calibration)) if usable else 1.0,
        "stride": STRIDE,
        "receptive_radius": radius(architecture),
        "magnifications": MAGNIFICATIONS,
        "resolution": max(data.train.mask.shape[1:]),
        "operations": round(operations(architecture)),
        "weights": sum(int(np.size(w)) for w in weights.values()),
    }


def _recipe(
    data: Data, options: TrainingOptions, training: Progressed, seconds: float
) -> dict[str, Any]:
    """What somebody needs to train the same network again."""
    suite = data.dataset.record.suite or {}
    random = suite.get("random") or {}
    return {
        "dataset": {
            "sha256": data.dataset.sha256,
            "suite": suite.get("name"),
            "seed": random.get("seed"),
            "count": random.get("count"),
            "splits": data.counts,
            "used": {"train": len(data.train.mask), "val": len(data.val.mask)},
            "versions": data.dataset.record.versions,
        },
        "options": asdict(options),
        "steps": training.steps,
        "device": described(options.batch),
        "versions": versions("malus", "jax", "optax", "onnx", "numpy"),
        "seconds": round(seconds, 1),
    }


ABLATION: dict[str, dict[str, Any]] = {
    "as it is": {},
    "inputs of the prior lobes": {"prior": "lobes"},
    "never turned": {"turn_deg": 0.0},
    "turned by any angle": {"turn_deg": 180.0},
}
"""Rows of the ablation: what differs from the options that are given."""

AS_RUN = "as method net runs it"
"""Row of the first network, which is measured twice."""


def ablation(
    folder: Path, options: TrainingOptions, progress: Progress
) -> Iterator[dict[str, Any]]:
    """Train once for each row of `ABLATION` and yield its skill on val and test.

    A row that changes nothing of the options, which the first network has, is left out.

    The first network is also measured as method `net` runs it: with its estimates for a picture
    and its mirror image averaged, at each of `MAGNIFICATIONS`.
    """
    use_cores()
    data = read_data(folder, options, progress)
    for row, change in ABLATION.items():
        own = replace(options, **change)
        if change and own == options:
            continue  # the first network is this one
        training = fit(data.train, data.val, own, progress, lambda _: None)
        # What the first could afford, all get.
        options = replace(options, seconds=None, steps=training.steps)
        weights = rounded(training.best)
        yield _compared(row, data, own.prior, weights, training.steps)
        if not change:
            yield _compared(AS_RUN, data, own.prior, weights, training.steps)


def _compared(row: str, data: Data, prior: str, weights: Weights, steps: int) -> dict[str, Any]:
    as_run = row == AS_RUN
    val = measured(weights, data.val, prior, as_run)
    test = None if data.test is None else measured(weights, data.test, prior, as_run)
    return {
        "row": row,
        "steps": steps,
        "val": val.skill,
        "test": None if test is None else test.skill,
        "above_guess": val.above_guess,
    }
