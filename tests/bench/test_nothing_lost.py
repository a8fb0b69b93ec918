"""What stands in a folder is kept, or the command refuses it; pages show their own run alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import fsspec
import numpy as np
import pytest
from runs import NOBODY, SUITE, formula_dataset

import malus
from malus.bench.datasets.export import export
from malus.bench.datasets.render import render_dataset
from malus.bench.running.runner import run
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.reports.source import Source
from malus.scenes import Camera, InputError, MeshFile, Suite
from malus.scenes.core.remote import as_path

CUBE = (
    "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
    + "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
)


DRAWN = """
name = "drawn"
wavelengths_nm = [550]
methods = ["eq8"]
camera = { resolution = 8 }
sampling = { samples = 2 }
[random]
count = 2
seed = 1
shapes = [{ kind = "mesh", path = "cube.obj" }]
materials = [{ eta = { uniform = [1.3, 1.7] } }]
surfaces = ["rubber"]
lights = [{ kind = "uniform" }]
"""


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: text.replace("malus dataset 1", "malus dataset 2"),
        lambda text: text[: len(text) // 2],
        lambda text: json.dumps(json.loads(text) | {"created_by": "hand"}),
    ],
    ids=["newer", "cut", "another key"],
)
def test_a_dataset_that_cannot_be_read_is_not_rendered_over(
    tmp_path: Path, spoil: Callable[[str], str]
) -> None:
    """It was taken for none: every scene was replaced by one of other samples."""
    formula_dataset(tmp_path / "a", 8)
    record = tmp_path / "a" / "dataset.json"
    record.write_text(spoil(record.read_text("utf-8")), "utf-8")
    before = contents(tmp_path / "a")
    other = SUITE.model_copy(update={"sampling": SUITE.sampling.model_copy(update={"seed": 9})})
    with pytest.raises(InputError, match="nothing was changed"):
        render_dataset(other, tmp_path / "a", NOBODY)
    assert contents(tmp_path / "a") == before


def test_predictions_are_not_replaced_by_scenes(tmp_path: Path) -> None:
    """They lie in folders of the scenes' names, as an export and a dataset do."""
    dataset = formula_dataset(tmp_path / "a", 8)
    for scene in dataset.scenes:
        (tmp_path / "mine" / scene).mkdir(parents=True)
        (tmp_path / "mine" / scene / "0.npy").write_bytes(b"of a network")
    before = contents(tmp_path / "mine")
    with pytest.raises(InputError, match="a folder of something else"):
        export(dataset, "numpy", tmp_path / "mine")
    with pytest.raises(InputError, match="a folder of something else"):
        formula_dataset(tmp_path / "mine", 8)
    assert contents(tmp_path / "mine") == before


@pytest.mark.parametrize("drawn", [False, True])
@pytest.mark.parametrize("harm", ["removed", "changed"])
def test_copies_of_meshes_are_mended(tmp_path: Path, harm: str, drawn: bool) -> None:
    """A scene whose copy was lost to a full disk counted as done, and was never whole again."""
    (tmp_path / "cube.obj").write_text(CUBE, "utf-8")
    shape = MeshFile(path=str(tmp_path / "cube.obj"))
    changes = {"shapes": (shape,), "camera": Camera(resolution=8), "renderer": "mitsuba"}
    suite: Suite | Path = SUITE.model_copy(update=changes)
    if drawn:
        suite = tmp_path / "drawn.toml"
        suite.write_text(DRAWN, "utf-8")
    done = render_dataset(suite, tmp_path / "a", "auto", samples=2)
    (copy,) = (tmp_path / "a" / "meshes").iterdir()
    content = copy.read_bytes()
    copy.unlink()
    if harm == "changed":
        copy.write_bytes(content[:-5])
    again = render_dataset(suite, tmp_path / "a", "auto", samples=2)
    assert (again["rendered"], again["taken_over"]) == (0, done["rendered"])
    assert copy.read_bytes() == content


def test_a_store_keeps_no_file_of_an_older_export(tmp_path: Path) -> None:
    dataset, store = formula_dataset(tmp_path / "a", 8), as_path("memory://an-older-export/a")
    export(dataset, "polanalyser", store, pixels="exr")
    export(dataset, "polanalyser", store, pixels="png")
    files = fsspec.filesystem("memory").find("/an-older-export/a")
    assert any(name.endswith(".png") for name in files)
    assert not [name for name in files if name.endswith(".exr")]


def test_crops_reach_every_pixel_of_pictures_of_other_sizes(tmp_path: Path) -> None:
    """Their place was drawn from the size of the first picture."""
    small, large = (formula_dataset(tmp_path / str(side), side) for side in (8, 12))
    with DatasetWriter(tmp_path / "both") as writer:
        for dataset in (small, large):
            writer.add(dataset.truth(dataset.scenes[0]))
    export(malus.open_dataset(tmp_path / "both"), "webdataset", tmp_path / "shards")
    for folder in (tmp_path / "both", tmp_path / "shards"):
        samples = malus.open_dataset(folder, maps=("normals",), crop=6)
        whole = [sample["normals"] for sample in malus.open_dataset(folder, maps=("normals",))]
        assert sorted(map(len, whole)) == [8, 12]
        for number, picture in enumerate(whole):
            rows = set()
            for epoch in range(60):
                samples.set_epoch(epoch)
                window = samples._cut(number)(picture.shape[:2])
                np.testing.assert_array_equal(samples[number]["normals"], picture[window])
                rows.add(window[0].start)
            assert rows == set(range(len(picture) - 5))
        with pytest.raises(InputError, match=r"at least 10 × 10 pixels, found 8 × 8|1 to 8 pixels"):
            list(malus.open_dataset(folder, maps=("normals",), crop=10))


def test_images_are_those_of_the_runs_own_renders(tmp_path: Path) -> None:
    """After a run of other samples, a table was taken over beside that run's images."""
    suite = SUITE.model_copy(update={"renderer": "mitsuba"})

    def of(samples: int, **changes: object) -> dict[str, bytes]:
        sampling = suite.sampling.model_copy(update={"samples": samples})
        run(suite.model_copy(update={"sampling": sampling, **changes}), tmp_path / "run")
        return contents(tmp_path / "run" / "examples")

    first = of(4)
    assert of(2) != first
    again = of(4)
    assert again.keys() == first.keys()
    for name in first:
        path = tmp_path / name
        path.write_bytes(first[name])
        with np.load(path) as one, np.load(tmp_path / "run" / "examples" / name) as other:
            np.testing.assert_array_equal(one["truth"], other["truth"])


def test_a_page_shows_no_other_runs_scenes_or_methods(tmp_path: Path) -> None:
    results = run(SUITE, tmp_path / "run", NOBODY)
    folder = tmp_path / "run" / "examples"
    own = sorted(folder.iterdir())
    content = dict(np.load(own[0]))
    meta = json.loads(str(content["meta"])) | {"scene": "0123456789abcdef"}
    np.savez(folder / "0123456789abcdef.npz", **content | {"meta": np.array(json.dumps(meta))})
    content["method.visible"] = content["method.eq8"]
    np.savez(own[0], **content)
    source = Source(results.table, results.run, tmp_path / "run", ())
    assert {example.scene for example in source.examples} <= set(results.table["scene"])
    assert {name for example in source.examples for name in example.methods} == set(SUITE.methods)
    assert len(source.examples) == len(own)


def test_documents_of_fewer_scenes_do_not_stand_beside_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stopped enlargement left splits of the earlier scenes, and no export would take them."""
    text = """
name = "more"
wavelengths_nm = [500]
methods = ["eq8"]
renderer = "torrance-sparrow"
camera = { resolution = 8 }
[random]
count = 4
seed = 3
shapes = [{ kind = "sphere" }]
lights = [{ kind = "distant", incidence_deg = 45 }]
materials = [{ eta = { uniform = [1.3, 1.7] } }]
surfaces = ["rubber", "carbon"]
bodies = ["unpolarised"]
[splits]
train = 0.5
test = 0.5
"""
    suite = tmp_path / "more.toml"
    suite.write_text(text, "utf-8")
    render_dataset(suite, tmp_path / "a", NOBODY)
    documents = {"README.md", "croissant.json", "splits.json"}
    assert documents <= {path.name for path in (tmp_path / "a").iterdir()}
    suite.write_text(text.replace("count = 4", "count = 9"), "utf-8")
    written = DatasetWriter.add

    def stopped(writer: DatasetWriter, *arguments: object) -> None:
        if len(writer.done) == 6:
            raise KeyboardInterrupt
        written(writer, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(DatasetWriter, "add", stopped)
    with pytest.raises(KeyboardInterrupt):
        render_dataset(suite, tmp_path / "a", NOBODY)
    assert not documents & {path.name for path in (tmp_path / "a").iterdir()}
    assert export(tmp_path / "a", "webdataset", tmp_path / "b") >= 4
    monkeypatch.undo()
    render_dataset(suite, tmp_path / "a", NOBODY)
    assert documents <= {path.name for path in (tmp_path / "a").iterdir()}


def test_an_empty_split_is_told_as_empty(tmp_path: Path) -> None:
    dataset = formula_dataset(tmp_path / "a", 8)
    samples = dataset.samples()
    samples.source.splits["train"] = list(dataset.scenes)  # type: ignore[index]
    with pytest.raises(InputError, match="split test: expected a scene in it"):
        type(samples).of(samples.source, "test")
