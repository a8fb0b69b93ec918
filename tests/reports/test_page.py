"""The page, in a real browser: it asks for nothing, holds what a run has, and all can use it."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from browser import Browser
from viewed_scenes import EVIL, SIZE, WAVELENGTHS, disc, save_example, stokes_image

from malus.bench.scoring.colour_error import delta_e
from malus.reports import write_report
from malus.reports.tables import sample
from malus.scenes.colour import compared_colours, differences_from


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
    media = "Emulation.setEmulatedMedia"
    browser.driver.execute_cdp_cmd(media, {"features": features})
    try:
        browser.open(report)
        browser.js("localStorage.clear()")
        browser.open(report)
        theme = "return document.documentElement.dataset.theme"
        assert browser.js(theme) == scheme
        browser.js("document.getElementById('theme').click()")
        assert browser.js(theme) != scheme
        browser.js("localStorage.clear()")
    finally:
        browser.driver.execute_cdp_cmd(media, {"features": []})


def test_a_dark_page_is_printed_in_the_light_colours_with_all_of_its_tables(
    browser: Browser, report: Path
) -> None:
    media = "Emulation.setEmulatedMedia"
    style = "getComputedStyle(document.querySelector(arguments[0]))[arguments[1]]"
    browser.open(report)
    browser.js("document.documentElement.dataset.theme = 'dark'")
    dark = browser.js(f"return {style}", "body", "color")
    browser.driver.execute_cdp_cmd(media, {"media": "print"})
    try:
        assert browser.js(f"return {style}", "body", "color") == "rgb(35, 35, 43)" != dark
        assert browser.js(f"return {style}", ".scroll", "overflowX") == "visible"
        assert browser.js(f"return {style}", "h3", "breakAfter") == "avoid"
    finally:
        browser.driver.execute_cdp_cmd(media, {"media": ""})


@pytest.mark.parametrize("width", [1280, 800, 390])
def test_panels_of_a_row_stand_at_one_height(browser: Browser, report: Path, width: int) -> None:
    """A caption of two lines pushed its image below the one beside it."""
    browser.open(report, width)
    browser.js(
        "document.querySelectorAll('.method-name').forEach("
        "name => { name.textContent = 'a method with a name of many many words '.repeat(2); })"
    )
    browser.settle()
    boxes = browser.js(
        "return [...document.querySelectorAll('.panels figure > canvas')].map(c => {"
        "const b = c.getBoundingClientRect(); return [Math.round(b.top), Math.round(b.bottom)]; })"
    )
    tops = {top for top, _ in boxes}
    rows = {1280: 2, 800: 4, 390: 4}[width]
    assert len(tops) == rows
    assert all(bottom > top + 50 for top, bottom in boxes)


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
    table = sample.table()
    numbers = table["scene"].map(lambda name: f"{int(name, 16) + 12:016x}")
    table = pd.concat([table, table.assign(scene=numbers)], ignore_index=True)
    methods = {name: stokes_image(4, 96) for name in ("eq8", "unpolarised", "half_vector")}
    for number in range(24):
        save_example(tmp_path / "examples", f"{number:016x}", f"scene {number}", **methods)
    write_report(SimpleNamespace(table=table, run=sample.run()), tmp_path)
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
    save_example(tmp_path / "examples", f"{0:016x}", "a disc", eq8=close)
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
