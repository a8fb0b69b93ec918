"""Normals of meshes that do not cross sharp edges."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_up import icosphere

from malus.scenes import InputError, MeshFile, Scene, load_suite
from malus.scenes.shapes.meshes import angle_weighted_normals, load_mesh, smooth_groups
from malus.scenes.shapes.shapes import Crease

BLOCK = Path(__file__).parents[1] / "cases" / "mesh" / "block.obj"


def test_a_block_has_the_normals_of_its_six_sides() -> None:
    mesh, _ = load_mesh(BLOCK, Crease(crease_deg=40))
    assert (len(mesh.vertices), len(mesh.faces)) == (24, 12)
    assert mesh.normals is not None
    corners = mesh.vertices[mesh.faces].astype(float)
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    # float32 of numbers up to 1
    np.testing.assert_allclose(mesh.normals[mesh.faces], np.repeat(sides[:, None], 3, 1), atol=5e-7)


def test_a_crease_that_no_edge_reaches_is_smooth(shared: Path) -> None:
    for file in (BLOCK, shared / "meshes" / "spot.obj"):  # the second has a seam of the texture
        smooth, _ = load_mesh(file, "smooth")
        creased, _ = load_mesh(file, Crease(crease_deg=179.9))
        assert smooth.normals is not None
        assert creased.normals is not None
        for name in ("vertices", "normals", "uv"):
            one, other = getattr(smooth, name), getattr(creased, name)
            if one is None:
                assert other is None
            else:
                np.testing.assert_allclose(one[smooth.faces], other[creased.faces], atol=2e-7)


def test_a_seam_of_the_texture_is_no_crease(shared: Path) -> None:
    """Spot is smooth: hardly more vertices than its texture needs."""
    mesh, _ = load_mesh(shared / "meshes" / "spot.obj", Crease(crease_deg=40))
    assert mesh.uv is not None
    assert 3225 <= len(mesh.vertices) < 1.02 * 3225


@pytest.mark.parametrize(("crease_deg", "groups"), [(29.9, 2), (30.1, 1)])
def test_faces_part_at_the_angle_that_is_told(crease_deg: float, groups: int) -> None:
    """Two triangles that meet at 30° in the edge from (0, 0, 0) to (0, 1, 0)."""
    bend = np.radians(30)
    corners = np.array(
        [[0, 0, 0], [0, 1, 0], [-1, 0, 0], [np.cos(bend), 0, np.sin(bend)]], dtype=float
    )
    faces = np.array([[0, 1, 2], [1, 0, 3]])
    found = smooth_groups(corners, faces, np.radians(crease_deg))
    assert len(set(found[faces == 0])) == groups
    assert len(set(found[faces == 1])) == groups


def test_parts_round_a_vertex_are_parted_by_edges_not_by_normals() -> None:
    """A ball of small faces stays whole at any crease above its steps: edges lead all the way."""
    ball = icosphere(3)
    vertices, faces = ball.vertices.astype(float), ball.faces.astype(np.int64)
    groups = smooth_groups(vertices, faces, np.radians(15))
    assert groups.max() + 1 == len(vertices)
    whole = angle_weighted_normals(vertices, faces)
    positions = np.empty((len(vertices), 3))
    positions[groups] = vertices[faces]
    np.testing.assert_allclose(angle_weighted_normals(positions, groups)[groups], whole[faces])


def test_edges_of_three_faces_are_creases() -> None:
    corners = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 0, 0.1], [-1, 0, 0]], dtype=float)
    faces = np.array([[1, 0, 2], [1, 0, 3], [0, 1, 4]])
    assert smooth_groups(corners, faces, 3.0).max() + 1 == 9


def suite_of(folder: Path, shading: str) -> Path:
    text = f"""name = "part"
shapes = [{{ kind = "mesh", path = "{BLOCK}"{shading} }}]
materials = ["pmma"]
surfaces = [{{ alpha = 0.2, albedo = 0.4 }}]
lights = [{{ kind = "uniform" }}]
bodies = ["polarised"]
wavelengths_nm = [550]
methods = ["unpolarised"]
"""
    (folder / "suite.toml").write_text(text, "utf-8")
    return folder / "suite.toml"


def test_a_suite_tells_the_crease(tmp_path: Path) -> None:
    (scene,) = load_suite(suite_of(tmp_path, ", shading = { crease_deg = 40 }")).scenes()
    assert isinstance(scene.shape, MeshFile)
    assert scene.shape.shading == Crease(crease_deg=40)
    (plain,) = load_suite(suite_of(tmp_path, "")).scenes()
    (said,) = load_suite(suite_of(tmp_path, ', shading = "smooth"')).scenes()
    assert plain.id == scene.id != said.id
    # A scene that was stored when the default was `smooth` says so, and stays what it was.
    assert Scene.model_validate(said.model_dump(mode="json")).id == said.id


@pytest.mark.parametrize("shading", ["{ crease_deg = 200 }", '"smoth"', "{ crease = 3 }"])
def test_a_wrong_crease_is_refused(tmp_path: Path, shading: str) -> None:
    with pytest.raises(InputError) as refusal:
        load_suite(suite_of(tmp_path, f", shading = {shading}"))
    assert "shading" in str(refusal.value)
    assert "pydantic" not in str(refusal.value)
