"""Radiance pictures, .hdr: read wherever pictures are, against an encoder written for the test."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from click.testing import CliRunner

from malus.bench.commands.filter import filter_command
from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.capture_fit import fit_capture
from malus.reconstruct.photos.masks_and_normals import read_mask
from malus.reconstruct.photos.read_picture import read_picture
from malus.scenes import InputError, polarisation

STEP = 1 / 128
"""Of the brightest channel: its mantissa has 8 bits, of which the first is set, and is cut off."""


def write_rgbe(path: Path, light: np.ndarray, *lines: str) -> Path:
    """Ward's format without run lengths: mantissas of 8 bits below a common power of 2."""
    brightest = light.max(axis=-1)
    exponent = np.where(brightest > 0, np.floor(np.log2(np.maximum(brightest, 1e-30))) + 1, -128)
    mantissas = np.floor(light * (256 / 2.0**exponent)[..., None])
    mantissas[brightest == 0] = 0
    values = np.concatenate([mantissas, (exponent + 128)[..., None]], axis=-1).astype(np.uint8)
    height, width = light.shape[:2]
    head = ["#?RADIANCE", *lines, "FORMAT=32-bit_rle_rgbe", "", f"-Y {height} +X {width}", ""]
    path.write_bytes("\n".join(head).encode() + values.tobytes())
    return path


def light_of(shape: tuple[int, int] = (9, 7)) -> np.ndarray:
    light = np.exp(3 * np.random.default_rng(0).normal(size=(*shape, 3)))
    light[0, 0] = 0
    return light


@pytest.mark.parametrize("shape", [(9, 7), (1, 1), (1, 40), (5, 300)])
def test_a_radiance_picture_has_the_light_that_was_written(
    tmp_path: Path, shape: tuple[int, int]
) -> None:
    light = light_of(shape)
    picture = read_picture(write_rgbe(tmp_path / "a.hdr", light))
    assert picture.assumption == "values are linear light"
    off = np.abs(picture.linear - light) / np.maximum(light.max(axis=-1, keepdims=True), 1e-30)
    assert off.max() <= STEP


def test_it_is_filtered_to_an_exr(tmp_path: Path) -> None:
    path = write_rgbe(tmp_path / "a.HDR", light_of())
    options = [str(path), "--method", "unpolarised", "--angle", "0", "--out", str(tmp_path / "o")]
    result = CliRunner().invoke(filter_command, options, catch_exceptions=False)
    assert "a Radiance picture is written as an OpenEXR" in result.output
    with OpenEXR.File(str(tmp_path / "o" / "a_angle000.exr")) as file:
        written = np.asarray(file.channels()["RGB"].pixels)
    np.testing.assert_array_equal(written, read_picture(path).linear)


def test_captures_and_masks_of_radiance(tmp_path: Path) -> None:
    stokes = np.array([1.0, 0.3, -0.2])
    (tmp_path / "pot").mkdir()
    for angle in (0, 45, 90, 135):
        light = np.full((6, 8, 3), 50 * polarisation.polarised(stokes, angle))
        write_rgbe(tmp_path / "pot" / f"pol_{angle:03d}.hdr", light)
    found = fit_capture(read_capture(tmp_path / "pot")).stokes / 50
    np.testing.assert_allclose(found, np.broadcast_to(stokes, found.shape), atol=2 * STEP)
    mask = np.indices((6, 8))[1] > 2
    path = write_rgbe(tmp_path / "m.hdr", np.repeat(mask[..., None], 3, axis=-1).astype(float))
    np.testing.assert_array_equal(read_mask(path, (6, 8)), mask)


def test_numbers_that_are_no_radiance_are_refused(tmp_path: Path) -> None:
    path = write_rgbe(tmp_path / "a.hdr", light_of(), "EXPOSURE=2")
    with pytest.raises(InputError, match="RGB without EXPOSURE or COLORCORR, found EXPOSURE=2"):
        read_picture(path)
    path.write_bytes(path.read_bytes()[:90])
    with pytest.raises(InputError, match=r"a\.hdr: expected"):
        read_picture(path)
