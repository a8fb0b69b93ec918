"""Writes api.md, the reference of the public names, from their docstrings: run it in any folder."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path
from types import ModuleType

REFERENCE = Path(__file__).parents[2] / "reports" / "docs" / "api.md"
PACKAGES = ("scenes", "renderers", "reconstruct", "bench", "reports")
UNIONS = ("Light", "Shape")
"""Annotations of several classes: they have no docstring of their own."""

HEAD = """# The public names

Written from the docstrings by `bench/documents/api_reference.py`. `python -m pydoc
malus.scenes.Scene` prints one in the terminal. Other modules may change without notice.
"""


def reference() -> str:
    """The whole page."""
    return "\n".join([HEAD, *(_package(name) for name in PACKAGES)])


def _package(name: str) -> str:
    module = importlib.import_module(f"malus.{name}")
    title = f"## malus.{name}\n\n{inspect.getdoc(module)}\n"
    return "\n".join([title, *(_entry(module, public) for public in sorted(module.__all__))])


def _entry(module: ModuleType, name: str) -> str:
    thing = getattr(module, name)
    if name in UNIONS:
        return f"### {name}\n\nAny of the classes above and below whose `kind` a suite may name.\n"
    return f"### {name}\n\n```text\n{inspect.getdoc(thing)}\n```\n"


if __name__ == "__main__":
    REFERENCE.write_text(reference(), encoding="utf-8", newline="\n")
