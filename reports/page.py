"""The page: one HTML file that needs no network and no other file."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib import resources

from malus.reports.html import Markup, join, tag
from malus.reports.section import Section

PAGE = "report.html"

_SCRIPTS = ("stokes.js", "panel.js", "readout.js", "viewer.js", "page.js")


def page(name: str, description: str, sections: Sequence[Section]) -> str:
    """The whole page.

    Nothing is loaded from anywhere, and the content security policy forbids it: only the page's
    own script runs, known by its hash.

    Parameters
    ----------
    name, description : str
        Of the suite or study.
    sections : sequence of Section
    """
    script = script_text()
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=_policy(script)),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", f"malus: {name}"),
        tag("link", rel="icon", href="data:,"),
        tag("style", Markup(_asset("page.css"))),
    )
    body = tag(
        "body",
        _header(name, description, sections),
        tag("main", *map(_section, sections)),
        tag("script", Markup(script)),
    )
    return "<!doctype html>\n" + tag("html", head, body, lang="en") + "\n"


def script_text() -> str:
    """The page's script; its parts share one scope that no other script sees."""
    parts = "\n".join(_asset(name) for name in _SCRIPTS)
    return f'(() => {{\n"use strict";\n{parts}}})();\n'


def _policy(script: str) -> str:
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    allowed = ("default-src 'none'", f"script-src 'sha256-{digest}'", "img-src data:")
    return "; ".join((*allowed, "style-src 'unsafe-inline'", "base-uri 'none'"))


def _asset(name: str) -> str:
    return (resources.files("malus.reports") / "assets" / name).read_text("utf-8")


def _header(name: str, description: str, sections: Sequence[Section]) -> Markup:
    links = [tag("a", section.title, href=f"#{section.name}") for section in sections]
    toggle = tag("button", "Dark", id="theme", type="button", aria_pressed="false")
    return tag(
        "header",
        tag("div", tag("h1", "malus ", tag("span", name)), toggle, class_="top"),
        tag("p", description),
        tag("nav", *links, aria_label="Sections"),
    )


def _section(section: Section) -> Markup:
    title = tag("h2", section.title, id=f"{section.name}-title")
    content = join(title, section.content)
    return tag("section", content, id=section.name, aria_labelledby=f"{section.name}-title")
