"""Pages and tables say what was left out; masks and numbers that are none are refused."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fsspec
import numpy as np
import pandas as pd
import pytest
from random_suites import AXES, BASE
from runs import formula_dataset

import malus
from malus.bench.commands.console import plain_console
from malus.bench.commands.run import _announce
from malus.bench.datasets.card import card
from malus.bench.datasets.export import export
from malus.bench.datasets.layouts import layout_predictions
from malus.bench.gates.baseline import RunIdentity
from malus.bench.running.inside_worker import import_all
from malus.bench.running.worker_process import WorkerProcess
from malus.bench.studies import scaling, speed_ratio
from malus.bench.studies.registry import STUDIES
from malus.reconstruct.photos.knowledge import Knowledge
from malus.renderers.datasets import hdf5
from malus.renderers.datasets.dataset_record import DatasetRecord
from malus.renderers.datasets.shards import SHARDS
from malus.renderers.variant import Variant
from malus.reports import write_report
from malus.reports.figures.figure5 import figure5, figure5_by_light
from malus.reports.summary import summary
from malus.reports.tables import sample
from malus.reports.tables.colour_errors import table1
from malus.reports.tables.headline import headline_tiles
from malus.reports.tables.paper_table import paper_table
from malus.scenes import Camera, InputError, Suite, load_suite
from malus.scenes.core.model import content_id
from malus.scenes.core.remote import as_path


def test_the_size_and_samples_of_drawn_pictures_are_told_as_they_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The suite's own resolution was told, which no scene had, and samples that no pixel took."""
    cameras = [{"resolution": side, "weight": 2} for side in (24, 16)]
    changes = {"random": AXES | {"cameras": cameras}, "sampling": {"samples": 32, "target": 0.1}}
    made = Suite.parse(BASE | changes, "test")
    sides = {scene.camera.resolution for scene in made.scenes()}
    assert made.least_and_most_pixels == (min(sides), max(sides))
    _announce(made, Variant("llvm", "it renders"), plain_console(soft_wrap=True))
    assert "16² to 24² pixels, at most 32 samples a pixel" in capsys.readouterr().out
    run = sample.run() | {"suite": made.model_dump(mode="json")}
    text = summary(sample.table(), run)
    assert "16 to 24 pixels square." in text
    assert "at most 32 samples a pixel" in text


def test_a_report_says_first_what_failed(tmp_path: Path) -> None:
    """Fewer scenes in a column were all that told of a method that failed on half of them."""
    run = sample.run() | {"families": 8, "families_failed": 3, "failures": ["by zero <b>"]}
    text = summary(sample.table(), run)
    told = "3 of 8 families of scenes failed"
    assert text.index(told) < text.index("## Beside the paper")
    write_report(SimpleNamespace(table=sample.table(), run=run), tmp_path)
    page = (tmp_path / "report.html").read_text("utf-8")
    assert told in page
    assert "by zero &lt;b&gt;" in page
    assert "failed, wholly" not in summary(sample.table(), sample.run())


def test_tiles_compare_the_best_and_the_guess_on_the_same_scenes() -> None:
    """The guess had the mean of all scenes, the best that of those that it could work on."""
    table = sample.coloured()
    table = table[table["method"].isin(["unpolarised", "eq8"])]
    lacking = table["scene"].unique()[:3]
    easy = table["scene"].isin(lacking)
    table = table[~(easy & (table["method"] == "eq8"))].copy()
    table.loc[easy, "value"] *= 100.0
    tiles = [label for _, label in headline_tiles(table, table1(table), "sample")]
    others = table[~table["scene"].isin(lacking)]
    shared = [label for _, label in headline_tiles(others, table1(others), "sample")]
    compared = [label for label in tiles if "unpolarised: " in label]
    assert compared
    count = table["scene"].nunique()
    note = f", on the {count - 3} of {count} scenes of eq8"
    assert all(label.endswith(note) for label in compared)
    assert [label.removesuffix(note) for label in compared] == [
        label for label in shared if "unpolarised: " in label
    ]


def test_every_skill_of_a_table_for_papers_is_a_median() -> None:
    table = sample.table()
    rows = table[table["metric"] == "skill"]
    worst = rows["value"].copy()
    worst[worst.index[rows["method"] == "eq8"][0]] = -1000.0
    other = rows.assign(metric="skill_unmixed", value=worst)
    found = paper_table(pd.concat([table, other], ignore_index=True), ["skill_unmixed"])
    eq8 = other[other["method"] == "eq8"]["value"]
    assert found.cells["eq8", "skill_unmixed"].value == pytest.approx(eq8.median())


@pytest.mark.parametrize("points", [1, 2, 5])
def test_by_hand_is_timed_a_point(monkeypatch: pytest.MonkeyPatch, points: int) -> None:
    """With fewer points than it would take, the time was still shared among three."""
    clock = iter([0.0, 6.0])
    monkeypatch.setattr(speed_ratio.time, "perf_counter", lambda: next(clock))
    monkeypatch.setattr(speed_ratio, "by_hand", lambda *_: 0.0)
    values = tuple(np.full(points, value) for value in (0.5, 1.5, 10.0))
    seconds, _ = speed_ratio._by_hand(values, 3, "eq8")  # type: ignore[arg-type]
    assert seconds == 6.0 / min(points, 3)


def test_other_metrics_are_the_same_scenes_for_the_gate() -> None:
    suite = load_suite("quick")
    described = suite.model_dump(mode="json")

    def results(**changes: Any) -> Any:
        run = {"suite": described | changes, "variant": {"name": "scalar"}}
        return SimpleNamespace(run=run)

    origin = RunIdentity.of(results())
    assert origin.is_of(results(metrics=["delta_e76"], maps=["depth"], licence="CC0"))
    other = described["sampling"] | {"samples": 64}
    assert not origin.is_of(results(sampling=other))
    assert not origin.is_of(results(wavelengths_nm=[500]))
    # Baselines of earlier versions have metrics in their hash.
    kept = {k: v for k, v in described.items() if k not in ("name", "description", "methods")}
    sampling = {k: v for k, v in described["sampling"].items() if k != "seed"}
    content = kept | {"metrics": ["psnr"], "sampling": sampling}
    earlier = origin.model_copy(update={"scenes": content_id(content)})
    assert earlier.is_of(results(metrics=["psnr"]))
    assert not earlier.is_of(results(metrics=["ssim"]))


def test_a_disk_that_is_nearly_full_ends_an_hdf5_export_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """HDF5 ends the process where a write fails; it is not let come to that."""
    pytest.importorskip("h5py", reason="h5py is not installed")
    dataset = formula_dataset(tmp_path / "a", 8)
    usage = SimpleNamespace(free=1 << 20)
    monkeypatch.setattr(hdf5.shutil, "disk_usage", lambda _: usage)
    with pytest.raises(InputError, match=r"room for .* MB, found 1.0 MB"):
        export(dataset, "hdf5", tmp_path / "b")
    assert not list((tmp_path / "b").glob("*.h5"))


def test_predictions_of_a_layout_are_on_this_machine(tmp_path: Path) -> None:
    dataset = formula_dataset(tmp_path / "a", 8)
    with pytest.raises(InputError, match="a folder on this machine"):
        layout_predictions(dataset, as_path("memory://predictions"), "pol")
    with pytest.raises(InputError, match="a folder on this machine"):
        malus.score_published("memory://set", "pol", predictions=tmp_path)


def test_shards_of_another_format_are_refused(tmp_path: Path) -> None:
    export(formula_dataset(tmp_path / "a", 8), "webdataset", tmp_path / "b")
    record = tmp_path / "b" / SHARDS
    record.write_text(record.read_text("utf-8").replace("malus shards 1", "malus shards 2"))
    with pytest.raises(InputError, match="malus shards 1 is known"):
        malus.open_dataset(tmp_path / "b")


def test_a_study_with_a_required_option_is_told_with_it() -> None:
    assert "`malus bench single-image --stage …`" in STUDIES["single-image"].plan
    assert "`malus run stress`" in STUDIES["stress"].plan


@pytest.mark.parametrize(
    "options",
    [
        {"stage": "chain", "levels": ["nonsense"]},
        {"stage": "chain", "shapes": ["cube"]},
        {"stage": "separation", "levels": ["blind"]},
        {"stage": "separation", "coloured": True},
        {"stage": "speed", "shapes": ["sphere"]},
    ],
)
def test_options_that_a_stage_cannot_use_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        malus.run_study("single-image", **options)


MASK = np.zeros((12, 12), bool)
MASK[3:9, 3:9] = True
PICTURE = np.random.default_rng(4).random((12, 12, 3)) * [1.5, 1.0, 0.5]


@pytest.mark.parametrize("marked", [1, 255])
@pytest.mark.parametrize(
    "call",
    [
        lambda mask: malus.separate(PICTURE, mask).specular,
        lambda mask: malus.estimate_illuminant(PICTURE, mask, "gray-world").colour,
        lambda mask: Knowledge(mask=mask).mask,
        lambda mask: malus.Observation(PICTURE, mask).mask,
    ],
    ids=["separate", "illuminant", "knowledge", "observation"],
)
def test_a_mask_of_a_picture_is_that_mask(call: Callable[[Any], Any], marked: int) -> None:
    """Zeros and ones were taken for the numbers of rows: a colour of shape (40, 40, 3)."""
    for dtype in (np.uint8, np.int64, np.float32):
        found = call(MASK.astype(dtype) * dtype(marked))
        np.testing.assert_array_equal(found, call(MASK))
    for other in (PICTURE[..., 0], MASK.astype(int) * 7, np.full(MASK.shape, "yes")):
        with pytest.raises(InputError, match="mask: expected True and False"):
            call(other)


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"light": (0.0, 0.0, 0.0)}, "light"),
        ({"light": (1.0, 1.0)}, "light"),
        ({"alpha": 3.0}, "alpha"),
        ({"alpha": 0.0}, "alpha"),
        ({"eta": 0.5}, "eta"),
        ({"eta": float("nan")}, "eta"),
    ],
)
def test_what_is_told_of_a_picture_is_checked(values: dict[str, Any], word: str) -> None:
    """The command refused what a script was given wrong pictures for."""
    with pytest.raises(InputError, match=f"^{word}: "):
        Knowledge(**values)


def test_the_label_of_the_papers_range_stands_where_there_is_room() -> None:
    table = sample.table()
    nmse = (table["metric"] == "nmse") & (table["light"] == "uniform")
    table.loc[nmse, "value"] = 3e-3  # just below the band
    figure = figure5_by_light(table, "unpolarised")
    labelled = [ax.get_title(loc="left") for ax in figure.axes if _texts(ax, "paper: ")]
    assert labelled == ["distant 60°"]


@pytest.mark.parametrize(
    ("noise", "says"), [(1e-4, ""), (1e-9, "below the panels: at most 1.0e-9"), (0.0, "none")]
)
def test_a_legend_says_where_noise_is_that_no_panel_shows(noise: float, says: str) -> None:
    figure = figure5(sample.table().assign(noise=noise), "unpolarised")
    (legend,) = figure.legends
    (entry,) = [
        text
        for text in (" ".join(each.get_text().split()) for each in legend.get_texts())
        if text.startswith("expected Monte Carlo noise")
    ]
    assert entry.partition("of any method")[2].lstrip(", ") == says


def _texts(ax: Any, start: str) -> list[Any]:
    return [text for text in ax.texts if text.get_text().startswith(start)]


def test_no_folder_is_a_picture(tmp_path: Path) -> None:
    (tmp_path / "a.png").mkdir()
    with pytest.raises(InputError, match="expected a picture, found a folder"):
        malus.read_picture(tmp_path / "a.png")


def test_a_missing_run_is_told_once(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found No such file or directory; `malus run` makes"):
        malus.read_results(tmp_path)


def test_a_card_has_every_size(tmp_path: Path) -> None:
    suite = load_suite("quick")
    scenes = [
        next(iter(suite.scenes())).model_copy(update={"camera": Camera(resolution=side)})
        for side in (26, 16)
    ]
    record = DatasetRecord(planned=2, scenes=(), variant={}, versions={})
    assert "16 × 16 to 26 × 26 pixels" in card(record, suite, scenes)


@pytest.mark.parametrize("layout", ["pol", "rgb2pol", "polaranything"])
def test_layouts_of_networks_are_written_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, layout: str
) -> None:
    dataset = formula_dataset(tmp_path / "a", 8)

    def full(path: Path, content: bytes) -> int:
        with path.open("wb") as file:
            file.write(content[:3])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises((InputError, OSError), match="No space left"):
        export(dataset, layout, tmp_path / "b")
    assert not list((tmp_path / "b").rglob("*.png"))


def test_views_are_written_to_a_store(tmp_path: Path) -> None:
    malus.render_dataset("orbit", tmp_path / "a", resolution=12, samples=2)
    assert export(tmp_path / "a", "neisf", as_path("memory://views/x")) == 16
    names = fsspec.filesystem("memory").find("/views/x")
    assert sum(name.endswith(".exr") for name in names) == 3 * 16
    assert any(name.endswith("poses_bounds.npy") for name in names)


def test_a_worker_looks_for_garbage_again_after_its_imports() -> None:
    with WorkerProcess(timeout=60) as worker:
        worker.begin(import_all, "no_such_module")
        assert list(worker.stream(_enabled)) == [True]


def _enabled() -> Iterator[bool]:
    yield gc.isenabled()


def test_sizes_of_scaling_are_measured_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[list[int]] = []
    monkeypatch.setattr(scaling, "measure", lambda counts: asked.append(counts) or [])
    monkeypatch.setattr(scaling, "messages", lambda: SimpleNamespace())
    monkeypatch.setattr(scaling, "asdict", lambda _: {})
    monkeypatch.setattr(scaling, "report_lines", lambda *_: [])
    malus.run_study("scaling", most=100)
    malus.run_study("scaling", most=10_000)
    assert asked == [[24, 100], [100, 1000, 10_000]]
