"""What malus needs of other packages, by its own metadata, and what of that is not met here."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, metadata, requires, version

from packaging.requirements import Requirement

OF_DEVELOPERS = ("dev", "docs", "nist")
"""Extras that no command needs."""


def installed_packages() -> dict[str, str | None]:
    """Version of malus and of every package that it needs, None where one is missing.

    Packages of extras are among them where they are installed. Without metadata, as of a checkout
    that is only on the path, what malus needs is not known.

    Examples
    --------
    >>> "numpy" in installed_packages()
    True
    """
    needed = {need.name: _version(need.name) for need, _ in _needs()}
    optional = {need.name for need, is_optional in _needs() if is_optional}
    here = {name: at for name, at in needed.items() if at is not None or name not in optional}
    return {"malus": _version("malus"), **here}


def unmet_requirements() -> dict[str, str]:
    """What to install for each package that is missing or of a version that does not fit.

    Examples
    --------
    >>> unmet_requirements().get("numpy") is None
    True
    """
    installed = installed_packages()
    unmet = {
        need.name: f"{need.name}{need.specifier}"
        for need, _ in _needs()
        if need.name in installed and not _fits(need, installed[need.name])
    }
    return unmet if installed["malus"] is not None else {"malus": "."}


def _needs() -> Iterator[tuple[Requirement, bool]]:
    """Requirements that hold here, and whether only an extra has them."""
    try:
        extras = set(metadata("malus").get_all("Provides-Extra") or ()) - {*OF_DEVELOPERS}
        texts = requires("malus") or ()
    except PackageNotFoundError:
        return
    for need in map(Requirement, texts):
        if need.marker is None or need.marker.evaluate({"extra": ""}):
            yield need, False
        elif any(need.marker.evaluate({"extra": extra}) for extra in extras):
            yield need, True


def _fits(need: Requirement, installed: str | None) -> bool:
    return installed is not None and need.specifier.contains(installed, prereleases=True)


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
