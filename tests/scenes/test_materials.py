"""Materials and surfaces, against reference indices computed elsewhere and the laws they obey."""

from __future__ import annotations

import pickle
import tomllib
from pathlib import Path

import numpy as np
import pytest

from malus.scenes.core.errors import InputError
from malus.scenes.materials.materials import Material, material, materials, surface, surfaces

# n at 400, 587.6 and 700 nm and the Abbe number, computed by the authors of the shared data from
# the database's own numbers with another programme.
REFERENCE = {
    "pmma": (1.50753, 1.49253, 1.48885, 59.3),
    "polystyrene": (1.62858, 1.59163, 1.58291, 29.5),
    "polycarbonate": (1.62359, 1.58476, 1.57565, 27.8),
    "styrene_acrylonitrile": (1.59742, 1.56647, 1.55910, 33.5),
    "nas_21": (1.60333, 1.57130, 1.56369, 32.7),
    "optorez_1330": (1.52735, 1.50946, 1.50510, 51.4),
    "zeonex_e48r": (1.54900, 1.53051, 1.52600, 51.8),
    "cellulose": (1.48583, 1.47013, 1.46629, 54.0),
    "polyethylene_terephthalate": (1.61027, 1.56925, 1.56052, 27.9),
    "polyvinyl_chloride": (1.56135, 1.54247, 1.53754, 53.9),
    "polydimethylsiloxane": (1.42528, 1.41148, 1.40863, 59.2),
    "noa_61": (1.58107, 1.55974, 1.55354, 42.4),
    "water": (1.34356, 1.33340, 1.33052, 55.7),
    "methanol": (1.33715, 1.32701, 1.32460, 59.6),
    "ethanol": (1.37256, 1.36168, 1.35898, 59.3),
    "acetone": (1.37126, 1.35916, 1.35628, 54.4),
    "butanol_1": (1.41057, 1.39538, 1.39261, 60.5),
    "ethylene_glycol": (1.44517, 1.43158, 1.42817, 56.6),
    "chloroform": (1.46272, 1.44497, 1.44067, 45.4),
    "carbon_tetrachloride": (1.47509, 1.45697, 1.45307, 49.5),
    "glycerol": (1.48403, 1.47133, 1.46803, 64.4),
    "benzene": (1.52918, 1.49575, 1.48893, 30.4),
    "nitrobenzene": (1.59572, 1.55076, 1.54040, 22.9),
    "carbon_disulfide": (1.69508, 1.62839, 1.61339, 17.9),
}

# The reference is printed with 5 decimals (Abbe: 1): half a unit, and a little for the halves.
INDEX_ROUNDING = 0.51e-5
ABBE_ROUNDING = 0.051


@pytest.mark.parametrize("name", REFERENCE)
def test_index_matches_the_reference(name: str) -> None:
    n_400, n_d, n_700, abbe = REFERENCE[name]
    substance = material(name)
    found = substance.eta([400.0, 587.6, 700.0])
    np.testing.assert_allclose(found, [n_400, n_d, n_700], rtol=0, atol=INDEX_ROUNDING)
    assert substance.eta_d == found[1]
    assert abs(substance.abbe - abbe) < ABBE_ROUNDING


def test_twelve_plastics_and_twelve_liquids() -> None:
    assert list(materials()) == list(REFERENCE)
    kinds = [item.kind for item in materials().values()]
    assert kinds == ["plastic"] * 12 + ["liquid"] * 12
    assert all(item.source for item in materials().values())


def test_numbers_are_those_of_the_shared_data(shared: Path) -> None:
    theirs = tomllib.loads((shared / "data" / "materials.toml").read_text("utf-8"))
    for entry in theirs["material"]:
        ours, dispersion = material(entry["id"]), entry["dispersion"]
        assert ours.source == entry["source"]
        assert ours.dispersion == dispersion["type"]
        assert list(ours.coefficients) == dispersion.get("coefficients", [])
        assert list(ours.table_n) == dispersion.get("n", [])
        # Micrometres times 1000, rounded: exact to a femtometre.
        assert ours.table_nm == pytest.approx(
            [1e3 * um for um in dispersion.get("wavelength_um", [])], abs=1e-6
        )
        assert ours.valid_range_nm == pytest.approx([1e3 * um for um in entry["valid_range_um"]])
        extrapolated = entry["computed"]["extrapolated_wavelengths_nm"]
        lines = np.array([400.0, 486.1, 587.6, 656.3, 700.0])
        assert lines[ours.extrapolated(lines)].tolist() == extrapolated


@pytest.mark.parametrize("name", REFERENCE)
def test_normal_dispersion_over_the_visible(name: str) -> None:
    # Transparent media: n falls towards the red. Measured tables may tie in their last digit.
    eta = material(name).eta(np.linspace(400, 700, 301))
    assert (np.diff(eta) <= 0).all()
    assert ((eta > 1.3) & (eta < 1.8)).all()


@pytest.mark.parametrize("name", ["water", "pmma", "polyvinyl_chloride"])
def test_shape_and_dtype_follow_the_wavelengths(name: str) -> None:
    for wavelengths in (550, [500, 600], np.full((2, 3), 550, dtype=np.float32)):
        eta = material(name).eta(wavelengths)
        assert isinstance(eta, np.ndarray)
        assert eta.shape == np.shape(wavelengths)
        assert eta.dtype == np.float64


def test_table_is_linear_between_its_points_and_ends_there() -> None:
    table = material("polyvinyl_chloride")
    low, high = table.eta([410.0, 420.0])
    assert float(table.eta(412.5)) == pytest.approx(0.75 * low + 0.25 * high, abs=1e-15)
    for outside in (399.9, 700.1):
        assert bool(table.extrapolated(outside))
        with pytest.raises(InputError, match=r"within its table, 400 to 700 nm"):
            table.eta([550.0, outside])


def test_formula_extrapolates_and_says_so() -> None:
    polystyrene = material("polystyrene")
    assert float(polystyrene.eta(400.0)) > float(polystyrene.eta(436.8))
    assert polystyrene.extrapolated([436.7, 436.8, 1052.0, 1052.1]).tolist() == [
        True, False, False, True,
    ]  # fmt: skip


@pytest.mark.parametrize("wavelength", [0.0, -550.0, np.nan, np.inf])
def test_impossible_wavelengths_are_refused(wavelength: float) -> None:
    for name in ("water", "polyvinyl_chloride"):
        with pytest.raises(InputError, match="positive finite wavelengths"):
            material(name).eta([550.0, wavelength])


def test_wavelength_between_poles_has_no_real_index() -> None:
    # Below its pole at 500 nm this one-term Sellmeier formula gives n² < 0.
    pole = Material(
        "x", "x", "liquid", "-", (450.0, 700.0), "sellmeier_direct_poles", (0.0, 0.75, 0.25)
    )
    with pytest.raises(InputError, match="real index"):
        pole.eta(450.0)


@pytest.mark.parametrize("name", REFERENCE)
def test_an_index_is_given_near_its_data_only(name: str) -> None:
    """Where it was measured and where people see: no formula has run off there, none is trusted
    beyond.

    Of these media all indices lie between 1.3 and 2.1 there, that of carbon disulfide at 300 nm
    being the largest, and fall towards the red over the visible. The data of carbon disulfide go on
    over a band of absorption at 6.5 µm.
    """
    substance = material(name)
    is_table = substance.dispersion == "table"
    low, high = substance.usable_range_nm
    assert (low, high) == substance.valid_range_nm if is_table else low <= 360 < 830 <= high
    eta = substance.eta(np.geomspace(low, min(high, 2800), 200))
    assert ((eta > 1.3) & (eta < 2.1)).all()
    if not is_table:
        assert (np.diff(substance.eta(np.linspace(360, 830, 48))) < 0).all()
    for outside in (low * 0.999, high * 1.001):
        with pytest.raises(InputError, match=rf"material {name}: expected .*wavelengths .* nm"):
            substance.eta([550.0, outside])


def test_formulas_against_hand_computed_values() -> None:
    # At L = 0.5 µm the sums are short decimals: n² = 1 + 1 + 0.75 · 0.25 / (0.25 − 0.0625) = 3.
    def index(dispersion: str, coefficients: tuple[float, ...]) -> float:
        substance = Material("x", "x", "liquid", "-", (1.0, 2.0), dispersion, coefficients)
        return float(substance.eta(500.0)) ** 2

    # Two ulp of rounding in the square of a square root.
    assert index("sellmeier_squared_poles", (1.0, 0.75, 0.25)) == pytest.approx(3.0, rel=4e-16)
    assert index("sellmeier_direct_poles", (1.0, 0.75, 0.0625)) == pytest.approx(3.0, rel=4e-16)
    assert index("polynomial_in_n_squared", (2.0, 4.0, 2.0)) == pytest.approx(3.0, rel=4e-16)
    assert index("cauchy", (1.0, 0.25, -2.0)) == pytest.approx(4.0, rel=4e-16)


def test_surfaces_are_those_of_the_shared_data(shared: Path) -> None:
    theirs = tomllib.loads((shared / "data" / "roughness.toml").read_text("utf-8"))["surface"]
    assert list(surfaces()) == [entry["id"] for entry in theirs]
    for entry in theirs:
        ours = surface(entry["id"])
        assert ours.alpha == entry["rms_slope_m"]
        assert ours.albedo == entry["diffuse_fraction"]
        assert ours.status == entry["status"]
        # The shared file prints σ with 4 decimals.
        assert ours.sigma == pytest.approx(entry["exponent_sigma"], abs=0.51e-4)


def test_unverified_surfaces_say_so() -> None:
    assert {item.status for item in surfaces().values()} == {"recalled_unverified"}


def test_unknown_names_list_close_matches() -> None:
    with pytest.raises(InputError, match=r"found 'watter'; did you mean water\?"):
        material("watter")
    with pytest.raises(InputError, match=r"known: carbon, rubber"):
        surface("zzzz")


def test_callers_cannot_change_what_others_see() -> None:
    materials().clear()
    assert len(materials()) == 24


@pytest.mark.parametrize("nasty", ["two\nlines", "\x1b[31mred", "\u2028", "tab\t", "\udc80", "\r"])
def test_input_error_is_one_printable_line(nasty: str) -> None:
    text = str(InputError(nasty, nasty, nasty, nasty))
    assert text.isprintable()
    text.encode("utf-8")


def test_input_error_shortens_what_was_found() -> None:
    text = str(InputError("here", "little", "x" * 10_000, "write less"))
    assert text == f"here: expected little, found {'x' * 77}...; write less"


def test_input_error_survives_pickling() -> None:
    error = InputError("a", "b", "c", "d")
    again = pickle.loads(pickle.dumps(error))
    assert isinstance(again, ValueError)
    assert (str(again), again.hint) == (str(error), "d")
