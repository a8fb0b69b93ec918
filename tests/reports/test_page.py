"""The page, in a real browser: it is self-contained, it computes Equation 1, and all can use it."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from malus.bench.scoring.colour_error import delta_e
from malus.reports import write_report
from malus.reports.tables import sample
from malus.reports.viewer.error_maps import gallery
from malus.reports.viewer.examples import Example, read_example
from malus.reports.viewer.pack import NOT_FINITE, Packer, Shown, fitted, quantised
from malus.scenes.colour import compared_colours, differences_from, preview
from malus.scenes.core.arrays import AnyArray, BoolArray, Float32Array, Float64Array, IntArray
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import polarised

EVIL = "<script>alert(1)</script>"
SIZE = 40
WAVELENGTHS = (450.0, 650.0)
CHROMIUM_FLAGS = (
    "--headless=new",
    "--no-sandbox",  # root, as in CI, has no other way
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--force-device-scale-factor=1",
)


def disc(size: int = SIZE) -> BoolArray:
    y, x = np.mgrid[:size, :size]
    middle = (size - 1) / 2
    return (x - middle) ** 2 + (y - middle) ** 2 < (0.47 * size) ** 2


def mixed_part(size: int = SIZE) -> BoolArray:
    """Some of the disc's pixels, not symmetric in any way."""
    y, x = np.mgrid[:size, :size]
    return disc(size) & ((x - 0.3 * size) ** 2 + (y - 0.6 * size) ** 2 < (0.15 * size) ** 2)


def stokes_image(seed: int, size: int = SIZE) -> Float32Array:
    """Every degree and angle of polarisation, and no two pixels alike."""
    random = np.random.default_rng(seed)
    s0 = random.uniform(0.05, 1.0, (size, size, len(WAVELENGTHS)))
    degree = random.uniform(0.0, 1.0, s0.shape)
    angle = random.uniform(0.0, 2 * np.pi, s0.shape)
    parts = [s0, s0 * degree * np.cos(angle), s0 * degree * np.sin(angle)]
    return np.stack(parts, axis=-1).astype(np.float32)


def save_example(
    folder: Path, scene: str, label: str, mixed: BoolArray | None = None, **methods: Float32Array
) -> Float32Array:
    size = len(next(iter(methods.values())))
    truth = stokes_image(1, size)
    meta = {"scene": scene, "label": label, "wavelengths_nm": WAVELENGTHS}
    arrays: dict[str, Any] = {f"method.{name}": stokes for name, stokes in methods.items()}
    if mixed is not None:
        arrays["mixed"] = mixed
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / f"{scene}.npz", truth=truth, mask=disc(size), meta=np.array(json.dumps(meta)),
             allow_pickle=False, **arrays)  # fmt: skip
    return truth


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report whose names are hostile and whose viewer shows two scenes."""
    folder = tmp_path_factory.mktemp("report")
    table = sample.table()
    first, second = table["scene"].unique()[:2]
    save_example(
        folder / "examples",
        first,
        EVIL,
        mixed_part(),
        eq8=stokes_image(2),
        unpolarised=_unpolarised(),
    )
    save_example(folder / "examples", second, "second", eq8=stokes_image(3))
    table["light"] = table["light"].replace("uniform", EVIL)
    run = sample.run()
    run["suite"] |= {"name": EVIL, "description": EVIL}
    write_report(SimpleNamespace(table=table, run=run), folder)
    return folder / "report.html"


def _unpolarised() -> Float32Array:
    guess = stokes_image(1)
    guess[..., 1:] = 0
    return guess


def find_browser() -> tuple[str, str]:
    """Chromium and its driver, or a skip; under CI they must be there."""
    browser, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if browser and driver:
        return browser, driver
    message = "needs chromium and chromedriver (Debian: chromium, chromium-driver)"
    if os.environ.get("CI") == "true":
        pytest.fail(message)
    pytest.skip(message)


class Browser:
    """A page in Chromium, driven through its driver."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, page: Path, width: int = 1280) -> None:
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        self.logs()
        self.driver.get(page.as_uri())
        self.until("document.documentElement.dataset.ready")

    def js(self, script: str, *arguments: Any) -> Any:
        return self.driver.execute_script(script, *arguments)

    def until(self, condition: str) -> None:
        from selenium.webdriver.support.ui import WebDriverWait

        WebDriverWait(self.driver, 20, 0.02).until(lambda _: self.js(f"return {condition}"))

    def logs(self) -> list[dict[str, Any]]:
        return list(self.driver.get_log("browser"))

    def requests(self) -> list[str]:
        """Addresses of everything that was asked for since the last call."""
        events = [json.loads(entry["message"]) for entry in self.driver.get_log("performance")]
        sent = [
            e["message"] for e in events if e["message"]["method"] == "Network.requestWillBeSent"
        ]
        return [event["params"]["request"]["url"] for event in sent]

    def keys(self, selector: str, *keys: str) -> None:
        from selenium.webdriver.common.by import By

        element = self.driver.find_element(By.CSS_SELECTOR, selector)
        self.js("arguments[0].focus()", element)
        for key in keys:
            element.send_keys(key)
        self.settle()

    def settle(self) -> None:
        """Let the frame pass that shows what was just changed."""
        self.driver.execute_async_script(
            "const done = arguments[0];"
            "requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )

    def choose(self, name: str, value: str) -> None:
        script = (
            "const select = document.getElementById(arguments[0]); select.value = arguments[1];"
            "select.dispatchEvent(new Event('change'))"
        )
        self.js(script, name, value)
        self.settle()

    def turn(self, degrees: float) -> None:
        script = (
            "const slider = document.getElementById('angle'); slider.value = arguments[0];"
            "slider.dispatchEvent(new Event('input'))"
        )
        self.js(script, degrees)
        self.settle()
        assert self.js("return Number(document.getElementById('viewer').dataset.shown)") == degrees

    def grey(self, panel: str, size: int = SIZE) -> IntArray:
        """Red channel of a panel, as `rgb`."""
        return self.rgb(panel, size)[..., 0]

    def rgb(self, panel: str, size: int = SIZE) -> IntArray:
        """A panel at the centres of the image's pixels, as the screen shows it."""
        script = """
            const canvas = document.querySelector(`[data-panel=${arguments[0]}] canvas`);
            const context = canvas.getContext("2d"), size = arguments[1], found = [];
            const image = context.getImageData(0, 0, canvas.width, canvas.height);
            for (let y = 0; y < size; y++) for (let x = 0; x < size; x++) {
              const column = Math.floor((x + 0.5) * canvas.width / size);
              const row = Math.floor((y + 0.5) * canvas.height / size);
              const place = 4 * (row * canvas.width + column);
              found.push(...image.data.slice(place, place + 3));
            }
            return found;
        """
        return np.array(self.js(script, panel, size)).reshape(size, size, 3)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    chromium, driver_path = find_browser()
    webdriver = pytest.importorskip("selenium.webdriver")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*CHROMIUM_FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('chromium')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(driver_path))
    driver.set_script_timeout(20)
    yield Browser(driver)
    driver.quit()


@pytest.fixture
def opened(browser: Browser, report: Path) -> Browser:
    browser.open(report)
    return browser


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


def coloured_stokes(seed: int) -> Float32Array:
    """Three bands of every degree and angle."""
    return np.concatenate([stokes_image(seed), stokes_image(seed + 10)[:, :, :1]], axis=2)


@pytest.fixture(scope="module")
def coloured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of one scene with three bands: it opens in colour."""
    folder = tmp_path_factory.mktemp("coloured")
    meta = {"scene": "0", "label": "a disc", "wavelengths_nm": list(CIE_1931)}
    (folder / "examples").mkdir()
    np.savez(folder / "examples" / "0.npz", truth=coloured_stokes(1), mask=disc(),
             meta=np.array(json.dumps(meta)), **{"method.eq8": coloured_stokes(2)})  # fmt: skip
    run = sample.run() | {"command": f"malus run '{EVIL}'"}
    write_report(SimpleNamespace(table=sample.table(), run=run), folder)
    return folder / "report.html"


def test_the_command_can_be_copied(browser: Browser, coloured: Path) -> None:
    browser.open(coloured)
    assert browser.js("return document.querySelector('.command code').textContent") == (
        f"malus run '{EVIL}'"
    )
    browser.js("document.querySelector('button.copy').click()")
    text = "document.querySelector('button.copy').textContent"
    browser.until(f"{text} !== 'Copy the command'")
    # A browser may refuse; the command is marked then.
    marked = browser.js("return String(window.getSelection())")
    assert browser.js(f"return {text}") == "Copied" or marked == f"malus run '{EVIL}'"
    assert browser.logs() == []


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


def test_everything_has_a_name_for_a_screen_reader(opened: Browser) -> None:
    nameless = opened.js("""
        const kinds = "button, select, input, a, canvas, svg, [tabindex]";
        return [...document.querySelectorAll(kinds)].filter((e) => !e.closest("[aria-hidden=true]")
            && !(e.getAttribute("aria-label") || e.textContent.trim() || (e.labels || []).length))
          .map((e) => e.outerHTML.slice(0, 120));
    """)
    assert nameless == []
    assert opened.js("return document.documentElement.lang") == "en"
    doubled = opened.js("""
        const ids = [...document.querySelectorAll("[id]")].map((e) => e.id);
        return ids.filter((id, i) => ids.indexOf(id) !== i && !id.includes("-m"));
    """)
    assert doubled == []
    assert "anticlockwise" in opened.js(
        "return document.getElementById('angle').getAttribute('aria-valuetext')"
    )


@pytest.mark.parametrize("width", [390, 768])
def test_narrow_screens_scroll_only_down(browser: Browser, report: Path, width: int) -> None:
    browser.open(report, width)
    assert browser.js("return document.documentElement.scrollWidth") <= width


def test_nothing_is_asked_for_and_nothing_goes_wrong(browser: Browser, report: Path) -> None:
    browser.requests()
    browser.open(report)
    browser.js("document.getElementById('play').click()")
    browser.choose("scene", "1")
    browser.js("document.getElementById('theme').click()")
    browser.js("document.querySelector('button[data-scene]').click()")
    browser.settle()
    assert browser.logs() == []
    outside = [url for url in browser.requests() if not url.startswith("data:")]
    assert outside == [report.as_uri()]


def test_names_stay_text(opened: Browser) -> None:
    option = opened.js("return document.querySelector('#scene option').textContent")
    assert option == EVIL
    assert EVIL in opened.js("return document.querySelector('h1').textContent")
    scripts = opened.js(
        "return [...document.scripts].filter((s) => s.text.includes('alert(1)')).length"
    )
    assert scripts == 1  # the viewer's JSON, which is not run
    assert EVIL not in opened.driver.page_source


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_follows_the_system_and_the_button(
    browser: Browser, report: Path, scheme: str
) -> None:
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    browser.open(report)
    browser.js("localStorage.clear()")
    browser.open(report)
    theme = "return document.documentElement.dataset.theme"
    assert browser.js(theme) == scheme
    browser.js("document.getElementById('theme').click()")
    assert browser.js(theme) != scheme
    browser.js("localStorage.clear()")


def test_skill_map_opens_its_example(opened: Browser) -> None:
    label = opened.js(
        "const b = document.querySelectorAll('button[data-scene]')[0]; b.click();"
        "return document.getElementById('scene').selectedOptions[0].textContent"
    )
    assert label in {EVIL, "second"}


def test_captures_have_a_page_with_their_colours(browser: Browser, tmp_path: Path) -> None:
    """Channels in place of bands, pictures above their error maps, Table I by group."""
    table = sample.captured()
    scene = table["scene"].iloc[0]
    truth = np.repeat(stokes_image(1)[:, :, :1], 3, axis=2)
    meta = {"scene": scene, "label": EVIL, "channels": ["red", "green", "blue"]}
    (tmp_path / "examples").mkdir()
    np.savez(tmp_path / "examples" / f"{scene}.npz", truth=truth, mask=disc(),
             meta=np.array(json.dumps(meta)), **{"method.eq8": 0.9 * truth})  # fmt: skip
    write_report(SimpleNamespace(table=table, run=sample.run_of_captures()), tmp_path)
    browser.open(tmp_path / "report.html", 390)
    assert browser.js("return document.documentElement.scrollWidth") <= 390
    bands = browser.js("return [...document.querySelectorAll('#band option')].map(o => o.text)")
    assert bands == ["all, in colour", "red", "green", "blue"]
    channels = browser.rgb("truth")[disc()]
    assert (np.ptp(channels, axis=1) == 0).all()  # equal in all channels is grey
    rows = "[...document.querySelectorAll('.error-maps tbody th')].map(h => h.textContent)"
    assert browser.js(f"return {rows}") == ["captured", "eq8", "eq8, ΔE76"]
    loaded = "[...document.querySelectorAll('.error-maps img')].every(i => i.naturalWidth == 40)"
    browser.until(loaded)
    groups = "[...document.querySelectorAll('#colour tbody th')].map(h => h.textContent)"
    assert browser.js(f"return {groups}") == ["indoor"] * 3 + ["outdoor"] * 3
    assert "pot: expected a folder" in browser.js("return document.body.textContent")
    assert browser.logs() == []


def test_page_without_examples_has_no_viewer_and_no_error(browser: Browser, tmp_path: Path) -> None:
    write_report(SimpleNamespace(table=sample.table(), run=sample.run()), tmp_path)
    browser.open(tmp_path / "report.html")
    assert browser.logs() == []
    assert not browser.js("return document.getElementById('viewer')")
    assert browser.js("return document.querySelectorAll('.heat').length") == 2


COUNT_DECODED = """
    const plain = window.atob;
    window.decoded = 0;
    window.atob = (text) => { window.decoded += text.length; return plain(text); };
"""


def test_a_full_page_is_below_15_mb_and_decodes_one_scene_to_begin_with(
    browser: Browser, tmp_path: Path
) -> None:
    """What must be decoded before anything can be used does not grow with the scenes."""
    methods = {name: stokes_image(4, 96) for name in ("eq8", "visible", "half_vector")}
    for number in range(24):
        save_example(tmp_path / "examples", f"{number:016x}", f"scene {number}", **methods)
    write_report(SimpleNamespace(table=sample.table(), run=sample.run()), tmp_path)
    page = tmp_path / "report.html"
    size = page.stat().st_size
    assert 9e6 < size < 15e6
    added = browser.driver.execute_cdp_cmd(
        "Page.addScriptToEvaluateOnNewDocument", {"source": COUNT_DECODED}
    )
    try:
        browser.open(page)
        first = browser.js("return window.decoded")
        # The truth and one of three methods of one of 24 scenes, and tables of colours.
        assert 0 < first < 1.2 * size * 2 / (4 * 24)
        browser.choose("scene", "1")
        assert browser.js("return window.decoded") > 1.8 * first  # the count sees a scene
    finally:
        browser.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)


def test_error_maps_are_those_of_the_metric_and_white_is_10_jnd(
    browser: Browser, tmp_path: Path
) -> None:
    truth = stokes_image(1)
    close = truth * np.array([1.0, 0.9, 0.7], np.float32)
    save_example(tmp_path / "examples", "0", "a disc", eq8=close)
    write_report(SimpleNamespace(table=sample.table(), run=sample.run()), tmp_path)
    browser.open(tmp_path / "report.html")
    drawn = np.array(
        browser.driver.execute_async_script("""
        const done = arguments[arguments.length - 1];
        const pictures = [...document.querySelectorAll(".error-maps img")];
        Promise.all(pictures.map((picture) => picture.decode())).then(() => done(
          pictures.map((picture) => {
            const canvas = document.createElement("canvas");
            canvas.width = picture.naturalWidth;
            canvas.height = picture.naturalHeight;
            const context = canvas.getContext("2d");
            context.drawImage(picture, 0, 0);
            return [...context.getImageData(0, 0, canvas.width, canvas.height).data];
          })));
        """)
    ).reshape(-1, SIZE, SIZE, 4)
    inside = disc()
    peak = truth[inside][..., 0].max()
    estimated, true = close[inside].astype(float) / peak, truth[inside].astype(float) / peak
    colours = compared_colours(true, WAVELENGTHS)
    maps = [values for _, _, values in differences_from(colours, estimated)]
    assert len(drawn) == len(maps) == 7
    for picture, values in zip(drawn, maps, strict=True):
        np.testing.assert_array_equal(picture[..., 3] == 255, inside)
        # Half a grey level, and as much again for a value that a rounding error puts on the edge.
        wanted = 255 * np.clip(values / 23.0, 0, 1)
        assert np.abs(picture[inside][:, 0] - wanted).max() < 0.51
        assert wanted.min() < 40
    assert max(values.max() for values in maps) > 23.0  # the test sees white
    sums = [sums for _, _, sums in delta_e(estimated, colours)][:7]
    texts = browser.js(
        "return [...document.querySelectorAll('.error-maps td span')].map(e => e.textContent)"
    )
    assert texts == [f"{total.mean:.2f} ± {total.std:.2f}" for total in sums]


def test_error_maps_keep_to_the_budget_and_skip_what_no_eye_sees() -> None:
    short = gallery([example(8, 2)] * 3, budget=6000)
    assert short is not None
    assert "further scene" in short
    assert gallery([replace(example(8, 1), wavelengths_nm=(1550.0,))]) is None


@pytest.mark.parametrize("values", [[0.0, 1.0], [-3.0, 0.0, 5.0], [7.0, 7.0], [0.0, 0.0], [-2.0]])
def test_storing_rounds_by_half_a_step_at_most_and_keeps_zero(values: list[float]) -> None:
    q, first, step = quantised(np.array(values))
    back = step * (first + q.astype(float))
    span = float(np.ptp(values)) / 65533
    np.testing.assert_allclose(back, values, rtol=0, atol=0.5 * span + 1e-15)
    assert all(stored == 0.0 for stored, value in zip(back, values, strict=True) if value == 0.0)
    assert quantised(np.array([np.inf, np.nan]))[0].tolist() == [NOT_FINITE] * 2


def example(size: int, bands: int) -> Example:
    truth, estimate = np.random.default_rng(7).random((2, size, size, bands, 3), np.float32)
    wavelengths = tuple(np.linspace(400.0, 700.0, bands))
    mask = np.ones((size, size), bool)
    mask[0] = False
    return Example("0", "a", wavelengths, mask, truth, {"eq8": estimate})


def test_a_large_run_keeps_its_colours_and_counts_what_it_leaves_out() -> None:
    """Surroundings go first, then single bands, then scenes."""
    ways = []
    scene = example(64, 8)
    bands_of_ten = 10 * 64 * 63 * 2 * 3 * 2 * 4 // 3  # truth and one method, 16 bits in base64
    for budget in (9 * bands_of_ten, 8 * bands_of_ten, 7 * bands_of_ten, 3 * bands_of_ten):
        kept, left_out = fitted([scene] * 10, budget)
        assert sum(one.size for one in kept) <= budget
        ways.append((len(kept[0].bands), kept[0].with_surroundings, left_out))
        packer = Packer()
        packer.scene(kept[0], {})
        # The masks are a bit a pixel; base64 fills up to four characters a block.
        assert sum(map(len, packer.blocks)) == pytest.approx(kept[0].size, rel=0.02)
    assert ways == [(8, True, 0), (8, False, 0), (3, True, 0), (1, True, 3)]


def test_colour_is_of_all_bands_also_where_few_are_shown() -> None:
    """What is packed as red, green and blue is what the page makes of all bands."""
    scene = example(8, 8)
    (every,), _ = fitted([scene])
    (few,), _ = fitted([scene], budget=0.7 * every.size)
    assert (every.with_colour, few.with_colour) == (False, True)
    wanted, found = (_packed_colour(one) for one in (every, few))
    # Each of eight planes is rounded by half of 1/65533 of a range of 1, and weights are up to 0.5.
    np.testing.assert_allclose(found, wanted, atol=4e-5)
    np.testing.assert_allclose(
        found[..., 0], preview(scene.truth[..., 0], scene.wavelengths_nm)[scene.mask], atol=4e-5
    )
    assert np.ptp(found[..., 0], axis=-1).max() > 0.2  # the test sees colours


def test_only_light_that_is_known_is_shown_beside_the_object() -> None:
    scene = example(8, 3)
    scene.truth[0, :3] = 0
    scene.truth[0, 3, 1, 2] = np.nan
    wanted = ~scene.mask
    wanted[0, :4] = False
    np.testing.assert_array_equal(scene.beyond, wanted)


def _packed_colour(shown: Shown) -> Float64Array:
    """Stokes vectors (pixels, channels, 3) of the truth as the page has them."""
    packer = Packer()
    scene = packer.scene(shown, {})
    planes = []
    for plane in scene["truth"]:
        q = np.frombuffer(base64.b64decode(packer.blocks[plane["block"]]), "<u2").reshape(3, -1)
        planes.append((q + np.array(plane["first"])[:, None]) * np.array(plane["step"])[:, None])
    return np.einsum("ck,ksp->pcs", scene["colours"], planes)


@pytest.mark.parametrize("spoil", ["not an archive", "no truth", "wrong shape", "no json"])
def test_a_bad_example_is_named_in_one_line(tmp_path: Path, spoil: str) -> None:
    path = tmp_path / "bad.npz"
    writers: dict[str, Callable[[], object]] = {
        "not an archive": lambda: path.write_text("hello"),
        "no truth": lambda: np.savez(path, mask=disc()),
        "wrong shape": lambda: np.savez(
            path, truth=np.zeros((2, 2, 1, 3)), mask=disc(),
            meta=np.array('{"scene": "a", "label": "b", "wavelengths_nm": [5]}'),
        ),
        "no json": lambda: np.savez(
            path, truth=stokes_image(1), mask=disc(), meta=np.array("hello")
        ),
    }  # fmt: skip
    writers[spoil]()
    with pytest.raises(InputError, match=r"bad\.npz: expected truth and methods"):
        read_example(path)
