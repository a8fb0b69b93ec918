"""Pixels of the viewer: which one it opens at, its place in a capture, and what is not finite."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from browser import Browser
from viewed_scenes import disc, stokes_image

from malus.reports import write_report
from malus.reports.tables import sample
from malus.reports.viewer.error_maps import error_maps
from malus.reports.viewer.examples import Example, read_example

STEP = 3
BRIGHTEST, NAN, NEGATIVE, DARK = (30, 12), (20, 15), (22, 15), (25, 14)  # rows and columns
TURNED = "pot\u202e"
MAGENTA = [255, 0, 255]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of a capture: every third pixel, and two pixels of an estimate that are no light."""
    folder = tmp_path_factory.mktemp("pixels")
    table = sample.captured()
    scene = table["scene"].iloc[0]
    truth = np.repeat(stokes_image(1)[:, :, :1], 3, axis=2)
    truth[BRIGHTEST] *= 2 / truth[BRIGHTEST][0, 0]
    truth[DARK] = 0
    estimate = 0.9 * truth
    estimate[NAN], estimate[NEGATIVE] = np.nan, -truth[NEGATIVE]
    meta = {"scene": scene, "label": TURNED, "channels": ["red", "green", "blue"], "step": STEP}
    (folder / "examples").mkdir()
    np.savez(folder / "examples" / f"{scene}.npz", truth=truth, mask=disc(),
             meta=np.array(json.dumps(meta)), **{"method.eq8": estimate})  # fmt: skip
    write_report(SimpleNamespace(table=table, run=sample.run_of_captures()), folder)
    return folder / "report.html"


@pytest.fixture
def viewer(browser: Browser, page: Path) -> Browser:
    browser.open(page)
    return browser


def place(viewer: Browser) -> list[int]:
    """Row and column of the pixel that is read out."""
    text = viewer.js("return document.querySelector('#readout .place').textContent")
    column, row = re.findall(r"\d+", text)
    return [int(row), int(column)]


def test_the_viewer_opens_at_the_brightest_pixel_in_places_of_the_capture(viewer: Browser) -> None:
    assert place(viewer) == [STEP * BRIGHTEST[0], STEP * BRIGHTEST[1]]


def move_to(viewer: Browser, row: int, column: int) -> list[str]:
    """Read out a pixel: cells of the estimate."""
    from selenium.webdriver.common.keys import Keys

    canvas, (now_row, now_column) = "[data-panel=truth] canvas", place(viewer)
    down, right = row - now_row // STEP, column - now_column // STEP
    vertical = Keys.ARROW_DOWN if down > 0 else Keys.ARROW_UP
    horizontal = Keys.ARROW_RIGHT if right > 0 else Keys.ARROW_LEFT
    keys = [vertical] * abs(down) + [horizontal] * abs(right)
    viewer.keys(canvas, *(Keys.SHIFT + key for key in keys))
    assert place(viewer) == [STEP * row, STEP * column]
    rows = "[...document.querySelectorAll('#readout tbody tr')]"
    cells: list[str] = viewer.js(f"return {rows}.map(r => r.querySelectorAll('td')[1].textContent)")
    return cells


def test_what_is_no_light_is_shown_as_not_finite(viewer: Browser) -> None:
    for panel in ("estimate", "dolp-estimate", "aolp-estimate"):
        assert viewer.rgb(panel)[NAN].tolist() == MAGENTA, panel
    for panel in ("dolp-estimate", "aolp-estimate"):  # a radiance below zero is black
        assert viewer.rgb(panel)[NEGATIVE].tolist() == MAGENTA, panel
    assert move_to(viewer, *NAN) == ["not finite"] * 6
    assert move_to(viewer, *NEGATIVE)[4] == "not finite"


def test_the_page_says_that_channels_are_primaries(page: Path, coloured: Path) -> None:
    assert "In colour, channels are taken for the primaries of sRGB" in page.read_text("utf-8")
    assert "CIE 1931" not in page.read_text("utf-8")
    assert "In colour, all bands are seen through the CIE 1931" in coloured.read_text("utf-8")


def test_names_turn_no_text_around(viewer: Browser) -> None:
    option = viewer.js("return document.querySelector('#scene option').textContent")
    assert option == r"pot\u202e"
    assert "\u202e" not in viewer.js("return document.body.textContent")


def test_a_pixel_without_light_has_an_axis_that_can_be_read(viewer: Browser) -> None:
    """Both sinusoids are zero: numbers beside the axis were too long for their place."""
    assert move_to(viewer, *DARK)[4] == "0.00 %"
    ends = "['.least', '.most'].map(name => document.querySelector(name).textContent)"
    assert viewer.js(f"return {ends}") == ["-1", "1"]


def test_error_maps_count_pixels_that_are_not_finite(page: Path) -> None:
    (example,) = (read_example(path) for path in (page.parent / "examples").iterdir())
    assert isinstance(example, Example)
    assert all(error.spread.endswith(", 1 pixel not finite") for error in error_maps(example))
    assert "1 pixel not finite" in page.read_text("utf-8")
