"""Hide what other libraries print beside the exceptions that they raise."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout

_lock = threading.Lock()
_inside = 0
_undo = ExitStack()


@contextmanager
def quiet() -> Iterator[None]:
    """Hide what is written to `sys.stdout` and to the error stream, that of C libraries too.

    Both belong to the whole process: what other threads write meanwhile is lost as well, so that
    this is for the moments in which a file is decoded or a library is loaded. Threads may be inside
    together: the first redirects, the last restores.

    Examples
    --------
    >>> with quiet():
    ...     print("hidden")
    """
    global _inside, _undo
    with _lock:
        if not _inside:
            _undo = _redirected()
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if not _inside:
                _undo.close()


def _redirected() -> ExitStack:
    """Redirect both streams; closing the result restores them."""
    with ExitStack() as undo:
        null_device = undo.enter_context(open(os.devnull, "w", encoding="utf-8"))
        if sys.stderr is not None:
            sys.stderr.flush()
            error_stream = os.dup(2)
            undo.callback(os.close, error_stream)
            undo.callback(os.dup2, error_stream, 2)
            os.dup2(null_device.fileno(), 2)
        undo.enter_context(redirect_stdout(null_device))
        return undo.pop_all()
