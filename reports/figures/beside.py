"""Draw figures here and, at the same time, in another process."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from malus.reports.figures.drawings import Drawing, Picture, picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Elsewhere = Callable[..., Iterable[Any]]
"""Called with a function and its arguments: yields what that yields in another process."""


class _NotDrawn(Exception):  # no error: the figure is drawn here then
    """The other process did not draw the figure."""


class Draughtsman:
    """Draws figures, and shares them with another process.

    That begins with the first. Here they are drawn from the last on, once one is asked for.

    Parameters
    ----------
    drawings : sequence of Drawing
    with_png : bool
        Draw each as PNG too.
    elsewhere : Elsewhere, optional
        Without it all are drawn here. What it cannot draw is drawn here as well.
    """

    def __init__(
        self,
        drawings: Sequence[Drawing],
        with_png: bool = False,
        elsewhere: Elsewhere | None = None,
    ) -> None:
        self._with_png = with_png
        self._waiting = deque(drawings)
        self._pictures: dict[str, Future[Picture]] = {d.name: Future() for d in drawings}
        self.drawings = tuple(
            replace(drawing, drawn=partial(self._picture, drawing)) for drawing in drawings
        )
        if elsewhere is not None:
            threading.Thread(target=self._draw_elsewhere, args=(elsewhere,), daemon=True).start()

    def _picture(self, drawing: Drawing) -> Picture:
        """The picture of a drawing; until it is there, others that wait are drawn."""
        wanted = self._pictures[drawing.name]
        while not wanted.done():
            try:
                own = self._waiting.pop()
            except IndexError:
                break
            self._pictures[own.name].set_result(picture(own.draw, self._with_png))
        try:
            return wanted.result()
        except _NotDrawn:
            return picture(drawing.draw, self._with_png)

    def _draw_elsewhere(self, elsewhere: Elsewhere) -> None:
        while True:
            try:
                drawing = self._waiting.popleft()
            except IndexError:
                return
            try:
                (drawn,) = elsewhere(_drawn, drawing.draw, self._with_png)
            except Exception:  # also a process that died
                self._pictures[drawing.name].set_exception(_NotDrawn())
                return
            self._pictures[drawing.name].set_result(drawn)


def _drawn(draw: Callable[[], Figure], with_png: bool) -> Iterator[Picture]:
    yield picture(draw, with_png)
