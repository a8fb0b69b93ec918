"""Every example in a docstring runs, and public things have one."""

from __future__ import annotations

import ast
import builtins
import doctest
import importlib
import inspect
import pkgutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from types import ModuleType

import pytest

import malus
import malus.bench
import malus.reconstruct
import malus.renderers
import malus.reports
import malus.scenes

PACKAGES = (malus.scenes, malus.renderers, malus.reconstruct, malus.bench, malus.reports)
MODULES = [
    importlib.import_module(entry.name)
    for package in PACKAGES
    for entry in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
]


@pytest.mark.parametrize("module", MODULES, ids=lambda m: m.__name__)
def test_examples_run(module: ModuleType) -> None:
    result = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    assert result.failed == 0


def test_the_examples_were_found() -> None:
    finder = doctest.DocTestFinder()
    examples = sum(len(t.examples) for module in MODULES for t in finder.find(module))
    assert examples >= 300  # a finder that misses folders would pass with fewer


PASTED = {*malus.__all__, *dir(builtins), "malus", "np", "Path"}
"""Names that the reference tells to import before an example is pasted."""


def examples_of(name: str) -> Iterator[str]:
    """Code of the examples of a public name, and of each of its members."""
    value = getattr(malus, name)
    members = vars(value) if inspect.isclass(value) else {}
    for one in (value, *(m for name, m in members.items() if not name.startswith("_"))):
        function = getattr(one, "fget", None) or getattr(one, "__func__", one)
        text = getattr(function, "__doc__", None)
        if isinstance(text, str) and (inspect.isroutine(function) or one is value):
            yield "".join(e.source for e in doctest.DocTestParser().get_examples(text))


@pytest.mark.parametrize("name", malus.__all__)
def test_examples_may_be_pasted(name: str) -> None:
    """Every name in them is imported by the reference's own lines, or made in the example."""
    for code in examples_of(name):
        nodes = list(ast.walk(ast.parse(code)))
        imports = [n for n in nodes if isinstance(n, ast.Import | ast.ImportFrom)]
        made = {a.asname or a.name.split(".")[0] for n in imports for a in n.names}
        made |= {n.name for n in nodes if isinstance(n, ast.FunctionDef | ast.ClassDef)}
        made |= {n.arg for n in nodes if isinstance(n, ast.arg)}
        used = [n for n in nodes if isinstance(n, ast.Name)]
        made |= {n.id for n in used if isinstance(n.ctx, ast.Store)}
        assert {n.id for n in used} <= made | PASTED, code


UNIONS = ("Light", "Shape")
"""Annotations of several classes: they have no docstring of their own."""


@pytest.mark.parametrize("name", sorted(set(malus.__all__) - set(UNIONS)))
def test_public_names_are_documented(name: str) -> None:
    """One sentence, an example that runs, and for functions parameters, results and errors."""
    value = getattr(malus, name)
    doc = inspect.getdoc(value) or ""
    assert doc.split("\n\n")[0].endswith("."), "begins with a sentence"
    assert "Examples\n--------\n" in doc
    assert ">>>" in doc
    if inspect.isfunction(value):
        signature = inspect.signature(value)
        for section in ("Parameters", "Returns") if signature.parameters else ():
            assert f"{section}\n---" in doc, section
        if any(isinstance(node, ast.Raise) for node in ast.walk(source_of(value))):
            assert "Raises\n---" in doc


def source_of(value: object) -> ast.AST:
    return ast.parse(textwrap.dedent(inspect.getsource(value)))  # type: ignore[arg-type]


def test_public_names_of_packages_are_public_names() -> None:
    assert {*malus.scenes.__all__, *malus.reconstruct.__all__} <= {*malus.__all__}
    for package in PACKAGES:
        for name in package.__all__:
            assert inspect.getdoc(getattr(package, name)), f"{package.__name__}.{name}"


def test_public_names_are_told_without_being_imported() -> None:
    script = "import sys, malus; assert malus.__version__; print(*dir(malus)); "
    script += "assert 'malus.bench' not in sys.modules"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert {"__version__", *malus.__all__} <= {*done.stdout.split()}


def test_a_bare_import_imports_nothing_of_weight() -> None:
    """Under 0.1 s: what takes longer is imported when it is used."""
    script = "import sys, malus; print(sum(m.split('.')[0] == 'malus' for m in sys.modules), "
    script += "'numpy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["1", "False"]
