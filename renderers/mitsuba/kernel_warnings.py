"""Turn warnings of Dr.Jit and OptiX during a render into errors: such pictures lack light.

Where OptiX cannot run a kernel, Dr.Jit prints a line, leaves the ray tracing out and goes on. The
picture then looks plausible, and is wrong.
"""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Iterator
from typing import TextIO, cast

_FROM_DRJIT = re.compile(r"\b(?:jitc?_\w+|validate)\(\): ?.*")
"""Every message of Dr.Jit's core begins with the function that it comes from."""

_HARMLESS = (
    "jit_flush_malloc_cache(): ",
    "jit_find_library(): ",
    "jitc_llvm_init(): ",
    # The kernel cache, by default ~/.drjit: where it is full, not writable or holds a damaged file,
    # kernels are compiled anew.
    "jit_kernel_write(): ",
    "jit_kernel_load(): discarding cache file ",
    "jit_cache_sweep(): ",
)
"""Messages that do not concern the numbers, but speed or a library of another variant."""


class KernelWarning(RuntimeError):
    """Dr.Jit or OptiX warned during a render, so that its pictures cannot be trusted."""


class _Listening:
    """An error stream that passes everything on and keeps what Dr.Jit says."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self.warnings: list[str] = []

    def write(self, text: str) -> int:
        self.warnings += _FROM_DRJIT.findall(text)
        return self.stream.write(text)

    def __getattr__(self, name: str) -> object:
        return getattr(self.stream, name)


@contextlib.contextmanager
def refused_warnings(label: str) -> Iterator[None]:
    """Raise for anything that Dr.Jit or OptiX warns of inside the block.

    Dr.Jit writes its warnings to Python's `sys.stderr`, which is replaced meanwhile.

    Parameters
    ----------
    label : str
        Name of what is rendered, for the message.

    Raises
    ------
    KernelWarning
        With the first warning, after the block.

    Examples
    --------
    >>> with refused_warnings("scene 0123"):
    ...     print("jit_eval(): ... Disabling this ray tracing operation", file=sys.stderr)
    Traceback (most recent call last):
    ...
    malus.renderers.mitsuba.kernel_warnings.KernelWarning: scene 0123: ...
    """
    listening = _Listening(sys.stderr)
    with contextlib.redirect_stderr(cast(TextIO, listening)):
        yield
    serious = [text for text in listening.warnings if not text.startswith(_HARMLESS)]
    if serious:
        raise KernelWarning(
            f"{label}: the render is not to be trusted, it was warned: {serious[0]}"
        )
