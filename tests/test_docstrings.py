"""Every example in a docstring runs, and public things have one."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil
from types import ModuleType

import pytest

import malus.bench
import malus.reconstruct
import malus.renderers
import malus.reports
import malus.scenes

PACKAGES = (malus.scenes, malus.renderers, malus.reconstruct, malus.bench, malus.reports)
MODULES = [
    importlib.import_module(found.name)
    for package in PACKAGES
    for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
]


@pytest.mark.parametrize("module", MODULES, ids=lambda m: m.__name__)
def test_examples_run(module: ModuleType) -> None:
    result = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    assert result.failed == 0


def test_the_examples_were_found() -> None:
    finder = doctest.DocTestFinder()
    examples = sum(len(t.examples) for module in MODULES for t in finder.find(module))
    assert examples >= 300  # a finder that misses folders would pass with fewer


@pytest.mark.parametrize("package", PACKAGES[:4], ids=lambda p: p.__name__)
def test_public_names_are_documented(package: ModuleType) -> None:
    assert package.__all__
    for name in package.__all__:
        thing = getattr(package, name)
        doc = inspect.getdoc(thing)
        assert doc, name
