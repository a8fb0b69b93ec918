"""Check what a method of one's own returns: real numbers, for every pixel of the object."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.observation import Components, Observation
from malus.scenes.core.errors import InputError


def checked_components(name: str, returned: Any, observation: Observation) -> Components:
    """The components that the method of that name returned, in single or double precision.

    Raises
    ------
    InputError
        No Components, arrays of another shape than the image's, of no real numbers, or masked
        where the object is; a negative deviation; `converged` that is no bool.

    Examples
    --------
    >>> seen = Observation(np.ones((2, 2, 1)), np.ones((2, 2), bool))
    >>> whole = Components(*np.ones((3, 2, 2, 1), np.int64))
    >>> checked_components("mine", whole, seen).image.dtype.name
    'float64'
    """
    if not isinstance(returned, Components):
        hint = "return malus.reconstruct.Components(image, s1, s2)"
        raise InputError(f"method {name}", "Components", type(returned).__name__, hint)
    shape, mask = observation.image.shape, observation.mask
    radiance: dict[str, Any] = {
        part: _real(name, part, getattr(returned, part), shape, mask[..., None])
        for part in ("image", "s1", "s2", "deviation")
        if part != "deviation" or returned.deviation is not None
    }
    if np.any(radiance.get("deviation", 0) < 0):
        expected, hint = "a deviation of 0 or more", "it is a standard deviation, without a sign"
        raise InputError(f"method {name}", expected, "negative values", hint)
    if not isinstance(returned.converged, bool | np.bool_ | None):
        found, hint = repr(returned.converged), "it says of the whole picture whether it did"
        raise InputError(f"method {name}", "converged to be True, False or None", found, hint)
    valid = returned.valid
    if valid is not None:
        valid = _real(name, "valid", valid, shape[:2], mask) != 0
    return replace(returned, valid=valid, **radiance)


def _real(
    name: str, part: str, values: Any, shape: tuple[int, ...], mask: NDArray[np.bool_]
) -> NDArray[Any]:
    """One of a method's arrays, of that shape, in single or double precision."""
    array = np.asarray(values)
    if array.shape != shape or array.dtype.kind not in "fiub":
        raise InputError(
            f"method {name}",
            f"{part} of shape {shape} and real numbers",
            f"shape {array.shape} and type {array.dtype}",
            "return image, s1 and s2 of the image's shape, and valid of the mask's",
        )
    if isinstance(values, np.ma.MaskedArray):  # what is masked would be scored as if it were not
        count = int((np.ma.getmaskarray(values) & mask).sum())
        if count:
            found, hint = f"{count} masked ones", "fill them, or name their pixels in `valid`"
            raise InputError(f"method {name}", f"values of {part} on the object", found, hint)
        array = values.filled(0)
    double = array.dtype.kind != "f" or array.dtype.itemsize > 4
    return array.astype(np.float64 if double else np.float32, copy=False)
