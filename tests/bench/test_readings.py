"""Readings of the paper's "normalised": against images that are scaled one by one, and by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from malus.bench.scoring.image_sums import image_sums
from malus.bench.scoring.judge import Judge
from malus.bench.scoring.readings import LIKELIEST, READINGS, DatasetSums
from malus.bench.studies import paper_readings as study
from malus.bench.studies import separation
from malus.bench.studies.registry import run_study
from malus.reconstruct import get_method
from malus.renderers import render
from malus.renderers.variant import choose
from malus.reports.tables.readings import by_dataset, reading_cells, verdicts
from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere, Uniform
from malus.scenes.polarisation import PAPER_ANGLES_DEG, polarised

RNG = np.random.default_rng(0)


def objects() -> list[tuple[np.ndarray, np.ndarray]]:
    """Stokes vectors (pixels, bands, 3), estimated and true, of three objects of other sizes."""
    made = []
    for pixels, bright in ((40, 1.0), (25, 3.0), (60, 0.2)):
        true = RNG.random((pixels, 2, 3)) * [bright, 0.3 * bright, 0.3 * bright]
        estimate = true + [0, 0.05, -0.03] * RNG.random((pixels, 2, 3)) * bright
        made.append((estimate, true))
    return made


def scaled_one_by_one(name: str, pairs: list[tuple[np.ndarray, np.ndarray]]) -> list[float]:
    """The reading by the letter: every image is made, scaled and compared."""
    measure, scope, _ = READINGS[name]
    images = [[[polarised(s, a) for a in PAPER_ANGLES_DEG] for s in pair] for pair in pairs]
    unpolarised = [true[..., 0] for _, true in pairs]
    errors = []
    for own, whole in zip(images, unpolarised, strict=True):
        square = 0.0
        for k in range(len(PAPER_ANGLES_DEG)):
            both = []
            for side in (0, 1):
                image, low, size = own[side][k], 0.0, 1.0
                around = {
                    "image": [image],
                    "object": own[side],
                    "dataset": [i for one in images for i in one[side]],
                }[scope]
                if measure == "range":
                    low = min(i.min() for i in around)
                    size = max(i.max() for i in around) - low
                elif measure == "energy":
                    size = np.sqrt(np.mean(own[1][k] ** 2))
                else:
                    pick = np.max if measure == "peak" else np.mean
                    of = {"image": image, "object": whole,
                          "dataset": np.concatenate([u.ravel() for u in unpolarised])}  # fmt: skip
                    size = pick(of[scope])
                both.append((image - low) / size)
            square += np.mean((both[0] - both[1]) ** 2) / len(PAPER_ANGLES_DEG)
        errors.append(square)
    return errors


def sums_of(pairs: list[tuple[np.ndarray, np.ndarray]]) -> DatasetSums:
    planes = [[tuple(s[..., k] for k in range(3)) for s in pair] for pair in pairs]
    sums = np.stack([image_sums(*pair)[0] for pair in planes])
    whole = [true[..., 0] for _, true in pairs]
    counts, peaks, means = ([f(u) for u in whole] for f in (np.size, np.max, np.mean))
    return DatasetSums(sums, *map(np.array, (counts, peaks, means)))


@pytest.mark.parametrize("name", READINGS)
def test_readings_are_those_of_images_scaled_one_by_one(name: str) -> None:
    pairs = objects()
    # Sums of squares of values of order one that cancel to errors of 1e-3: 1e-13 of them remains.
    expected = pytest.approx(scaled_one_by_one(name, pairs), rel=1e-9)
    assert sums_of(pairs).errors(name).tolist() == expected


def test_scenes_side_by_side_have_the_sums_that_they_have_alone() -> None:
    (estimate, true), *_ = objects()
    planes = [tuple(s[..., k] for k in range(3)) for s in (estimate, true)]
    alone = [image_sums(*[tuple(p[:, b : b + 1] for p in s) for s in planes])[0] for b in (0, 1)]
    np.testing.assert_allclose(image_sums(*planes, scenes=2), alone, rtol=1e-14)


def scene(light: Distant | Uniform, albedo: float) -> Scene:
    return Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.35, albedo=albedo, body="unpolarised"),
        light=light,
        camera=Camera(resolution=24),
    )


def test_a_score_has_the_likeliest_reading() -> None:
    truth = render(scene(Distant(incidence_deg=60), 0.1), renderer="torrance-sparrow")
    score = Judge(truth).score(get_method("eq8"))
    from malus.bench.scoring.observe import observe
    from malus.reconstruct.observation import INPUTS

    estimate = get_method("eq8").reconstruct(observe(truth, INPUTS)).stokes[truth.mask]
    (expected,) = scaled_one_by_one(LIKELIEST, [(estimate, truth.stokes[truth.mask])])
    assert score.own_range == pytest.approx(expected, rel=1e-6)
    (row,) = (v for v in score.values() if v.metric == "nmse_own_range")
    assert row.value == score.own_range
    assert np.isnan(row.noise)  # not measured, which is not none


def test_images_of_one_lamp_and_no_body_are_alike_in_their_own_range() -> None:
    """All facets polarise alike: the guess that knows nothing is perfect in this reading."""
    truth = render(scene(Distant(incidence_deg=60), 0.0), renderer="torrance-sparrow")
    assert Judge(truth).score(get_method("unpolarised")).own_range < 1e-14


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "LIGHTS", (Uniform(), Distant(incidence_deg=60)))
    monkeypatch.setattr(study, "ALBEDOS", (0.1,))
    monkeypatch.setattr(study, "SAMPLES", 4)
    monkeypatch.setattr(study, "CHAIN_EVERY", 5)


def test_the_study_scores_what_it_says(small: None) -> None:
    table = study.paper_readings(choose(), every=24, resolution=16)
    assert set(table["reading"]) == {reading.title for reading in READINGS.values()}
    ours = table[table["reading"] == READINGS["peak"].title]
    eq8 = ours[(ours["method"] == "eq8") & (ours["light"] == "distant 60°")]
    assert sorted(eq8["panel"].value_counts().items()) == [("all", 1), ("alpha", 5), ("eta", 1)]
    (rust,) = eq8.loc[eq8["name"] == "rust", "mean"]
    made_of = Dielectric.named("water", "rust", "unpolarised")
    named = next(name for name in eq8["name"] if name not in ("all",))
    made_of = Dielectric.named(named, "rust", "unpolarised").model_copy(update={"albedo": 0.1})
    known = scene(Distant(incidence_deg=60), 0.1).model_copy(
        update={"surface": made_of, "camera": Camera(resolution=16)}
    )
    known = known.model_copy(update={"wavelengths_nm": study.BANDS_NM})
    truth = render(known, renderer="torrance-sparrow")
    # Whole pictures here, the mask's pixels there: roundings of their sums.
    assert rust == pytest.approx(Judge(truth).score(get_method("eq8")).nmse, rel=1e-6)
    chain = ours[(ours["method"] == "paper") & (ours["panel"] == "all")]
    assert chain["objects"].sum() + chain["failed"].sum() == 2


def test_the_study_writes_its_page(small: None, tmp_path: Path) -> None:
    findings = run_study("paper", tmp_path / "paper", every=24, resolution=12)
    assert findings.passed
    assert findings.lines[0].startswith("The paper: 4e-3 … 6e-3 over the index")
    page = (tmp_path / "paper" / "report.html").read_text("utf-8")
    assert "each image to [0, 1] by its own range" in page
    assert {"readings.csv", "readings.svg", "run.json"} <= {
        path.name for path in (tmp_path / "paper").iterdir()
    }


def made_up(by_index: tuple[float, ...], by_roughness: tuple[float, ...]) -> pd.DataFrame:
    panels = {"eta": by_index, "alpha": by_roughness, "all": (float(np.mean(by_index)),)}
    rows = [
        ("a reading", "uniform", 0.3, "eq8", panel, str(x), float(x), mean, 0.0, 1, 0)
        for panel, means in panels.items()
        for x, mean in enumerate(means)
    ]
    rows.append(("a reading", "uniform", 0.3, "unpolarised", "all", "", 0.0, 0.02, 0.0, 1, 0))
    columns = ["reading", "light", "albedo", "method", *study._COLUMNS]
    return pd.DataFrame(rows, columns=columns)


@pytest.mark.parametrize(
    ("by_index", "by_roughness", "expected"),
    [
        ((4e-3, 6e-3), (4.1e-3, 5.9e-3), (True, True, True)),
        ((4e-3, 6.1e-3), (4.1e-3, 5.9e-3), (True, False, True)),
        ((4e-3, 6e-3), (2e-3, 8e-3), (True, True, False)),
        ((1e-3, 1.2e-3), (1e-3, 1.2e-3), (False, True, True)),
    ],
)
def test_height_and_flatness(
    by_index: tuple[float, ...], by_roughness: tuple[float, ...], expected: tuple[bool, ...]
) -> None:
    datasets = by_dataset(made_up(by_index, by_roughness))
    (row,) = datasets[["height", "flat_eta", "flat_alpha"]].values.tolist()
    assert tuple(row) == expected
    (line,) = reading_cells(datasets).lines
    assert line[6] == "2.0e-2"  # the guess
    said = " ".join(verdicts(datasets))
    assert ("Reached: a reading, uniform, albedo 0.3" in said) == all(expected)
    assert "whole chain is in the range in 0." in said  # it was not run here
    assert ("where eq8 beats the guess" in said) == expected[1]
    assert ("Nearest: a reading" in said) == (expected == (True, True, False))


def test_the_study_of_separations_scores_the_exact_lobes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    everything = separation.photo_scenes
    monkeypatch.setattr(separation, "photo_scenes", lambda *a, **k: everything(*a, **k)[:3])
    findings = run_study("separation", tmp_path / "s", every=24, resolution=24)
    assert findings.lines[0].startswith("chromaticity: median (worst), suv")
    table = pd.read_csv(tmp_path / "s" / "separation.csv")
    assert len(table) == 9
    # The lobes of single_image.md: medians of 0.7 to 1.1 %, at worst a tenth.
    assert table["rmse"].between(1e-4, 0.1).all()
    assert "Separation of the lobes" in (tmp_path / "s" / "report.html").read_text("utf-8")
