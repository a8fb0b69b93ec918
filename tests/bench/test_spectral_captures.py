"""Captures whose channels are bands of a spectrum: their wavelengths reach methods and pages."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from runs import NOBODY, SUITE

import malus
from malus.bench.datasets.export import export
from malus.bench.datasets.render import render_dataset
from malus.bench.running import captures
from malus.bench.running.capture_suite import CaptureSuite
from malus.bench.running.output_folder import CAPTURES
from malus.bench.scoring.capture_metrics import CapturedPixels
from malus.bench.scoring.capture_score import score_capture, write_fit
from malus.reconstruct import Components, Inapplicable, Method, Observation, get_method
from malus.reconstruct.photos import estimate as photo_estimate
from malus.reconstruct.photos.capture import Capture, read_capture
from malus.reconstruct.photos.capture_fit import fit_capture
from malus.reconstruct.photos.knowledge import Knowledge
from malus.renderers.datasets.dataset import open_folder
from malus.reports.viewer.examples import read_examples
from malus.scenes import Camera, polarisation
from malus.scenes.core.result_files import EXAMPLES

THREE, FIVE = (450.0, 550.0, 650.0), (420.0, 480.0, 550.0, 600.0, 680.0)


def shortest(observation: Observation) -> Components:
    """Half of the light of the shortest wavelength is polarised, and no other."""
    if observation.wavelengths_nm is None:
        raise Inapplicable("the bands are not known")
    first = np.argmin(observation.wavelengths_nm)
    s1 = np.zeros_like(observation.image)
    s1[..., first] = 0.5 * observation.image[..., first]
    return Components(observation.image, s1, np.zeros_like(s1))


SHORTEST = replace(get_method("unpolarised"), name="shortest", reconstruct=shortest)
assert isinstance(SHORTEST, Method)


def test_a_deviation_that_one_object_lacks_is_stated_for_none() -> None:
    """A deviation of 0 was said to be stated there, and its calibration was 5e9."""
    image, left = np.ones((2, 4, 3), np.float32), np.zeros((2, 4), bool)
    left[:, :2] = True
    lacking: list[Exception | None] = [None, Inapplicable("dark")]

    def stating(observation: Observation, error: Exception | None) -> Components:
        if observation.mask[0, 0]:
            return Components(image, 0 * image, 0 * image, deviation=0.1 * image)
        if error is not None:
            raise error
        return Components(image, 0 * image, 0 * image)

    untold, refused = (
        captures.reconstruct(
            replace(SHORTEST, reconstruct=lambda o, error=error: stating(o, error)),
            image,
            [left, ~left],
        ).deviation
        for error in lacking
    )
    assert untold is None
    assert refused is not None
    assert refused[0, :, 0].tolist() == [np.float32(0.1), np.float32(0.1), 1.0, 1.0]


def exported(folder: Path, layout: str, bands: tuple[float, ...]) -> Path:
    """The folder of a scene with light of so many bands."""
    suite = SUITE.model_copy(
        update={
            "camera": Camera(resolution=12),
            "wavelengths_nm": bands,
            "materials": SUITE.materials[:1],
        }
    )
    render_dataset(suite, folder / "data", NOBODY)
    dataset = open_folder(folder / "data")
    export(dataset.path, layout, folder / "export")
    return folder / "export" / dataset.scenes[0]


@pytest.mark.parametrize("layout", ["numpy", "polanalyser"])
@pytest.mark.parametrize("bands", [THREE, FIVE])
def test_methods_and_pages_know_the_bands(
    layout: str, bands: tuple[float, ...], tmp_path: Path
) -> None:
    folder = exported(tmp_path, layout, bands)
    assert read_capture(folder).wavelengths_nm == bands
    suite = CaptureSuite.of_folders([folder], [f"{__name__}:SHORTEST"])
    results = malus.run_captures(suite, tmp_path / "results")
    assert not results.run["failures"]
    (example,) = read_examples(tmp_path / "results" / EXAMPLES)
    assert example.wavelengths_nm == bands
    assert example.band_names[0] == f"{bands[0]:g} nm"
    stokes = example.methods["shortest"][example.mask]
    np.testing.assert_array_equal(stokes[:, 0, 1], 0.5 * stokes[:, 0, 0])
    assert stokes[:, 0, 1].any()
    assert not stokes[:, 1:, 1].any()
    page = (tmp_path / "results" / "report.html").read_text("utf-8")
    assert f"{bands[0]:g} nm" in page


def test_a_single_capture_tells_its_bands_and_compares_no_colours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = exported(tmp_path, "numpy", THREE)
    capture, truth = read_capture(folder), open_folder(tmp_path / "data").truth(folder.name)
    seen: list[object] = []
    whole = photo_estimate._of_objects

    def watched(observation: Observation, knowledge: Knowledge) -> object:
        seen.append(observation.wavelengths_nm)
        return whole(observation, knowledge)

    monkeypatch.setattr(photo_estimate, "_of_objects", watched)
    known = Knowledge(truth.normals, truth.mask, eta=1.5, alpha=0.1, mirror=True)
    score = score_capture(capture, knowledge=known)
    assert seen == [THREE]
    assert score["delta_e76"] == score["delta_e76_trivial"] == {}


def test_an_example_tells_how_it_is_thinned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    suite = CaptureSuite.of_folders([exported(tmp_path, "polanalyser", THREE)], ["unpolarised"])
    examples = []
    for side in (256, 4):
        monkeypatch.setattr("malus.bench.running.captures.EXAMPLE_SIDE", side)
        malus.run_captures(suite, tmp_path / "results")
        examples += read_examples(tmp_path / "results" / EXAMPLES)
    whole, thinned = examples
    assert (whole.step, thinned.step) == (1, 3)  # of 12 pixels
    np.testing.assert_array_equal(thinned.truth, whole.truth[::3, ::3])


def test_the_id_of_an_export_is_of_its_files(tmp_path: Path) -> None:
    folder = exported(tmp_path, "polanalyser", THREE)

    def scene() -> str:
        suite = CaptureSuite.of_folders([folder], ["unpolarised"])
        return str(malus.run_captures(suite, tmp_path / "results").table.scene.iloc[0])

    before = scene()
    assert scene() == before
    shutil.copy(folder / "450nm" / "image00002.exr", folder / "450nm" / "image00000.exr")
    assert scene() != before


@pytest.mark.parametrize("sigma", [0.0, 0.004])
def test_without_polarisation_no_skill_is_told(sigma: float, tmp_path: Path) -> None:
    """Four pictures that differ by nothing, or by noise: the guess has no error but that."""
    random = np.random.default_rng(3)
    light = random.uniform(0.2, 0.8, (48, 48, 1))
    pictures = np.repeat(light[None], 4, axis=0) + random.normal(0, sigma, (4, 48, 48, 1))
    np.save(tmp_path / "four.npy", pictures.astype(np.float32))
    suite = CaptureSuite.of_folders(
        [tmp_path / "four.npy"], [f"{__name__}:STRONG"], angles=(0.0, 45.0, 90.0, 135.0)
    )
    table = malus.run_captures(suite, tmp_path / "results").table
    for metric in ("skill", "scaled_skill"):
        assert table[(table.metric == metric) & (table.method == "strong")].value.isna().all()
    of_all = (table.metric == "nmse") & table.angle_deg.isna() & (table.method == "strong")
    assert (table[of_all].value > 0.001).all()
    capture = read_capture(tmp_path / "four.npy", angles=(0, 45, 90, 135))
    tilted = np.tile(np.array([0, np.sin(np.pi / 3), 0.5], np.float32), (48, 48, 1))
    mirror = Knowledge(tilted, eta=1.5, alpha=0.01, mirror=True)
    score = score_capture(capture, knowledge=mirror)
    assert math.isnan(score["skill"])
    write_fit(tmp_path / "fit", fit_capture(capture), {"score": score})
    written = json.loads(
        (tmp_path / "fit" / "capture.json").read_text("utf-8"),
        parse_constant=lambda name: pytest.fail(f"{name} is no JSON"),
    )
    assert written["score"]["skill"] is None


def strong(observation: Observation) -> Components:
    """Half of all light is polarised."""
    image = observation.image
    return Components(image, 0.5 * image, np.zeros_like(image))


STRONG = replace(get_method("unpolarised"), name="strong", reconstruct=strong)


def test_a_run_that_fails_leaves_the_record_of_older_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = exported(tmp_path, "numpy", THREE)
    suite = CaptureSuite.of_folders([folder], ["unpolarised"])
    malus.run_captures(suite, tmp_path / "results")
    before = (tmp_path / "results" / CAPTURES).read_text("utf-8")
    other = CaptureSuite.of_folders([folder], ["unpolarised"], name="another")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(captures, "write_results", full)
    for out, is_older in ((tmp_path / "results", True), (tmp_path / "new", False)):
        with pytest.raises(OSError, match="No space"):
            malus.run_captures(other, out)
        assert ((out / CAPTURES).read_text("utf-8") == before) == is_older


def test_an_object_has_the_noise_of_its_own_pixels() -> None:
    """A dim one beside a bright and noisy one: as when it is alone."""
    random = np.random.default_rng(5)
    stokes = np.zeros((40, 40, 1, 3))
    stokes[:, :20, :, 0] = 1.0
    stokes[:, 20:] = np.array([0.06, 0.018, 0.0])
    angles = (0.0, 45.0, 90.0, 135.0)
    pictures = np.stack([polarisation.polarised(stokes, angle) for angle in angles])
    pictures[:, :, :20] += random.normal(0, 0.02, (4, 40, 20, 1))
    clipped, right = np.zeros((40, 40), bool), np.arange(40)[None] >= 20
    capture = Capture(pictures.astype(np.float32), angles, clipped, tuple("abcd"), "linear")
    fit = fit_capture(capture)
    both = CapturedPixels.of(capture, fit, ~clipped)
    mask = np.broadcast_to(right, clipped.shape)
    part, alone = both.part(mask[~clipped]), CapturedPixels.of(capture, fit, mask)
    estimate = part.stokes * np.array([1.0, 0.95, 0.95])
    nmse, skill = part.errors(estimate)
    assert skill == pytest.approx(1 - 0.05**2, abs=1e-3)  # its pictures are of single precision
    # The same numbers over another peak: rounded differently in double precision.
    assert skill == pytest.approx(alone.errors(alone.stokes * [1.0, 0.95, 0.95])[1], rel=1e-6)
    assert nmse > 0
    # Its pictures have single precision alone; the left half's would have 800 times 0.02².
    assert part.noise.moments.max() < 1e-9
    assert both.noise.moments.max() > 0.1
