"""Predictions in another convention or unit are suspected by name; honest ones are not.

Every mistake is made here from the definitions: L is polarised intensity, χ the angle of
polarisation from +x, ψ that from the vertical.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import reduce
from operator import add

import numpy as np
import pytest
from made_up import made_up_truth

from malus.bench.datasets.convention_check import ConventionSums
from malus.renderers import Truth
from malus.renderers.variant import choose, mitsuba
from malus.scenes import Camera

TRUTHS = [made_up_truth(seed, side=12) for seed in range(3)]


def intensity(stokes: np.ndarray) -> np.ndarray:
    return np.hypot(stokes[..., 1], stokes[..., 2])


def angle(stokes: np.ndarray) -> np.ndarray:
    """χ in (−π/2, π/2]."""
    return 0.5 * np.arctan2(stokes[..., 2], stokes[..., 1])


def linear(stokes: np.ndarray, double: np.ndarray) -> np.ndarray:
    """The same intensities with another double angle."""
    part = intensity(stokes)
    return np.stack([stokes[..., 0], part * np.cos(double), part * np.sin(double)], axis=-1)


def from_vertical(stokes: np.ndarray, phase: np.ndarray) -> np.ndarray:
    return linear(stokes, 2 * phase + np.pi)


def phase(stokes: np.ndarray) -> np.ndarray:
    """ψ in [0, π)."""
    return (angle(stokes) + np.pi / 2) % np.pi


def with_polarisation(stokes: np.ndarray, polarised: np.ndarray) -> np.ndarray:
    return np.concatenate([stokes[..., :1], polarised], axis=-1)


def suspicions(change: Callable[[np.ndarray], np.ndarray], truths: list[Truth]) -> list[str]:
    """What is suspected of predictions with nine tenths of the polarisation, after a change."""
    sums = [
        ConventionSums.of(change(truth.stokes.astype(float) * [1, 0.9, 0.9]), truth)
        for truth in truths
    ]
    return list(reduce(add, sums, ConventionSums()).suspicions())


MISTAKES: dict[str, tuple[Callable[[np.ndarray], np.ndarray], str]] = {
    "exchanged": (lambda s: s[..., [0, 2, 1]], "with s1 and s2 exchanged"),
    "exchanged, other signs": (lambda s: s[..., [0, 2, 1]] * [1, -1, -1], "exchanged"),
    "turned by 45": (lambda s: s[..., [0, 2, 1]] * [1, -1, 1], "turned by 45°"),
    "AoLP doubled": (lambda s: linear(s, 4 * angle(s)), "doubled once too often"),
    "phase doubled": (lambda s: from_vertical(s, 2 * phase(s)), "doubled once too often"),
    "not doubled": (lambda s: linear(s, angle(s)), "with twice the angle"),
    "not doubled, 0 to 180": (lambda s: linear(s, angle(s) % np.pi), "with twice the angle"),
    "phase not doubled": (lambda s: from_vertical(s, phase(s) / 2), "with twice the angle"),
    "degrees": (lambda s: linear(s, 2 * np.degrees(angle(s))), "degrees seem to be taken"),
    "phase in degrees": (lambda s: from_vertical(s, np.degrees(phase(s))), "degrees seem"),
    "converted twice": (lambda s: linear(s, 2 * np.radians(angle(s))), "once too often"),
    "phase twice": (lambda s: from_vertical(s, np.radians(phase(s))), "once too often"),
    "over s0": (lambda s: with_polarisation(s, s[..., 1:] / s[..., :1]), "divided by it"),
    "codes": (
        lambda s: with_polarisation(s, np.rint(127.5 + 127.5 * s[..., 1:] / s[..., :1])),
        "8-bit codes about 127.5",
    ),
    "codes of radiance": (
        lambda s: with_polarisation(s, np.rint(128 + 20 * s[..., 1:])),
        "8-bit codes about 127.5",
    ),
    "codes over 255": (
        lambda s: with_polarisation(s, 0.5 + 0.5 * s[..., 1:] / s[..., :1]),
        "codes about 0.5",
    ),
    "s1 and s2 times 255": (lambda s: s * [1, 255, 255], "s1 and s2 are 2"),
    "s1 and s2 over 255": (lambda s: s / [1, 255, 255], "s1 and s2 are 0.00353 times"),
}


@pytest.mark.parametrize(("change", "says"), MISTAKES.values(), ids=list(MISTAKES))
def test_a_mistake_is_named_from_the_images(
    change: Callable[[np.ndarray], np.ndarray], says: str
) -> None:
    (suspicion,) = suspicions(change, TRUTHS)
    assert says in suspicion
    assert says in suspicions(change, TRUTHS[:1])[0]  # a single scene is enough


WIDE = Camera(resolution=12, projection="perspective", fov_deg=80, distance=2)
UP = np.array([0.0, 1.0, 0.0])


def seen_by(camera: Camera) -> list[Truth]:
    """The truths of another camera; its rays are all that matters of it here."""
    scenes = [truth.scene.model_copy(update={"camera": camera}) for truth in TRUTHS]
    return [
        dataclasses.replace(truth, scene=scene) for truth, scene in zip(TRUTHS, scenes, strict=True)
    ]


def in_frame(stokes: np.ndarray, axis: np.ndarray, view: np.ndarray) -> np.ndarray:
    """Stokes vectors for another reference axis (height, width, 3) across the rays."""
    ours = np.cross(UP, view)
    ours /= np.linalg.norm(ours, axis=-1, keepdims=True)
    across = axis - np.sum(axis * view, axis=-1, keepdims=True) * view
    turn = np.arctan2(np.sum(np.cross(ours, across) * view, -1), np.sum(ours * across, -1))
    return linear(stokes, 2 * (angle(stokes) - turn[..., None]))


def rays(camera: Camera) -> np.ndarray:
    view = camera.view_directions()
    return np.broadcast_to([0.0, 0, 1], (12, 12, 3)) if view is None else view


@pytest.mark.parametrize("roll", [25, -70, 160])
@pytest.mark.parametrize("camera", [Camera(resolution=12), WIDE])
def test_the_horizontal_of_the_scene_is_named(camera: Camera, roll: float) -> None:
    rolled = camera.model_copy(update={"roll_deg": float(roll)})
    view, sideways = rays(rolled), np.radians(roll)
    # The scene's up leans to the right by the roll when the camera turns anticlockwise.
    up = np.array([np.sin(sideways), np.cos(sideways), 0.0])
    found = suspicions(lambda s: in_frame(s, np.cross(up, view), view), seen_by(rolled))
    assert len(found) == 1
    assert "the horizontal of the scene" in found[0]


def test_the_cameras_axis_across_each_ray_is_named() -> None:
    view = rays(WIDE)
    x = np.broadcast_to([1.0, 0, 0], view.shape)
    (found,) = suspicions(lambda s: in_frame(s, x, view), seen_by(WIDE))
    assert "the camera's +x laid across the ray" in found


@pytest.mark.parametrize("roll", [0.0, 25.0])
def test_mitsubas_own_frames_are_named(roll: float) -> None:
    # Within 80° they differ by 4.8° (rms), which a tenth too little polarisation hides.
    camera = WIDE.model_copy(update={"roll_deg": roll, "fov_deg": 120})
    mi = mitsuba(choose())
    view = rays(camera)
    world = view @ camera.axes
    basis = [
        np.ravel(mi.mueller.stokes_basis(mi.Vector3f(*map(float, ray)))).tolist()
        for ray in world.reshape(-1, 3)
    ]
    axis = (np.array(basis) @ camera.axes.T).reshape(view.shape)
    (found,) = suspicions(lambda s: in_frame(s, axis, view), seen_by(camera))
    assert "`stokes_basis`" in found


@pytest.mark.parametrize("camera", [Camera(resolution=12), WIDE])
@pytest.mark.parametrize("quarter", [0, 1])
def test_axes_that_point_away_from_the_middle_are_named(camera: Camera, quarter: int) -> None:
    row, column = np.mgrid[:12, :12]
    azimuth = np.arctan2(5.5 - row, column - 5.5) + quarter * np.pi / 2
    change = lambda s: linear(s, 2 * (angle(s) - azimuth[..., None]))  # noqa: E731
    (found,) = suspicions(change, seen_by(camera))
    assert "point away from its middle" in found


@pytest.mark.parametrize("camera", [WIDE, WIDE.model_copy(update={"roll_deg": 40.0})])
def test_our_own_frame_is_not_suspected(camera: Camera) -> None:
    for change in (lambda s: s, noisy, lambda s: s * [1, 0.1, 0.1]):
        assert suspicions(change, seen_by(camera)) == []


def test_scales_of_everything_are_told_once() -> None:
    assert suspicions(lambda s: 255 * s, TRUTHS) == [
        "intensities are 255 times those of the scenes"
    ]


def noisy(stokes: np.ndarray) -> np.ndarray:
    noise = np.random.default_rng(5).normal(scale=0.5, size=stokes.shape)
    return stokes + noise * intensity(stokes)[..., None]


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s,
        lambda s: s * [1, 0.1, 0.1],
        lambda s: s * [1, 1.0, 0.0],
        lambda s: s * [1, 0, 0],
        lambda s: linear(s, 2 * angle(s) + 0.5),
        noisy,
    ],
)
def test_a_method_that_is_merely_bad_is_not_suspected(
    change: Callable[[np.ndarray], np.ndarray],
) -> None:
    assert suspicions(change, TRUTHS) == []


def test_radiance_of_one_is_not_taken_for_a_division_by_s0() -> None:
    """Where s0 is 1 everywhere both are the same, and both fit."""
    truths = []
    for truth in TRUTHS:
        level = truth.specular[..., :1] + truth.diffuse[..., :1]
        lobes = {"specular": truth.specular / level, "diffuse": truth.diffuse / level}
        truths.append(dataclasses.replace(truth, **lobes))
    assert suspicions(lambda s: s, truths) == []


def test_the_largest_numbers_overflow_without_a_warning() -> None:
    suspicions(lambda s: s * 1e300, TRUTHS)
