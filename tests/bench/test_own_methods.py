"""What methods of one's own may do wrong costs no other method its scores, and is not hidden."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up import made_up_truth
from runs import NOBODY, SUITE, formula_dataset

import malus
from malus.bench.gates.baseline import DEFAULT_RULES, Baseline
from malus.bench.gates.gate import gate, passed, updated
from malus.bench.running.results import Results, headline
from malus.bench.running.runner import run
from malus.reconstruct import Components, Method, Observation
from malus.reconstruct.observation import INPUTS
from malus.reports.tables.compared_runs import RunComparison
from malus.reports.tables.skills import by_light_and_body, unreported_skills
from malus.scenes import InputError

MODULE = """
import numpy as np
from malus import Components, Inapplicable, Method, get_method

good = get_method("eq8")

def wrong(observation):
    found = good.reconstruct(observation)
    image, s1, s2 = found.image.copy(), found.s1.copy(), found.s2.copy()
    dense = observation.eta[0] > 1.4
    CODE
    return Components(image, s1, s2)

mine = Method("NAME", good.needs, wrong, "wrong somewhere", per_pixel=PER_PIXEL, per_band=False)
"""


@pytest.fixture(autouse=True)
def _working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def write(module: str, code: str, name: str = "mine", per_pixel: bool = False) -> str:
    """Write a module with a method that does `code` to eq8's estimate; how it is called."""
    text = MODULE.replace("CODE", code).replace("NAME", name).replace("PER_PIXEL", str(per_pixel))
    Path(f"{module}.py").write_text(text, encoding="utf-8")
    return f"{module}:mine"


def results(*methods: str, out: str = "run") -> Results:
    return run(SUITE.model_copy(update={"methods": methods}), out, variant=NOBODY)


def test_what_a_method_writes_into_is_its_own() -> None:
    """Arrays of the truth would be others for all methods that come after it."""
    code = (
        "observation.normals[...] *= -1; observation.specular[...] = 0; observation.image[...] = 9"
    )
    own = [
        write("whole", code, "whole"),
        write("pixels", code, "pixels", per_pixel=True),
    ]
    alone = results("unpolarised", "eq8", out="alone").table
    after = results("unpolarised", *own, "eq8", out="after").table
    for method in ("unpolarised", "eq8"):
        first, second = (table[table.method == method] for table in (alone, after))
        assert first.value.tolist() == second.value.tolist()


def test_what_is_written_into_an_observation_changes_no_truth() -> None:
    truth, same = made_up_truth(), made_up_truth()
    told = malus.observe(truth, INPUTS)
    for value in vars(told).values():
        if isinstance(value, np.ndarray):
            value[...] = 0
    for name in ("specular", "diffuse", "normals", "mask", "eta", "image", "stokes"):
        np.testing.assert_array_equal(getattr(truth, name), getattr(same, name))


@pytest.mark.parametrize("per_pixel", [True, False])
@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("s1 = s1[..., :1]", "expected s1 of shape"),
        ("s2 = s2[..., None]", "expected s2 of shape"),
        ("image, s1, s2 = (np.repeat(x, 2, axis=1) for x in (image, s1, s2))", "expected image of"),
        ("image, s1, s2 = (x.swapaxes(0, 2) for x in (image, s1, s2))", "expected image of shape"),
        ("s1 = s1 + 0j", "type complex"),
        (
            "return Components(image, s1, s2, valid=np.ones((1, 1, 1), bool))",
            "expected valid of shape",
        ),
        ("return Components(image, s1, s2, deviation=s1[..., 0])", "expected deviation of shape"),
        ("return image", "expected Components, found ndarray"),
    ],
)
def test_arrays_that_are_no_picture_of_the_same_shape_are_no_scores(
    code: str, words: str, per_pixel: bool
) -> None:
    """A loop over flat pixels would read others in their place."""
    run = results("unpolarised", write("odd", code, "odd", per_pixel=per_pixel))
    assert "odd" not in set(run.table.method)
    assert words in run.run["failures"][0]


@pytest.mark.parametrize("dtype", ["float16", ">f4", ">f8", "longdouble", "float64"])
def test_any_type_of_real_numbers_is_scored(dtype: str) -> None:
    cast = f"image, s1, s2 = (x.astype('{dtype}') for x in (image, s1, s2))"
    table = results("eq8", write("cast", cast, "cast", per_pixel=True)).table
    table = table[table.metric == "skill"]
    ours, cast_ones = (table[table.method == m].value.to_numpy() for m in ("eq8", "cast"))
    # Half precision rounds by 1/2048, 2 % of the polarisation here, and single by 6e-8: 3e-6.
    tolerance = 2e-2 if dtype == "float16" else 1e-5
    assert cast_ones == pytest.approx(ours, rel=tolerance, abs=tolerance)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_an_error_beyond_all_numbers_is_no_number(dtype: str) -> None:
    """Its square is infinite: one scored as infinite would be a value, and one that raises none."""
    code = f"s1 = np.full(s1.shape, np.finfo('{dtype}').max, '{dtype}')"
    run = results("eq8", write("huge", code, "huge", per_pixel=True))
    assert not run.run["failures"]
    rows = run.headlines[run.headlines.method == "huge"]
    nmse, skill = (rows[rows.metric == name].value for name in ("nmse", "skill"))
    assert np.isfinite(nmse).all() if dtype == "float32" else nmse.isna().all()
    assert (skill < 0).all() if dtype == "float32" else skill.isna().all()
    told = [row for row in headline(run) if row["method"] == "huge"]
    assert all((row["nmse_mean"] is None) == (dtype == "float64") for row in told)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("needs", {"normal"}, "method odd, needs: .* found normal; did you mean normals"),
        ("needs", "image", "found image; image, mask and wavelengths_nm are always there"),
        ("optional", ["eta", "lihgt"], "method odd, optional: .* found lihgt; did you mean light"),
        ("name", " ", "method: expected a name, found ' '"),
        ("name", 5, "method: expected a name, found 5"),
        ("reconstruct", "eq8", "method odd: expected a function, found 'eq8'"),
    ],
)
def test_what_no_method_can_be_is_refused_when_it_is_made(key: str, value: Any, words: str) -> None:
    odd: dict[str, Any] = {"name": "odd", "needs": (), "reconstruct": len, "summary": ""}
    with pytest.raises(InputError, match=words):
        Method(**(odd | {key: value}))


def test_a_wrong_need_is_told_before_anything_is_rendered() -> None:
    text = "from malus import Method\nmine = Method('mine', {'normal'}, len, '')\n"
    Path("made.py").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"method mine, needs: .* did you mean normals"):
        results("unpolarised", "made:mine")
    assert not Path("run").exists()


def test_a_method_may_ask_for_every_input_and_is_told_it() -> None:
    truth = made_up_truth()
    every = Method("every", INPUTS, lambda observation: observation, "asks for all")
    told = malus.observe(truth, every.needs)
    assert all(getattr(told, name) is not None for name in INPUTS)


def test_two_methods_of_one_name_are_refused() -> None:
    own = write("same", "pass", name="eq8")
    with pytest.raises(InputError, match="eq8 for eq8 and same:mine; rename one of them"):
        results("eq8", own)
    assert not Path("run").exists()
    dataset = formula_dataset(Path("dataset"))
    with pytest.raises(InputError, match="rename one of them"):
        malus.score_dataset(dataset, ["eq8", own])
    assert results("eq8", "eq8").table.method.unique().tolist() == ["eq8"]


def test_methods_that_are_objects_are_held_to_the_same() -> None:
    dataset = formula_dataset(Path("dataset"))

    def greedy(observation: Observation) -> Components:
        assert observation.normals is not None
        observation.normals[...] = 0
        observation.image[...] = 9
        return Components(observation.image, 0 * observation.image, 0 * observation.image)

    own = Method("mine", frozenset({"normals"}), greedy, "writes into its arrays", True)
    alone, after = (malus.score_dataset(dataset, [*first, "eq8"]).table for first in ((), (own,)))
    values = [table[table.method == "eq8"].value.tolist() for table in (alone, after)]
    assert values[0] == values[1]
    for twice in ([own, replace(own, summary="another")], ["eq8", replace(own, name="eq8")]):
        with pytest.raises(InputError, match="rename one of them"):
            malus.score_dataset(dataset, twice)


def test_an_estimate_that_is_not_finite_betters_nothing() -> None:
    own = write("holes", "s1[...] = np.nan if dense else s1")
    found = results("unpolarised", "eq8", own)
    values = found.table.query("metric == 'nmse' and method == 'mine' and band_nm.isna()")
    assert 0 < values.value.isna().sum() < len(values)
    for row in headline(found):
        assert (
            (row["nmse_mean"] is None) == (row["skill_median"] is None) == (row["method"] == "mine")
        )
    rows = by_light_and_body(found.table).set_index("method")
    assert rows.loc["mine", ["nmse_mean", "nmse_max", "skill_median", "skill_min"]].isna().all()
    assert rows.loc["eq8", ["nmse_mean", "nmse_max"]].notna().all()
    # The trivial guess rises above the noise there: eq8 has a skill.
    assert unreported_skills(found.table, "mine").equals(unreported_skills(found.table, "eq8"))
    write("holes", "pass")
    whole = results("unpolarised", "eq8", own, out="whole")
    change = next(
        change
        for change in RunComparison.of(("whole", "holes"), (whole, found)).changes
        if (change.metric.name, change.key[0]) == ("nmse", "mine")
    )
    assert change.outcome == "worse"


@pytest.fixture
def reviewed() -> Baseline:
    return updated(results("unpolarised", write("own", "pass"), out="first"), None, DEFAULT_RULES)


@pytest.mark.parametrize(
    ("code", "outcome"),
    [
        ("pass", "same"),
        ("if dense: raise Inapplicable('too dense')", "missing"),
        ("if dense: raise ValueError('too dense')", "missing"),
        ("image[image == image.max()] = np.nan", "not finite"),
    ],
)
def test_the_gate_sees_what_is_scored_no_more(reviewed: Baseline, code: str, outcome: str) -> None:
    found = gate(results("unpolarised", write("own", code), out="again"), reviewed)
    assert outcome in {comparison.outcome for comparison in found if comparison.key[1] == "mine"}
    assert passed(found) == (outcome == "same")


def test_a_gate_that_compares_nothing_is_refused(reviewed: Baseline) -> None:
    found = results("unpolarised", "own:mine", out="first")
    other = (DEFAULT_RULES[0].model_copy(update={"method": "eq9"}),)
    for nothing in ({"rules": other}, {"values": ()}):
        with pytest.raises(InputError, match="nothing would be compared"):
            gate(found, reviewed.model_copy(update=nothing))


def test_a_method_that_failed_is_tried_again_when_it_is_mended() -> None:
    own = write("mended", "raise ZeroDivisionError('boom')")
    assert results("eq8", own).run["families_failed"] == 2
    assert results("eq8", own).run["families_taken_over"] == 0
    write("mended", "pass")
    mended = results("eq8", own)
    assert mended.run["families_failed"] == 0
    assert set(mended.table.method) == {"eq8", "mine"}
