"""Paired differences, the table to paste and comparisons of runs, on tables made by hand."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from malus.reports.tables.compared_runs import RunComparison
from malus.reports.tables.metric_definitions import DEFINITIONS, definition_of
from malus.reports.tables.other_images import same_images
from malus.reports.tables.paired import half_width, paired, ranked_pairs, student_width
from malus.reports.tables.paper_table import number_with_error, paper_table
from malus.scenes.core.errors import InputError
from malus.scenes.core.json_text import json_text


def table_of(values: dict[str, dict[str, list[float]]]) -> pd.DataFrame:
    """A results table from metric → method → values by scene."""
    rows: list[dict[str, Any]] = [
        {
            "scene": f"s{number}", "method": method, "metric": metric, "value": value,
            "body": "unpolarised", "light": "uniform", "knowledge": "everything",
            "band_nm": math.nan, "angle_deg": math.nan,
        }
        for metric, methods in values.items()
        for method, numbers in methods.items()
        for number, value in enumerate(numbers)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def run_of(values: dict[str, dict[str, list[float]]], **facts: Any) -> SimpleNamespace:
    return SimpleNamespace(table=table_of(values), run={"suite": {"name": "made up"}, **facts})


def test_a_paired_difference_is_students_interval() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(30, 5, 12), rng.normal(29, 5, 12)
    table = table_of({"psnr": {"a": list(a), "b": list(b)}})
    pair = paired(table, "psnr", "a", "b")
    interval = stats.ttest_rel(a, b).confidence_interval(0.95)
    assert pair.difference == pytest.approx(a.mean() - b.mean())
    assert pair.half_width == pytest.approx((interval.high - interval.low) / 2)
    assert (pair.better, pair.worse) == ((a > b).sum(), (a < b).sum())


@pytest.mark.parametrize(
    ("metric", "better"), [("psnr", 2), ("nmse", 1), ("gain", 2), ("rotation", 1)]
)
def test_better_follows_the_direction_of_the_metric(metric: str, better: int) -> None:
    table = table_of({metric: {"a": [0.9, 0.8, 0.5], "b": [0.5, 0.5, 0.7]}})
    assert paired(table, metric, "a", "b").better == better


def test_scenes_that_only_one_has_are_left_out() -> None:
    none = math.nan
    table = table_of({"psnr": {"a": [none, 31, 32, 34, 9], "b": [20, 30, 30, 31, none]}})
    pair = paired(table, "psnr", "a", "b")
    assert (pair.better, pair.scenes, pair.difference) == (3, 3, 2.0)
    assert pair.half_width == pytest.approx(half_width(np.array([1.0, 2.0, 3.0])))


def test_two_infinite_ratios_are_equal() -> None:
    table = table_of({"psnr": {"a": [math.inf, 30, 31, 32], "b": [math.inf, 29, 30, 31]}})
    pair = paired(table, "psnr", "a", "b")
    assert (pair.better, pair.worse, pair.scenes) == (3, 0, 4)
    assert pair.difference == pytest.approx(0.75)


def test_too_few_scenes_have_no_interval() -> None:
    assert math.isnan(half_width(np.array([1.0, 2.0])))
    assert not ranked_pairs(table_of({"nmse": {"a": [1, 2], "b": [2, 3]}}))


def test_methods_that_left_scenes_out_are_not_best() -> None:
    values = {"unpolarised": [3e-3] * 4, "eq8": [1e-3] * 4, "half_vector": [1e-9, math.nan] * 2}
    table = paper_table(table_of({"nmse": values}))
    (metric,) = table.metrics
    assert table.methods[0] == "unpolarised"
    assert [method for method in table.methods if table.is_best(method, metric)] == ["eq8"]
    assert table.images("half_vector") == "2"
    assert "| eq8 | **1.000e-3** | 4 |" in table.text("markdown")


def test_who_left_scenes_out_is_compared_with_the_best_of_the_others() -> None:
    """On the scenes of both; among those that have all it would be ranked by easier ones."""
    a, b = [1e-3, 2e-3, 1e-3, 2e-3], [3e-3, 5e-3, 4e-3, 5e-3]
    table = table_of({"nmse": {"b": b, "few": [1e-9, 1e-9, 2e-9, math.nan], "a": a}})
    assert [line[1:3] for line in ranked_pairs(table).lines] == [["a", "b"], ["few", "a"]]


def test_an_infinite_ratio_is_infinite_in_every_format() -> None:
    table = paper_table(table_of({"psnr": {"eq8": [math.inf, 30.0]}}), ["psnr"])
    assert "| **∞** |" in table.text("markdown")
    assert r"\textbf{$\infty$}" in table.text("latex")
    assert ",inf," in table.text("csv")


def test_heads_are_labels_where_they_are_of_one_metric() -> None:
    heads = paper_table(
        table_of({name: {"eq8": [1.0, 2.0]} for name in ("delta_e76", "delta_e76_i_max")}),
        ["delta_e76", "delta_e76_i_max"],
    ).text("markdown")
    assert heads.startswith("| method | ΔE76 ↓ | delta_e76_i_max ↓ | images |")


def test_names_are_escaped() -> None:
    table = paper_table(table_of({"nmse": {"my_net & co": [0.1, 0.2]}}))
    assert r"my\_net \& co & " in table.text("latex")
    names = {"a<b>|c": [0.1, 0.2], "d\u202ee": [0.1, 0.2]}
    table = paper_table(table_of({"nmse": names, "my|metric": names}))
    assert r"a\textless{}b\textgreater{}\textbar{}c & " in table.text("latex")
    assert r"| a&lt;b&gt;\|c | " in table.text("markdown")
    assert r"| my\|metric | " in table.text("markdown")
    assert not any("\u202e" in table.text(form) for form in ("latex", "markdown"))


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (5e-324, math.nan, "4.941e-324"),
        (9.996e-5, 1e-6, "1.000e-4 ± 1.0e-6"),
        (9.94e-5, 1e-6, "9.94e-5 ± 1.0e-6"),
        (1e-9, 1e-6, "1e-9 ± 1.0e-6"),
        (-0.8123, 0.3, "−0.81 ± 0.30"),
        (-2e-5, 1e-6, "−2.00e-5 ± 1.0e-6"),
        (0.0, math.nan, "0"),
        (0.0, 1e-6, "0e-7 ± 1.0e-6"),
    ],
)
def test_a_number_has_the_digits_of_its_error(value: float, error: float, text: str) -> None:
    assert number_with_error(value, error) == text


def test_the_minus_of_a_number_is_no_hyphen_in_latex() -> None:
    table = paper_table(table_of({"skill": {"eq8": [-0.5, -0.5, -0.5]}}))
    assert r"$-$0.5000" in table.text("latex")


def test_an_unknown_metric_is_named() -> None:
    with pytest.raises(InputError, match="did you mean nmse"):
        paper_table(table_of({"nmse": {"eq8": [0.1, 0.2]}}), ["nmsd"])


def test_every_definition_is_whole() -> None:
    for definition in DEFINITIONS:
        assert definition.definition
        assert definition.source
    assert len({definition.name for definition in DEFINITIONS}) == len(DEFINITIONS)
    assert definition_of("skill").name == "skill"


def test_noise_is_no_change_and_a_shift_is() -> None:
    """The same scenes; a shift of a tenth of the spread is seen because scenes are paired."""
    rng = np.random.default_rng(1)
    base = rng.normal(0.5, 0.2, 40)
    noise = rng.normal(0, 0.005, 40)
    before = run_of({"skill": {"eq8": list(base)}})
    same = run_of({"skill": {"eq8": list(base + noise)}})
    shifted = run_of({"skill": {"eq8": list(base + noise - 0.02)}}, versions={"malus": "2"})
    assert not RunComparison.of(("a", "b"), (before, same)).changed
    comparison = RunComparison.of(("a", "b"), (before, shifted))
    assert [change.outcome for change in comparison.changes] == ["worse"]
    assert comparison.differing.lines == [["version of malus", "none", "2"]]


def test_other_scenes_are_compared_by_their_means() -> None:
    """Welch's interval, as SciPy has it."""
    rng = np.random.default_rng(2)
    a, b = rng.normal(0.5, 0.1, 9), rng.normal(0.9, 0.2, 7)
    after = run_of({"skill": {"eq8": list(b)}})
    after.table["scene"] = "other " + after.table["scene"]
    comparison = RunComparison.of(("a", "b"), (run_of({"skill": {"eq8": list(a)}}), after))
    (change,) = comparison.changes
    interval = stats.ttest_ind(b, a, equal_var=False).confidence_interval(0.95)
    assert not change.paired
    assert change.scenes == 7  # of the run that has fewer
    assert change.difference == pytest.approx((interval.high + interval.low) / 2)
    assert change.half_width == pytest.approx((interval.high - interval.low) / 2)


def test_two_comparisons_share_the_chance_of_a_false_alarm() -> None:
    """Welch's interval at 97.5 % each; of scenes that both runs have, these alone are paired."""
    rng = np.random.default_rng(3)
    a, b = rng.normal(0.5, 0.1, (2, 6))
    before, after = (run_of({"skill": {"eq8": list(v), "mine": list(v)}}) for v in (a, b))
    after.table.loc[after.table["method"] == "eq8", "scene"] += " other"
    own = after.table["method"] == "mine"
    after.table.loc[own & after.table["scene"].isin(["s4", "s5"]), "scene"] += " other"
    changes = RunComparison.of(("a", "b"), (before, after)).changes
    welch = stats.ttest_ind(b, a, equal_var=False).confidence_interval(0.975)
    student = stats.ttest_rel(b[:4], a[:4]).confidence_interval(0.975)
    assert [(change.paired, change.scenes) for change in changes] == [(False, 6), (True, 4)]
    widths = [(interval.high - interval.low) / 2 for interval in (welch, student)]
    assert [change.half_width for change in changes] == pytest.approx(widths)


def test_equal_values_are_neither_better_nor_worse() -> None:
    pair = paired(table_of({"psnr": {"a": [1.0, 2, 4], "b": [1.0, 3, 3]}}), "psnr", "a", "b")
    assert (pair.better, pair.worse, pair.scenes) == (1, 1, 3)


PERFECT, GOOD, NONE = [math.inf, 30, 31], [40.0, 30, 31], [math.nan, 30, 31]


@pytest.mark.parametrize(
    ("metric", "before", "after", "outcome"),
    [
        ("psnr", GOOD, PERFECT, "better"),
        ("psnr", PERFECT, GOOD, "worse"),
        ("psnr", PERFECT, PERFECT, "same"),
        ("psnr", PERFECT, [30, math.inf, math.inf], "same"),  # both have perfect scenes
        ("nmse", GOOD, PERFECT, "worse"),
        ("nmse", PERFECT, NONE, "worse"),
        ("nmse", NONE, PERFECT, "better"),
    ],
)
@pytest.mark.parametrize("same_scenes", [True, False])
def test_an_infinite_value_is_as_good_as_its_metric_says(
    metric: str, before: list[float], after: list[float], outcome: str, same_scenes: bool
) -> None:
    runs = [run_of({metric: {"eq8": values}}) for values in (before, after)]
    if not same_scenes:
        runs[1].table["scene"] = "other " + runs[1].table["scene"]
    (change,) = RunComparison.of(("a", "b"), runs).changes
    assert change.outcome == outcome


@pytest.mark.parametrize("change", [-0.05, 0.05])
@pytest.mark.parametrize("lost", [(0, 0), (0, 1)], ids=["same scene", "another scene"])
def test_scenes_that_are_finite_in_both_runs_decide_where_both_have_others(
    change: float, lost: tuple[int, int]
) -> None:
    """A method that is not finite on one scene of each run: the means of both are no numbers."""
    values = np.array([0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
    both = [values.copy(), values + change]
    for numbers, scene in zip(both, lost, strict=True):
        numbers[scene] = math.nan
    runs = [run_of({"nmse": {"eq8": list(numbers)}}) for numbers in both]
    (line,) = RunComparison.of(("a", "b"), runs).changes
    assert line.difference == pytest.approx(change)
    assert line.outcome == ("better" if change < 0 else "worse")


def test_plain_values_tell_infinity_from_no_number() -> None:
    runs = [run_of({"psnr": {"eq8": values}}) for values in (GOOD, PERFECT)]
    (line,) = RunComparison.of(("a", "b"), runs).numbers()
    assert (line["after"], line["difference"], line["half_width"]) == ("Infinity", "Infinity", None)
    assert json.loads(json_text(line)) == line
    (line,) = RunComparison.of(("b", "a"), runs[::-1]).numbers()
    assert (line["before"], line["difference"]) == ("Infinity", "-Infinity")


def test_changes_are_in_the_order_of_the_first_run() -> None:
    names = [f"m{number}" for number in range(12)]
    runs = [run_of({"nmse": {name: [1.0, 2, 3] for name in names}}) for _ in range(2)]
    assert [change.key[0] for change in RunComparison.of(("a", "b"), runs).changes] == names


def test_what_became_worse_stands_first() -> None:
    values = np.array([0.5, 0.6, 0.7])
    before = run_of({"skill": {"a": list(values), "b": list(values)}})
    after = run_of({"skill": {"a": list(values + 0.1), "b": list(values - 0.1)}})
    changed = RunComparison.of(("a", "b"), (before, after)).changed
    assert [line[0] for line in changed.lines] == ["worse", "better"]


def test_scenes_that_are_no_longer_scored_are_told() -> None:
    values = [0.2, 0.3, 0.4, 0.5, 0.6]
    before = run_of({"nmse": {"eq8": values, "mine": values}})
    after = run_of({"nmse": {"eq8": values, "mine": values}})
    gone = (after.table["method"] == "mine") & after.table["scene"].isin(["s1", "s3"])
    assert gone.sum() == 2
    after.table = after.table[~gone]
    comparison = RunComparison.of(("a", "b"), (before, after))
    (lost,) = (line for line in comparison.numbers() if line["outcome"] == "not scored")
    assert (lost["run"], lost["method"], lost["scenes"]) == ("b", "mine", 2)
    assert all(line.keys() == lost.keys() for line in comparison.numbers())
    assert comparison.headline.endswith("; mine: 2 of 5 scenes are not scored in b")
    # Scenes that the other run does not have, and methods it does not name, are no loss.
    fewer = run_of({"nmse": {"eq8": values[:3]}})
    assert not RunComparison.of(("a", "b"), (before, fewer)).lost


def test_chance_alone_seldom_makes_a_change() -> None:
    """One comparison in twenty; of 60 with 20 lines each, more than 9 would be a rate of 0.15."""
    rng = np.random.default_rng(3)
    alarms = 0
    for _ in range(60):
        methods = {f"m{k}": rng.normal(0.5, 0.2, 10) for k in range(20)}
        again = {name: list(v + rng.normal(0, 0.01, 10)) for name, v in methods.items()}
        runs = run_of({"skill": {k: list(v) for k, v in methods.items()}}), run_of({"skill": again})
        alarms += bool(RunComparison.of(("a", "b"), runs).changed)
    assert alarms <= 9


def _other_images(values: dict[str, list[float]], signal: float, error: float) -> SimpleNamespace:
    """A run of one method whose scenes have that signal, and metrics that stated error."""
    run = run_of({name: {"eq8": column} for name, column in values.items()})
    scenes = len(next(iter(values.values())))
    told = table_of({"signal": {"eq8": [signal] * scenes}})
    run.table = pd.concat([run.table, told], ignore_index=True).assign(noise=error)
    return run


def _outcomes(before: SimpleNamespace, after: SimpleNamespace) -> dict[str, str]:
    changes = RunComparison.of(("a", "b"), (before, after)).changes
    return {change.metric.name: change.outcome for change in changes}


def test_noise_that_scenes_share_is_no_change() -> None:
    """Scenes of a seed share their random numbers: all move by the noise of one draw."""
    rng = np.random.default_rng(4)
    gain, skill = rng.normal(0.9, 0.02, 24), rng.normal(0.6, 0.2, 24)
    before = _other_images({"skill": list(skill), "gain": list(gain)}, 0.1, 0.01)
    moved = {"skill": list(skill + 0.004), "gain": list(gain + 0.01)}
    assert _outcomes(before, _other_images(moved, 0.1003, 0.01)) == {
        "skill": "not told",
        "gain": "same",
    }
    # On the same images there is no noise between the runs: every scene shows the same change.
    assert _outcomes(before, _other_images(moved, 0.1, 0.01)) == {"skill": "better"}


def test_a_change_beyond_the_noise_of_other_images_is_told() -> None:
    """1.96 · 1.6 · √2 · 0.01 and a tolerance of 0.005 are 0.049, less than a gain fell by."""
    values = {"skill": [0.5, 0.6, 0.7], "gain": [0.9, 0.95, 1.0]}
    fallen = {"skill": [0.4, 0.5, 0.6], "gain": [0.8, 0.85, 0.9]}
    before, after = (_other_images(v, s, 0.01) for v, s in ((values, 0.1), (fallen, 0.2)))
    assert _outcomes(before, after) == {"skill": "not told", "gain": "worse"}
    comparison = RunComparison.of(("a", "b"), (before, after))
    told = "changes beyond chance: 1 compared, 0 better, 1 worse, 0 changed; 1 not told (skill)"
    assert comparison.headline.startswith(told)
    (gain,) = (change for change in comparison.changes if change.metric.name == "gain")
    # One comparison, for which chance has all of its 5 %: nothing is told of the skill.
    assert gain.half_width == pytest.approx(0.005 + 1.959964 * 1.6 * 2**0.5 * 0.01, rel=1e-6)


def test_an_infinite_value_is_told_on_other_images_too() -> None:
    """No noise makes an error zero."""
    before, after = (_other_images({"psnr": v}, s, 0.01) for v, s in ((GOOD, 0.1), (PERFECT, 0.2)))
    assert _outcomes(before, after) == {"psnr": "better"}
    # Nor does any make a value exactly equal.
    assert _outcomes(before, _other_images({"psnr": GOOD}, 0.2, 0.01)) == {"psnr": "same"}


@pytest.mark.parametrize(("signal", "same"), [(0.1 * (1 + 1e-6), True), (0.1 * (1 + 1e-4), False)])
def test_images_that_differ_by_rounding_are_the_same(signal: float, same: bool) -> None:
    """Of single precision, 6e-8 a value; noise of 10⁴ samples in all is a hundredth."""
    assert same_images(pd.Series([0.1, 0.2]), pd.Series([signal, 0.2])) is same


def test_an_estimate_that_is_not_finite_is_worse_on_other_images_too() -> None:
    before = _other_images({"nmse": [0.1, 0.2, 0.3]}, 0.1, 0.01)
    after = _other_images({"nmse": [0.1, math.nan, 0.3]}, 0.2, 0.01)
    assert _outcomes(before, after) == {"nmse": "worse"}


def test_every_metric_of_a_score_is_defined() -> None:
    """What a table can hold is told by `malus list metrics`."""
    from malus.bench.scoring.extra_metrics import METRICS, get_metrics
    from malus.bench.scoring.judge import Judge
    from malus.reconstruct import get_method
    from malus.renderers.rendering import render
    from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere

    truth = render(
        Scene(
            shape=Sphere(),
            surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
            light=Distant(incidence_deg=60),
            camera=Camera(resolution=16),
            wavelengths_nm=(450.0, 550.0, 650.0),
        ),
        renderer="torrance-sparrow",
    )
    score = Judge(truth).score(get_method("eq8"), get_metrics(tuple(METRICS)))
    names = {value.metric for value in score.values()}
    assert [name for name in names if not definition_of(name).definition] == []


@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
@pytest.mark.parametrize("freedom", [1, 1.5, 2, 7.3, 30, 1799, 1e6])
def test_student_widths_are_those_of_scipy(confidence: float, freedom: float) -> None:
    expected = stats.t.ppf(0.5 + confidence / 2, freedom)
    # 64 nodes leave 1e-11 where the density ends as a root does, and the difference of two ln Γ of
    # size ν ln ν loses the digits of that size: 5e-8 at 1e6.
    assert student_width(confidence, freedom) == pytest.approx(
        expected, rel=1e-10 + 1e-13 * freedom
    )
