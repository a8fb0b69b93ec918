"""The site builds strictly, its links lead somewhere, and it loads nothing from elsewhere.

The last tests open it in Chromium from `file://`, as whoever built it without a server does.
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote, urlsplit

import pytest
from browser import chromium

import malus
from malus.bench.cli import cli
from malus.bench.documents.reference_pages import list_page, suite_page
from malus.bench.documents.site_hooks import generated_pages
from malus.bench.documents.tutorial_pages import tutorial_page
from malus.scenes.suite import Suite

ROOT = Path(__file__).parents[1]

LOADED = {
    ("script", "src"), ("img", "src"), ("iframe", "src"), ("source", "src"), ("source", "srcset"),
    ("video", "src"), ("audio", "src"), ("object", "data"), ("embed", "src"),
}  # fmt: skip
"""Attributes that make a browser fetch something when it opens a page."""
LOADING_RELATIONS = {"stylesheet", "icon", "preload", "preconnect", "dns-prefetch", "modulepreload"}

LOCAL = ("file:", "data:", "chrome:")
"""What a page may ask for: itself, and what the browser's own first page still asks for."""


class Page(HTMLParser):
    """What a page links, loads and can be linked to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attributes}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if tag == "link" and LOADING_RELATIONS & set(given.get("rel", "").split()):
            self.loads.append(given["href"])
        self.loads += [given[name] for name in given if (tag, name) in LOADED]


class Tables(HTMLParser):
    """Rows of all tables of a page, a cell a text; heads of columns are a row too."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: list[list[list[str]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, _attributes: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_data(self, data: str) -> None:
        if self.tables and self.tables[-1] and self.tables[-1][-1]:
            self.tables[-1][-1][-1] += data


class Site(NamedTuple):
    """The folder of the built site, and its pages by their path."""

    folder: Path
    pages: dict[Path, Page]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    """The site as `make docs` builds it, in a folder of its own."""
    folder = tmp_path_factory.mktemp("site")
    recipe = re.search(r"\$\(BIN\)/python -m (mkdocs .*)$", (ROOT / "Makefile").read_text(), re.M)
    assert recipe
    build = [sys.executable, "-m", *shlex.split(recipe[1]), "--site-dir", str(folder)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    # MkDocs counts no warning that it does not print: quiet, it would not be strict.
    assert "INFO" in done.stderr
    pages = {path: Page(path.read_text("utf-8")) for path in folder.rglob("*.html")}
    return Site(folder, pages)


def test_every_page_was_built(site: Site) -> None:
    sources = [
        path.relative_to(ROOT / "reports" / "docs") for path in ROOT.glob("reports/docs/**/*.md")
    ]
    built = {path.relative_to(site.folder).with_suffix("").as_posix() for path in site.pages}
    expected = {path.with_suffix("").as_posix() for path in sources}
    assert expected <= built
    assert {Path(path).with_suffix("").as_posix() for path in generated_pages()} <= built


def test_links_and_anchors_lead_somewhere(site: Site) -> None:
    checked = 0
    for path, page in site.pages.items():
        if path.name == "404.html":
            continue  # served for any address, its links start at the root
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                assert parts.scheme in ("https", "mailto"), f"{path}: {link}"
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.is_file(), f"{path.relative_to(site.folder)}: {link}"
            if parts.fragment and target in site.pages:
                anchors = site.pages[target].anchors
                assert unquote(parts.fragment) in anchors, (
                    f"{path.relative_to(site.folder)}: {link}"
                )
            checked += 1
    assert checked > 1000  # a parser that finds no links would pass


def test_nothing_is_loaded_from_elsewhere(site: Site) -> None:
    loaded = 0
    for path, page in site.pages.items():
        for address in page.loads:
            parts = urlsplit(address)
            assert parts.scheme in ("", "data"), f"{path.name} loads {address}"
            assert not parts.netloc, f"{path.name} loads {address}"
            if path.name != "404.html" and parts.scheme == "":
                assert (path.parent / parts.path).resolve().is_file(), f"{path.name}: {address}"
            loaded += 1
    assert loaded > 100
    for style in site.folder.rglob("*.css"):
        assert not re.search(r"(?:@import|url\()\s*['\"]?https?:", style.read_text("utf-8")), style


def test_a_page_that_loads_from_elsewhere_would_be_seen() -> None:
    page = Page('<link rel="preconnect" href="https://a"><img src="https://b"><a href="https://c">')
    assert page.loads == ["https://a", "https://b"]
    assert page.links == ["https://c"]


def test_the_reference_has_every_public_name(site: Site) -> None:
    anchors = set().union(*(page.anchors for page in site.pages.values()))
    for name in malus.__all__:
        home = getattr(getattr(malus, name), "__module__", "")
        assert {f"malus.{name}", f"{home}.{name}"} & anchors, name


def test_the_reference_says_what_everything_is(site: Site) -> None:
    """No parameter, attribute or result without words, nor with its type for words."""
    rows = 0
    for path in site.folder.glob("reference/api_*.html"):
        for head, *body in Tables(path.read_text("utf-8")).tables:
            names = [" ".join(cell.split()) for cell in head]
            for row in body if "Description" in names else ():
                cells = dict(zip(names, (" ".join(c.split()) for c in row), strict=True))
                told = cells["Description"]
                assert told, f"{path.name}: {cells}"
                assert told != cells["Type"], f"{path.name}: {cells}"
                rows += 1
    assert rows > 400  # a parser that finds no tables would pass


def test_the_reference_says_what_methods_are_told() -> None:
    """A mask always: an `Observation` has one whatever a method asks for besides."""
    rows = [line.split(" | ") for line in list_page().splitlines() if line.startswith("| `")]
    told = {name.strip("|` "): besides.strip("| ") for name, _, besides in rows}
    assert "the picture and the mask" in list_page()
    assert told["blind"] == told["paper"] == "nothing else"
    assert told["half_vector"] == "diffuse, eta, light, specular"


def test_the_reference_has_every_command_and_option(site: Site) -> None:
    text = (site.folder / "reference" / "commands.html").read_text("utf-8")
    for name, command in cli.commands.items():
        assert f'id="malus-{name}"' in text
        for option in (o for p in command.params for o in p.opts if o.startswith("--")):
            assert option in text, f"malus {name} {option}"


def test_the_reference_has_every_key_of_a_suite() -> None:
    page = suite_page()
    for key in Suite.model_fields:
        assert f"| `{key}` |" in page
    assert "| `half_angle_deg` | a number, > 0, ≤ 80 | `20.0` |" in page  # a bound and a default


def test_a_tutorial_becomes_prose_and_code() -> None:
    script = '"""Head."""\n\n# %% [markdown]\n# # T\n#\n# Words.\n\n# %%\nx = 1\n\n# %%\ny = 2\n'
    assert tutorial_page(script) == (
        "# T\n\nWords.\n\n```python\nx = 1\n```\n\n```python\ny = 2\n```"
    )


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Chromium's driver; without it these tests are skipped, but in CI they fail."""
    driver = chromium(tmp_path_factory.mktemp("chromium"))
    yield driver
    driver.quit()


def open_page(driver: Any, page: Path, width: int) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    driver.get(page.as_uri())


def requests(driver: Any) -> list[str]:
    events = [json.loads(entry["message"])["message"] for entry in driver.get_log("performance")]
    sent = [event for event in events if event["method"] == "Network.requestWillBeSent"]
    return [event["params"]["request"]["url"] for event in sent]


@pytest.mark.parametrize(
    "name", ["index", "start/glossary", "guides/suites", "reference/commands", "reference/suites"]
)
def test_a_page_fits_a_telephone_and_asks_for_nothing(driver: Any, site: Site, name: str) -> None:
    driver.get_log("browser")
    open_page(driver, site.folder / f"{name}.html", 390)
    # Wide tables and formulas scroll by themselves.
    assert driver.execute_script("return document.documentElement.scrollWidth") <= 390
    asked = requests(driver)
    assert asked
    assert [url for url in asked if not url.startswith(LOCAL)] == []
    assert driver.get_log("browser") == []


@pytest.mark.parametrize("name", ["physics", "conventions"])
def test_formulas_are_not_cut(driver: Any, site: Site, name: str) -> None:
    open_page(driver, site.folder / f"{name}.html", 1300)
    widths = driver.execute_script(
        "const blocks = [...document.querySelectorAll('pre > code')];"
        "return blocks.map(block => [block.scrollWidth, block.clientWidth])"
    )
    assert widths
    assert all(needed <= given for needed, given in widths)


def test_dark_and_light_are_a_click(driver: Any, site: Site) -> None:
    open_page(driver, site.folder / "index.html", 1280)
    schemes = set()
    for _ in range(2):
        schemes.add(driver.execute_script("return document.body.dataset.mdColorScheme"))
        driver.execute_script(
            "document.querySelector('label.md-header__button[for^=__palette]:not([hidden])').click()"
        )
    assert schemes == {"default", "slate"}


def test_the_search_works_without_a_server(driver: Any, site: Site) -> None:
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import WebDriverWait

    open_page(driver, site.folder / "start" / "glossary.html", 1280)
    field = driver.find_element(By.CSS_SELECTOR, ".md-search__input")
    driver.execute_script("arguments[0].focus()", field)
    told = "return document.querySelector('.md-search-result__meta').textContent"
    wait = WebDriverWait(driver, 20, 0.05)
    wait.until(lambda _: "start searching" in driver.execute_script(told))
    field.send_keys("roughness")
    wait.until(lambda _: "matching documents" in driver.execute_script(told))
    assert [url for url in requests(driver) if not url.startswith(LOCAL)] == []
