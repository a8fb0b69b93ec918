"""What this machine renders with, what is missing, and the command that mends it."""

from __future__ import annotations

import os
import platform
from pathlib import Path
from typing import Any

from malus.bench.public.requirements import installed_packages, unmet_requirements
from malus.renderers.self_check import Check
from malus.renderers.self_check import self_check as checks_of
from malus.renderers.variant import (
    BROKEN_LLVM,
    SCALAR,
    choose,
    forget_failures,
    installed_llvm,
    llvm_version,
    missing_llvm,
    unchecked,
)


def doctor() -> dict[str, Any]:
    """Examine this machine: Python, packages, LLVM libraries, and the variant that renders.

    Variants that failed before are tried again.

    Returns
    -------
    dict
        `python`, a version; `packages`, versions by name, None where one is missing; `unmet`, what
        to install for each that is missing or of a version that does not fit; `variant`, Mitsuba's,
        and the `reason` why; `llvm`, path of the library in use or None; `libraries`,
        those found, each with path, version and whether it `aborts` the process; `missing_library`,
        the file that DRJIT_LIBLLVM_PATH names where there is none, or None; `advice`, how to
        render faster, or None.

    Examples
    --------
    >>> doctor()["variant"].endswith("_polarized")
    True
    """
    forget_failures()
    variant = choose()
    libraries = [
        {"path": str(path), "version": llvm_version(path), "aborts": _aborts(llvm_version(path))}
        for path in installed_llvm()
    ]
    return {
        "python": platform.python_version(),
        "packages": installed_packages(),
        "unmet": unmet_requirements(),
        "variant": variant.name,
        "reason": variant.reason,
        "llvm": variant.llvm,
        "libraries": libraries,
        "missing_library": missing_llvm(),
        "advice": _advice(variant.name),
    }


def self_check(backend: str = "auto", short: bool = False) -> list[Check]:
    """Render small scenes of every kind and compare them with stored values and laws.

    Parameters
    ----------
    backend : 'auto', 'cuda', 'llvm' or 'scalar'
        What to check, also where it is not chosen because it failed before.
    short : bool
        Only the few scenes that a variant must pass before malus chooses it.

    Returns
    -------
    list of Check
        Name, what was compared, deviation and its limit, seconds, and whether it passed.

    Raises
    ------
    InputError
        An unknown backend, or one that is not here.

    Examples
    --------
    >>> all(check.passed for check in self_check("scalar", short=True))
    True
    """
    return list(checks_of(unchecked(backend), short))


def _aborts(number: int | None) -> bool:
    return number in BROKEN_LLVM


def _advice(variant: str) -> str | None:
    if variant != SCALAR:
        return None
    named = os.environ.get("DRJIT_LIBLLVM_PATH", "")
    if Path(named).is_file():  # then malus looks nowhere else
        return (
            f"DRJIT_LIBLLVM_PATH names {named}, which is no working LLVM 17 or later: "
            "unset it to let malus look in the usual places"
        )
    return (
        "rendering works, but about ten times slower than with LLVM 17 or later: "
        "`apt-get install libllvm19` (Debian, Ubuntu), `dnf install llvm-libs` (Fedora), "
        "`brew install llvm` (macOS)"
    )
