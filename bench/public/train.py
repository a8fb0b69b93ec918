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
) -> Training:
    """Train a small network that tells polarisation from one unpolarised picture.

    It sees pictures in linear light and learns s1/s0 and s2/s0 of their pixels, and how sure it is.
    Every step sees new variants of the pictures: mirrored, turned and scaled (which turns s1, s2),
    in other colours, blurred, saturated, noisy, compressed. The split `val` decides which weights
    are kept. A training that was stopped goes on with the same call.

    Parameters
    ----------
    dataset : path of a folder
        Of a dataset in three bands with splits `train` and `val`, as random suites have.
    out : path
        Of the model, an ONNX file of at most 4 MB. Beside it are written its recipe and history
        (.json) and its loss curve (.svg); `OUT.training` holds the state until it is finished.
    options : TrainingOptions, optional
    progress : function of (steps done, steps in all, label)

    Returns
    -------
    Training

    Raises
    ------
    InputError
        Missing packages, a dataset that cannot be trained on, or a file that cannot be written.

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

    return train_model(Path(dataset), Path(out), options or TrainingOptions(), progress)


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
