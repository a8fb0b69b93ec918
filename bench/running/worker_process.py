"""A worker process: a crash or a hang of native code costs one task, not the run.

Python cannot interrupt a renderer that never returns, nor outlive its segmentation fault. A worker
process can be given up; the next task gets a fresh one.

A new process of `multiprocessing` begins by running the program again that started it, which fails
for one read from standard input and runs away for one without `if __name__ == "__main__"`. Workers
therefore start without it, and run it only where a task holds something that it defines.

Little is imported here, so that a process can start, and import what it needs, while the one that
starts it still imports.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.reduction import DupFd
from types import ModuleType
from typing import IO, Any, TypeVar

from malus.bench.running.inside_worker import END, ERROR, ITEM, READY, serve, without_results

ATTEMPTS = 2
"""Worker processes that one task may cost before it is recorded as failed."""

TIMEOUT_SECONDS = 3600.0
"""Time that one task may take by default: a hundred times that of the largest family of scenes in
the suites of malus, on two cores."""

LONGEST_SECONDS = 1e6
"""Largest timeout, eleven days; far longer ones overflow the clock of the watchdog."""

_START_SECONDS = 300.0
"""Time in which a process has to start: it imports malus, which takes a second or two."""

_start_lock = threading.Lock()

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
            from malus.scenes.core.errors import InputError

            expected = f"seconds above 0, at most {LONGEST_SECONDS:g}"
            raise InputError("timeout", expected, f"{timeout:g}", "leave it out")
        self.timeout = timeout
        self._process: Any = None
        self._connection: Connection | None = None
        self._told: IO[bytes] | None = None  # its errors, until it is ready
        self._begun = 0
        self._loads: list[tuple[Any, ...]] = []
        self._given_up = False

    def __enter__(self) -> WorkerProcess:
        """Start nothing yet."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process, whatever it does."""
        self._stop()

    def give_up(self) -> None:
        """End the process for good, from any thread; who waits for it is told that it died."""
        self._given_up = True
        process = self._process
        if process is not None:
            process.kill()

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
        self._wait_until_ready()
        started = time.monotonic()
        try:
            self._connection.send((function, arguments, self.timeout))
            while self._begun:
                self._begun -= self._connection.recv()[0] in (END, ERROR)
            started = time.monotonic()
            kind, item = self._connection.recv()
            while kind == ITEM:
                yield item
                kind, item = self._connection.recv()
        except (EOFError, BrokenPipeError, ConnectionResetError):
            raise Died(self._reason(time.monotonic() - started)) from None
        except GeneratorExit:
            # The rest of the stream would be taken for the beginning of the next.
            self._stop()
            raise
        if kind == ERROR:  # here: one like those of a lost connection is no death
            raise item

    def begin(self, function: Callable[..., object], *arguments: Any) -> None:
        """Start the process where there is none, and let it do what nobody waits for: imports.

        One that is started after it died does again what was done. What goes wrong is told by the
        task that needs it.

        Examples
        --------
        >>> from malus.bench.running.inside_worker import import_all
        >>> with WorkerProcess(timeout=60) as worker:
        ...     worker.begin(import_all, "json")
        ...     list(worker.stream(range, 2))
        [0, 1]
        """
        self._loads.append((function, *arguments))
        with suppress(Died, OSError):
            if self._process is None:
                self._start()
            else:
                self._load(self._loads[-1])

    def _load(self, call: tuple[Any, ...]) -> None:
        assert self._connection is not None
        # Imports may take longer than tasks that are given little time.
        self._connection.send((without_results, call, max(self.timeout, _START_SECONDS)))
        self._begun += 1

    def is_free(self) -> bool:
        """Whether it would begin a task at once: it has started, and done what it was to begin.

        So is one that died, or was never started: its next task starts another.
        """
        try:
            while self._connection is not None and (self._begun or self._told is not None):
                if not self._connection.poll():
                    return False
                if self._told is not None:
                    self._wait_until_ready()
                else:
                    self._begun -= self._connection.recv()[0] in (END, ERROR)
        except (Died, EOFError, ConnectionResetError):
            self._stop()
        return True

    def _start(self) -> None:
        """Start a process.

        Raises
        ------
        Died
            Where it could not start; the message is the last line that it wrote.
        """
        if self._given_up:
            raise Died("it was given up")
        # A fork would copy locks that the threads of LLVM and BLAS hold.
        context = multiprocessing.get_context("spawn")
        self._connection, worker_end = context.Pipe()
        self._begun = 0
        self._told = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the process is ready
        errors_to_file = _errors_to(self._told.fileno())
        with _start_lock, _safe_path(), errors_to_file as error_stream, main_hidden() as main:
            process = context.Process(target=serve, args=(worker_end, error_stream, main))
            try:
                process.start()
                self._process = process
                if self._given_up:
                    process.kill()
            except OSError as error:  # gone before it was told what to do
                raise self._not_started(f"it ended with {error}") from None
            finally:
                worker_end.close()
        with suppress(OSError):  # its task tells
            for call in self._loads:
                self._load(call)

    def _wait_until_ready(self) -> None:
        """Wait until a process that was started is ready.

        Raises
        ------
        Died
            Where it could not start; the message is the last line that it wrote.
        """
        if self._told is None:
            return
        if not _is_ready(self._connection):
            self._process.kill()
            self._process.join()
            raise self._not_started(f"it ended with code {self._process.exitcode}")
        self._told.close()
        self._told = None

    def _not_started(self, why: str) -> Died:
        """What is raised for a process that could not start; it is stopped."""
        assert self._told is not None
        self._told.seek(0)
        lines = self._told.read().decode("utf-8", "replace").strip().splitlines()
        self._stop()
        reason = lines[-1].strip()[:200] if lines else why
        return Died(f"the process that should do it could not start: {reason}")

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
        if self._begun:  # what it did not survive, or was not done with, is not begun again
            del self._loads[-self._begun :]
            self._begun = 0
        if self._told is not None:
            self._told.close()
            self._told = None
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


def _is_ready(connection: Connection | None) -> bool:
    """Whether a new process says that it is ready, in time."""
    assert connection is not None
    try:
        return connection.poll(_START_SECONDS) and connection.recv() == READY
    except (EOFError, ConnectionResetError):
        return False


@contextmanager
def _safe_path() -> Iterator[None]:
    """Let a process that is started import nothing from the working folder before it has this path.

    A file there that is called `types.py` or `queue.py` would end it. It gets this process's path.
    """
    former = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if former is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = former


class _Inherited:
    """A file descriptor of this process that a process which is started gets, too."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def __reduce__(self) -> tuple[Any, ...]:
        """As the descriptor that the new process has: only while that is started."""
        return _detached, (DupFd(self._descriptor),)


def _detached(descriptor: Any) -> int:
    return int(descriptor.detach())


@contextmanager
def _errors_to(file: int) -> Iterator[_Inherited | None]:
    """Send the error stream to a file, as that of a process that is started; yields the former one.

    None where this process has no error stream.
    """
    # It lives on, and would keep the file as its error stream.
    resource_tracker.ensure_running()
    try:
        stream = os.dup(2)
    except OSError:
        yield None
        return
    try:
        os.dup2(file, 2)
        yield _Inherited(stream)
    finally:
        os.dup2(stream, 2)
        os.close(stream)


@contextmanager
def main_hidden() -> Iterator[tuple[str | None, str | None]]:
    """Keep a process that is started from running the program again; yields its name and path."""
    main = sys.modules["__main__"]
    name = getattr(getattr(main, "__spec__", None), "name", None)  # a debugger's has no __spec__
    path = getattr(main, "__file__", None)
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield name, None if path is None else os.path.abspath(path)
    finally:
        sys.modules["__main__"] = main
