"""The colour of the light: exact cases, and truths under light of a known colour."""

from __future__ import annotations

import numpy as np
import pytest

from malus.reconstruct.observation import Inapplicable
from malus.reconstruct.single_image.illuminant import (
    ILLUMINANTS,
    from_highlights,
    gray_world,
    neutral,
    shades_of_grey,
    specular_tint,
)
from malus.renderers import render
from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
from malus.scenes.materials.materials import material

LIGHT = np.array([0.7, 1.0, 1.3])
BODY = np.array([0.3, 1.2, 0.6])


def glossy_sphere() -> tuple[np.ndarray, np.ndarray]:
    """A coloured sphere with a highlight under coloured light, and its mask."""
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.15, body="unpolarised"),
        light=Distant(incidence_deg=30),
        camera=Camera(resolution=128),
        wavelengths_nm=(450, 550, 650),
    )
    truth = render(scene, renderer="torrance-sparrow")
    return (truth.diffuse[..., 0] * BODY + truth.specular[..., 0]) * LIGHT, truth.mask


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))))


@pytest.mark.parametrize("name", sorted(ILLUMINANTS))
def test_colour_has_mean_one_and_does_not_depend_on_exposure(name: str) -> None:
    image, mask = glossy_sphere()
    dim, bright = (ILLUMINANTS[name](scale * image, mask) for scale in (1e-6, 1e6))
    assert dim.colour.mean() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(dim.colour, bright.colour, rtol=1e-6)
    assert len(dim.assumption) > 10


def test_grey_world_and_its_powers_agree_on_a_grey_scene() -> None:
    rng = np.random.default_rng(0)
    image = rng.random((20, 20, 1)) * LIGHT
    for estimate in (gray_world(image), shades_of_grey(image), shades_of_grey(image, order=30)):
        np.testing.assert_allclose(estimate.colour, LIGHT, rtol=1e-12)


def test_power_one_is_grey_world_and_a_high_power_is_white_patch() -> None:
    image = np.random.default_rng(1).random((20, 20, 3)) + 0.1
    np.testing.assert_allclose(
        shades_of_grey(image, order=1.0).colour, gray_world(image).colour, rtol=1e-12
    )
    brightest = image.max(axis=(0, 1))
    # (1/n)^(1/400) for n = 400 pixels is the same factor for every band up to a percent.
    np.testing.assert_allclose(
        shades_of_grey(image, order=400.0).colour, brightest / brightest.mean(), rtol=0.02
    )


def test_highlights_see_the_light_where_grey_world_sees_the_body() -> None:
    image, mask = glossy_sphere()
    # 2° is below what a viewer notices in a photograph (Finlayson: 2 to 3°).
    assert angle_deg(from_highlights(image, mask).colour, LIGHT) < 2.0
    assert angle_deg(gray_world(image, mask).colour, LIGHT) > 20.0
    assert angle_deg(gray_world(image, mask).colour, LIGHT * BODY) < 10.0


@pytest.mark.parametrize("colours", [LIGHT, BODY * LIGHT])
def test_highlights_need_a_highlight_over_a_colour(colours: np.ndarray) -> None:
    shade = np.linspace(0.2, 1.0, 32 * 32).reshape(32, 32, 1)
    with pytest.raises(Inapplicable, match="no highlight over a coloured body"):
        from_highlights(shade * colours)


@pytest.mark.parametrize("name", sorted(set(ILLUMINANTS) - {"neutral"}))
def test_a_dark_image_has_no_colour(name: str) -> None:
    with pytest.raises(Inapplicable, match="dark"):
        ILLUMINANTS[name](np.zeros((16, 16, 3)), None)


@pytest.mark.parametrize("name", sorted(ILLUMINANTS))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_pixels_that_are_not_finite_say_nothing(name: str, value: float) -> None:
    image, mask = glossy_sphere()
    image[64:68, 60], without = value, mask.copy()
    without[64:68, 60] = False
    filled = np.where(np.isfinite(image), image, 0.0)
    # Only the order of a sum may differ.
    found, expected = ILLUMINANTS[name](image, mask), ILLUMINANTS[name](filled, without)
    np.testing.assert_allclose(found.colour, expected.colour, rtol=1e-12)
    if name != "neutral":
        with pytest.raises(Inapplicable, match="no pixel is finite"):
            ILLUMINANTS[name](np.full_like(image, value), mask)


def test_neutral_leaves_an_image_as_it_is() -> None:
    image, _ = glossy_sphere()
    np.testing.assert_array_equal(image / neutral(image).colour, image)


@pytest.mark.parametrize("name", ["pmma", "polystyrene", "water", "polycarbonate"])
def test_the_typical_tint_is_nearer_to_a_materials_than_white_is(name: str) -> None:
    wavelengths = (450.0, 550.0, 650.0)
    eta = material(name).eta(wavelengths)
    true = ((eta - 1) / (eta + 1)) ** 2
    true /= true.mean()
    assert np.abs(specular_tint(wavelengths) - true).max() < np.abs(1 - true).max()
