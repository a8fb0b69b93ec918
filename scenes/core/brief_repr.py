"""A representation in one line of objects that hold arrays: their shapes in place of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

_MOST_CHARACTERS = 60
"""Of a value that is no array; the rest is left out."""


def brief_repr(self: Any) -> str:
    """Class and fields of a data class or named tuple in one line, without what is None or empty.

    Data classes take it as their `__repr__`: NumPy's own would fill a terminal for every array.

    Examples
    --------
    >>> import dataclasses
    >>> import numpy as np
    >>> @dataclasses.dataclass
    ... class Picture:
    ...     light: np.ndarray
    ...     name: str = "ball"
    ...     mask: np.ndarray | None = None
    ...     __repr__ = brief_repr
    >>> Picture(np.zeros((4, 6, 3), np.float32))
    Picture(light=<float32 4 × 6 × 3>, name='ball')
    """
    names = getattr(self, "_fields", ()) or [field.name for field in fields(self)]
    values = ((name, getattr(self, name)) for name in names)
    told = ", ".join(f"{name}={_brief(value)}" for name, value in values if not _empty(value))
    return f"{type(self).__name__}({told})"


def _empty(value: Any) -> bool:
    return value is None or (isinstance(value, Mapping | tuple) and not value)


def _brief(value: Any) -> str:
    """Type and shape of what has one, the beginning of anything else."""
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple):
        kind = getattr(value, "dtype", type(value).__name__)
        return f"<{kind} {' × '.join(map(str, shape))}>" if shape else repr(value)
    if isinstance(value, Mapping):
        return f"<{len(value)} by name: {_cut(', '.join(map(str, value)))}>"
    return _cut(" ".join(repr(value).split()))


def _cut(text: str) -> str:
    return text if len(text) <= _MOST_CHARACTERS else text[: _MOST_CHARACTERS - 1] + "…"
