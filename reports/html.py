"""HTML from functions: text is escaped unless it is `Markup`, so that none slips through."""

from __future__ import annotations

from malus.reports.tables.formats import markup
from malus.reports.tables.text_tables import TextTable

_VOID = frozenset({"br", "img", "input", "link", "meta"})


class Markup(str):
    """A string that is HTML already."""

    __slots__ = ()


def tag(name: str, /, *children: str, **attributes: str | bool) -> Markup:
    """An element; `class_` and `for_` lose their underscore, other underscores become hyphens.

    Examples
    --------
    >>> tag("p", "a < b", tag("b", "c"), class_="note", data_x='"')
    '<p class="note" data-x="&quot;">a &lt; b<b>c</b></p>'
    """
    head = name + "".join(_attribute(key, value) for key, value in attributes.items())
    if name in _VOID:
        return Markup(f"<{head}>")
    return Markup(f"<{head}>{join(*children)}</{name}>")


def _attribute(key: str, value: str | bool) -> str:
    if value is False:
        return ""
    name = key.rstrip("_").replace("_", "-")
    return f" {name}" if value is True else f' {name}="{markup(value)}"'


def join(*children: str) -> Markup:
    """Children one after the other, text escaped.

    Examples
    --------
    >>> join("<", Markup("<b>"))
    '&lt;<b>'
    """
    return Markup("".join(c if isinstance(c, Markup) else markup(c) for c in children))


def scrolling(content: Markup, label: str) -> Markup:
    """A box that scrolls sideways on a narrow screen, also by keyboard."""
    return tag("div", content, class_="scroll", tabindex="0", role="region", aria_label=label)


def table(found: TextTable, caption: str) -> Markup:
    """A table whose first column heads its lines."""
    heads = tag("tr", *(tag("th", head, scope="col") for head in found.heads))
    lines = [
        tag("tr", tag("th", line[0], scope="row"), *(tag("td", cell) for cell in line[1:]))
        for line in found.lines
    ]
    whole = tag("table", tag("caption", caption), tag("thead", heads), tag("tbody", *lines))
    return scrolling(whole, caption)


def folded(summary: str, *content: str, **attributes: str | bool) -> Markup:
    """Something to open."""
    return tag("details", tag("summary", summary), *content, **attributes)
