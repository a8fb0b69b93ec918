"""Method `net` in suites and captures: scored, calibrated, and recorded where it cannot run."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile
from click.testing import CliRunner
from networks import SURE, edges
from scipy.stats import spearmanr

import malus
from malus.bench.commands.capture import capture_command
from malus.bench.running.captures import reconstruct
from malus.bench.scoring.calibration import calibration_values
from malus.bench.scoring.judge import Judge
from malus.reconstruct import Components, Method, get_method
from malus.renderers import render
from malus.reports.tables.captures import agreements
from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere

SCENE = Scene(
    shape=Sphere(),
    surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    light=Distant(incidence_deg=40),
    camera=Camera(resolution=24),
    wavelengths_nm=(450.0, 550.0, 650.0),
)


def values(score: malus.Score) -> dict[str, float]:
    rows = (row for row in score.values() if row.band_nm is None and row.angle_deg is None)
    return {row.metric: row.value for row in rows}


def stating(error: np.ndarray, deviation: np.ndarray) -> Method:
    """A method that errs from the truth of SCENE by `error` of s1/s0, and states `deviation`."""
    truth = render(SCENE, renderer="torrance-sparrow")
    stokes = truth.stokes

    def known(observation: malus.Observation) -> Components:
        light = observation.image
        s1 = stokes[..., 1] + error * stokes[..., 0]
        return Components(light, s1, stokes[..., 2], deviation=deviation)

    return Method("stating", frozenset(), known, "of a test")


def errors(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations that differ over a picture, and normal errors of that size."""
    random = np.random.default_rng(seed)
    deviation = random.uniform(0.01, 0.1, (24, 24, 3))
    return random.normal(0, deviation), deviation


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_calibration_is_the_squared_error_over_the_stated_variance(factor: float) -> None:
    error, deviation = errors(1)
    truth = render(SCENE, renderer="torrance-sparrow")
    score = values(Judge(truth).score(stating(error, deviation / factor)))
    # s2 has no error: half of the squares of a variable of variance 1, over ~400 pixels, 3 bands.
    assert score["calibration"] == pytest.approx(0.5 * factor**2, rel=0.15)


def test_the_rank_is_spearmans_over_lit_pixels() -> None:
    error, deviation = errors(2)
    truth = render(SCENE, renderer="torrance-sparrow")
    image = truth.stokes[..., 0]
    lit = truth.mask[..., None] & (image > 0.01 * image[truth.mask].max())
    score = values(Judge(truth).score(stating(error, deviation)))
    expected = spearmanr(deviation[lit], np.abs(error)[lit]).statistic
    assert score["deviation_rank"] == pytest.approx(expected, abs=1e-3)  # rounding breaks ties
    assert 0.2 < expected < 0.9


def test_one_deviation_for_all_has_no_rank() -> None:
    error, _ = errors(3)
    truth = render(SCENE, renderer="torrance-sparrow")
    score = values(Judge(truth).score(stating(error, np.full(error.shape, 0.05))))
    assert np.isnan(score["deviation_rank"])


def test_a_method_that_states_nothing_has_neither() -> None:
    truth = render(SCENE, renderer="torrance-sparrow")
    assert "calibration" not in values(Judge(truth).score(get_method("eq8")))


def test_noise_of_the_truth_stands_beside_it() -> None:
    image, zero = np.ones((50, 1)), np.zeros((2, 50, 1))
    draw = np.full((2, 50, 1), 0.1)
    rows = list(calibration_values(image, zero, zero, np.full((50, 1), 0.2), draw))
    assert rows[0].noise == pytest.approx(0.25)


def test_noise_counts_over_the_light_as_errors_do() -> None:
    """An estimate that is wrong by the draw has an error of what stands beside it."""
    random = np.random.default_rng(4)
    image, stated = random.uniform(0.5, 4.0, (50, 3)), random.uniform(0.1, 0.3, (50, 3))
    true, draw = random.normal(0, 0.1, (2, 2, 50, 3))
    row = next(iter(calibration_values(image, true, true + draw, stated, draw)))
    assert row.noise == pytest.approx(row.value, rel=1e-12)


def test_a_picture_without_light_has_neither() -> None:
    dark, zero = np.zeros((50, 1)), np.zeros((2, 50, 1))
    assert not list(calibration_values(dark, zero, zero, np.full((50, 1), 0.2)))


@pytest.mark.usefixtures("stand_in_net")
def test_a_suite_scores_it_beside_others(tmp_path: Path) -> None:
    options = {"resolution": 12, "samples": 2, "report": False}
    results = malus.run("quick", tmp_path / "r", methods=["unpolarised", "net"], **options)
    table = results.table
    rows = table[(table.method == "net") & (table.metric == "calibration")]
    assert len(rows) == table.scene.nunique()
    assert (rows.value > 0).all()


def test_without_the_runtime_a_suite_records_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stand_in_net: Path
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    options = {"resolution": 8, "samples": 2, "report": False}
    table = malus.run("quick", tmp_path / "r", methods=["eq8", "net"], **options).table
    rows = table[table.method == "net"]
    assert set(rows.metric) == {"inapplicable"}
    assert rows.note.str.contains(r"pip install 'malus\[net\]'").all()
    assert (table[table.method == "eq8"].metric == "skill").any()


def test_the_suites_that_stand_for_photographs_have_it() -> None:
    for name in ("indoor", "outdoor", "gate"):
        assert "net" in malus.load_suite(name).methods
    assert malus.CaptureSuite.of_folders(["a"]).methods == ("paper", "blind", "net")


def test_the_runtime_is_there_where_tests_run() -> None:
    """Nothing of this file may be skipped in silence: the extra `dev` has the runtime."""
    import onnxruntime

    assert onnxruntime.get_available_providers()


def test_a_capture_says_how_strong_and_how_sure_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    image = np.random.default_rng(0).uniform(0.2, 0.9, (24, 24, 3)).astype(np.float32)
    method = get_method(f"net:{edges(tmp_path / 'n.onnx')}")
    whole = [np.ones((24, 24), bool)]
    told = reconstruct(method, image, whole)
    for angle in (0, 45, 90, 135):  # through a polariser, half as polarised as the network says
        stokes = told.stokes * np.array([1, 0.5, 0.5], np.float32)
        light = malus.scenes.polarisation.polarised(stokes, float(angle))
        tifffile.imwrite(tmp_path / f"pol_{angle:03d}.tif", light, photometric="rgb")
    monkeypatch.chdir(tmp_path)
    suite = malus.CaptureSuite.of_folders([tmp_path], [method.name], linear=True)
    table = malus.run_captures(suite, tmp_path / "out", report=False).table
    rows = table[(table.method == method.name) & table.angle_deg.isna()].set_index("metric").value
    assert rows["gain"] == pytest.approx(2.0, rel=1e-4)
    assert rows["scale"] == pytest.approx(0.5, rel=1e-4)
    assert rows["scaled_skill"] == pytest.approx(1.0, abs=1e-6)
    error = 0.5 * told.stokes[..., 1:] / told.stokes[..., :1]
    expected = np.mean(np.square(error / told.deviation[..., None]))
    assert rows["calibration"] == pytest.approx(expected, rel=1e-3)
    assert isinstance(rows["deviation_rank"], float)
    # A skill of 0 at twice the strength: the sentence tells strength and correlation apart.
    (told,) = agreements(table)
    assert told.endswith("is 2 times the true one (rms), and correlates with it by 1.00.")


def test_a_capture_is_seen_at_the_size_that_is_asked_for(
    tmp_path: Path, stand_in_net: Path
) -> None:
    image = np.random.default_rng(0).uniform(0.2, 0.9, (24, 24, 3)).astype(np.float32)
    for angle in (0, 45, 90, 135):
        name = tmp_path / f"pol_{angle:03d}.tif"
        tifffile.imwrite(name, (0.5 + 0.001 * angle) * image, photometric="rgb")
    arguments = [str(tmp_path), "--linear", "--method", "net", "--net-size", "16"]
    result = CliRunner().invoke(capture_command, arguments)
    assert result.exit_code == 0, result.output
    assert "the network saw 16 x 16 pixels" in result.output
    assert "best gain" in result.output


def test_objects_of_a_capture_keep_their_deviation(tmp_path: Path) -> None:
    method = get_method(f"net:{edges(tmp_path / 'n.onnx')}")
    image = np.full((24, 24, 3), 0.5, np.float32)
    left = np.arange(24)[None, :] * np.ones((24, 1)) < 8
    right = np.arange(24)[None, :] * np.ones((24, 1)) >= 16
    told = reconstruct(method, image, [left, right])
    between = ~(left | right)
    assert not told.deviation[between].any()
    for columns in (slice(2, 6), slice(18, 22)):  # one in each object
        np.testing.assert_allclose(told.deviation[:, columns], sum(SURE), rtol=1e-5)
