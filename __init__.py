"""Synthetic ground truth for methods that tell polarisation from one unpolarised image.

Everything that the command line does is here as a function that returns values and prints nothing:
`malus.run("quick", out="results/quick")`. `__init__.pyi` lists the public names, for this module
and for type checkers; each is imported when it is first used.
"""

from __future__ import annotations

from typing import Any

from lazy_loader import attach_stub

_imported, _, __all__ = attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """A public name, imported from its module when it is first used."""
    if name == "__version__":
        from importlib.metadata import version

        return version("malus")
    return _imported(name)


def __dir__() -> list[str]:
    """Public names, those not imported yet among them."""
    return sorted({*globals(), *__all__, "__version__"})
