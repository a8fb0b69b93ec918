"""Matplotlib's SVG as an element of a page, in the page's colours."""

from __future__ import annotations

import re

from markupsafe import Markup, escape

from malus.scenes.core.errors import printable

# The inks of reports/figures/style.py, which is not imported here: it loads Matplotlib.
_THEMED = {
    "#23232b": "currentColor",
    "#dcdce2": "var(--line)",
    "#8a8a94": "var(--soft)",
    "#f0e3b8": "var(--band)",
    "#7a6312": "var(--band-text)",
    "#d55e00": "var(--c1)",
    "#0072b2": "var(--c2)",
    "#009e73": "var(--c3)",
    "#cc79a7": "var(--c4)",
    "#56b4e9": "var(--c5)",
    "#e69f00": "var(--c6)",
    "#ffffff": "var(--card)",
    "white": "var(--card)",
}


def inlined(svg: str, prefix: str, label: str) -> Markup:
    """An SVG document as an element of a page.

    Parameters
    ----------
    svg : str
        As Matplotlib wrote it.
    prefix : str
        Put before every id, so that two figures of a page do not take each other's marks.
    label : str
        What a screen reader says.
    """
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r'\bid="', f'id="{prefix}-', body)
    body = re.sub(r"url\(#", f"url(#{prefix}-", body)
    body = re.sub(r'href="#', f'href="#{prefix}-', body)
    for ink, variable in _THEMED.items():
        body = re.sub(rf"(fill|stroke): {ink}\b", rf"\1: {variable}", body)
    head, rest = body.split(">", 1)
    size = re.search(r'viewBox="[^"]*"', head)
    box = size.group() if size else ""
    opening = (
        f'<svg {box} role="img" aria-labelledby="{prefix}-title" xmlns="http://www.w3.org/2000/svg"'
        ' xmlns:xlink="http://www.w3.org/1999/xlink">'
    )
    title = f'<title id="{prefix}-title">{escape(printable(label))}</title>'
    return Markup(opening + title + rest)
