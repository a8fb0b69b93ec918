"""The viewer of a page, in a real browser: it computes Equation 1, and keys and fingers move it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from browser import Browser
from viewed_scenes import SIZE, coloured_stokes, disc, mixed_part, stokes_image

from malus.scenes.core.arrays import AnyArray, BoolArray, Float64Array
from malus.scenes.polarisation import polarised


def screen_grey(radiance: AnyArray, white: float) -> Float64Array:
    """What a screen shows of a radiance: 1024 steps of the sRGB curve, as in the IEC standard."""
    linear = np.clip(np.floor(radiance / white * 1023 + 0.5), 0, 1023) / 1023
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.rint(255 * curve)


@pytest.mark.parametrize("angle", [0, 17.5, 45, 90, 133.3, 180])
@pytest.mark.parametrize(("panel", "seed"), [("truth", 1), ("estimate", 2)])
def test_slider_changes_pixels_as_equation_1_says(
    opened: Browser, angle: float, panel: str, seed: int
) -> None:
    opened.choose("method", "eq8")
    opened.choose("band", "0")
    opened.turn(angle)
    white = float(opened.js("return document.getElementById('viewer').dataset.white"))
    wanted = screen_grey(polarised(stokes_image(seed)[:, :, 0], angle), white)
    shown = opened.grey(panel)
    away = disc() & ~_near_the_pick(opened)
    difference = np.abs(shown - wanted)[away]
    # 16-bit storage moves a radiance by less than 1e-5 of white: now and then over the border
    # between two of 1024 steps, which are up to 13 grey levels apart only in the darkest five.
    assert np.mean(difference == 0) > 0.98
    assert difference[wanted[away] > 40].max() <= 1
    assert np.ptp(wanted[away]) > 200  # the test sees the whole range


def _near_the_pick(browser: Browser) -> BoolArray:
    """Pixels that the mark of the read-out may cover."""
    text = browser.js("return document.querySelector('#readout .place').textContent")
    numbers = re.findall(r"\d+", text)
    y, x = np.mgrid[:SIZE, :SIZE]
    return (abs(x - int(numbers[0])) <= 3) & (abs(y - int(numbers[1])) <= 3)


def test_band_and_scene_are_the_ones_chosen(opened: Browser) -> None:
    opened.choose("band", "1")
    opened.choose("scene", "1")
    opened.choose("band", "1")
    opened.turn(30)
    white = float(opened.js("return document.getElementById('viewer').dataset.white"))
    wanted = screen_grey(polarised(stokes_image(3)[:, :, 1], 30), white)
    away = disc() & ~_near_the_pick(opened)
    assert np.mean(opened.grey("estimate")[away] == wanted[away]) > 0.98
    methods = opened.js("return [...document.querySelectorAll('#method option')].map(o => o.value)")
    assert methods == ["eq8"]


CIE_1931 = {
    450: (0.33620, 0.03800, 1.77211),
    550: (0.43345, 0.99495, 0.00875),
    650: (0.28350, 0.10700, 0.00000),
}
"""Rows of the printed table of colour matching functions."""

E_TO_D65 = np.array([
    [0.9531874, -0.0265906, 0.0238731],
    [-0.0382467, 1.0288406, 0.0094060],
    [0.0026068, -0.0030332, 1.0892565],
])  # fmt: skip
"""Bradford's adaptation of the equal-energy white to daylight, as B. Lindbloom prints it."""

XYZ_TO_SRGB = np.array([
    [3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570],
])  # fmt: skip
"""IEC 61966-2-1."""


def observed(bands: AnyArray) -> Float64Array:
    """Linear sRGB of radiances at 450, 550 and 650 nm, from printed tables alone."""
    functions = np.array(list(CIE_1931.values()))
    xyz = bands @ (functions / functions.sum(axis=0))
    return np.asarray(xyz @ E_TO_D65.T @ XYZ_TO_SRGB.T)


@pytest.mark.parametrize(("panel", "seed"), [("truth", 1), ("estimate", 2)])
def test_page_opens_in_the_colours_of_the_standard_observer(
    browser: Browser, coloured: Path, panel: str, seed: int
) -> None:
    browser.open(coloured)
    browser.turn(30)
    assert browser.js("return document.getElementById('band').value") == "colour"
    white = float(browser.js("return document.getElementById('viewer').dataset.white"))
    stokes = coloured_stokes(seed)
    wanted = screen_grey(observed(polarised(stokes, 30)), white)
    # Off the mask a reconstruction shows what a camera sees, halved.
    seen = observed(polarised(stokes, 30) if panel == "truth" else coloured_stokes(1)[..., 0] / 2)
    wanted[~disc()] = screen_grey(seen, white)[~disc()]
    away = ~_near_the_pick(browser)
    difference = np.abs(browser.rgb(panel) - wanted)[away]
    # Printed matrices have four digits, up to 2e-4 of a radiance: less than one of 1024 steps,
    # which are one code apart but near black.
    assert difference[wanted[away] > 40].max() <= 1
    assert np.mean(difference == 0) > 0.8
    assert np.ptp(wanted[away], axis=1).max() > 150  # the test sees colours


def test_luminance_of_all_bands_is_read_out(browser: Browser, coloured: Path) -> None:
    browser.open(coloured)
    browser.turn(30)
    text = browser.js("return document.querySelector('#readout .place').textContent")
    assert "as the eye weighs them" in text
    x, y = map(int, re.findall(r"\d+", text))
    cell = "document.querySelector('#readout tbody td').textContent"
    shown = float(browser.js(f"return {cell}"))
    linear = observed(polarised(coloured_stokes(1)[y, x].astype(float), 30))
    # Four digits of the matrices and of the number that is read.
    assert shown == pytest.approx(linear @ [0.2126, 0.7152, 0.0722], abs=5e-4)


def test_mask_can_be_laid_over_the_pictures(browser: Browser, coloured: Path) -> None:
    browser.open(coloured)
    away, inside = ~_near_the_pick(browser), disc()
    plain = {name: browser.rgb(name) for name in ("truth", "estimate", "dolp-truth")}
    # While the polariser turns, too: what does not turn with it is drawn anew all the same.
    browser.js(
        "document.getElementById('angle').dispatchEvent(new Event('input'));"
        "document.getElementById('off-mask').click()"
    )
    browser.settle()
    for name, before in plain.items():
        after = browser.rgb(name)
        np.testing.assert_array_equal(after[inside & away], before[inside & away])
        changed = (after != before).any(axis=-1)[~inside & away]
        assert changed.mean() > 0.95, name  # a stripe may have the colour of what it covers
    browser.js("document.getElementById('off-mask').click()")
    browser.settle()
    np.testing.assert_array_equal(browser.rgb("truth"), plain["truth"])
    browser.choose("band", "1")
    grey = browser.rgb("truth")[away]
    assert (np.ptp(grey, axis=-1) == 0).all()  # a single band has no colour


def test_pixels_of_several_normals_can_be_left_out(opened: Browser) -> None:
    mixed, label = mixed_part(), "document.getElementById('unmixed').closest('.unmixed')"
    assert f"Leave out {mixed.sum()} pixels" in opened.js(f"return {label}.textContent")
    opened.choose("method", "eq8")
    opened.choose("band", "0")
    opened.turn(30)
    before = opened.grey("estimate")
    opened.js("document.getElementById('unmixed').click()")
    opened.settle()
    white = float(opened.js("return document.getElementById('viewer').dataset.white"))
    away = disc() & ~_near_the_pick(opened)
    found = opened.grey("estimate")
    wanted = screen_grey(polarised(stokes_image(2)[:, :, 0], 30), white)
    assert np.mean(found[away & ~mixed] == wanted[away & ~mixed]) > 0.98  # as above
    assert (found[away & mixed] == 0).all()  # nothing is painted there
    assert "without pixels of several normals" in opened.js(
        "return document.getElementById('score').textContent"
    )
    opened.js("document.getElementById('unmixed').click()")
    opened.settle()
    np.testing.assert_array_equal(opened.grey("estimate"), before)
    opened.choose("scene", "1")  # an older example, which does not tell
    assert opened.js(f"return {label}.hidden")
    assert opened.js(f"return getComputedStyle({label}).display") == "none"


def test_read_out_tells_the_pixel(opened: Browser) -> None:
    opened.choose("band", "0")
    opened.turn(30)
    cells = opened.js(
        "return [...document.querySelectorAll('#readout tbody tr')].map("
        "row => row.querySelector('td').textContent)"
    )
    text = opened.js("return document.querySelector('#readout .place').textContent")
    x, y = map(int, re.findall(r"\d+", text))
    s0, s1, s2 = stokes_image(1)[y, x, 0].astype(float)
    part = np.hypot(s1, s2)
    assert float(cells[0]) == pytest.approx(polarised(np.array([s0, s1, s2]), 30), abs=1e-4)
    assert float(cells[1]) == pytest.approx((s0 + part) / 2, abs=1e-4)
    assert float(cells[2]) == pytest.approx((s0 - part) / 2, abs=1e-4)
    assert float(cells[4].removesuffix(" %")) == pytest.approx(100 * part / s0, abs=0.05)
    aolp = np.degrees(0.5 * np.arctan2(s2, s1)) % 180
    assert float(cells[5].removesuffix("°")) == pytest.approx(aolp, abs=0.1)
    assert float(cells[3].removesuffix("°")) == pytest.approx((aolp + 90) % 180, abs=0.1)


def test_keys_turn_zoom_and_move(opened: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    def angle() -> float:
        return float(opened.js("return document.getElementById('angle').value"))

    opened.turn(20)
    opened.keys("#angle", Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    assert angle() == 22
    opened.keys("[data-panel=truth] canvas", Keys.ARROW_LEFT, Keys.PAGE_UP)
    assert angle() == 31
    opened.keys("#angle", Keys.END)
    assert angle() == 180
    before = opened.grey("truth")
    opened.keys("[data-panel=truth] canvas", "+", "+")
    assert np.mean(before == opened.grey("truth")) < 0.9
    opened.keys("[data-panel=truth] canvas", "0")
    np.testing.assert_array_equal(before, opened.grey("truth"))
    place = "return document.querySelector('#readout .place').textContent"
    was = [int(n) for n in re.findall(r"\d+", opened.js(place))]
    opened.keys("[data-panel=truth] canvas", Keys.SHIFT + Keys.ARROW_RIGHT)
    assert [int(n) for n in re.findall(r"\d+", opened.js(place))] == [was[0] + 1, was[1]]


class Fingers:
    """Fingers on the truth's panel; positions are parts of its width and height."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser
        browser.js("document.querySelector('[data-panel=truth]').scrollIntoView()")
        browser.settle()
        self.box = browser.js(
            "const b = document.querySelector('[data-panel=truth] canvas').getBoundingClientRect();"
            "return [b.left, b.top, b.width, b.height]"
        )

    def send(self, kind: str, *positions: tuple[float, float]) -> None:
        left, top, width, height = self.box
        points = [
            {"x": left + x * width, "y": top + y * height, "id": k}
            for k, (x, y) in enumerate(positions)
        ]
        event = {"type": kind, "touchPoints": points}
        self.browser.driver.execute_cdp_cmd("Input.dispatchTouchEvent", event)

    def drag(self, *ways: tuple[tuple[float, float], tuple[float, float]], steps: int = 8) -> None:
        self.send("touchStart", *(start for start, _ in ways))
        for step in range(1, steps + 1):
            part = step / steps
            now = [(a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])) for a, b in ways]
            self.send("touchMove", *now)
            self.browser.settle()  # a browser may join the moves of one frame into one
        self.send("touchEnd")
        self.browser.settle()

    def tap(self, x: float, y: float) -> list[int]:
        """The pixel that is read out after a tap."""
        self.send("touchStart", (x, y))
        self.send("touchEnd")
        self.browser.settle()
        text = self.browser.js("return document.querySelector('#readout .place').textContent")
        return [int(number) for number in re.findall(r"\d+", text)]


def test_fingers_pick_pinch_and_pan(browser: Browser, report: Path) -> None:
    touch = "Emulation.setTouchEmulationEnabled"
    browser.driver.execute_cdp_cmd(touch, {"enabled": True, "maxTouchPoints": 2})
    try:
        browser.open(report, width=390)
        fingers = Fingers(browser)
        assert fingers.tap(0.26, 0.74) == [10, 29]  # of 40 pixels
        # Two fingers from 0.4 and 0.6 to 0.2 and 0.8: three times as large, the middle stays.
        fingers.drag(((0.4, 0.5), (0.2, 0.5)), ((0.6, 0.5), (0.8, 0.5)), steps=1)
        pinched = fingers.tap(0.26, 0.74)
        wanted = np.array([1 / 3 + 0.26 / 3, 1 / 3 + 0.74 / 3]) * SIZE
        # A finger is at whole pixels of a panel that is some 170 wide: a quarter of one of ours.
        assert np.abs(np.array(pinched) + 0.5 - wanted).max() < 1
        # One finger 0.6 to the left and up pans by 0.2 of the image, also upwards.
        fingers.drag(((0.8, 0.8), (0.2, 0.2)))
        panned = fingers.tap(0.26, 0.74)
        assert np.abs(np.array(panned) - pinched - 0.2 * SIZE).max() <= 1
        browser.js("document.getElementById('zoom-reset').click()")
        browser.settle()
        assert fingers.tap(0.26, 0.74) == [10, 29]
    finally:
        browser.driver.execute_cdp_cmd(touch, {"enabled": False})


def test_play_turns_and_stops(opened: Browser) -> None:
    opened.js("document.getElementById('play').click()")
    opened.until("Number(document.getElementById('angle').value) > 5")
    assert (
        opened.js("return document.getElementById('play').getAttribute('aria-pressed')") == "true"
    )
    opened.js("document.getElementById('play').click()")
    opened.settle()
    stopped = opened.js("return document.getElementById('viewer').dataset.shown")
    opened.settle()
    assert opened.js("return document.getElementById('viewer').dataset.shown") == stopped
