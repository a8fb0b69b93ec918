"""Scenes that a gate pools: lost and broken ones are told, and noise that they share stays."""

from __future__ import annotations

import dataclasses
import io
import math
import re
from statistics import NormalDist
from typing import Any
from xml.etree import ElementTree

import pandas as pd
import pytest
from rich.console import Console
from runs import SUITE

from malus.bench.gates.baseline import DEFAULT_RULES, PooledMetric, default_rules, measure
from malus.bench.gates.gate import HIDDEN_NOISE, gate, passed, updated
from malus.bench.gates.gate_report import junit, markdown, tables
from malus.bench.running.results import Results

VALUES = {"gain": 0.9, "rotation": 0.01, "facing_skill": 0.8, "signal": 0.1, "nmse": 1e-4}
NOISE = 0.003
GROUP = {
    "method": "mine",
    "knowledge": "everything",
    "body": "polarised",
    "light": "uniform",
    "surface": "rust",
}
WHOLE = {"band_nm": math.nan, "angle_deg": math.nan, "note": ""}


def results(scenes: int, seed: int = 1) -> Results:
    """A run of alike scenes of one group."""
    table = [
        {"scene": f"{k:016x}", **GROUP, **WHOLE, "metric": name, "value": value, "noise": NOISE}
        for k in range(scenes)
        for name, value in VALUES.items()
    ]
    suite: dict[str, Any] = SUITE.model_dump(mode="json")
    suite["sampling"]["seed"] = seed
    return Results(pd.DataFrame.from_records(table), {"suite": suite, "variant": {"name": "none"}})


def without(run: Results, metric: str) -> Results:
    """The run with a value of its second scene lost."""
    table = run.table
    lost = (table["scene"] == f"{1:016x}") & (table["metric"] == metric)
    return dataclasses.replace(run, table=table[~lost])


def outcomes(run: Results, reviewed: Results) -> dict[str, str]:
    compared = gate(run, updated(reviewed, None, DEFAULT_RULES))
    return {comparison.key[0]: comparison.outcome for comparison in compared}


SAME = dict.fromkeys(("gain", "rotation", "facing_skill"), "same")


@pytest.mark.parametrize("seed", [1, 2], ids=["same seed", "other seed"])
def test_a_lost_scene_is_missing_whatever_the_seed(seed: int) -> None:
    reviewed, run = results(2), results(2, seed)
    assert outcomes(run, reviewed) == SAME
    assert outcomes(without(run, "gain"), reviewed) == SAME | {"gain": "missing"}


def test_a_scene_whose_skill_another_seed_hides_is_not_lost() -> None:
    """Whether a guess rises above the noise of a render, and so has a skill, is a draw."""
    reviewed = results(2)
    assert outcomes(without(results(2, seed=2), "facing_skill"), reviewed) == SAME
    told = outcomes(without(reviewed, "facing_skill"), reviewed)
    assert told == SAME | {"facing_skill": "missing"}


def test_a_skill_that_another_seed_hides_in_every_scene_is_no_failure() -> None:
    """Of quick at 24 pixels and 16 samples 7 comparisons of seeds in 56 failed for it alone."""
    reviewed = results(2)
    hidden = without_metric(results(2, seed=2), "facing_skill")
    assert outcomes(hidden, reviewed) == SAME | {"facing_skill": "not told"}
    compared = gate(hidden, updated(reviewed, None, DEFAULT_RULES))
    assert passed(compared)
    suite = ElementTree.fromstring(junit(compared))[0]
    assert (suite.attrib["tests"], suite.attrib["skipped"]) == ("3", "1")
    assert len(suite.findall(".//skipped")) == 1
    other_variant = dataclasses.replace(reviewed, run=reviewed.run | {"variant": {"name": "llvm"}})
    hidden_there = without_metric(other_variant, "facing_skill")
    assert outcomes(hidden_there, reviewed) == SAME | {"facing_skill": "not told"}
    # With the same random numbers, or where the method has no gain either, it is lost.
    same_seed = without_metric(reviewed, "facing_skill")
    for run in (same_seed, without_metric(hidden, "gain")):
        assert outcomes(run, reviewed)["facing_skill"] == "missing"


@pytest.mark.parametrize("seed", [1, 2], ids=["same seed", "other seed"])
def test_means_of_other_scenes_are_not_compared(seed: int) -> None:
    """As of a baseline of one split, or of a run of which scenes had failed."""
    few, many = results(2), results(4, seed)
    compared = gate(many, updated(few, None, DEFAULT_RULES))
    told = {one.key[0]: one for one in compared}
    counted = {"gain", "rotation"} if seed == 2 else set(SAME)
    assert {name for name, one in told.items() if one.outcome == "changed"} == counted
    for text in (markdown(compared), junit(compared)):
        assert text.count("of 4 scenes, in the baseline of 2") == len(counted)
    fewer = gate(few, updated(results(4), None, DEFAULT_RULES))
    assert {one.outcome for one in fewer} == {"missing"}
    assert markdown(fewer).count("2 of 4 scenes have it") == 3
    assert "nan" not in markdown(fewer) + junit(fewer)


def test_a_narrow_terminal_shows_every_name_whole() -> None:
    reviewed = results(2)
    gated = reviewed.table["metric"].isin(SAME)
    table = reviewed.table.assign(value=reviewed.table["value"] - 0.5 * gated)
    compared = gate(Results(table, reviewed.run), updated(reviewed, None, DEFAULT_RULES))
    told = Console(width=80, file=io.StringIO(), record=True)
    for each in tables(compared):
        told.print(each)
    assert "…" not in told.export_text()


def test_a_scene_that_is_not_finite_is_named_for_every_metric() -> None:
    """A skill over the other scenes alone would be taken for one over all."""
    reviewed = results(2)
    table = reviewed.table
    broken = (table["scene"] == f"{1:016x}") & (table["metric"] != "signal")
    run = dataclasses.replace(reviewed, table=table.assign(value=table["value"].mask(broken)))
    assert outcomes(run, reviewed) == dict.fromkeys(SAME, "not finite")


def test_a_scene_whose_noise_is_no_number_is_not_finite() -> None:
    """The noise of the others alone would make the limit too narrow."""
    reviewed = results(2)
    table = reviewed.table
    untold = (table["scene"] == f"{1:016x}") & (table["metric"] == "gain")
    run = dataclasses.replace(reviewed, table=table.assign(noise=table["noise"].mask(untold)))
    assert outcomes(run, reviewed) == SAME | {"gain": "not finite"}


@pytest.mark.parametrize("rounding", [0.0, 5e-9])
def test_scenes_weigh_by_their_polarised_energy(rounding: float) -> None:
    """Of energies 1 and 9: gains of 0.5 and 1 are 0.95 together, the slope over all pixels."""
    run = results(3)
    values = [{"gain": 0.5, "signal": 0.1}, {"gain": 1.0, "signal": 0.3}]
    # Without polarised light, as of an unpolarised body under a lamp at the camera, there is no
    # slope, whatever rounding makes of the signal.
    values.append({"gain": math.nan, "rotation": math.nan, "signal": rounding})
    for k, changed in enumerate(values):
        for metric, value in changed.items():
            row = (run.table["scene"] == f"{k:016x}") & (run.table["metric"] == metric)
            run.table.loc[row, "value"] = value
    gain, rotation = (
        value
        for value in measure(run)
        if isinstance(value, PooledMetric) and value.metric != "facing_skill"
    )
    assert (gain.value, rotation.value) == pytest.approx((0.95, VALUES["rotation"]), rel=1e-12)
    assert gain.signal == pytest.approx(0.05**0.5, rel=1e-12)  # root mean square of 0.1 and 0.3
    assert gain.scenes == 2


def captures(names: tuple[str, ...], skills: tuple[float, ...]) -> Results:
    """Results of captures, whose skill is the plain one; NaN where their noise hides the guess's
    error."""
    rows = [
        {"scene": name, **GROUP, "surface": name, **WHOLE, "metric": metric, "value": value}
        for name, skill in zip(names, skills, strict=True)
        for metric, value in (VALUES | {"skill": skill}).items()
        if metric != "facing_skill"
    ]
    record = {"suite": {"name": "desk"}, "captures": [{"scene": name} for name in names]}
    return Results(pd.DataFrame.from_records(rows).assign(noise=NOISE), record)


def test_a_capture_without_a_skill_is_gated_by_its_other_values() -> None:
    """A matt object polarises less than the camera's noise: no fault of the method."""
    run = captures(("glass", "felt"), (0.8, math.nan))
    reviewed = updated(run, None, default_rules(run))
    gated = {(value.metric, value.surface) for value in reviewed.values}
    every = {(metric, name) for metric in ("gain", "rotation") for name in ("glass", "felt")}
    assert gated == every | {("skill", "glass")}
    compared = gate(captures(("felt", "glass"), (math.nan, 0.8)), reviewed)
    assert [one.outcome for one in compared] == 5 * ["same"]
    lost = gate(captures(("glass", "felt"), (math.nan, math.nan)), reviewed)
    assert [one.key[0] for one in lost if one.outcome == "missing"] == ["skill"]


def test_noise_that_scenes_share_does_not_fall_with_their_number() -> None:
    """Scenes of one seed share their random numbers: two alike know no more than one."""
    for scenes in (1, 2):
        pooled = [value for value in measure(results(scenes)) if isinstance(value, PooledMetric)]
        assert len(pooled) == len(SAME)
        for value in pooled:
            # A sum of two equal halves.
            assert value.noise == pytest.approx(NOISE, rel=1e-12)


def test_limits_follow_from_the_probabilities_that_are_promised() -> None:
    """Of another seed: noise alone turns one whole run in 1000 red, and of changes of `visible`
    98 in 100 are seen."""
    baseline = updated(results(4), None, DEFAULT_RULES)
    comparisons = gate(results(4, seed=2), baseline)
    assert len(comparisons) == 3
    alarms = 0.0
    for comparison in comparisons:
        assert not comparison.paired
        # Both runs have the noise; halves of the samples do not show all of it.
        assert comparison.error == pytest.approx(HIDDEN_NOISE * 2**0.5 * NOISE, rel=1e-12)
        (rule,) = (rule for rule in DEFAULT_RULES if rule.metric == comparison.key[0])
        beyond = (comparison.limit - rule.tolerance) / comparison.error
        alarms += 2 * (1 - NormalDist().cdf(beyond))
        seen = NormalDist().cdf((comparison.visible - comparison.limit) / comparison.error)
        assert seen == pytest.approx(0.98, abs=0.005)
    assert alarms == pytest.approx(1e-3, rel=1e-9)


def test_what_no_rule_gates_is_nothing_new() -> None:
    """A value that appeared is told where a rule would hold for it, and only there."""
    reviewed = updated(without_metric(results(2), "rotation"), None, DEFAULT_RULES)
    of_gains = reviewed.model_copy(update={"rules": DEFAULT_RULES[:1]})
    for baseline, expected in ((reviewed, ["rotation"]), (of_gains, [])):
        compared = gate(results(2), baseline)
        kept = [value.metric for value in updated(results(2), baseline, ()).values]
        assert kept == (list(SAME) if baseline is reviewed else ["gain"])
        assert [one.key[0] for one in compared if one.outcome == "new"] == expected


def without_metric(run: Results, metric: str) -> Results:
    return dataclasses.replace(run, table=run.table[run.table["metric"] != metric])


def test_a_name_ends_no_cell_of_the_summary() -> None:
    table = results(2).table
    renamed = Results(table.assign(light="a|b"), results(2).run)
    baseline = updated(renamed, None, DEFAULT_RULES)
    worse = table.assign(light="a|b", value=table["value"].where(table["metric"] != "gain", 0.1))
    text = markdown(gate(Results(worse, renamed.run), baseline))
    rows = [line for line in text.splitlines() if line.startswith("| worse")]
    assert rows
    for row in rows:
        assert "a\\|b" in row
        assert len(re.split(r"(?<!\\)\|", row)) == 8 + 2  # eight cells, and what is outside
