"""Figures drawn here and in another process: the same, whoever draws them, and whoever fails."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd
import pytest

from malus.reports.figures.beside import Draughtsman
from malus.reports.figures.drawings import Drawing, drawings
from malus.reports.tables import sample


@pytest.fixture(scope="module")
def plain() -> dict[str, str]:
    return {drawing.name: drawing.picture.svg for drawing in drawings(sample.table())}


def svgs(of: tuple[Drawing, ...]) -> dict[str, str]:
    return {drawing.name: drawing.picture.svg for drawing in of}


class Elsewhere:
    """Runs what it is asked for after `failing` calls; the first of those that fail raises."""

    def __init__(self, works: int) -> None:
        self.works, self.asked, self.ready = works, 0, threading.Event()

    def __call__(self, function: Callable[..., Iterator[Any]], *arguments: Any) -> Iterator[Any]:
        self.asked += 1
        try:
            if self.asked > self.works:
                raise RuntimeError("the process died")
            yield from function(*arguments)
        finally:
            if self.asked >= min(self.works, 3):
                self.ready.set()


@pytest.mark.parametrize("works", [0, 1, 9])
def test_figures_are_the_same_wherever_they_are_drawn(plain: dict[str, str], works: int) -> None:
    elsewhere = Elsewhere(works)
    artist = Draughtsman(list(drawings(sample.table())), elsewhere=elsewhere)
    assert elsewhere.ready.wait(60)  # it has drawn all that it can, before one is asked for here
    assert svgs(artist.drawings) == plain
    assert elsewhere.asked == min(works + 1, len(plain))


def test_figures_are_the_same_whatever_was_imported(plain: dict[str, str]) -> None:
    with np.printoptions(legacy="1.13"):  # as colour-science sets it where it is imported
        assert svgs(tuple(drawings(sample.table()))) == plain


def test_what_is_drawn_elsewhere_is_not_drawn_here(monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = Elsewhere(9)
    artist = Draughtsman(list(drawings(sample.table())), elsewhere=elsewhere)
    assert elsewhere.ready.wait(60)
    monkeypatch.setattr("malus.reports.figures.beside.picture", lambda *_: pytest.fail("drawn"))
    assert all(svg.startswith("<?xml") for svg in svgs(artist.drawings).values())


def test_a_fault_of_a_figure_is_raised_where_it_is_asked_for() -> None:
    drawing = next(drawings(sample.table()))
    broken = Drawing("broken", "", "", pd.DataFrame(), drawing.cells, lambda: 1 / 0)  # type: ignore[arg-type, return-value]
    artist = Draughtsman([broken], elsewhere=Elsewhere(9))
    with pytest.raises(ZeroDivisionError):
        artist.drawings[0].picture  # noqa: B018
