"""Shifts between the pictures of a capture: found where there are any, and nowhere else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter, shift

from malus.reconstruct.photos.capture_fit import fit_capture
from malus.reconstruct.photos.movement import MOVED, Shift, is_sub_grids, measure_shifts
from malus.scenes.polarisation import analyser

ANGLES = (0.0, 45.0, 90.0, 135.0)
RNG = np.random.default_rng(0)


def lengths(*pictures: np.ndarray) -> list[float]:
    stack = np.stack(pictures)[..., None].astype(np.float32)
    return [moved.length for moved in measure_shifts(stack, ANGLES[: len(pictures)])]


def texture(side: int = 120) -> np.ndarray:
    return 0.2 + gaussian_filter(RNG.random((side, side)), 1.2)


@pytest.mark.parametrize("side", [24, 60, 160])
@pytest.mark.parametrize("noise", [0.0, 0.002, 0.02])
@pytest.mark.parametrize("shape", ["ramp", "bowl", "vignette", "even"])
def test_smooth_light_does_not_move(shape: str, noise: float, side: int) -> None:
    """A smooth gradient was said to have moved by 0.8 pixels."""
    y, x = np.mgrid[:side, :side] / side
    light = {
        "ramp": 0.2 + 0.6 * x + 0.2 * y,
        "bowl": 0.2 + 0.6 * (x - 0.4) ** 2 + 0.3 * y**2,
        "vignette": np.cos(1.2 * np.hypot(x - 0.5, y - 0.5)) ** 4,
        "even": 0.5 + 0 * x,
    }[shape]
    polarised = [light * (1 + 0.3 * np.cos(2 * np.radians(a) + 2 * x + y)) for a in ANGLES]
    pictures = [p + noise * RNG.standard_normal(p.shape) for p in polarised]
    assert lengths(*pictures) == [0, 0, 0, 0]


@pytest.mark.parametrize("offset", [(0.0, 0.5), (0.5, 0.0), (0.4, -0.3), (3.0, 0.0), (-2.3, 4.2)])
def test_shifts_are_measured_to_a_twentieth_of_a_pixel(offset: tuple[float, float]) -> None:
    still = texture(140)
    moved = shift(still, offset, order=5)
    inner = np.s_[10:-10, 10:-10]
    y, x = np.mgrid[:120, :120] / 120
    half = 0.5 + 0.3 * np.sin(5 * x + y)  # what a polariser does to it
    pair = [still[inner], moved[inner] * half + 0.002 * RNG.standard_normal((120, 120))]
    stack = np.stack(pair)[..., None].astype(np.float32)
    measured = measure_shifts(stack, ANGLES[:2])[1]
    assert measured.down == pytest.approx(offset[0], abs=0.05)
    assert measured.right == pytest.approx(offset[1], abs=0.05)


def test_noise_alone_moves_nothing() -> None:
    assert lengths(*RNG.random((4, 64, 64))) == [0, 0, 0, 0]


def test_an_unmoved_texture_does_not_move() -> None:
    still = texture()
    noisy = [still * a + 0.01 * RNG.standard_normal(still.shape) for a in (1, 0.8, 0.6, 0.9)]
    assert max(lengths(*noisy)) < 0.05


@pytest.mark.parametrize(
    ("shifts", "expected"),
    [
        ([(0, 0), (0, 0.5), (0.5, 0), (0.5, 0.5)], True),
        ([(0, 0), (0.03, -0.54), (-0.47, 0.01), (-0.5, -0.53)], True),
        ([(0, 0), (0, 0.5), (0, 0.5), (0.5, 0.5)], False),
        ([(0, 0), (0, 0), (0, 0), (0, 0)], False),
        ([(0, 0), (0, 1.5), (0.5, 0), (0.5, 0.5)], False),
        ([(0, 0), (0, 0.5), (0.5, 0)], False),
    ],
)
def test_sub_grids_of_a_mosaic(shifts: list[tuple[float, float]], expected: bool) -> None:
    assert is_sub_grids([Shift(*pair) for pair in shifts]) == expected


def test_a_moved_picture_is_warned_of(tmp_path: Path) -> None:
    still = texture().astype(np.float32)
    for angle in ANGLES:
        picture = np.roll(still, 2, axis=0) if angle == 90 else still
        tifffile.imwrite(tmp_path / f"p{angle:g}.tif", picture)
    warnings = fit_capture(tmp_path).warnings
    assert any("moved by up to 2.0 pixels: p90.tif" in warning for warning in warnings)


def smooth_field(seed: int) -> np.ndarray:
    """Stokes image (80, 90, 3) in which light, degree and angle vary each on their own."""
    random = np.random.default_rng(seed)
    width = random.uniform(4, 10)
    fields = [gaussian_filter(random.normal(size=(80, 90)), width) for _ in range(3)]
    light, degree, angle = (field / field.std() for field in fields)
    light, degree = np.exp(0.4 * light), 0.4 / (1 + np.exp(-degree))
    parts = [np.ones_like(light), degree * np.cos(2 * angle), degree * np.sin(2 * angle)]
    return light[..., None] * np.stack(parts, axis=-1)


@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_details_of_the_polarisation_alone_move_nothing(noise: float) -> None:
    """Two in five of such captures were said to have moved by pixels, though the fit was exact."""
    for seed in range(12):
        random = np.random.default_rng(seed)
        pictures = np.moveaxis(smooth_field(seed) @ analyser(ANGLES).T, -1, 0)
        noisy = pictures + noise * random.standard_normal(pictures.shape)
        assert max(lengths(*noisy)) <= MOVED, seed


def test_a_picture_that_moved_among_such_details_is_still_found() -> None:
    found = 0
    for seed in range(12):
        pictures = np.moveaxis(smooth_field(seed) @ analyser(ANGLES).T, -1, 0)
        pictures[2] = shift(pictures[2], (1.5, 0.0), order=3, mode="nearest")
        found += max(lengths(*pictures)) > MOVED
    assert found >= 9  # where light itself has hardly a detail, it cannot be told
