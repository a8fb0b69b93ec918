"""Tables of named things that malus brings, and the way to one of them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib import resources
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
"""A name that a folder may have."""


def table(name: str) -> dict[str, Any]:
    """The content of the TOML file of that name among malus' data."""
    return tomllib.loads(resources.files("malus.scenes").joinpath("data", name).read_text("utf-8"))


def lookup(name: str, known: Mapping[str, Item], where: str, expected: str = "") -> Item:
    """What is known under that name.

    Parameters
    ----------
    name : str
    known : mapping by name
    where, expected : str
        Of the message; by default the name of a `where` is expected.

    Raises
    ------
    InputError
        For an unknown name; tells the closest ones.

    Examples
    --------
    >>> lookup("gold", {"gold": 79}, "metal")
    79
    """
    if name in known:
        return known[name]
    hint = near(name, known) or f"known: {', '.join(known)}"
    raise InputError(where, expected or f"the name of a {where}", repr(name), hint)
