"""The stress table passes, says what is wrong when something is, and its reference is right."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from mpmath import mpf
from reference import fresnel as literal

from malus.bench.cli import cli
from malus.bench.studies import stress
from malus.bench.studies.reference import reference_dolp, reflectances
from malus.bench.studies.stress_images import ImageCase, image_cases, image_faults, ordinary
from malus.reconstruct import known_lights
from malus.reconstruct import lobe_models as lobes
from malus.reconstruct import pixel_block as block

SOME = stress.rho_cases()[2::11]


def test_the_table_passes() -> None:
    table = stress.stress_table(SOME)
    assert len(table) > 100
    assert set(table.group) == {"rho", "image", "shape", "refusal"}
    assert table.passed.all(), table[~table.passed].to_string()
    assert table[table.group == "rho"].error.max() <= 1e-8


def test_every_case_of_the_issue_is_there() -> None:
    cases = stress.rho_cases()
    assert {case.eta for case in cases} >= {1.0, 1 + 1e-12, 1 - 1e-12, 1.0001, 0.6, 4.0, 0.2 + 3.4j}
    assert {case.sigma for case in cases} >= {1e-6, 1e10}
    assert {case.name for case in cases} >= {"zenith 0", "zenith 1e-6", "89.99°", "90°"}
    assert {case.measure for case in SOME} == {"eq8", "visible", "shadowed"}


def test_a_wrong_integral_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    exact = stress.specular_dolp
    monkeypatch.setattr(stress, "specular_dolp", lambda *a: exact(*a) + 2e-8)
    table = stress.stress_table(SOME[:3], methods=())
    rho = table[table.group == "rho"]
    assert not rho.passed.any()
    assert rho.why.str.contains("error above 1e-08").all()


def test_silent_repair_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def all_good(rows: block.Block) -> np.ndarray:
        return np.ones(rows.mask.shape, dtype=bool)

    monkeypatch.setattr(block.Block, "valid", property(all_good))
    table = stress.stress_table([], methods=("eq8+body",))
    failed = table[~table.passed]
    assert "NaN specular, one band, float32" in set(failed.case)
    assert "negative diffuse, one band, float64" in set(failed.case)
    assert "zero normal, float32" in set(failed.case)
    assert "ordinary pixels, float32" not in set(failed.case)


def test_too_much_polarisation_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block, "below_one", lambda dtype: 1.0 + 1e-6)
    case = next(case for case in image_cases() if case.name == "complete polarisation")
    assert any("DoLP" in fault for fault in image_faults(case, "float32", "smooth"))


def test_a_warning_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def warning(*_: object) -> object:
        return np.array([np.inf]) * np.array([0.0])

    monkeypatch.setattr(known_lights, "quadrature", warning)
    case = ImageCase("ordinary pixels", lambda observation: observation, False)
    assert "warns invalid value" in image_faults(case, "float32", "lights")[0]


def test_unchecked_roughness_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lobes, "uniform_alpha", lambda observation: abs(observation.alpha) + 0.1)
    failed = stress.stress_table([], methods=())
    failed = failed[~failed.passed]
    assert "eq8, alpha -0.3" in set(failed.case)
    assert set(failed.group) == {"refusal"}


def run_stress(out: Path, table: Any, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(stress, "stress_table", lambda: table)
    return CliRunner().invoke(cli, ["run", "stress", "--out", str(out)]).exit_code


def test_the_command_writes_the_table_and_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = stress.stress_table(SOME[:1], methods=("half_vector",))
    assert run_stress(tmp_path / "good", table, monkeypatch) == 0
    text = (tmp_path / "good" / "stress.md").read_text("utf-8")
    assert text.count("\n") == len(table) + 2
    assert "| ok |" in text
    assert "FAILED" not in text
    header = (tmp_path / "good" / "stress.csv").read_text("utf-8").splitlines()[0]
    assert header == "group,case,seconds,value,error,why,passed"
    table.loc[0, "passed"] = False
    assert run_stress(tmp_path / "bad", table, monkeypatch) == 1
    assert "FAILED" in (tmp_path / "bad" / "stress.md").read_text("utf-8")


def test_the_ordinary_image_is_ordinary() -> None:
    observation = ordinary("float64")
    np.testing.assert_allclose(np.linalg.norm(observation.normals, axis=-1), 1.0, rtol=1e-12)
    assert observation.specular is not None
    assert observation.specular.min() > 0.0


def test_reference_against_the_stored_one() -> None:
    """The stored values come from another program: Fresnel in mpmath, order 18 throughout."""
    path = Path(__file__).parents[1] / "reference" / "stress_values.json"
    rows = json.loads(path.read_text("utf-8"))["rows"][3::86]
    assert len(rows) >= 8
    for row in rows:
        eta = complex(*row["eta"]) if row["eta"][1] else row["eta"][0]
        reference = reference_dolp(row["zenith"], eta, row["sigma"], row["measure"])
        # The worst of the stored ones (rough, visible) are good to 1.5e-9.
        assert reference.value == pytest.approx(row["rho"], abs=2e-9)


@pytest.mark.parametrize("eta", [1 + 1e-12, 1 - 1e-12, 0.6, 1.5, 4.0, 0.2 + 3.4j])
def test_reference_fresnel_against_mpmath(eta: complex) -> None:
    incidence = np.array([0.2, 0.7, 1.1, 1.5])
    perpendicular, parallel = reflectances(np.cos(incidence), eta)
    delta2 = abs((eta - 1) * (eta + 1)) ** 2
    for index, angle in enumerate(incidence):
        exact = [float(value) for value in literal.reflectances(mpf(angle), eta)]
        # cos(1.5) keeps 15 digits; F_∥ may vanish, so both are judged beside F_⊥.
        bound = 1e-12 * exact[0]
        assert perpendicular[index] * delta2 == pytest.approx(exact[0], abs=bound)
        assert parallel[index] * delta2 == pytest.approx(exact[1], abs=bound)
