"""The 24 materials with their dispersion, and the 5 surfaces with their roughness.

The numbers, with their sources, are in `data/materials.toml` and `data/surfaces.toml`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from malus.scenes.core.arrays import BoolArray, Float64Array
from malus.scenes.core.errors import InputError
from malus.scenes.core.registry import lookup, table
from malus.scenes.materials.dispersion import FORMULAS, Coefficients

Kind = Literal["plastic", "liquid"]

FRAUNHOFER_F_NM, FRAUNHOFER_D_NM, FRAUNHOFER_C_NM = 486.1, 587.6, 656.3
"""Lines of hydrogen (F, C) and helium (d) that define the Abbe number."""

VISIBLE_NM = (360.0, 830.0)
"""Wavelengths of CIE's standard observer: formulas may be used for all of these.

The narrowest data are of 477 to 830 and of 400 to 710 nm. Where people see, all of these media are
clear and their formulas smooth; beyond that and the data, a formula comes to absorption that it
does not know: that of ethylene glycol, of data to 2800 nm, gives 1.38 there, none at 3000 and 1.44
at 3600 nm.
"""


@dataclass(frozen=True)
class Material:
    """A transparent substance and its refractive index n(λ).

    `dispersion` names a formula of refractiveindex.info with its `coefficients`, or is "table"
    with `table_nm` and `table_n`. `source` is the publication, `valid_range_nm` the wavelengths
    that the data cover.
    """

    id: str
    name: str
    kind: Kind
    source: str
    valid_range_nm: tuple[float, float]
    dispersion: str
    coefficients: Coefficients = ()
    table_nm: tuple[float, ...] = ()
    table_n: tuple[float, ...] = ()

    def eta(self, wavelength_nm: ArrayLike) -> Float64Array:
        """Refractive index at wavelengths in nm, same shape, relative to vacuum or air.

        Raises
        ------
        InputError
            For a wavelength that is not positive and finite, outside a table, or for a formula
            both outside its data and `VISIBLE_NM`; `extrapolated` tells of the visible ones.

        Examples
        --------
        >>> float(material("water").eta(587.6).round(3))
        1.333
        """
        wavelengths = np.asarray(wavelength_nm, dtype=np.float64)
        self._check_wavelengths(
            wavelengths,
            (wavelengths > 0) & np.isfinite(wavelengths),
            "positive finite wavelengths in nm",
        )
        if self.dispersion == "table":
            return self._from_table(wavelengths)
        low, high = self.usable_range_nm
        self._check_wavelengths(
            wavelengths,
            (wavelengths >= low) & (wavelengths <= high),
            f"visible wavelengths or those of its data, {low:g} to {high:g} nm",
        )
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            eta = np.asarray(FORMULAS[self.dispersion](wavelengths * 1e-3, self.coefficients))
        self._check_wavelengths(
            wavelengths, np.isfinite(eta) & (eta > 0), "wavelengths with a real index"
        )
        return eta

    def extrapolated(self, wavelength_nm: ArrayLike) -> BoolArray:
        """Whether wavelengths in nm lie outside the range of the data; same shape.

        Examples
        --------
        >>> material("pmma").extrapolated([400.0, 550.0]).tolist()
        [True, False]
        """
        wavelengths = np.asarray(wavelength_nm, dtype=np.float64)
        low, high = self.valid_range_nm
        return ~((wavelengths >= low) & (wavelengths <= high))

    @property
    def usable_range_nm(self) -> tuple[float, float]:
        """Wavelengths that have an index: those of the data; of a formula, all visible ones too.

        Examples
        --------
        >>> material("ethanol").usable_range_nm  # a formula, whose data begin at 477 nm
        (360.0, 830.0)
        >>> material("polyvinyl_chloride").usable_range_nm  # a table
        (400.0, 700.0)
        """
        (low, high), (violet, red) = self.valid_range_nm, VISIBLE_NM
        if self.dispersion == "table":
            return self.table_nm[0], self.table_nm[-1]
        return min(low, violet), max(high, red)

    @property
    def eta_d(self) -> float:
        """Refractive index at the helium d line, 587.6 nm."""
        return float(self.eta(FRAUNHOFER_D_NM))

    @property
    def abbe(self) -> float:
        """Abbe number (n_d − 1) / (n_F − n_C): small where dispersion is strong."""
        n_f, n_d, n_c = self.eta([FRAUNHOFER_F_NM, FRAUNHOFER_D_NM, FRAUNHOFER_C_NM])
        return float((n_d - 1.0) / (n_f - n_c))

    def _from_table(self, wavelengths: Float64Array) -> Float64Array:
        low, high = self.usable_range_nm
        inside = (wavelengths >= low) & (wavelengths <= high)
        self._check_wavelengths(
            wavelengths, inside, f"wavelengths within its table, {low:g} to {high:g} nm"
        )
        return np.asarray(np.interp(wavelengths, self.table_nm, self.table_n), dtype=np.float64)

    def _check_wavelengths(
        self, wavelengths: Float64Array, valid: BoolArray, expected: str
    ) -> None:
        """Raise InputError for the first wavelength that is not valid."""
        if not valid.all():
            found = f"{wavelengths[~valid].flat[0]:g} nm"
            raise InputError(
                f"material {self.id}", expected, found, "choose other bands or another material"
            )


@dataclass(frozen=True)
class NamedSurface:
    """A rough surface of the data file.

    `alpha` is the Beckmann roughness (rms slope), `albedo` the diffuse fraction; `status`
    is "recalled_unverified" for a value that nobody has compared with the printed source.
    """

    id: str
    alpha: float
    albedo: float
    source: str
    status: str

    @property
    def sigma(self) -> float:
        """Exponent σ = 1/α² of the paper's Equation 2.

        Examples
        --------
        >>> round(surface("carbon").sigma, 9)
        6.25
        """
        return 1.0 / self.alpha**2


def materials() -> dict[str, Material]:
    """All materials by id, in the order of the data file.

    Examples
    --------
    >>> len(materials())
    24
    """
    return {item.id: item for item in _load_materials()}


def material(name: str) -> Material:
    """The material of that id.

    Raises
    ------
    InputError
        For an unknown id; names the closest ones.

    Examples
    --------
    >>> material("water").kind
    'liquid'
    """
    return lookup(name, materials(), "material")


def surfaces() -> dict[str, NamedSurface]:
    """All surfaces by id, in the order of the data file.

    Examples
    --------
    >>> list(surfaces())
    ['carbon', 'rubber', 'obsidian', 'olive_drab', 'rust']
    """
    return {item.id: item for item in _load_surfaces()}


def surface(name: str) -> NamedSurface:
    """The surface of that id.

    Raises
    ------
    InputError
        For an unknown id; names the closest ones.

    Examples
    --------
    >>> surface("rubber").alpha
    0.3
    """
    return lookup(name, surfaces(), "surface")


def _nanometres(micrometres: Iterable[float]) -> tuple[float, ...]:
    # Rounded to a femtometre, so that 0.58 µm is the 580 nm that a user writes.
    return tuple(round(value * 1e3, 6) for value in micrometres)


@cache
def _load_materials() -> tuple[Material, ...]:
    return tuple(_material(entry) for entry in table("materials.toml")["material"])


def _material(entry: dict[str, Any]) -> Material:
    low, high = _nanometres(entry["valid_range_um"])
    return Material(
        id=entry["id"],
        name=entry["name"],
        kind=entry["kind"],
        source=entry["source"],
        valid_range_nm=(low, high),
        dispersion=entry["dispersion"],
        coefficients=tuple(entry.get("coefficients", ())),
        table_nm=_nanometres(entry.get("wavelength_um", ())),
        table_n=tuple(entry.get("n", ())),
    )


@cache
def _load_surfaces() -> tuple[NamedSurface, ...]:
    data = table("surfaces.toml")
    return tuple(
        NamedSurface(
            id=entry["id"],
            alpha=entry["rms_slope_m"],
            albedo=entry["diffuse_fraction"],
            source=data["source"],
            status=entry["status"],
        )
        for entry in data["surface"]
    )
