"""What reconstruction is given: whole numbers, lists, masks of numbers, and what does not fit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

import malus
from malus.reconstruct import Components, Observation, get_method
from malus.reconstruct.fresnel import reflectances
from malus.reconstruct.photos.filter import FilterOutput, filter_picture
from malus.reconstruct.photos.knowledge import Knowledge
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.single_image.illuminant import estimate_illuminant
from malus.reconstruct.single_image.light_direction import estimate_direction
from malus.reconstruct.single_image.parameters import fit_parameters
from malus.reconstruct.single_image.separation import separate
from malus.reconstruct.single_image.shape import GivenParameters, recover_shape
from malus.reconstruct.single_image.stereographic import normals_of, to_rim
from malus.scenes import Distant, InputError, Scene, polarisation

ANY: Any = None


@pytest.mark.parametrize("kind", ["uint8", "uint16", "int64", "float16"])
def test_whole_numbers_are_light_too(kind: str) -> None:
    stokes = np.array([[200, 60, 80], [100, 3, 4]]).astype(kind)
    exact = stokes.astype(np.float64)
    close = {"rtol": 2e-3} if kind == "float16" else {"rtol": 1e-15}  # 11 bits, or 53
    for function in (polarisation.dolp, polarisation.aolp, polarisation.phase):
        np.testing.assert_allclose(function(stokes), function(exact), **close)
    np.testing.assert_allclose(
        polarisation.polarised(stokes, 30.0), polarisation.polarised(exact, 30.0), **close
    )
    for found, expected in zip(
        polarisation.extremes(stokes), polarisation.extremes(exact), strict=True
    ):
        np.testing.assert_allclose(found, expected, **close)
    picture = stokes[None, :, :1]
    light = get_method("unpolarised").reconstruct(Observation(picture, np.ones((1, 2), bool)))
    np.testing.assert_allclose(light.polarised(30.0), 0.5 * picture.astype(float), **close)
    light.s1[:] = 1  # of its own
    assert not light.s2.any()


def test_an_angle_is_one_number() -> None:
    for angle in ([0.0, 30.0], "30", np.nan):
        with pytest.raises(ValueError, match="angle_deg: expected a finite angle"):
            polarisation.polarised(np.ones(3), angle)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["shadowed", "shadowed+body", "lights", "lights+body"])
def test_methods_that_know_distributions_work_on_photographs(method: str) -> None:
    """Untold it is Beckmann's, as for every other method."""
    y, x = np.mgrid[1:-1:24j, -1:1:24j]
    mask = x**2 + y**2 < 0.8
    z = np.sqrt(np.clip(1 - x**2 - y**2, 0, None))
    normals = np.where(mask[..., None], np.stack([x, y, z], axis=-1), 0).astype(np.float32)
    light = np.where(mask, z, 0)[..., None] * np.array([0.9, 0.5, 0.2])
    light += np.where(mask & (z > 0.9), 0.5, 0)[..., None]
    told = Knowledge(normals, mask, light=(0.3, 0.3, 1.0), eta=1.5, alpha=0.2, method=method)
    found = filter_picture(Picture(light.astype(np.float32), "EXR", None), knowledge=told)
    assert np.hypot(found.components.s1, found.components.s2)[mask].max() > 0


@pytest.mark.parametrize("alpha", [0.003, 0.01, 0.1])
def test_known_lights_of_one_direction_are_a_half_vector(alpha: float) -> None:
    """However smooth: facets that mirror a lamp polarise it alike, wherever the mean normal is."""
    y, x = np.mgrid[1:-1:16j, -1:1:16j]
    mask = x**2 + y**2 < 0.8
    normals = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, None))], axis=-1)
    specular = np.ones((16, 16, 1))
    seen = Observation(
        specular, mask, specular=specular, diffuse=0 * specular, normals=normals, alpha=alpha,
        eta=np.array([1.5]), light=Distant(incidence_deg=60, azimuth_deg=35),
    )  # fmt: skip
    one, other = (get_method(name).reconstruct(seen) for name in ("lights", "half_vector"))
    assert (np.hypot(one.s1, one.s2)[mask] > 0.1).all()
    np.testing.assert_allclose(one.s1, other.s1, atol=1e-6)  # single precision
    np.testing.assert_allclose(one.s2, other.s2, atol=1e-6)


def test_normals_of_a_limb_are_valid() -> None:
    """Also where rounding takes them behind it."""
    turn = np.linspace(0, 2 * np.pi, 10001)
    assert (normals_of(*to_rim(1.3 * np.cos(turn), 1.3 * np.sin(turn)))[:, 2] >= 0).all()
    ones, mask = np.ones((1, 2, 1), np.float32), np.ones((1, 2), bool)
    normals = np.array([[[1, 0, -4.4e-8], [1, 0, 0]]], np.float32)
    given = {"specular": 0 * ones, "diffuse": ones, "normals": normals, "eta": np.array([1.5])}
    seen = Observation(ones, mask, **given, alpha=0.3)
    for name in ("eq8+body", "shadowed+body"):
        light = get_method(name).reconstruct(seen)
        assert light.invalid(mask) == 0
        assert light.s1[0, 0, 0] == light.s1[0, 1, 0] != 0
    behind = Observation(
        ones, mask, **given | {"normals": np.array([[[1, 0, -1e-3]] * 2])}, alpha=0.3
    )
    assert get_method("eq8+body").reconstruct(behind).invalid(mask) == 2


def ball() -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[1:-1:16j, -1:1:16j]
    facing = np.sqrt(np.clip(1 - (x**2 + y**2) / 0.8, 0, None))
    return facing[..., None], x**2 + y**2 < 0.8


def test_a_shape_is_recovered_from_what_others_take_too() -> None:
    image, mask = ball()
    given, towards = GivenParameters(body="unpolarised"), np.array([0.0, 0.0, 1.0])
    expected = recover_shape(image, mask, towards, given).normals
    for same in (mask.astype(float), 255 * mask.astype(np.uint8), mask.astype(np.uint8)):
        np.testing.assert_array_equal(recover_shape(image, same, towards, given).normals, expected)
    longer = recover_shape(image, mask, 5 * towards, given).normals
    np.testing.assert_array_equal(longer, expected)
    broken = image.copy()
    broken[8, 8] = np.nan
    angles = np.sum(recover_shape(broken, mask, towards, given).normals * expected, axis=-1)[mask]
    assert np.median(angles) > 0.99  # 8°: one of a hundred pixels tells nothing
    with pytest.raises(InputError, match="direction: expected a vector"):
        recover_shape(image, mask, np.zeros(3), given)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"normals": 2.0}, "normals: expected unit vectors, found lengths from 2 to 2"),
        ({"body": "lambert"}, "body: expected one of unpolarised, polarised, found lambert"),
        ({"pixels": np.ones(5)}, r"shapes \(n, bands\) and \(n, 3\), found \(5,\)"),
        ({"direction": [0, 0]}, "direction: expected a vector"),
        ({"irradiance": -1.0}, "irradiance: expected a finite number above 0, found -1.0"),
        ({"irradiance": np.inf}, "irradiance: expected a finite number above 0, found inf"),
        ({"eta": 0}, "eta: expected a finite number above 0, found 0"),
        ({"alpha": 0.0}, "alpha: expected a finite number above 0, found 0.0"),
        ({"alpha": np.nan}, "alpha: expected a finite number above 0, found nan"),
    ],
)
def test_fits_refuse_what_is_no_surface(change: dict[str, Any], says: str) -> None:
    facing = np.tile([0.0, 0.0, 1.0], (5, 1))
    told = {"pixels": np.ones((5, 1)), "normals": facing, "direction": facing[0]}
    told |= {"body": "unpolarised", "alpha": 0.3} | change
    if isinstance(told["normals"], float):
        told["normals"] = told["normals"] * facing
    with pytest.raises(InputError, match=says):
        fit_parameters(**told)


@pytest.mark.parametrize(
    "given", [{"irradiance": 0.0}, {"eta": -1.5}, {"alpha": np.nan}, {"body": "polarized"}]
)
def test_what_is_given_of_a_surface_is_possible(given: dict[str, Any]) -> None:
    """A negative irradiance had an index of 2.58, without a word."""
    (name,) = given
    with pytest.raises(InputError, match=f"{name}: expected"):
        GivenParameters(**given)


def test_lists_and_arrays_have_the_same_surface_and_light() -> None:
    pixels, normals, light = made_up_ball()
    fit, same = (
        fit_parameters(p, n, d, "unpolarised", alpha=0.3)
        for p, n, d in (
            (pixels, normals, light),
            (pixels.tolist(), normals.tolist(), light.tolist()),
        )
    )
    np.testing.assert_array_equal(same.albedo, fit.albedo)
    grey = pixels.mean(axis=1)
    np.testing.assert_array_equal(
        estimate_direction(grey.tolist(), normals.tolist()), estimate_direction(grey, normals)
    )
    for wrong in (pixels, grey[:-1], grey[:, None, None]):
        with pytest.raises(InputError, match=r"shapes \(n,\) and \(n, 3\), found .*take the mean"):
            estimate_direction(wrong, normals)


def test_pixels_that_are_no_numbers_are_told_of() -> None:
    """The search said that its solver cannot continue, and that the object is dark."""
    pixels, normals, light = made_up_ball()
    torn = pixels.copy()
    torn[[3, 5], 0] = np.nan, np.inf
    for wrong, found in ((torn, f"2 of {len(pixels)} that are not"), (pixels[:0], "0 of 0")):
        some = normals[: len(wrong)]
        with pytest.raises(InputError, match=f"pixels: expected at least one.*{found}"):
            fit_parameters(wrong, some, light, "unpolarised", irradiance=1.0)
        with pytest.raises(InputError, match=f"pixels: expected at least one.*{found}"):
            estimate_direction(wrong[:, 0], some)


def test_a_specular_lobe_belongs_to_its_picture() -> None:
    image, mask = ball()
    light, given = np.array([0.0, 0.0, 1.0]), GivenParameters(alpha=0.3, body="unpolarised")
    lobe = np.where(image > 0.95, 0.2, 0.0)
    whole = recover_shape(image + lobe, mask, light, given, lobe)
    listed = recover_shape((image + lobe).tolist(), mask.tolist(), light, given, lobe.tolist())
    np.testing.assert_array_equal(listed.normals, whole.normals)
    for wrong in (lobe[..., 0], lobe[:5]):
        with pytest.raises(InputError, match=r"specular: expected shape \(16, 16, 1\)"):
            recover_shape(image + lobe, mask, light, given, wrong)
    # A pixel that is no number in either picture is off the object in both.
    lobe[8, 8] = np.nan
    torn = recover_shape(image, mask, light, given, lobe).normals
    assert np.isfinite(torn).all()
    assert not torn[8, 8].any()


def made_up_ball() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (n, 2), normals (n, 3) and light of Lambert's ball."""
    image, mask = ball()
    y, x = np.mgrid[1:-1:16j, -1:1:16j] / np.sqrt(0.8)
    normals = np.stack([x[mask], y[mask], image[mask][:, 0]], axis=-1)
    light = np.array([0.6, 0.0, 0.8])
    return np.clip(normals @ light, 0, None)[:, None] * [0.5, 1.0], normals, light


def test_pictures_and_masks_belong_together() -> None:
    image, mask = ball()
    for function in (
        lambda i, m: estimate_illuminant(i, m, "gray-world"),
        separate,
        lambda i, m: recover_shape(i, m, np.array([0.0, 0.0, 1.0])),
    ):
        with pytest.raises(InputError, match=r"image: expected \(height, width, bands\)"):
            function(image[..., 0], mask)
        with pytest.raises(InputError, match=r"mask: expected shape \(16, 16\)"):
            function(np.tile(image, 3), mask[:8])


def test_lists_are_arrays_too() -> None:
    seen = Observation(
        [[[1.0]]], [[1]], normals=[[[0.6, 0, 0.8]]], eta=[1.5], alpha=0.3,
        specular=[[[0.2]]], diffuse=[[[0.8]]],
    )  # fmt: skip
    assert get_method("eq8").reconstruct(seen).s1.shape == (1, 1, 1)
    assert Knowledge(labels=[[0, 1, 2]]).mask.tolist() == [[False, True, True]]
    one = Knowledge(eta=np.array(1.5), alpha=np.float32(0.2))  # type: ignore[arg-type]
    assert (one.eta, one.alpha) == (1.5, np.float32(0.2))
    with pytest.raises(InputError, match="labels: expected whole numbers"):
        Knowledge(labels=np.array([[0, np.nan]]))
    light = Components(np.ones((1, 1, 1)), ANY, ANY, valid=np.array([[False]]))
    assert light.invalid(np.ones((1, 1))) == 1


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: get_method(ANY), "method: expected the name of a method, found NoneType"),
        (lambda: get_method(get_method("eq8")), "the name of a method, found Method"),  # type: ignore[arg-type]
        (lambda: Knowledge(light=Distant(incidence_deg=3)), "light: expected a direction X,Y,Z"),  # type: ignore[arg-type]
        (lambda: Knowledge(eta=1.5 + 1j), "eta: expected a refractive index"),  # type: ignore[arg-type]
        (lambda: Knowledge(alpha=[0.1]), "alpha: expected a roughness"),  # type: ignore[arg-type]
        (lambda: Knowledge(eta="1.5"), "eta: expected a refractive index"),  # type: ignore[arg-type]
        (
            lambda: filter_picture(
                Picture(np.ones((4, 4, 3), np.float32), "EXR", None),
                output=FilterOutput(("30",)),  # type: ignore[arg-type]
            ),
            "angles: expected degrees from the vertical, found 30",
        ),
        (lambda: filter_picture(np.ones((4, 4, 3))), "a path or a malus.Picture, found ndarray"),  # type: ignore[arg-type]
        (lambda: malus.render(Scene, renderer=ANY), "expected"),  # type: ignore[arg-type]
        (lambda: separate(*ball(), method=ANY), "found None"),
    ],
)
def test_what_is_of_another_kind_is_one_line(call: Any, says: str) -> None:
    with pytest.raises(InputError) as error:
        call()
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_light_is_one_of_malus() -> None:
    with pytest.raises(ValueError, match=r"light: expected one of malus\.scenes, found 'distant'"):
        Observation(np.ones((1, 1, 1)), np.ones((1, 1)), light="distant")  # type: ignore[arg-type]


def test_a_picture_with_what_is_no_number_is_told(tmp_path: Path) -> None:
    light = np.ones((8, 8, 3), np.float32)
    light[3, 3] = np.nan
    with pytest.raises(InputError, match="expected finite values, found 3 others"):
        filter_picture(Picture(light, "EXR", None), knowledge=Knowledge(method="unpolarised"))
    one = FilterOutput(angles_deg=30.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="angles: expected a list of degrees, found 30"):
        filter_picture(Picture(light, "EXR", None), tmp_path, output=one)


def test_no_surface_reflects_more_than_all() -> None:
    cosine = np.linspace(0, 1, 2001)[:, None]
    index = np.array([0.5, 0.66, 0.9, 1.5, 0.2 + 3j, 0.01 + 20j])
    for part in reflectances(cosine, index):
        assert part.max() <= 1.0
        assert part.min() >= 0.0


@pytest.mark.parametrize(
    "told",
    [
        {"mask": np.ones((8, 7), bool)},
        {"labels": np.ones((3, 3), int)},
        {"normals": np.zeros((9, 8, 3), np.float32)},
    ],
    ids=lambda told: next(iter(told)),
)
def test_what_is_of_another_size_than_the_picture_is_told(told: dict[str, Any]) -> None:
    """Normals ended in a message of NumPy, and what is no InputError in a traceback."""
    picture = Picture(np.full((8, 8, 3), 0.5, np.float32), "EXR", None)
    (name,) = told
    with pytest.raises(InputError, match=rf"^{name}: expected shape \(8, 8"):
        filter_picture(picture, knowledge=Knowledge(**told, method="unpolarised"))


def test_a_page_is_chosen_by_its_number(tmp_path: Path) -> None:
    pages = np.arange(3 * 64, dtype=np.float32).reshape(3, 8, 8)
    tifffile.imwrite(tmp_path / "a.tif", pages, photometric="minisblack")
    for part in (2, "2"):
        found = malus.read_picture(tmp_path / "a.tif", part=part).linear[..., 0]
        np.testing.assert_array_equal(found, pages[1])
    for part in (0, 4, "²", "x", -1):
        with pytest.raises(InputError, match=f"part: expected a page from 1 to 3, found {part}"):
            malus.read_picture(tmp_path / "a.tif", part=part)
    with pytest.raises(InputError, match="path: expected a path, found NoneType"):
        malus.read_picture(ANY)
