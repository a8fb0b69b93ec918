"""Run a suite: render every family, let every method reconstruct, score, and store the results."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from malus.bench.running.examples import example_ids, is_example_of, with_images_of
from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.output_folder import check_holds, prepare_folder
from malus.bench.running.parts import (
    Failure,
    Parts,
    in_order,
    merged,
    part_id,
    stamped,
    still_the_same,
    write_plan,
)
from malus.bench.running.plan import FamilyPlan, by_stage, plan, plan_record, stages
from malus.bench.running.progress import Progress, silent
from malus.bench.running.results import Results, origin, read_results, write_run, write_tables
from malus.bench.running.work import Engine, in_this_process
from malus.reconstruct import get_method
from malus.reconstruct.methods import by_name
from malus.renderers.mitsuba.wavefront import STAGES
from malus.renderers.variant import Variant, choose
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import owned, write_whole
from malus.scenes.core.remote import as_path
from malus.scenes.core.result_files import EXAMPLES
from malus.scenes.suite import Suite

if TYPE_CHECKING:
    import pandas as pd


def run(
    suite: Suite,
    out: Path | str,
    variant: Variant | None = None,
    progress: Progress = silent,
    engine: Engine | None = None,
    retry_failed: bool = False,
) -> Results:
    """Render, reconstruct and score a suite; write the results to `out`.

    Families whose results are already there, from the same suite, seed and versions, are taken
    over: a run that was stopped goes on where it was. What cannot be done is recorded, and the run
    goes on without it.

    Parameters
    ----------
    suite : Suite
    out : path of a folder
    variant : Variant, optional
        By default the fastest that works.
    progress : function of (families done, families in all, label of the next)
    engine : Engine, optional
        What does the work; by default this process.
    retry_failed : bool
        Try again what failed in an earlier run. A failure that names a wrong input is always tried
        again, because it may have been mended; any other would cost the same time for the same end.

    Raises
    ------
    InputError
        Unknown method or metric, two methods of one name, folder that cannot be written or that a
        run of another suite is writing, not a single family that can be rendered.
    """
    started = time.perf_counter()
    chosen_variant = variant or choose()
    methods = by_name((get_method(reference).name, reference) for reference in suite.methods)
    if suite.metrics:
        from malus.bench.scoring.extra_metrics import get_metrics

        get_metrics(suite.metrics)  # whose names are checked before anything is rendered
    check_holds(as_path(out), "a run")
    progress(0, 1, "planning")  # half a minute where thousands of objects are drawn
    families = plan(suite)
    folder = prepare_folder(as_path(out), "a run")
    suite_run = SuiteRun(suite, families, methods, folder, chosen_variant, progress, retry_failed)
    with owned(folder, suite.id):
        write_plan(folder, suite, families, methods, chosen_variant)
        for task, result in (engine or in_this_process(chosen_variant))(suite_run.tasks()):
            suite_run.keep(task, result)
        progress(len(families), len(families), "writing")
        totals = RunTotals()
        write_tables(folder, suite_run.tables(totals))
        suite_run.seconds["total"] = time.perf_counter() - started
        write_run(folder, suite_run.record(totals))
    return read_results(folder)


@dataclass
class SuiteRun:
    """One run of a suite: its tasks, where their results go, and the seconds of its stages."""

    suite: Suite
    families: Sequence[FamilyPlan]
    methods: dict[str, str]
    folder: Path
    variant: Variant
    progress: Progress = silent
    retry_failed: bool = False
    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    taken_over: int = 0
    finished: int = 0
    label: str = ""
    stamps: dict[str, dict[str, str]] = field(default_factory=dict)
    """Of each task's methods, when the task was given out."""

    @property
    def parts(self) -> Parts:
        """Parts in the folder: the results of each family."""
        return Parts(self.folder)

    def tasks(self) -> Iterator[FamilyTask]:
        """Tasks that are left, each looked up shortly before its turn: others may do it, too."""
        examples = example_ids(self.families)
        for family in in_working_order(self.families):
            name = part_id(family, self.suite, self.variant.name)
            shown = examples.intersection(family.scene_ids)
            missing = self._missing_methods(name, shown)
            if not missing:
                self.finished += 1
                continue
            self.label = family.label
            self.progress(self.finished, len(self.families), self.label)
            self.stamps[name] = {key: stamped(reference) for key, reference in missing.items()}
            yield FamilyTask(
                name,
                family,
                self.suite.renderer,
                missing,
                self.suite.metrics,
                shown,
                ladder=self.suite.knowledge == "ladder",
            )

    def _missing_methods(self, name: str, examples: Collection[str]) -> dict[str, str]:
        """Methods that a part lacks, without those whose failure is final.

        All of them where the images of an example are missing, or of a run at other samples.
        """
        methods = self._whole_methods(self.parts.table(name))
        if methods >= set(self.methods):
            files = (self.folder / EXAMPLES / f"{scene}.npz" for scene in examples)
            if not all(is_example_of(name, path) for path in files):
                return self.methods
            self.taken_over += 1
            return {}
        failures = self.parts.failures(name)
        failed = {
            failure.method
            for failure in failures
            if failure.is_final(self.retry_failed) and not self._has_changed(failure)
        }
        if None in failed:
            return {}
        return {
            method: reference
            for method, reference in self.methods.items()
            if method not in methods | failed
        }

    def _has_changed(self, failure: Failure) -> bool:
        """Whether what failed is a method whose weights or module are others by now."""
        called = self.methods.get(failure.method or "")
        return called is not None and failure.stamp not in ("", stamped(called))

    def _whole_methods(self, table: pd.DataFrame | None) -> set[str]:
        """Methods that a table has for every scene, and none of the same name that is another."""
        found = _methods_of(table).items()
        return {name for name, reference in found if self.methods.get(name, reference) == reference}

    def keep(self, task: FamilyTask, result: FamilyResult) -> None:
        """Store the result of a task, the examples first: a part is never there without them."""
        old = self.parts.table(task.id)
        before = _methods_of(old)
        done = {name: before[name] for name in before if name not in task.methods}
        stamps = self.stamps.pop(task.id)
        for name, content in result.examples.items():
            path = self.folder / EXAMPLES / name
            _write_bytes(path, with_images_of(done, path, content))
        table = merged(old, result.table, task.methods)
        if table is not None:
            now = result.whole(_unchanged(task, stamps))
            self.parts.write(task.id, table, done | {name: task.methods[name] for name in now})
        failures_of_others = [
            failure
            for failure in self.parts.failures(task.id)
            if failure.method not in {None, *task.methods}
        ]
        failed = [replace(one, stamp=stamps.get(one.method or "", "")) for one in result.failures]
        failures = [*failures_of_others, *failed]
        self.parts.write_failures(task.id, task.family.label, failures)
        for stage, seconds in result.seconds.items():
            self.seconds[stage] += seconds
        self.finished += 1
        self.progress(self.finished, len(self.families), self.label)

    def tables(self, totals: RunTotals) -> Iterator[pd.DataFrame]:
        """Tables of all families, one at a time; each is counted in `totals`.

        Raises
        ------
        InputError
            If there is not a single row.
        """
        for family in self.families:
            name = part_id(family, self.suite, self.variant.name)
            table = self.parts.table(name)
            if table is not None and table.method.isin(self.methods).any():
                ordered = in_order(table, family, self.methods)
                totals.add(family, ordered)
                yield ordered
            lacking = set(self.methods) - self._whole_methods(table)
            if lacking:
                totals.failures.append(_reason(self.parts.failures(name), lacking, family))
        if not totals.families:
            raise InputError(
                f"suite {self.suite.name}",
                "a family that can be rendered and scored",
                f"{len(totals.failures)} that failed",
                _first_of(totals.failures),
            )

    def record(self, totals: RunTotals) -> dict[str, Any]:
        """Record for `run.json`: how the results came about."""
        return origin() | {
            "suite": self.suite.model_dump(mode="json"),
            "suite_id": self.suite.id,
            "variant": {"name": self.variant.name, "reason": self.variant.reason},
            "seconds": {name: round(value, 3) for name, value in self.seconds.items()},
            "families": len(self.families),
            "families_taken_over": self.taken_over,
            "families_failed": len(totals.failures),
            "failures": [failure.reason for failure in totals.failures[:REASONS_KEPT]],
            "scenes": totals.scenes,
            "interpolation_rms": totals.interpolation_rms,
            "samples": {"least": min(totals.samples), "most": max(totals.samples)},
            "plan": plan_record(self.suite, totals.families, totals.render_seconds),
        }


def in_working_order(families: Sequence[FamilyPlan]) -> Sequence[FamilyPlan]:
    """Families in the order of the plan, or by stage where there are more than stay loaded.

    The tables of dozens of roughnesses are kept, and one costs less than a tree.
    """
    several = len(set(stages(families))) > STAGES
    return by_stage(families) if several else families


def _unchanged(task: FamilyTask, stamps: Mapping[str, str]) -> list[str]:
    """Methods of a task whose weights or module nobody changed while it was done."""
    return [name for name, called in task.methods.items() if stamped(called) == stamps[name]]


def _methods_of(table: pd.DataFrame | None) -> dict[str, str]:
    """Methods that a part has for every scene of its family, and how each is called."""
    return {} if table is None else still_the_same(table.attrs)


def _reason(failures: Iterable[Failure], lacking: set[str], family: FamilyPlan) -> Failure:
    """The first failure that explains why a family lacks these methods."""
    for failure in failures:
        if failure.method is None or failure.method in lacking:
            return failure
    hint = "give the command again: it makes the part again"
    raise InputError(f"results of {family.label}", "a whole part", "a damaged or lost one", hint)


def _first_of(failures: Sequence[Failure]) -> str:
    """What the first of some failures says, and how it is tried again where nothing else helps."""
    if not failures:
        return "the first says: nothing"
    again = "; `retry_failed` tries them again" if failures[0].is_final(False) else ""
    return f"the first says: {failures[0].reason}{again}"


def _write_bytes(path: Path, content: bytes) -> None:
    write_whole(path, lambda temporary: temporary.write_bytes(content))


REASONS_KEPT = 20
"""Largest number of failures in `run.json`; the parts and `malus status` have all."""


@dataclass
class RunTotals:
    """Totals over the families of a run, for its record, counted while their tables are written.

    Attributes
    ----------
    families : list of FamilyPlan
        Those with a table, of this run or an earlier one.
    failures : list of Failure
        The first of each family of which something failed.
    samples : list of int
        Samples a pixel of each.
    """

    families: list[FamilyPlan] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    samples: list[int] = field(default_factory=list)
    scenes: int = 0
    interpolation_rms: float = 0.0
    render_seconds: float = 0.0

    def add(self, family: FamilyPlan, table: pd.DataFrame) -> None:
        """Count a family's table."""
        self.families.append(family)
        self.samples.append(table.attrs["samples"])
        self.scenes += table.scene.nunique()
        self.interpolation_rms = max(self.interpolation_rms, table.attrs["interpolation_rms"])
        self.render_seconds += table.attrs["render_seconds"]
