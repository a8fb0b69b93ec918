"""Work in a child process: a crash or a hang of native code costs one task, not the run.

Python cannot interrupt a renderer that never returns, nor outlive its segmentation fault. A child
process can be given up; the next task gets a fresh one.
"""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

from malus.scenes.core.errors import InputError

ATTEMPTS = 2
"""Children that one task may cost before it is recorded as failed."""

TIMEOUT_SECONDS = 3600.0
"""Time that one task may take by default: some hundred times what the largest family of the suites
that malus brings takes on two cores."""

LONGEST_SECONDS = 1e6
"""Eleven days; far longer ones overflow the clock of the watchdog."""

_END = "end"
_ITEM = "item"
_ERROR = "error"


class Died(Exception):
    """The child is gone; the message tells what of."""


class WorkerProcess:
    """A process that does one task after the other; a context manager that ends it.

    It is started with the first task, and again after it died.

    Parameters
    ----------
    timeout : float
        Seconds that a task may take.

    Raises
    ------
    InputError
        If that is no time, or more than `LONGEST_SECONDS`.

    Examples
    --------
    >>> with Child(timeout=60) as child:
    ...     list(child.stream(range, 3))
    [0, 1, 2]
    """

    def __init__(self, timeout: float = TIMEOUT_SECONDS) -> None:
        if not 0 < timeout <= LONGEST_SECONDS:
            expected = f"seconds above 0, at most {LONGEST_SECONDS:g}"
            raise InputError("--timeout", expected, f"{timeout:g}", "leave it out")
        self.timeout = timeout
        self._process: Any = None
        self._connection: Connection | None = None

    def __enter__(self) -> WorkerProcess:
        """Start nothing yet."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process, whatever it does."""
        self._stop()

    def stream(self, function: Callable[..., Iterable[Any]], *arguments: Any) -> Iterator[Any]:
        """What `function(*arguments)` yields in the child; both have to be picklable.

        Raises
        ------
        Died
            Where it crashed, was killed, or took longer than `timeout`.
        Exception
            What the function raises.
        """
        if self._process is None:
            self._start()
        assert self._connection is not None
        started = time.monotonic()
        try:
            self._connection.send((function, arguments, self.timeout))
            while True:
                kind, item = self._connection.recv()
                if kind == _ERROR:
                    raise item
                if kind == _END:
                    return
                yield item
        except (EOFError, BrokenPipeError, ConnectionResetError):
            raise Died(self._reason(time.monotonic() - started)) from None
        except GeneratorExit:
            # The rest of the stream would be taken for the beginning of the next.
            self._stop()
            raise

    def _start(self) -> None:
        # A fork would copy locks that the threads of LLVM and BLAS hold.
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,))
        self._process.start()
        theirs.close()

    def _reason(self, seconds: float) -> str:
        self._process.join()
        code = self._process.exitcode
        self._stop()
        if code < 0:
            return f"the process that did it died of {signal.Signals(-code).name}"
        if seconds >= self.timeout:
            return f"it took longer than the {self.timeout:g} seconds of --timeout"
        return f"the process that did it ended with code {code}"

    def _stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._connection.close()  # type: ignore[union-attr]
            self._process = self._connection = None


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """End this process at once where the block takes longer, in native code too.

    The watchdog is a thread of C, which waits for no lock of Python's.
    """
    with open(os.devnull, "w", encoding="ascii") as nothing:
        faulthandler.dump_traceback_later(seconds, exit=True, file=nothing)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


def _serve(connection: Connection) -> None:
    """Do what the parent asks, until it hangs up."""
    # Ctrl-C goes to all processes of a terminal: the parent's business.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow_parent, daemon=True).start()
    while True:
        try:
            function, arguments, timeout = connection.recv()
        except EOFError:
            return
        try:
            with at_most(timeout):
                for item in function(*arguments):
                    connection.send((_ITEM, item))
            connection.send((_END, None))
        except Exception as error:
            connection.send((_ERROR, error))


def _follow_parent() -> None:
    """End with the parent, also where that was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
