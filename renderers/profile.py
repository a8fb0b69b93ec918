"""Where the time of a render goes: kernels, their compilation, and the rest."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from malus.renderers.variant import Variant, mitsuba


@dataclass
class Profile:
    """Seconds of wall clock, of running kernels and of compiling them; launches counted."""

    wall: float = 0.0
    kernels: float = 0.0
    compilation: float = 0.0
    launches: int = 0
    compiled: int = 0

    @property
    def python(self) -> float:
        """What is neither kernel nor compilation: tracing, launching and copying."""
        return max(self.wall - self.kernels - self.compilation, 0.0)


@contextmanager
def profiled(variant: Variant) -> Iterator[Profile]:
    """Profile the block; on the scalar variant only the wall clock is known."""
    profile = Profile()
    mitsuba(variant)
    if not variant.vectorised:
        started = time.perf_counter()
        yield profile
        profile.wall = time.perf_counter() - started
        return
    import drjit as dr

    dr.kernel_history_clear()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        started = time.perf_counter()
        yield profile
        dr.sync_thread()
        profile.wall = time.perf_counter() - started
        for kernel in dr.kernel_history():
            profile.launches += 1
            profile.kernels += kernel.get("execution_time", 0.0) * 1e-3
            built = kernel.get("codegen_time", 0.0) + kernel.get("backend_time", 0.0)
            profile.compilation += built * 1e-3
            profile.compiled += not kernel.get("cache_hit", True)
