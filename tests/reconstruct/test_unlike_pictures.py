"""Folders whose files do not belong together: hidden ones, turned ones, other units of light."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.capture_fit import fit_capture
from malus.scenes import InputError
from malus.scenes.polarisation import analyser

ANGLES = (0.0, 45.0, 90.0, 135.0)
STOKES = np.array([0.8, 0.2, -0.1])


def codes(angle: float, white: int = 65535) -> np.ndarray:
    light = float((analyser([angle]) @ STOKES)[0])
    return np.full((8, 8), round(white * light), np.uint16)


def write(folder: Path, **tags: object) -> None:
    for angle in ANGLES:
        tifffile.imwrite(folder / f"pol_{angle:03.0f}.tif", codes(angle), **tags)


def turned_to(orientation: int) -> dict[str, object]:
    return {"extratags": [(274, 3, 1, orientation, True)]}


def test_hidden_files_are_no_pictures(tmp_path: Path) -> None:
    """macOS leaves one beside every picture on disks of other systems: two sets were found."""
    (tmp_path / "dark").mkdir()
    tifffile.imwrite(tmp_path / "dark" / "1.tif", np.full((8, 8), 100, np.uint16))
    write(tmp_path)
    for path in [*tmp_path.glob("*.tif"), tmp_path / "dark" / "1.tif"]:
        (path.parent / f"._{path.name}").write_bytes(b"\0\5\x16\7of a system")
    for angles in (None, ANGLES):
        capture = read_capture(tmp_path, linear=True, angles=angles, black=tmp_path / "dark")
        stokes = fit_capture(capture).stokes[0, 0, 0]
        # Codes are rounded by 1/131070; 100 of them are dark, of which s0 has twice as many.
        np.testing.assert_allclose(stokes, STOKES - [200 / 65535, 0, 0], atol=3e-5)


def test_pictures_are_turned_alike(tmp_path: Path) -> None:
    """Of a square picture that a camera says to turn, other pixels were fitted together."""
    write(tmp_path, **turned_to(3))
    assert fit_capture(read_capture(tmp_path, linear=True)).relative_residual < 1e-4
    tifffile.imwrite(tmp_path / "pol_090.tif", codes(90.0))
    with pytest.raises(InputError, match=r"pol_090.tif: expected pictures that are all turned, or"):
        read_capture(tmp_path, linear=True)
    write(tmp_path)
    tifffile.imwrite(tmp_path / "pol_135.tif", codes(135.0), **turned_to(6))
    with pytest.raises(InputError, match=r"pol_135.tif: .* found turned by an orientation tag"):
        read_capture(tmp_path, linear=True)


@pytest.mark.parametrize("is_float_first", [False, True])
def test_floats_and_whole_numbers_have_no_common_unit(tmp_path: Path, is_float_first: bool) -> None:
    write(tmp_path)
    name = "pol_000.tif" if is_float_first else "pol_135.tif"
    tifffile.imwrite(tmp_path / name, codes(0.0).astype(np.float32))
    words = "expected floats, as the first" if is_float_first else "expected whole numbers"
    with pytest.raises(InputError, match=words):
        read_capture(tmp_path, linear=True)


def test_a_dark_frame_is_in_the_unit_of_its_pictures(tmp_path: Path) -> None:
    """Of floats, 100 codes were 100 times white; codes beside floats were next to nothing."""
    (tmp_path / "a").mkdir()
    write(tmp_path / "a")
    dark = np.full((8, 8), 100, np.uint16)
    tifffile.imwrite(tmp_path / "codes.tif", dark)
    tifffile.imwrite(tmp_path / "mean.tif", dark.astype(np.float32))
    tifffile.imwrite(tmp_path / "share.tif", (dark / 65535).astype(np.float32))
    with pytest.raises(InputError, match=r"mean.tif: expected floats up to 1, .* found 100; write"):
        read_capture(tmp_path / "a", linear=True, black=tmp_path / "mean.tif")
    of_codes, of_shares = (
        read_capture(tmp_path / "a", linear=True, black=tmp_path / f"{name}.tif").pictures
        for name in ("codes", "share")
    )
    np.testing.assert_allclose(of_codes, of_shares, atol=1e-7)
    np.save(tmp_path / "stack.npy", np.stack([codes(a).astype(np.float32) for a in ANGLES]))
    told = {"angles": ANGLES, "black": tmp_path / "mean.tif"}
    stokes = fit_capture(read_capture(tmp_path / "stack.npy", **told)).stokes[0, 0, 0]
    np.testing.assert_allclose(stokes / 65535, STOKES - [200 / 65535, 0, 0], atol=3e-5)
    with pytest.raises(InputError, match=r"codes.tif: expected floats, as the pictures"):
        read_capture(tmp_path / "stack.npy", **told | {"black": tmp_path / "codes.tif"})
