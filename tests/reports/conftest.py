"""Results to report, pages of them, and the browser that tests open the pages in."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from browser import Browser, chromium
from viewed_scenes import (
    COLOURED_NM,
    EVIL,
    coloured_stokes,
    disc,
    mixed_part,
    save_example,
    stokes_image,
)

from malus.reports import write_report
from malus.reports.tables import sample
from malus.scenes.core.arrays import Float32Array


@pytest.fixture
def table() -> pd.DataFrame:
    return sample.table()


@pytest.fixture(scope="session")
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


@pytest.fixture(scope="session")
def coloured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of one scene with three bands: it opens in colour."""
    folder = tmp_path_factory.mktemp("coloured")
    meta = {"scene": f"{0:016x}", "label": "a disc", "wavelengths_nm": COLOURED_NM}
    (folder / "examples").mkdir()
    np.savez(folder / "examples" / f"{0:016x}.npz", truth=coloured_stokes(1), mask=disc(),
             meta=np.array(json.dumps(meta)), **{"method.eq8": coloured_stokes(2)})  # fmt: skip
    run = sample.run() | {"command": f"malus run '{EVIL}'"}
    write_report(SimpleNamespace(table=sample.table(), run=run), folder)
    return folder / "report.html"


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    driver = chromium(tmp_path_factory.mktemp("chromium"))
    driver.set_script_timeout(20)
    yield Browser(driver)
    driver.quit()


@pytest.fixture
def opened(browser: Browser, report: Path) -> Browser:
    browser.open(report)
    return browser
