"""The first problem that pydantic finds in untrusted data, as an InputError of one line."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from malus.scenes.core.errors import InputError

_EXPECTED = {
    "missing": "this key",
    "too_short": "at least {min_length} item(s)",
    "too_long": "at most {max_length} items",
    "string_too_short": "at least {min_length} character(s)",
    "string_too_long": "at most {max_length} characters",
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "dict_type": "a table of keys",
    "model_type": "a table of keys",
    "model_attributes_type": 'a table with a kind: {{ kind = "…" }}',
    "union_tag_not_found": 'a kind: {{ kind = "…" }}',
    "union_tag_invalid": "one of {expected_tags}",
}
"""Expectations by pydantic's type of error; other types keep pydantic's message."""


def first_problem(error: ValidationError, data: Any, where: str) -> InputError:
    """The first problem of a ValidationError of `data`; `where` names the file."""
    told = error.errors(include_url=False)
    problems = [p for p in told if not _follows(p)] or told
    # Where a value may be one of several types, the deepest complaint is about the one meant.
    first = max(problems, key=lambda problem: len(problem["loc"]))
    cause = first.get("ctx", {}).get("error")
    key = _key(first["loc"], data)
    if isinstance(cause, InputError):
        inside = f"{where}, key {key}" if key else where
        return InputError(f"{inside}, {cause.where}", cause.expected, cause.found, cause.hint)
    missing = first["type"] == "missing"
    if missing:
        key = ".".join(filter(None, (key, str(first["loc"][-1]))))
    if first["type"] == "union_tag_invalid":
        key, found = f"{key}.kind", repr(first["ctx"]["tag"])
    else:
        value = first["input"]
        found = "nothing" if missing else repr(list(value) if isinstance(value, tuple) else value)
    more = f"; {len(problems) - 1} more problem(s) follow" if len(problems) > 1 else ""
    return InputError(
        where=f"{where}, key {key or '(top level)'}",
        expected=_expectation(first),
        found=found,
        hint=("add this key" if missing else _nearest(first)) + more,
    )


def near(name: object, names: Iterable[str]) -> str:
    """A question that suggests the most similar names, or an empty string where none is.

    Examples
    --------
    >>> near("sphre", ["sphere", "torus"])
    'did you mean sphere?'
    """
    close = difflib.get_close_matches(str(name).lower(), names, n=3, cutoff=0.5)
    return f"did you mean {' or '.join(close)}?" if close else ""


def _follows(problem: Mapping[str, Any]) -> bool:
    """Whether a list counts as too short only because its items were refused."""
    return problem["type"] == "too_short" and bool(problem["input"])


def _key(loc: tuple[int | str, ...], data: Any) -> str:
    """The key in the data of a pydantic location, without the names of the types of a union."""
    parts = []
    for part in loc:
        if part in data if isinstance(data, Mapping) else _has_item(data, part):
            data = data[part]
            parts.append(str(part))
    return ".".join(parts)


def _has_item(data: Any, part: int | str) -> bool:
    return isinstance(data, list | tuple) and isinstance(part, int) and part < len(data)


def _expectation(problem: Mapping[str, Any]) -> str:
    """What would have been right, in words."""
    if problem["type"] in _EXPECTED:
        return _EXPECTED[problem["type"]].format(**problem.get("ctx", {})).replace("'", "")
    message: str = problem["msg"]
    for prefix in ("Input should be ", "Value error, "):
        message = message.removeprefix(prefix)
    return message


def _nearest(problem: Mapping[str, Any]) -> str:
    """What to do: take the most similar of the allowed names, where there are any."""
    context = problem.get("ctx", {})
    value = context.get("tag", problem["input"])
    names = re.findall("'([^']*)'", context.get("expected_tags", context.get("expected", "")))
    return (near(value, names) if isinstance(value, str) else "") or "correct this value"
