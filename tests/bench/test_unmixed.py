"""Scores without the pixels that see more than one normal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up import made_up_truth
from runs import run_malus

from malus.bench.scoring.family_scores import FamilyJudge, FamilyPixels
from malus.bench.scoring.judge import Judge, Score
from malus.bench.scoring.observe import observe
from malus.bench.scoring.unmixed_pixels import MOST_SPREAD_DEG, mixed_pixels
from malus.reconstruct import get_method
from malus.reconstruct.observation import INPUTS
from malus.renderers import Truth
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.families.family import render_family
from malus.renderers.families.interpolated import Family
from malus.scenes import Blob, Camera, Dielectric, MeshFile, Sampling, Scene, Shape, Uniform

METHODS = ("unpolarised", "eq8", "shadowed+body")


def wedge(folder: Path) -> MeshFile:
    """A box seen at an angle, whose edges are sharp."""
    import trimesh

    box = trimesh.creation.box((1, 1, 1))
    box.apply_transform(trimesh.transformations.euler_matrix(0.6, 0.7, 0.2))
    box.export(folder / "box.stl")
    return MeshFile(path=str(folder / "box.stl"))


def rendered(shape: Shape, resolution: int = 24) -> tuple[Family, tuple[Scene, ...]]:
    scenes = tuple(
        Scene(
            shape=shape,
            surface=Dielectric(eta=eta, alpha=0.2, body="polarised"),
            light=Uniform(),
            camera=Camera(resolution=resolution),
            wavelengths_nm=(450.0, 650.0),
        )
        for eta in (1.4, 1.5, 1.6)
    )
    family = render_family(scenes, Sampling(samples=32))
    assert isinstance(family, Family)
    return family, scenes


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> tuple[Family, tuple[Scene, ...]]:
    return rendered(wedge(tmp_path_factory.mktemp("box")))


def values(score: Score) -> dict[str, float]:
    return {v.metric: v.value for v in score.values() if v.band_nm is None and v.angle_deg is None}


@pytest.mark.parametrize("method", METHODS)
def test_it_is_the_skill_of_a_truth_of_those_pixels(
    box: tuple[Family, tuple[Scene, ...]], method: str
) -> None:
    family, scenes = box
    truth = family.truth(scenes[1])
    assert truth.normal_spread is not None
    kept = truth.mask & (truth.normal_spread <= MOST_SPREAD_DEG)
    found = Judge(truth).score(get_method(method))
    alone = Judge(replace(truth, mask=kept)).score(get_method(method))
    # Sums over all less those over the mixed ones: float64, cancelling at most four digits here.
    assert found.skill_unmixed == pytest.approx(alone.skill, rel=1e-10, abs=1e-10)
    numbers = values(found)
    assert numbers["skill_unmixed"] == found.skill_unmixed
    assert numbers["mixed"] == truth.mask.sum() - kept.sum() > 10
    if method == "shadowed+body":  # right physics: what is wrong is the normal at edges
        assert found.skill < 0.99 < found.skill_unmixed


@pytest.mark.parametrize("method", METHODS)
def test_scenes_side_by_side_score_alike(
    box: tuple[Family, tuple[Scene, ...]], method: str
) -> None:
    family, scenes = box
    pixels = FamilyPixels.of(family, scenes, family.truth(scenes[0], False))
    together = FamilyJudge(pixels).scores(pixels.estimate(get_method(method)))
    for scene, score in zip(scenes, together, strict=True):
        alone = Judge(family.truth(scene)).score(get_method(method))
        assert score.unmixed is not None
        assert alone.unmixed is not None
        assert score.unmixed.mixed == alone.unmixed.mixed
        # Interpolation adds float32 numbers in another order, see test_family_scores.
        assert score.skill_unmixed == pytest.approx(alone.skill_unmixed, rel=1e-4, abs=1e-6)


def test_without_a_mixed_pixel_it_is_the_skill_to_the_bit() -> None:
    family, scenes = rendered(Blob(), resolution=64)
    truth = family.truth(scenes[0], False)
    score = Judge(truth).score(get_method("eq8"))
    numbers = values(score)
    assert numbers["mixed"] == 0
    assert numbers["skill_unmixed"] == numbers["skill"]


def test_pixels_that_are_all_mixed_have_no_skill(box: tuple[Family, tuple[Scene, ...]]) -> None:
    family, scenes = box
    truth = family.truth(scenes[0], False)
    assert truth.normal_spread is not None
    only = replace(truth, mask=truth.mask & (truth.normal_spread > MOST_SPREAD_DEG))
    assert np.isnan(Judge(only).score(get_method("eq8")).skill_unmixed)


def test_methods_are_not_told(box: tuple[Family, tuple[Scene, ...]]) -> None:
    family, scenes = box
    told = vars(observe(family.truth(scenes[0], False), INPUTS))
    assert not [name for name in told if "spread" in name or "mixed" in name]


def stored(folder: Path, truth: Truth) -> Path:
    with DatasetWriter(folder / "dataset") as writer:
        writer.add(truth)
    return folder / "dataset"


def test_older_datasets_are_scored_without_it_and_told(
    tmp_path: Path, box: tuple[Family, tuple[Scene, ...]]
) -> None:
    family, scenes = box
    truth = family.truth(scenes[0], False)
    for number, one in enumerate((truth, replace(truth, normal_spread=None))):
        folder = tmp_path / str(number)
        folder.mkdir()
        out = str(folder / "out")
        told = run_malus("score", str(stored(folder, one)), "--method", "eq8", "--out", out)
        assert told.returncode == 0
        table = (folder / "out" / "results.csv").read_text()
        assert ("skill_unmixed" in table) == (number == 0)
        assert ("1 of 1 scenes do not tell" in told.stderr) == (number == 1)


def test_a_pixel_is_mixed_beyond_the_spread_that_is_documented() -> None:
    """Files.md: a spread of up to 5° is that of one normal."""
    truth = made_up_truth()
    for spread, mixed in ((5.0, 0), (5.1, truth.mask.sum())):
        told = mixed_pixels(replace(truth, normal_spread=np.full(truth.mask.shape, spread)))
        assert told is not None
        assert told.sum() == mixed
