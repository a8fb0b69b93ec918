"""HTML from the templates of this folder; all values are escaped unless they are Markup."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from malus.scenes.core.errors import printable


def render(template: str, **values: Any) -> Markup:
    """A template with its values filled in.

    Parameters
    ----------
    template : str
        Name of a file in this folder.
    values
        By the names that the template uses; text is escaped, also its control characters.

    Raises
    ------
    jinja2.UndefinedError
        If the template uses a name that is not given.

    Examples
    --------
    >>> values = {"explanation": "a < b", "tiles": [], "lines": [], "drawings": [], "origin": ""}
    >>> print(render("figures.html", **values))
    <p>a &lt; b</p>
    """
    return Markup(_environment().get_template(template).render(values).strip())


def asset(name: str) -> str:
    """Text of a file of `reports/assets`."""
    return (resources.files("malus.reports") / "assets" / name).read_text("utf-8")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("malus.reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_finalised,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # Of the filter `tojson`, which also escapes what would end a script element.
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return environment


def _finalised(value: object) -> object:
    return value if isinstance(value, Markup) else printable(str(value))
