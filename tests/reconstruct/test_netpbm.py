"""PPM, PGM and PFM, from bytes that are written here after their specifications."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.capture_fit import fit_capture
from malus.reconstruct.photos.masks_and_normals import read_normals
from malus.reconstruct.photos.read_picture import read_picture
from malus.reconstruct.photos.write_picture import write_picture
from malus.scenes.core.errors import InputError

RNG = np.random.default_rng(20260)
HEIGHT, WIDTH = 5, 7


def _netpbm(codes: np.ndarray, largest: int, comment: bytes = b"") -> bytes:
    """Binary Netpbm: of two bytes the high one first, as ppm(5) says."""
    kind = b"P6" if codes.ndim == 3 else b"P5"
    body = bytearray()
    for code in codes.ravel().tolist():
        body += bytes([code]) if largest < 256 else bytes([code >> 8, code & 255])
    return kind + b"\n" + comment + b"%d %d\n%d\n" % (WIDTH, HEIGHT, largest) + bytes(body)


@pytest.mark.parametrize("largest", [1, 100, 255, 256, 1000, 4095, 65535])
@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)])
def test_codes_are_shares_of_the_largest_one(
    tmp_path: Path, largest: int, shape: tuple[int, ...]
) -> None:
    """And go out as they came in: each has its own light in both senses."""
    codes = RNG.integers(0, largest + 1, shape)
    codes.ravel()[-1] = 10 % (largest + 1)  # ends with the code of a new line
    path = tmp_path / "a.ppm"
    path.write_bytes(_netpbm(codes, largest, b"# made up\n"))
    planes = codes.reshape(HEIGHT, WIDTH, -1)
    linear = read_picture(path, linear=True)
    np.testing.assert_allclose(linear.linear, planes / largest, rtol=1e-6)  # float32
    coded = read_picture(path)
    # float32, and constants of the standard that are rounded to 5 digits.
    np.testing.assert_allclose(coded.linear, _light_of_srgb(planes / largest), rtol=1e-4, atol=1e-7)
    for picture in (linear, coded):
        write_picture(tmp_path / "b.ppm", picture)
        assert (tmp_path / "b.ppm").read_bytes() == _netpbm(codes, largest)


def _light_of_srgb(shares: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1."""
    return np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)


def test_text_says_the_same(tmp_path: Path) -> None:
    codes = RNG.integers(0, 1024, (HEIGHT, WIDTH, 3))
    numbers = "\n# between\n".join(" ".join(map(str, row.ravel())) for row in codes)
    text = f"P3 # colour\n{WIDTH}\n# between\n{HEIGHT} 1023\n{numbers}\n"
    (tmp_path / "a.ppm").write_text(text)
    light = read_picture(tmp_path / "a.ppm", linear=True).linear
    np.testing.assert_allclose(light, codes / 1023, rtol=1e-6)  # float32


WHOLE = _netpbm(np.full((HEIGHT, WIDTH), 4000), 4095)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (WHOLE.replace(b"4095", b"3999"), "expected codes of at most 3999, found 4000"),
        (WHOLE[:-1], "expected 70 codes or bytes of them behind the header, found 69"),
        (2 * WHOLE, f"expected one picture, found {len(WHOLE)} bytes behind it"),
        (WHOLE.replace(b"4095", b"70000"), "expected a largest code of 1 to 65535, found 70000"),
        (b"P2 2 1 9 3 -4", "expected whole numbers from 0"),
        (b"P2 2 1 9 3 4.5", "expected whole numbers from 0"),
        (b"P2 2 1 9 3", "expected 2 codes or bytes of them behind the header, found 1"),
        (b"P5\n0 7\n255\n", "expected a pixel or more a side"),
    ],
)
def test_other_codes_are_refused(tmp_path: Path, content: bytes, told: str) -> None:
    (tmp_path / "a.pgm").write_bytes(content)
    with pytest.raises(InputError, match=re.escape(told)):
        read_picture(tmp_path / "a.pgm")


def test_levels_of_a_camera_count_in_the_codes_of_its_frame(tmp_path: Path) -> None:
    """A dark level of 240 of 4095 is that also where the file does not go up to 65535.

    Taken for 240 of 65535, light of DoLP 0.5 had one of 0.44.
    """
    y, x = np.mgrid[:24, :24]
    angle = np.radians(np.array([[90, 45], [135, 0]])[y % 2, x % 2])
    light = 1 + 0.5 * np.cos(2 * (angle - np.radians(20)))
    codes = np.rint(240 + 1200 * light).astype(">u2")
    (tmp_path / "frame.pgm").write_bytes(b"P5 24 24 4095\n" + codes.tobytes())
    capture = read_capture(tmp_path / "frame.pgm", mosaic=(90, 45, 135, 0), black=240)
    inner = fit_capture(capture).components.dolp[4:-4, 4:-4]
    np.testing.assert_allclose(inner, 0.5, atol=2e-3)  # a code is 1/1200 of the light


@pytest.mark.parametrize(("scale", "order"), [(b"-1.0", "<f4"), (b"1", ">f4")])
@pytest.mark.parametrize("channels", [1, 3])
def test_floats_have_the_bottom_row_first(
    tmp_path: Path, scale: bytes, order: str, channels: int
) -> None:
    light = RNG.uniform(0, 9, (HEIGHT, WIDTH, channels)).astype(np.float32)
    header = (b"PF" if channels == 3 else b"Pf") + b"\n%d %d\n%s\n" % (WIDTH, HEIGHT, scale)
    rows = b"".join(row.astype(order).tobytes() for row in reversed(light))
    (tmp_path / "a.pfm").write_bytes(header + rows)
    picture = read_picture(tmp_path / "a.pfm")
    np.testing.assert_array_equal(picture.linear, light)
    assert picture.full_scale == np.inf
    write_picture(tmp_path / "b.pfm", picture)
    np.testing.assert_array_equal(read_picture(tmp_path / "b.pfm").linear, light)


def _pfm(values: np.ndarray) -> bytes:
    height, width = values.shape[:2]
    kind = b"PF" if values.ndim == 3 else b"Pf"
    return kind + b"\n%d %d\n-1\n" % (width, height) + values[::-1].astype("<f4").tobytes()


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (_pfm(np.ones((2, 2))).replace(b"-1", b"-0.00392157"), "expected a scale of 1 or -1"),
        (_pfm(np.ones((2, 2))) + b"!", "expected 16 bytes of values, found 17"),
        (_pfm(np.full((2, 2), np.inf)), "expected finite values, found 4 others"),
        (b"P5\n2 2\n255\n1234", "expected a file that begins with PF or Pf"),
    ],
)
def test_other_floats_are_refused(tmp_path: Path, content: bytes, told: str) -> None:
    (tmp_path / "a.pfm").write_bytes(content)
    with pytest.raises(InputError, match=re.escape(told)):
        read_picture(tmp_path / "a.pfm")


def test_normals_of_floats_are_vectors(tmp_path: Path) -> None:
    vectors = RNG.normal(size=(HEIGHT, WIDTH, 3))
    vectors[..., 2] = np.abs(vectors[..., 2])
    vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
    (tmp_path / "n.pfm").write_bytes(_pfm(vectors))
    read = read_normals(tmp_path / "n.pfm", (HEIGHT, WIDTH))
    np.testing.assert_allclose(read, vectors, atol=1e-6)  # float32
    (tmp_path / "n.pfm").write_bytes(_pfm((vectors + 1) / 2))
    with pytest.raises(InputError, match=re.escape("as of (n + 1)/2")):
        read_normals(tmp_path / "n.pfm", (HEIGHT, WIDTH))
