"""`malus doctor`: what renders here, what is missing, and the command that mends it."""

from __future__ import annotations

import json
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from rich.console import Console
from rich.table import Table

from malus.renderers.variant import BROKEN_LLVM, SCALAR, choose, installed_llvm, llvm_version

PACKAGES = (
    "malus",
    "mitsuba",
    "drjit",
    "numpy",
    "scipy",
    "trimesh",
    "OpenEXR",
    "colour-science",
    "scikit-image",
    "matplotlib",
    "pandas",
    "pyarrow",
)


def findings() -> dict[str, Any]:
    """Everything `malus doctor` knows, as plain data."""
    variant = choose()
    libraries = [
        {"path": str(path), "version": llvm_version(path), "aborts": _aborts(llvm_version(path))}
        for path in installed_llvm()
    ]
    return {
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES},
        "variant": variant.name,
        "reason": variant.reason,
        "llvm": variant.llvm,
        "libraries": libraries,
        "advice": _advice(variant.name),
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _aborts(number: int | None) -> bool:
    return number in BROKEN_LLVM


def _advice(variant: str) -> str | None:
    if variant != SCALAR:
        return None
    return (
        "rendering works, but about ten times slower than with LLVM 17 or later: "
        "`apt-get install libllvm19` (Debian, Ubuntu), `dnf install llvm-libs` (Fedora), "
        "`brew install llvm` (macOS)"
    )


def report(as_json: bool) -> bool:
    """Print the findings; true where all that malus needs is there."""
    found = findings()
    complete = all(found["packages"].values())
    if as_json:
        sys.stdout.write(json.dumps(found, indent=2) + "\n")
        return complete
    table = Table(show_header=False)
    table.add_row("Python", found["python"])
    for name, number in found["packages"].items():
        table.add_row(name, number or f"missing: pip install {name}")
    for library in found["libraries"]:
        use = "aborts the process, never loaded" if library["aborts"] else "candidate"
        table.add_row(f"LLVM {library['version'] or '?'}", f"{library['path']}: {use}")
    table.add_row("variant", f"{found['variant']} ({found['reason']})")
    console = Console()
    console.print(table)
    if found["advice"]:
        console.print(found["advice"], highlight=False)
    return complete
