"""Methods of other people: by name of an object, and by entry point."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import pytest

from malus.bench.scoring.judge import score
from malus.reconstruct import Components, Method, Observation, get_method, methods
from malus.reconstruct.methods import _installed
from malus.renderers import render
from malus.scenes import Camera, Dielectric, Distant, InputError, Scene, Sphere

TEXT = """
from malus.reconstruct import Components, Method

def all_vertical(observation):
    image = observation.image
    return Components(image, -0.1 * image, 0 * image)

mine = Method("mine", frozenset({"normals"}), all_vertical, "a tenth, vertical")
nothing = 3
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "my_methods.py").write_text(TEXT, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_an_object_in_the_working_folder(module: Path) -> None:
    method = get_method("my_methods:mine")
    surface = Dielectric(eta=1.5, alpha=0.3, body="unpolarised")
    scene = Scene(
        shape=Sphere(),
        surface=surface,
        light=Distant(incidence_deg=60),
        camera=Camera(resolution=16),
    )
    assert score(render(scene, renderer="torrance-sparrow"), method).skill < 0


@pytest.mark.parametrize(
    "name", ["my_methods:absent", "my_methods:nothing", "no_such_module:x", "os:system", ":"]
)
def test_what_is_no_method_is_said_in_one_line(module: Path, name: str) -> None:
    with pytest.raises(InputError) as mistake:
        get_method(name)
    assert "\n" not in str(mistake.value)


def test_entry_points_are_methods(module: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [
        importlib.metadata.EntryPoint(name, "my_methods:mine", "malus.methods")
        for name in ("theirs", "visible")
    ]
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: entries)
    for kept in (methods, _installed):
        kept.cache_clear()
    try:
        assert get_method("theirs").summary == "a tenth, vertical"
        assert get_method("visible").summary == "a tenth, vertical"  # in place of malus's own
        assert "eq8" in methods()
    finally:
        for kept in (methods, _installed):
            kept.cache_clear()


def test_a_method_is_a_small_declaration() -> None:
    def guess(observation: Observation) -> Components:
        return Components(observation.image, 0 * observation.image, 0 * observation.image)

    assert Method("guess", frozenset(), guess, "nothing").name == "guess"
