"""One unit of work of a run, a family of scenes, and its outcome."""

from __future__ import annotations

import errno
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from malus.bench.running.parts import Failure
from malus.bench.running.plan import FamilyPlan
from malus.bench.running.results import Record, table_of
from malus.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

    from malus.reconstruct import Method


@dataclass(frozen=True)
class FamilyTask:
    """Work to do on one family of scenes.

    Attributes
    ----------
    id : str
        Of the part of the run's results that the task makes.
    methods : dict of name to reference
        By the reference, such as `package.module:object`, another process finds the method.
    examples : frozenset of str
        Scenes whose images are kept for people to look at.
    ladder : bool
        Whether methods are scored on every rung of the ladder of knowledge.
    following : FamilyPlan, optional
        The family that is next, whose kernels can run while this one is scored.
    """

    id: str
    family: FamilyPlan
    renderer: str
    methods: dict[str, str]
    metrics: tuple[str, ...] = ()
    examples: frozenset[str] = frozenset()
    ladder: bool = False
    following: FamilyPlan | None = None


@dataclass
class FamilyResult:
    """The outcome of a task.

    Attributes
    ----------
    table : DataFrame or None
        None where not a single row could be made, and before it is made of the records.
    records : list of Record
        Scores of every method on every scene; `attributes` are those of their table.
    failures : list of Failure
    examples : dict of file name to content
        Compressed images of the few scenes that were asked for.
    seconds : dict of stage to seconds
    clock : function
        The clock that measures the seconds of a stage; by default that on the wall.
    """

    table: pd.DataFrame | None = None
    failures: list[Failure] = field(default_factory=list)
    examples: dict[str, bytes] = field(default_factory=dict)
    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    clock: Callable[[], float] = time.perf_counter
    records: list[Record] = field(default_factory=list)
    attributes: dict[str, Any] = field(default_factory=dict)

    def tabled(self, renderer: str) -> FamilyResult:
        """Make the table of the records, and return self."""
        if self.records:
            with self.stage("score"):
                self.table = table_of(self.records)
            self.table.insert(self.table.columns.get_loc("method"), "renderer", renderer)
            self.table.attrs.update(self.attributes)
            self.records = []
        return self

    def whole(self, methods: Iterable[str]) -> set[str]:
        """Methods that worked on every scene."""
        failed = {failure.method for failure in self.failures}
        return set() if None in failed else set(methods) - failed

    def worked(self, methods: Iterable[Method]) -> list[Method]:
        """Methods that have not failed so far."""
        failed = {failure.method for failure in self.failures}
        return [method for method in methods if method.name not in failed]

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the seconds of a stage."""
        started = self.clock()
        try:
            yield
        finally:
            self.seconds[name] += self.clock() - started

    @contextmanager
    def guard(self, scene: Scene | None = None, method: Method | None = None) -> Iterator[None]:
        """Record an exception and go on, unless it means that the run has to stop."""
        try:
            yield
        except Exception as error:
            raise_what_stops(error)
            scene_id = scene.id if scene else None
            self.failures.append(Failure.of(error, scene_id, method.name if method else None))


_NO_ROOM = {errno.ENOSPC, errno.EDQUOT}


def raise_what_stops(error: BaseException) -> None:
    """Raise a stop by the user, or a full disk, also where another exception wraps it."""
    cause: BaseException | None = error
    while cause is not None:
        full = isinstance(cause, OSError) and cause.errno in _NO_ROOM
        if full or not isinstance(cause, Exception):
            raise cause
        cause = cause.__cause__ or cause.__context__
