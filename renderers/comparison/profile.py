"""Time that a render spends on running kernels and on compiling them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from malus.renderers.variant import Variant, mitsuba


@dataclass
class Profile:
    """Wall-clock seconds of running kernels, and of compiling them or finding them in a cache."""

    kernels: float = 0.0
    compilation: float = 0.0


@contextmanager
def profiled(variant: Variant) -> Iterator[Profile]:
    """Measure the kernels of the enclosed code; zeros for the scalar variant, which has none."""
    profile = Profile()
    mitsuba(variant)
    if not variant.vectorised:
        yield profile
        return
    import drjit as dr

    dr.kernel_history_clear()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        yield profile
        dr.sync_thread()
        for kernel in dr.kernel_history():
            profile.kernels += kernel.get("execution_time", 0.0) * 1e-3
            built = kernel.get("codegen_time", 0.0) + kernel.get("backend_time", 0.0)
            profile.compilation += built * 1e-3
