"""What commands write to: names and paths stand there as they are."""

from __future__ import annotations

from rich.console import Console


def plain_console(stderr: bool = False, soft_wrap: bool = False) -> Console:
    """A console that reads no markup and no emoji in what it prints, nor colours numbers.

    Examples
    --------
    >>> plain_console().print("x[/b] [red] :smile:")
    x[/b] [red] :smile:
    """
    return Console(stderr=stderr, soft_wrap=soft_wrap, markup=False, emoji=False, highlight=False)
