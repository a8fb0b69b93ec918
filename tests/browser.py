"""A page in Chromium, as tests open, turn and read it."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from viewed_scenes import SIZE

from malus.scenes.core.arrays import IntArray

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


def find_browser() -> tuple[str, str]:
    """Chromium and its driver, or a skip; under CI they must be there."""
    browser, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if browser and driver:
        return browser, driver
    message = "needs chromium and chromedriver (Debian: chromium, chromium-driver)"
    if os.environ.get("CI") == "true":
        pytest.fail(message)
    pytest.skip(message)


def chromium(profile: Path) -> Any:
    """Chromium's driver with an empty profile; it logs what pages say and ask for."""
    browser, path = find_browser()
    webdriver = pytest.importorskip("selenium.webdriver")
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for flag in (*CHROMIUM_FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    return webdriver.Chrome(options, webdriver.ChromeService(path))


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
