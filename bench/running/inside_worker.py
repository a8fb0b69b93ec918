"""What a worker process does: it takes tasks and sends what they yield, until its parent is gone.

Little is imported here: see `worker_process`, which starts it.
"""

from __future__ import annotations

import faulthandler
import gc
import importlib
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import spawn
from multiprocessing.connection import Connection
from typing import Any

END, ITEM, ERROR, READY = "end", "item", "error", "ready"
"""Kinds of messages of a worker process."""

SCORING = ("malus.bench.running.scored_family", "malus.reconstruct.builtin_methods")
"""Modules that it needs to score a family."""

DRAWING = (
    "malus.reports.figures.undocumented",
    "malus.reports.figures.figure5",
    "malus.reports.figures.angles",
)
"""Modules that it needs to draw most figures of a report, in this order."""


def import_all(*modules: str) -> None:
    """Import modules by their names."""
    for module in modules:
        importlib.import_module(module)


def without_results(function: Callable[..., object], *arguments: Any) -> Iterator[None]:
    """Call a function that imports, and yield nothing."""
    gc.disable()  # modules stay: nobody need look for garbage while they are made, or among them
    function(*arguments)
    gc.freeze()
    yield from ()


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


def serve(
    connection: Connection, error_stream: int | None, main: tuple[str | None, str | None]
) -> None:
    """Do the tasks that come through the connection, until the parent closes it."""
    if error_stream is not None:
        os.dup2(error_stream, 2)
        os.close(error_stream)
    try:
        connection.send(READY)
    except BrokenPipeError:  # the parent was killed meanwhile
        return
    # Ctrl-C goes to all processes of a terminal; the parent ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow_parent, daemon=True).start()
    while True:
        gc.enable()
        try:
            message = connection.recv_bytes()
        except EOFError:
            return
        try:
            function, arguments, timeout = _unpickled(message, main)
            with at_most(timeout):
                for item in function(*arguments):
                    connection.send((ITEM, item))
            connection.send((END, None))
        except Exception as error:
            connection.send((ERROR, _carried(error)))


def _carried(error: Exception) -> Exception:
    """The exception; one with its name and words where another process cannot make it again."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # its class decides what that raises
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _unpickled(message: bytes, main: tuple[str | None, str | None]) -> Any:
    """The object of a message; the program that started this one is run where it defines a part.

    Raises
    ------
    InputError
        Where that program cannot be run again.
    """
    try:
        return pickle.loads(message)
    except AttributeError:
        name, path = main
        try:
            if name is not None:
                spawn._fixup_main_from_name(name)  # type: ignore[attr-defined]
            elif path is not None:
                spawn._fixup_main_from_path(path)  # type: ignore[attr-defined]
            return pickle.loads(message)
        except Exception as error:
            from malus.scenes.core.errors import InputError, first_line

            expected = "methods that a worker process can import"
            hint = "define them in a module of their own"
            raise InputError("methods", expected, first_line(error), hint) from None


def _follow_parent() -> None:
    """End this process when its parent ends, also where that was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
