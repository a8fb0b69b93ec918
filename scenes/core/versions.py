"""Versions of packages, for the records beside results and datasets."""

from __future__ import annotations

import platform
from importlib.metadata import version


def versions(*packages: str) -> dict[str, str]:
    """Versions of installed packages by name, and that of Python.

    Raises
    ------
    importlib.metadata.PackageNotFoundError
        If one of them is not installed.

    Examples
    --------
    >>> sorted(versions("numpy"))
    ['numpy', 'python']
    """
    return {name: version(name) for name in packages} | {"python": platform.python_version()}
