"""Plan, run, score, gate and time suites; the command line. Stands on all other packages.

`malus` has the functions that users call; `run` here takes a Suite and writes no report.
Names are imported when they are first used, so that `malus --help` answers at once.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from malus.bench.running.results import Results, read_results
    from malus.bench.running.runner import run
    from malus.bench.scoring.observe import observe
    from malus.bench.scoring.score import score

__all__ = ["Results", "observe", "read_results", "run", "score"]

_MODULES = {
    "Results": "running.results",
    "observe": "scoring.observe",
    "read_results": "running.results",
    "run": "running.runner",
    "score": "scoring.score",
}
"""Module of each name that is imported when it is first used."""


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value
