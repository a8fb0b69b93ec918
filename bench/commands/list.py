"""`malus list`: what there is to choose from."""

from __future__ import annotations

from collections.abc import Callable
from typing import get_args

import numpy as np
from rich.console import Console
from rich.table import Table

from malus.bench.studies.registry import STUDIES
from malus.reconstruct import methods
from malus.scenes.core.errors import InputError
from malus.scenes.core.model import Model
from malus.scenes.lights.lights import Light
from malus.scenes.materials.albedo import reflectance, swatches
from malus.scenes.materials.materials import materials, surfaces
from malus.scenes.materials.metals import metals
from malus.scenes.shapes.patterns import Pattern
from malus.scenes.shapes.shapes import Shape
from malus.scenes.suite import load_suite, suite_names

SHOWN_NM = (450.0, 550.0, 650.0)


def list_things(what: str) -> None:
    """Print one of the lists, or all of them.

    Raises
    ------
    InputError
        If there is no such list.
    """
    lists: dict[str, Callable[[], Table]] = {
        "suites": _suites,
        "methods": _methods,
        "materials": _materials,
        "metals": _metals,
        "surfaces": _surfaces,
        "swatches": _swatches,
        "patterns": lambda: _kinds("patterns: where each of several surfaces is", Pattern),
        "shapes": lambda: _kinds("shapes", Shape),
        "lights": lambda: _kinds("lights", Light),
    }
    if what != "everything" and what not in lists:
        raise InputError("list", f"one of {', '.join(lists)}", what, "or leave it out for all")
    console = Console()
    for name, make in lists.items():
        if what in (name, "everything"):
            console.print(make())


def _new(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left")
    for column in columns:
        table.add_column(column)
    return table


def _suites() -> Table:
    table = _new("suites", "name", "scenes", "what for")
    for name in suite_names():
        suite = load_suite(name)
        table.add_row(name, str(sum(1 for _ in suite.scenes())), suite.description)
    for study in STUDIES.values():
        table.add_row(study.name, "", study.description)
    return table


def _methods() -> Table:
    table = _new("methods", "name", "needs", "what it does")
    for method in methods().values():
        table.add_row(method.name, ", ".join(sorted(method.needs)), method.summary)
    return table


def _materials() -> Table:
    table = _new("materials", "name", "kind", "η at 587.6 nm", "extrapolated below", "source")
    visible = np.arange(400.0, 701.0)
    for material in materials().values():
        outside = visible[np.asarray(material.extrapolated(visible))]
        limit = f"{outside.max():.0f} nm" if outside.size else ""
        table.add_row(material.id, material.kind, f"{material.eta_d:.4f}", limit, material.source)
    return table


def _metals() -> Table:
    table = _new("metals: materials without a body", "name", *map(_nm, SHOWN_NM), "source")
    for item in metals().values():
        values = item.eta(SHOWN_NM)
        table.add_row(item.id, *(f"{v.real:.2f} + {v.imag:.2f}i" for v in values), item.source)
    return table


def _surfaces() -> Table:
    table = _new("surfaces", "name", "alpha", "σ = 1/alpha²", "albedo", "status")
    for surface in surfaces().values():
        table.add_row(
            surface.id,
            f"{surface.alpha:g}",
            f"{surface.sigma:.4g}",
            f"{surface.albedo:g}",
            surface.status,
        )
    return table


def _swatches() -> Table:
    table = _new("swatches: colours that `albedo` may name", "name", *map(_nm, SHOWN_NM))
    for name in swatches():
        values = reflectance(name, SHOWN_NM)
        table.add_row(name, *(f"{value:.3f}" for value in values))
    return table


def _nm(wavelength: float) -> str:
    return f"{wavelength:g} nm"


def _kinds(title: str, union: object) -> Table:
    """Members of a union of scene data, with the keys that a suite may set."""
    table = _new(title, "kind", "keys [default]", "what it is")
    members: tuple[type[Model], ...] = get_args(get_args(union)[0])
    for member in members:
        fields = {name: field for name, field in member.model_fields.items() if name != "kind"}
        keys = ", ".join(
            name if field.is_required() else f"{name} [{field.default}]"
            for name, field in fields.items()
        )
        doc = (member.__doc__ or "").strip().splitlines()[0]
        table.add_row(str(member.model_fields["kind"].default), keys, doc)
    return table
