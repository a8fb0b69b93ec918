"""Pages of the reference that are made from data: keys of a suite, metrics, methods and suites."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import malus
from malus.bench.public.lists import list_methods, list_metrics, list_suites
from malus.scenes.suite import Suite


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    r"""A table in Markdown; a bar in a cell is not a border.

    Examples
    --------
    >>> print(table(["a", "b"], [["1", "x|y"]]))
    | a | b |
    |---|---|
    | 1 | x\|y |
    <BLANKLINE>
    """
    lines = [head, ["---"] * len(head), *rows]
    cells = [[" ".join(str(cell).split()).replace("|", r"\|") for cell in line] for line in lines]
    text = [f"| {' | '.join(line)} |" for line in cells]
    text[1] = "|" + "---|" * len(head)
    return "\n".join([*text, ""])


def suite_page() -> str:
    """Markdown of every key that a suite may have, with type, default and bounds.

    Examples
    --------
    >>> "### Camera" in suite_page()
    True
    """
    schema = Suite.model_json_schema(mode="validation")
    parts = ["# Keys of a suite\n", _SUITE, "## Suite\n", _keys(schema)]
    parts += ["## Tables inside a suite\n"]
    for name, inner in schema["$defs"].items():
        if "properties" in inner:
            parts += [f"### {name}\n", _first_sentences(inner.get("description", "")), _keys(inner)]
    return "\n".join(parts)


_SUITE = """Made from the classes that read a suite, so that it says what is accepted. What the keys
of the first table mean stands in [files](../files.md#a-suite), with examples; guides show
whole suites.
`kind` chooses among the tables of shapes, lights and patterns.
"""


def _first_sentences(description: str) -> str:
    return " ".join(inspect.cleandoc(description).split("\n\n")[0].split()) + "\n"


def _keys(schema: Mapping[str, Any]) -> str:
    required = schema.get("required", ())
    rows = [
        [f"`{key}`", _type(field), _default(field, key in required)]
        for key, field in schema["properties"].items()
        if key != "digest"  # computed from the file
    ]
    return table(["key", "takes", "default"], rows)


def _type(field: Mapping[str, Any]) -> str:
    """A type in words, from its JSON schema."""
    if "$ref" in field:
        name = field["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    if "const" in field:
        return f'`"{field["const"]}"`'
    if "enum" in field:
        return ", ".join(f'`"{value}"`' for value in field["enum"])
    for union in ("anyOf", "oneOf", "allOf"):
        if union in field:
            kinds = [_type(kind) for kind in field[union] if kind.get("type") != "null"]
            return " or ".join(dict.fromkeys(kinds))
    if field.get("type") == "array":
        return _array(field)
    return _NAMES.get(field.get("type", ""), "any value") + _bounds(field)


_NAMES = {
    "string": "a text",
    "integer": "a whole number",
    "number": "a number",
    "boolean": "`true` or `false`",
    "object": "a table",
}


def _array(field: Mapping[str, Any]) -> str:
    if "prefixItems" in field:
        return f"[{', '.join(_type(item) for item in field['prefixItems'])}]"
    return f"a list of: {_type(field.get('items', {}))}"


def _bounds(field: Mapping[str, Any]) -> str:
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    told = [f"{sign} {field[key]:g}" for key, sign in signs.items() if key in field]
    if "multipleOf" in field:
        told.append(f"a multiple of {field['multipleOf']}")
    return f", {', '.join(told)}" if told else ""


def _default(field: Mapping[str, Any], required: bool) -> str:
    if required:
        return "must be given"
    value = field.get("default")
    return "" if value is None else f"`{textwrap.shorten(_toml(value), 60)}`"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        inner = ", ".join(f"{k} = {_toml(v)}" for k, v in value.items() if v is not None)
        return "{ " + inner + " }" if inner else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else str(value)


def metric_page() -> str:
    """Markdown of the definition of every metric.

    Examples
    --------
    >>> "`skill`" in metric_page()
    True
    """
    rows = [
        [f"`{name}`", m.definition, m.unit, m.better, m.asked_for and f"`{m.asked_for}`", m.source]
        for name, m in list_metrics().items()
    ]
    head = ["metric", "definition", "unit", "better", "asked for with", "source"]
    return "\n".join(["# Metrics\n", _METRICS, table(head, rows)])


_METRICS = """What `malus list metrics` and the `metrics.json` beside every report say. Columns and
further names are in [files](../files.md#metrics). A metric without a name under
"asked for with" is in every run.
"""


def list_page() -> str:
    """Markdown of the methods and suites that malus brings.

    Examples
    --------
    >>> "`lights+body`" in list_page()
    True
    """
    return "\n".join(["# Methods and suites\n", "Made from `malus list`.\n", *_lists()])


def _lists() -> Iterator[str]:
    yield "## Methods\n"
    rows = [
        [f"`{name}`", method.summary, ", ".join(sorted(method.needs)) or "nothing else"]
        for name, method in list_methods().items()
    ]
    yield _TOLD
    yield table(["method", "what it is", "is told besides"], rows)
    yield "## Suites\n"
    yield table(
        ["suite", "what it is", "scenes"],
        [[f"`{name}`", s.description, str(s.scene_count)] for name, s in list_suites().items()],
    )
    yield "`malus list` also has materials, metals, surfaces, swatches, patterns, shapes, lights,"
    yield "maps and sensors.\n"


_TOLD = """Every method is told the picture and the mask of what is to be seen in it. `unpolarised`,
`net` and `net-around` can do without a mask, and then take the whole picture.
"""


_API = {
    "scenes": ("Python: scenes and truths", "What to look at, and what a render of it is."),
    "runs": ("Python: runs and data sets", "What the commands do, as functions."),
    "methods": (
        "Python: methods and pictures",
        "What a method is and sees; photographs, captures.",
    ),
}
_PAGES = {
    "malus.renderers.datasets": "runs",
    "malus.scenes": "scenes",
    "malus.renderers": "scenes",
    "malus.reconstruct": "methods",
    "malus.bench": "runs",
}
"""The page of the public names of each package; the first that fits counts."""


def api_pages() -> dict[str, str]:
    """Markdown of the reference of `import malus`, by the name of its page: who made a name, where.

    Examples
    --------
    >>> "::: malus.render\\n" in api_pages()["scenes"]
    True
    """
    names: dict[str, list[str]] = {page: [] for page in _API}
    for name in sorted(malus.__all__, key=str.lower):
        names[
            next(_PAGES[package] for package in _PAGES if _home(name).startswith(package))
        ].append(name)
    return {
        page: "\n".join(
            [
                f"# {title}\n",
                f"{told} All of them are names of `import malus`. {_EXAMPLES}\n",
                *(f"::: malus.{name}\n" for name in names[page]),
            ]
        )
        for page, (title, told) in _API.items()
    }


_EXAMPLES = """Examples may be pasted after `from malus import *`, `import numpy as np` and
`from pathlib import Path`."""


def _home(name: str) -> str:
    """The module that a public name comes from; a union of classes has none and is a scene's."""
    module = str(getattr(getattr(malus, name), "__module__", ""))
    return module if module.startswith("malus.") else "malus.scenes"
