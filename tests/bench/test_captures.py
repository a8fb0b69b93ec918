"""Several real captures together: their scores, their results, and what fails among them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import colour
import numpy as np
import pandas as pd
import PIL.Image
import pytest
import tifffile
from runs import one_line, run_malus

import malus
from malus.bench.running.captures import reconstruct
from malus.bench.scoring.capture_metrics import CapturedPixels
from malus.reconstruct import Components, Inapplicable, Method, Observation
from malus.reports.viewer.error_maps import error_maps
from malus.reports.viewer.examples import read_example
from malus.scenes import InputError, polarisation

SIDE = 24
ANGLES = (0.0, 45.0, 90.0, 135.0)
S1, S2 = 0.3, -0.1
"""Polarised part of the light of every pixel, over its intensity."""

METHODS = """
from malus.reconstruct import Components, Inapplicable, Method

def _share(observation, share):
    image = observation.image
    return Components(image, 0.3 * share * image, -0.1 * share * image)

def half(observation):
    return _share(observation, 0.5)

def wrong(observation):
    return _share(observation, -1.0)

def small_only(observation):
    if observation.mask.sum() > 100:
        raise Inapplicable("too large")
    return _share(observation, 1.0)

def breaks(observation):
    raise ZeroDivisionError("by nothing")

methods = {f.__name__: Method(f.__name__, frozenset(), f, "of a test")
           for f in (half, wrong, small_only, breaks)}
half, wrong, small_only, breaks = methods.values()
"""


def stokes_image(seed: int = 0) -> np.ndarray:
    """Light of many colours (SIDE, SIDE, 3, 3), all of it polarised alike."""
    s0 = np.random.default_rng(seed).uniform(0.2, 0.9, (SIDE, SIDE, 3))
    return np.stack([s0, S1 * s0, S2 * s0], axis=-1)


def write_pictures(folder: Path, stokes: np.ndarray, sigma: float = 0.0) -> None:
    """Float pictures through a polariser, with normal noise."""
    folder.mkdir(parents=True)
    random = np.random.default_rng(1)
    for angle in ANGLES:
        light = polarisation.polarised(stokes, angle)
        light = light + random.normal(0, sigma, light.shape) if sigma else light
        name = folder / f"pol_{angle:03.0f}.tif"
        tifffile.imwrite(name, light.astype(np.float32), photometric="rgb")


def write_labels(path: Path) -> None:
    """A large object on the left, a small one on the right, and nothing between."""
    labels = np.zeros((SIDE, SIDE), np.uint8)
    labels[:, :10], labels[4:12, 14:22] = 1, 7
    PIL.Image.fromarray(labels).save(path)


@pytest.fixture
def user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with two captures, a label image, a suite of both, and methods."""
    write_pictures(tmp_path / "pot", stokes_image(0))
    write_pictures(tmp_path / "lake", stokes_image(1))
    write_labels(tmp_path / "labels.png")
    (tmp_path / "two.toml").write_text(
        'name = "two"\n'
        'methods = ["of_tests:half", "of_tests:small_only", "eq8"]\n'
        '[[capture]]\nfolder = "pot"\ngroup = "indoor"\nlabels = "labels.png"\n'
        '[[capture]]\nfolder = "lake"\ngroup = "outdoor"\n',
        "utf-8",
    )
    (tmp_path / "of_tests.py").write_text(METHODS, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def value(table: pd.DataFrame, metric: str, method: str, name: str = "pot") -> float:
    """The only value of a metric over all bands and angles."""
    rows = table[table.band_nm.isna() & table.angle_deg.isna() & (table.metric == metric)]
    rows = rows[(rows.method == method) & (rows.surface == name)]
    assert len(rows) == 1, (metric, method, name)
    return float(rows.value.iloc[0])


def test_half_of_the_polarisation_has_the_scores_that_follow(user: Path) -> None:
    table = malus.run_captures("two.toml", "out", report=False).table
    # Half of the error of the guess is a quarter of its square; float32 pictures.
    assert value(table, "skill", "half") == pytest.approx(0.75, abs=1e-5)
    assert value(table, "gain", "half") == pytest.approx(0.5, abs=1e-5)
    assert value(table, "rotation", "half") == pytest.approx(0.0, abs=1e-5)
    assert value(table, "scale", "half") == pytest.approx(2.0, abs=1e-4)
    assert value(table, "scaled_skill", "half") == pytest.approx(1.0, abs=1e-6)
    assert value(table, "skill", "unpolarised") == 0.0
    assert value(table, "violations", "half") == 0.0


def test_a_field_against_the_true_one_is_worse_than_none(user: Path) -> None:
    """Twice the error of the guess is four times its square, and a scale of −1 mends it."""
    table = malus.run_captures("two.toml", "out", methods=["of_tests:wrong"], report=False).table
    assert value(table, "skill", "wrong") == pytest.approx(-3.0, abs=1e-4)
    assert value(table, "scale", "wrong") == pytest.approx(-1.0, abs=1e-5)
    assert value(table, "scaled_skill", "wrong") == pytest.approx(1.0, abs=1e-6)
    summary = malus.report("out")[-2].read_text("utf-8")
    reason = "its polarised light is 1 times the true one (rms), and correlates with it by −1.00"
    assert f"wrong on pot: skill −3.00: {reason}." in summary


def test_rotation_is_positive_anticlockwise(user: Path) -> None:
    capture = malus.read_capture("pot")
    pixels = CapturedPixels.of(capture, malus.fit_capture(capture), ~capture.clipped)
    turn = np.radians(2 * 10.0)
    s1, s2 = pixels.stokes[..., 1], pixels.stokes[..., 2]
    turned = pixels.stokes.copy()
    turned[..., 1] = np.cos(turn) * s1 - np.sin(turn) * s2
    turned[..., 2] = np.sin(turn) * s1 + np.cos(turn) * s2
    before, after = (polarisation.aolp(stokes[0, 0]) for stokes in (pixels.stokes, turned))
    assert np.degrees(after - before) % 180.0 == pytest.approx(10.0)  # an axis, not an arrow
    values = {row.metric: row.value for row in pixels.values(turned)}
    assert values["rotation"] == pytest.approx(np.sin(turn))
    assert values["aolp_mae_deg"] == pytest.approx(10.0)


def test_numbers_are_those_of_the_definitions(user: Path) -> None:
    """NMSE, ΔE76 and DoLP by hand, over the pixels of both objects."""
    table = malus.run_captures("two.toml", "out", report=False).table
    labels = np.asarray(PIL.Image.open("labels.png"))
    true = stokes_image(0)[labels > 0]
    guess = true * [1.0, 0.5, 0.5]
    peak = true[..., 0].max()
    errors = [
        np.mean((polarisation.polarised(guess - true, angle) / peak) ** 2)
        for angle in polarisation.PAPER_ANGLES_DEG
    ]
    assert value(table, "nmse", "half") == pytest.approx(np.mean(errors), rel=1e-5)
    by_angle = table[(table.metric == "nmse") & (table.method == "half") & (table.surface == "pot")]
    by_angle = by_angle[by_angle.angle_deg.notna()]
    np.testing.assert_allclose(by_angle.value, errors, rtol=1e-5)

    def lab(light: np.ndarray) -> np.ndarray:
        xyz = colour.RGB_to_XYZ(light / peak, "sRGB")
        return np.asarray(
            colour.XYZ_to_Lab(xyz, colour.RGB_COLOURSPACES["sRGB"].whitepoint), dtype=float
        )

    i_max = [polarisation.extremes(stokes)[0] for stokes in (guess, true)]
    difference = colour.delta_E(lab(i_max[0]), lab(i_max[1]), method="CIE 1976")
    # colour-science rounds its matrix to four digits in one of the two.
    assert value(table, "delta_e76_i_max", "half") == pytest.approx(difference.mean(), rel=1e-3)
    dolp = np.hypot(S1, S2)
    assert value(table, "dolp_mae", "half") == pytest.approx(dolp / 2, rel=1e-4)


def test_the_noise_beside_an_error_is_that_of_the_pictures(
    user: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A method that knows the true field has nothing but that noise left."""
    sigma = 0.01
    stokes = stokes_image(2)
    write_pictures(user / "noisy", stokes, sigma)
    true = stokes.astype(np.float32)

    def oracle(observation: Observation) -> Components:
        return Components(observation.image, true[..., 1], true[..., 2])

    method = Method("oracle", frozenset(), oracle, "knows")
    monkeypatch.setattr("malus.bench.running.captures.get_method", lambda name: method)
    table = malus.run_captures(["noisy"], "out", methods=["oracle"], report=False).table
    rows = table[(table.metric == "nmse") & (table.method == "oracle") & table.angle_deg.isna()]
    # 1728 pixels and channels with one residual each: both are known to 1/sqrt(1728) · 1.4 = 3.4 %.
    assert rows.value.iloc[0] == pytest.approx(rows.noise.iloc[0], rel=0.15)


def test_objects_are_seen_one_by_one_and_refusals_are_told(user: Path) -> None:
    table = malus.run_captures("two.toml", "out", report=False).table
    assert value(table, "skill_object_2", "small_only") == pytest.approx(1.0, abs=1e-5)
    refused = table[(table.metric == "skill_object_1") & (table.method == "small_only")]
    assert refused.empty
    notes = table[(table.method == "small_only") & (table.surface == "pot")].note.unique()
    assert list(notes) == ["left unpolarised: object 1: too large"]
    # A whole picture is one object; what needs more than a picture says so.
    reasons = table[table.metric == "inapplicable"].set_index(["surface", "method"]).note
    assert reasons["lake", "small_only"] == "too large"
    assert "normals" in reasons["lake", "eq8"]


def test_a_method_sees_nothing_but_picture_and_mask() -> None:
    seen: list[Observation] = []

    def look(observation: Observation) -> Components:
        seen.append(observation)
        return Components(observation.image, 2 * observation.image, 0 * observation.image)

    image, left = np.ones((2, 4, 1), np.float32), np.zeros((2, 4), bool)
    left[:, :2] = True
    estimate = reconstruct(Method("look", frozenset(), look, ""), image, [left])
    told = {name for name, given in vars(seen[0]).items() if given is not None}
    assert told == {"image", "mask"}
    np.testing.assert_array_equal(estimate.stokes[left][..., 1], 2.0)
    np.testing.assert_array_equal(estimate.stokes[~left][..., 1], 0.0)
    with pytest.raises(Inapplicable, match="normals"):
        reconstruct(Method("look", frozenset({"normals"}), look, ""), image, [left])


def test_results_are_reported_as_those_of_a_run(user: Path) -> None:
    malus.run_captures("two.toml", "out")
    folder = user / "out"
    table1 = pd.read_csv(folder / "table1.csv")
    assert list(table1.columns[:2]) == ["group", "method"]
    summary = (folder / "summary.md").read_text("utf-8")
    lines = [line for line in summary.splitlines() if "the paper," in line]
    assert [line.split(" | ")[0] for line in lines] == ["| indoor", "| outdoor"]
    # The paper's lines stand below those of their group.
    order = [k for k, line in enumerate(summary.splitlines()) if line.startswith("| outdoor | unp")]
    assert summary.splitlines().index(lines[0]) < order[-1]
    figure9 = pd.read_csv(folder / "figure9.csv")
    assert set(figure9.light) == {"indoor", "outdoor"}
    assert set(figure9.x) == set(polarisation.PAPER_ANGLES_DEG)
    page = (folder / "report.html").read_text("utf-8")
    assert "error map of I_max by half" in page
    assert "I_max, captured" in page
    assert "of_tests" not in page
    assert [path.name for path in malus.report("out")][-1] == "report.html"


def test_examples_are_pixels_of_the_capture(user: Path) -> None:
    results = malus.run_captures("two.toml", "out", report=False)
    scene = results.run["captures"][0]["scene"]
    example = read_example(user / "out" / "examples" / f"{scene}.npz")
    assert example.channels == ("red", "green", "blue")
    np.testing.assert_allclose(example.truth, stokes_image(0), atol=1e-6)  # float32
    assert set(example.methods) == {"unpolarised", "half", "small_only"}
    # All pixels are kept of so small a picture, so that its error maps have the table's means.
    maps = {(m.method, m.image): np.nanmean(m.difference) for m in error_maps(example)}
    for image, metric in (("I_max", "delta_e76_i_max"), ("I_min", "delta_e76_i_min")):
        mean = value(results.table, metric, "half")
        assert maps["half", image] == pytest.approx(mean, rel=1e-5)


def test_what_fails_is_named_and_the_others_are_scored(user: Path) -> None:
    done = run_malus(
        "capture", "pot", "nowhere", "lake", "--method", "of_tests:breaks", "--out", "out"
    )
    assert done.returncode == 1, done.stderr
    told = [line for line in done.stderr.splitlines() if line.startswith("left out, ")]
    assert len(told) == 3
    assert "nowhere: " in told[1]
    assert "pot, breaks: ZeroDivisionError (of_tests.py, line 20): by nothing" in told[0]
    results = malus.read_results("out")
    assert set(results.table.surface) == {"pot", "lake"}
    assert results.run["captures_failed"] == 1
    assert (user / "out" / "report.html").exists()


def test_nothing_that_can_be_scored_ends_in_one_line(user: Path) -> None:
    done = run_malus("capture", "nowhere", "neither", "--out", "out")
    assert done.returncode == 2
    assert "nowhere: expected" in one_line(done.stderr)
    assert not (user / "out" / "run.json").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["pot", "lake", "--light", "1,1,2"], "--light"),
        (["pot", "lake", "--fit-only"], "--fit-only"),
        (["pot", "lake", "--mask", "labels.png"], "--mask"),
        (["two.toml", "--linear"], "--linear"),
        (["two.toml", "pot"], "one TOML file"),
        (["pot", "lake", "--method", "eq9"], "--method"),
    ],
)
def test_options_that_cannot_hold_for_all_are_refused(
    user: Path, arguments: list[str], told: str
) -> None:
    done = run_malus("capture", *arguments, "--out", "out")
    assert done.returncode == 2
    assert told in one_line(done.stderr)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('[[capture]]\nfolder = "a"\nmask = "m.png"\nlabels = "l.png"', "not both"),
        ('[[capture]]\nfolder = "a/x"\n[[capture]]\nfolder = "b/x"', "different names"),
        ('[[capture]]\nfolder = "a"\nsens = "clockwise"', "sens"),
        ('[[capture]]\nfolder = "a"\nbayer = "rgbg"', "bayer"),
        ("name = 3", "name"),
        ('name = "none"', "capture"),
        ("[[capture", "TOML"),
    ],
)
def test_bad_files_are_told_in_one_line(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError) as mistake:
        malus.load_captures(path)
    assert told in str(mistake.value)
    assert "\n" not in str(mistake.value)


def soft_edges(path: Path) -> None:
    codes = np.random.default_rng(0).integers(0, 2**16, (SIDE, SIDE)).astype(np.uint16)
    PIL.Image.fromarray(codes).save(path)


def too_small(path: Path) -> None:
    PIL.Image.fromarray(np.ones((4, 4), np.uint8)).save(path)


def nothing_on_it(path: Path) -> None:
    PIL.Image.fromarray(np.zeros((SIDE, SIDE), np.uint8)).save(path)


@pytest.mark.parametrize("spoil", [soft_edges, too_small, nothing_on_it])
def test_bad_labels_cost_their_capture(user: Path, spoil: Callable[[Path], None]) -> None:
    spoil(user / "labels.png")
    results = malus.run_captures("two.toml", "out", report=False)
    (failure,) = results.run["failures"]
    assert failure.startswith("pot: ")
    assert "labels.png" in failure
    assert set(results.table.surface) == {"lake"}


def test_the_gate_guards_captures(user: Path) -> None:
    methods = ["of_tests:half"]
    first = malus.run_captures("two.toml", "out", methods=methods, report=False)
    baseline = malus.update_baseline(first, "base.toml").baseline
    assert {value.metric for value in baseline.values} == {"gain", "rotation", "skill"}
    again = malus.run_captures("two.toml", "again", methods=methods, report=False)
    assert malus.gate(again, "base.toml").passed
    worse = first.table.copy()
    worse.loc[(worse.metric == "skill") & (worse.method == "half"), "value"] -= 0.02
    assert not malus.gate(malus.Results(worse, first.run), "base.toml").passed
    others = malus.run_captures(["pot"], "others", methods=methods, report=False)
    with pytest.raises(InputError, match="scenes"):
        malus.gate(others, "base.toml")


def test_a_folder_of_something_else_stays_as_it_is(user: Path) -> None:
    (user / "out").mkdir()
    (user / "out" / "plan.json").write_text("{}", "utf-8")
    with pytest.raises(InputError, match="a run"):
        malus.run_captures("two.toml", "out", report=False)


def test_captures_of_before_leave_no_pictures(user: Path) -> None:
    malus.run_captures(["pot", "lake"], "out", methods=["unpolarised"], report=False)
    results = malus.run_captures(["lake"], "out", methods=["unpolarised"], report=False)
    kept = {path.stem for path in (user / "out" / "examples").glob("*.npz")}
    assert kept == {capture["scene"] for capture in results.run["captures"]}


def test_ids_follow_what_is_read(user: Path) -> None:
    def scene(**told: object) -> str:
        entry = malus.CaptureEntry.model_validate({"folder": "pot", **told})
        suite = malus.CaptureSuite(capture=(entry,), methods=("unpolarised",))
        return str(malus.run_captures(suite, "out", report=False).run["captures"][0]["scene"])

    first = scene()
    assert scene() == first
    assert scene(group="outdoor") == first
    assert scene(zero="horizontal") != first
    assert scene(labels="labels.png") != first


def test_the_reference_captures_have_outlines(shared: Path, tmp_path: Path) -> None:
    """Label images that were drawn by hand fit the captures beside the checkout."""
    suite = malus.load_captures(Path(__file__).parents[1] / "captures" / "captures.toml")
    small = [entry for entry in suite.capture if entry.called in ("bowl", "car")]
    chosen = suite.model_copy(update={"capture": tuple(small), "methods": ("unpolarised",)})
    results = malus.run_captures(chosen, tmp_path / "out", report=False)
    assert results.run["failures"] == []
    assert [len(capture["objects"]) for capture in results.run["captures"]] == [7, 2]
    asked = json.loads((tmp_path / "out" / "captures.json").read_text("utf-8"))
    assert len(asked["capture"]) == 2
