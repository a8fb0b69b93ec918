"""`malus render` does several things at once; what comes out is as one after the other."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import pytest

from malus.bench.datasets.render import WritingThread, render_dataset
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.mitsuba import translate, wavefront
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, choose
from malus.scenes import Blob, InputError, Suite

NOBODY = Variant("scalar_spectral_polarized", "not used")


def suite(**more: Any) -> Suite:
    """Three shapes, of which plans make those of one roughness first."""
    data = {
        "name": "three",
        "shapes": [{"kind": "blob", "seed": seed} for seed in range(3)],
        "materials": [{"eta": 1.5}],
        "surfaces": ["obsidian", "carbon"],
        "lights": [{"kind": "distant", "incidence_deg": 60}],
        "wavelengths_nm": [550],
        "methods": ["eq8"],
        "camera": {"resolution": 8},
        "sampling": {"samples": 2},
    }
    return Suite.model_validate(data | more)


def spheres() -> Suite:
    return suite(renderer="torrance-sparrow", shapes=[{"kind": "sphere"}])


def test_a_tree_is_built_once_a_shape(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not choose().vectorised:
        pytest.skip("only the scalar variant runs here")
    monkeypatch.setattr("malus.renderers.mitsuba.wavefront.cached_stage", one_stage())
    stages, meshes = [], []
    load = wavefront.Stage.__init__
    blob = translate.geometry.blob
    monkeypatch.setattr(
        wavefront.Stage, "__init__", lambda self, *a: stages.append(a[1]) or load(self, *a)
    )
    monkeypatch.setattr(
        translate.geometry, "blob", lambda seed: meshes.append(seed) or blob(seed, subdivisions=2)
    )
    translate.tessellated.cache_clear()
    done = render_dataset(suite(), tmp_path)
    translate.tessellated.cache_clear()  # of coarse meshes
    assert done["rendered"] == 6
    assert stages == [Blob(seed=seed) for seed in range(3)]
    assert sorted(meshes) == [0, 1, 2]
    planned = [scene.id for scene in suite().scenes()]
    assert sorted(open_folder(tmp_path).scenes) == sorted(planned)


def one_stage() -> Any:
    """As `cached_stage`, for one stage only: another shape between would be found out."""
    kept: dict[Any, wavefront.Stage] = {}

    def stage(variant: Variant, *parts: Any) -> wavefront.Stage:
        if parts not in kept:
            kept.clear()
            kept[parts] = wavefront.Stage(wavefront.mitsuba(variant), *parts)
        return kept[parts]

    return stage


def test_the_next_mesh_is_made_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    threads = []

    def made(shape: Blob) -> None:
        threads.append(threading.current_thread().name)
        raise InputError("mesh", "a mesh", "none", "mend it")  # told when it is its turn

    monkeypatch.setattr(translate, "tessellated", made)
    with translate.tessellated_ahead(Blob(seed=77)):
        pass
    with translate.tessellated_ahead(None):
        pass
    assert threads == ["malus-mesh"]


def test_a_truth_is_written_while_the_next_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second is made before the first is whole; a third waits for it."""
    made: list[str] = []
    second = threading.Event()
    add = DatasetWriter.add
    render = render_dataset.__globals__["_rendered"]

    def slow(writer: DatasetWriter, truth: Truth, origin: str = "") -> None:
        assert second.wait(20)
        add(writer, truth, origin)

    def watched(task: Any) -> Any:
        for outcome in render(task):
            made.append(outcome.scene.id)
            if len(made) == 2:
                second.set()
            yield outcome

    monkeypatch.setattr(DatasetWriter, "add", slow)
    monkeypatch.setattr("malus.bench.datasets.render._rendered", watched)
    assert render_dataset(spheres(), tmp_path, NOBODY)["rendered"] == 2
    assert not [t for t in threading.enumerate() if t.name.startswith("malus-writes")]


def test_what_cannot_be_written_stops_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(writer: DatasetWriter, truth: Truth, origin: str = "") -> None:
        raise InputError(str(writer.folder), "room", "none", "make some")

    monkeypatch.setattr(DatasetWriter, "add", refuses)
    with pytest.raises(InputError, match="expected room, found none"):
        render_dataset(spheres(), tmp_path, NOBODY)


def test_ctrl_c_waits_for_what_is_being_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add = DatasetWriter.add
    begun = threading.Event()

    def slow(writer: DatasetWriter, truth: Truth, origin: str = "") -> None:
        begun.set()
        time.sleep(0.2)
        add(writer, truth, origin)

    begin = WritingThread.begin

    def interrupted(self: WritingThread, *arguments: Any) -> None:
        begin(self, *arguments)
        assert begun.wait(20)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(DatasetWriter, "add", slow)
        patch.setattr(WritingThread, "begin", interrupted)
        with pytest.raises(KeyboardInterrupt):
            render_dataset(spheres(), tmp_path, NOBODY)
    assert len(open_folder(tmp_path)) == 1
    assert len(list(open_folder(tmp_path))) == 1  # whole: every file is read and checked
    done = render_dataset(spheres(), tmp_path, NOBODY)
    assert (done["rendered"], done["taken_over"]) == (1, 1)
