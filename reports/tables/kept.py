"""What is computed once of each table, though a summary and a page both show it."""

from __future__ import annotations

import functools
import weakref
from collections.abc import Callable
from typing import Concatenate, ParamSpec, TypeVar

import pandas as pd

Made = TypeVar("Made")
Options = ParamSpec("Options")


def kept(
    make: Callable[Concatenate[pd.DataFrame, Options], Made],
) -> Callable[Concatenate[pd.DataFrame, Options], Made]:
    """Keep what a function makes of a table for as long as that table lives.

    Nobody writes into a table of which something was made, nor into what was made of it.

    Examples
    --------
    >>> asked = []
    >>> rows = kept(lambda table: asked.append("rows") or len(table))
    >>> table = pd.DataFrame({"value": [1.0, 2.0]})
    >>> rows(table), rows(table), rows(table[:1]), asked
    (2, 2, 1, ['rows', 'rows'])
    """
    by_table: dict[int, dict[object, Made]] = {}

    @functools.wraps(make)
    def made(table: pd.DataFrame, /, *values: Options.args, **named: Options.kwargs) -> Made:
        if id(table) not in by_table:
            by_table[id(table)] = {}
            weakref.finalize(table, by_table.pop, id(table))
        own, asked = by_table[id(table)], (values, tuple(sorted(named.items())))
        if asked not in own:
            own[asked] = make(table, *values, **named)
        return own[asked]

    return made
