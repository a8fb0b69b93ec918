"""The main job: render every family, let every method reconstruct, score, and keep the results."""

from __future__ import annotations

import platform
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

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

Progress = Callable[[int, int, str], None]
Seconds = defaultdict[str, float]


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
    methods = [get_method(name) for name in suite.methods]
    folder = prepare_folder(Path(out))
    chosen = variant or choose()
    families = plan(suite)
    seconds: Seconds = defaultdict(float)
    errors: list[float] = []
    parts, reused = [], 0
    for done, family in enumerate(families):
        progress(done, len(families), family.label)
        path = folder / PARTS / f"{_part_id(family, suite, methods, chosen)}.parquet"
        part = _stored(path)
        if part is None:
            part = _family_table(family, suite, methods, chosen, seconds)
            _store(path, part)
        else:
            reused += 1
        parts.append(part)
        errors.append(float(part.attrs.get("interpolation_rms", 0.0)))
    progress(len(families), len(families), "writing")
    seconds["total"] = time.perf_counter() - started
    record = _record(suite, chosen, seconds, families, reused, max(errors, default=0.0))
    results = Results(pd.concat(parts, ignore_index=True), record)
    write_results(folder, results)
    return results


def _stored(path: Path) -> pd.DataFrame | None:
    """An earlier part, or None; parts are written whole, so that one that exists is complete."""
    if not path.exists():
        return None
    try:
        return pd.read_parquet(path)
    except (OSError, ValueError):
        return None


def _store(path: Path, part: pd.DataFrame) -> None:
    write_whole(path, lambda temporary: part.to_parquet(temporary, index=False))


def _part_id(family: FamilyPlan, suite: Suite, methods: Sequence[Method], variant: Variant) -> str:
    names = [method.name for method in methods]
    return content_id([family.id, suite.renderer, names, variant.name, version("malus")])


def _family_table(
    family: FamilyPlan,
    suite: Suite,
    methods: Sequence[Method],
    variant: Variant,
    seconds: Seconds,
) -> pd.DataFrame:
    records: list[dict[str, Any]] = []
    worst = 0.0
    for truth in _truths(family, suite, variant, seconds):
        before = time.perf_counter()
        judge = Judge(truth)
        for method in methods:
            try:
                records += score_rows(truth.scene, method.name, judge.score(method))
            except Inapplicable as reason:
                records += inapplicable_rows(truth.scene, method.name, str(reason))
        seconds["reconstruct and score"] += time.perf_counter() - before
        worst = max(worst, truth.interpolation_error.get("rms", 0.0))
    table = table_of(records)
    table.attrs["interpolation_rms"] = worst
    return table


def _truths(
    family: FamilyPlan, suite: Suite, variant: Variant, seconds: Seconds
) -> Iterator[Truth]:
    before = time.perf_counter()
    if suite.renderer == "torrance-sparrow":
        for scene in family.scenes:
            truth = render_torrance_sparrow(scene)
            seconds["render"] += time.perf_counter() - before
            yield truth
            before = time.perf_counter()
        return
    rendered = render_family(family.scenes, family.sampling, variant, errors=False)
    seconds["render"] += time.perf_counter() - before
    for scene in family.scenes:
        before = time.perf_counter()
        truth = rendered.truth(scene, standard_error=False)
        seconds["interpolate in eta"] += time.perf_counter() - before
        yield truth


def _record(
    suite: Suite,
    variant: Variant,
    seconds: Seconds,
    families: Sequence[FamilyPlan],
    reused: int,
    interpolation_error: float,
) -> dict[str, Any]:
    packages = ("malus", "mitsuba", "drjit", "numpy", "scipy", "pandas")
    return {
        "suite": suite.model_dump(mode="json"),
        "suite_id": suite.id,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {name: version(name) for name in packages}
        | {"python": platform.python_version()},
        "machine": {"system": platform.platform(), "processor": platform.machine()},
        "variant": {"name": variant.name, "reason": variant.reason},
        "seconds": {name: round(value, 3) for name, value in seconds.items()},
        "families": len(families),
        "families_taken_over": reused,
        "scenes": sum(len(family.scenes) for family in families),
        "interpolation_rms": interpolation_error,
    }
