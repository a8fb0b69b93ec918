"""What is wrong with a mesh file is told by `malus plan`."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh
from click.testing import CliRunner
from made_up import icosphere

from malus.bench.commands.plan import plan_command
from malus.bench.running.mesh_defects import MOST_READ, mesh_defects
from malus.scenes import Dielectric, MeshFile, Placed, Scene, Sphere, Surroundings, Uniform

PAINT = Dielectric(eta=1.5, alpha=0.3)


def half_ball(path: Path, whole: bool = False) -> Path:
    """A ball of 320 triangles, or the 160 of its front, whose rim has an edge without another."""
    ball = icosphere(2)
    front = ball.vertices[ball.faces].mean(axis=1)[:, 2] > 0
    faces = ball.faces if whole else ball.faces[front]
    trimesh.Trimesh(ball.vertices, faces, process=False).export(path)
    return path


def scene(path: Path) -> Scene:
    return Scene(shape=MeshFile(path=str(path)), surface=PAINT, light=Uniform())


def test_defects_are_those_of_every_mesh_of_the_objects(tmp_path: Path) -> None:
    sound, open_ = half_ball(tmp_path / "a.ply", whole=True), half_ball(tmp_path / "b.ply")
    beside = Placed(shape=MeshFile(path=str(open_)), surface=PAINT)
    room = Scene(
        shape=Sphere(),
        surface=PAINT,
        light=Uniform(),
        surroundings=Surroundings(name="room", objects=(beside,)),
    )
    assert mesh_defects([scene(sound)]) == {}
    rim = len(trimesh.load(open_, process=False).outline().entities[0].points) - 1
    assert rim > 0
    expected = {str(open_): [f"open: {rim} edges have only one face"]}
    assert mesh_defects([scene(sound), scene(open_), room]) == expected


def test_of_thousands_of_meshes_some_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = []
    monkeypatch.setattr(
        "malus.bench.running.mesh_defects.load_mesh",
        lambda path, *_: read.append(path) or (None, []),
    )
    for number in range(MOST_READ + 5):
        (tmp_path / f"{number}.ply").write_bytes(bytes(number))
    assert mesh_defects(scene(path) for path in sorted(tmp_path.iterdir())) == {}
    assert len(read) == MOST_READ


@pytest.mark.parametrize("whole", [False, True])
def test_a_plan_tells_of_them(tmp_path: Path, whole: bool) -> None:
    half_ball(tmp_path / "ball.ply", whole)
    suite = """
name = "ball"
shapes = [{ kind = "mesh", path = "ball.ply" }]
materials = ["water"]
surfaces = [{ alpha = 0.3 }]
lights = [{ kind = "uniform" }]
wavelengths_nm = [550]
methods = ["unpolarised"]
camera = { resolution = 12 }
sampling = { samples = 4 }
"""
    (tmp_path / "s.toml").write_text(suite, "utf-8")
    told = CliRunner().invoke(plan_command, [str(tmp_path / "s.toml"), "--backend", "scalar"])
    assert told.exit_code == 0, told.output
    assert ("edges have only one face; backs of faces" in told.output) != whole
