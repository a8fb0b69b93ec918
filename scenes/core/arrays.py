"""Types of arrays for annotations, shorter than NumPy's own names."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.floating[Any]]
"""Real numbers of any precision: images are float32 from Mitsuba, float64 from formulas."""

Float64Array: TypeAlias = NDArray[np.float64]
Float32Array: TypeAlias = NDArray[np.float32]
Complex128Array: TypeAlias = NDArray[np.complex128]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]
IndexArray: TypeAlias = NDArray[np.intp]
Int32Array: TypeAlias = NDArray[np.int32]
UInt32Array: TypeAlias = NDArray[np.uint32]

NumberArray: TypeAlias = NDArray[np.inexact[Any]]
"""Real or complex numbers: a refractive index, for example."""

AnyArray: TypeAlias = NDArray[Any]
