"""Descriptions in the reference of Python: what griffe takes for types in docstrings.

Docstrings here say `name : what it is, in which unit`, because the code itself holds the types.
To numpydoc what follows the colon is a type, and the description would be empty. Configured in
`reports/mkdocs.yml`.
"""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

_SECTION = re.compile(
    r"^((?:Parameters|Attributes)\n-+\n)(.*?)(?=^\w[^\n]*\n---|\Z)", re.MULTILINE | re.DOTALL
)
_ITEM = re.compile(r"^(\*{0,2}\w[\w, *]*) : ([^\n]+)\n((?:[ \t]+\S[^\n]*\n|\n(?=[ \t]+\S))*)", re.M)


class DescribedItems(Extension):
    """Griffe reads every docstring with its descriptions as descriptions."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Rewrite the docstring of an object."""
        if obj.docstring is not None:
            obj.docstring.value = described(obj.docstring.value)


def described(docstring: str) -> str:
    r"""A docstring in which what is said of a parameter or attribute is its description.

    An item of one line has no type: the code has it. Where a text below begins with a small letter
    it goes on with the line; otherwise the line is a type, and stays one.

    Examples
    --------
    >>> print(described("A.\n\nParameters\n----------\nfov : angle of view,\n    in degrees\n"))
    A.
    <BLANKLINE>
    Parameters
    ----------
    fov
        angle of view,
        in degrees
    >>> print(described("A.\n\nAttributes\n----------\nfov : float\n    Angle of view.\n"))
    A.
    <BLANKLINE>
    Attributes
    ----------
    fov : float
        Angle of view.
    """
    return _SECTION.sub(_section, f"{docstring}\n").removesuffix("\n")


def _section(section: re.Match[str]) -> str:
    return section[1] + _ITEM.sub(_item, section[2])


def _item(item: re.Match[str]) -> str:
    names, line, below = item.groups()
    if below.strip() and not below.lstrip()[0].islower():
        return item[0]
    return "".join(f"{name}\n    {line}\n{below}" for name in names.split(", "))
