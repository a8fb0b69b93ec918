"""A worker process: a crash or a hang of native code costs one task, not the run.

Python cannot interrupt a renderer that never returns, nor outlive its segmentation fault. A worker
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
from typing import Any, TypeVar

from malus.scenes.core.errors import InputError

ATTEMPTS = 2
"""Worker processes that one task may cost before it is recorded as failed."""

TIMEOUT_SECONDS = 3600.0
"""Time that one task may take by default: a hundred times that of the largest family of scenes in
the suites of malus, on two cores."""

LONGEST_SECONDS = 1e6
"""Largest timeout, eleven days; far longer ones overflow the clock of the watchdog."""

_END = "end"
_ITEM = "item"
_ERROR = "error"


_Item = TypeVar("_Item")


class Died(Exception):
    """The worker process is gone; the message says why."""


class WorkerProcess:
    """A process that does one task after the other; as a context manager it is ended at the end.

    It is started with the first task, and again after it died.

    Parameters
    ----------
    timeout : float
        Seconds that a task may take.

    Raises
    ------
    InputError
        If `timeout` is not above 0, or is more than `LONGEST_SECONDS`.

    Examples
    --------
    >>> with WorkerProcess(timeout=60) as worker:
    ...     list(worker.stream(range, 3))
    [0, 1, 2]
    """

    def __init__(self, timeout: float = TIMEOUT_SECONDS) -> None:
        if not 0 < timeout <= LONGEST_SECONDS:
            expected = f"seconds above 0, at most {LONGEST_SECONDS:g}"
            raise InputError("timeout", expected, f"{timeout:g}", "leave it out")
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
        """Yield what `function(*arguments)` yields in the worker; both have to be picklable.

        Raises
        ------
        Died
            Where the worker crashed, was killed, or took longer than `timeout`.
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
        self._connection, worker_end = context.Pipe()
        self._process = context.Process(target=_serve, args=(worker_end,))
        self._process.start()
        worker_end.close()

    def _reason(self, seconds: float) -> str:
        """Reason why the worker ended, after that many seconds of its task."""
        self._process.join()
        code = self._process.exitcode
        self._stop()
        if code < 0:
            return f"the process that did it died of {signal.Signals(-code).name}"
        if seconds >= self.timeout:
            return f"it took longer than the {self.timeout:g} seconds of its timeout"
        return f"the process that did it ended with code {code}"

    def _stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._connection.close()  # type: ignore[union-attr]
            self._process = self._connection = None


def retried(attempt: Callable[[], Iterator[_Item]]) -> Iterator[_Item]:
    """Yield what `attempt()` yields, and call it again where the worker dies, `ATTEMPTS` times.

    Raises
    ------
    Died
        Where the worker died in the last attempt, too.
    """
    for attempts_left in reversed(range(ATTEMPTS)):
        try:
            yield from attempt()
        except Died as death:
            if not attempts_left:
                raise Died(f"{death}, {ATTEMPTS} times") from None
        else:
            return


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """End this process at once where the block takes longer, also in native code.

    The watchdog is a thread written in C, which does not wait for the lock of Python.
    """
    with open(os.devnull, "w", encoding="ascii") as discarded:
        faulthandler.dump_traceback_later(seconds, exit=True, file=discarded)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


def _serve(connection: Connection) -> None:
    """Do the tasks that come through the connection, until the parent closes it."""
    # Ctrl-C goes to all processes of a terminal; the parent ends this one.
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
    """End this process when its parent ends, also where that was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
