"""`malus list`: what there is to choose from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, get_args

import click

from malus.bench.commands.options import command

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo
    from rich.table import Table

    from malus.scenes.core.model import Model
    from malus.scenes.materials.materials import Material
    from malus.scenes.materials.metals import Metal

SHOWN_NM = (450.0, 550.0, 650.0)
"""Wavelengths at which indices and colours are shown."""


@command("list")
@click.argument("what", default="everything")
def list_command(what: str) -> None:
    """List suites, methods, metrics, materials, metals, surfaces, swatches, patterns, …

    WHAT may also be shapes, lights, maps or sensors. Without it: everything.

    \b
    Example:
      malus list materials
    """
    from malus.bench.commands.console import plain_console
    from malus.bench.public.lists import list_lights, list_patterns, list_shapes
    from malus.scenes.core.errors import InputError
    from malus.scenes.core.validation import near

    tables: dict[str, Callable[[], Table]] = {
        "suites": _suites,
        "methods": _methods,
        "metrics": _metrics,
        "materials": _materials,
        "metals": _metals,
        "surfaces": _surfaces,
        "swatches": _swatches,
        "patterns": lambda: _kinds("patterns: where each of several surfaces is", list_patterns()),
        "shapes": lambda: _kinds("shapes", list_shapes()),
        "lights": lambda: _kinds("lights", list_lights()),
        "maps": _maps,
        "sensors": _sensors,
    }
    if what != "everything" and what not in tables:
        hint = near(what, tables) or "or leave it out for all"
        raise InputError("list", f"one of {', '.join(tables)}", what, hint)
    console = plain_console()
    for name, make in tables.items():
        if what in (name, "everything"):
            console.print(make())


_UNSHOWN = ("kind", "found_in", "digest")
"""Keys of a model that nobody writes: its name in the table, and folder and hash of its file."""


def _new(title: str, *columns: str) -> Table:
    """An empty table whose first column, the names that one copies, is never broken or cut."""
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for number, column in enumerate(columns):
        table.add_column(column, no_wrap=number == 0, overflow="fold")
    return table


def _suites() -> Table:
    from malus.bench.public.lists import list_studies, list_suites

    table = _new("suites", "name", "scenes", "what for")
    for name, suite in list_suites().items():
        table.add_row(name, str(suite.scene_count), suite.description)
    for study in list_studies().values():
        table.add_row(study.name, "", study.description)
    return table


def _methods() -> Table:
    from malus.bench.public.lists import list_methods

    table = _new("methods", "name", "needs besides picture and mask", "what it does")
    for method in list_methods().values():
        table.add_row(method.name, ", ".join(sorted(method.needs)), method.summary)
    return table


def _metrics() -> Table:
    from malus.bench.public.lists import list_metrics

    table = _new("metrics", "name", "unit", "better", "definition; source; name in `metrics`")
    for metric in list_metrics().values():
        told = (metric.definition, metric.source, metric.asked_for)
        table.add_row(metric.name, metric.unit, metric.better, "\n".join(filter(None, told)))
    return table


def _materials() -> Table:
    from malus.bench.public.lists import list_materials

    table = _new("materials", "name", "kind", "η at 587.6 nm", "data, nm", "usable, nm")
    for material in list_materials().values():
        ranges = map(_range, (material.valid_range_nm, material.usable_range_nm))
        table.add_row(material.id, material.kind, f"{material.eta_d:.4f}", *ranges)
    return _with_sources(table, list_materials())


def _range(ends: tuple[float, float]) -> str:
    low, high = ends
    return f"{low:g}–{high:g}"


def _metals() -> Table:
    from malus.bench.public.lists import list_metals

    table = _new("metals: materials without a body", "name", *map(_nm, SHOWN_NM), "data, nm")
    for metal in list_metals().values():
        indices = [f"{eta.real:.2f} + {eta.imag:.2f}i" for eta in metal.eta(SHOWN_NM)]
        ends = _range((metal.table_nm[0], metal.table_nm[-1]))
        table.add_row(metal.id, *indices, ends)
    return _with_sources(table, list_metals())


def _with_sources(table: Table, substances: Mapping[str, Material | Metal]) -> Table:
    """A table with the sources below, which are too long for a column, each once."""
    by_source: dict[str, list[str]] = {}
    for substance in substances.values():
        by_source.setdefault(substance.source, []).append(substance.id)
    table.caption = "\n".join(f"{', '.join(ids)}: {one}" for one, ids in by_source.items())
    table.caption_justify = "left"
    return table


def _surfaces() -> Table:
    from malus.bench.public.lists import list_surfaces

    table = _new("surfaces", "name", "alpha", "σ = 1/alpha²", "albedo", "status")
    for surface in list_surfaces().values():
        table.add_row(
            surface.id,
            f"{surface.alpha:g}",
            f"{surface.sigma:.4g}",
            f"{surface.albedo:g}",
            surface.status,
        )
    return table


def _swatches() -> Table:
    from malus.bench.public.lists import list_swatches
    from malus.scenes.materials.albedo import reflectance

    table = _new("swatches: colours that `albedo` may name", "name", *map(_nm, SHOWN_NM))
    for name in list_swatches():
        values = reflectance(name, SHOWN_NM)
        table.add_row(name, *(f"{value:.3f}" for value in values))
    return table


def _maps() -> Table:
    from malus.bench.public.lists import list_maps
    from malus.scenes.maps import ALWAYS

    title = "maps: what datasets hold; those not always there are asked for with `maps`"
    # Seven columns would break words into syllables on 80: what belongs together shares one.
    table = _new(title, "name", "always", "unit; frame; type", "what it is; partly covered")
    for name, one in list_maps().items():
        kind = f"{one.dtype} × {one.shape}" if one.shape else one.dtype
        measured = "\n".join(filter(None, (one.unit, one.frame, kind)))
        told = f"{one.summary}\npartly covered: {one.partly_covered}"
        table.add_row(name, "yes" if name in ALWAYS else "", measured, told)
    return table


def _sensors() -> Table:
    from malus.bench.public.lists import list_sensors

    title = "sensors of polarisation cameras"
    table = _new(title, "preset", "what it is; source", "keys", "to be given")
    for name, values in list_sensors().items():
        about = ("id", "name", "needs", "source")
        shown = {key: value for key, value in values.items() if key not in about}
        keys = ", ".join(f"{key} {_plain(value)}" for key, value in shown.items())
        given = ", ".join(values["needs"])
        table.add_row(name, f"{values['name']}\n{values['source']}", keys, given)
    return table


def _plain(value: object) -> str:
    """A value, or several one after the other, without brackets."""
    return " ".join(f"{part:g}" for part in value) if isinstance(value, tuple) else str(value)


def _nm(wavelength: float) -> str:
    return f"{wavelength:g} nm"


def _kinds(title: str, kinds: dict[str, type[Model]]) -> Table:
    """Kinds of scene data, with the keys that a suite may set."""
    table = _new(title, "kind", "keys [default]", "what it is")
    for kind, model in kinds.items():
        fields = {name: field for name, field in model.model_fields.items() if name not in _UNSHOWN}
        keys = ", ".join(
            name if field.is_required() else f"{name} [{_shown(field)}]"
            for name, field in fields.items()
        )
        table.add_row(kind, keys, (model.__doc__ or "").strip().splitlines()[0])
    return table


def _shown(field: FieldInfo) -> str:
    """A default as a suite writes it; of a table that is left out, its keys."""
    from malus.scenes.core.model import Model

    value = field.default
    for model in get_args(field.annotation) if value is None else ():
        if issubclass(model, Model):
            return f"left out; {{ {', '.join(model.model_fields)} }}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(str, value))}]"
    if not isinstance(value, Model):
        return f'"{value}"' if isinstance(value, str) else str(value)
    keys = value.model_dump(exclude_none=True)
    return f"{{ {', '.join(f'{key} = {number:g}' for key, number in keys.items())} }}"
