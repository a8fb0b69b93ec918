"""What the viewer is given: small enough, rounded by little, and refused where it is none."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from viewed_scenes import disc, stokes_image

from malus.reports.viewer.error_maps import _pictures, error_maps, gallery
from malus.reports.viewer.examples import Example, read_example
from malus.reports.viewer.pack import NOT_FINITE, Packer, Shown, fitted, quantised
from malus.scenes.colour import preview
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError


def test_error_maps_keep_to_the_budget_and_skip_what_no_eye_sees() -> None:
    short = gallery([example(8, 2)] * 3, budget=6000)
    assert short is not None
    assert "further scene" in short
    assert gallery([replace(example(8, 1), wavelengths_nm=(1550.0,))]) is None


@pytest.mark.parametrize(
    "values",
    [
        [0.0, 1.0], [-3.0, 0.0, 5.0], [7.0, 7.0], [0.0, 0.0], [-2.0],
        np.random.default_rng(8).normal(size=100).tolist(),
    ],
)  # fmt: skip
def test_storing_rounds_by_half_a_step_at_most_and_keeps_zero(values: list[float]) -> None:
    q, first, step = quantised(np.array(values))
    back = step * (first + q.astype(float))
    span = float(np.ptp(values)) / 65533
    np.testing.assert_allclose(back, values, rtol=0, atol=0.5 * span + 1e-15)
    assert all(stored == 0.0 for stored, value in zip(back, values, strict=True) if value == 0.0)
    assert quantised(np.array([np.inf, np.nan]))[0].tolist() == [NOT_FINITE] * 2


def example(size: int, bands: int) -> Example:
    truth, estimate = np.random.default_rng(7).random((2, size, size, bands, 3), np.float32)
    wavelengths = tuple(np.linspace(400.0, 700.0, bands))
    mask = np.ones((size, size), bool)
    mask[0] = False
    return Example("0", "a", wavelengths, mask, truth, {"eq8": estimate})


def test_a_scene_that_is_too_large_costs_no_other_its_place() -> None:
    """Where pictures are drawn in several sizes, one took the room of all that came after it."""
    small, large = example(16, 1), example(64, 1)
    size = fitted([small])[0][0].size
    kept, left_out = fitted([small, large, small, small], budget=2 * size)
    assert [shown.example is small for shown in kept] == [True, True]
    assert left_out == 2


def test_a_large_run_keeps_its_colours_and_counts_what_it_leaves_out() -> None:
    """Surroundings go first, then single bands, then scenes."""
    ways = []
    scene = example(64, 8)
    bands_of_ten = 10 * 64 * 63 * 2 * 3 * 2 * 4 // 3  # truth and one method, 16 bits in base64
    for budget in (9 * bands_of_ten, 8 * bands_of_ten, 7 * bands_of_ten, 3 * bands_of_ten):
        kept, left_out = fitted([scene] * 10, budget)
        assert sum(one.size for one in kept) <= budget
        ways.append((len(kept[0].bands), kept[0].with_surroundings, left_out))
        packer = Packer()
        packer.scene(kept[0], {})
        # The masks are a bit a pixel; base64 fills up to four characters a block.
        assert sum(map(len, packer.blocks)) == pytest.approx(kept[0].size, rel=0.02)
    assert ways == [(8, True, 0), (8, False, 0), (3, True, 0), (1, True, 3)]


def test_colour_is_of_all_bands_also_where_few_are_shown() -> None:
    """What is packed as red, green and blue is what the page makes of all bands."""
    scene = example(8, 8)
    (every,), _ = fitted([scene])
    (few,), _ = fitted([scene], budget=0.7 * every.size)
    assert (every.with_colour, few.with_colour) == (False, True)
    wanted, found = (_packed_colour(one) for one in (every, few))
    # Each of eight planes is rounded by half of 1/65533 of a range of 1, and weights are up to 0.5.
    np.testing.assert_allclose(found, wanted, atol=4e-5)
    np.testing.assert_allclose(
        found[..., 0], preview(scene.truth[..., 0], scene.wavelengths_nm)[scene.mask], atol=4e-5
    )
    assert np.ptp(found[..., 0], axis=-1).max() > 0.2  # the test sees colours


def test_only_light_that_is_known_is_shown_beside_the_object() -> None:
    scene = example(8, 3)
    scene.truth[0, :3] = 0
    scene.truth[0, 3, 1, 2] = np.nan
    wanted = ~scene.mask
    wanted[0, :4] = False
    np.testing.assert_array_equal(scene.beyond, wanted)


def _packed_colour(shown: Shown) -> Float64Array:
    """Stokes vectors (pixels, channels, 3) of the truth as the page has them."""
    packer = Packer()
    scene = packer.scene(shown, {})
    planes = []
    for plane in scene["truth"]:
        q = np.frombuffer(base64.b64decode(packer.blocks[plane["block"]]), "<u2").reshape(3, -1)
        planes.append((q + np.array(plane["first"])[:, None]) * np.array(plane["step"])[:, None])
    return np.einsum("ck,ksp->pcs", scene["colours"], planes)


@pytest.mark.parametrize("spoil", ["not an archive", "no truth", "wrong shape", "no json"])
def test_a_bad_example_is_named_in_one_line(tmp_path: Path, spoil: str) -> None:
    path = tmp_path / "bad.npz"
    writers: dict[str, Callable[[], object]] = {
        "not an archive": lambda: path.write_text("hello"),
        "no truth": lambda: np.savez(path, mask=disc()),
        "wrong shape": lambda: np.savez(
            path, truth=np.zeros((2, 2, 1, 3)), mask=disc(),
            meta=np.array('{"scene": "a", "label": "b", "wavelengths_nm": [5]}'),
        ),
        "no json": lambda: np.savez(
            path, truth=stokes_image(1), mask=disc(), meta=np.array("hello")
        ),
    }  # fmt: skip
    writers[spoil]()
    with pytest.raises(InputError, match=r"bad\.npz: expected truth and methods"):
        read_example(path)


def test_light_beside_the_object_changes_no_error_map() -> None:
    """White is the brightest pixel of the object, as of the metric."""
    plain = example(8, 3)
    lamp = plain.truth.copy()
    lamp[~plain.mask] = (100.0, 0.0, 0.0)
    assert (~plain.mask).any()
    for dark, lit in zip(error_maps(plain), error_maps(replace(plain, truth=lamp)), strict=True):
        np.testing.assert_array_equal(dark.difference, lit.difference)


def test_photographs_of_captures_have_the_names_of_what_they_show() -> None:
    """Half of the light is polarised, from upper right to lower left: ϑ of 45° stops it."""
    stokes = np.float32([1.0, 0.0, 0.5]) * np.ones((4, 4, 3, 1), np.float32)
    shown = {
        cell["image"]: PIL.Image.open(
            io.BytesIO(base64.b64decode(cell["src"].partition(",")[2]))
        ).getpixel((0, 0))[0]
        for cell in _pictures("captured", stokes)
    }
    codes = {
        name: 255 * (1.055 * light ** (1 / 2.4) - 0.055)  # IEC 61966-2-1
        for name, light in {"I_max": 0.75, "I_min": 0.25, "I(0°)": 0.5, "I(45°)": 0.25}.items()
    }
    for name, code in codes.items():
        assert shown[name] == pytest.approx(code, abs=2)  # of an even JPEG
