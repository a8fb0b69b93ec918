"""A refractive index of one's own: a number for all bands, or one number a band."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag

from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError
from malus.scenes.core.model import content_id

_SHOWN = 4
"""Most bands whose numbers stand in a label."""


def _kind_of_index(value: Any) -> str | None:
    match value:
        case int() | float():
            return "flat"
        case tuple() | list():
            return "bands"
    return None


_EITHER = Discriminator(_kind_of_index, "choice", "a number, or one number a band")
_BANDS = Field(min_length=1, max_length=512)

_Denser = Annotated[float, Field(gt=1, le=4)]
_Positive = Annotated[float, Field(gt=0, le=20)]
_Absorbing = Annotated[float, Field(ge=0, le=20)]

DielectricIndex = Annotated[
    Annotated[_Denser, Tag("flat")] | Annotated[tuple[_Denser, ...], _BANDS, Tag("bands")], _EITHER
]
"""Index of a dielectric relative to air."""

MetalIndex = Annotated[
    Annotated[_Positive, Tag("flat")] | Annotated[tuple[_Positive, ...], _BANDS, Tag("bands")],
    _EITHER,
]
"""Real part of a metal's index."""

Extinction = Annotated[
    Annotated[_Absorbing, Tag("flat")] | Annotated[tuple[_Absorbing, ...], _BANDS, Tag("bands")],
    _EITHER,
]
"""Imaginary part of a metal's index."""


def index_by_band(
    name: str, index: float | tuple[float, ...], wavelengths_nm: tuple[float, ...]
) -> Float64Array:
    """The number of every band, shape (bands,); `name` is told where there are others.

    Raises
    ------
    InputError
        If there are as many numbers as there are no bands.

    Examples
    --------
    >>> index_by_band("eta", (1.52, 1.51), (450.0, 550.0)).tolist()
    [1.52, 1.51]
    """
    values = np.asarray(index, dtype=np.float64)
    if values.ndim and len(values) != len(wavelengths_nm):
        expected, found = f"one number a band, {len(wavelengths_nm)}", str(len(values))
        raise InputError(name, expected, found, "or give one number for all bands")
    return np.broadcast_to(values, len(wavelengths_nm)).copy()


def index_label(index: float | tuple[float, ...]) -> str:
    """The numbers in tables; of many bands the first, the last, and digits that tell them apart.

    Examples
    --------
    >>> index_label(1.5), index_label((1.52, 1.51))
    ('1.5', '1.52, 1.51')
    """
    if not isinstance(index, tuple):
        return f"{index:g}"
    if len(index) <= _SHOWN:
        return ", ".join(f"{value:g}" for value in index)
    return f"{index[0]:g} to {index[-1]:g} ({content_id(index)[:4]})"
