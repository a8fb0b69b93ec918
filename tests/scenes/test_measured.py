"""Measured materials: a table made of a known material renders as that material.

No measured file is brought along. The tables of `measured_tables.py` are made of Mitsuba's
`pplastic`, whose polarised body gives them an s2 whose sign tells every mistake of handedness.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_tables import ALBEDO, ALPHA, BANDS, CAMERAS, scene, table, truth_of, write
from plain import against_scalar

from malus.renderers import Truth
from malus.renderers.mitsuba.measured_bsdf import measured_bsdfs
from malus.renderers.variant import choose, mitsuba
from malus.scenes import Area, Camera, Dielectric, Distant, Measured, Uniform


def analytic(camera: Camera) -> np.ndarray:
    """Stokes images of the material itself; half way between two wavelengths it is their mean."""

    def at(eta: float) -> np.ndarray:
        surface = Dielectric(eta=eta, alpha=ALPHA, albedo=ALBEDO, body="polarised")
        return truth_of(scene(surface, camera)).stokes[:, :, 0]

    return np.stack([0.5 * (at(1.40) + at(1.45)), at(1.50), at(1.60)], axis=2)


def between_the_horizons(truth: Truth) -> np.ndarray:
    """Pixels whose table cells hold no direction below the surface: 24° away, two cells of 6°."""
    view = np.array([0.0, 0.0, 1.0]) if truth.view_direction is None else truth.view_direction
    assert isinstance(truth.scene.light_in_image, Distant)
    cosines = truth.normals @ np.array(truth.scene.light_in_image.direction)
    pixels: np.ndarray = truth.mask & (cosines > 0.4) & ((truth.normals * view).sum(axis=-1) > 0.4)
    assert pixels.sum() > 100
    return pixels


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
def test_a_table_of_a_material_renders_as_that_material(tmp_path: Path, camera: Camera) -> None:
    """Linear interpolation: an error of second order in the step of the table.

    A step half as large leaves a quarter of it, so that the two pictures differ by three times the
    error of the finer one: 0.33, and 0.5 with the part of higher order. A wrong sign, axis or
    frame is an error of the size of the signal, whatever the step.
    """
    expected = analytic(camera)
    coarse, fine = (
        truth_of(
            scene(Measured(path=str(write(tmp_path / f"{step}.pbsdf", **table(step)))), camera)
        )
        for step in (6.0, 3.0)
    )
    assert not fine.diffuse.any()
    pixels = between_the_horizons(fine)
    for component in range(3):
        true, rough, good = (
            s[pixels][..., component] for s in (expected, coarse.stokes, fine.stokes)
        )
        error = rms(good - true)
        assert error < 0.5 * rms(rough - good)
        assert 2.5 < rms(rough - true) / error < 5.5
        assert error < 0.01 * rms(true)  # so that the signal is far above what is asserted


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64))))


def test_under_a_lamp_only_noise_is_left(tmp_path: Path) -> None:
    """Directions drawn from lamp and BSDF: another sampler than a distant light's."""
    lamp = Area(incidence_deg=50, azimuth_deg=35, half_angle_deg=10)
    surface = Measured(path=str(write(tmp_path / "a.pbsdf", **table(3.0))), alpha=ALPHA)
    known = Dielectric(eta=1.5, alpha=ALPHA, albedo=ALBEDO, body="polarised")
    camera = Camera(resolution=16)
    ours, theirs = (
        truth_of(scene(one, camera, lamp, (550.0,)), samples=256, seed=seed)
        for seed, one in enumerate((surface, known))
    )
    cosines = ours.normals @ np.array(lamp.direction)
    pixels = ours.mask & (cosines > 0.5) & (ours.normals[..., 2] > 0.4)
    error = np.hypot(ours.standard_error, theirs.standard_error)[pixels]
    residual = (ours.stokes - theirs.stokes)[pixels] / error
    # Mean of some hundred squares of normal numbers, and what the table is off by.
    assert pixels.sum() > 60
    assert 0.6 < np.mean(residual**2) < 1.5


def test_the_self_test_of_the_conventions(tmp_path: Path) -> None:
    """Mirrored light under a uniform sky (physics.md): the signs on three limbs."""
    surface = Measured(path=str(write(tmp_path / "a.pbsdf", **table(6.0))))
    one = scene(surface, Camera(resolution=24), Uniform(), (550.0,))
    truth = truth_of(one, samples=256)
    y, x = np.mgrid[:24, :24] - 11.5
    # At zenith angles of 45 to 65°, where mirrored light outweighs that of the body.
    ring = (np.hypot(x, y) > 8) & (np.hypot(x, y) < 10.5)
    s1, s2 = truth.stokes[:, :, 0, 1], truth.stokes[:, :, 0, 2]
    assert np.mean(s1[ring & (x > 3 * abs(y))]) < 0 < np.mean(s1[ring & (-y > 3 * abs(x))])
    assert np.mean(s2[ring & (x > abs(y) / 2) & (-y > abs(x) / 2)]) < 0


def test_one_band_of_a_table_is_what_the_plugin_makes_of_all(tmp_path: Path) -> None:
    path = write(tmp_path / "a.pbsdf", **table(6.0))
    variant = choose()
    mi = mitsuba(variant)
    rng = np.random.default_rng(1)
    light, viewer = (
        v / np.linalg.norm(v, axis=0)
        for v in (rng.uniform([[-1], [-1], [0.5]], 1, (3, 50)) for _ in range(2))
    )
    hit = mi.SurfaceInteraction3f()
    hit.wi = mi.Vector3f(viewer.astype(np.float32))

    def column(bsdf: Any) -> np.ndarray:
        value = bsdf.eval(mi.BSDFContext(), hit, mi.Vector3f(light.astype(np.float32)))
        return np.array([np.asarray(value[i, 0][0]) for i in range(3)])

    for wavelength, ours in zip(
        BANDS, measured_bsdfs(variant, Measured(path=str(path)), BANDS), strict=True
    ):
        whole = {"type": "measured_polarized", "filename": str(path), "wavelength": wavelength}
        expected = column(mi.load_dict(whole))
        # Rounding of 32-bit floats, which interpolate in another order.
        np.testing.assert_allclose(column(ours), expected, atol=2e-6 * np.abs(expected).max())


def test_vectorised_and_scalar_truths_agree(tmp_path: Path) -> None:
    surface = Measured(path=str(write(tmp_path / "a.pbsdf", **table(15.0))))
    residual = against_scalar(scene(surface, Camera(resolution=12)))
    # Student's t, variance 7/5; pixels and bands correlate.
    assert 0.4 < np.mean(residual**2) < 2.0
