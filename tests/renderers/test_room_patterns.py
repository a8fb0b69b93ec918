"""Several surfaces on one object among others: where each is, and light between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pictures import ball_with_coordinates, corner
from PIL import Image
from rooms import needs_arrays

from malus.renderers import Truth, render
from malus.scenes import (
    Area,
    Camera,
    Checker,
    Conductor,
    Dielectric,
    Distant,
    ImageTexture,
    Patterned,
    Placed,
    Plane,
    Sampling,
    Scene,
    Sphere,
    Stripes,
    Suite,
    Surroundings,
    load_suite,
)
from malus.scenes.materials.surface import Surface

pytestmark = needs_arrays

MATT = Dielectric(material="pmma", alpha=0.4, albedo="red", body="polarised")
SHINY = Dielectric(material="water", alpha=0.15, albedo="blue", body="unpolarised")
GOLD = Conductor(material="gold", alpha=0.25)


IN_FRONT = Camera(resolution=24, half_width=1.2)


def among(*objects: Placed, light: object = None, camera: Camera = IN_FRONT) -> Scene:
    """Objects beside a ball that is out of sight."""
    return Scene(
        shape=Sphere(),
        surface=MATT,
        light=light or Distant(incidence_deg=45, azimuth_deg=30),
        camera=camera,
        surroundings=Surroundings(name="room", objects=objects),
    )


def noise_of(truth: Truth, lobe: str) -> np.ndarray:
    return np.asarray(getattr(truth, f"{lobe}_noise"))


def test_with_nothing_near_a_pattern_is_that_of_its_shape_alone() -> None:
    """Against the sum of surfaces that scenes of one object are made of: three kinds of surface."""
    surface = Patterned(pattern=Checker(size=0.4), surfaces=(MATT, SHINY, GOLD))
    alone = Scene(
        shape=Sphere(),
        surface=surface,
        light=Area(incidence_deg=45),
        camera=Camera(resolution=24),
    )
    far = Placed(shape=Sphere(), surface=MATT, position=(0, 0, -500))
    beside = alone.model_copy(update={"surroundings": Surroundings(name="far", objects=(far,))})
    one, other = (render(scene, Sampling(samples=128)) for scene in (alone, beside))
    mask = one.mask & other.mask
    assert (mask == one.mask).mean() > 0.99
    np.testing.assert_allclose(one.eta[mask], other.eta[mask], rtol=1e-6)
    np.testing.assert_allclose(one.alpha[mask], other.alpha[mask], rtol=1e-6)
    for lobe in ("specular", "diffuse"):
        difference = (getattr(one, lobe) - getattr(other, lobe))[mask]
        scale = np.sqrt(one.standard_error**2 + other.standard_error**2)[mask]
        # About 280 pixels, each with the noise of both: mean squares within a third of 1. Lobes
        # have a part of the noise of their sum each.
        assert (difference**2).sum() < 1.3 * (scale**2).sum()
        draws = [noise_of(truth, lobe)[mask] for truth in (one, other)]
        # Sums over pixels, as in test_room: five deviations.
        assert (
            np.abs(difference.sum(axis=0)) <= 5 * np.sqrt(np.square(draws).sum(axis=(0, 1)))
        ).all()


def test_a_pattern_moves_turns_and_grows_with_its_object() -> None:
    """Stripes across x, turned by a right angle, are stripes across z with their turns swapped."""

    def ball(axis: str, turn_deg: float, z: float, *surfaces: Surface) -> Placed:
        paint = Patterned(pattern=Stripes(axis=axis, width=0.37), surfaces=surfaces)
        at = (0.3, 0.2, z)
        return Placed(shape=Sphere(), surface=paint, position=at, scale=0.7, turn_deg=turn_deg)

    # A direct light and one bounce: nothing is random but the place within a pixel.
    once = Sampling(samples=8, max_depth=2)
    turned = among(ball("x", 90, 4.0, MATT, GOLD))
    # To an orthographic camera the distance is the same to the eye.
    straight = among(ball("z", 0, 3.1, MATT, GOLD))
    swapped = among(ball("z", 0, 3.1, GOLD, MATT))
    one, other, third = (render(scene, once) for scene in (turned, straight, swapped))
    seen = [np.allclose(one.alpha, truth.alpha) for truth in (other, third)]
    assert sorted(seen) == [False, True]
    same = other if seen[0] else third
    # Points within 1e-6 of a boundary may fall on either side of it.
    assert np.quantile(np.abs(one.stokes - same.stokes), 0.99) < 1e-5 * one.image.max()


def test_a_plane_does_not_flicker_where_it_is_a_boundary() -> None:
    """A floor lies at y = 0 of its own space, where cubes of a checker end."""
    floor = Patterned(pattern=Checker(size=10), surfaces=(MATT, GOLD, SHINY))
    wall = Placed(shape=Plane(), surface=floor, position=(0.5, 0.4, 3), tilt_deg=90, scale=0.3)
    truth = render(among(wall), Sampling(samples=2, max_depth=2))
    assert set(np.unique(np.asarray(truth.alpha)[truth.mask].round(6))) <= {0.4, 0.25, 0.15}


def test_a_fine_mixture_is_its_mean_between_objects_too(tmp_path: Path) -> None:
    """Bodies are linear in their albedo: half 0.2 and half 0.8 send the light of 0.5, all ways."""
    Image.fromarray(np.full((2, 2), 32768, dtype=np.uint16)).save(tmp_path / "grey.png")
    grey = ImageTexture(path=str(tmp_path / "grey.png"))

    def paint(albedo: float) -> Dielectric:
        return Dielectric(eta=1.5, alpha=0.3, albedo=albedo, body="unpolarised")

    mixed = Patterned(pattern=grey, surfaces=(paint(0.2), paint(0.8)))

    def in_corner(surface: Surface) -> Scene:
        floor = Placed(shape=Plane(), surface=surface, position=(0, -1, 0), tilt_deg=30, scale=9)
        scene = among(floor, light=Area(incidence_deg=60, azimuth_deg=60))
        return scene.model_copy(update={"surface": surface})

    one, other = (render(in_corner(s), Sampling(samples=256)) for s in (mixed, paint(0.5)))
    mask = one.mask & other.mask
    for lobe in ("specular", "diffuse"):
        difference = (getattr(one, lobe) - getattr(other, lobe))[mask].sum(axis=0)
        draws = [noise_of(truth, lobe)[mask] for truth in (one, other)]
        bound = 5 * np.sqrt(np.square(draws).sum(axis=(0, 1)))
        assert (np.abs(difference) <= bound + 1e-5 * other.image[mask].sum()).all()
        # The test sees a hundredth of the light: 0.51 in the place of 0.5.
        assert lobe == "specular" or bound[0, 0] < 0.01 * other.image[mask].sum()


def test_texture_coordinates_stay_with_a_mesh_that_is_moved(tmp_path: Path) -> None:
    """Those of the planar projection give its picture, where the ball stands too."""
    mesh, path = ball_with_coordinates(tmp_path, "obj"), str(corner(tmp_path))
    maps = []
    for projection in ("planar", "uv"):
        texture = ImageTexture(path=path, projection=projection)
        paint = Patterned(pattern=texture, surfaces=(MATT, GOLD))
        ball = Placed(shape=mesh, surface=paint, position=(0.2, 0.1, 4), scale=0.8, turn_deg=20)
        truth = render(among(ball), Sampling(samples=2, max_depth=2))
        maps.append(np.where(truth.mask & (truth.normals[..., 2] > 0.4), truth.alpha, 0))
    np.testing.assert_allclose(*maps, atol=0.01)  # rounding, as in test_patterns
    assert {0.25, 0.4} <= set(maps[0].round(6).ravel())


@pytest.mark.parametrize(
    ("elevation", "tilt"), [(90.0, 0.0), (0.0, 90.0)], ids=["floor from above", "wall"]
)
def test_a_picture_lies_on_the_face_of_a_plane(
    tmp_path: Path, elevation: float, tilt: float
) -> None:
    """Along z a plane is a line: one row of the picture would be smeared all over it."""
    paint = Patterned(
        pattern=ImageTexture(path=str(corner(tmp_path))), surfaces=(MATT, GOLD)
    )  # gold where the picture is white, in its upper right quarter
    camera = Camera(resolution=24, half_width=1.0, elevation_deg=elevation)
    before = tuple(4.0 * camera.axes[2])  # the ball
    plane = Placed(shape=Plane(), surface=paint, position=before, tilt_deg=tilt)
    truth = render(among(plane, camera=camera), Sampling(samples=2, max_depth=2))
    expected = np.full((24, 24), 0.4)
    expected[:12, 12:] = 0.25
    # The picture is mixed within half of its pixels beside an edge, 0.3 of an image pixel there, by
    # a quarter of the step of 0.15 on average; at the corner by both edges: 2 · 0.3 · 0.04 = 0.024.
    np.testing.assert_allclose(truth.alpha[truth.mask], expected[truth.mask], atol=0.03)
    assert truth.mask.sum() >= 22 * 22


SUITE = """
name = "tiles"
shapes = [{ kind = "sphere" }]
materials = [{ eta = 1.5 }]
surfaces = ["obsidian"]
lights = [{ kind = "uniform" }]
wavelengths_nm = [550]
methods = ["eq8"]
camera = { resolution = 8 }

[[surroundings]]
name = "tiles"
[[surroundings.objects]]
shape = { kind = "plane" }
surface = { kind = "patterned", pattern = { kind = "image", path = "tiles.png" }, surfaces = [
    { eta = 1.5, alpha = 0.2 },
    { kind = "conductor", material = "gold", alpha = 0.2 },
] }
position = [0, -1, 0]
"""


def test_a_picture_on_a_floor_is_found_beside_its_suite(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((2, 2), dtype=np.uint8)).save(tmp_path / "tiles.png")
    (tmp_path / "tiles.toml").write_text(SUITE, "utf-8")
    suite = load_suite(tmp_path / "tiles.toml")
    floor = suite.surroundings[0].objects[0].surface
    assert isinstance(floor, Patterned)
    assert isinstance(floor.pattern, ImageTexture)
    assert floor.pattern.checked() == tmp_path / "tiles.png"
    assert floor.pattern.digest
    assert Suite.model_validate_json(suite.model_dump_json()) == suite
