"""An index with one number a band is, in every band, what that number is for all bands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rooms import needs_arrays
from suite_texts import GOOD

import malus
from malus.scenes import InputError, load_suite

BANDS = (450.0, 550.0, 650.0)
ETAS, KS = (1.7, 1.5, 1.4), (3.0, 2.0, 1.0)
DESK = malus.Placed(
    shape=malus.Plane(),
    surface=malus.Dielectric(eta=ETAS, alpha=0.2),
    position=(0, -1, 0),
    scale=6,
)


def scene(surface: Any, bands: tuple[float, ...] = BANDS, **options: Any) -> malus.Scene:
    light, camera = malus.Distant(incidence_deg=50), malus.Camera(resolution=16)
    given = {"shape": malus.Sphere(), "light": light, "camera": camera, **options}
    return malus.Scene(surface=surface, wavelengths_nm=bands, **given)


@pytest.mark.parametrize("renderer", ["mitsuba", "torrance-sparrow"])
def test_each_band_of_a_dielectric_is_that_of_its_own_number(renderer: Any) -> None:
    body = "polarised" if renderer == "mitsuba" else "unpolarised"
    both = malus.render(scene(malus.Dielectric(eta=ETAS, alpha=0.3, body=body)), renderer=renderer)
    assert both.eta.tolist() == list(ETAS)
    for band, eta in enumerate(ETAS):
        flat = scene(malus.Dielectric(eta=eta, alpha=0.3, body=body))
        one = malus.render(flat, renderer=renderer)
        # Mitsuba's are interpolated in the index: 1e-5 of the peak and less.
        peak = float(one.image.max())
        np.testing.assert_allclose(
            both.stokes[:, :, band], one.stokes[:, :, band], atol=2e-5 * peak
        )


def test_each_band_of_a_metal_is_that_of_its_own_number() -> None:
    both = malus.render(scene(malus.Conductor(eta=ETAS, k=KS, alpha=0.3)))
    assert both.eta.tolist() == [complex(*pair) for pair in zip(ETAS, KS, strict=True)]
    for band, (eta, k) in enumerate(zip(ETAS, KS, strict=True)):
        one = malus.render(scene(malus.Conductor(eta=eta, k=k, alpha=0.3)))
        np.testing.assert_allclose(both.stokes[:, :, band], one.stokes[:, :, band], rtol=1e-5)


@needs_arrays
def test_among_objects_each_band_has_its_own_number() -> None:
    """In rooms, too, whose surfaces take their indices band by band: bands of other indices."""
    rooms = [
        malus.Surroundings(name="desk", objects=(DESK.model_copy(update={"surface": surface}),))
        for surface in (DESK.surface, *(malus.Dielectric(eta=eta, alpha=0.2) for eta in ETAS))
    ]
    balls = [malus.Dielectric(eta=eta, alpha=0.2) for eta in (ETAS, *ETAS)]
    both, *single = (
        malus.render(scene(ball, surroundings=room), malus.Sampling(samples=4))
        for ball, room in zip(balls, rooms, strict=True)
    )
    for band, one in enumerate(single):
        np.testing.assert_array_equal(both.stokes[:, :, band], one.stokes[:, :, band])


@pytest.mark.parametrize(
    "surface",
    [
        lambda: malus.Dielectric(eta=ETAS, alpha=0.3),
        lambda: malus.Conductor(eta=1.5, k=KS, alpha=0.3),
    ],
)
def test_as_many_numbers_as_bands_are_wanted(surface: Any) -> None:
    assert scene(surface()).eta.shape == (3,)
    with pytest.raises(InputError, match="expected one number a band, 2, found 3"):
        scene(surface(), BANDS[:2])


def test_a_suite_takes_them_and_refuses_others(tmp_path: Path) -> None:
    file = tmp_path / "curve.toml"
    file.write_text(
        GOOD.replace('["water"]', "[{ eta = [1.52, 1.51] }, { eta = 1.5, k = [3, 2] }]")
    )
    labels = {one.surface.material_label for one in load_suite(str(file)).scenes()}
    assert labels == {"eta 1.52, 1.51", "eta 1.5 + 3, 2i"}
    for wrong in ("[1.52]", "[1.52, 0.9]", "[]", '"pmma"'):
        file.write_text(GOOD.replace('["water"]', f"[{{ eta = {wrong} }}]"))
        with pytest.raises(InputError, match="eta"):
            load_suite(str(file))


def test_curves_of_many_bands_with_equal_ends_have_different_names() -> None:
    ends, bands = (1.6, 1.5), np.linspace(0, 1, 8)
    curves = [tuple(ends[0] + (ends[1] - ends[0]) * bands**power) for power in (1, 2)]
    labels = {malus.Dielectric(eta=curve, alpha=0.3).material_label for curve in curves}
    assert len(labels) == 2
    assert all(label.startswith("eta 1.6 to 1.5 (") for label in labels)


def test_ids_of_scenes_with_one_number_stay() -> None:
    """Worked out before an index could be a list."""
    assert scene(malus.Dielectric(eta=1.5, alpha=0.3)).id == "3f64356538b8df1c"
    assert scene(malus.Conductor(eta=0.2, k=3, alpha=0.3)).id == "89ba18220f536743"
