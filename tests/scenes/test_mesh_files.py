"""Mesh files as people have them: strips and polygons of PLY, textures that are not there."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from made_up import volume

from malus.scenes.core.errors import InputError
from malus.scenes.shapes.meshes import load_mesh
from malus.scenes.shapes.ply import read_ply

CASES = Path(__file__).parents[1] / "cases" / "mesh"
PENTAGON = [(np.cos(a), np.sin(a)) for a in np.radians(72 * np.arange(5))]
PRISM = [(x, y, z) for z in (0.0, 1.0) for x, y in PENTAGON]
PRISM_FACES = [
    [4, 3, 2, 1, 0],
    [5, 6, 7, 8, 9],
    *([k, (k + 1) % 5, (k + 1) % 5 + 5, k + 5] for k in range(5)),
]
HEADER = """ply
format {form} 1.0
element vertex 10
property float x
property float y
property float z
element face 7
property list uchar int vertex_indices
end_header
"""


def ply_of_polygons(form: str, newline: str = "\n") -> bytes:
    """A prism of two pentagons and five quadrangles."""
    header = HEADER.format(form=form).replace("\n", newline).encode()
    if form == "ascii":
        rows = [*PRISM, *([len(face), *face] for face in PRISM_FACES)]
        return header + "".join(" ".join(map(repr, map(float, r))) + "\n" for r in rows).encode()
    order = "<" if "little" in form else ">"
    data = [struct.pack(f"{order}3f", *corner) for corner in PRISM]
    data += [struct.pack(f"{order}B{len(f)}i", len(f), *f) for f in PRISM_FACES]
    return header + b"".join(data)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_polygons_of_unlike_length_are_read(tmp_path: Path, form: str, newline: str) -> None:
    content = ply_of_polygons(form, newline)
    if form == "ascii":  # trimesh reads these
        content = content.replace(b".0 ", b" ").replace(b".0\n", b"\n")
    (tmp_path / "prism.ply").write_bytes(content)
    mesh, defects = load_mesh(tmp_path / "prism.ply", "flat")
    assert len(mesh.faces) == 3 + 3 + 5 * 2
    assert defects == ["no normals in the file"]  # closed, and wound alike
    height = np.ptp(mesh.vertices[:, 2])  # 1 before it was scaled
    exact = 2.5 * np.sin(np.radians(72)) * height**3
    assert volume(mesh) == pytest.approx(exact, rel=1e-6)  # float32


def test_strips_are_turned_into_triangles() -> None:
    mesh, defects = load_mesh(CASES / "triangle_strips.ply", "flat")
    assert (len(mesh.faces), len(mesh.vertices)) == (4, 4)
    assert not [words for words in defects if words.startswith(("open", "inconsistent"))]
    # A tetrahedron of edges 1, and all its faces wound the same way after one was turned.
    assert volume(mesh) > 0


def strips(rows: str, count: int) -> bytes:
    head = HEADER.format(form="ascii").replace("vertex 10", "vertex 4")
    head = head.replace("face 7", f"tristrips {count}").replace("uchar int", "int int")
    return (head + "0 0 0\n1 0 0\n0 1 0\n1 1 0\n" + rows).encode()


def test_strips_begin_anew_after_a_negative_index_and_lose_doubled_corners() -> None:
    whole = read_ply(strips("4 0 1 2 3\n", 1))
    assert whole.faces.tolist() == [[0, 1, 2], [2, 1, 3]]
    broken = read_ply(strips("7 0 1 2 -1 2 1 3\n", 1))
    assert broken.faces.tolist() == [[0, 1, 2], [2, 1, 3]]
    apart = read_ply(strips("3 0 1 2\n3 2 1 3\n", 2))
    assert apart.faces.tolist() == broken.faces.tolist()
    doubled = read_ply(strips("5 0 1 2 2 3\n", 1))
    assert doubled.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    "content",
    [
        strips("4 0 1 2\n", 1),
        strips("4 0 1 2 3\n9\n", 1),
        strips("-4 0 1 2 3\n", 1),
        strips("4 0 1 2 x\n", 1),
        strips("1e300 0 1 2 3\n", 1),
        strips("3 0 1 2\n", 99_999_999),
        ply_of_polygons("binary_little_endian")[:-1],
        ply_of_polygons("binary_little_endian") + b"!",
        ply_of_polygons("binary_big_endian").replace(b"uchar", b"rgb"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.ply: expected a readable ply file"):
        load_mesh(tmp_path / "a.ply")


def test_a_refusal_says_once_what_was_expected(tmp_path: Path) -> None:
    path = tmp_path / "x.ply"
    path.write_bytes(ply_of_polygons("ascii").replace(b"property float x", b"property float X"))
    with pytest.raises(InputError, match="readable ply file, found no vertices with x, y and z;"):
        load_mesh(path)


def test_a_missing_texture_is_nobodys_business(tmp_path: Path) -> None:
    """In a program of its own: there the log of trimesh goes to the error stream."""
    file = CASES / "names_a_texture.ply"
    program = f"from malus.scenes.shapes.meshes import load_mesh; load_mesh({str(file)!r})"
    told = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert told.stdout + told.stderr == ""


@pytest.mark.parametrize(("suffix", "needs"), [("3mf", "lxml"), ("dae", "pycollada")])
def test_what_a_format_needs_is_named(tmp_path: Path, suffix: str, needs: str) -> None:
    from trimesh.exchange.load import mesh_formats

    if suffix in mesh_formats():
        pytest.skip("trimesh reads it here")
    (tmp_path / f"a.{suffix}").write_bytes(b"x")
    with pytest.raises(InputError, match=f"install {needs}"):
        load_mesh(tmp_path / f"a.{suffix}")


@pytest.mark.parametrize("suffix", ["3mf", "glb"])
def test_several_bodies_are_read_where_they_stand(tmp_path: Path, suffix: str) -> None:
    import trimesh
    from trimesh.exchange.load import mesh_formats

    if suffix not in mesh_formats():
        pytest.skip("an optional reader of trimesh is missing")
    box = trimesh.creation.box()
    moved = trimesh.transformations.translation_matrix([3, 0, 0])
    scene = trimesh.Scene([box])
    scene.add_geometry(box.copy(), transform=moved)
    (tmp_path / f"two.{suffix}").write_bytes(scene.export(file_type=suffix))
    mesh, _ = load_mesh(tmp_path / f"two.{suffix}", "flat")
    assert len(mesh.faces) == 24
    extent = np.ptp(mesh.vertices, axis=0)
    assert extent.max() / extent.min() == pytest.approx(4.0, rel=1e-6)


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize(
    ("plain", "written"),
    [
        ("v 0 1 0\n", "  v 0 1 0\n"),
        ("v 0 1 0\n", "v\t0\t1\t0\n"),
        ("v 0 1 0\n", "\tv 0 1 0 # the third\n"),
        ("v 0 0 0\n", "\ufeffv 0 0 0\n"),
        ("f 1 2 4\n", "  f 1 2 4\n"),
        ("f 1 2 4\n", "f\t1 2\t4 # a face\n"),
        ("f 1 2 4\n", "#f 1 2 3\nf 1 \\\n2 4\n"),
        ("\n", "\r\n"),
        ("\n", "\r"),
    ],
)
def test_lines_of_obj_mean_the_same_however_they_are_written(
    tmp_path: Path, plain: str, written: str
) -> None:
    texts = {"plain": TETRAHEDRON, "written": TETRAHEDRON.replace(plain, written)}
    meshes = {}
    for name, text in texts.items():
        (tmp_path / f"{name}.obj").write_bytes(text.encode())
        meshes[name], _ = load_mesh(tmp_path / f"{name}.obj", "flat")
    np.testing.assert_array_equal(meshes["written"].vertices, meshes["plain"].vertices)
    np.testing.assert_array_equal(meshes["written"].faces, meshes["plain"].faces)


@pytest.mark.parametrize("mark", ["utf-16-le", "utf-16-be"])
def test_an_obj_of_16_bits_a_letter_is_the_same_mesh(tmp_path: Path, mark: str) -> None:
    """As PowerShell writes it; its negative indices were counted from the end of the file."""
    text = TETRAHEDRON.replace("f 1 3 2", "f -4 -2 -3") + "v 9 9 9\n"
    (tmp_path / "plain.obj").write_text(text)
    (tmp_path / "wide.obj").write_bytes(("\ufeff" + text).encode(mark))
    plain, wide = (load_mesh(tmp_path / f"{name}.obj", "flat")[0] for name in ("plain", "wide"))
    np.testing.assert_array_equal(wide.vertices, plain.vertices)
    np.testing.assert_array_equal(wide.faces, plain.faces)
    assert len(wide.faces) == 4


@pytest.mark.parametrize("header", [b"solid box", b"solid facet", b""])
@pytest.mark.parametrize("behind", [0, 2, 80])
def test_binary_stl_is_read_by_its_count(tmp_path: Path, header: bytes, behind: int) -> None:
    import trimesh

    content = trimesh.creation.box((2, 1, 1)).export(file_type="stl")
    (tmp_path / "box.stl").write_bytes(header.ljust(80) + content[80:] + bytes(behind))
    mesh, _ = load_mesh(tmp_path / "box.stl", "flat")
    assert len(mesh.faces) == 12
    assert volume(mesh) == pytest.approx(2 * (2 / np.sqrt(6)) ** 3)  # a diagonal of 2, from √6
