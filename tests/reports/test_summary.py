"""Tables, headline and summary: numbers are those of the results, none left out in silence."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from malus.bench.running.results import Results
from malus.reports.figures.drawings import drawings
from malus.reports.sections import of_run
from malus.reports.source import Source
from malus.reports.summary import summary
from malus.reports.tables import sample
from malus.reports.tables.captures import by_group as captured_by_group
from malus.reports.tables.captures import fits
from malus.reports.tables.colour_errors import table1, table1_text
from malus.reports.tables.compared_runs import means_table
from malus.reports.tables.figure_numbers import angle_numbers, numbers
from malus.reports.tables.formats import scientific
from malus.reports.tables.headline import best_method, headline_tiles
from malus.reports.tables.metric_definitions import definition_of
from malus.reports.tables.other_images import HIDDEN_NOISE, TOLERANCES, noise_width
from malus.reports.tables.paper_table import Cell, PaperTable, paper_table
from malus.reports.tables.rows import coverages
from malus.reports.tables.sentences import (
    extrapolation,
    interpolation,
    no_scene_without_skill,
)
from malus.reports.tables.skills import (
    by_light_and_body,
    median_skills,
    negative_skills,
    unreported_skills,
)
from malus.reports.tables.text_tables import beside_paper


def with_skill(table: pd.DataFrame, value: float, **where: Any) -> pd.DataFrame:
    chosen = table["metric"] == "skill"
    for name, wanted in where.items():
        chosen &= table[name] == wanted
    return table.assign(value=table["value"].mask(chosen, value))


def test_coverage_of_part_of_a_light(table: pd.DataFrame) -> None:
    first = table["scene"] == f"{0:016x}"
    covered = coverages(table[~(first & (table["metric"] == "nmse"))])["eq8"]
    assert (covered.partial_lights, covered.missing_lights) == (("uniform",), ())
    assert str(covered) == "only distant 60°, part of uniform"


def test_nan_skills_are_counted_and_never_dropped_in_silence(table: pd.DataFrame) -> None:
    table = with_skill(table, math.nan, method="eq8", light="uniform", surface="carbon")
    row = by_light_and_body(table).query("method == 'eq8' and light == 'uniform'").iloc[0]
    assert (row["scenes"], row["unreported"], row["negative"]) == (6, 3, 0)
    assert unreported_skills(table, "eq8").values.tolist() == [
        ["uniform", "carbon", "unpolarised", 3, 3]
    ]
    assert "| eq8 | uniform | carbon | unpolarised | 3 of 3 |" in summary(table, sample.run())


def broken(table: pd.DataFrame) -> pd.DataFrame:
    """The table with an estimate of eq8 that is not finite, on its first scene."""
    scene = table["scene"].iloc[0]
    metrics = ("nmse", "skill", "delta_e76_i_max", "delta_e76_i_max_std")
    first = (table["scene"] == scene) & (table["method"] == "eq8") & table["metric"].isin(metrics)
    return table.assign(value=table["value"].mask(first, math.nan))


def test_an_estimate_that_is_not_finite_makes_no_number_better(table: pd.DataFrame) -> None:
    """A mean of the other scenes would be read as one of all."""
    colours = table[table["metric"] == "nmse"].assign(metric="delta_e76_i_max", value=0.5)
    table = pd.concat([table, colours])
    whole, part = (
        errors[(errors["method"] == "eq8") & (errors["formula"] == "ΔE76")].iloc[0]
        for errors in (table1(table), table1(broken(table)))
    )
    assert part["scenes"] == whole["scenes"]
    assert (whole["mean"], math.isnan(part["mean"])) == (0.5, True)
    line = next(each for each in table1_text(table1(broken(table))).lines if each[1] == "eq8")
    assert line[3] == "not finite"
    figure = numbers(broken(table), "alpha").query("method == 'eq8'")
    assert figure["mean"].isna().sum() == 1
    by_angle = table.assign(angle_deg=30.0)
    assert angle_numbers(broken(by_angle)).query("method == 'eq8'")["mean"].isna().any()
    cells = paper_table(broken(table)).cells
    assert {str(cell) for (name, _), cell in cells.items() if name == "eq8"} == {"not finite"}
    assert not any(math.isnan(cell.value) for (name, _), cell in cells.items() if name != "eq8")


def test_an_estimate_that_is_not_finite_is_not_a_guess_inside_the_noise(
    table: pd.DataFrame,
) -> None:
    row = by_light_and_body(broken(table)).query("method == 'eq8' and light == 'uniform'").iloc[0]
    assert (row["unreported"], math.isnan(row["skill_median"])) == (0, True)
    assert len(unreported_skills(broken(table), "eq8")) == 0
    assert math.isnan(median_skills(broken(table), "eq8", "unpolarised").loc["uniform"]["carbon"])
    tiles = {
        label: number
        for number, label in headline_tiles(broken(table), table1(broken(table)), "fig5")
    }
    assert tiles["scenes on which eq8 gave what is not finite"] == "1 of 12"
    assert not any("inside the noise" in label for label in tiles)
    assert best_method(broken(table)) != "eq8"
    captures = captured_by_group(broken(sample.captured()))
    assert next(line for line in captures.lines if line[1] == "eq8")[3].startswith("not finite")


def test_the_degree_of_a_capture_is_said_to_be_of_the_whole_picture() -> None:
    assert "DoLP median, whole picture" in fits(sample.run_of_captures()).heads


def test_comparisons_tell_how_many_scenes_have_a_skill(table: pd.DataFrame) -> None:
    run = sample.run()
    hidden = with_skill(table, math.nan, method="eq8", light="uniform", surface="carbon")
    tables = [table, hidden, broken(table)]
    lines = means_table(("whole", "part", "broken"), [Results(each, run) for each in tables]).lines
    whole, part, not_finite = (line for line in lines if line[0] == "eq8")
    assert [whole[4], part[4]] == ["12", "12, 9 with a skill"]
    assert not_finite[1:4] == ["broken", "not finite", "–"]


def test_an_error_of_interpolation_is_told_where_there_is_one() -> None:
    assert "nothing was interpolated" in interpolation({"interpolation_rms": 0.0})
    assert "1.2e-6 of the peak" in interpolation({"interpolation_rms": 1.2e-6})


def test_negative_skills_are_listed_with_their_place_and_number(table: pd.DataFrame) -> None:
    table = with_skill(table, -0.5, method="eq8", light="uniform", surface="carbon")
    table = with_skill(table, -7.0, method="eq8", light="distant 60°", material="pmma")
    negative = [
        (row["light"], row["surface"], row["negative"], row["scenes"], row["worst"])
        for row in negative_skills(table, "eq8").to_dict("records")
    ]
    assert negative == [
        ("distant 60°", "carbon", 1, 3, -7.0),
        ("distant 60°", "obsidian", 1, 3, -7.0),
        ("uniform", "carbon", 3, 3, -0.5),
    ]
    text = summary(table, sample.run())
    assert "5 scenes in 3 places" in text
    assert "| uniform | carbon (0.4) | unpolarised | 3 of 3 | −0.50 |" in text


def told_of_skill(table: pd.DataFrame, folder: Path) -> list[str]:
    """Which sentences on skill the summary and the page have; both have the same."""
    told = [
        "eq8 was not run.",
        "eq8 has no skill on any scene",
        "is negative nowhere",
        "No method but the trivial guess was scored.",
        "an estimate that is not finite has no skill",
        "Every scene has a skill",
    ]
    text = summary(table, sample.run())
    (skills,) = (s for s in of_run(Source(table, sample.run(), folder, ())) if s.name == "skill")
    found = [sentence for sentence in told if sentence in text]
    assert [sentence for sentence in told if sentence in skills.content] == found
    return found


def test_skill_is_told_of_what_was_run_only(table: pd.DataFrame, tmp_path: Path) -> None:
    def told(rows: pd.DataFrame) -> list[str]:
        return told_of_skill(rows, tmp_path)

    assert told(table) == ["is negative nowhere", "Every scene has a skill"]
    without = table[table["method"] == "half_vector"]
    assert told(without) == ["eq8 was not run.", "Every scene has a skill"]
    guess = table[table["method"] == "unpolarised"]
    assert told(guess) == ["eq8 was not run.", "No method but the trivial guess was scored."]
    none = with_skill(table, math.nan)
    assert told(none) == ["eq8 has no skill on any scene"]
    finite = "an estimate that is not finite has no skill"
    assert told(broken(table)) == ["is negative nowhere", finite]


def test_skill_map_is_in_order_of_roughness_and_keeps_its_holes(table: pd.DataFrame) -> None:
    table = with_skill(table, math.nan, method="eq8", light="uniform", surface="carbon")
    skills = median_skills(table, "eq8", "unpolarised")
    assert list(skills.columns) == ["obsidian", "carbon"]
    assert skills.loc["uniform", "obsidian"] == pytest.approx(0.95)
    assert math.isnan(skills.loc["uniform", "carbon"])


@pytest.mark.parametrize(("worst", "below"), [(3.9e-3, "yes"), (5e-3, "no")])
def test_the_worst_scene_is_compared_with_the_papers_best_mean(
    table: pd.DataFrame, worst: float, below: str
) -> None:
    """The paper's means lie between 0.004 and 0.006."""
    scene = (table["scene"] == f"{0:016x}") & (table["method"] == "eq8")
    chosen = scene & (table["metric"] == "nmse")
    told = beside_paper(table.assign(value=table["value"].mask(chosen, worst)))
    assert told.heads[-1] == "every scene below 0.004"
    assert {line[1]: line[-1] for line in told.lines}["eq8"] == below


def test_table_1_pools_pixels_and_stands_beside_the_paper() -> None:
    random = np.random.default_rng(1)
    pixels = {scene: random.uniform(0, 9, 50) for scene in ("a", "b", "c")}
    rows = sample.table().drop_duplicates(["metric", "method"]).query("metric == 'nmse'")
    plain = rows[rows["method"] == "eq8"]
    parts = [plain]
    for scene, values in pixels.items():
        for end, value in (("", values.mean()), ("_std", values.std())):
            metric = f"delta_e76_i_min{end}"
            parts.append(plain.assign(scene=scene, metric=metric, value=value, noise=0.2))
    errors = dict(zip(pixels, (2e-3, 5e-3, 1e-3), strict=True))
    for scene, value in errors.items():
        parts.append(plain.assign(scene=scene, metric="nmse_i_max", value=value, noise=1e-5))
    table = pd.concat([*parts[1:], *(plain.assign(scene=scene) for scene in pixels)])
    differences = table1(table).set_index(["formula", "image"])
    assert list(differences.index) == [("ΔE76", "I_min"), ("NMSE", "I_max"), ("NMSE", "I(ϑ)")]
    pooled = np.concatenate(list(pixels.values()))
    means = [values.mean() for values in pixels.values()]
    colour, error = differences.loc[("ΔE76", "I_min")], differences.loc[("NMSE", "I_max")]
    # The same sums in another order: a few roundings of float64.
    assert colour["mean"] == pytest.approx(pooled.mean(), rel=1e-12)
    assert colour["std"] == pytest.approx(pooled.std(), rel=1e-12)
    assert colour["scene_std"] == pytest.approx(np.std(means), rel=1e-12)
    assert (colour["noise"], colour["scenes"]) == (pytest.approx(0.2), 3)
    assert error["mean"] == pytest.approx(np.mean(list(errors.values())), rel=1e-12)
    assert error["scene_std"] == pytest.approx(np.std(list(errors.values())), rel=1e-12)
    assert math.isnan(error["std"])
    printed = table1_text(table1(table))
    assert printed.heads[3:] == ("ΔE76 of I_min", "NMSE of I_max", "NMSE of I(ϑ)")
    text = f"{pooled.mean():.2f} ± {pooled.std():.2f} ({np.std(means):.2f})"
    assert printed.lines[0][:5] == ["unpolarised", "eq8", "3", text, "2.7e-3 (1.7e-3)"]
    paper = ["the paper, Indoor", "–", "1.24 ± 0.31", "0.008 ± 0.0011", "–"]
    assert printed.lines[-2][1:] == paper


def test_without_colour_metrics_there_is_neither(table: pd.DataFrame) -> None:
    assert not table1_text(table1(table))
    assert "Table I" not in summary(table, sample.run())
    names = [drawing.name for drawing in drawings(table)]
    assert "figure9" not in names
    assert "figure9" in [drawing.name for drawing in drawings(sample.coloured())]


def headline_of(rows: pd.DataFrame, suite: str = "sample") -> str:
    """Labels and numbers of a headline's tiles, as one text."""
    tiles = headline_tiles(rows, table1(rows), suite)
    return " | ".join(f"{number} {label}" for number, label in tiles)


def test_the_headline_answers_what_the_suite_asks(table: pd.DataFrame) -> None:
    """Several materials ask Figure 5's question, colours Table I's, a ladder its own."""
    figure5 = headline_of(table)
    assert "mean NMSE of eq8 by material. The paper: 4e-3" in figure5
    assert "ΔE76" not in figure5
    colours = headline_of(sample.coloured())
    assert "Figure 5" not in colours
    assert "by material" not in colours
    # Means of the sample: 3 of the guess, 1 of eq8.
    assert "1.00 mean ΔE76 of I_max by eq8; unpolarised: 3.00 |" in colours
    assert "the paper, Indoor: 2.09 ± 0.64" in headline_of(sample.coloured(), "indoor")
    assert "the paper, Outdoor: 4.40 ± 1.95" in headline_of(sample.coloured(), "outdoor")
    ladder = headline_of(sample.laddered())
    # From 1e-3 with everything known to 3e-3, 7e-3 and back to 6e-3.
    assert "2.0e-3 of the mean NMSE of eq8: lobes estimated" in ladder
    assert "-1.0e-3 of the mean NMSE of eq8: single image" in ladder
    one = table[table["material"] == "pmma"]
    assert "by material" not in headline_of(one)
    assert "0.95 median skill of eq8" in headline_of(one)


def test_scenes_that_no_method_could_score_are_among_those_left_out() -> None:
    table = sample.coloured()
    lost = table["scene"] == f"{0:016x}"
    refused = table[lost].drop_duplicates("method").assign(metric="inapplicable", value=1.0)
    rows = pd.concat([table[~lost], refused], ignore_index=True)
    assert "on the 11 of 12 scenes of eq8" in headline_of(rows)


def test_the_best_method_is_that_of_the_largest_median(table: pd.DataFrame) -> None:
    """One scene on which it fails badly, as the paper's method does somewhere, decides nothing."""
    eq8 = table[table["method"] == "eq8"]
    steady = eq8.assign(method="visible", value=eq8["value"].where(eq8["metric"] != "skill", 0.5))
    failed = (table["scene"] == f"{0:016x}") & (table["metric"] == "skill")
    rows = table.assign(value=table["value"].mask(failed & (table["method"] == "eq8"), -50.0))
    assert best_method(pd.concat([rows, steady], ignore_index=True)) == "eq8"


def test_colours_of_two_methods_stand_side_by_side_on_the_same_scenes_only() -> None:
    """Where eq8 left out what is hard for every method, it would seem the better one."""
    plain = sample.coloured()
    eq8 = plain[plain["method"] == "eq8"]
    hard = eq8["scene"].isin(eq8["scene"].unique()[6:])
    colours = eq8["metric"].isin(["delta_e76_i_max", "delta_e76_i_min"])
    best = eq8.assign(
        method="visible", value=eq8["value"].mask(hard & colours, 5.0).replace(0.95, 0.99)
    )
    rows = pd.concat([plain[plain["method"] == "unpolarised"], best, eq8], ignore_index=True)
    assert "3.00 mean ΔE76 of I_max by visible; eq8: 1.00; unpolarised: 3.00" in headline_of(rows)
    fewer = pd.concat([rows[rows["method"] != "eq8"], eq8[~hard]], ignore_index=True)
    assert "3.00 mean ΔE76 of I_max by visible; unpolarised: 3.00" in headline_of(fewer)


def test_errors_of_degree_and_angle_stand_first_where_they_were_asked_for(
    table: pd.DataFrame,
) -> None:
    errors = table[(table["metric"] == "nmse") & table["angle_deg"].isna()]
    degree = errors.assign(metric="dolp_mae", value=errors["method"].map({"eq8": 0.02}).fillna(0.1))
    text = headline_of(pd.concat([table, degree], ignore_index=True))
    assert "0.02 mean DoLP MAE of eq8; of the trivial guess 0.1 |" in text


def test_summary_says_what_a_reader_must_know(table: pd.DataFrame) -> None:
    text = summary(table, sample.run())
    for words in (
        "4e-3 … 6e-3",
        "unverified stand-ins",
        "64 samples a pixel",
        "scalar_spectral_polarized",
        "2.0e-6 of the peak",
        "half_vector left out 6 scenes: needs a distant light, found uniform",
        "| render | 1.50 |",
    ):
        assert words in text


def test_bands_beyond_the_data_of_a_material_are_told(table: pd.DataFrame) -> None:
    """Data begin at 436.8 nm for NAS-21 and at 450 nm for NOA 61; an index has none."""
    names = pd.DataFrame({"material": ["nas_21", "noa_61", "water", "eta 1.5"]})
    (told,) = extrapolation(names, [400.0, 443.0, 600.0])
    assert "of 2 materials" in told
    assert told.endswith("at 400 nm nas_21; at 400 and 443 nm noa_61.")
    assert not list(extrapolation(names, [500.0]))
    run = sample.run()
    run["suite"]["wavelengths_nm"] = [400.0, 500.0]
    assert "at 400 nm noa_61" in summary(table.assign(material="noa_61"), run)


def test_the_headline_counts_scenes_worse_than_no_model(table: pd.DataFrame) -> None:
    rows = table[table["body"] == "unpolarised"].copy()
    scenes = rows["scene"].unique()
    worse = rows["scene"].isin(scenes[:2]) & (rows["metric"] == "skill")
    rows.loc[worse & (rows["method"] == "eq8"), "value"] = -0.5
    told = f"2 of {len(scenes)} scenes with negative skill of eq8"
    assert told in headline_of(rows)


def test_errors_of_a_group_stand_beside_the_guess_on_the_same_captures() -> None:
    """What a method left out may be hard, or easy: there the guess does not count either."""
    captured = sample.captured()
    indoor = captured["light"] == "indoor"
    left_out = captured[indoor]["scene"].unique()[0]
    hard = captured["scene"] == left_out
    guess = (captured["method"] == "unpolarised") & (captured["metric"] == "nmse")
    captured.loc[hard & guess, "value"] = 1e3
    kept = captured[~(hard & (captured["method"] == "eq8"))]
    (line,) = [one for one in captured_by_group(kept).lines if one[:2] == ["indoor", "eq8"]]
    whole = captured["angle_deg"].isna() & captured["band_nm"].isna()
    shared = captured[indoor & guess & ~hard & whole]
    assert line[2] == "2 of 3"
    assert line[3].endswith(f"({scientific(shared['value'].mean())})")


def test_noise_of_two_runs_adds_in_quadrature() -> None:
    """Standard errors 3 and 4 make 5; the tolerance is added as it stands."""
    width = noise_width("gain", 0.03, 0.04, 2.0)
    assert width == pytest.approx(TOLERANCES["gain"] + 2.0 * HIDDEN_NOISE * 0.05, rel=1e-12)


def test_an_estimate_that_is_not_finite_has_no_skill_and_that_is_said(table: pd.DataFrame) -> None:
    assert no_scene_without_skill(table).startswith("Every scene has a skill")
    assert "not finite has no skill" in no_scene_without_skill(broken(table))


def test_the_worst_place_stands_first(table: pd.DataFrame) -> None:
    worse = with_skill(with_skill(table, -0.2, method="eq8", surface="carbon"), -7.0,
                       method="eq8", surface="carbon", light="distant 60°")  # fmt: skip
    worst = negative_skills(worse, "eq8")["worst"].tolist()
    assert len(worst) > 1
    assert worst == sorted(worst)
    assert worst[0] == -7.0


def test_a_method_that_left_scenes_out_is_not_in_bold_at_an_equal_mean() -> None:
    metric = definition_of("nmse")
    cells = {("all", "nmse"): Cell(1e-3, 1e-5, 9), ("some", "nmse"): Cell(1e-3, 1e-5, 8)}
    made = PaperTable(("all", "some"), (metric,), cells)
    assert [made.is_best(name, metric) for name in made.methods] == [True, False]
