"""Coloured bodies: exact by linearity, and what the swatches' numbers are."""

from __future__ import annotations

import numpy as np
import pytest

from malus.reconstruct import Inapplicable
from malus.reconstruct.single_image.separation import separate
from malus.renderers.families.family import FamilyKey, render_family
from malus.scenes import Camera, Dielectric, Distant, InputError, Sampling, Scene, Sphere
from malus.scenes.materials.albedo import reflectance, swatches

BANDS = (450.0, 550.0, 650.0)


def scene(albedo: object, body: str = "polarised", resolution: int = 16) -> Scene:
    return Scene(
        shape=Sphere(),
        surface=Dielectric(material="pmma", alpha=0.3, albedo=albedo, body=body),
        light=Distant(incidence_deg=45),
        camera=Camera(resolution=resolution),
        wavelengths_nm=BANDS,
    )


@pytest.mark.parametrize("body", ["polarised", "unpolarised"])
@pytest.mark.parametrize("albedo", ["red", (0.1, 0.0, 1.0)])
def test_a_colour_is_the_white_body_times_its_reflectance(albedo: object, body: str) -> None:
    white, coloured = scene(1.0, body), scene(albedo, body)
    assert FamilyKey.of(white) == FamilyKey.of(coloured)
    family = render_family([white, coloured], Sampling(samples=8))
    one, other = family.truth(white), family.truth(coloured)
    factor = reflectance(albedo, BANDS)[:, None]
    # A product of two 32-bit floats is right to half a unit in the last of 24 bits.
    np.testing.assert_allclose(other.diffuse, one.diffuse * factor, rtol=2**-23)
    np.testing.assert_allclose(other.diffuse_noise, one.diffuse_noise * factor, rtol=2**-23)
    np.testing.assert_array_equal(other.specular, one.specular)


def test_standard_errors_of_a_band_are_those_of_its_own_albedo() -> None:
    """A coloured body's error in a band is that of a grey body of the band's reflectance."""
    coloured = scene("green")
    greys = [scene(float(value)) for value in reflectance("green", BANDS)]
    family = render_family([coloured, *greys], Sampling(samples=8))
    found = family.truth(coloured).standard_error
    for band, grey in enumerate(greys):
        np.testing.assert_array_equal(
            found[:, :, band], family.truth(grey).standard_error[:, :, band]
        )


def test_swatches_are_those_that_colour_science_brings() -> None:
    from colour import SDS_COLOURCHECKERS

    chart = SDS_COLOURCHECKERS["BabelColor Average"]
    assert len(chart) == len(swatches()) == 24
    for name, theirs in zip(swatches(), chart.values(), strict=True):
        np.testing.assert_allclose(np.arange(380.0, 731.0, 10.0), theirs.wavelengths)
        # Three digits are stored.
        np.testing.assert_allclose(swatches()[name], theirs.values, atol=5.1e-4)


def test_reflectance_is_linear_between_the_table() -> None:
    nm = (450.0, 453.0, 460.0)
    low, between, high = reflectance("blue", nm)
    assert between == pytest.approx(low + 0.3 * (high - low), rel=1e-12)


@pytest.mark.parametrize(
    ("albedo", "expected"),
    [("rde", "did you mean"), ((0.5, 0.5), "one number a band, 3"), (1.5, "1"), ((2.0,) * 3, "1")],
)
def test_bad_colours_are_refused(albedo: object, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        scene(albedo)


def test_swatches_end_where_their_table_ends() -> None:
    with pytest.raises(InputError, match="380 to 730"):
        scene("red").model_copy().parse(
            scene("red").model_dump() | {"wavelengths_nm": (350.0, 550.0)}, "scene"
        )


def test_separation_by_colour_has_colours_to_work_with() -> None:
    """The dichromatic methods split the lobes of a red body, and refuse a grey one."""
    red, grey = scene("red", "unpolarised", 32), scene(0.3, "unpolarised", 32)
    family = render_family([red, grey], Sampling(samples=64))
    truth = family.truth(red)
    found = separate(truth.image, truth.mask, None, "suv", None).specular
    true = truth.specular[..., 0]
    error = np.sqrt(np.mean((found - true)[truth.mask] ** 2)) / true.max()
    assert error < 0.01  # 0.004 here: noise, and the slight colour of the interface
    with pytest.raises(Inapplicable, match="colour is needed"):
        separate(family.truth(grey).image, truth.mask, None, "suv", None)
