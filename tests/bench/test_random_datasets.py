"""Datasets in parts are the whole, are listed without reading scenes, and tell what they are."""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from rooms import needs_arrays
from runs import SUITE, run_malus

from malus.bench.commands.plan import plan_command
from malus.bench.commands.status import status_command
from malus.bench.datasets import card as documents
from malus.bench.datasets.export import export
from malus.bench.datasets.render import render_dataset
from malus.bench.running.distributions import histogram
from malus.bench.running.status import status
from malus.renderers.datasets import dataset as datasets
from malus.renderers.datasets import part_list
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.variant import Variant
from malus.scenes import Camera, InputError, Sampling, Suite, load_suite
from malus.scenes.core.remote import as_path
from malus.scenes.random_suite.splits import values_of

NOBODY = Variant("scalar_spectral_polarized", "not used")
CONTENT: dict[str, Any] = {
    "name": "drawn",
    "description": "Spheres at random",
    "wavelengths_nm": [550],
    "methods": ["unpolarised"],
    "renderer": "torrance-sparrow",
    "camera": {"resolution": 8},
    "random": {
        "count": 10,
        "seed": 1,
        "shapes": [{"kind": "sphere"}],
        "materials": [{"eta": {"uniform": [1.3, 1.8]}}],
        "surfaces": [{"alpha": {"log_uniform": [0.1, 0.5]}, "albedo": {"uniform": [0.1, 0.9]}}],
        "lights": [{"kind": "distant", "incidence_deg": {"uniform": [10, 80]}}],
    },
    "splits": {"train": 0.6, "val": 0.2, "test": 0.2, "disjoint": ["material", "light"]},
}
FILES = {"README.md", "conventions.png", "croissant.json", "dataset.json", "splits.json"}


def drawn(count: int = 10, **changes: Any) -> Suite:
    content = CONTENT | {"random": CONTENT["random"] | {"count": count}} | changes
    return Suite.parse(content, "test")


def content_of(folder: Path) -> dict[str, bytes]:
    """Bytes of every image of a dataset, by scene and name."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.parent != folder
    }


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    render_dataset(drawn(), folder, NOBODY)
    return folder


def test_parts_in_one_folder_are_the_whole(whole: Path, tmp_path: Path) -> None:
    for number in (2, 3, 1):  # in any order
        assert not (tmp_path / "README.md").exists()
        done = render_dataset(drawn(), tmp_path, NOBODY, part=f"{number}/3")
        assert done["part"] == f"{number}/3"
        assert done["scenes"] == done["rendered"] == (4 if number == 1 else 3)
    assert content_of(tmp_path) == content_of(whole)
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in whole.iterdir()}
    for name in FILES - {"conventions.png"}:
        assert (tmp_path / name).read_bytes() == (whole / name).read_bytes(), name


def test_parts_in_a_store_elsewhere_are_the_whole(whole: Path) -> None:
    url = "memory://parts/drawn"
    for number in (2, 1):
        render_dataset(drawn(), url, NOBODY, part=f"{number}/2")
    assert status(url).done == 10
    dataset = open_folder(url)
    assert dataset.record == open_folder(whole).record
    assert {path.name for path in as_path(url).iterdir()} == {p.name for p in whole.iterdir()}


def test_parts_in_several_folders_are_copied_together(whole: Path, tmp_path: Path) -> None:
    for number in (1, 2):
        render_dataset(drawn(), tmp_path / str(number), NOBODY, part=f"{number}/2")
        shutil.copytree(tmp_path / str(number), tmp_path / "all", dirs_exist_ok=True)
    done = render_dataset(drawn(), tmp_path / "all", NOBODY)
    assert (done["rendered"], done["taken_over"]) == (0, 10)
    assert content_of(tmp_path / "all") == content_of(whole)
    assert (tmp_path / "all" / "dataset.json").read_bytes() == (whole / "dataset.json").read_bytes()


def test_the_first_scenes_of_a_larger_suite_are_taken_over(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "more")
    done = render_dataset(drawn(14), tmp_path / "more", NOBODY)
    assert (done["rendered"], done["taken_over"]) == (4, 10)
    assert content_of(tmp_path / "more").items() >= content_of(whole).items()
    few = open_folder(whole).scenes
    assert open_folder(tmp_path / "more").scenes[:10] == few


def test_families_of_any_suite_are_parted(tmp_path: Path) -> None:
    quick = load_suite("quick").model_copy(
        update={
            "renderer": "torrance-sparrow",
            "lights": load_suite("quick").lights[1:],
            "bodies": ("unpolarised",),
            "camera": drawn().camera,
        }
    )
    render_dataset(quick, tmp_path / "whole", NOBODY)
    for number in (1, 2):
        render_dataset(quick, tmp_path / "parts", NOBODY, part=f"{number}/2")
    assert content_of(tmp_path / "parts") == content_of(tmp_path / "whole")
    assert open_folder(tmp_path / "parts").scenes == open_folder(tmp_path / "whole").scenes


def test_status_counts_parts_while_they_are_made(tmp_path: Path) -> None:
    def stop(done: int, total: int, label: str) -> None:
        del total, label
        if done == 2:
            state = status(tmp_path)
            assert (state.total, state.done, state.left) == (10, 5, 5)
            raise KeyboardInterrupt

    render_dataset(drawn(), tmp_path, NOBODY, part="2/3")
    with pytest.raises(KeyboardInterrupt):
        render_dataset(drawn(), tmp_path, NOBODY, part="1/3", progress=stop)
    state = status(tmp_path)
    assert (state.total, state.done, state.left, state.finished) == (10, 5, 5, False)
    assert [(p.part, p.total, p.done) for p in state.parts] == [("1/3", 4, 2), ("2/3", 3, 3)]
    told = CliRunner().invoke(status_command, [str(tmp_path)]).output
    assert "part 1/3: 2 of 4 done" in told
    done = render_dataset(drawn(), tmp_path, NOBODY, part="1/3")
    assert (done["rendered"], done["taken_over"]) == (2, 2)
    assert len(open_folder(tmp_path)) == 7


def test_parts_that_were_copied_together_are_not_finished(tmp_path: Path) -> None:
    """One of their lists of scenes has come in the place of the other's."""
    both = tmp_path / "both"
    for number in (1, 2):
        render_dataset(drawn(), tmp_path / str(number), NOBODY, part=f"{number}/2")
        shutil.copytree(tmp_path / str(number), both, dirs_exist_ok=True)
    state = status(both)
    assert (state.done, state.left, state.finished) == (10, 0, False)
    assert len(open_folder(both)) == 5
    told = CliRunner().invoke(status_command, [str(both)]).output
    assert "The same command without --part takes over what parts have here." in told
    assert render_dataset(drawn(), both, NOBODY)["taken_over"] == 10
    assert status(both).finished
    assert len(open_folder(both)) == 10


def test_a_part_of_other_renders_is_refused(tmp_path: Path) -> None:
    render_dataset(drawn(), tmp_path, NOBODY, part="1/2")
    before = content_of(tmp_path)
    others = (drawn(sampling={"seed": 5}), NOBODY), (drawn(), Variant("other", "not used"))
    for suite, variant in others:
        with pytest.raises(InputError, match="a dataset of the same scenes, samples and seed, "):
            render_dataset(suite, tmp_path, variant, part="2/2")
    assert content_of(tmp_path) == before
    assert len(open_folder(tmp_path)) == 5
    assert status(tmp_path).left == 5


def test_scores_of_half_a_dataset_say_so(whole: Path, tmp_path: Path) -> None:
    render_dataset(drawn(), tmp_path / "half", NOBODY, part="1/2")
    for folder, says in ((tmp_path / "half", "5 more of the suite are not rendered"), (whole, "")):
        out = ("--out", str(tmp_path / "scores"))
        done = run_malus("score", str(folder), "--method", "unpolarised", *out)
        assert done.returncode == 0, done.stderr
        assert says in done.stderr
        assert ("not rendered" in done.stderr) == bool(says)
        run = json.loads((tmp_path / "scores" / "run.json").read_text("utf-8"))
        assert run["scenes_missing"] == (5 if says else 0)


def test_a_part_into_the_whole_leaves_it_whole(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "again")
    render_dataset(drawn(), tmp_path / "again", NOBODY, part="1/2")
    assert len(open_folder(tmp_path / "again")) == status(tmp_path / "again").total == 10


def test_resuming_and_status_read_no_scene(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(whole, tmp_path / "again")

    def refused(*_: object) -> None:
        raise AssertionError("a scene was read")

    monkeypatch.setattr(datasets, "read_record", refused)
    monkeypatch.setattr(datasets, "read_scene", refused)
    assert render_dataset(drawn(), tmp_path / "again", NOBODY)["taken_over"] == 10
    assert status(tmp_path / "again").done == len(open_folder(tmp_path / "again")) == 10


def test_what_was_killed_before_it_was_listed_goes_on_by_its_list(tmp_path: Path) -> None:
    """`dataset.json` is written at the end; a list, cut in the middle of a line, tells the rest."""

    def stop(done: int, total: int, label: str) -> None:
        del total, label
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_dataset(drawn(), tmp_path, NOBODY, part="1/2", progress=stop)
    (path,) = (tmp_path / "parts").iterdir()
    path.write_bytes(path.read_bytes()[:-20])  # the last of four lines
    (tmp_path / "dataset.json").unlink()
    done = render_dataset(drawn(), tmp_path, NOBODY, part="1/2")
    assert (done["rendered"], done["taken_over"]) == (1, 4)  # the fourth is looked at itself
    assert len(open_folder(tmp_path)) == 5
    assert status(tmp_path).done == 5


def test_a_cluster_shares_out_parts(whole: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed")
    done = render_dataset(drawn(), tmp_path, "scalar", workers=2)
    assert (done["rendered"], done["taken_over"], done["failed"]) == (10, 0, 0)
    assert content_of(tmp_path) == content_of(whole)
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in whole.iterdir()}
    with pytest.raises(InputError, match="no part beside"):
        render_dataset(drawn(), tmp_path, "scalar", workers=2, part="1/2")


@pytest.mark.parametrize("part", ["0/3", "4/3", "1", "1/0", "a/b", "-1/2"])
def test_a_part_that_is_none_is_refused(tmp_path: Path, part: str) -> None:
    with pytest.raises(InputError, match="a part of several, such as 3/16"):
        render_dataset(drawn(), tmp_path / "new", NOBODY, part=part)
    assert not (tmp_path / "new" / "dataset.json").exists()


def test_scenes_that_are_alike_are_refused(tmp_path: Path) -> None:
    flat = CONTENT["random"] | {"materials": ["pmma"], "surfaces": ["carbon"], "count": 30}
    flat["lights"] = [{"kind": "distant", "incidence_deg": {"choice": [30, 60]}}]
    same = Suite.parse(CONTENT | {"random": flat, "splits": {"train": 1.0}}, "test")
    with pytest.raises(InputError, match=r"scene 0; draw a range in place of choices"):
        render_dataset(same, tmp_path, NOBODY)


def test_splits_are_written_kept_by_exports_and_checked(whole: Path, tmp_path: Path) -> None:
    content = json.loads((whole / "splits.json").read_text("utf-8"))
    dataset = open_folder(whole)
    names = [name for names in content["splits"].values() for name in names]
    assert sorted(names) == sorted(dataset.scenes)
    of_entries = {entry.scene: entry.split for entry in dataset.record.scenes}
    for split, scenes in content["splits"].items():
        assert scenes
        for name in scenes:
            assert of_entries[name] == split
            for axis in ("material", "light"):
                for value in values_of(dataset.scene(name).scene, axis):
                    assert content["values"][axis][value] == split
    export(whole, "png", tmp_path / "png")
    assert json.loads((tmp_path / "png" / "splits.json").read_text("utf-8")) == content
    shutil.copytree(whole, tmp_path / "leak")
    content["splits"]["test"].append(content["splits"]["train"][0])
    (tmp_path / "leak" / "splits.json").write_text(json.dumps(content), "utf-8")
    with pytest.raises(InputError, match="every scene of the dataset in one split"):
        export(tmp_path / "leak", "png", tmp_path / "no")


def test_the_card_tells_what_the_dataset_is(whole: Path) -> None:
    text = (whole / "README.md").read_text("utf-8")
    for said in (
        "# drawn", "Spheres at random", "10 scenes", "8 × 8 pixels", "550 nm", "splits.json",
        "No material and no light", "`surface.eta`", "conventions.png", "reference axis +x",
        "## Limits", "## Licence", "Not stated", "@software{malus",
    ):  # fmt: skip
        assert said in text, said
    counts = {
        s: len(n) for s, n in json.loads((whole / "splits.json").read_text())["splits"].items()
    }
    assert ", ".join(f"{split} {count}" for split, count in counts.items()) in text
    licensed = documents.card(
        open_folder(whole).record,
        drawn(licence="https://creativecommons.org/licenses/by/4.0/"),
        [],
    )
    assert "of two scenes is so too" in licensed
    of_axes = documents.card(open_folder(whole).record, SUITE, [])
    assert "of two scenes is not: all have the same random numbers" in of_axes
    assert "licenses/by/4.0" in licensed
    assert "Not stated" not in licensed


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of rdflib, which mlcroissant reads by
def test_croissant_metadata_are_valid_and_give_the_scenes(whole: Path) -> None:
    if importlib.util.find_spec("mlcroissant") is None:
        pytest.skip("mlcroissant is not installed: pip install 'malus[dev]'")
    import mlcroissant

    read = mlcroissant.Dataset(jsonld=whole / "croissant.json")
    assert not read.metadata.issues.errors
    rows = list(read.records("scenes"))
    told = {row["scenes/scene"].decode(): row["scenes/split"].decode() for row in rows}
    assert told == {entry.scene: entry.split for entry in open_folder(whole).record.scenes}
    kinds = {row["splits/name"]: row["splits/url"] for row in read.records("splits")}
    assert kinds["test"] == "cr:TestSplit"


def test_the_plan_shows_distributions_and_splits(tmp_path: Path) -> None:
    lines = [
        'name = "planned"\nwavelengths_nm = [550]\nmethods = ["unpolarised"]',
        'renderer = "torrance-sparrow"\ncamera = { resolution = 8 }',
        '[random]\ncount = 40\nshapes = [{ kind = "sphere" }]\nmaterials = ["pmma", "water"]',
        "surfaces = [{ alpha = { uniform = [0.1, 0.5] } }]",
        'lights = [{ kind = "distant", incidence_deg = { uniform = [10, 80] } }]',
        "[splits]\ntrain = 0.5\ntest = 0.5",
    ]
    (tmp_path / "s.toml").write_text("\n".join(lines), "utf-8")
    told = CliRunner().invoke(plan_command, [str(tmp_path / "s.toml"), "--backend", "scalar"])
    assert told.exit_code == 0, told.output
    assert "40 scenes in 40 families" in told.output
    assert "light.incidence_deg" in told.output
    assert "pmma 20" in told.output
    assert "train 20, test 20" in told.output


def test_a_histogram_is_even_on_the_scale_that_was_drawn_from() -> None:
    places = [(i + 0.5) / 160 for i in range(160)]
    assert histogram([1 + 99 * u for u in places]) == "█" * 16
    assert histogram([100**u for u in places]) == "█" * 16
    assert histogram([3.0]) == "█"


@needs_arrays
def test_the_card_names_maps_and_frames(tmp_path: Path) -> None:
    """Files that only some data sets have, in card and metadata, where they are there."""
    suite = load_suite("quick").model_copy(
        update={
            "camera": Camera(resolution=8),
            "sampling": Sampling(samples=2),
            "lights": load_suite("quick").lights[1:],
            "maps": ("depth",),
        }
    )
    render_dataset(suite, tmp_path)
    metadata = (tmp_path / "croissant.json").read_text("utf-8")
    assert "`<scene>/maps.exr`" in (tmp_path / "README.md").read_text("utf-8")
    assert "maps.exr" in metadata
    assert "raw.tiff" not in metadata


def test_a_part_that_ends_while_another_is_listed_loses_no_scene(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It made the dataset whole and removed its list; the other then listed what it had read."""
    write, others = DatasetWriter._write_record_with, []

    def late(writer: DatasetWriter, *arguments: Any) -> None:
        if writer.part.number == 1 and len(writer.done) == 5 and not others:
            others.append(render_dataset(drawn(), tmp_path, NOBODY, part="2/2"))
        write(writer, *arguments)

    monkeypatch.setattr(DatasetWriter, "_write_record_with", late)
    render_dataset(drawn(), tmp_path, NOBODY, part="1/2")
    assert others
    assert (tmp_path / "dataset.json").read_bytes() == (whole / "dataset.json").read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in whole.iterdir()}


def test_a_part_begins_while_the_folder_of_lists_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = part_list.replace_text

    def replace(path: Path, text: str) -> None:
        monkeypatch.undo()
        path.parent.rmdir()
        written(path, text)

    monkeypatch.setattr(part_list, "replace_text", replace)
    assert render_dataset(drawn(), tmp_path, NOBODY, part="1/2")["rendered"] == 5
