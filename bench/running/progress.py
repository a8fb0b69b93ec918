"""Progress of long work, shown as a bar with the time left, and the memory that it took."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar


def peak_memory() -> int:
    """Peak resident bytes of this process plus those of its largest child that has ended.

    Zero on Windows, where the number is not available.

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
    processes = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(resource.getrusage(who).ru_maxrss for who in processes) * unit


Progress = Callable[[int, int, str], None]
"""Called with the number done, the number in all, and the label of what comes next."""


def silent(_done: int, _total: int, _label: str) -> None:
    """Progress that is shown nowhere."""


def with_progress(console: Console, label: str, work: Callable[[Progress], Any]) -> Any:
    """Call `work` under a progress bar on the console, if that is a terminal; return its value."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(label, total=None)

        def show(done: int, total: int, next_label: str) -> None:
            bar.update(task, completed=done, total=total, description=next_label)

        return work(show)
