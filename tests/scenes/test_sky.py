"""Sky, sun and radiance maps: against Mitsuba's own `sunsky`, and the files that maps come in."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import pytest

from malus.bench import score
from malus.renderers import Truth
from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.translate import diffuse_bsdf, sensor, shape_object, specular_bsdf
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Camera,
    Dielectric,
    Environment,
    InputError,
    Sampling,
    Scene,
    Sky,
    Sphere,
    load_suite,
)
from malus.scenes.lights.environment import radiance_map
from malus.scenes.lights.sky import radiance, sun
from malus.scenes.materials.surface import Facets

CAMERA = Camera(resolution=24)
SKIES = (
    Sky(sun_elevation_deg=45, turbidity=3),
    Sky(sun_elevation_deg=10, turbidity=2.5, sun_azimuth_deg=-120),
    Sky(sun_elevation_deg=80, turbidity=9.5, wavelength_nm=450),
    Sky(
        sun_elevation_deg=30, turbidity=10, wavelength_nm=700, sun_azimuth_deg=180
    ),  # Mitsuba reads past its table at 720
)

FACETS = Facets((0.2, 0.2))


@pytest.fixture
def mi() -> Any:
    """Mitsuba's scalar variant, after the vectorised one: no LLVM is found the other way round."""
    mitsuba(choose())
    return mitsuba(choose("scalar"))


def mitsubas(mi: Any, sky: Sky, **scales: float) -> dict[str, object]:
    """Mitsuba's emitter for a sky; its z is up, our y."""
    return {
        "type": "sunsky",
        "turbidity": sky.turbidity,
        "sun_direction": list(sky.to_sun),
        "albedo": 0.3,
        "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90),
        **scales,
    }


def their_radiance(mi: Any, emitter: Any, toward: np.ndarray, wavelength_nm: float) -> float:
    seen = mi.SurfaceInteraction3f()
    seen.wi, seen.wavelengths = mi.Vector3f(*(-toward)), [wavelength_nm] * 4
    return float(np.ravel(emitter.eval(seen)[0, 0])[0])


@pytest.mark.parametrize("sky", SKIES, ids=lambda sky: sky.label)
def test_radiance_is_that_of_mitsubas_sky(mi: Any, sky: Sky) -> None:
    emitter = mi.load_dict(mitsubas(mi, sky, sun_scale=0.0))
    toward = np.random.default_rng(1).normal(size=(64, 3))
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    theirs = np.array([their_radiance(mi, emitter, one, sky.wavelength_nm) for one in toward])
    assert (theirs > 0).sum() > 20
    # Theirs is computed in float32; exponentials lose another digit.
    np.testing.assert_allclose(radiance(sky, toward), theirs, rtol=2e-5, atol=1e-9)


@pytest.mark.parametrize("sky", SKIES, ids=lambda sky: sky.label)
def test_the_sun_is_mitsubas_sun(mi: Any, sky: Sky) -> None:
    emitter = mi.load_dict(mitsubas(mi, sky, sky_scale=0.0))
    cone = 2 * math.pi * (1 - math.cos(math.radians(0.5358 / 2)))
    theirs = their_radiance(mi, emitter, np.array(sky.to_sun), sky.wavelength_nm) * cone
    # Mitsuba interpolates in the same table in another way, and its cone's angle in float32.
    assert sun(sky).irradiance == pytest.approx(theirs, rel=0.015)
    assert sun(sky).direction == pytest.approx(sky.to_sun, abs=1e-12)


def test_a_ball_under_the_sky_looks_as_under_mitsubas_own(mi: Any) -> None:
    """The map's resolution, the narrow sun taken for parallel light: no more than a percent."""
    sky = Sky(sun_elevation_deg=40, sun_azimuth_deg=50)
    surface = Dielectric(eta=1.5, alpha=0.2, albedo=1.0, body="unpolarised")
    scene = Scene(shape=Sphere(), surface=surface, light=sky, camera=CAMERA)
    ours = render_family([scene], Sampling(samples=256, seed=1)).truth(scene)
    mitsuba(choose("scalar"))
    window = {
        "type": "uniform",
        "wavelength_min": sky.wavelength_nm - 0.5,
        "wavelength_max": sky.wavelength_nm + 0.5,
        "value": 1.0,
    }

    def seen(light: dict[str, object], bsdf: dict[str, object]) -> np.ndarray:
        scene = {
            "type": "scene",
            "sensor": sensor(mi, CAMERA) | {"srf": window},
            "shape": shape_object(mi, Sphere(), mi.load_dict(bsdf)),
            "light": light,
            "integrator": {
                "type": "stokes",
                "path": {"type": "path", "max_depth": 2, "hide_emitters": False},
            },
        }
        image: np.ndarray = np.asarray(mi.render(mi.load_dict(scene), spp=256, seed=3))
        return image[..., [-11, -8, -5]]

    one = {"type": "constant", "radiance": {"type": "uniform", "value": 1.0}}
    unit = float(
        seen(one, diffuse_bsdf(1.5, FACETS, "unpolarised"))[
            [0, 0, -1, -1], [0, -1, 0, -1], 0
        ].mean()
    )
    for lobe, bsdf in (
        (ours.specular, specular_bsdf(1.5, FACETS)),
        (ours.diffuse, diffuse_bsdf(1.5, FACETS, "unpolarised")),
    ):
        theirs = seen(mitsubas(mi, sky), bsdf)[ours.mask] / unit
        mine = lobe[:, :, 0][ours.mask]
        brightness = float(theirs[:, 0].mean())
        # 300 pixels of 256 samples leave half a percent of noise, the sun's table as much.
        assert mine.mean(axis=0) == pytest.approx(theirs.mean(axis=0), abs=0.02 * brightness)
        assert np.sqrt(np.mean((mine - theirs) ** 2)) < 0.1 * brightness


@pytest.mark.parametrize("with_sun", [True, False])
def test_the_method_that_knows_the_lights_knows_the_sky(with_sun: bool) -> None:
    truth = truth_under(Sky(sun=with_sun))
    assert score(truth, "lights+body").skill == pytest.approx(1.0, abs=0.01)
    assert score(truth, "shadowed+body").skill < 0.98


def truth_under(light: Sky | Environment) -> Truth:
    surface = Dielectric(eta=1.5, alpha=0.3)
    scene = Scene(shape=Sphere(), surface=surface, light=light, camera=Camera(resolution=40))
    return render_family([scene], Sampling(samples=64, seed=2)).truth(scene)


def made_up_map() -> np.ndarray:
    return np.random.default_rng(3).uniform(0.5, 200.0, (8, 16, 3)).astype(np.float32)


def write_hdr(path: Path, colours: np.ndarray) -> Path:
    path.write_bytes(imagecodecs.rgbe_encode(np.ascontiguousarray(colours), header=True))
    return path


def test_a_radiance_file_gives_the_map_that_it_holds(tmp_path: Path) -> None:
    """RGBE shares one exponent among three mantissas of 8 bits: 1/128 of the brightest colour."""
    colours = made_up_map()
    found = radiance_map(Environment(name=str(write_hdr(tmp_path / "map.hdr", colours))))
    assert np.abs(found - colours.mean(axis=-1)).max() < colours.max() / 128
    exr = tmp_path / "map.exr"
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": colours}).write(str(exr))
    assert found == pytest.approx(radiance_map(Environment(name=str(exr))), rel=0.01, abs=1.0)


@pytest.mark.parametrize("kind", ["PF", "Pf"])
def test_a_file_of_floats_gives_the_map_that_it_holds(tmp_path: Path, kind: str) -> None:
    """Its bottom row stands first: a map upside down would light from the floor."""
    colours = made_up_map() if kind == "PF" else made_up_map()[..., :1]
    rows = b"".join(row.astype(">f4").tobytes() for row in colours[::-1])
    path = tmp_path / "map.pfm"
    path.write_bytes(f"{kind}\n16 8\n1.0\n".encode() + rows)
    found = radiance_map(Environment(name=str(path)))
    np.testing.assert_allclose(found, colours.mean(axis=-1), rtol=1e-6)  # float32


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "size reads -Y height"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n+X 4 -Y 4\n", "size reads -Y height"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 99999 +X 99999\n", "64 megapixels"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 64 +X 64\n\x02\x02", "a whole Radiance file"),
    ],
)
def test_a_broken_radiance_file_is_refused(tmp_path: Path, content: bytes, expected: str) -> None:
    path = tmp_path / "map.hdr"
    path.write_bytes(content)
    with pytest.raises(InputError, match=expected):
        radiance_map(Environment(name=str(path)))


@pytest.mark.parametrize(
    ("line", "is_read"),
    [
        ("EXPOSURE=4.0", False),
        ("EXPOSURE=11", False),
        ("EXPOSURE=1.01", False),
        ("EXPOSURE=bright", False),
        ("EXPOSURE= 1.0", True),
        ("EXPOSURE=1.0000e+00", True),
        ("COLORCORR=1.01 1 1", False),
        ("COLORCORR=1 1 1.00", True),
        ("COLORCORR=1 0.9 1", False),
        ("SOFTWARE=EXPOSURE=2", True),
    ],
)
def test_numbers_that_are_no_radiance_are_refused(tmp_path: Path, line: str, is_read: bool) -> None:
    path = write_hdr(tmp_path / "map.hdr", made_up_map())
    content = path.read_bytes()
    first, rest = content.split(b"\n", 1)
    path.write_bytes(first + b"\n" + line.encode() + b"\n" + rest)
    light = Environment(name=str(path))
    if is_read:
        write_hdr(tmp_path / "plain.hdr", made_up_map())
        plain = radiance_map(Environment(name=str(tmp_path / "plain.hdr")))
        np.testing.assert_array_equal(radiance_map(light), plain)
        return
    with pytest.raises(InputError, match=f"without EXPOSURE or COLORCORR, found {line}"):
        radiance_map(light)


def test_colours_of_other_primaries_are_refused(tmp_path: Path) -> None:
    path = write_hdr(tmp_path / "map.hdr", made_up_map())
    path.write_bytes(path.read_bytes().replace(b"32-bit_rle_rgbe", b"32-bit_rle_xyze"))
    with pytest.raises(InputError, match="found FORMAT=32-bit_rle_xyze"):
        radiance_map(Environment(name=str(path)))


def test_suites_name_skies_and_radiance_files(tmp_path: Path) -> None:
    write_hdr(tmp_path / "map.hdr", made_up_map())
    (tmp_path / "suite.toml").write_text(
        'name = "out"\nshapes = [{ kind = "sphere" }]\nmaterials = ["pmma"]\n'
        'surfaces = ["carbon"]\nwavelengths_nm = [550]\nmethods = ["eq8"]\n'
        'lights = [{ kind = "sky", sun_elevation_deg = 20 }, '
        '{ kind = "environment", name = "map.hdr" }]\n'
    )
    sky, environment = load_suite(tmp_path / "suite.toml").lights
    assert sky == Sky(sun_elevation_deg=20)
    assert isinstance(environment, Environment)
    assert len(environment.digest) == 16  # known by content
    assert radiance_map(environment).shape == (8, 16)
