"""Colour matching functions at the bands, which both previews and colour differences use."""

from __future__ import annotations

import subprocess
import sys

import colour
import numpy as np
import pytest

from malus.scenes.colour import (
    RGB,
    band_weights,
    cell_widths,
    channel_weights,
    lab,
    preview,
    srgb_weights,
)
from malus.scenes.colour import matching_functions as matching

BANDS = (450.0, 512.5, 550.25, 610.0, 650.0)


def test_both_interpolations_agree_with_the_table() -> None:
    whole = (360.0, 445.0, 555.0, 600.0, 830.0)
    # Tabulated wavelengths: only the rounding of the polynomial is between them.
    np.testing.assert_allclose(matching(whole), matching(whole, "sprague"), rtol=1e-12, atol=1e-15)
    # Between rows 1 nm apart a straight line errs by f'' / 8, of the order of 1e-4.
    np.testing.assert_allclose(matching(BANDS), matching(BANDS, "sprague"), atol=3e-4)


def test_nothing_is_visible_outside_the_table() -> None:
    for between in ("linear", "sprague"):
        assert not matching((100.0, 359.0, 830.5, 2000.0), between).any()


def test_cells_meet_half_way() -> None:
    np.testing.assert_allclose(cell_widths((400.0, 410.0, 430.0)), [10.0, 15.0, 20.0])
    np.testing.assert_allclose(cell_widths((532.0,)), [1.0])


def test_grey_is_grey_in_every_colorimetry() -> None:
    spectrum = np.full((1, 1, len(BANDS)), 0.18)
    colours = lab(spectrum, band_weights(BANDS)).ravel()
    # The white of both is equal energy, adapted to that of sRGB in previews.
    of_preview = lab(preview(spectrum, BANDS), channel_weights(RGB)).ravel()
    np.testing.assert_allclose(colours[1:], 0.0, atol=1e-9)
    # sRGB's matrices are rounded to four digits, and its preview to single precision.
    np.testing.assert_allclose(of_preview, colours, atol=0.05)


def test_the_table_of_the_observer_is_that_of_colour_science() -> None:
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    np.testing.assert_array_equal(matching(tuple(observer.wavelengths)), observer.values)


@pytest.mark.parametrize("bands", [BANDS, (450.0, 550.0, 650.0), tuple(np.arange(360.0, 840.0, 5))])
def test_the_colour_of_a_preview_is_that_of_colour_science(bands: tuple[float, ...]) -> None:
    observer = "CIE 1931 2 Degree Standard Observer"
    responses = colour.MSDS_CMFS[observer][np.minimum(bands, 830.0)] * np.gradient(bands)[:, None]
    responses[np.array(bands) > 830.0] = 0.0
    white = colour.CCS_ILLUMINANTS[observer]["E"]
    expected = colour.XYZ_to_RGB(responses / responses.sum(axis=0), "sRGB", white, "Bradford")
    # A matrix of 17 digits, and the rounding of the polynomial between the table's rows.
    np.testing.assert_allclose(srgb_weights(bands), expected, rtol=0, atol=1e-14)


def test_colour_science_leaves_how_numpy_prints_numbers() -> None:
    """Its import sets the format of NumPy 1.13: 12 digits, in every table written afterwards."""
    code = (
        "import numpy as np; before = np.get_printoptions();"
        "from malus.scenes.core.colour_science import colour_science;"
        "assert colour_science().__name__ == 'colour'; print(before == np.get_printoptions())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


def test_lab_is_that_of_colour_science() -> None:
    weights = band_weights(BANDS)
    radiance = np.random.default_rng(3).random((500, len(BANDS))) ** 4
    radiance[:9] *= 1e-3  # the straight part near black
    white = weights.sum(axis=0)
    xyz = radiance @ weights / 100.0
    expected = colour.XYZ_to_Lab(xyz, colour.XYZ_to_xy(white / 100.0))
    # Both round a few times, and the white of colour-science goes through its chromaticity.
    np.testing.assert_allclose(lab(radiance, weights), expected, rtol=0, atol=1e-12)
