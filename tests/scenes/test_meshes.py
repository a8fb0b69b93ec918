"""Mesh files: what comes out of sound, broken and hostile ones."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from made_up import icosphere, volume

from malus.scenes.core.errors import InputError
from malus.scenes.shapes import mesh_files, meshes
from malus.scenes.shapes.geometry import TriangleMesh, blob
from malus.scenes.shapes.meshes import load_mesh

# Float32 steps of numbers up to 1, a few of them.
FLOAT32 = 5e-7

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def as_trimesh(mesh: TriangleMesh, normals: bool = False) -> trimesh.Trimesh:
    own = mesh.normals if normals else None
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=own, process=False)


def obj(folder: Path, text: str) -> Path:
    file = folder / "mesh.obj"
    file.write_text(text)
    return file


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb", "off"])
def test_every_format_gives_the_same_mesh(suffix: str, tmp_path: Path) -> None:
    original = blob(subdivisions=3)
    file = tmp_path / f"blob.{suffix}"
    as_trimesh(original).export(file)
    mesh, defects = load_mesh(file)
    # Formats that hold no shared vertices (STL) are merged again.
    assert len(mesh.vertices) == len(original.vertices)
    assert len(mesh.faces) == len(original.faces)
    # Text formats keep eight digits, and fitting rounds once more.
    assert volume(mesh) == pytest.approx(volume(original), rel=1e-6)
    assert mesh.vertices.dtype == np.float32
    assert mesh.faces.dtype == np.uint32
    assert set(defects) <= {"no normals in the file"}


def test_scale_and_place_in_the_file_do_not_matter(tmp_path: Path) -> None:
    original = icosphere(3)
    for scale, shift in [(1e-9, 0.0), (1e6, 3e7), (250.0, -40.0)]:
        moved = trimesh.Trimesh(original.vertices * scale + shift, original.faces, process=False)
        moved.export(tmp_path / "moved.obj", digits=17)
        mesh, _ = load_mesh(tmp_path / "moved.obj")
        # The scaled coordinates were float32: 1e6 at an offset of 3e7 keeps steps of 2.
        atol = 4e-6 if shift > 1e6 else FLOAT32
        assert len(mesh.faces) == len(original.faces)
        np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1.0, atol=2 * atol)


def test_smooth_normals_approach_those_of_the_sphere(tmp_path: Path) -> None:
    as_trimesh(icosphere(5)).export(tmp_path / "sphere.ply")
    mesh, _ = load_mesh(tmp_path / "sphere.ply", "smooth")
    # Angle-weighted normals of a smooth surface are off by the order of the squared edge,
    # (0.04)² = 1.6e-3.
    np.testing.assert_allclose(mesh.normals, mesh.vertices, rtol=0, atol=1.6e-3)


def test_smooth_normal_of_a_box_corner_is_its_diagonal(tmp_path: Path) -> None:
    # However a face is cut in two: weighting by area would favour one side.
    trimesh.creation.box((2, 2, 2)).export(tmp_path / "box.obj")
    mesh, _ = load_mesh(tmp_path / "box.obj")
    assert len(mesh.vertices) == 8
    np.testing.assert_allclose(mesh.normals, mesh.vertices, atol=FLOAT32)


def test_shading_is_chosen_knowingly(tmp_path: Path) -> None:
    original = blob(subdivisions=3)
    with_normals, without = tmp_path / "with.ply", tmp_path / "without.ply"
    as_trimesh(original, normals=True).export(with_normals, vertex_normal=True)
    as_trimesh(original).export(without, vertex_normal=False)
    own, defects = load_mesh(with_normals, "file")
    assert defects == []
    np.testing.assert_allclose(own.normals, original.normals, atol=FLOAT32)
    assert load_mesh(with_normals, "flat")[0].normals is None
    smooth, defects = load_mesh(without, "smooth")
    assert defects == ["no normals in the file"]
    assert smooth.normals is not None
    # Averages on 1280 faces are visibly not the exact normals: the choice matters.
    assert np.abs(smooth.normals - own.normals).max() > 1e-3
    with pytest.raises(InputError, match="expected normals in the file, found none"):
        load_mesh(without, "file")
    with pytest.raises(InputError, match="smooth, flat or file"):
        load_mesh(without, "phong")  # type: ignore[arg-type]


def test_parts_of_a_file_are_placed_with_their_normals(tmp_path: Path) -> None:
    part = as_trimesh(icosphere(2), normals=True)
    stretched_mirrored = np.diag([-3.0, 1.0, 0.5, 1.0])
    stretched_mirrored[:3, 3] = [10.0, 2.0, 0.0]
    scene = trimesh.Scene()
    scene.add_geometry(part)
    scene.add_geometry(part, transform=stretched_mirrored)
    (tmp_path / "two.glb").write_bytes(scene.export(file_type="glb", include_normals=True))
    mesh, defects = load_mesh(tmp_path / "two.glb", "file")
    # Neither inside out nor with normals behind their faces, mirrored and stretched as one part is.
    assert defects == []
    assert len(mesh.faces) == 2 * len(part.faces)
    smooth, _ = load_mesh(tmp_path / "two.glb", "smooth")
    # Averages over 320 faces, on an ellipsoid with curvature up to 12: degrees off, not opposite.
    assert mesh.normals is not None
    assert smooth.normals is not None
    assert np.einsum("ij,ij->i", mesh.normals, smooth.normals).min() > 0.95


def test_normals_that_point_inwards_are_turned_and_reported(tmp_path: Path) -> None:
    original = blob(subdivisions=2)
    assert original.normals is not None
    file = tmp_path / "inward.ply"
    trimesh.Trimesh(
        original.vertices, original.faces, vertex_normals=-original.normals, process=False
    ).export(file, vertex_normal=True)
    mesh, defects = load_mesh(file, "file")
    assert defects == ["inverted normals: they pointed against the faces and were turned"]
    np.testing.assert_allclose(mesh.normals, original.normals, atol=FLOAT32)


def test_inside_out_is_turned_and_reported(tmp_path: Path) -> None:
    sound, defects = load_mesh(obj(tmp_path, TETRAHEDRON), "flat")
    assert (volume(sound) > 0, defects) == (True, ["no normals in the file"])
    inverted = "\n".join(
        f"f {' '.join(reversed(line.split()[1:]))}" if line.startswith("f") else line
        for line in TETRAHEDRON.splitlines()
    )
    mesh, defects = load_mesh(obj(tmp_path, inverted), "flat")
    assert volume(mesh) == pytest.approx(volume(sound), rel=FLOAT32)
    assert defects[0].startswith("inverted: ")


@pytest.mark.parametrize(
    ("text", "words", "faces"),
    [
        (TETRAHEDRON.replace("f 2 3 4\n", ""), "open: 3 edges have only one face", 3),
        (TETRAHEDRON + "f 1 2 2\n", "degenerate: 1 faces without area dropped", 4),
        (TETRAHEDRON + "v 9 9 9\n", "no normals in the file", 4),
        (TETRAHEDRON.replace("f 1 3 2", "f 1 2 3"), "inconsistent: 3 edges", 4),
        (TETRAHEDRON + "v 0 0 -1\nf 1 2 5\n", "not a surface: 1 edges", 5),
    ],
)
def test_defects_in_words(text: str, words: str, faces: int, tmp_path: Path) -> None:
    mesh, defects = load_mesh(obj(tmp_path, text), "smooth")
    assert any(defect.startswith(words) for defect in defects), defects
    assert len(mesh.faces) == faces
    assert mesh.normals is not None
    assert np.isfinite(mesh.normals).all()
    # A vertex that no face uses does not shrink the mesh.
    assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(1.0, abs=FLOAT32)


def test_a_double_sided_sheet_has_finite_normals(tmp_path: Path) -> None:
    mesh, _ = load_mesh(obj(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n"))
    assert mesh.normals is not None
    np.testing.assert_allclose(np.abs(mesh.normals @ [0, 0, 1]), 1.0, atol=FLOAT32)


def test_huge_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "HUGE_FACES", 3)
    assert "huge: 4 faces" in load_mesh(obj(tmp_path, TETRAHEDRON))[1]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.obj", b"", "expected a mesh with faces"),
        ("points.obj", b"v 0 0 0\nv 1 1 1\n", "expected a mesh with faces"),
        ("nan.obj", b"v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", "1 of 3 vertices with NaN"),
        ("inf.obj", b"v 0 0 0\nv 1 inf 0\nv 0 1 0\nf 1 2 3\n", "1 of 3 vertices with NaN"),
        ("point.obj", b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", "a positive finite extent, found 0"),
        ("far.obj", b"v -1e308 0 0\nv 1e308 0 0\nv 0 1 0\nf 1 2 3\n", "extent, found inf"),
        ("line.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "expected faces with area"),
        ("beyond.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "from 1 to 3 in face 1, found 9"),
        ("zero.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 0 1 2\n", "3 in face 2, found 0"),
        ("before.obj", b"v 0 0 0\nv 1 0 0\nf -1 -2 -3\nv 0 1 0\n", "to 2 in face 1, found -3"),
        ("cut.stl", bytes(80) + b"\2\0\0\0" + bytes(99), "found 183 of 184 bytes: the file is cut"),
        ("broken.ply", b"garbage", "readable ply file"),
        ("broken.glb", b"garbage", "readable glb file"),
        ("cut.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\n"
         b"property float x\nend_header\n", "expected"),
        ("picture.png", b"\x89PNG", "expected a mesh file"),
        ("outside.gltf", b'{"asset":{"version":"2.0"},"buffers":[{"uri":"x.bin","byteLength":1}]}',
         "export it as .glb, or with embedded buffers"),
    ],
)  # fmt: skip
def test_bad_files_end_in_one_line(name: str, content: bytes, words: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load_mesh(file)
    message = str(caught.value)
    assert words in message
    assert message.startswith(f"mesh {file}: expected ")
    assert message.isprintable()


def test_missing_files_folders_and_devices_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_mesh(tmp_path / "missing.obj")
    with pytest.raises(InputError, match="null"):
        load_mesh("a\0.obj")
    (tmp_path / "folder.obj").mkdir()
    os.mkfifo(tmp_path / "pipe.obj")  # opening it would wait for ever
    for name in ("folder.obj", "pipe.obj"):
        with pytest.raises(InputError, match="a folder or device"):
            load_mesh(tmp_path / name)


def test_too_large_is_refused_before_reading(tmp_path: Path) -> None:
    file = tmp_path / "large.stl"
    with file.open("wb") as stream:
        stream.truncate(mesh_files.LARGEST_FILE_BYTES + 1)  # sparse: takes no disk
    with pytest.raises(InputError, match=r"at most 2 GiB, found 2\.0 GiB"):
        load_mesh(file)


def test_no_other_file_is_opened(tmp_path: Path) -> None:
    file = obj(tmp_path, "mtllib secret.mtl\n" + TETRAHEDRON.replace("f", "usemtl a\nf", 1))
    (tmp_path / "secret.mtl").write_text("newmtl a\n")
    opened: list[str] = []
    listening = [True]

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and listening and str(tmp_path) in str(arguments[0]):
            opened.append(Path(str(arguments[0])).name)

    sys.addaudithook(hook)  # sees every way to open a file; hooks cannot be removed, only deafened
    assert len(load_mesh(file)[0].faces) == 4
    listening.clear()
    assert opened == ["mesh.obj"]


def test_spot_is_sound(shared: Path) -> None:
    mesh, defects = load_mesh(shared / "meshes" / "spot.obj")
    places = np.unique(mesh.vertices, axis=0)
    assert (len(mesh.faces), len(places)) == (5856, 2930)  # its publisher's numbers
    assert defects == ["no normals in the file"]


def test_teapot_is_open(shared: Path) -> None:
    mesh, defects = load_mesh(shared / "meshes" / "teapot.obj")
    assert any(defect.startswith("open: ") for defect in defects)
    assert len(mesh.faces) == 6320
    assert mesh.normals is not None
    assert np.isfinite(mesh.normals).all()
