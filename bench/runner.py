"""The main job: render every family, let every method reconstruct, score, and keep the results."""

from __future__ import annotations

import platform
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from malus.bench.examples import chosen, keep
from malus.bench.extra_metrics import get_metrics
from malus.bench.judge import Judge
from malus.bench.plan import FamilyPlan, plan
from malus.bench.results import (
    PARTS,
    Results,
    inapplicable_rows,
    prepare_folder,
    score_rows,
    table_of,
    write_results,
    write_whole,
)
from malus.reconstruct import Inapplicable, Method, get_method
from malus.renderers.family import render_family
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, choose
from malus.scenes.model import content_id
from malus.scenes.suite import Suite

SCHEMA = 1
"""Counts up when the rows of a part change their meaning: older parts are then made again."""

Progress = Callable[[int, int, str], None]


def _silent(_done: int, _total: int, _label: str) -> None:
    """Progress that nobody watches."""


def run(
    suite: Suite,
    out: Path | str,
    variant: Variant | None = None,
    progress: Progress = _silent,
) -> Results:
    """Render, reconstruct and score a suite; write the results to `out`.

    Families whose results are already there, from the same suite, seed and versions, are taken
    over: a run that was stopped goes on where it was.

    Parameters
    ----------
    suite : Suite
    out : path of a folder
    variant : Variant, optional
        By default the fastest that works.
    progress : function of (families done, families in all, label of the next)

    Raises
    ------
    InputError
        Unknown method, folder that cannot be written.
    """
    started = time.perf_counter()
    families = plan(suite)
    job = Job(
        suite,
        [get_method(name) for name in suite.methods],
        prepare_folder(Path(out)),
        variant or choose(),
        chosen(families),
    )
    parts = []
    for done, family in enumerate(families):
        progress(done, len(families), family.label)
        parts.append(job.part(family))
    progress(len(families), len(families), "writing")
    job.seconds["total"] = time.perf_counter() - started
    results = Results(pd.concat(parts, ignore_index=True), job.record(parts))
    write_results(job.folder, results)
    return results


@dataclass
class Job:
    """One run: what it is about, where it writes, and the seconds that its stages took."""

    suite: Suite
    methods: Sequence[Method]
    folder: Path
    variant: Variant
    examples: frozenset[str]
    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    reused: int = 0

    def part(self, family: FamilyPlan) -> pd.DataFrame:
        """The table of one family, from an earlier run where that is there."""
        names = [method.name for method in self.methods]
        suite = self.suite
        content = [family.id, suite.renderer, names, suite.metrics, self.variant.name]
        content += [version("malus"), SCHEMA]
        path = self.folder / PARTS / f"{content_id(content)}.parquet"
        part = _stored(path)
        if part is not None:
            self.reused += 1
            return part
        part = self._table(family)
        write_whole(path, lambda temporary: part.to_parquet(temporary, index=False))
        return part

    def _table(self, family: FamilyPlan) -> pd.DataFrame:
        records: list[dict[str, Any]] = []
        worst = 0.0
        for truth in self._truths(family):
            with self._stage("reconstruct and score"):
                records += self._rows(truth)
            if truth.scene.id in self.examples:
                with self._stage("write examples"):
                    keep(self.folder, truth, self.methods)
            worst = max(worst, truth.interpolation_error.get("rms", 0.0))
        table = table_of(records)
        # pandas stores attributes with the Parquet file: they come back when a run goes on
        table.attrs["interpolation_rms"] = worst
        return table

    def _rows(self, truth: Truth) -> list[dict[str, Any]]:
        judge = Judge(truth)
        metrics = get_metrics(self.suite.metrics)
        records: list[dict[str, Any]] = []
        for method in self.methods:
            try:
                records += score_rows(truth.scene, method.name, judge.score(method, metrics))
            except Inapplicable as reason:
                records += inapplicable_rows(truth.scene, method.name, str(reason))
        return records

    def _truths(self, family: FamilyPlan) -> Iterator[Truth]:
        if self.suite.renderer == "torrance-sparrow":
            for scene in family.scenes:
                with self._stage("render"):
                    truth = render_torrance_sparrow(scene)
                yield truth
            return
        with self._stage("render"):
            rendered = render_family(family.scenes, family.sampling, self.variant, errors=False)
        for scene in family.scenes:
            with self._stage("interpolate in eta"):
                truth = rendered.truth(scene, standard_error=False)
            yield truth

    @contextmanager
    def _stage(self, name: str) -> Iterator[None]:
        started = time.perf_counter()
        yield
        self.seconds[name] += time.perf_counter() - started

    def record(self, parts: Sequence[pd.DataFrame]) -> dict[str, Any]:
        """What `run.json` says: how the results came about."""
        packages = ("malus", "mitsuba", "drjit", "numpy", "scipy", "pandas")
        versions = {name: version(name) for name in packages}
        return {
            "suite": self.suite.model_dump(mode="json"),
            "suite_id": self.suite.id,
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "versions": versions | {"python": platform.python_version()},
            "machine": {"system": platform.platform(), "processor": platform.machine()},
            "variant": {"name": self.variant.name, "reason": self.variant.reason},
            "seconds": {name: round(value, 3) for name, value in self.seconds.items()},
            "families": len(parts),
            "families_taken_over": self.reused,
            "scenes": sum(part.scene.nunique() for part in parts),
            "interpolation_rms": max(part.attrs["interpolation_rms"] for part in parts),
        }


def _stored(path: Path) -> pd.DataFrame | None:
    """An earlier part, or None; parts are written whole, so that one that exists is complete."""
    if not path.exists():
        return None
    try:
        return pd.read_parquet(path)
    except (OSError, ValueError):
        return None
