"""Refuse workers of a cluster whose results would not be those of this process.

Parts are filed under this process's versions and files of methods: what a worker with others makes
would be filed wrongly. One that lacks malus would die of the first task, and the next one after it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from malus.bench.running.family_task import FamilyTask
from malus.bench.running.parts import stamped
from malus.renderers.variant import BACKENDS, Variant, choose, made_by
from malus.scenes.core.errors import InputError, first_line, reading

_HINT = "give all workers what is here, start them again, then give the command again"


class UnfitWorker(InputError):
    """A worker that would give other results than this process, or none; it ends the run."""


def check_workers(client: Any) -> None:
    """Refuse a cluster with a worker that lacks malus, or has another version of what renders.

    Raises
    ------
    UnfitWorker
        Naming the first such worker.
    """
    # A function travels here as bytes, which fail alone where they cannot be read; a task would
    # take the worker with it.
    for address, found in client.run(made_by, "mitsuba", on_error="return").items():
        if isinstance(found, OSError):  # lost at this moment: others get its tasks
            continue
        told = first_line(found) if isinstance(found, Exception) else found
        _check(f"worker {address}", made_by("mitsuba"), told)


def made_with(task: FamilyTask) -> dict[str, str]:
    """Versions and files that decide a task's results, by what they are of.

    Examples
    --------
    >>> from malus.bench.running.plan import plan
    >>> from malus.scenes import load_suite
    >>> family = plan(load_suite("quick"))[0]
    >>> made = made_with(FamilyTask("a", family, "torrance-sparrow", {"eq8": "eq8"}))
    >>> list(made), made["method eq8"]
    (['versions', 'method eq8'], 'eq8')
    """
    files = {f"method {name}": stamped(call) for name, call in task.methods.items()}
    return {"versions": made_by(task.renderer)} | files


def fit_variant(name: str, task: FamilyTask, expected: Mapping[str, str], worker: str) -> Variant:
    """The variant of that name on this worker, which must have what `made_with` told elsewhere.

    Raises
    ------
    UnfitWorker
        If it has another version or file, or the variant does not work here.
    """
    backend = next(backend for backend, variant in BACKENDS.items() if variant == name)
    where = f"worker {worker}"
    try:
        with reading(where, "malus and what it needs", _HINT):
            own, variant = made_with(task), choose(backend)
    except InputError as mistake:
        raise UnfitWorker(where, mistake.expected, mistake.found, _HINT) from None
    for what, value in expected.items():
        _check(f"{where}, {what}", value, own[what])
    return variant


def _check(where: str, expected: str, found: str) -> None:
    if found != expected:
        raise UnfitWorker(where, _told(expected), _told(found), _HINT)


def _told(made: str) -> str:
    """Versions, or how a method is called, as a message has them."""
    call, of_file, digest = made.rpartition("@")
    return f"{call} of file {digest or 'none'}" if of_file else made.replace("|", ", ")
