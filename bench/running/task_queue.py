"""Which family each process does next: one of which it has what takes long to make."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import replace
from itertools import islice
from typing import Any, Generic, TypeVar

from malus.bench.running.plan import FamilyPlan
from malus.renderers.family_key import FamilyKey

Task = TypeVar("Task", bound=Any)
"""A dataclass with the `family` that it is about, and the one that is `following`."""

AHEAD = 16
"""Tasks among which the next is chosen, where there are several processes."""

_TREE, _TABLE = 2, 1
"""Costs of the ray tracer's tree of a mesh, and of the methods' table of a roughness: the latter is
smaller, and a sphere needs no tree."""


class TaskQueue(Generic[Task]):
    """Tasks for one process in their order, or shared out among several.

    Among those that it has looked at already the first ones go first that cost a process least.
    Who takes a task is told which family it will be given next. Several processes get tasks whose
    meshes and roughnesses they have had before, and of others those that no other process has had;
    with `one_renders`, where one process renders for all of them, a mesh is had once for all.

    Examples
    --------
    >>> TaskQueue([]).next_of("any") is None
    True
    """

    def __init__(self, tasks: Iterable[Task], one_renders: bool = False) -> None:
        self._source = iter(tasks)
        self._waiting: list[Task] = []
        self._kept: dict[Hashable, Task] = {}
        self._had: dict[Hashable, set[Hashable]] = {}
        self._one_renders = one_renders

    def next_of(self, worker: Hashable) -> Task | None:
        """The next task of a process, with the family that follows; None where none is left."""
        task = self._kept.pop(worker, None) or self._cheapest(worker)
        if task is None and self._kept:  # what is left waits for others
            task = self._kept.pop(next(iter(self._kept)))
        if task is None:
            return None
        following = self._cheapest(worker)
        if following is None:
            return task
        self._kept[worker] = following
        return replace(task, following=following.family)

    def in_sight(self) -> int:
        """Tasks that are left, as far as it looks ahead."""
        self._look(AHEAD)
        return len(self._waiting) + len(self._kept)

    def _look(self, ahead: int) -> None:
        self._waiting += islice(self._source, max(0, ahead - len(self._waiting)))

    def _cheapest(self, worker: Hashable) -> Task | None:
        """Take the task that costs a process the least, the first of equal ones."""
        had = self._had.setdefault(worker, set())
        self._look(AHEAD if len(self._had) > 1 else 1)
        if not self._waiting:
            return None
        others = [theirs for other, theirs in self._had.items() if other != worker]

        built = had.union(*others) if self._one_renders else had

        def cost(place: int) -> tuple[int, int]:
            costs = _costs(self._waiting[place].family)
            new = {
                key: price
                for key, price in costs.items()
                if key not in (built if price == _TREE else had)
            }
            return sum(new.values()), sum(key in theirs for theirs in others for key in new)

        task = self._waiting.pop(min(range(len(self._waiting)), key=cost))
        had.update(_costs(task.family))
        return task


def _costs(family: FamilyPlan) -> dict[Hashable, int]:
    """What the first family of a mesh, or of a roughness, costs a process."""
    key = FamilyKey.of(family.scenes[0])
    costs: dict[Hashable, int] = {(key.facets, key.measured): _TABLE}
    if key.shape.kind != "sphere":
        costs[key.shape, key.camera] = _TREE
    return costs
