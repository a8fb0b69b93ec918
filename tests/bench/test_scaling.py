"""What many scenes cost is measured on runs that are real but for the renders."""

from __future__ import annotations

from malus.bench.studies.scaling import (
    FAMILY,
    Messages,
    Scale,
    made_up_suite,
    measure,
    report_lines,
)


def test_a_suite_has_as_many_scenes_as_asked_for_and_all_are_different() -> None:
    ids = [scene.id for scene in made_up_suite(100).scenes()]
    assert len(ids) == len(set(ids)) == 5 * FAMILY


def test_costs_are_those_of_a_run_of_so_many_scenes() -> None:
    one, four = measure([FAMILY, 4 * FAMILY])
    assert (one.scenes, four.scenes) == (FAMILY, 4 * FAMILY)
    # One Parquet file a family and one of all: some of their bytes are the same for any size.
    assert 2 * one.store_mb < four.store_mb < 4 * one.store_mb
    assert 0 < one.start_mb <= one.memory_mb
    assert min(one.plan_seconds, one.run_seconds) > 0


def test_larger_numbers_are_drawn_on_in_a_straight_line() -> None:
    scales = [Scale(n, 1e-3 * n, 2e-3 * n, 5.0 + n, 100.0, 100.0 + 0.5 * n) for n in (10, 30)]
    lines = report_lines(scales, Messages(5000, 500_000, 0.024))
    million = next(line for line in lines if line.startswith("  1000000")).split()
    # plan 1 ms, tables 2 ms, scheduler 24 ms a family of 24 = 1 ms, each times a million
    assert [million[k] for k in (1, 3, 9)] == ["1000.0", "2000.0", "1000.0"]
    assert (million[5], million[7]) == ("1000005.0", "500100")


def test_no_cost_falls_with_more_scenes() -> None:
    """Peaks of memory of two small runs differ by chance, in either direction."""
    scales = [Scale(24, 0.01, 0.1, 0.2, 600.0, 671.0), Scale(48, 0.02, 0.2, 0.4, 600.0, 614.0)]
    lines = report_lines(scales, Messages(5000, 500_000, 0.024))
    million = next(line for line in lines if line.startswith("  1000000")).split()
    assert million[7] == "614"
