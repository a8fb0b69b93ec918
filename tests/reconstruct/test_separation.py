"""Separation by colour: exact dichromatic images, truths, and where it must say no."""

from __future__ import annotations

import numpy as np
import pytest

from malus.reconstruct.observation import Inapplicable, Observation
from malus.reconstruct.single_image.blind import run_chain
from malus.reconstruct.single_image.separation import SEPARATIONS, separate
from malus.renderers import render
from malus.scenes import Camera, Dielectric, Distant, InputError, Scene, Sphere

METHODS = sorted(SEPARATIONS)
BODY = np.array([0.25, 0.45, 1.0])


def dichromatic(bands: int = 3, side: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Body light and mirrored white light of a shaded patch with a round highlight."""
    y, x = np.mgrid[-1 : 1 : side * 1j, -1 : 1 : side * 1j]
    colour = np.linspace(0.4, 1.6, bands)
    body = (0.8 - 0.3 * x)[..., None] * colour
    glare = 0.6 * np.clip(1 - 4 * ((x - 0.2) ** 2 + y**2), 0, None)
    return body, np.repeat(glare[..., None], bands, axis=-1)


def relative_rmse(estimated: np.ndarray, true: np.ndarray, mask: np.ndarray) -> float:
    error = (estimated - true)[mask]
    return float(np.sqrt(np.mean(error**2)) / true[mask].max())


def coloured_sphere(alpha: float = 0.3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(I_d, I_s, mask) of a sphere: the body's lobe times a colour, as Stokes lobes are linear."""
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=alpha, body="unpolarised"),
        light=Distant(incidence_deg=45),
        camera=Camera(resolution=64),
        wavelengths_nm=(450, 550, 650),
    )
    truth = render(scene, renderer="torrance-sparrow")
    return truth.diffuse[..., 0] * BODY, truth.specular[..., 0], truth.mask


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("bands", [2, 3, 8])
def test_one_colour_is_separated_for_any_number_of_bands(method: str, bands: int) -> None:
    body, glare = dichromatic(bands)
    mask = np.ones(body.shape[:2], bool)
    parts = separate(body + glare, mask, method=method)
    # Noise-free, so only the stops of each search remain; erosion stops at a slope of 1e-5.
    assert relative_rmse(parts.specular, glare, mask) < 0.01


@pytest.mark.parametrize("method", METHODS)
def test_lobes_add_up_and_none_is_negative(method: str) -> None:
    rng = np.random.default_rng(0)
    image, mask = rng.random((40, 40, 3)).astype(np.float32), rng.random((40, 40)) > 0.2
    parts = separate(image, mask, method=method)
    np.testing.assert_allclose((parts.diffuse + parts.specular)[mask], image[mask], rtol=1e-6)
    assert parts.diffuse.min() >= 0
    assert parts.specular.min() >= 0
    assert not parts.specular[~mask].any()
    assert parts.specular.dtype == np.float32


@pytest.mark.parametrize("method", METHODS)
def test_exposure_and_the_colour_of_the_light_change_nothing(method: str) -> None:
    body, glare = dichromatic()
    mask = np.ones(body.shape[:2], bool)
    light = np.array([0.8, 1.0, 1.2])
    plain = separate(body + glare, mask, method=method).specular
    tinted = separate(7.0 * (body + glare) * light, mask, light, method).specular
    np.testing.assert_allclose(tinted, 7.0 * plain * light, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("power", [-120, -70, 70, 120])
def test_a_power_of_two_scales_both_lobes_exactly(method: str, power: int) -> None:
    """Single precision holds all of its numbers but not their squares; no warning is an error."""
    body, glare = dichromatic()
    image = (body + glare).astype(np.float32)
    mask = np.ones(body.shape[:2], bool)
    plain = separate(image, mask, method=method)
    scaled = separate(np.ldexp(image, power), mask, method=method)
    # Exact but for what falls below the smallest normal number, 2^-126, and is rounded there.
    atol = np.finfo(np.float32).smallest_subnormal
    np.testing.assert_allclose(scaled.specular, np.ldexp(plain.specular, power), rtol=0, atol=atol)
    np.testing.assert_allclose(scaled.diffuse, np.ldexp(plain.diffuse, power), rtol=0, atol=atol)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.int32])
def test_whole_numbers_are_separated_as_floats_are(method: str, kind: type) -> None:
    body, glare = dichromatic()
    light, mask = np.array([1.2, 1.0, 1.1]), np.ones(body.shape[:2], bool)
    codes = np.rint(100 * (body + glare) * light).astype(kind)
    parts = separate(codes, mask, light, method)
    exact = separate(codes.astype(np.float64), mask, light, method)
    # Single precision of sums up to 255 and of quotients near 0, where codes lie on a line.
    np.testing.assert_allclose(parts.specular, exact.specular, atol=2e-3)
    assert parts.specular.dtype == np.result_type(kind, np.float32)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_pixel_that_is_not_finite_is_off_the_mask(method: str, value: float) -> None:
    body, glare = dichromatic()
    image, mask = body + glare, np.ones(body.shape[:2], bool)
    mask[20, 20] = False
    without = separate(image, mask, method=method)
    image[20, 20, 1] = value
    spoilt = separate(image, np.ones_like(mask), method=method)
    np.testing.assert_array_equal(spoilt.specular, without.specular)
    np.testing.assert_array_equal(spoilt.diffuse, without.diffuse)
    with pytest.raises(Inapplicable, match=r"^no pixel of the object is finite$"):
        separate(np.full_like(image, value), mask, method=method)


@pytest.mark.parametrize("method", METHODS)
def test_body_colours_keep_their_own(method: str) -> None:
    body, glare = dichromatic()
    # Another hue and half the saturation: one κ for both would turn body light into glare.
    body[:, 18:30] = body[:, 18:30, 1:2] * [1.3, 1.0, 0.7]
    body[:, 30:] = body[:, 30:, 1:2] * [0.9, 1.4, 0.7]
    mask = np.ones(body.shape[:2], bool)
    parts = separate(body + glare, mask, method=method)
    assert relative_rmse(parts.specular, glare, mask) < 0.02


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("light", [0.3, 0.09, 0.04])
def test_a_dark_body_beside_a_bright_one_keeps_its_colour(method: str, light: float) -> None:
    """What one body reflects says nothing of the highlights of another."""
    body, _ = dichromatic()
    body[:, 24:] = light * body[:, 24:, 1:2] * [1.4, 1.0, 0.6]
    mask = np.ones(body.shape[:2], bool)
    specular = separate(body, mask, method=method).specular
    # Matt, so only the stops of each search remain, as above.
    assert specular[:, 24:].max() < 0.01 * body[:, 24:].max()
    assert specular[:, :24].max() < 0.01 * body.max()


@pytest.mark.parametrize("method", METHODS)
def test_an_object_of_one_row_in_a_large_picture(method: str) -> None:
    """Of many pixels a sample is looked at: it has those of the object, however flat that is."""
    body, glare = dichromatic(side=32)
    row = (body + glare).reshape(1, -1, 3).astype(np.float32)
    large, mask = np.zeros((3, 1 << 20, 3), np.float32), np.zeros((3, 1 << 20), bool)
    large[1, : row.shape[1]], mask[1, : row.shape[1]] = row, True
    alone = separate(row, np.ones(row.shape[:2], bool), method=method).specular
    inside = separate(large, mask, method=method).specular[mask]
    # Erosion may take more steps in the larger picture; both have settled to 1e-5.
    np.testing.assert_allclose(inside, alone[0], atol=1e-4)


@pytest.mark.parametrize("method", METHODS)
def test_a_matt_object_has_no_highlight(method: str) -> None:
    body, _ = dichromatic()
    mask = np.ones(body.shape[:2], bool)
    assert separate(body, mask, method=method).specular.max() < 0.01 * body.max()


@pytest.mark.parametrize(("method", "alpha"), [(m, a) for m in METHODS for a in (0.15, 0.3, 0.5)])
def test_lobes_of_a_rendered_sphere(method: str, alpha: float) -> None:
    body, glare, mask = coloured_sphere(alpha)
    parts = separate(body + glare, mask, method=method)
    # Measured 0.003 to 0.012: rough lobes leave no pixel that is pure body light.
    assert relative_rmse(parts.specular, glare, mask) < 0.02


@pytest.mark.parametrize("method", METHODS)
def test_grey_says_so(method: str) -> None:
    _, glare = dichromatic()
    mask = np.ones(glare.shape[:2], bool)
    with pytest.raises(Inapplicable, match="grey image where colour is needed"):
        separate(glare + 0.3, mask, method=method)
    with pytest.raises(Inapplicable, match="grey image where colour is needed"):
        separate(glare[..., :1] + 0.3, mask, method=method)


def test_dark_images_and_empty_masks_say_so() -> None:
    black, mask = np.zeros((8, 8, 3)), np.ones((8, 8), bool)
    with pytest.raises(Inapplicable, match="dark"):
        separate(black, mask)
    with pytest.raises(Inapplicable, match="dark"):
        separate(black + 1.0, np.zeros_like(mask))


def test_one_pixel_works() -> None:
    parts = separate(np.array([[[3.0, 1.0]]]), np.ones((1, 1), bool))
    np.testing.assert_allclose(parts.diffuse + parts.specular, [[[3.0, 1.0]]])


def test_wrong_arguments_name_themselves() -> None:
    image, mask = np.ones((4, 4, 3)) * BODY, np.ones((4, 4), bool)
    with pytest.raises(InputError, match=r"^method: expected .*: chromaticity, suv, ratio"):
        separate(image, mask, method="magic")
    with pytest.raises(InputError, match=r"^separation: expected .*: chromaticity, suv, ratio"):
        run_chain(Observation(image, mask), separation="magic")
    with pytest.raises(ValueError, match="illuminant: expected 3 positive values"):
        separate(image, mask, [1.0, 0.0, 1.0])


def test_noise_in_the_dark_is_no_highlight() -> None:
    rng = np.random.default_rng(0)
    body = np.linspace(0.2, 1, 32 * 32).reshape(32, 32, 1) * [1.5, 1.0, 0.5]
    body[:, :8] = 0.01 * rng.random((32, 8, 3))
    parts = separate(body, np.ones((32, 32), bool))
    assert not parts.specular[:, :8].any()
    # Equal but for the rounding of one subtraction and one sum.
    np.testing.assert_allclose(parts.diffuse + parts.specular, body, rtol=1e-14)


@pytest.mark.parametrize("method", METHODS)
def test_primaries_and_greys_are_separated(method: str) -> None:
    """Their chromaticities are 1 and 1/3, or what rounding makes of them."""
    image = 1.0 * (np.random.default_rng(0).random((24, 24, 3)) > 0.5)
    light, mask = image.mean(axis=(0, 1)), np.ones((24, 24), bool)
    parts = separate(image, mask, light / light.mean(), method)
    np.testing.assert_allclose(parts.diffuse + parts.specular, image, rtol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_wider_frame_changes_nothing(method: str) -> None:
    body, glare = dichromatic(side=32)
    mask = np.ones(body.shape[:2], bool)
    wide = np.pad(body + glare, ((5, 40), (60, 3), (0, 0)), constant_values=0.3)
    wide_mask = np.pad(mask, ((5, 40), (60, 3)))
    alone = separate(body + glare, mask, method=method).specular
    inside = separate(wide, wide_mask, method=method).specular[wide_mask]
    # Erosion may take more steps in the wider frame; both have settled to 1e-5.
    np.testing.assert_allclose(inside, alone[mask], atol=1e-4)


HAND_BODY = np.array([6.0, 3.0, 1.0])
"""Sum 10, largest chromaticity Λ = 0.6."""
HAND_PIXELS = {
    # ½ (6, 3, 1) and twice white: Σ 11, σ = 5/11, ΣI_d = 5 (3 σ - 1) / (σ (3 · 0.6 - 1)) = 5.
    (5.0, 3.5, 2.5): 2.0,
    # ¼ (6, 3, 1) and 5 times white: Σ 17.5, σ = 6.5/17.5, ΣI_d = 6.5 (2/17.5) / (6.5/17.5 · 0.8).
    (6.5, 5.75, 5.25): 5.0,
    # (6, 3, 1) and once white: τ = S/|UV| = 13/√38, of the body 10/√38, I_s = 13/3 (1 - 10/13).
    (7.0, 4.0, 2.0): 1.0,
}
"""Pixels of the dichromatic model, and the white light in each, worked out by hand."""


@pytest.mark.parametrize("method", ["chromaticity", "suv"])
@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), (1.5, 1.0, 0.5)])
def test_tan_and_mallick_by_hand(method: str, light: tuple[float, ...]) -> None:
    """Exact on the dichromatic model where pixels of body light alone lie around a highlight."""
    shades = np.linspace(0.5, 1.5, 64).reshape(8, 8, 1)
    image, glare = shades * HAND_BODY, np.zeros((8, 8, 1))
    for column, (pixel, white) in enumerate(HAND_PIXELS.items()):
        image[3, 2 * column + 1], glare[3, 2 * column + 1] = pixel, white
    colour = np.array(light)
    parts = separate(image * colour, np.ones((8, 8), bool), colour, method)
    # Tan's Λ is a mean of equal chromaticities; erosion stops at a slope of 1e-5 of the smallest τ,
    # which |UV| of the brightest pixel, 2.5, enlarges.
    atol = {"chromaticity": 1e-12, "suv": 2e-4}[method]
    np.testing.assert_allclose(parts.specular, glare * colour, atol=atol)
    np.testing.assert_allclose(parts.diffuse, image * colour - glare * colour, atol=atol)
