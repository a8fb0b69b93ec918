"""Predictions of another picture than the one that was given are suspected; honest ones are not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from made_up import made_up_truth
from scipy.ndimage import gaussian_filter

from malus.bench.datasets.picture_check import PictureCheck
from malus.bench.datasets.score import score_dataset
from malus.renderers import Truth
from malus.renderers.datasets.dataset_writer import DatasetWriter

TRUTHS = [made_up_truth(seed, side=12) for seed in range(6)]


def suspicions(
    change: Callable[[np.ndarray], np.ndarray], truths: list[Truth] = TRUTHS
) -> list[str]:
    check = PictureCheck()
    for truth in truths:
        check.add(change(truth.image), truth)
    return list(check.suspicions())


MISTAKES: dict[str, tuple[Callable[[np.ndarray], np.ndarray], str]] = {
    "rows": (np.flipud, "upside down"),
    "columns": (np.fliplr, "mirrored"),
    "both": (lambda image: np.flipud(np.fliplr(image)), "turned by 180°"),
    "matrix": (lambda image: image.transpose(1, 0, 2), "rows and columns exchanged"),
    "anticlockwise": (lambda image: np.rot90(image), "turned by 90°"),
    "clockwise": (lambda image: np.rot90(image, 3), "turned by -90°"),
    "bgr": (lambda image: image[..., [2, 1, 0]], "bands reversed"),
}


@pytest.mark.parametrize("name", MISTAKES)
@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_a_picture_in_another_order_is_suspected(name: str, scale: float) -> None:
    change, says = MISTAKES[name]
    noise = np.random.default_rng(1).normal(1.0, 0.05, size=TRUTHS[0].image.shape)
    (suspicion,) = suspicions(lambda image: scale * noise * change(image))
    assert says in suspicion
    (alone,) = suspicions(change, TRUTHS[:1])
    assert says in alone


def noisy(image: np.ndarray) -> np.ndarray:
    return image + 0.3 * image.max() * np.random.default_rng(2).normal(size=image.shape)


@pytest.mark.parametrize(
    "change",
    [
        lambda image: image,
        lambda image: 255.0 * image,
        lambda image: image**0.45,
        lambda image: gaussian_filter(image, (1, 1, 0)),
        lambda image: gaussian_filter(image, (4, 4, 0)),
        lambda image: np.roll(image, (1, 1), axis=(0, 1)),
        lambda image: np.minimum(image, np.median(image)),
        lambda image: np.full_like(image, image.mean()),
        lambda image: np.zeros_like(image),
        lambda image: image.astype(np.float64) * 1e300,
        lambda image: np.random.default_rng(3).random(image.shape),
        noisy,
    ],
)
def test_honest_pictures_are_not_suspected(change: Callable[[np.ndarray], np.ndarray]) -> None:
    assert suspicions(change) == []
    assert suspicions(change, TRUTHS[:1]) == []


def test_what_a_flip_does_not_change_tells_nothing() -> None:
    assert suspicions(lambda image: image + np.flipud(image)) == []


def test_scenes_in_another_order_are_named() -> None:
    check = PictureCheck()
    for truth, other in zip(TRUTHS, [TRUTHS[-1], *TRUTHS[:-1]], strict=True):
        check.add(gaussian_filter(other.image, (0.3, 0.3, 0)), truth)
    (suspicion,) = check.suspicions()
    first, last = TRUTHS[0].scene.id, TRUTHS[-1].scene.id
    assert f"of 6 scenes fits the picture of another scene better, that of {first}" in suspicion
    assert f"the picture of {last}: the name is the id of the scene" in suspicion


def test_scoring_tells_it(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path / "dataset") as writer:
        for truth in TRUTHS:
            writer.add(truth)
    (tmp_path / "mine").mkdir()
    for truth in TRUTHS:
        np.savez(tmp_path / "mine" / f"{truth.scene.id}.npz", stokes=truth.stokes[::-1])
    run = score_dataset(tmp_path / "dataset", predictions=tmp_path / "mine").run
    assert any("upside down" in suspicion for suspicion in run["predictions"]["suspicions"])
