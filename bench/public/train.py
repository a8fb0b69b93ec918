"""Train a network on a dataset, or compare what helps it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from malus.bench.learning.options import TrainingOptions, check_packages
from malus.bench.running.progress import Progress, silent

if TYPE_CHECKING:
    from malus.bench.learning.train import Training


def train(
    dataset: Path | str,
    out: Path | str,
    options: TrainingOptions | None = None,
    progress: Progress = silent,
    begin_from: Path | str | None = None,
) -> Training:
    """Train a small network that tells polarisation from one unpolarised picture.

    It sees pictures in linear light and learns s1/s0 and s2/s0 of their pixels, and how sure it is.
    Every step sees new variants of the pictures: mirrored, turned and scaled (which turns s1, s2),
    in other colours, blurred, saturated, noisy, compressed. The split `val` decides which weights
    are kept, those before the first step among them. A training that was stopped goes on with the
    same call.

    Parameters
    ----------
    dataset : path of a folder
        Of a dataset in three bands with splits `train` and `val`, as random suites have.
    out : path
        Of the model, an ONNX file of 3.7 MB at the default width. Beside it are written its recipe
        and history (.json) and its loss curve (.svg); `OUT.training` holds the state until it is
        finished.
    options : TrainingOptions, optional
        How long and how to train; by default as in `TrainingOptions()`.
    progress : function of (steps done, steps in all, label)
    begin_from : path, optional
        A model that `train` has written: training goes on from its weights in place of random ones,
        as on further scenes. `width` and `prior` of the options must be the model's; without
        options they are. The recipe holds the model's SHA-256 and its own recipe.

    Returns
    -------
    Training
        The model's file, how good it is, and the history.

    Raises
    ------
    InputError
        Missing packages, a dataset that cannot be trained on, a file that cannot be written, or a
        model that cannot be begun from.

    Examples
    --------
    >>> import malus
    >>> malus.train("quick-dataset", "net.onnx", TrainingOptions(steps=100))
    Traceback (most recent call last):
        ...
    malus.scenes.core.errors.InputError: quick-dataset/dataset.json: expected a readable file, ...
    """
    check_packages()
    from malus.bench.learning.train import train_model

    parent = None if begin_from is None else Path(begin_from)
    return train_model(Path(dataset), Path(out), options, progress, parent)


def shape_of(model: Path | str) -> dict[str, Any]:
    """Options of a model that whoever goes on from it must repeat: `width` and `prior`.

    Raises
    ------
    InputError
        Missing packages, or a file that is no model of `train`.

    Examples
    --------
    >>> shape_of("no.onnx")
    Traceback (most recent call last):
        ...
    malus.scenes.core.errors.InputError: no.onnx: expected a model of malus train, found ...
    """
    check_packages()
    from malus.bench.learning.model_file import read_model

    return read_model(Path(model)).architecture._asdict()


def ablate(
    dataset: Path | str,
    options: TrainingOptions | None = None,
    progress: Progress = silent,
) -> list[dict[str, Any]]:
    """Train several networks that differ in one thing each, and compare their skill.

    Parameters
    ----------
    dataset : path of a folder
    options : TrainingOptions, optional
        Of the first network; the others differ in the prior, or in how far pictures are turned.
        Where the first is one of them, it is trained once.
        All take as many steps as the first.
    progress : function of (steps done, steps in all, label)

    Returns
    -------
    list of dict
        With `row`, `steps`, median skill on `val` and `test`, and the share of scenes that are
        `above_guess`.

    Raises
    ------
    InputError
        As `train`.

    Examples
    --------
    >>> from malus.bench.learning.options import TrainingOptions
    >>> ablate("quick-dataset", TrainingOptions(steps=10))
    Traceback (most recent call last):
        ...
    malus.scenes.core.errors.InputError: quick-dataset/dataset.json: expected a readable file, ...
    """
    check_packages()
    from malus.bench.learning.train import ablation

    return list(ablation(Path(dataset), options or TrainingOptions(), progress))
