"""Maps of depth, position, normals, ids and surfaces against geometry written out here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rooms import needs_arrays, table

from malus.renderers import render
from malus.renderers.mitsuba import surface_maps
from malus.renderers.mitsuba.surface_maps import render_maps
from malus.renderers.variant import Variant, choose
from malus.scenes import (
    Camera,
    Checker,
    Conductor,
    Dielectric,
    InputError,
    MeshFile,
    Patterned,
    Placed,
    Plane,
    Sampling,
    Scene,
    Sphere,
    Stripes,
    Surroundings,
    Torus,
    Uniform,
)
from malus.scenes.maps import MAPS, different_surfaces

PAINT = Dielectric(eta=1.5, alpha=0.3, albedo="blue")
WIDE = Camera(resolution=24, projection="perspective", fov_deg=50, distance=3)
ROLLED = WIDE.model_copy(update={"roll_deg": 30.0})


def scene(camera: Camera, surface: object = PAINT, shape: object = None) -> Scene:
    return Scene(
        shape=shape or Sphere(),
        surface=surface,
        light=Uniform(),
        camera=camera,
        wavelengths_nm=(450.0, 650.0),
    )


def rays(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (16, height, width, 3) of a camera that is not rolled."""
    side = camera.resolution
    steps = (np.arange(4 * side) + 0.5) / (2 * side) - 1  # -1..1, four a pixel
    x, y = np.meshgrid(steps, -steps)
    if camera.distance is None:
        x, y = camera.half_width * x, camera.half_width * y
        origin = np.stack([x, y, np.full_like(x, 10.0)], axis=-1)
        direction = np.broadcast_to([0.0, 0.0, -1.0], origin.shape)
    else:
        edge = np.tan(np.radians(camera.fov_deg / 2))
        direction = np.stack([edge * x, edge * y, np.full_like(x, -1.0)], axis=-1)
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        origin = np.broadcast_to([0.0, 0.0, camera.distance], direction.shape)
    return tuple(
        a.reshape(side, 4, side, 4, 3).transpose(1, 3, 0, 2, 4).reshape(16, side, side, 3)
        for a in (origin, direction)
    )


@needs_arrays
@pytest.mark.parametrize("camera", [Camera(resolution=24), WIDE], ids=["orthographic", "wide"])
def test_a_sphere_is_where_its_equation_says(camera: Camera) -> None:
    """|o + t d| = 1 for every ray; maps are means over those that hit."""
    maps = render_maps(scene(camera), tuple(MAPS), choose())
    origin, direction = rays(camera)
    b = np.sum(origin * direction, axis=-1)
    under = b**2 - np.sum(origin**2, axis=-1) + 1
    hits = under > 0
    points = origin + (-b - np.sqrt(np.where(hits, under, 0)))[..., None] * direction
    count = hits.sum(axis=0)
    mean = np.sum(points * hits[..., None], axis=0) / np.maximum(count, 1)[..., None]
    # Rays that graze the sphere may hit or miss it in float32: one of 16 at a few outline pixels.
    same = maps["coverage"] * 16 == count
    assert same.mean() > 0.99
    # Mitsuba computes in float32; near the rim the square root magnifies it.
    assert np.abs(maps["position"] - mean)[same].max() < 2e-3
    assert np.abs(maps["position"] - mean)[count == 16].max() < 2e-4
    depth = np.where(count > 0, (camera.distance or 0) - mean[..., 2], 0)
    assert np.abs(maps["depth"] - depth)[same].max() < 2e-3
    unit = mean / np.maximum(np.linalg.norm(mean, axis=-1, keepdims=True), 1e-9)
    for name in ("shading_normals", "geometric_normals"):
        assert np.abs(maps[name] - unit)[same].max() < 2e-3
    assert np.array_equal(maps["object_id"][same], (count > 0)[same])
    assert np.array_equal(maps["material_id"], maps["object_id"])
    off = maps["object_id"] == 0
    assert all((values[off] == 0).all() for values in maps.values())


@needs_arrays
def test_coordinates_of_a_sphere_are_longitude_and_latitude() -> None:
    maps = render_maps(scene(Camera(resolution=64)), ("position", "uv", "coverage"), choose())
    inner = maps["coverage"] == 1
    x, y, z = maps["position"][inner].T
    u = 0.5 + np.arctan2(x, z) / (2 * np.pi)
    v = 0.5 + np.arcsin(np.clip(y, -1, 1)) / np.pi
    # They are those of one ray, a quarter of a pixel from the centre; steeper towards the rim.
    near = np.hypot(x, y) < 0.8
    assert np.abs(maps["uv"][inner][near] - np.stack([u, v], -1)[near]).max() < 0.02


@needs_arrays
def test_coordinates_of_a_mesh_are_its_own(tmp_path: Path) -> None:
    path = tmp_path / "square.obj"
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    lines = [f"v {x} {y} 0" for x, y in corners]
    lines += [f"vt {0.2 + 0.1 * x} {0.6 + 0.3 * y}" for x, y in corners]
    path.write_text("\n".join([*lines, "f 1/1 2/2 3/3", "f 1/1 3/3 4/4"]), "utf-8")
    maps = render_maps(
        scene(Camera(resolution=32), shape=MeshFile(path=str(path))), tuple(MAPS), choose()
    )
    inner = maps["coverage"] == 1
    half = np.sqrt(0.5)  # a mesh fits the unit sphere
    assert inner.sum() > 300
    expected = [0.2, 0.6] + [0.1, 0.3] * maps["position"][inner][:, :2] / half
    # A quarter of a pixel of 32 from the mean of its rays, times the slope.
    assert np.abs(maps["uv"][inner] - expected).max() < 0.3 / half * 2.1 / 32 / 2


@needs_arrays
def test_coordinates_of_a_plane_are_those_of_its_square() -> None:
    described = table(Uniform(), resolution=24)
    maps, floor = render_maps(described, tuple(MAPS), choose()), described.objects[1]
    inner = (maps["object_id"] == 2) & (maps["coverage"] == 1)
    own = (maps["position"][inner] - np.array(floor.position)) @ floor.rotation / floor.scale
    assert np.abs(own[:, 1]).max() < 1e-5  # it lies in its own plane
    expected = np.stack([0.5 + 0.5 * own[:, 0], 0.5 - 0.5 * own[:, 2]], axis=-1)
    # A pixel of 0.15 is 0.004 of half the floor, and twice that on its slope of 30 degrees.
    assert np.abs(maps["uv"][inner] - expected).max() < 0.005


@needs_arrays
@pytest.mark.parametrize("camera", [WIDE, ROLLED], ids=["upright", "rolled"])
def test_normals_and_surfaces_are_those_of_the_truth(camera: Camera) -> None:
    parts = (PAINT, Conductor(material="gold", alpha=0.1))
    striped = Patterned(pattern=Stripes(width=0.3), surfaces=parts)
    described = scene(camera, striped, Torus())
    truth = render(described, Sampling(samples=64))
    maps = render_maps(described, tuple(MAPS), choose())
    inner = truth.mask & (maps["coverage"] == 1)
    assert inner.sum() > 100
    # Random samples of a pixel against a grid in it: less than a pixel's change of normal.
    difference = np.abs(maps["shading_normals"] - truth.normals)[inner]
    assert np.median(difference) < 0.01
    assert np.sum(maps["geometric_normals"] * maps["shading_normals"], -1)[inner].min() > 0.99
    # The same rays tell the shares of surfaces.
    assert maps["alpha"][inner] == pytest.approx(truth.alpha_map[inner], abs=1e-6)
    assert np.abs(maps["eta"] - truth.eta_map)[inner].max() < 1e-5
    whole = np.isin(maps["alpha"], np.float32([0.3, 0.1])) & inner
    assert np.array_equal(maps["material_id"][whole] == 2, maps["alpha"][whole] < 0.2)
    blue = np.where(maps["material_id"] == 1, np.float32(0.309), 0)
    assert maps["albedo"][..., 0][whole] == pytest.approx(blue[whole], abs=1e-6)


@needs_arrays
def test_a_brushed_metal_has_one_roughness_in_maps() -> None:
    """√(α_u α_v), as methods are told."""
    brushed = Conductor(material="gold", alpha=(0.1, 0.4))
    maps = render_maps(scene(WIDE, brushed), tuple(MAPS), choose())
    inner = maps["coverage"] == 1
    assert inner.sum() > 100
    assert maps["alpha"][inner] == pytest.approx(0.2, abs=1e-7)


@needs_arrays
def test_pixels_at_an_outline_are_of_one_object() -> None:
    described = table(Uniform(), resolution=24)
    maps = render_maps(described, tuple(MAPS), choose())
    ids = maps["object_id"]
    assert set(np.unique(ids)) == {0, 1, 2, 3, 4} - ({0} - set(np.unique(ids)))
    for number in (1, 3):  # the balls
        placed = described.objects[number - 1]
        mixed = (ids == number) & (maps["coverage"] < 1)
        away = np.linalg.norm(maps["position"] - np.array(placed.position), axis=-1)[mixed]
        assert mixed.sum() > 5
        # A mean of points on a sphere lies inside it, by less than a pixel squared over its radius.
        pixel = 2 * described.camera.half_width / described.camera.resolution
        assert away.max() < placed.scale + 1e-4
        assert away.min() > placed.scale - pixel
        assert maps["coverage"][mixed].min() * 16 >= 4  # most of 16 rays among 4 objects at most
    truth = render(described, Sampling(samples=4))
    same = truth.mask & (maps["coverage"] == 1)
    assert np.abs(maps["eta"] - truth.eta_map)[same].max() < 1e-6


@needs_arrays
@pytest.mark.parametrize("distance", [3.0, 9500.0])
def test_maps_reach_as_far_as_the_render(distance: float) -> None:
    """A ball before a wall that is far behind it: the mask has it, and so must all maps."""
    fov = float(2 * np.degrees(np.arctan(2.2 / distance)))
    camera = Camera(resolution=16, projection="perspective", fov_deg=fov, distance=distance)
    wall = Placed(shape=Plane(), surface=PAINT, position=(0, 0, -900), tilt_deg=90, scale=1000)
    around = Surroundings(name="far wall", objects=(wall,))
    described = scene(camera).model_copy(update={"surroundings": around})
    truth = render(described, Sampling(samples=4, max_depth=2))
    maps = render_maps(described, ("depth", "coverage", "object_id"), choose())
    assert truth.mask.sum() > 100
    assert (maps["coverage"][truth.mask] == 1).all()
    assert set(np.unique(maps["object_id"][truth.mask])) == {1, 2}
    # float32 at 1e4: a step is 1e-3, and the mean of 16 depths is a few of them.
    on_wall = maps["object_id"] == 2
    assert maps["depth"][on_wall] == pytest.approx(distance + 900, abs=5e-3)


@needs_arrays
def test_equal_surfaces_have_one_number() -> None:
    described = table(Uniform(), resolution=16)
    objects = tuple(
        placed.model_copy(update={"surface": PAINT}) for placed in described.surroundings.objects
    )
    around = described.surroundings.model_copy(update={"objects": objects})
    repainted = described.model_copy(update={"surroundings": around, "surface": PAINT})
    assert different_surfaces(repainted) == (PAINT,)
    maps = render_maps(repainted, ("object_id", "material_id"), choose())
    assert maps["object_id"].max() > 1
    assert maps["material_id"].max() == 1


@needs_arrays
def test_launches_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    checked = Patterned(pattern=Checker(size=0.4), surfaces=(PAINT, Dielectric(eta=2, alpha=0.1)))
    described = scene(Camera(resolution=16), checked)
    whole = render_maps(described, tuple(MAPS), choose())
    monkeypatch.setattr(surface_maps, "PIXELS_A_LAUNCH", 100)
    parts = render_maps(described, tuple(MAPS), choose())
    assert list(parts) == list(MAPS)
    for name, values in whole.items():
        assert values.tobytes() == parts[name].tobytes(), name


def test_ray_by_ray_is_refused() -> None:
    nobody = Variant("scalar_spectral_polarized", "not used")
    assert render_maps(scene(Camera(resolution=8)), (), nobody) == {}
    with pytest.raises(InputError, match="expected LLVM or CUDA for maps"):
        render_maps(scene(Camera(resolution=8)), ("depth",), nobody)


@needs_arrays
def test_of_objects_with_equally_many_rays_a_pixel_is_of_the_first() -> None:
    """The edge of two walls runs through the middle of the middle column: 8 rays on each side."""
    walls = tuple(
        Placed(shape=Plane(), surface=PAINT, position=(x, 0.0, 2.0), tilt_deg=90.0)
        for x in (1.0, -1.0)  # they hide the sphere
    )
    away = scene(Camera(resolution=3, half_width=0.9)).model_copy(
        update={"surroundings": Surroundings(name="walls", objects=walls)}
    )
    owner = render_maps(away, ("object_id",), choose())["object_id"]
    assert owner.tolist() == [[3, 2, 2]] * 3


def test_rays_nearest_to_the_centre_of_a_pixel_come_first() -> None:
    """Texture coordinates are those of the first that hits the object."""
    away = np.hypot(*(surface_maps._OFFSETS - 0.5).T)
    assert len(np.unique(surface_maps._OFFSETS, axis=0)) == 16
    assert (np.diff(away) >= -1e-7).all()  # of float32
