"""Concave polygons in mesh files are cut rightly or refused, and files may have another axis up."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from made_up import icosphere, volume

from malus.scenes import Camera, Dielectric, MeshFile, Scene, Uniform
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError
from malus.scenes.shapes.meshes import load_mesh
from malus.scenes.shapes.polygons import MOST_CORNERS, cut_polygons
from malus.scenes.shapes.text_meshes import obj_with_triangles

OUTLINE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)]
"""An L, of area 5; a fan from its first corner is right, from others it is not."""
KEYHOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
"""A square of 16 with a hole of 4, whose outlines a cut joins."""


def shoelace(points: Float64Array) -> float:
    x, y = points.T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)


def in_space(points: Float64Array, seed: int) -> Float64Array:
    """Points (n, 2) on a plane that lies anywhere, as the 32-bit floats of a file."""
    random = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    turn[2] *= np.sign(np.linalg.det(turn))
    lifted = np.column_stack([points, np.zeros(len(points))]) @ turn + random.normal(size=3)
    return lifted.astype(np.float32).astype(np.float64)


def star(seed: int) -> Float64Array:
    """A polygon seen whole from the origin, with many corners that point inwards."""
    random = np.random.default_rng(seed)
    count = int(random.integers(5, 40))
    angles = (np.arange(count) + random.uniform(0.1, 0.9, count)) * 2 * np.pi / count
    radii = random.uniform(0.1, 1, count)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1)


@pytest.mark.parametrize("points", [*map(star, range(30)), np.array(KEYHOLE, float)])
def test_triangles_cover_the_polygon_once(points: Float64Array) -> None:
    corners = in_space(points, seed=len(points))
    everything = list(range(len(points)))
    triangles = cut_polygons(corners, [everything]).get(0)
    if triangles is None:  # a fan is right
        triangles = np.array([(0, k, k + 1) for k in range(1, len(points) - 1)])
    assert triangles.shape == (len(points) - 2, 3)
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a) / 2
    # All face the same way and add up to the outline's area: nothing is covered twice or left out.
    normal = areas.sum(axis=0)
    assert np.linalg.norm(normal) == pytest.approx(shoelace(points), rel=1e-5)  # float32
    assert (areas @ normal >= -1e-6 * (normal @ normal)).all()


@pytest.mark.parametrize("shift", range(len(OUTLINE)))
def test_it_does_not_matter_where_an_outline_begins(shift: int) -> None:
    corners = np.column_stack([np.roll(OUTLINE, shift, axis=0), np.zeros(6)]).astype(float)
    cut = cut_polygons(corners, [list(range(6)), list(range(6))[::-1]])
    assert (0 in cut) == (shift not in (0, 3))  # of the inner corner and the one across, fans do
    for place, sign in ((0, 1), (1, -1)):
        if place not in cut:
            continue
        order = np.array(list(range(6))[::sign])
        a, b, c = (corners[order[cut[place][:, k]]] for k in range(3))
        areas = np.cross(b - a, c - a)[:, 2] / 2
        assert areas.sum() == pytest.approx(sign * 5)
        assert (sign * areas > 0).all()


def prism() -> tuple[Float64Array, list[list[int]]]:
    """The L, 2 high: 6 quadrangles between two hexagons whose fans are wrong."""
    outline = np.roll(OUTLINE, 1, axis=0)
    corners = [(x, y, z) for z in (0, 2) for x, y in outline]
    sides = [[k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6] for k in range(6)]
    return np.array(corners, float), [list(range(6))[::-1], list(range(6, 12)), *sides]


PLY = """ply
format {form} 1.0
element vertex 12
property float x
property float y
property float z
element face 8
property list uchar int vertex_indices
end_header
"""


def text_of(kind: str) -> bytes:
    """The prism as a file."""
    corners, faces = prism()
    positions = "".join("{:g} {:g} {:g}\n".format(*corner) for corner in corners)
    rows = "".join(f"{len(face)} {' '.join(map(str, face))}\n" for face in faces)
    if kind == "off":
        return f"OFF # of an L\n12 8 0\n{positions}{rows}".encode()
    if kind == "ply":
        return (PLY.format(form="ascii") + positions + rows).encode()
    if kind == "binary.ply":
        data = [struct.pack("<3f", *corner) for corner in corners]
        data += [struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces]
        return PLY.format(form="binary_little_endian").encode() + b"".join(data)
    texture = "vt 0 0\nvt 1 1\n" if kind == "textured.obj" else ""
    ends = {"obj": "{}", "textured.obj": "{}/2", "negative.obj": "{}"}[kind]
    first = -12 if kind == "negative.obj" else 1
    lines = "".join(
        "f " + " ".join(ends.format(first + corner) for corner in face) + "\n" for face in faces
    )
    vertices = "".join(f"v {line}\n" for line in positions.splitlines())
    # Vertices behind the faces: negative indices count from where they stand.
    behind = "v 9 9 9\n" if kind == "negative.obj" else ""
    return (vertices + texture + lines.replace(" 8 ", " \\\n8 ") + behind).encode()


@pytest.mark.parametrize(
    "kind", ["obj", "textured.obj", "negative.obj", "off", "ply", "binary.ply"]
)
def test_a_prism_of_concave_faces_has_its_volume(tmp_path: Path, kind: str) -> None:
    (tmp_path / f"l.{kind}").write_bytes(text_of(kind))
    mesh, defects = load_mesh(tmp_path / f"l.{kind}", "flat")
    assert len(mesh.faces) == 2 * 4 + 6 * 2
    assert defects == ["no normals in the file"]  # closed, wound alike, not inside out
    height = float(np.ptp(mesh.vertices[:, 2])) / 2  # of 2, before it was scaled
    assert volume(mesh) == pytest.approx(10 * height**3, rel=1e-6)  # float32


def test_what_needs_no_change_stays_to_the_byte() -> None:
    convex = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf 3 2 1\n"
    assert obj_with_triangles(convex) == convex
    commented = b"# a comment -1\n" + convex.replace(b"f 3 2 1", b"f 3 2 1 # -2")
    assert obj_with_triangles(commented) == b"\n" + convex
    both = obj_with_triangles(convex + b"v 0 0 1\nvn 0 0 1\nf -1//-1 1//1 2//1\n")
    assert both == convex + b"v 0 0 1\nvn 0 0 1\nf 5//1 1//1 2//1\n"


BOW = "0 0 0\n1 1 0\n1 0 0\n0 1 0\n"


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        ("obj", "".join(f"v {row}\n" for row in BOW.splitlines()) + "f 1 2 3\nf 1 2 3 4\n"),
        ("off", f"OFF\n4 2 0\n{BOW}3 0 1 2\n4 0 1 2 3\n"),
        ("ply", PLY.format(form="ascii").replace("12", "4").replace("8", "2")
         + f"{BOW}3 0 1 2\n4 0 1 2 3\n"),
    ],
)  # fmt: skip
def test_a_face_that_crosses_itself_is_named(tmp_path: Path, kind: str, content: str) -> None:
    (tmp_path / f"bow.{kind}").write_text(content)
    with pytest.raises(
        InputError, match=r"face 2: expected a face that can be cut, found one that"
    ):
        load_mesh(tmp_path / f"bow.{kind}")


def test_an_endless_concave_face_is_refused() -> None:
    count = MOST_CORNERS + 2
    angles = np.arange(count) * 2 * np.pi / count
    radii = np.where(np.arange(count) % 2, 1, 0.5)
    corners = np.stack([radii * np.cos(angles), radii * np.sin(angles), 0 * angles], axis=-1)
    with pytest.raises(ValueError, match=f"concave one of {count} corners"):
        cut_polygons(corners, [range(count)])


def test_an_index_before_the_first_vertex_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf -1 -2 -4\n")
    with pytest.raises(InputError, match=r"from 1 to 3 in face 1, found -4"):
        load_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize("shading", ["smooth", "file"])
def test_a_file_with_z_upright_stands_as_one_with_y(tmp_path: Path, shading: str) -> None:
    """Exported twice, as programs do: with their z upright, and turned by -90° about x for y."""
    ball = icosphere(1)
    vertices = ball.vertices * np.array([0.5, 0.7, 1.0]) + 0.1 * ball.vertices[:, [1, 2, 0]]
    body = trimesh.Trimesh(vertices, ball.faces, vertex_normals=ball.normals, process=False)
    body.export(tmp_path / "z.ply", vertex_normal=True)
    body.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    body.export(tmp_path / "y.ply", vertex_normal=True)
    one, _ = load_mesh(tmp_path / "y.ply", shading)
    other, _ = load_mesh(tmp_path / "z.ply", shading, "z")
    assert one.normals is not None
    assert other.normals is not None
    np.testing.assert_allclose(other.vertices, one.vertices, atol=1e-6)  # float32
    np.testing.assert_allclose(other.normals, one.normals, atol=2e-6)
    assert volume(other) > 0  # turned, not mirrored
    lying, _ = load_mesh(tmp_path / "z.ply", shading, "x")
    assert volume(lying) == pytest.approx(volume(one), rel=1e-5)
    np.testing.assert_allclose(np.ptp(lying.vertices[:, 1]), np.ptp(one.vertices[:, 0]), rtol=1e-5)


def test_scenes_keep_their_id_unless_an_axis_is_named() -> None:
    def scene(**keys: str) -> Scene:
        shape = MeshFile(path="a.obj", digest="0123456789abcdef", **keys)
        surface = Dielectric(eta=1.5, alpha=0.2)
        return Scene(shape=shape, surface=surface, light=Uniform(), camera=Camera())

    assert "up" not in scene().model_dump()["shape"]
    assert scene().id == scene(up="y").id != scene(up="z").id
