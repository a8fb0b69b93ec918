"""What commands write to: names and paths stand there as they are."""

from __future__ import annotations

from rich.console import Console

NARROWEST = 80
"""Columns that tables take at least: in fewer, columns would be left out and numbers be cut."""


def plain_console(stderr: bool = False, soft_wrap: bool = False) -> Console:
    """A console that reads no markup and no emoji in what it prints, nor colours numbers.

    A narrower terminal breaks the lines of tables; sentences on the error stream, and the bar of
    progress there, fit into it.

    Examples
    --------
    >>> plain_console().print("x[/b] [red] :smile:")
    x[/b] [red] :smile:
    """
    console = Console(
        stderr=stderr, soft_wrap=soft_wrap, markup=False, emoji=False, highlight=False
    )
    if console.width < (1 if stderr else NARROWEST):  # 0 in terminals that tell no size
        console.width = NARROWEST
    return console
