"""The stages of the single-image chain are measured on the scenes that they claim."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from malus.bench.commands.bench import bench_command
from malus.bench.studies import single_image
from malus.bench.studies.registry import run_study
from malus.bench.studies.single_image import (
    COLOURS,
    chain_row,
    photo_scenes,
    separation_row,
)
from malus.reconstruct.single_image.separation import SEPARATIONS
from malus.renderers.families.family import render_family
from malus.renderers.truth import Truth
from malus.scenes import InputError, Sampling, Scene
from malus.scenes.materials.materials import materials


def test_turns_reach_every_material_body_and_light() -> None:
    scenes = photo_scenes(("sphere", "blob"), 24, 8, coloured=True)
    assert len(scenes) == len({scene.id for scene in scenes}) == 5 * 2 * 4 * 2
    assert {scene.surface.material_label for scene in scenes} == set(materials())
    assert {scene.surface.albedo for scene in scenes} == set(COLOURS)
    assert len(photo_scenes(("sphere",), 1, 8, coloured=False)) == 24 * 5 * 2 * 4


def test_every_fourth_has_each_material_once_a_surface_and_body() -> None:
    scenes = photo_scenes(("sphere", "blob"), 4, 8, coloured=False)
    cases = {
        (s.shape.label, s.surface.label, s.surface.material_label, s.surface.body) for s in scenes
    }
    assert len(scenes) == len(cases) == 2 * 5 * 24 * 2
    lights = Counter((s.surface.material_label, s.light.label) for s in scenes)
    # Five surfaces share four lights: one comes up twice, with two bodies and two shapes.
    assert len(lights) == 24 * 4
    assert set(lights.values()) == {4, 8}


def test_fewer_materials_are_some_of_the_same_scenes() -> None:
    few, all_of_them = (
        {s.id for s in photo_scenes(("blob",), every, 8, coloured=True)} for every in (24, 4)
    )
    assert few < all_of_them


def test_the_beginning_stands_for_all() -> None:
    begun = photo_scenes(("sphere", "blob"), 4, 8, coloured=False)[:60]
    for of in (lambda s: s.shape.label, lambda s: s.surface.body, lambda s: s.light.label):
        counts = Counter(of(s) for s in begun)
        # A fair draw of 60 leaves a half 30 ± 4 and a quarter 15 ± 3.4: three of these.
        assert min(counts.values()) > 60 / len(counts) - 3 * np.sqrt(60 * 0.25)


def _truth(scene: Scene) -> Truth:
    return render_family([scene], Sampling(samples=64)).truth(scene)


def test_every_separation_is_measured() -> None:
    row = separation_row(_truth(photo_scenes(("sphere",), 24, 24, coloured=True)[0]))
    errors = [row[name + tint] for name in SEPARATIONS for tint in ("", "+tint")]
    # Of the highlight's largest value: measured below 1 %; a tenth would be a wrong formula.
    assert 0 < min(errors) < max(errors) < 0.1
    assert row["light neutral"] == 0.0


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> list[Scene]:
    scenes = photo_scenes(("sphere",), 24, 20, coloured=False)[:2]
    monkeypatch.setattr(single_image, "photo_scenes", lambda *_: scenes)
    return scenes


def _run(rows: Path) -> str:
    arguments = ["--stage", "chain", "--level", "blind-normals", "--rows", str(rows)]
    result = CliRunner().invoke(bench_command, ["single-image", *arguments])
    assert result.exit_code == 0, result.output
    return result.output


def test_the_command_writes_a_line_a_scene(tmp_path: Path, few: list[Scene]) -> None:
    rows = tmp_path / "rows.jsonl"
    printed = _run(rows)
    written = [json.loads(line) for line in rows.read_text("utf-8").splitlines()]
    assert [row["scene"] for row in written] == [scene.id for scene in few]
    again = chain_row(_truth(few[0]), "blind-normals")
    assert written[0]["skill"] == pytest.approx(again["skill"])
    assert np.all([row["normals_deg"] < 0.1 for row in written])
    assert "median" in printed


def test_a_stopped_measurement_goes_on(
    tmp_path: Path, few: list[Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = tmp_path / "rows.jsonl"
    printed = _run(rows)
    first, second = rows.read_bytes().splitlines(keepends=True)
    # Cut off in its last line, even where what is left of it could be read.
    rows.write_bytes(first + second.rstrip(b"\n"))
    asked = []

    def counted(truth: Truth, level: str) -> dict[str, object]:
        asked.append(truth.scene.id)
        return {key: value for key, value in json.loads(second).items() if key != "made"}

    monkeypatch.setattr(single_image, "chain_row", counted)
    assert _run(rows) == printed
    assert asked == [few[1].id]
    assert rows.read_bytes() == first + second


@pytest.mark.parametrize("changed", ["SAMPLES", "made_by"])
def test_rows_of_another_version_are_measured_again(
    tmp_path: Path, few: list[Scene], monkeypatch: pytest.MonkeyPatch, changed: str
) -> None:
    rows, asked = tmp_path / "rows.jsonl", []

    def row(truth: Truth, level: str) -> dict[str, object]:
        asked.append(truth.scene.id)
        columns = {"shape": "sphere", "body": "polarised", "skill": float(len(asked))}
        return {"scene": truth.scene.id, **columns, "level": level}

    monkeypatch.setattr(single_image, "chain_row", row)
    printed = _run(rows)
    assert _run(rows) == printed
    assert len(asked) == 2
    other = {"SAMPLES": 32, "made_by": lambda _: "malus 9"}
    monkeypatch.setattr(single_image, changed, other[changed])
    again = _run(rows)
    assert again != printed
    assert _run(rows) == again
    assert asked == [scene.id for scene in few] * 2


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("text", ["{\n", "[]\n", '{"shape": "sphere"}\n', "\xff\n", "a last word"])
def test_a_file_of_something_else_is_left_alone(tmp_path: Path, text: str) -> None:
    rows = tmp_path / "rows.jsonl"
    rows.write_text(text, "latin-1")
    arguments = ["single-image", "--stage", "chain", "--rows", str(rows)]
    with pytest.raises(InputError, match=r"rows.jsonl, line 1: expected a row of this command"):
        CliRunner().invoke(bench_command, arguments, catch_exceptions=False)
    assert rows.read_text("latin-1") == text


def test_an_unknown_level_is_named_with_those_there_are() -> None:
    with pytest.raises(InputError, match=r"expected the name of a level, found 'nope'; known: bl"):
        run_study("single-image", stage="chain", levels=("nope",))
