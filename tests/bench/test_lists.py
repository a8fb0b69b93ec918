"""What `malus list` prints is what may be written in a suite."""

from __future__ import annotations

import tomllib

import pytest

from malus.bench.commands.list import _UNSHOWN, _materials, _metals, _shown
from malus.bench.public.lists import (
    list_lights,
    list_materials,
    list_metals,
    list_patterns,
    list_shapes,
)
from malus.scenes import InputError

KINDS = [*list_shapes().values(), *list_lights().values(), *list_patterns().values()]


def printed(table: object, column: str) -> list[str]:
    """The cells of a column of a table."""
    cells = {one.header: list(one.cells) for one in table.columns}  # type: ignore[attr-defined]
    return [str(cell) for cell in cells[column]]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_a_default_is_printed_as_a_suite_writes_it(kind: type) -> None:
    """Read back as TOML it is the default."""
    for name, field in kind.model_fields.items():  # type: ignore[attr-defined]
        shown = "" if name in _UNSHOWN or field.is_required() else _shown(field)
        if not shown or shown.startswith("left out"):
            continue
        value = tomllib.loads(f"key = {shown}")["key"]
        others = {key: 60 if key == "incidence_deg" else "a.obj" for key in _required(kind)}
        assert getattr(kind.parse({**others, name: value}, "suite.toml"), name) == field.default  # type: ignore[attr-defined]


def _required(kind: type) -> list[str]:
    fields = kind.model_fields  # type: ignore[attr-defined]
    return [name for name, field in fields.items() if field.is_required()]


def test_ranges_are_those_that_have_an_index() -> None:
    """To the end and not beyond; of the data only where they are the whole of it."""
    everything = {
        **dict(zip(list_materials().values(), printed(_materials(), "usable, nm"), strict=True)),
        **dict(zip(list_metals().values(), printed(_metals(), "data, nm"), strict=True)),
    }
    for substance, told in everything.items():
        low, high = map(float, told.split("–"))
        assert substance.eta([low, high]).shape == (2,)
        for beyond in (0.999 * low, 1.001 * high):
            with pytest.raises(InputError, match=r"expected .*wavelengths"):
                substance.eta(beyond)
    for material, told in zip(
        list_materials().values(), printed(_materials(), "data, nm"), strict=True
    ):
        low, high = map(float, told.split("–"))
        outside = material.extrapolated([0.999 * low, low, high, 1.001 * high])
        assert outside.tolist() == [True, False, False, True]
