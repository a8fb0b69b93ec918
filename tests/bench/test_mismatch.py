"""The price of an assumption: nothing where it holds, and by hand on tables made up here."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from malus.bench.studies import mismatch
from malus.bench.studies.mismatch import ASSUMPTIONS, Effort, mismatch_table, tilted
from malus.bench.studies.registry import run_study
from malus.renderers import Truth, render
from malus.renderers.variant import choose
from malus.reports.figures.prices import figure_prices
from malus.reports.tables.headline import price_tiles
from malus.reports.tables.prices import price_cells, prices
from malus.scenes import Camera, Dielectric, Distant, InputError, Scene, Sphere

COLUMNS = ["assumption", "kind", "scene", "method", "holds", "broken"]


def test_tilted_normals_stay_unit_and_turn_by_the_angle() -> None:
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(500, 3)) * [0.5, 0.5, 0.2] + [0, 0, 1]
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    turned = tilted(normals, 5.0)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=-1), 1.0, rtol=1e-12)
    angle = np.degrees(np.arccos(np.clip((turned * normals).sum(-1), -1, 1)))
    np.testing.assert_allclose(angle, 5.0, rtol=1e-9)
    # No direction is preferred: the mean turn is nought within four standard errors.
    assert np.linalg.norm((turned - normals).mean(axis=0)) < 4 * 0.087 / np.sqrt(len(normals))
    grazing = np.array([[1.0, 0.0, 1e-3]])
    assert (tilted(np.repeat(grazing, 50, axis=0), 5.0)[:, 2] > 0).all()


@pytest.fixture
def truth() -> Truth:
    return render(
        Scene(
            shape=Sphere(),
            surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised", albedo=0.2),
            light=Distant(incidence_deg=60),
            camera=Camera(resolution=16),
        ),
        renderer="torrance-sparrow",
    )


def test_right_inputs_cost_nothing(truth: Truth) -> None:
    rows = list(mismatch._of_inputs(truth, "eta", lambda observation: observation))
    assert [method for _, method, *_ in rows] == list(mismatch.METHODS)
    assert all(holds == broken for *_, holds, broken in rows)


def test_an_input_has_no_price_for_methods_that_do_not_use_it(truth: Truth) -> None:
    """`eq8` is printed without a light; every one whose price is told changes its estimate."""
    turned = partial(mismatch._turned_light, by_deg=10.0)
    ((_, name, holds, broken),) = mismatch._of_inputs(truth, "light", turned)
    assert name == "lights+body"
    assert holds != broken


def test_prices_are_paired_means() -> None:
    rows = [("a", "truth", str(k), "eq8", 0.9, 0.9 - d) for k, d in enumerate((0.1, 0.2, 0.3))]
    rows += [("a", "truth", "3", "eq8", 0.9, float("nan"))]
    numbers = prices(pd.DataFrame(rows, columns=COLUMNS))
    assert numbers.price.item() == pytest.approx(0.2)
    # Student's t of two degrees of freedom at 97.5 %, 4.303, times 0.1 / √3.
    assert numbers.half_width.item() == pytest.approx(4.3027 * 0.1 / 3**0.5, rel=1e-4)
    assert (numbers.pairs.item(), numbers.worst.item()) == (3, pytest.approx(0.3))
    assert price_cells(numbers).lines[0][:2] == ["a", "eq8"]


def test_both_signs_of_a_wrong_input_are_one_chance() -> None:
    """Twice the rows of the same scenes tell no more of their spread."""
    pairs = [("a", "input", str(k), "eq8", 0.9, 0.9 - d) for k, d in enumerate((0.1, 0.2, 0.3))]
    once, twice = (prices(pd.DataFrame(rows, columns=COLUMNS)) for rows in (pairs, 2 * pairs))
    assert twice.half_width.item() == pytest.approx(once.half_width.item(), rel=1e-12)
    assert (twice.pairs.item(), twice.all_pairs.item()) == (3, 3)
    signs = [(*row[:5], row[5] + sign) for row in pairs for sign in (-0.05, 0.05)]
    both = prices(pd.DataFrame(signs, columns=COLUMNS))
    assert both.price.item() == pytest.approx(once.price.item(), rel=1e-12)
    assert both.half_width.item() == pytest.approx(once.half_width.item(), rel=1e-12)
    assert both.worst.item() == pytest.approx(0.35)


def test_pairs_without_a_skill_are_told() -> None:
    """Where no pair has one, the assumption stays in the table, and is no bar."""
    nothing = float("nan")
    rows = [("a", "truth", str(k), "eq8", 0.9, (0.8, 0.7, nothing)[k]) for k in range(3)]
    rows += [("b", "input", "0", "visible", 0.9, nothing), ("c", "input", "0", "visible", 0.9, 0.4)]
    numbers = prices(pd.DataFrame(rows, columns=COLUMNS))
    lines = price_cells(numbers).lines
    assert [line[-1] for line in lines] == ["2 of 3", "0 of 1", "1"]
    assert lines[1][4] == "–"
    axes = figure_prices(numbers, "eq8").axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "c, visible"]


def test_shadowing_is_all_that_its_pair_differs_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under uniform light, where only the body of a method and its facets matter."""
    if not choose("auto").vectorised:
        pytest.skip("needs LLVM or CUDA")
    monkeypatch.setattr(mismatch, "SHAPES", (Sphere(),))
    monkeypatch.setattr(mismatch, "ALPHAS", (0.5,))
    ((_, name, holds, broken),) = mismatch._masking(Effort.of(24, 128, "auto"))
    assert name == "visible+body"
    assert holds == pytest.approx(1.0, abs=0.02)  # coarse pixels and few samples
    # Rough facets shadow each other most where the viewer sees them at grazing incidence.
    assert 0.05 < holds - broken < 3.0


@pytest.mark.parametrize(
    ("samples", "backend", "expected"),
    [(3, "auto", "key samples: expected a multiple of 2"), (2, "scalar", "expected LLVM or CUDA")],
)
def test_the_study_refuses_what_it_cannot_render(
    samples: int, backend: str, expected: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=f"study mismatch.*{expected}"):
        run_study("mismatch", tmp_path / "none", samples=samples, backend=backend)


def test_the_study_writes_its_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two assumptions on tiny pictures; with all physics the skill is nearly 1."""
    variant = choose("auto")
    if not variant.vectorised:
        pytest.skip("needs LLVM or CUDA")
    chosen = [one for one in ASSUMPTIONS if "GGX" in one.name or "index known" in one.name]
    monkeypatch.setattr(mismatch, "ASSUMPTIONS", chosen)
    monkeypatch.setattr(mismatch, "SHAPES", (Sphere(),))
    table = mismatch_table(Effort.of(16, 32, "auto"))
    assert list(table.columns) == COLUMNS
    assert set(table.assumption) == {one.name for one in chosen}
    told = table[(table.kind == "truth") & (table.method == "lights+body")]
    # With all physics the skill is 1; what is left are pixels that are coarse, and few samples.
    assert told.holds.median() > 0.95
    run_study("mismatch", tmp_path / "page", resolution=16, samples=16)
    page = (tmp_path / "page" / "report.html").read_text("utf-8")
    assert "The price of each assumption" in page


def test_the_dearest_assumptions_stand_first() -> None:
    """Of each assumption its first method; one that no pair prices is left out."""
    rows = [
        (name, "truth", scene, method, 0.9, broken)
        for name, broken in (
            ("a", 0.8),
            ("b", 0.2),
            ("c", np.nan),
            ("d", 0.5),
            ("e", 0.6),
            ("f", 0.9),
        )
        for method in ("eq8", "visible")
        for scene in ("s", "t")
    ]
    tiles = list(price_tiles(pd.DataFrame(rows, columns=COLUMNS)))
    assert [label for _, label in tiles] == [
        f"loss of skill: {name} (eq8)" for name in ("b", "d", "e", "a")
    ]
    assert tiles[0][0].startswith("0.7")
