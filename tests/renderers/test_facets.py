"""GGX and anisotropic facets: against plain Mitsuba, and laws of them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mpmath import mpf
from plain import (
    GOLD,
    LAMP,
    MIRROR,
    OBLIQUE,
    against_scalar,
    by_mitsuba,
    compare,
    own_shape,
    plain_bsdf,
    returns_no_more,
    scene_of,
)
from reference.fresnel import reflectances
from rooms import needs_arrays

from malus.renderers import render
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Area,
    Conductor,
    Dielectric,
    Distant,
    InputError,
    Light,
    MeshFile,
    Placed,
    Plane,
    Sampling,
    Sphere,
    Surroundings,
    Torus,
    Uniform,
)
from malus.scenes.materials.surface import Surface


@needs_arrays
@pytest.mark.parametrize(
    ("surface", "light", "roll_deg"),
    [
        (Dielectric(eta=1.5, alpha=0.3, distribution="ggx"), OBLIQUE, 0.0),
        (Dielectric(eta=1.5, alpha=0.2, distribution="ggx", albedo=0.2), Uniform(), 0.0),
        (Conductor(**GOLD, alpha=0.3, distribution="ggx"), LAMP, 30.0),
        (Conductor(**GOLD, alpha=(0.1, 0.45)), OBLIQUE, 0.0),
        (Conductor(**GOLD, alpha=(0.1, 0.45), distribution="ggx"), LAMP, 30.0),
        (Conductor(**GOLD, alpha=(0.4, 0.15)), Uniform(), 0.0),
    ],
)
def test_facets_are_those_of_mitsuba(surface: Surface, light: Light, roll_deg: float) -> None:
    scene, sampling = scene_of(surface, light, roll_deg=roll_deg), Sampling(samples=256)
    compare(render(scene, sampling), by_mitsuba(scene, sampling, own_shape(scene), 8))


@needs_arrays
def test_anisotropic_facets_turn_with_an_object_among_others() -> None:
    """A brushed plane, tilted and turned, beside Mitsuba's rectangle with the same transform."""
    brushed = Conductor(**GOLD, alpha=(0.08, 0.5))
    wall = Placed(shape=Plane(), surface=brushed, tilt_deg=60, turn_deg=35, scale=2.0)
    ball = Conductor(**GOLD, alpha=0.3)
    light = Area(incidence_deg=40, azimuth_deg=35, half_angle_deg=25, radiance=2.0)
    scene = scene_of(ball, light).model_copy(
        update={"surroundings": Surroundings(name="wall", objects=(wall,))}
    )
    sampling = Sampling(samples=256, max_depth=2)
    mi = mitsuba(choose())
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], 35.0).rotate([1, 0, 0], 60.0)
    facing_up = turn.scale(2.0).rotate([1, 0, 0], -90.0)
    shapes = {
        "ball": {"type": "sphere", "bsdf": plain_bsdf(ball)},
        "wall": {"type": "rectangle", "to_world": facing_up, "bsdf": plain_bsdf(brushed)},
    }
    truth = render(scene, sampling)
    compare(truth, by_mitsuba(scene, sampling, shapes, 8))
    turned = wall.model_copy(update={"surface": Conductor(**GOLD, alpha=(0.5, 0.08))})
    swapped = scene.model_copy(
        update={"surroundings": Surroundings(name="wall", objects=(turned,))}
    )
    other = render(swapped, sampling)
    assert np.abs(other.image - truth.image)[truth.mask].max() > 0.02 * truth.image.max()


@needs_arrays
def test_a_brushed_sphere_turns_with_its_object() -> None:
    """Beside Mitsuba's sphere with the same transform."""
    brushed = Conductor(**GOLD, alpha=(0.08, 0.5))
    beside = Placed(
        shape=Sphere(), surface=brushed, tilt_deg=60, turn_deg=35, position=(0, 0, 3), scale=0.8
    )
    behind = Conductor(**GOLD, alpha=0.3)
    light = Area(incidence_deg=40, azimuth_deg=35, half_angle_deg=25, radiance=2.0)
    scene = scene_of(behind, light).model_copy(
        update={"surroundings": Surroundings(name="ball", objects=(beside,))}
    )
    sampling = Sampling(samples=256, max_depth=2)
    mi = mitsuba(choose())
    moved = mi.ScalarTransform4f().translate([0, 0, 3]).rotate([0, 1, 0], 35.0)
    turned = moved.rotate([1, 0, 0], 60.0).scale(0.8)
    shapes = {
        "behind": {"type": "sphere", "bsdf": plain_bsdf(behind)},
        "ball": {"type": "sphere", "to_world": turned, "bsdf": plain_bsdf(brushed)},
    }
    compare(render(scene, sampling), by_mitsuba(scene, sampling, shapes, 8))


QUAD = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property float s
property float t
element face 1
property list uchar int vertex_indices
end_header
"""


def quad(folder: Path, name: str, uv: list[tuple[int, int]] | None) -> MeshFile:
    """A square that leans to the right and to the top, with texture coordinates."""
    right, up = np.array([0.8, 0.0, -0.6]), np.array([-0.36, 0.8, -0.48])  # orthonormal
    corners = [0.7 * (a * right + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    header = QUAD if uv else QUAD.replace("property float s\nproperty float t\n", "")
    rows = [(*c, *(uv[i] if uv else ())) for i, c in enumerate(corners)]
    text = header + "".join(" ".join(map(str, row)) + "\n" for row in rows) + "4 0 1 2 3\n"
    (folder / name).write_text(text, "ascii")
    return MeshFile(path=str(folder / name), shading="flat")


def test_texture_coordinates_turned_by_90_degrees_swap_both_roughnesses(tmp_path: Path) -> None:
    straight = quad(tmp_path, "straight.ply", [(0, 0), (1, 0), (1, 1), (0, 1)])
    turned = quad(tmp_path, "turned.ply", [(0, 1), (0, 0), (1, 0), (1, 1)])
    light = Distant(incidence_deg=20, azimuth_deg=70)

    def image(shape: MeshFile, alphas: tuple[float, float]) -> np.ndarray:
        scene = scene_of(Conductor(**GOLD, alpha=alphas), light, shape)
        return render(scene, Sampling(samples=4)).stokes

    first, swapped = image(straight, (0.1, 0.4)), image(turned, (0.4, 0.1))
    # The same facets in 32-bit floats, from another tangent.
    np.testing.assert_allclose(swapped, first, atol=1e-5 * first.max())
    assert np.abs(image(turned, (0.1, 0.4)) - first).max() > 0.05 * first.max()


def test_a_mesh_without_coordinates_refuses_two_roughnesses(tmp_path: Path) -> None:
    scene = scene_of(Conductor(**GOLD, alpha=(0.1, 0.4)), OBLIQUE, quad(tmp_path, "bare.ply", None))
    with pytest.raises(InputError, match=r"texture coordinates.*one number as alpha"):
        render(scene, Sampling(samples=2))


def test_recordings_tell_distributions_apart() -> None:
    """A kernel that was recorded for one distribution is not played again for another."""
    surfaces = {
        (distribution, alpha): Conductor(**GOLD, alpha=alpha, distribution=distribution)
        for distribution in ("beckmann", "ggx")
        for alpha in (0.3, (0.1, 0.4))
    }
    images = {
        name: render(scene_of(surface, OBLIQUE), Sampling(samples=4)).image
        for name, surface in surfaces.items()
    }
    again = {
        name: render(scene_of(surfaces[name], OBLIQUE), Sampling(samples=4)).image
        for name in reversed(surfaces)
    }
    for name, image in images.items():
        np.testing.assert_array_equal(again[name], image)
    for one, other in [(("ggx", 0.3), ("beckmann", 0.3)), (("ggx", (0.1, 0.4)), ("ggx", 0.3))]:
        assert np.abs(images[one] - images[other]).max() > 0.02 * images[one].max()


def test_the_scalar_variant_has_the_same_facets() -> None:
    scene = scene_of(Conductor(**GOLD, alpha=(0.15, 0.4), distribution="ggx"), OBLIQUE)
    residual = against_scalar(scene)
    # As in test_conductors: Student's t, variance 7/5; components correlate.
    assert 0.4 < np.mean(residual**2) < 1.8


def test_the_formulas_refuse_ggx() -> None:
    surface = Dielectric(eta=1.5, alpha=0.3, body="unpolarised", distribution="ggx")
    with pytest.raises(InputError, match=r"Beckmann's facets, found ggx"):
        render_torrance_sparrow(scene_of(surface, OBLIQUE))


def test_the_formulas_take_a_map_of_normals() -> None:
    """One tilted facet in every pixel but one: what a pocket calculator says of it."""
    eta, alpha, albedo, irradiance = 1.5, 0.3, 0.4, 2.0
    surface = Dielectric(eta=eta, alpha=alpha, albedo=albedo, body="unpolarised")
    lamp = Distant(incidence_deg=50, azimuth_deg=35, irradiance=irradiance)
    normal = np.array([0.2, 0.3, math.sqrt(1 - 0.13)])
    normals = np.tile(normal, (4, 6, 1))
    normals[0, 0] = 0.0
    scene = scene_of(surface, lamp, Torus(), resolution=4)
    truth = render_torrance_sparrow(scene, normals)
    assert truth.mask.sum() == 4 * 6 - 1
    assert not truth.stokes[0, 0].any()

    across, azimuth = math.sin(math.radians(50)), math.radians(35)
    light = np.array([across * math.cos(azimuth), across * math.sin(azimuth), 0])
    light[2] = math.cos(math.radians(50))
    half = (light + [0, 0, 1]) / np.linalg.norm(light + [0, 0, 1])
    n_h, n_v, n_l, incidence = normal @ half, normal[2], normal @ light, math.radians(25)
    perpendicular, parallel = map(float, reflectances(mpf(incidence), eta))
    facets = math.exp((1 - 1 / n_h**2) / alpha**2) / (math.pi * alpha**2 * n_h**4)
    masking = min(1, 2 * n_h * n_v / half[2], 2 * n_h * n_l / half[2])
    lobe = facets * masking / (4 * n_l * n_v) * irradiance * n_l
    s0 = lobe * (perpendicular + parallel) / 2
    # Crosswise to the plane of lamp and viewer, whose azimuth is 35°.
    crosswise = -lobe * (perpendicular - parallel) / 2
    expected = [s0, crosswise * math.cos(2 * azimuth), crosswise * math.sin(2 * azimuth)]
    seen = truth.specular[1, 2, 0]
    assert seen == pytest.approx(expected, rel=1e-12)  # rounding of a dozen operations
    assert truth.diffuse[1, 2, 0, 0] == pytest.approx(albedo / math.pi * irradiance * n_l)


def test_methods_are_told_one_roughness_of_two() -> None:
    truth = render(scene_of(Conductor(**GOLD, alpha=(0.1, 0.4)), OBLIQUE), Sampling(samples=2))
    assert truth.alpha == pytest.approx(0.2)  # √(0.1 · 0.4)
    assert replace(truth, alpha_map=np.full(truth.mask.shape, 0.3)).alpha[0, 0] == 0.3


@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
def test_nothing_returns_more_than_it_receives(distribution: str) -> None:
    """White bodies, and a metal that absorbs nothing, under radiance 1 from everywhere."""
    alphas = (0.05, 0.3, 1.0)
    surfaces: list[Surface] = [
        Dielectric(eta=eta, alpha=alpha, albedo=1.0, distribution=distribution)
        for eta in (1.05, 1.5, 2.5)
        for alpha in alphas
    ]
    surfaces += [
        Conductor(**MIRROR, alpha=alpha, distribution=distribution)
        for alpha in (*alphas, (0.05, 0.8))
    ]
    for surface in surfaces:
        returns_no_more(render(scene_of(surface, Uniform(), resolution=12), Sampling(samples=64)))
