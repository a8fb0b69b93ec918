"""Shapes of our own: closed, outward, in the unit sphere, with exact normals."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import numpy as np
import pytest
from made_up import icosphere, volume
from numpy.typing import NDArray

from malus.scenes.core.errors import InputError
from malus.scenes.shapes.geometry import (
    RadialSurface,
    TriangleMesh,
    blob,
    blob_radius,
    radial_normals,
    superquadric,
    superquadric_radius,
    torus,
)
from malus.scenes.shapes.lathe import lathe, profile

Array = NDArray[np.float64]

SHAPES: dict[str, Callable[[], TriangleMesh]] = {
    "icosphere": icosphere,
    "torus": torus,
    "torus tilted": lambda: torus(0.6, 0.2, tilt=math.radians(50)),
    "blob": blob,
    "blob 5": lambda: blob(seed=5, amplitude=1.0),
    "box": lambda: superquadric(0.2, 0.2),
    "superquadric": superquadric,
    "pinched": lambda: superquadric(1.5, 0.4),
    "book": lambda: superquadric(0.3, 0.2, stretch=(1.0, 0.3, 0.6)),
    "pot": lambda: lathe(seed=0),
    "glass": lambda: lathe(seed=13),
    "plate": lambda: lathe(seed=4),
    "coarse torus": lambda: torus(rings=3, sides=3),
    "icosahedron": lambda: icosphere(0),
}
RADIAL: dict[str, RadialSurface] = {
    "blob": blob_radius,
    "blob 5": lambda d: blob_radius(d, seed=5, amplitude=1.0),
    "box": lambda d: superquadric_radius(d, 0.2, 0.2),
    "superquadric": lambda d: superquadric_radius(d, 0.5, 0.5),
    "pinched": lambda d: superquadric_radius(d, 1.5, 0.4),
    "sphere": lambda d: superquadric_radius(d, 1.0, 1.0),
}
# A unit vector in float32 is off by at most a few of its steps of 6e-8.
FLOAT32 = 5e-7


@pytest.fixture(scope="module", params=SHAPES)
def mesh(request: pytest.FixtureRequest) -> TriangleMesh:
    return SHAPES[request.param]()


def directed_edges(mesh: TriangleMesh) -> Array:
    faces = mesh.faces.astype(np.int64)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.asarray(ends)


def unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def test_every_edge_has_two_faces_of_opposite_direction(mesh: TriangleMesh) -> None:
    edges = directed_edges(mesh)
    keys, back = edges @ [1 << 32, 1], edges @ [1, 1 << 32]
    assert len(np.unique(keys)) == len(keys)
    assert (np.sort(keys) == np.sort(back)).all()


@pytest.mark.parametrize("name", SHAPES)
def test_euler_characteristic(name: str) -> None:
    shape = SHAPES[name]()
    assert (np.unique(shape.faces) == np.arange(len(shape.vertices))).all()
    edges = len(directed_edges(shape)) // 2
    expected = 0 if "torus" in name else 2
    assert len(shape.vertices) - edges + len(shape.faces) == expected


def test_fits_the_unit_sphere_and_touches_it(mesh: TriangleMesh) -> None:
    radius = np.linalg.norm(mesh.vertices.astype(np.float64), axis=1).max()
    assert radius == pytest.approx(1.0, abs=FLOAT32)
    # Nothing moves off centre: the bounding box of each is about the origin. The coarse torus has
    # no vertex opposite to its first.
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    if len(mesh.faces) > 20:
        assert np.abs(middle).max() < FLOAT32


def test_normals_are_unit_and_on_the_outer_side(mesh: TriangleMesh) -> None:
    assert mesh.normals is not None
    normals = mesh.normals.astype(np.float64)
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < FLOAT32
    assert volume(mesh) > 0
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    of_faces = np.cross(b - a, c - a)
    agreement = np.einsum("fkj,fj->fk", normals[mesh.faces], of_faces)
    assert (agreement > 0).all()


def test_volumes() -> None:
    # A mesh inscribed in a convex surface loses about the mean squared edge, (2π/128)² ≈ 2e-3 at
    # the torus's tube, times 1/6 or so: 5e-4. The sphere's edges are shorter.
    exact_torus = 2 * math.pi**2 * 0.7 * 0.3**2
    assert volume(torus()) == pytest.approx(exact_torus, rel=5e-4)
    assert volume(torus(1.4, 0.6, tilt=1.0)) == pytest.approx(exact_torus, rel=5e-4)
    assert volume(icosphere()) == pytest.approx(4 / 3 * math.pi, rel=2e-4)
    assert volume(icosphere(0)) == pytest.approx(2.53615, abs=1e-5)  # regular icosahedron, R = 1


@pytest.mark.parametrize("name", RADIAL)
def test_radial_normals_are_orthogonal_to_finite_differences(name: str) -> None:
    surface = RADIAL[name]
    directions = unit(np.random.default_rng(3).normal(size=(2000, 3)))
    normals = radial_normals(directions, *surface(directions))
    step = 1e-5
    for axis in np.eye(3):
        tangent = np.cross(directions, axis)
        ends = [unit(directions + s * step * tangent) for s in (1, -1)]
        ahead, behind = (d * surface(d)[0][:, None] for d in ends)
        across = unit(ahead - behind)
        # A central difference is off by step² times the surface's third derivative, which reaches
        # 1e4 at the edges of the box and diverges at the creases of exponents above 1: hence the
        # 99th percentile there. Rounding adds 1e-16 / step.
        error = np.abs(np.einsum("ij,ij->i", across, normals))
        assert np.quantile(error, 0.99) < 1e-6
        assert name == "pinched" or error.max() < 1e-5


def test_superquadric_satisfies_its_inside_outside_function() -> None:
    directions = unit(np.random.default_rng(4).normal(size=(500, 3)))
    for e1, e2 in [(0.3, 0.7), (1.0, 1.0), (1.7, 0.4), (2.0, 2.0)]:
        x, y, z = np.abs(directions * superquadric_radius(directions, e1, e2)[0][:, None]).T
        value = (x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1) + z ** (2 / e1)
        # Powers up to 7 of numbers with a rounding error of 1e-16.
        np.testing.assert_allclose(value, 1.0, atol=1e-13)


def test_superquadric_normals_are_finite_at_poles_and_axes() -> None:
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    for e1, e2 in [(0.1, 2.0), (2.0, 0.1), (1.0, 1.0), (0.1, 0.1), (2.0, 2.0)]:
        normals = radial_normals(axes, *superquadric_radius(axes, e1, e2))
        np.testing.assert_allclose(normals, axes, atol=1e-12)


def test_torus_normals_point_away_from_the_core_circle() -> None:
    shape = torus(0.7, 0.3)
    points = shape.vertices.astype(np.float64)
    core = np.concatenate([0.7 * unit(points[:, :2]), np.zeros((len(points), 1))], axis=1)
    np.testing.assert_allclose(np.linalg.norm(points - core, axis=1), 0.3, atol=FLOAT32)
    # Dividing by 0.3 triples the float32 step of the points.
    np.testing.assert_allclose(shape.normals, (points - core) / 0.3, atol=4 * FLOAT32)


def test_torus_tilt_turns_its_axis_about_x() -> None:
    flat, tilted = torus(), torus(tilt=math.radians(90))
    # (x, y, z) to (x, −z, y)
    np.testing.assert_allclose(tilted.vertices, flat.vertices[:, [0, 2, 1]] * [1, -1, 1], atol=1e-7)


def interpolated(mesh: TriangleMesh) -> tuple[Array, Array]:
    """A point of each face, as weights of its corners, and the renderer's normal there."""
    weights = np.random.default_rng(0).dirichlet([1.0, 1.0, 1.0], len(mesh.faces))
    assert mesh.normals is not None
    normals = np.einsum("fk,fkj->fj", weights, mesh.normals[mesh.faces].astype(np.float64))
    return weights, unit(normals)


# Measured with the default tessellation: blob 0.021°, superquadric 0.5: 0.024°, 0.2: 0.27°; the
# surface within 3e-4 (box: 1e-3), where a pixel of a 128² image is 1.6e-2 wide.
@pytest.mark.parametrize(
    ("name", "degrees", "depth"),
    [("blob", 0.03, 4e-4), ("superquadric", 0.03, 4e-4), ("box", 0.3, 1.2e-3)],
)
def test_faceting_is_negligible(name: str, degrees: float, depth: float) -> None:
    directions, shape = icosphere().vertices.astype(np.float64), SHAPES[name]()
    points = directions * RADIAL[name](directions)[0][:, None]
    weights, found = interpolated(shape)
    on_faces = np.einsum("fk,fkj->fj", weights, points[shape.faces])
    exact = radial_normals(unit(on_faces), *RADIAL[name](unit(on_faces)))
    assert np.degrees(np.linalg.norm(found - exact, axis=1).max()) < degrees
    gap = RADIAL[name](unit(on_faces))[0] - np.linalg.norm(on_faces, axis=1)
    assert np.abs(gap).max() < depth


def test_sphere_faceting() -> None:
    shape = icosphere()
    weights, found = interpolated(shape)
    corners = shape.vertices[shape.faces].astype(np.float64)
    exact = unit(np.einsum("fk,fkj->fj", weights, corners))
    # Interpolating the position interpolates the normal: only float32 remains.
    assert np.abs(found - exact).max() < FLOAT32


def test_blob_is_the_sum_of_its_bumps_literally() -> None:
    draw = random.Random(4).random
    bumps = []
    for _ in range(7):
        z, azimuth = 2 * draw() - 1, 2 * math.pi * draw()
        ring = math.sqrt(1 - z * z)
        bumps.append((ring * math.cos(azimuth), ring * math.sin(azimuth), z))
    heights = [0.8 * (0.5 + 0.5 * draw()) for _ in bumps]
    d = (0.48, -0.64, 0.6)
    cosines = [sum(a * b for a, b in zip(d, bump, strict=True)) for bump in bumps]
    expected = 1 + sum(h * math.exp(6 * (c - 1)) for h, c in zip(heights, cosines, strict=True))
    radius, _ = blob_radius(np.array([d]), seed=4, amplitude=0.8)
    # The same sums in another order.
    assert radius[0] == pytest.approx(expected, rel=1e-14)


def test_a_seed_is_one_shape_for_ever() -> None:
    np.testing.assert_array_equal(blob(seed=2).vertices, blob(seed=2).vertices)
    assert np.abs(blob(seed=2).vertices - blob(seed=3).vertices).max() > 0.05
    # Frozen, as it is the identity of the blob in datasets; another libm may differ by float32.
    frozen = [-0.39357296, 0.79036891, -0.12384243]
    np.testing.assert_allclose(blob(seed=0).vertices[0], frozen, atol=FLOAT32)


@pytest.mark.parametrize(
    "make",
    [
        lambda: torus(0.3, 0.7),
        lambda: torus(0.7, 0.0),
        lambda: torus(math.nan, 0.3),
        lambda: torus(math.inf, 0.3),
        lambda: blob(amplitude=-0.1),
        lambda: blob(amplitude=math.nan),
        lambda: blob(seed=-1),
        lambda: superquadric(0.0, 1.0),
        lambda: superquadric(1.0, math.nan),
    ],
)
def test_impossible_shapes_are_refused_in_one_line(make: Callable[[], TriangleMesh]) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "make", [lambda: icosphere(-1), lambda: icosphere(10), lambda: torus(rings=2)]
)
def test_impossible_grids_are_refused(make: Callable[[], TriangleMesh]) -> None:
    with pytest.raises(ValueError, match="expected"):
        make()


def test_triangle_mesh_refuses_what_is_not_one() -> None:
    corners, faces = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], dtype=np.uint32)
    with pytest.raises(ValueError, match=r"vertices: expected \(n, 3\) float32"):
        TriangleMesh(corners.astype(np.float64), faces)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="index 3 of 3 vertices"):
        TriangleMesh(corners, faces + np.uint32(1))
    with pytest.raises(ValueError, match="one normal a vertex"):
        TriangleMesh(corners, faces, corners[:2].copy())
    with pytest.raises(ValueError, match="read-only"):
        TriangleMesh(corners, faces).vertices[0] = 0.0


@pytest.mark.parametrize("seed", range(12))
def test_turned_objects_are_closed_and_no_wall_crosses_itself(seed: int) -> None:
    mesh = lathe(seed, sides=16, steps=400)
    edges = directed_edges(mesh)
    keys, back = edges @ [1 << 32, 1], edges @ [1, 1 << 32]
    assert (np.sort(keys) == np.sort(back)).all()
    # One side of the profile, from foot to end: the area under it that is counted positively,
    # less what is counted negatively, is all of the solid only where the curve does not cross.
    radius, height = np.linalg.norm(mesh.vertices[:, [0, 2]], axis=1), mesh.vertices[:, 1]
    first = np.concatenate([[0], np.arange(1, len(radius) - 1, 16), [len(radius) - 1]])
    points = np.stack([radius[first], height[first]], axis=1).astype(np.float64)
    for k in range(len(points) - 3):
        a, b = points[k : k + 2]
        c, d = points[k + 2 : -1], points[k + 3 :]
        sides = _cross(b - a, c - a) * _cross(b - a, d - a)
        others = _cross(d - c, a - c) * _cross(d - c, b - c)
        assert not ((sides < 0) & (others < 0)).any()


def test_turned_objects_differ_and_half_of_them_are_open() -> None:
    meshes = [lathe(seed, sides=3, steps=50).vertices for seed in range(64)]
    assert len({mesh.tobytes() for mesh in meshes}) == 64
    # The profile of a vessel ends below its rim. Half of 64, within four standard errors of 4.
    opened = sum(mesh[-1, 1] < mesh[:, 1].max() - 0.01 for mesh in meshes)
    assert 16 <= opened <= 48


def _cross(one: Array, other: Array) -> Array:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])


def test_normals_of_turned_objects_are_across_finite_differences() -> None:
    control = np.array([[0.0, 0.0], [0.5, 0.0], [0.7, 0.4], [0.4, 0.9], [0.0, 1.0]])
    points, tangents = profile(control, 4001)
    across = np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)
    along = points[2:] - points[:-2]
    cosine = np.einsum("ij,ij->i", unit(across[1:-1]), unit(along))
    # The curve is 6 spans long: a central difference is off by (6 / 4000)² times its third
    # derivative over the first, about 10 where it turns most.
    assert np.abs(cosine).max() < 5e-5
    # Smooth at the axis: the profile leaves it level.
    assert np.abs(tangents[[0, -1], 1]).max() < 1e-12


def test_a_stretched_sphere_is_an_ellipsoid() -> None:
    mesh = superquadric(1.0, 1.0, stretch=(1.0, 0.5, 0.25), subdivisions=3)
    axes = np.array([1.0, 0.5, 0.25])
    points = mesh.vertices.astype(np.float64)
    assert np.abs((points**2 / axes**2).sum(axis=1) - 1).max() < 1e-5  # of float32
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.normals, unit(points / axes**2), atol=1e-5)


@pytest.mark.parametrize(("thickness", "degrees"), [(0.5, 0.03), (0.1, 0.3), (0.02, 5.0)])
def test_the_rim_of_a_flattened_sphere_is_as_exact_as_is_told(
    thickness: float, degrees: float
) -> None:
    """Against the gradient of an ellipsoid's equation, at the points between the vertices."""
    stretch = np.array([thickness, 1.0, 1.0])
    mesh = superquadric(1.0, 1.0, (thickness, 1.0, 1.0))
    weights, normals = interpolated(mesh)
    points = np.einsum("fk,fkj->fj", weights, mesh.vertices[mesh.faces].astype(np.float64))
    angle = np.degrees(np.linalg.norm(unit(points / stretch**2) - normals, axis=1).max())
    assert 0.1 * degrees < angle < degrees  # and no better by far
