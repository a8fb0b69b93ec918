"""Polarised light on objects: against plain Mitsuba, Fresnel's equations, and laws of polarisers.

Angles of 0 and 90 degrees hide a frame that is turned or mirrored; those here are neither, and
pixels lie off every axis.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plain import CHALK, COPPER, PAINT, by_mitsuba, own_shape
from rooms import needs_arrays

from malus.renderers import Truth, render
from malus.renderers.comparison.plain_mitsuba import lamps
from malus.renderers.families.family import render_family
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Area,
    Camera,
    Conductor,
    Dielectric,
    Distant,
    InputError,
    Light,
    Polariser,
    Sampling,
    Scene,
    Sky,
    SkyPolarisation,
    Sphere,
    Uniform,
)
from malus.scenes.lights.environment import directions, radiance_map, solid_angles
from malus.scenes.lights.lights import transmission_axis
from malus.scenes.materials.surface import Surface

CAMERA = Camera(resolution=12)
MOVED = Camera.model_validate(
    {"resolution": 12, "projection": "perspective", "fov_deg": 50.0, "distance": 2.6}
    | {"azimuth_deg": 35.0, "elevation_deg": 20.0, "roll_deg": 30.0}
)

LAMP = Distant(incidence_deg=60, polarised=Polariser(angle_deg=30))

pytestmark = needs_arrays


def scene_of(
    light: Light, surface: Surface = PAINT, camera: Camera = CAMERA, **more: object
) -> Scene:
    return Scene(shape=Sphere(), surface=surface, light=light, camera=camera, **more)  # type: ignore[arg-type]


def lit(truth: Truth) -> np.ndarray:
    """Pixels of the object that are not in the dark."""
    pixels: np.ndarray = truth.mask & (truth.image[..., 0] > 0.05 * truth.image.max())
    assert pixels.sum() > 25
    return pixels


@pytest.mark.parametrize("camera", [CAMERA, MOVED], ids=["still", "moved"])
@pytest.mark.parametrize("half_angle", [20.0, 60.0])
@pytest.mark.parametrize("surface", [PAINT, COPPER], ids=["paint", "copper"])
def test_a_polarised_lamp_is_mitsubas_lamp_behind_a_plate(
    camera: Camera, half_angle: float, surface: Surface
) -> None:
    """Both lobes; a wide lamp too, whose light crosses the plate obliquely.

    The camera is moved by Mitsuba's own transforms: its matrix is held against its rays elsewhere.
    """
    lamp = Area(incidence_deg=55, azimuth_deg=40, half_angle_deg=half_angle, radiance=4.0)
    scene = scene_of(
        lamp.model_copy(update={"polarised": Polariser(angle_deg=30)}), surface, camera
    )
    truth = render(scene, Sampling(samples=1024))
    runs = 16
    images = by_mitsuba(scene, Sampling(samples=1024), own_shape(scene), runs)
    theirs, pixels = images[..., :3], lit(truth)
    ours, error = truth.stokes[:, :, 0][pixels], truth.standard_error[:, :, 0][pixels]
    mean = theirs.mean(axis=0)[pixels]
    variance = error**2 + theirs.var(axis=0, ddof=1)[pixels] / runs

    def misfit(stokes: np.ndarray) -> np.ndarray:
        result: np.ndarray = (np.square(stokes - mean) / variance).mean(axis=0)
        return result

    # Means over 25 independent pixels or more, with variances from 16 runs: 1 ± 0.3.
    assert (misfit(ours) < 2.2).all()
    # It sees a wrong sign of s2, and light that is turned by 90°.
    assert misfit(ours * [1, 1, -1])[2] > 100
    assert misfit(ours * [1, -1, -1])[1] > 100
    unpolarised = render(scene_of(lamp, surface, camera), Sampling(samples=256))
    assert misfit(unpolarised.stokes[:, :, 0][pixels])[2] > 20


def test_metals_make_circular_light_of_a_lamp_as_mitsubas() -> None:
    """s3 is kept at the first reflection where the lamp is polarised, and nowhere it is zero."""
    lamp = Area(incidence_deg=80, azimuth_deg=40, polarised=Polariser(angle_deg=30))
    scene = scene_of(lamp, COPPER, MOVED)
    truth = render(scene, Sampling(samples=1024))
    assert truth.s3 is not None
    assert truth.s3_standard_error is not None
    runs = 16
    images = by_mitsuba(scene, Sampling(samples=1024), own_shape(scene), runs)
    theirs, pixels = images[..., 3], lit(truth)
    error = truth.s3_standard_error[..., 0][pixels]
    variance = error**2 + theirs.var(axis=0, ddof=1)[pixels] / runs
    ours, mean = truth.s3[..., 0][pixels], theirs.mean(axis=0)[pixels]
    assert np.mean((ours - mean) ** 2 / variance) < 2.2  # as above
    assert np.mean((ours + mean) ** 2 / variance) > 100
    assert render(scene_of(lamp, PAINT, MOVED), Sampling(samples=2)).s3 is None


def mirrored(scene: Scene) -> np.ndarray:
    """s1/s0 and s2/s0 (height, width, 2) of what facets mirror from a distant light, by Jones.

    Fields are vectors in the world, and Fresnel's amplitudes real: nothing of Mitsuba's frames, nor
    of any Mueller matrix, goes into it.
    """
    light, eta = scene.light, scene.eta[0].real
    assert isinstance(light, Distant)
    right, up, back = scene.camera.axes
    toward, degree = np.array(light.direction), 0.0
    waves = [np.cross(toward, axis) for axis in (right, np.cross(toward, right))]
    waves = [wave / np.linalg.norm(wave) for wave in waves]
    weights = [0.5, 0.5]
    if light.polarised:
        degree = light.polarised.degree
        waves, weights = [*waves, transmission_axis(light)], [0.5 * (1 - degree)] * 2 + [degree]
    cosine = np.cos(0.5 * np.arccos(back @ toward))
    refracted = np.sqrt(eta**2 - 1 + cosine**2)
    r_s, r_p = (
        (cosine - refracted) / (cosine + refracted),
        (eta**2 * cosine - refracted) / (eta**2 * cosine + refracted),
    )
    across = np.cross(toward, back)
    across /= np.linalg.norm(across)
    before, after = np.cross(across, -toward), np.cross(across, back)
    stokes = np.zeros(3)
    for wave, weight in zip(waves, weights, strict=True):
        out = r_s * (wave @ across) * across + r_p * (wave @ before) * after
        x, y = out @ right, out @ up
        stokes += weight * np.array([x**2 + y**2, x**2 - y**2, 2 * x * y])
    result: np.ndarray = stokes[1:] / stokes[0]
    return result


@pytest.mark.parametrize("angle", [30.0, 115.0])
@pytest.mark.parametrize("degree", [1.0, 0.6])
@pytest.mark.parametrize(
    "camera",
    [CAMERA, Camera(resolution=12, azimuth_deg=-40, elevation_deg=25, roll_deg=50)],
    ids=["still", "moved"],
)
def test_mirrored_polarised_light_is_fresnels(angle: float, degree: float, camera: Camera) -> None:
    """Parallel light and parallel rays have one half vector, so that every pixel is alike."""
    how = Polariser(angle_deg=angle, degree=degree)
    light = Distant(incidence_deg=75, azimuth_deg=20, polarised=how)
    truth = render(scene_of(light, camera=camera), Sampling(samples=16))
    bright = truth.mask & (truth.specular[:, :, 0, 0] > 0.05 * truth.specular.max())
    stokes = truth.specular[:, :, 0][bright]
    found, expected = stokes[:, 1:] / stokes[:, :1], mirrored(truth.scene)
    # float32 through two rotations of frames
    assert found == pytest.approx(np.broadcast_to(expected, found.shape), abs=2e-5)
    assert np.abs(expected).min() > 0.02  # a sign or an order that is wrong would show
    assert np.abs(expected[0] - expected[1]) > 0.02


@pytest.mark.parametrize("surface", [PAINT, CHALK, COPPER], ids=["paint", "chalk", "copper"])
@pytest.mark.parametrize("lamp", [Distant(incidence_deg=50), Area(incidence_deg=50)])
def test_polarised_lamps_add_up(lamp: Distant | Area, surface: Surface) -> None:
    """Two lamps, crossed at any angle, are twice an unpolarised one; a degree is a mixture.

    Sheets that light crosses obliquely are not quite crossed: this is for parallel light alone.
    """

    def stokes(how: Polariser | None) -> np.ndarray:
        light = lamp.model_copy(update={"polarised": how})
        truth = render(scene_of(light, surface), Sampling(samples=16))
        both: np.ndarray = np.stack([truth.specular, truth.diffuse])
        return both

    plain, one = stokes(Polariser(degree=1e-9)), stokes(Polariser(angle_deg=25))
    # The same random numbers in all: only float32 differs.
    tolerance = 1e-5 * float(plain.max())
    if isinstance(lamp, Distant):
        assert stokes(None) == pytest.approx(plain, abs=tolerance)
        crossed = stokes(Polariser(angle_deg=115))
        assert 0.5 * (one + crossed) == pytest.approx(plain, abs=tolerance)
    assert np.abs(one - plain).max() > 100 * tolerance
    part = stokes(Polariser(angle_deg=25, degree=0.3))
    assert part == pytest.approx(0.3 * one + 0.7 * plain, abs=tolerance)


def test_crossed_polarisers_separate_the_lobes() -> None:
    """Malus' law through the whole renderer: the lamp at the camera, the body depolarises.

    Facets that mirror the lamp face it: what they send is polarised as the lamp is. Light from the
    body is not, and half of it passes at every angle; cross-polarised captures hold nothing else.
    """
    lamp_angle = 30.0
    light = Distant(incidence_deg=0, polarised=Polariser(angle_deg=lamp_angle))
    truth = render(scene_of(light, CHALK), Sampling(samples=64))
    mask, peak = truth.mask, float(truth.image.max())
    for angle in (0.0, 30.0, 75.0, 120.0, 135.0):
        passes = np.cos(np.radians(angle - lamp_angle)) ** 2
        expected = truth.specular[..., 0] * passes + 0.5 * truth.diffuse[..., 0]
        seen = truth.polarised(angle_deg=angle)
        assert seen[mask] == pytest.approx(expected[mask], abs=1e-5 * peak)  # float32
    crossed = truth.polarised(angle_deg=lamp_angle + 90.0)
    assert 2 * crossed[mask] == pytest.approx(truth.diffuse[..., 0][mask], abs=1e-5 * peak)
    assert truth.specular[..., 0].max() > 0.1 * peak


def test_crossed_polarisers_leak_as_the_lamp_moves_away() -> None:
    """Facets then mirror at an angle, and turn light that oscillates oblique to their plane."""
    leaks = []
    for incidence in (0.0, 20.0, 60.0):
        how = Polariser(angle_deg=30)
        light = Distant(incidence_deg=incidence, azimuth_deg=0, polarised=how)
        truth = render(scene_of(light, CHALK), Sampling(samples=16))
        specular = replace(truth, diffuse=np.zeros_like(truth.diffuse))
        crossed, along = (specular.polarised(angle_deg=a)[truth.mask].sum() for a in (120.0, 30.0))
        leaks.append(crossed / along)
    assert leaks[0] < 1e-5
    assert 10 * max(leaks[0], 1e-5) < leaks[1] < 0.1 * leaks[2]


@pytest.mark.parametrize(("azimuth", "expected"), [(0, 0.025), (15, 0.0), (135, 0.25)])
def test_what_leaks_depends_on_the_lamps_azimuth(azimuth: float, expected: float) -> None:
    """Numbers of `physics.md`: the same polariser, the lamp 60° away on another side."""
    surface = Dielectric(material="pmma", alpha=0.2, albedo=0.5, body="unpolarised")
    how = Polariser(angle_deg=30)
    light = Distant(incidence_deg=60, azimuth_deg=azimuth, polarised=how)
    truth = render(scene_of(light, surface), Sampling(samples=16))
    specular = replace(truth, diffuse=np.zeros_like(truth.diffuse))
    leak = specular.polarised(angle_deg=120.0)[truth.mask].sum() / specular.image.sum()
    # Every pixel of specular light leaks alike: noise, resolution and digits of the page are small.
    assert leak == pytest.approx(expected, abs=2e-3)


def test_a_polarised_sky_is_many_polarised_lamps() -> None:
    """Each pixel of its map lights as parallel light would, polarised as the pattern says."""
    sky = Sky(
        sun_elevation_deg=25, sun_azimuth_deg=100, sun=False, polarised=SkyPolarisation(degree=0.8)
    )
    camera = Camera(resolution=10, azimuth_deg=20, roll_deg=15)
    rough = Conductor(eta=0.6, k=2.6, alpha=0.5)
    truth = render(scene_of(sky, rough, camera), Sampling(samples=4096))
    power, toward = coarse(sky)
    total = np.zeros_like(truth.stokes)
    for strength, direction in zip(power, toward, strict=True):
        scene = scene_of(as_lamp(sky, direction, strength), rough, camera)
        total += render(scene, Sampling(samples=64)).stokes
    pixels = lit(truth)
    difference, peak = (truth.stokes - total)[pixels], truth.image.max()
    # Half of it the noise of 4096 samples, half 256 directions in place of all.
    assert (
        np.sqrt(np.mean(difference**2, axis=(0, 1))) < np.array([0.015, 0.005, 0.0025]) * peak
    ).all()
    plain = render(scene_of(sky.model_copy(update={"polarised": None}), rough, camera))
    change = (plain.stokes - truth.stokes)[pixels][..., 1:]
    assert np.sqrt(np.mean(change**2)) > 0.05 * peak


def coarse(sky: Sky) -> tuple[np.ndarray, np.ndarray]:
    """Irradiances (K,) and directions (K, 3) of blocks of the sky's map above the horizon."""
    values, block = radiance_map(sky).astype(float), 16
    height, width = values.shape
    weights = values * solid_angles(height, width)
    toward = directions(height, width) * weights[..., None]

    def summed(plane: np.ndarray) -> np.ndarray:
        shape = (height // block, block, width // block, block, -1)
        result: np.ndarray = plane.reshape(shape).sum(axis=(1, 3))[: height // block // 2]
        return result.reshape(-1, result.shape[-1])

    power, centre = summed(weights[..., None])[:, 0], summed(toward)
    return power, centre / np.linalg.norm(centre, axis=-1, keepdims=True)


def as_lamp(sky: Sky, direction: np.ndarray, irradiance: float) -> Distant:
    """Parallel light, polarised as the sky is there: by the dipoles of Rayleigh's air."""
    sun = np.array(sky.to_sun)
    across = np.cross(direction, sun)
    squared = across @ across
    degree = sky.polarised.degree * squared / (2 - squared) if sky.polarised else 0.0
    lamp = Distant.towards(direction, irradiance)
    right = np.cross([0.0, 1.0, 0.0], direction)
    right /= np.linalg.norm(right)
    angle = np.degrees(np.arctan2(-across @ right, across @ np.cross(direction, right)))
    how = Polariser(angle_deg=float(angle), degree=float(degree))
    return lamp.model_copy(update={"polarised": how})


def test_the_scalar_variant_refuses_polarised_light() -> None:
    with pytest.raises(InputError, match=r"LLVM or CUDA for polarised light, found scalar"):
        render_family([scene_of(LAMP)], Sampling(samples=2), choose("scalar"))


def test_torrance_and_sparrow_know_no_polarised_light() -> None:
    with pytest.raises(InputError, match="expected unpolarised light"):
        render(scene_of(LAMP, CHALK), renderer="torrance-sparrow")


def test_plain_mitsuba_has_plates_for_whole_lamps_only() -> None:
    mi = mitsuba(choose())
    assert set(lamps(mi, Uniform())) == {"light0"}
    for light in (LAMP, Sky(polarised=SkyPolarisation())):
        with pytest.raises(ValueError, match="wholly polarised area light"):
            lamps(mi, light)
