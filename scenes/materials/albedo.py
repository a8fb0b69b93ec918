"""The colour of a body: its reflectance at a scene's bands."""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag

from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError
from malus.scenes.core.registry import lookup, table

Fraction = Annotated[float, Field(ge=0, le=1)]


def _kind_of_albedo(value: Any) -> str | None:
    match value:
        case str():
            return "swatch"
        case int() | float():
            return "grey"
        case tuple() | list():
            return "bands"
    return None


Albedo = Annotated[
    Annotated[Fraction, Tag("grey")]
    | Annotated[str, Tag("swatch")]
    | Annotated[tuple[Fraction, ...], Field(min_length=1, max_length=512), Tag("bands")],
    Discriminator(_kind_of_albedo, "choice", "a number in 0..1, a swatch, or one number a band"),
]
"""Albedo as a scene gives it: grey, the name of a swatch, or one number a band."""


def reflectance(albedo: Albedo, wavelengths_nm: tuple[float, ...]) -> Float64Array:
    """Reflectance of a body at wavelengths in nm, shape (bands,).

    Raises
    ------
    InputError
        An unknown swatch, a wavelength outside its table, or another number of bands.

    Examples
    --------
    >>> reflectance(0.5, (450.0, 550.0)).tolist()
    [0.5, 0.5]
    >>> reflectance("red", (450.0, 650.0)).tolist()
    [0.047, 0.675]
    """
    wavelengths = np.asarray(wavelengths_nm, dtype=np.float64)
    if isinstance(albedo, str):
        return _swatch_at(albedo, wavelengths)
    values = np.asarray(albedo, dtype=np.float64)
    if values.ndim and len(values) != len(wavelengths):
        expected, found = f"one number a band, {len(wavelengths)}", str(len(values))
        raise InputError("albedo", expected, found, "or give one number for all bands, or a swatch")
    return np.broadcast_to(values, wavelengths.shape).copy()


def swatches() -> dict[str, Float64Array]:
    """Reflectances of all swatches by name, every 10 nm from 380 to 730 nm.

    Examples
    --------
    >>> len(swatches())
    24
    """
    return {name: values.copy() for name, values in _tables()[1].items()}


def _swatch_at(name: str, wavelengths_nm: Float64Array) -> Float64Array:
    table_nm, reflectances = _tables()
    values = lookup(name, reflectances, "albedo", "a number in 0..1 or a swatch")
    inside = (wavelengths_nm >= table_nm[0]) & (wavelengths_nm <= table_nm[-1])
    if not inside.all():
        expected = f"wavelengths in {table_nm[0]:g} to {table_nm[-1]:g} nm"
        found = f"{wavelengths_nm[~inside][0]:g} nm"
        raise InputError(f"swatch {name}", expected, found, "choose other bands, or give numbers")
    return np.interp(wavelengths_nm, table_nm, values)


@cache
def _tables() -> tuple[Float64Array, dict[str, Float64Array]]:
    """Wavelengths (N,) in nm, and reflectances (N,) of every swatch by name."""
    data = table("swatches.toml")
    reflectances = {name: np.array(values) for name, values in data["swatches"].items()}
    count = len(next(iter(reflectances.values())))
    return data["first_nm"] + data["step_nm"] * np.arange(count, dtype=np.float64), reflectances
