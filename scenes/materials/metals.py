"""Metals and their complex refractive index n + ik; the numbers are in `data/metals.toml`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from malus.scenes.core.errors import InputError
from malus.scenes.core.registry import lookup, table


@dataclass(frozen=True)
class Metal:
    """A metal: n and k at the wavelengths of a table in nm, and the publication of both."""

    id: str
    name: str
    source: str
    table_nm: tuple[float, ...]
    table_n: tuple[float, ...]
    table_k: tuple[float, ...]

    def eta(self, wavelength_nm: ArrayLike) -> NDArray[np.complex128]:
        """Complex index at wavelengths in nm, same shape, relative to vacuum or air.

        Raises
        ------
        InputError
            For a wavelength outside the table.

        Examples
        --------
        >>> complex(metal("gold").eta(548.6))
        (0.43+2.455j)
        """
        wavelengths = np.asarray(wavelength_nm, dtype=np.float64)
        low, high = self.table_nm[0], self.table_nm[-1]
        inside = (wavelengths >= low) & (wavelengths <= high)
        if not inside.all():
            found = f"{wavelengths[~inside].flat[0]:g} nm"
            expected = f"wavelengths within its table, {low:g} to {high:g} nm"
            raise InputError(f"metal {self.id}", expected, found, "choose other bands")
        n, k = (np.interp(wavelengths, self.table_nm, t) for t in (self.table_n, self.table_k))
        return np.asarray(n + 1j * k)


def metals() -> dict[str, Metal]:
    """All metals by id.

    Examples
    --------
    >>> list(metals())
    ['aluminium', 'chromium', 'copper', 'gold', 'iron', 'silver']
    """
    return {item.id: item for item in _load()}


def metal(name: str) -> Metal:
    """The metal of that id.

    Raises
    ------
    InputError
        For an unknown id; names the closest ones.

    Examples
    --------
    >>> metal("gold").name
    'Gold'
    """
    return lookup(name, metals(), "metal")


@cache
def _load() -> tuple[Metal, ...]:
    return tuple(_metal(entry) for entry in table("metals.toml")["metal"])


def _metal(entry: dict[str, Any]) -> Metal:
    return Metal(
        id=entry["id"],
        name=entry["name"],
        source=entry["source"],
        table_nm=tuple(round(um * 1e3, 6) for um in entry["wavelength_um"]),
        table_n=tuple(entry["n"]),
        table_k=tuple(entry["k"]),
    )
