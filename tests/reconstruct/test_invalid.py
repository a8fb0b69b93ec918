"""Pixels with inputs that are no physical values are flagged, counted and told, never repaired."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from pictures import dome

from malus.bench.commands.score import score_command
from malus.bench.scoring.judge import Judge
from malus.reconstruct import get_method
from malus.reconstruct.photos.estimate import estimate
from malus.reconstruct.photos.knowledge import Knowledge
from malus.renderers import render
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.scenes import Camera, Dielectric, Distant, InputError, Sampling, Scene, Sphere, Torus

SCENE = Scene(
    shape=Sphere(),
    surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    light=Distant(incidence_deg=60),
    camera=Camera(resolution=12),
)


def test_a_score_counts_invalid_pixels_of_the_object() -> None:
    truth = render(SCENE, renderer="torrance-sparrow")
    assert truth.mask[6, 6]
    assert not truth.mask[0, 0]
    normals = truth.normals.copy()
    normals[6, 6], normals[0, 0] = np.nan, 7.0
    score = Judge(replace(truth, normals=normals)).score(get_method("eq8"))
    assert score.invalid == 1
    rows = {value.metric: value.value for value in score.values()}
    assert rows["invalid"] == 1.0
    assert Judge(truth).score(get_method("eq8")).invalid == 0


def test_an_object_that_covers_no_pixel_has_no_score() -> None:
    """NaN would be worse than a word; the camera sees the hole of a torus here."""
    ring = SCENE.model_copy(update={"shape": Torus(major=0.9, minor=0.02, tilt_deg=0)})
    truth = render(ring, Sampling(samples=2))
    assert not truth.mask.any()
    with pytest.raises(InputError, match="torus: expected an object that covers a pixel"):
        Judge(truth)


@pytest.mark.parametrize("light", [None, (1.0, 1.0, 2.0)])
def test_an_ordinary_picture_is_told_about_in_one_line(
    light: tuple[float, float, float] | None,
) -> None:
    image, normals = dome()
    good = estimate(image, Knowledge(normals=normals, light=light), "dome")
    assert not [warning for warning in good.warnings if "without valid" in warning]
    spoilt = normals.copy()
    spoilt[tuple(np.argwhere(normals[..., 2] > 0.9)[0])] = 0.0, 0.0, 2.0
    told = estimate(image, Knowledge(normals=spoilt, light=light), "dome").warnings
    expected = "1 pixel of the object without valid intensity or normal: not polarised"
    assert [warning for warning in told if "without valid" in warning] == [expected]


@pytest.mark.parametrize("spoilt", [False, True])
def test_the_score_command_tells_of_invalid_pixels(tmp_path: Path, spoilt: bool) -> None:
    truth = render(SCENE, renderer="torrance-sparrow")
    normals = truth.normals.copy()
    if spoilt:
        normals[6, 5:7] = 0.0
    with DatasetWriter(tmp_path / "data") as writer:
        writer.add(replace(truth, normals=normals))
    arguments = [str(tmp_path / "data"), "--method", "eq8", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(score_command, arguments, catch_exceptions=False)
    assert done.exit_code == 0
    assert ("2 pixels with invalid inputs" in done.output) == spoilt
