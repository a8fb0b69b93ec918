"""Names of lights in tables: lights that differ have different ones, and defaults keep theirs."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from malus.scenes import Distant, Environment, load_suite
from malus.scenes.core.named_file import NamedFile
from malus.scenes.lights.lights import Light

PLAIN: dict[str, dict[str, Any]] = {
    "uniform": {"kind": "uniform"},
    "distant 60°": {"kind": "distant", "incidence_deg": 60.0},
    "area 45°": {"kind": "area", "incidence_deg": 45.0},
    "environment studio": {"kind": "environment"},
    "sky 45°": {"kind": "sky"},
    "interior": {"kind": "interior"},
}
OTHERS: dict[str, list[Any]] = {
    "name": [],  # of a file: below
    "sun": [False],
    "turbidity": [4.0],
    "wavelength_nm": [450.0],
    "seed": [2],
    "polarised": [{"angle_deg": 10.0}, {"angle_deg": 20.0}, {"degree": 0.5}],
}


@pytest.mark.parametrize("label", PLAIN)
def test_every_key_of_a_light_is_in_its_label(label: str) -> None:
    """Each key changed alone, and one more, which moves no name of its own away."""
    build = TypeAdapter(Light).validate_python
    plain = PLAIN[label]
    light = build(plain)
    lights = [light]
    for key in type(light).model_fields:
        if key == "kind" or key in NamedFile.model_fields:
            continue
        values = OTHERS.get(key, [12.0, 13.0])
        if key == "polarised" and light.kind == "sky":
            values = [{"degree": 0.5}, {"degree": 0.7}]
        lights += [build(plain | {key: value}) for value in values]
    assert light.label == label
    assert len({one.label for one in lights}) == len(lights) == len(set(lights))


def test_two_maps_of_one_name_have_different_labels(tmp_path: Path) -> None:
    for folder in "ab":
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "sky.exr").write_text(folder, "utf-8")
    labels = {Environment(name=str(tmp_path / folder / "sky.exr")).label for folder in "ab"}
    assert len(labels) == 2
    assert all(label.startswith("environment sky ") for label in labels)
    assert not any(str(tmp_path) in label for label in labels)


def test_the_gate_finds_its_values_under_the_labels_of_its_suite() -> None:
    from malus.bench.gates import baseline

    path = Path(baseline.__file__).parents[1] / "baselines" / "gate.toml"
    stored = {value["light"] for value in tomllib.loads(path.read_text("utf-8"))["values"]}
    assert stored == {light.label for light in load_suite("gate").lights}


def test_drawn_lights_have_labels_of_their_own() -> None:
    lights = {scene.light for scene in load_suite("random").scenes()}
    assert len({light.label for light in lights}) == len(lights) > 1


def test_light_from_straight_behind_is_a_billionth_beside_it() -> None:
    """An incidence of 180° has no azimuth, and scenes refuse it."""
    behind = Distant.towards((0.0, 0.0, -2.0))
    assert 180 - 2e-9 < behind.incidence_deg < 180
    assert behind.direction[2] == pytest.approx(-1.0, abs=1e-15)
