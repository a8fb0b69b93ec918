"""The gallery: its pictures are made, and show what their captions say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from malus.bench.documents.gallery import (
    METHOD,
    SHEETS,
    filter_tiles,
    gallery,
    photo_tiles,
    suite_of,
)
from malus.bench.scoring.judge import Judge
from malus.reconstruct import get_method
from malus.renderers import Truth, render
from malus.reports.figures import stokes_pictures as pictures
from malus.scenes.core.arrays import FloatArray

BANDS = (450.0, 550.0, 650.0)


def decoded(codes: FloatArray) -> FloatArray:
    """Linear light of 8-bit sRGB codes (IEC 61966-2-1)."""
    code = codes / 255
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


@pytest.fixture(scope="module")
def still_life() -> Truth:
    """The scene of the photo, tiny: noise does not matter here."""
    suite = suite_of("photo", 0.1)
    return render(next(suite.scenes()), suite.sampling)


def test_crossed_polarisers_share_the_light_of_the_photo(still_life: Truth) -> None:
    """I(0°) + I(90°) = s0, so that the mean of both exposed pictures is the ordinary one."""
    seen, upright, across, *_ = (decoded(tile.pictures[0]) for tile in photo_tiles(still_life))
    mean = (upright + across) / 2
    three = np.stack([seen, upright, across])
    inside = (three.max(axis=0) < 1) & (three.min(axis=0) > 0)  # neither is clipped
    # Codes are rounded by half: 0.5/255 at a slope of the curve of 2.4 at most.
    assert np.abs(mean - seen)[inside].max() < 0.5 / 255 * 2.4 * 2
    # Light that vibrates level, of positive s1, passes a polariser at 90° from the vertical.
    assert [tile.caption[-3:] for tile in photo_tiles(still_life)[1:3]] == [" 0°", "90°"]
    assert (np.abs(upright - across)[inside] > 0.05).any()  # the polariser matters
    s1 = still_life.stokes[..., 1].mean(axis=-1)
    assert ((across - upright).mean(axis=-1) * s1).sum() > 0


def test_the_photo_says_the_skill_of_its_estimate(still_life: Truth) -> None:
    tiles = photo_tiles(still_life)
    truth, estimate = (tile.pictures[0].astype(int) for tile in tiles[-2:])
    skill = Judge(still_life).score(get_method(METHOD)).skill
    assert skill > 0.1
    assert f"skill {skill:.2f}" in tiles[-1].caption
    assert np.abs(truth - estimate)[still_life.mask].mean() < 60
    grey = estimate[~still_life.mask][0]
    assert np.abs(estimate - grey)[still_life.mask].max() > 60  # it finds something
    off = ~still_life.mask
    # Zero has one colour, that of an unpolarised light.
    assert len(np.unique(estimate[off], axis=0)) == 1
    assert tiles[-2].most == tiles[-1].most


def test_degree_and_angle_have_the_colours_of_their_legends() -> None:
    angles = np.radians(np.arange(0, 180, 15))
    degrees = np.linspace(0, 1, len(angles))
    stokes = np.ones((1, len(angles), 3, 3))
    stokes[..., 1] = (degrees * np.cos(2 * angles))[:, None]
    stokes[..., 2] = (degrees * np.sin(2 * angles))[:, None]
    bar = pictures.degree_bar(1001, 1)[0]
    wanted = bar[np.rint(1000 * degrees).astype(int)]
    assert np.abs(pictures.degree(stokes, BANDS, 1.0)[0].astype(int) - wanted).max() <= 3
    wheel = pictures.angle_wheel(201, 255)
    rim = np.rint(100 + 80 * np.stack([-np.sin(angles), np.cos(angles)], -1)).astype(int)
    shown = pictures.angle(stokes, BANDS)[0].astype(int)
    assert (shown[0] == 128).all()  # not polarised
    # A pixel of the wheel's rim is 0.4° wide, and neighbours of the table differ by a few codes.
    assert np.abs(shown[1:] - wheel[rim[1:, 0], rim[1:, 1]]).max() <= 12


def test_filter_is_told_the_mask_alone() -> None:
    suite = suite_of("filter", 0.12)
    truth = render(next(suite.scenes()), suite.sampling)
    before, after, *_, wanted = filter_tiles(truth)
    assert before.pictures[0].shape == after.pictures[0].shape == wanted.pictures[0].shape
    changed = filter_tiles(replace(truth, normals=-truth.normals))
    np.testing.assert_array_equal(changed[1].pictures[0], after.pictures[0])
    seen = before.pictures[0][truth.mask].mean()
    # Twice the least light is the photograph where nothing is polarised, and less elsewhere.
    assert all(tile.pictures[0][truth.mask].mean() < seen for tile in (after, wanted))


@pytest.mark.parametrize("name", SHEETS)
def test_every_sheet_tells_its_scenes_apart(name: str) -> None:
    contents = SHEETS[name]
    scenes = [scene for suite in contents.suites for scene in suite_of(suite).scenes()]
    captions = [contents.caption(scene) for scene in scenes]
    if name != "rooms":  # of which one is shown
        assert len(set(captions)) == len(captions)
    else:
        assert all(
            scene.surroundings and scene.surroundings.name in caption
            for scene, caption in zip(scenes, captions, strict=True)
        )


def test_gallery_writes_what_is_asked_for(tmp_path: Path) -> None:
    written = gallery(tmp_path, ["bodies"], 0.1)
    assert [path.name for path in written] == ["bodies.jpg"]
    with Image.open(written[0]) as sheet:
        # Gaps of 8; each tile has two pictures of 160², a caption below, and a legend.
        columns = (sheet.width - 8) / (2 * 160 + 8)
        assert columns == 3
        below = np.asarray(sheet.convert("L"))[8 + 160 + 4 :, 8:320]
        assert below[:12].min() < 100  # letters of the caption
        assert np.ptp(np.asarray(sheet.convert("HSV"))[8 + 160 + 4 :, 8:320, 1]) > 60  # the bar
        assert len(sheet.getcolors(1 << 20) or ()) > 100
