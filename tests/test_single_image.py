"""The stages of the single-image chain are measured on the scenes that they claim."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from malus.bench.photos.single_image import chain_row, main, separation_row, truths
from malus.reconstruct.single_image.separation import SEPARATIONS
from malus.scenes.materials import materials


def test_turns_reach_every_material_body_and_light(monkeypatch: pytest.MonkeyPatch) -> None:
    scenes = []

    class Family:
        def truth(self, scene: object) -> object:
            return scene

    def rendered(asked: list, _sampling: object) -> Family:
        scenes.extend(asked)
        return Family()

    monkeypatch.setattr("malus.bench.photos.single_image.render_family", rendered)
    assert list(truths(("sphere", "blob"), 24, 8, coloured=True)) == scenes
    assert len(scenes) == len({scene.id for scene in scenes}) == 5 * 2 * 4 * 2
    assert {scene.surface.material_label for scene in scenes} == set(materials())
    assert len({str(scene.surface.albedo) for scene in scenes}) == 7
    scenes.clear()
    assert len(list(truths(("sphere",), 1, 8, coloured=False))) == 24 * 5 * 2 * 4


def test_every_separation_is_measured() -> None:
    truth = next(truths(("sphere",), 24, 24, coloured=True))
    row = separation_row(truth)
    errors = [row[name + tint] for name in SEPARATIONS for tint in ("", "+tint")]
    # Of the highlight's largest value: measured below 1 %; a tenth would be a wrong formula.
    assert 0 < min(errors) < max(errors) < 0.1
    assert row["light neutral"] == 0.0


def test_the_command_writes_a_line_a_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = [truth for truth, _ in zip(truths(("sphere",), 24, 20, False), range(2), strict=False)]
    monkeypatch.setattr("malus.bench.photos.single_image.truths", lambda *_: iter(few))
    rows = tmp_path / "rows.jsonl"
    arguments = ["--stage", "chain", "--level", "blind-normals", "--rows", str(rows)]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    found = [json.loads(line) for line in rows.read_text("utf-8").splitlines()]
    assert [row["shape"] for row in found] == ["sphere", "sphere"]
    assert found[0]["skill"] == pytest.approx(chain_row(few[0], "blind-normals")["skill"])
    assert np.all([row["normals_deg"] < 0.1 for row in found])
    assert "median" in result.output
