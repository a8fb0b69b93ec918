"""How far long work is: told to whoever asks, or shown as a bar with the time left."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar


def peak_memory() -> int:
    """Peak resident bytes of this process plus those of its largest child that has ended.

    Zero on Windows, which does not tell.

    Examples
    --------
    >>> peak_memory() >= 0
    True
    """
    try:
        import resource
    except ImportError:
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    asked = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(resource.getrusage(who).ru_maxrss for who in asked) * unit


Progress = Callable[[int, int, str], None]
"""Called with what is done, all there is, and the label of what comes next."""


def silent(_done: int, _total: int, _label: str) -> None:
    """Progress that nobody watches."""


def with_progress(console: Console, what: str, work: Callable[[Progress], Any]) -> Any:
    """Do some work under a progress bar on the console, and return what it returns."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Bar(*columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=None)

        def show(done: int, total: int, label: str) -> None:
            bar.update(task, completed=done, total=total, description=label)

        return work(show)
