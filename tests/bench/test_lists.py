"""What `malus list` prints is what may be written in a suite."""

from __future__ import annotations

import io
import tomllib
from collections.abc import Callable, Iterable

import click
import pytest
from rich.console import Console
from rich.table import Table

import malus
from malus.bench.cli import cli
from malus.bench.commands.list import (
    _UNSHOWN,
    SHOWN_NM,
    _kinds,
    _maps,
    _materials,
    _metals,
    _methods,
    _metrics,
    _sensors,
    _shown,
    _suites,
    _surfaces,
    _swatches,
)
from malus.bench.datasets import export
from malus.bench.datasets.layouts import LAYOUTS
from malus.bench.learning.options import PRIORS
from malus.bench.public.lists import (
    list_lights,
    list_materials,
    list_metals,
    list_patterns,
    list_shapes,
    list_suites,
    list_surfaces,
    list_swatches,
)
from malus.bench.scoring.profiles import PROFILES
from malus.reconstruct.photos.mosaic import BAYER_ORDERS
from malus.scenes import InputError
from malus.scenes.materials.albedo import reflectance

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


def test_listed_numbers_are_those_that_scenes_take() -> None:
    """To the digits that are shown, and each in the column of its name."""
    at_d = printed(_materials(), "η at 587.6 nm")
    assert at_d == [f"{float(one.eta(587.6)):.4f}" for one in list_materials().values()]
    for nm in SHOWN_NM:
        indices = [
            complex(text.replace(" ", "").replace("i", "j"))
            for text in printed(_metals(), f"{nm:g} nm")
        ]
        expected = [complex(metal.eta(nm)) for metal in list_metals().values()]
        for told, index in zip(indices, expected, strict=True):
            assert abs(told - index) < 0.0071  # half of the last digit shown, of both parts
        greys = list(map(float, printed(_swatches(), f"{nm:g} nm")))
        values = [reflectance(name, (nm,)).item() for name in list_swatches()]
        assert greys == pytest.approx(values, abs=0.0005)
    for alpha, sigma, albedo, one in zip(
        printed(_surfaces(), "alpha"),
        printed(_surfaces(), "σ = 1/alpha²"),
        printed(_surfaces(), "albedo"),
        list_surfaces().values(),
        strict=True,
    ):
        assert (float(alpha), float(albedo)) == (one.alpha, one.albedo)
        assert float(sigma) == pytest.approx(one.alpha**-2, rel=5e-4)  # four digits


def test_listed_suites_have_as_many_scenes_as_are_rendered() -> None:
    counts = dict(zip(printed(_suites(), "name"), printed(_suites(), "scenes"), strict=True))
    for name in ("quick", "fig5", "orbit"):
        assert int(counts[name]) == sum(1 for _ in list_suites()[name].scenes())


def test_what_is_always_in_a_dataset_is_no_map_of_a_suite() -> None:
    always = dict(zip(printed(_maps(), "name"), printed(_maps(), "always"), strict=True))
    assert {name for name, told in always.items() if told} == {
        "stokes", "specular", "diffuse", "standard_error", "normals", "mask",
    }  # fmt: skip
    assert not always["depth"]


TABLES = (
    _suites, _methods, _metrics, _materials, _metals, _surfaces, _swatches, _maps, _sensors,
)  # fmt: skip
KINDS_OF = {"shapes": list_shapes, "lights": list_lights, "patterns": list_patterns}


@pytest.mark.parametrize(
    "make", [*TABLES, *(lambda k=k: _kinds(k, KINDS_OF[k]()) for k in KINDS_OF)]
)
def test_no_list_breaks_words_on_80_columns(make: Callable[[], Table]) -> None:
    """A name in two halves cannot be copied, and a column of syllables cannot be read."""
    table = make()
    console = Console(width=80, file=io.StringIO(), markup=False)
    console.print(table)
    words = set(console.file.getvalue().replace("│", " ").split())  # type: ignore[attr-defined]
    cells = [str(cell) for column in table.columns for cell in column.cells]
    broken = {word for cell in cells for word in cell.split()} - words
    # As wide as the longest word of a list's columns can be: names of keys.
    assert {word for word in broken if len(word) <= 17} == set()


@pytest.mark.parametrize(
    ("command", "option", "there"),
    [
        ("export", "layout", export.FORMATS),
        ("export", "pixels", export.PIXELS),
        ("score", "layout", LAYOUTS),
        ("score", "profiles", [name.removeprefix("profile:") for name in PROFILES]),
        ("filter", "illuminant", malus.illuminants()),
        ("filter", "separation", malus.separations()),
        ("capture", "bayer", BAYER_ORDERS),
        ("train", "prior", PRIORS),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_the_command_line_offers_all_that_there_is(
    command: str, option: str, there: Iterable[str]
) -> None:
    """Commands list it anew, so that their help answers before anything heavy is imported."""
    (param,) = (p for p in cli.commands[command].params if p.name == option)
    assert isinstance(param.type, click.Choice)
    assert set(param.type.choices) == set(there)
