"""Names and numbers as text: escaped for Markdown, rounded for a reader."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from malus.scenes.core.errors import printable

if TYPE_CHECKING:
    import pandas as pd

_MARKDOWN = r"\`*[]|~$"
_MARKDOWN_FIRST = _MARKDOWN + "#+-=_"
_REFERENCES = {"<": "&lt;", ">": "&gt;", "&": "&amp;"}

NO_NUMBER = "–"
"""Stands where a table has no number."""


def as_csv(table: pd.DataFrame) -> str:
    """A table as CSV with every digit, however NumPy is set to print numbers.

    Examples
    --------
    >>> import pandas as pd
    >>> as_csv(pd.DataFrame({"error": [1 / 3]})).splitlines()
    ['error', '0.3333333333333333']
    """
    import numpy as np

    with np.printoptions(legacy=False):
        return table.to_csv(index=False, lineterminator="\n")


def markdown(name: str) -> str:
    r"""A name escaped for Markdown: nothing in it becomes markup.

    Examples
    --------
    >>> markdown("a|b *c* <i>")
    'a\\|b \\*c\\* &lt;i&gt;'
    """
    first, rest = printable(name)[:1], printable(name)[1:]
    # Inside a word a hyphen or an underscore is harmless, and most names contain one.
    return _marked(first, _MARKDOWN_FIRST) + _marked(rest, _MARKDOWN)


def _marked(text: str, special: str) -> str:
    return "".join("\\" + c if c in special else _REFERENCES.get(c, c) for c in text)


def scientific(value: float) -> str:
    """Two significant digits, short exponent; a dash where there is no number.

    Examples
    --------
    >>> scientific(0.000412), scientific(0.0), scientific(float("nan"))
    ('4.1e-4', '0', '–')
    """
    if not math.isfinite(value):
        return NO_NUMBER
    if value == 0.0:
        return "0"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def error_text(value: float) -> str:
    """An error of a method that was scored: only an estimate that is not finite has no number.

    Examples
    --------
    >>> error_text(0.000412), error_text(float("nan"))
    ('4.1e-4', 'not finite')
    """
    return scientific(value) if math.isfinite(value) else "not finite"


def skill_text(value: float) -> str:
    """A skill: more digits the closer it is to 1; a dash where there is none to report.

    Examples
    --------
    >>> skill_text(0.99974), skill_text(0.5), skill_text(-63.8), skill_text(float("nan"))
    ('0.9997', '0.50', '−64', '–')
    >>> skill_text(-0.001)
    '0.00'
    """
    if not math.isfinite(value):
        return NO_NUMBER
    digits = 4 if value > 0.99 else 2 if value > -10 else 0
    text = f"{value:.{digits}f}"
    return text.replace("-", "−" if float(text) else "")  # 0.00 has no sign


def duration(seconds: float) -> str:
    """Seconds in the unit that people would use.

    Examples
    --------
    >>> duration(0.5), duration(90.4), duration(600.0), duration(86400.0)
    ('0.50 s', '90 s', '10 min', '24.0 h')
    >>> duration(9.99), duration(119.0), duration(7199.0)
    ('9.99 s', '119 s', '120 min')
    """
    if seconds < 10.0:
        return f"{seconds:.2f} s"
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200.0 else f"{seconds / 3600:.1f} h"


def listed(words: list[str]) -> str:
    """Words with commas and an "and".

    Examples
    --------
    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))
