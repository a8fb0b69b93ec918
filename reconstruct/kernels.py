"""Loops over the pixels of an image, compiled by numba.

Importing this module imports numba, which takes long: import it inside the function that has an
image to work on. Machine code is kept in the cache folder of Python or of the user, where one can
be written.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import math
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core.caching import FunctionCache
from numba.core.dispatcher import Dispatcher
from numba.core.sigutils import normalize_signature

Loop = TypeVar("Loop", bound=Callable[..., Any])


def _load_array_functions() -> None:
    """Load what numba knows of arrays, which it loads with the first loop, less linear algebra.

    It only looks whether SciPy has BLAS, and loads a third of SciPy for that. No loop here needs
    it; where a function multiplies matrices, numba looks again.
    """
    with contextlib.suppress(ImportError, AttributeError):  # a numba that does not look there
        from numba.np import linalg

        look_for_blas = linalg.ensure_blas
        linalg.ensure_blas = lambda: None
        try:
            importlib.import_module("numba.np.arraymath")
        finally:
            linalg.ensure_blas = look_for_blas


_load_array_functions()


def compiled(loop: Loop, any_order: bool = False) -> Loop:
    """Compile a loop to machine code that runs without the interpreter's lock.

    It is compiled for each combination of dtypes when first called with it. With `any_order`, the
    compiler may reorder sums, so that several parts of one are added up at once.
    """
    permitted = {"contract", "reassoc"} if any_order else {"contract"}
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": permitted}
    dispatcher = numba.njit(**options)(loop)
    with contextlib.suppress(RuntimeError):  # no folder can be written: every process compiles
        dispatcher._cache = _Cache(loop)
    return dispatcher


class _Cache(FunctionCache):  # type: ignore[misc]
    """Numba's cache, with all that is compiled into a loop in the key of its machine code.

    Numba by itself looks at the loop's own file only: the loop would go on with the old code of
    what it calls in other modules. What cannot be stored or is not what was stored costs the time
    to compile it: a full disk, files that a power cut left empty, and the machine code for other
    types that another process gave the same name at the same moment.
    """

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The machine code for arguments of these types; None where there is none that is whole."""
        try:
            found = super().load_overload(signature, target)
        except Exception:  # a damaged file raises anything
            with contextlib.suppress(OSError):
                self._cache_file.flush()
            return None
        types = normalize_signature(signature)[0]
        return found if found is not None and found.signature.args == types else None

    def save_overload(self, signature: Any, compiled_loop: Any) -> None:
        """Store the machine code for arguments of these types, where there is room."""
        with contextlib.suppress(OSError):
            super().save_overload(signature, compiled_loop)

    def _index_key(self, signature: Any, codegen: Any) -> tuple[Any, ...]:
        fields = [getattr(argument, "fields", ()) for argument in signature]  # of named tuples
        parts = repr((fields, sorted(_compiled_parts(self._py_func))))
        digest = hashlib.sha256(parts.encode()).hexdigest()
        return (*super()._index_key(signature, codegen), digest)


@functools.cache
def _compiled_parts(loop: FunctionType) -> frozenset[str]:
    """Digests of the files of a loop and of those that it calls, and constants of their modules."""
    parts = {_file_digest(loop.__code__.co_filename)}
    for name in loop.__globals__.keys() & set(loop.__code__.co_names):
        value = loop.__globals__[name]
        if isinstance(value, Dispatcher):
            if value.py_func is not loop:
                parts |= _compiled_parts(value.py_func)
        elif isinstance(value, np.ndarray):
            parts.add(f"{name} {value.tolist()}")
        elif not isinstance(value, ModuleType) and not callable(value):
            parts.add(f"{name} {value!r}")
    return frozenset(parts)


@functools.cache
def _file_digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@compiled
def mark_valid_pixels(specular: Any, diffuse: Any, normals: Any, largest: Any, valid: Any) -> None:
    """Mark the pixels whose intensities are in [0, largest] and whose normals face the viewer.

    specular, diffuse (pixels, bands); normals (pixels, 3), or (0, 3) where none are given; valid
    (pixels,) bool is written. Normals must have length one to 5e-4: float32 normals that were
    averaged and normalised again have it to 1e-6. Those of a limb may be so much behind it.
    """
    pixels, bands = specular.shape
    valid[:] = True
    # Counted over flat arrays first, which takes a quarter of the time of going pixel by pixel.
    out_of_range = 0
    for lobe in (specular.reshape(-1), diffuse.reshape(-1)):
        for k in range(lobe.size):
            out_of_range += not (lobe[k] >= 0 and lobe[k] <= largest)  # NaN compares False
    if out_of_range:
        for i in range(pixels):
            for b in range(bands):
                s, d = specular[i, b], diffuse[i, b]
                valid[i] &= s >= 0 and s <= largest and d >= 0 and d <= largest
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        valid[i] &= (abs(x * x + y * y + z * z - 1) < 1e-3) & (z > -1e-6)


@compiled
def polarise_about_normals(
    first: Any,
    second: Any,
    normals: Any,
    table: Any,
    signs: Any,
    frame_length: float,
    s1: Any,
    s2: Any,
) -> None:
    """Write s1 and s2 of one or two lobes whose polarisation depends on the zenith angle alone.

    first, second, s1, s2 (pixels, bands): intensities of the lobes and their Stokes components;
    normals (pixels, 3) with z ≥ 0. The rows of `table` hold s1/s0 at azimuth 0, over the sign of
    their lobe, on even steps of √cos θ from 0 to 1. Its columns are the bands of `first`, followed
    by those of `second` where there are twice as many; `signs` has one or two. `frame_length` is
    the length of (cos 2φ, sin 2φ).
    """
    pixels, bands = first.shape
    cells = table.shape[0] - 1
    both = table.shape[1] > bands
    first_sign, second_sign = signs[0], signs[-1]
    for i in range(pixels):
        x, y, z = np.float64(normals[i, 0]), np.float64(normals[i, 1]), np.float64(normals[i, 2])
        grid_position = math.sqrt(min(z, 1.0)) * cells
        cell = min(int(grid_position), cells - 1)
        part = grid_position - cell
        low, high = table[cell], table[cell + 1]
        # Where the squares underflow, both numerators are zero as well.
        inverse = frame_length / (x * x + y * y + 1e-300)
        cos2, sin2 = (x * x - y * y) * inverse, 2.0 * x * y * inverse
        for b in range(bands):
            polarised = first_sign * first[i, b] * (low[b] + part * (high[b] - low[b]))
            if both:
                c = bands + b
                polarised += second_sign * second[i, b] * (low[c] + part * (high[c] - low[c]))
            s1[i, b] = polarised * cos2
            s2[i, b] = polarised * sin2


@compiled
def add_polarised(intensity: Any, ratios: Any, s1: Any, s2: Any) -> None:
    """Add to s1 and s2 what a lobe contributes: its intensity times s1/s0 and s2/s0.

    intensity, s1, s2 (pixels, bands); ratios (pixels or 1, bands, 2).
    """
    pixels, bands = intensity.shape
    step = 1 if ratios.shape[0] > 1 else 0
    for i in range(pixels):
        for b in range(bands):
            s1[i, b] += intensity[i, b] * ratios[i * step, b, 0]
            s2[i, b] += intensity[i, b] * ratios[i * step, b, 1]
