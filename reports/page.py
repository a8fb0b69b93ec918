"""The page: one HTML file that needs no network and no other file."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from malus.reports.templates.render import asset, render

PAGE = "report.html"

_SCRIPTS = ("stokes.js", "panel.js", "readout.js", "viewer.js", "page.js")


@dataclass(frozen=True)
class Section:
    """A part of the page: the name in its address, a title and what it shows."""

    name: str
    title: str
    content: Markup


def page(name: str, description: str, sections: Sequence[Section]) -> str:
    """The whole page as HTML.

    Nothing is loaded from anywhere, and the content security policy forbids it: only the page's
    own script runs, known by its hash.

    Parameters
    ----------
    name, description : str
        Of the suite or study.
    sections : sequence of Section
    """
    script = script_text()
    return render(
        "page.html",
        name=name,
        description=description,
        sections=sections,
        policy=_policy(script),
        style=Markup(asset("page.css")),
        script=Markup(script),
    )


def script_text() -> str:
    """The page's script; its parts share one scope that no other script sees."""
    parts = "\n".join(asset(name) for name in _SCRIPTS)
    return f'(() => {{\n"use strict";\n{parts}}})();\n'


def _policy(script: str) -> str:
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    allowed = ("default-src 'none'", f"script-src 'sha256-{digest}'", "img-src data:")
    return "; ".join((*allowed, "style-src 'unsafe-inline'", "base-uri 'none'"))
