"""Maps of index and roughness: what holds for a surface holds for each pixel's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_up import random_observation

from malus.reconstruct import Components, Observation, get_method, specular_dolp
from malus.reconstruct.facets import maps
from malus.reconstruct.fresnel import reflectances, smooth_dolp, transmission_dolp
from malus.scenes import Area

MEASURES = ("eq8", "visible", "shadowed")
METHODS = [
    f"{name}{body}"
    for name in (*MEASURES, "smooth", "half_vector", "lights")
    for body in ("", "+body")
]
METAL = np.array([0.2 + 3.4j, 1.1 + 2.3j])
GLASS = np.array([1.52, 1.5])
# A table and an interpolant are each within 1e-6 of the integral; I_s ≤ 1.
TABLE = 2e-6


def reconstruct(observation: Observation, method: str) -> Components:
    return get_method(method).reconstruct(observation)


def filled(values: np.ndarray, height: int = 6, width: int = 8) -> np.ndarray:
    return np.tile(values, (height, width, 1))


def assert_same(components: Components, expected: Components, method: str) -> None:
    bound = TABLE  # also of the weights of `lights`, float32 where the surface is uniform
    for name in ("image", "s1", "s2"):
        np.testing.assert_allclose(getattr(components, name), getattr(expected, name), atol=bound)
    np.testing.assert_array_equal(components.valid, expected.valid)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("eta", [GLASS, METAL])
def test_a_constant_map_is_a_uniform_surface(method: str, eta: np.ndarray) -> None:
    picture = replace(random_observation(0), eta=eta)
    mapped = replace(picture, eta=filled(eta), alpha=np.full((6, 8), 0.3))
    components, expected = reconstruct(mapped, method), reconstruct(picture, method)
    assert_same(components, expected, method)
    assert np.max(np.abs(components.s1)) > 0.01


@pytest.mark.parametrize("method", METHODS)
def test_two_halves_are_two_surfaces(method: str) -> None:
    """Glass on the left, a metal on the right, as where two objects stand in one picture."""
    picture = random_observation(0, height=20, width=20)
    eta, alpha = filled(GLASS, 20, 20).astype(complex), np.full((20, 20), 0.3)
    eta[:, 4:], alpha[:, 4:] = METAL, 0.2
    both = reconstruct(replace(picture, eta=eta, alpha=alpha), method)
    left = reconstruct(picture, method)
    right = reconstruct(replace(picture, eta=METAL, alpha=0.2), method)
    for name in ("s1", "s2"):
        halves = [getattr(left, name)[:, :4], getattr(right, name)[:, 4:]]
        np.testing.assert_allclose(getattr(both, name), np.concatenate(halves, axis=1), atol=TABLE)


def test_a_smooth_patch_under_a_lamp_is_as_it_is_alone() -> None:
    """The roughest surface of a picture does not decide how finely the lamp is summed."""
    picture = random_observation(0, height=20, width=20)
    picture = replace(picture, light=Area(incidence_deg=50, half_angle_deg=30))
    alpha = np.full((20, 20), 0.6)
    alpha[:, :10] = 0.04
    patched = reconstruct(replace(picture, alpha=alpha), "lights")
    alone = reconstruct(replace(picture, alpha=0.04), "lights")
    for name in ("s1", "s2"):
        patch, expected = (getattr(each, name)[:, :10] for each in (patched, alone))
        lit = np.abs(expected) > 1e-3  # where next to nothing is mirrored, float32 weights end
        assert lit.sum() > 20
        # float32 weights and Stokes vectors of thousands of directions
        np.testing.assert_allclose(patch[lit], expected[lit], atol=1e-5)


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("metal", [False, True])
def test_a_texture_of_many_surfaces_is_the_integral_everywhere(measure: str, metal: bool) -> None:
    """2500 pixels, each with a roughness and an index of its own, and the integral of some."""
    picture, random = random_observation(0, height=50, width=50), np.random.default_rng(1)
    eta = random.uniform(1.4, 1.6, (50, 50, 2)) + (3.0j if metal else 0.0)
    alpha = random.uniform(0.2, 0.4, (50, 50))
    components = reconstruct(replace(picture, eta=eta, alpha=alpha), measure)
    some = (slice(None, None, 13), slice(None, None, 11))
    zenith = np.arccos(picture.normals[..., 2][some])[..., None]  # type: ignore[index]
    exact = specular_dolp(zenith, eta[some], alpha[some][..., None] ** -2.0, measure)  # type: ignore[arg-type]
    degree = np.hypot(components.s1, components.s2)[some] / picture.specular[some]  # type: ignore[index]
    np.testing.assert_allclose(degree, np.abs(exact), atol=TABLE)


def test_few_surfaces_have_tables_and_many_an_interpolant(monkeypatch: pytest.MonkeyPatch) -> None:
    cosine = np.linspace(0.1, 1.0, 240)
    sigma = np.repeat([11.0, 12.0], 120)
    tables = maps.scattered_dolp(cosine, np.array([1.5]), sigma, "visible")
    monkeypatch.setattr(maps, "_FEW", 1)
    interpolated = maps.scattered_dolp(cosine, np.array([1.5]), sigma, "visible")
    assert np.any(tables != interpolated)
    np.testing.assert_allclose(tables, interpolated, atol=TABLE)


@pytest.mark.parametrize("method", ["eq8", "smooth+body", "half_vector", "lights"])
@pytest.mark.parametrize(("name", "value"), [("eta", -1.5), ("eta", np.nan), ("alpha", 0.0)])
def test_pixels_of_no_material_are_flagged(method: str, name: str, value: float) -> None:
    picture = replace(random_observation(0), eta=filled(GLASS), alpha=np.full((6, 8), 0.3))
    spoilt = getattr(picture, name).copy()
    spoilt[2, 3] = value
    components = reconstruct(replace(picture, **{name: spoilt}), method)
    expected = np.ones((6, 8), dtype=bool)
    expected[2, 3] = False
    np.testing.assert_array_equal(components.valid, expected)
    assert not components.stokes[2, 3].any()
    before = reconstruct(picture, method)
    np.testing.assert_allclose(components.s1[expected], before.s1[expected], atol=TABLE)


@pytest.mark.parametrize("method", ["smooth", "half_vector", "smooth+body"])
def test_metals_against_fresnel(method: str) -> None:
    """Complex indices, evaluated pixel by pixel with the reflectances themselves."""
    picture = replace(random_observation(0), eta=METAL, diffuse=np.zeros((6, 8, 2)))
    components = reconstruct(picture, method)
    half = np.array(picture.light.direction) + [0.0, 0.0, 1.0]  # type: ignore[union-attr]
    mirror = picture.normals if "smooth" in method else half / np.linalg.norm(half)
    perpendicular, parallel = reflectances(mirror[..., 2:], METAL)  # type: ignore[index]
    rho = (perpendicular - parallel) / (perpendicular + parallel)
    twice = 2.0 * np.arctan2(mirror[..., 1], mirror[..., 0])[..., None]  # type: ignore[index]
    np.testing.assert_allclose(components.s1, -picture.specular * rho * np.cos(twice), atol=TABLE)  # type: ignore[operator]
    np.testing.assert_allclose(components.s2, -picture.specular * rho * np.sin(twice), atol=TABLE)  # type: ignore[operator]


@pytest.mark.parametrize("method", ["eq8", "shadowed", "smooth", "half_vector", "lights"])
def test_the_body_of_a_metal_without_body_light_changes_nothing(method: str) -> None:
    picture = replace(random_observation(0), eta=METAL, diffuse=np.zeros((6, 8, 2)))
    plain, mended = reconstruct(picture, method), reconstruct(picture, f"{method}+body")
    np.testing.assert_array_equal(plain.s1, mended.s1)
    np.testing.assert_array_equal(plain.s2, mended.s2)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("eta", [GLASS, np.array([1.0001, 0.6]), METAL])
@pytest.mark.parametrize("name", [*MEASURES, "smooth"])
def test_the_loop_over_pixels_is_the_formula(name: str, eta: np.ndarray, dtype: str) -> None:
    """Every pixel and band alone: integral, Fresnel and trigonometry in float64."""
    picture = replace(random_observation(4), eta=eta)
    arrays = {
        n: getattr(picture, n).astype(dtype) for n in ("image", "specular", "diffuse", "normals")
    }
    picture = replace(picture, **arrays)
    components = reconstruct(picture, f"{name}+body")
    for y, x, band in np.ndindex(6, 8, 2):
        normal = picture.normals[y, x].astype(np.float64)  # type: ignore[index]
        cosine = min(normal[2], 1.0)
        if name == "smooth":
            rho = float(smooth_dolp(cosine, eta[band]))
        else:
            rho = float(specular_dolp(np.arccos(cosine), eta[band], 0.3**-2, name))  # type: ignore[arg-type]
        polarised = float(picture.diffuse[y, x, band]) * float(transmission_dolp(cosine, eta[band]))  # type: ignore[index]
        polarised -= float(picture.specular[y, x, band]) * rho  # type: ignore[index]
        twice = 2.0 * np.arctan2(normal[1], normal[0])
        # Two tables within 1e-6 each, times intensities below 1.
        assert components.s1[y, x, band] == pytest.approx(polarised * np.cos(twice), abs=TABLE)
        assert components.s2[y, x, band] == pytest.approx(polarised * np.sin(twice), abs=TABLE)


def test_the_lights_method_is_one_integral_in_either_order() -> None:
    """A lamp over surfaces of one roughness: one product of matrices against pixel by pixel."""
    picture = replace(random_observation(0), light=Area(incidence_deg=50, half_angle_deg=30))
    towards = np.broadcast_to([0.0, 0.0, 1.0], (6, 8, 3))
    product = reconstruct(picture, "lights")
    for other in (replace(picture, view_direction=towards), replace(picture, eta=filled(GLASS))):
        sums = reconstruct(other, "lights")
        lit = np.abs(product.s1) > 1e-3  # where next to nothing is mirrored, float32 weights end
        assert lit.sum() > 20
        # float32 weights and Stokes vectors of 800 directions
        np.testing.assert_allclose(sums.s1[lit], product.s1[lit], atol=1e-5)
        np.testing.assert_allclose(sums.s2[lit], product.s2[lit], atol=1e-5)
