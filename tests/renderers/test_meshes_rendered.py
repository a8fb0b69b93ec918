"""Meshes as scenes: real files, and a sphere made of triangles beside the analytic one."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import trimesh
from made_up import icosphere

from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.coverage import check_facing
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.variant import choose
from malus.scenes import (
    Camera,
    Dielectric,
    Distant,
    InputError,
    MeshFile,
    Sampling,
    Scene,
    Sphere,
    Superquadric,
    Uniform,
)
from malus.scenes.polarisation import dolp

SURFACE = Dielectric(eta=1.5, alpha=0.3, albedo=0.5)


@pytest.mark.parametrize("name", ["spot.obj", "teapot.obj"])
def test_real_meshes_render_polarised(shared: Path, name: str) -> None:
    scene = Scene(
        shape=MeshFile(path=str(shared / "meshes" / name)),
        surface=SURFACE,
        light=Uniform(),
        camera=Camera(resolution=48),
    )
    truth = render_family([scene], Sampling(samples=16)).truth(scene)
    assert truth.mask.mean() > 0.1
    assert np.isfinite(truth.stokes).all()
    assert dolp(truth.specular)[truth.mask].max() > 0.5
    assert truth.image[truth.mask].min() >= 0


@pytest.mark.parametrize("backend", ["auto", "scalar"])
def test_a_flat_face_seen_along_its_normal_is_what_formulas_say(backend: str) -> None:
    """Normals of a block's face differ from its own by 1e-20 here, of which Mitsuba makes NaN."""
    scene = Scene(
        shape=Superquadric(e1=0.1, e2=0.1, stretch=(1, 1, 1)),
        surface=Dielectric(eta=1.5, alpha=0.3, albedo=0.5, body="unpolarised"),
        light=Distant(incidence_deg=40, azimuth_deg=70),
        camera=Camera(resolution=16, half_width=1e-3),
    )
    truth = render_family([scene], Sampling(samples=16), choose(backend)).truth(scene)
    law = render_torrance_sparrow(scene, np.broadcast_to([0.0, 0.0, 1.0], (16, 16, 3)))
    # Without noise; the scalar variant's film has a response that is measured to 1e-4.
    for found, expected in ((truth.specular, law.specular), (truth.diffuse, law.diffuse)):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-3 * expected.max())


@pytest.mark.parametrize("subdivisions", [4, 6])
def test_a_sphere_of_triangles_is_a_sphere(tmp_path: Path, subdivisions: int) -> None:
    """The same rays and samples: what differs is the faceting, and that is bounded.

    A triangle of edge h lies up to h²/8 below the sphere. Seen under a slope t the hit moves
    sideways by t h²/8, and the unit sphere's normal turns by as much. The radiance of the body is
    albedo · cos θ_L, so that it changes by at most the albedo times the turn; the mirror lobe is
    a few per cent of the body and adds less than half of that.
    """
    mesh = icosphere(subdivisions)
    path = tmp_path / "sphere.ply"
    ball = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=mesh.normals, process=False)
    ball.export(path)
    light, camera = Distant(incidence_deg=45), Camera(resolution=48)
    images = []
    for shape in (Sphere(), MeshFile(path=str(path), shading="file")):
        scene = Scene(shape=shape, surface=SURFACE, light=light, camera=camera)
        images.append(render_family([scene], Sampling(samples=32)).truth(scene))
    analytic, faceted = images
    inner = analytic.mask & faceted.mask & (analytic.normals[..., 2] > 0.5)
    slope = np.sqrt(3)  # at normals of 60 degrees
    edge = 1.05 * 0.62 * 2 ** (1 - subdivisions)  # the icosahedron's is 1.05
    turn = slope * edge**2 / 8
    difference = np.abs(analytic.stokes - faceted.stokes)[inner].max()
    assert difference < 1.5 * SURFACE.albedo * turn + 2e-6  # float32
    assert (analytic.mask != faceted.mask).mean() < 0.01


@pytest.mark.parametrize("backend", ["auto", "scalar"])
@pytest.mark.parametrize("inward", [False, True], ids=["outward", "inward"])
def test_an_open_mesh_that_is_inside_out_is_refused(
    tmp_path: Path, inward: bool, backend: str
) -> None:
    """Nothing turns it, as a closed one is; its truth would be dark, and no error would tell."""
    ball = icosphere(3)
    front = ball.faces[ball.vertices[ball.faces].mean(axis=1)[:, 2] > 0]
    faces = front[:, ::-1] if inward else front
    trimesh.Trimesh(ball.vertices, faces, process=False).export(tmp_path / "half.ply")
    shape = MeshFile(path=str(tmp_path / "half.ply"))
    for azimuth in (0.0, 180.0):  # from behind, the hollow of the other one is seen
        camera = Camera(resolution=8, azimuth_deg=azimuth)
        scene = Scene(shape=shape, surface=SURFACE, light=Uniform(), camera=camera)
        if inward == (azimuth == 0.0):
            with pytest.raises(InputError, match=r"half\.ply: expected faces wound anticlockwise"):
                render_family([scene], Sampling(samples=4), choose(backend))
        else:
            truth = render_family([scene], Sampling(samples=4), choose(backend)).truth(scene)
            assert (truth.image[truth.mask] > 0).all()


@pytest.mark.parametrize(("backs", "refused"), [(0, False), (89, False), (91, True)])
def test_a_mesh_is_refused_where_nearly_all_that_is_seen_are_backs(
    backs: int, refused: bool
) -> None:
    """Up to nine pixels of ten may be: an open bowl shows its inside."""
    normals = np.tile(np.float32([0.0, 0.6, 0.8]), (100, 1))
    normals[:backs] *= -1
    shape = MeshFile(path="bowl.obj")
    told = pytest.raises(InputError, match="flip the faces") if refused else nullcontext()
    with told:
        check_facing(normals, np.arange(100), Camera(resolution=10), shape)
