"""The shape of the project: which folder may import which, and how large things may grow."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ORDER = ("scenes", "renderers", "reconstruct", "bench", "reports")
MAY_IMPORT = {
    "scenes": set(),
    "renderers": {"scenes"},
    "reconstruct": {"scenes"},  # never renderers: no method may see a truth
    "bench": {"scenes", "renderers", "reconstruct"},
    "reports": {"scenes", "renderers", "reconstruct", "bench"},
}
EXCEPTIONS = {
    # The command line is where everything meets: it writes the report after a run.
    ("bench/commands/run.py", "reports"),
    ("bench/studies/registry.py", "reports"),
}
LINES_OF_A_MODULE = 250
LINES_OF_A_FUNCTION = 40


def sources(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def imports(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            found += [module] + [f"{module}.{alias.name}" for alias in node.names]
    return found


@pytest.mark.parametrize("folder", ORDER)
def test_imports_point_left(folder: str) -> None:
    for path in sources(folder):
        name = path.relative_to(ROOT).as_posix()
        for module in imports(path):
            parts = module.split(".")
            if parts[0] != "malus" or len(parts) < 2 or parts[1] == folder:
                continue
            allowed = parts[1] in MAY_IMPORT[folder] or (name, parts[1]) in EXCEPTIONS
            assert allowed, f"{name} imports {module}"


@pytest.mark.parametrize("folder", ORDER)
def test_mitsuba_lives_in_renderers_only(folder: str) -> None:
    for path in sources(folder):
        heavy = {module.split(".")[0] for module in imports(path)} & {"mitsuba", "drjit"}
        assert not heavy or folder == "renderers", path


@pytest.mark.parametrize("folder", ORDER)
def test_modules_and_functions_stay_small(folder: str) -> None:
    for path in sources(folder):
        text = path.read_text("utf-8")
        assert len(text.splitlines()) <= LINES_OF_A_MODULE, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                doc = ast.get_docstring(node, clean=False)
                lines = (node.end_lineno or 0) - node.lineno + 1 - len((doc or "").splitlines())
                assert lines <= LINES_OF_A_FUNCTION, f"{path}: {node.name} has {lines} lines"


def test_conventions_are_coded_once() -> None:
    """Only scenes/polarisation.py does trigonometry with a polariser's angle."""
    for folder in ORDER:
        for path in sources(folder):
            if path.name == "polarisation.py":
                continue
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.FunctionDef):
                    named = {a.arg for a in node.args.args + node.args.kwonlyargs}
                    called = {
                        inner.func.attr
                        for inner in ast.walk(node)
                        if isinstance(inner, ast.Call) and isinstance(inner.func, ast.Attribute)
                    }
                    angle = named & {"angle_deg", "angles_deg", "polariser_angle"}
                    assert not (angle and called & {"cos", "sin"}), f"{path}: {node.name}"


def test_the_command_line_imports_nothing_heavy() -> None:
    script = (
        "import sys, malus.bench.cli as c; c.cli.main(['run', '--help'], standalone_mode=False);"
        "print([m for m in ('mitsuba', 'drjit', 'numpy', 'pandas', 'matplotlib', 'colour',"
        " 'trimesh', 'rich', 'pydantic', 'dask', 'numba') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip().endswith("[]")
