"""ΔE against colour-science's own path from spectra to CIELAB, on whole images."""

from __future__ import annotations

from dataclasses import replace

import colour
import numpy as np
import pytest
from made_up import truth_with

from malus.bench.scoring.colour_error import delta_e
from malus.bench.scoring.extra_metrics import METRICS
from malus.bench.scoring.metrics import PixelSums
from malus.bench.scoring.polarisation_error import scaled
from malus.reconstruct import Components
from malus.renderers.truth import Truth
from malus.scenes.colour import JUST_NOTICEABLE, band_weights, compared_colours, lab
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import PAPER_ANGLES_DEG

SIDE = 10
BANDS = tuple(float(nm) for nm in range(400, 701, 20))


def made_up(seed: int = 0) -> tuple[Truth, Components]:
    rng = np.random.default_rng(seed)
    shape = (SIDE, SIDE, len(BANDS), 3)
    stokes = rng.uniform(-0.2, 0.2, shape) + np.array([0.7, 0, 0])
    mask = rng.random((SIDE, SIDE)) < 0.8
    truth = truth_with(stokes, mask, BANDS, noise=0.01 * rng.normal(size=shape))
    guess = stokes + rng.uniform(-0.05, 0.05, shape)
    return truth, Components(guess[..., 0], guess[..., 1], guess[..., 2])


def differences(
    truth: Truth, estimate: Components, method: str = "CIE 1976"
) -> dict[tuple[str, float | None], PixelSums]:
    estimated, true = (scaled(picture.stokes, truth) for picture in (estimate, truth))
    sums_by_angle = delta_e(estimated, compared_colours(true, BANDS), method)
    return {(suffix, angle): sums for suffix, angle, sums in sums_by_angle}


def colour_science_lab(image: np.ndarray) -> np.ndarray:
    """The whole image integrated by colour-science itself, under its equal-energy illuminant."""
    shape = colour.SpectralShape(BANDS[0], BANDS[-1], BANDS[1] - BANDS[0])
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    flat = colour.sd_ones(shape)
    xyz = colour.msds_to_XYZ(
        image, cmfs=observer, illuminant=flat, method="Integration", shape=shape
    )
    white = colour.sd_to_XYZ(flat, cmfs=observer, illuminant=flat, method="Integration")
    return np.asarray(colour.XYZ_to_Lab(xyz / 100, colour.XYZ_to_xy(white)))


@pytest.mark.parametrize("method", ["CIE 1976", "CIE 2000"])
def test_delta_e_equals_colour_science_on_whole_images(method: str) -> None:
    truth, estimate = made_up()
    white = truth.image[truth.mask].max()
    expected = {}
    for angle in PAPER_ANGLES_DEG:
        labs = [colour_science_lab(p.polarised(angle) / white) for p in (truth, estimate)]
        expected["", angle] = colour.delta_E(*labs, method=method)[truth.mask]
    half = 0.5 * np.hypot(truth.stokes[..., 1], truth.stokes[..., 2])
    i_max = 0.5 * truth.image + half
    pair = [colour_science_lab(image / white) for image in (i_max, estimate.i_max)]
    expected["_i_max", None] = colour.delta_E(*pair, method=method)[truth.mask]
    pair = [colour_science_lab(i / white) for i in (truth.image - i_max, estimate.i_min)]
    expected["_i_min", None] = colour.delta_E(*pair, method=method)[truth.mask]
    by_angle = differences(truth, estimate, method)
    for key, pixels in expected.items():
        sums = by_angle[key]
        # 1e-7: colour-science rounds the weights of its integration no coarser than this.
        assert sums.mean == pytest.approx(pixels.mean(), rel=1e-7)
        assert sums.std == pytest.approx(pixels.std(), rel=1e-7)
    over_all = np.concatenate([expected["", angle] for angle in PAPER_ANGLES_DEG])
    assert by_angle["", None].mean == pytest.approx(over_all.mean(), rel=1e-7)
    assert by_angle["", None].std == pytest.approx(over_all.std(), rel=1e-7)


def test_white_is_white_whatever_the_bands() -> None:
    for bands in ((550.0,), (400.0, 443.0, 486.0, 529.0, 571.0, 614.0, 657.0, 700.0), BANDS):
        weights = band_weights(bands)
        assert weights[:, 1].sum() == pytest.approx(100.0, rel=1e-12)
        np.testing.assert_allclose(lab(np.ones(len(bands)), weights), [100.0, 0.0, 0.0], atol=1e-9)


def test_unequal_bands_count_by_their_width() -> None:
    """Splitting one band in two equal halves leaves the integral of a smooth spectrum alone."""
    coarse = band_weights((500.0, 520.0, 540.0, 560.0, 580.0, 600.0))
    dense = band_weights((500.0, 520.0, 540.0, 545.0, 550.0, 555.0, 560.0, 580.0, 600.0))
    # The curves bend over 20 nm; without widths the densely sampled middle would count double.
    np.testing.assert_allclose(dense.sum(axis=0), coarse.sum(axis=0), rtol=0.03)


def test_equal_images_differ_by_nothing_and_nobody_sees_less_than_a_jnd() -> None:
    truth, _ = made_up()
    stokes = truth.stokes
    perfect = Components(stokes[..., 0], stokes[..., 1], stokes[..., 2])
    assert all(sums.mean < 1e-6 for sums in differences(truth, perfect).values())
    brighter = Components(*(np.moveaxis(1.01 * stokes, -1, 0)))
    brightened = differences(truth, brighter).values()
    assert all(0 < sums.mean < JUST_NOTICEABLE for sums in brightened)


def test_shards_add_up_to_the_whole() -> None:
    truth, estimate = made_up()
    y, x = np.unravel_index(np.argmax(np.where(truth.mask, truth.image.max(-1), 0)), (SIDE, SIDE))
    left = truth.mask & (np.arange(SIDE) <= x)
    right = truth.mask & ~left
    # Both parts need the same white: the brightest pixel lends its brightness to the other part.
    other = np.argwhere(right)[0]
    lit = truth.specular.copy()
    lit[tuple(other)] = lit[y, x]
    truth = replace(truth, specular=lit)
    a, b = (differences(replace(truth, mask=half), estimate) for half in (left, right))
    for key, whole in differences(truth, estimate).items():
        both = a[key] + b[key]
        assert both.count == whole.count
        assert (both.mean, both.std) == pytest.approx((whole.mean, whole.std), rel=1e-9), key


def test_noise_is_what_a_perfect_method_scores() -> None:
    truth, estimate = made_up()
    noisy_values = METRICS["delta_e76"](truth)(estimate.stokes[truth.mask])
    values = {v.metric: v for v in noisy_values if v.angle_deg is None}
    assert 0 < values["delta_e76"].noise < values["delta_e76"].value
    still = replace(truth, specular_noise=0 * truth.specular_noise)
    quiet_values = METRICS["delta_e76"](still)(estimate.stokes[truth.mask])
    quiet = {v.metric: v for v in quiet_values if v.angle_deg is None}
    assert quiet["delta_e76"].noise < 1e-6
    assert quiet["delta_e76"].value == pytest.approx(values["delta_e76"].value)


@pytest.mark.parametrize("bands", [(1000.0, 1100.0), (200.0,), (660.0,), (650.0, 700.0, 800.0)])
def test_bands_that_no_white_can_be_made_of_are_refused(bands: tuple[float, ...]) -> None:
    """Beyond 649 nm the table of CIE 1931 has no Z: a ratio to that of white would be 0/0."""
    with pytest.raises(InputError, match="from 360 to 649 nm"):
        band_weights(bands)
    assert np.isfinite(
        lab(np.ones(len(bands) + 1), band_weights(tuple(sorted((649.0, *bands)))))
    ).all()
