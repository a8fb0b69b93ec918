"""TOML tables that malus brings, and look-up by name with suggestions for a wrong one."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import PurePath
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator

from malus.scenes.core.errors import InputError
from malus.scenes.core.validation import near

Item = TypeVar("Item")


def _no_path(name: str) -> str:
    if name.startswith(".") or set(name) & {"/", "\\"}:
        raise ValueError("a name without slashes that does not begin with a dot")
    return name


FolderName = Annotated[str, AfterValidator(_no_path)]
"""Text that can name a folder: without slashes, not beginning with a dot."""


def table(name: str) -> dict[str, Any]:
    """Read the TOML file of that name in `malus/scenes/data`."""
    return tomllib.loads(resources.files("malus.scenes").joinpath("data", name).read_text("utf-8"))


def several(given: Iterable[Item] | PurePath) -> tuple[Item, ...]:
    """Names or paths as a tuple; a text or a path that is given alone is a tuple of one.

    To Python a text is a sequence of letters.

    Examples
    --------
    >>> several("gold"), several(["gold", "iron"])
    (('gold',), ('gold', 'iron'))
    """
    return (given,) if isinstance(given, str | PurePath) else tuple(given)  # type: ignore[return-value]


def lookup(name: str, items: Mapping[str, Item], where: str, expected: str = "") -> Item:
    """The item of that name.

    Parameters
    ----------
    name : str
    items : mapping by name
    where, expected : str
        Parts of the error message; by default the name of a `where` is expected.

    Raises
    ------
    InputError
        For an unknown name; the message suggests the closest ones.

    Examples
    --------
    >>> lookup("gold", {"gold": 79}, "metal")
    79
    """
    if name in items:
        return items[name]
    hint = near(name, items) or f"known: {', '.join(items)}"
    raise InputError(where, expected or f"the name of a {where}", repr(name), hint)
