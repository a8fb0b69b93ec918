"""The shape of the project: which module may import which, and how large things may grow."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("scenes", "renderers", "reconstruct", "reports", "bench")

PACKAGE_IMPORTS = {
    "scenes": set(),
    "renderers": {"scenes"},
    "reconstruct": {"scenes"},  # never renderers: no method may see a truth
    "reports": {"scenes"},  # the names of result files and the colorimetry stand there
    "bench": {"scenes", "renderers", "reconstruct", "reports"},
}
"""What each package may import besides itself."""

ROOMS = {
    "scenes": (
        "core", "polarisation", "colour camera", "lights", "shapes", "materials",
        "surroundings sensor", "scene sensor_frame", "suite_surfaces maps", "random_suite", "suite",
    ),
    "renderers": (
        "truth variant family_key", "mitsuba", "families", "torrance_sparrow", "rendering",
        "datasets comparison self_check_scenes", "self_check_laws", "self_check",
    ),
    "reconstruct": (
        "observation fresnel kernels", "pixel_block quadrature", "facets", "lobe_models",
        "known_light_kernels", "known_lights", "image", "single_image learned",
        "builtin_methods checked_components", "methods", "photos",
    ),
    "reports": (
        "tables templates", "figures viewer", "source page", "sections summary",
        "capture_report", "write",
    ),
    "bench": (
        "scoring", "running", "datasets", "gates", "studies learning", "public", "commands", "cli",
        "documents",
    ),
}  # fmt: skip
"""Folders and modules of each package from the lowest up; those in one line do not meet."""

LINES_OF_A_MODULE = 400
LINES_OF_A_FUNCTION = 40


def sources(package: str) -> list[Path]:
    """Its modules; tutorials, which are scripts among the documents, are none."""
    paths = (ROOT / package).rglob("*.py")
    return sorted(path for path in paths if not path.is_relative_to(ROOT / "reports" / "docs"))


def all_sources() -> list[Path]:
    return [ROOT / "__init__.py", *(path for package in PACKAGES for path in sources(package))]


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(("malus", *(part for part in parts if part != "__init__")))


MODULES = {module_name(path): path for path in all_sources()}


def imports(path: Path) -> Iterator[str]:
    """Every module that a file names in an import, wherever that stands."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            for alias in node.names:
                inner = f"{module}.{alias.name}"
                yield inner if inner in MODULES else module


def own_imports(path: Path) -> set[str]:
    """Modules of malus that a file imports; pages of users may `import malus` as users do."""
    own = {name for name in imports(path) if name.split(".")[0] == "malus"}
    return own - {"malus"} if path.parent.name == "documents" else own


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_what_they_may(package: str) -> None:
    for path in sources(package):
        for module in own_imports(path):
            other = module.split(".")[1] if "." in module else "malus"
            allowed = other == package or other in PACKAGE_IMPORTS[package]
            assert allowed, f"{path.relative_to(ROOT)} imports {module}"


def room_of(module: str) -> str:
    parts = module.split(".")
    return parts[2] if len(parts) > 2 else "__init__"


@pytest.mark.parametrize("package", PACKAGES)
def test_rooms_import_only_rooms_below(package: str) -> None:
    level = {room: row for row, line in enumerate(ROOMS[package]) for room in line.split()}
    beside = {path.stem for path in (ROOT / package).glob("*.py")} - {"__init__"}
    folders = {path.parent.name for path in (ROOT / package).glob("*/__init__.py")}
    assert set(level) == beside | folders, "ROOMS lists every room"
    for path in sources(package):
        room = room_of(module_name(path))
        if room == "__init__":  # gathers the public names
            continue
        for module in own_imports(path):
            other = room_of(module)
            if module.split(".")[1] != package or other == room:
                continue
            assert other != "__init__", f"{path.relative_to(ROOT)} imports what gathers it"
            assert level[other] < level[room], f"{path.relative_to(ROOT)} imports {module}"


def test_no_circle_of_modules() -> None:
    """A package's `__init__` gathers names of modules; none of these imports it back."""
    graph = {name: own_imports(path) for name, path in MODULES.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("package", PACKAGES)
def test_mitsuba_lives_in_renderers_only(package: str) -> None:
    for path in sources(package):
        heavy = {module.split(".")[0] for module in imports(path)} & {"mitsuba", "drjit"}
        assert not heavy or package == "renderers", path


@pytest.mark.parametrize("package", PACKAGES)
def test_modules_and_functions_stay_small(package: str) -> None:
    for path in sources(package):
        text = path.read_text("utf-8")
        assert len(text.splitlines()) <= LINES_OF_A_MODULE, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                doc = ast.get_docstring(node, clean=False)
                lines = (node.end_lineno or 0) - node.lineno + 1 - len((doc or "").splitlines())
                assert lines <= LINES_OF_A_FUNCTION, f"{path}: {node.name} has {lines} lines"


def test_modules_of_tests_stay_small() -> None:
    """Their functions may be long: a test reads as one story."""
    modules = list((ROOT / "tests").rglob("*.py"))
    assert modules
    for path in modules:
        assert len(path.read_text("utf-8").splitlines()) <= LINES_OF_A_MODULE, path


def test_conventions_are_coded_once() -> None:
    """Only scenes/polarisation.py does trigonometry with a polariser's angle."""
    for path in all_sources():
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


def loaded_by(script: str, packages: set[str]) -> set[str]:
    """Those of some packages that a new process has loaded after a script."""
    found = f"import sys; {script}; print(*{packages} & {{*sys.modules}}, sep='\\n')"
    done = subprocess.run([sys.executable, "-c", found], capture_output=True, text=True, check=True)
    return packages & {*done.stdout.split()}


def test_the_command_line_imports_nothing_heavy() -> None:
    heavy = {"mitsuba", "drjit", "numpy", "pandas", "matplotlib", "colour"}
    heavy |= {"trimesh", "rich", "pydantic", "dask", "numba"}
    command = "import malus.bench.cli as c; c.cli.main(['run', '--help'], standalone_mode=False)"
    assert not loaded_by(command, heavy)


def test_what_scores_imports_no_tables() -> None:
    """Workers send records: the process that starts them makes tables, and pages, of these."""
    tables = {"pandas", "pyarrow", "jinja2", "PIL", "matplotlib", "malus.reports"}
    imports = "from malus.bench.running.inside_worker import *; import_all(*SCORING)"
    assert loaded_by(imports, {*tables, "numba"}) == {"numba"}


COLLECTIONS = """
import gc
from malus.bench.cli import main
before = gc.get_stats()[0]["collections"]
main()
print("collected", gc.get_stats()[0]["collections"] - before)
"""


def test_a_command_looks_seldom_for_garbage() -> None:
    """What it makes are modules and tables, which stay; by default it looks two hundred times."""
    done = subprocess.run(
        [sys.executable, "-c", COLLECTIONS, "list", "suites"],
        capture_output=True,
        text=True,
        check=True,
    )
    times = int(done.stdout.rpartition("collected")[2])
    assert times < 5, done.stdout


def messages(path: Path) -> Iterator[str]:
    """Texts of a module that are no docstrings."""
    tree = ast.parse(path.read_text("utf-8"))
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
            yield node.value


PRINTS = {"print", "click.echo", "sys.stdout.write", "console.print"}


def calls_print(path: Path) -> bool:
    """Whether a module writes to the terminal; with `file=` it writes elsewhere."""
    return any(
        ast.unparse(node.func) in PRINTS and "file" not in {word.arg for word in node.keywords}
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Call)
    )


def test_only_commands_print_and_name_options() -> None:
    """Errors name parameters; `bench/commands/options.py` tells them as options."""
    option = re.compile(r"(?:^|[\s`])--[a-z][a-z-]*(?:[\s`;,.]|$)")
    for path in all_sources():
        if path.parent.name in ("commands", "documents") or path.name == "cli.py":
            continue  # documents tell readers of commands
        assert not calls_print(path), path
        named = [text for text in messages(path) if option.search(text)]
        assert not named, f"{path.relative_to(ROOT)}: {named}"
