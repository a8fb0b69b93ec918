"""Raw files of cameras: developed in proportion to light, or refused with what to install."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from malus.reconstruct.photos import read_camera_raw as reader
from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.capture_fit import fit_capture
from malus.reconstruct.photos.read_picture import read_picture
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import aolp, dolp

BLACK, WHITE = 64, 4095
RATIO = np.array([0.2, 0.4, 0.6])


def needs_rawpy() -> None:
    pytest.importorskip("rawpy", reason="develops raw files")


def fractions(values: AnyArray) -> tuple[int, ...]:
    return tuple(part for value in np.ravel(values) for part in (round(value * 10_000), 10_000))


def dng(path: Path, light: AnyArray, balance: tuple[float, ...] = (0.5, 1.0, 0.7)) -> Path:
    """A DNG of light (height, width, 3): a mosaic of red, green, green, blue of 12 bits."""
    y, x = np.mgrid[: light.shape[0], : light.shape[1]]
    channel = np.array([[0, 1], [1, 2]])[y % 2, x % 2]
    codes = np.rint(BLACK + (WHITE - BLACK) * light[y, x, channel]).astype(np.uint16)
    tags = [
        (50706, 1, 4, bytes([1, 4, 0, 0]), True),  # version
        (50708, 2, 0, "malus made this up", True),  # camera
        (33421, 3, 2, (2, 2), True),  # mosaic
        (33422, 1, 4, bytes([0, 1, 1, 2]), True),
        (50714, 4, 1, BLACK, True),
        (50717, 4, 1, WHITE, True),
        (50721, 10, 9, fractions(np.eye(3)), True),  # from XYZ to the camera's colours
        (50778, 3, 1, 21, True),  # under D65
        (50728, 5, 3, fractions(np.array(balance)), True),  # white balance of the shot
    ]
    tifffile.imwrite(path, codes, photometric=32803, extratags=tags, metadata=None)
    return path


def flat(level: float) -> AnyArray:
    return np.broadcast_to(level * RATIO, (32, 48, 3))


def test_values_are_in_proportion_to_light(tmp_path: Path) -> None:
    needs_rawpy()
    # A picture whose brightest pixel is between 3/4 and all of the range would set a white level
    # of its own, and the balance of a shot would scale its colours.
    pictures = [
        read_picture(dng(tmp_path / f"{level}.dng", flat(level), balance)).linear
        for level, balance in ((1.4, (0.5, 1.0, 0.7)), (0.35, (0.9, 1.0, 0.4)))
    ]
    assert pictures[0].shape == (32, 48, 3)
    inner = (slice(4, -4), slice(4, -4))
    # Half a code of 12 bits, at 0.07 of the range: 0.2 %.
    np.testing.assert_allclose(pictures[1][inner] / pictures[0][inner], 0.25, rtol=0.004)


def test_it_goes_on_as_a_tiff_and_says_so(tmp_path: Path) -> None:
    needs_rawpy()
    picture = read_picture(dng(tmp_path / "a.dng", flat(1.0)))
    assert picture.suffix == ".tif"
    assert picture.assumption == "values are linear light"
    assert any("raw file" in note for note in picture.notes)


def test_a_capture_of_raw_files_is_the_polarisation_that_it_shows(tmp_path: Path) -> None:
    needs_rawpy()
    for angle in (0, 45, 90, 135):
        level = 0.5 * (1 + 0.3 * np.cos(2 * np.radians(angle - 20)))
        dng(tmp_path / f"shot_{angle:03d}.dng", flat(level))
    fit = fit_capture(read_capture(tmp_path, zero="horizontal"))
    inner = fit.stokes[4:-4, 4:-4]
    np.testing.assert_allclose(dolp(inner), 0.3, atol=0.003)  # codes of 12 bits
    np.testing.assert_allclose(np.degrees(aolp(inner)), 20, atol=0.3)


def test_without_the_package_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(reader.importlib, "import_module", missing)
    with pytest.raises(InputError, match="pip install rawpy, or develop it"):
        read_picture(dng(tmp_path / "a.dng", flat(1.0)))


def test_a_damaged_file_ends_in_one_line(tmp_path: Path) -> None:
    needs_rawpy()
    (tmp_path / "a.nef").write_bytes(np.random.default_rng(1).bytes(3000))
    with pytest.raises(InputError, match=r"a\.nef: expected a raw file that LibRaw reads"):
        read_picture(tmp_path / "a.nef")
