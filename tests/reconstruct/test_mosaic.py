"""Frames of polarisation cameras: interpolation, colours, packing, and a real frame."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import tifffile

from malus.reconstruct.photos import mosaic
from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.capture_fit import fit_capture
from malus.reconstruct.photos.mosaic import bilinear, demosaic, demosaic_bayer, demosaic_grey
from malus.reconstruct.photos.raw_frames import read_raw, unpack
from malus.scenes import InputError, polarisation

CASES = Path(__file__).parents[1] / "cases"
SONY = (90.0, 45.0, 135.0, 0.0)
"""Angles of the sensors IMX250MZR and MYR, from the horizontal."""
INNER = np.s_[..., 4:-4, 4:-4]


def edges(side: int = 96) -> np.ndarray:
    """Stokes image (side, side, 3) of a bright disc and a thin line, evenly polarised in parts."""
    y, x = np.mgrid[:side, :side].astype(float)
    disc = (x - side / 2) ** 2 + (y - side / 2) ** 2 < (side / 3) ** 2
    light = np.where(disc, 1.0, 0.2) * (1 + 0.1 * np.sin(x / 9))
    light[np.abs(x - 1.7 * y + 30) < 3] = 0.9
    degree, angle = 0.3 + 0.1 * np.sin(y / 15), 0.4 + x / 40
    s1, s2 = light * degree * np.cos(2 * angle), light * degree * np.sin(2 * angle)
    return np.stack([light, s1, s2], axis=-1)


def through(stokes: np.ndarray, angles: tuple[float, ...] = SONY) -> np.ndarray:
    """Pictures (4, height, width) through polarisers at angles from the horizontal."""
    return np.stack([polarisation.polarised(stokes, angle - 90.0) for angle in angles])


def frame_of(pictures: np.ndarray) -> np.ndarray:
    """What the sensor gives: of every 2 x 2 square one pixel of each picture."""
    frame = np.empty(pictures.shape[1:], dtype=np.float32)
    for index, picture in enumerate(pictures):
        row, column = divmod(index, 2)
        frame[row::2, column::2] = picture[row::2, column::2]
    return frame


def plain(frame: np.ndarray) -> np.ndarray:
    """Bilinear interpolation, as polanalyser does it: equal to its result but for the border."""
    pictures = []
    for index in range(4):
        row, column = divmod(index, 2)
        samples = np.zeros_like(frame)
        samples[row::2, column::2] = 1
        pictures.append(bilinear(frame * samples, samples))
    return np.stack(pictures)


def degree(pictures: np.ndarray) -> np.ndarray:
    i90, i45, i135, i0 = pictures
    return np.hypot(i0 - i90, i45 - i135) / (0.5 * pictures.sum(axis=0))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_edges_are_better_than_after_bilinear_interpolation(noise: float) -> None:
    """polanalyser 3.0.0 errs as `plain` does: by 0.0314 of light, 0.0613 of DoLP at 128 pixels."""
    pictures = through(edges())
    frame = frame_of(pictures)
    frame += noise * np.random.default_rng(0).standard_normal(frame.shape).astype(np.float32)
    ours, theirs = demosaic_grey(frame), plain(frame)
    light = [rms((p - pictures)[INNER]) for p in (ours, theirs)]
    assert light[0] < 0.45 * light[1]
    polarised = [rms((degree(p) - degree(pictures))[INNER]) for p in (ours, theirs)]
    assert polarised[0] < 0.7 * polarised[1]
    largest = [float(np.abs((degree(p) - degree(pictures))[INNER]).max()) for p in (ours, theirs)]
    assert largest[0] < largest[1]


def test_frames_are_worked_on_in_strips_that_leave_no_seam(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frame = frame_of(through(edges()))
    whole = demosaic_grey(frame)
    monkeypatch.setattr(mosaic, "_ROWS", 20)
    # Float32 sums of a running window begin elsewhere.
    np.testing.assert_allclose(demosaic_grey(frame), whole, atol=1e-5)


def test_measured_pixels_stay_as_they_are() -> None:
    frame = frame_of(through(edges()))
    np.testing.assert_allclose(frame_of(demosaic_grey(frame)), frame, atol=1e-6)


@pytest.mark.parametrize("shape", [(33, 40), (32, 41), (5, 5), (4, 4)])
def test_even_light_is_exact_to_the_border_in_frames_of_any_size(shape: tuple[int, int]) -> None:
    stokes = np.broadcast_to(np.array([1.0, 0.3, -0.2]), (*shape, 3))
    pictures = through(stokes)
    # Float32 of sums over a window.
    np.testing.assert_allclose(demosaic_grey(frame_of(pictures)), pictures, atol=2e-5)


@pytest.mark.parametrize("bayer", ["rggb", "bggr", "grbg", "gbrg"])
def test_colours_of_a_colour_camera(tmp_path: Path, bayer: str) -> None:
    colours = np.array([0.9, 0.5, 0.2])
    stokes = np.array([1.0, 0.25, 0.1])
    frame = np.empty((48, 64), dtype=np.float32)
    for row in range(4):
        for column in range(4):
            angle = SONY[2 * (row % 2) + column % 2] - 90.0
            colour = colours["rgb".index(bayer[2 * (row // 2) + column // 2])]
            frame[row::4, column::4] = colour * polarisation.polarised(stokes, angle)
    pictures = demosaic(frame, bayer)
    assert pictures.shape == (4, 48, 64, 3)
    expected = through(np.broadcast_to(stokes, (48, 64, 3)))[..., None] * colours
    # Float32 of sums over a window.
    np.testing.assert_allclose(pictures, expected, atol=2e-5)
    PIL.Image.fromarray((60000 * frame).round().astype(np.uint16)).save(tmp_path / "f.png")
    fit = fit_capture(read_capture(tmp_path / "f.png", mosaic=SONY, bayer=bayer))
    # Codes of 3000 and more, rounded.
    np.testing.assert_allclose(polarisation.dolp(fit.stokes), np.hypot(0.25, 0.1), atol=5e-4)


def test_gradients_of_bayers_mosaic_are_exact() -> None:
    """Malvar's weights leave nothing of a straight gradient that all colours share."""
    y, x = np.mgrid[:20, :24].astype(np.float32)
    ramp = 1 + 0.02 * x + 0.01 * y
    rgb = demosaic_bayer(ramp, "rggb")
    # Float32 of sums of twelve products.
    np.testing.assert_allclose(rgb[3:-3, 3:-3], np.repeat(ramp[..., None], 3, -1)[3:-3, 3:-3],
                               atol=1e-5)  # fmt: skip


@pytest.mark.parametrize("name", ["frame_mono8.png", "frame_mono16.png"])
def test_the_case_of_a_mosaic(name: str) -> None:
    capture = read_capture(CASES / "capture_mosaic" / name, mosaic=SONY)
    fit = fit_capture(capture)
    # Every square has a brightness of its own: single pixels are off where it jumps.
    stokes = np.median(fit.stokes, axis=(0, 1))[0]
    assert float(np.median(polarisation.dolp(fit.stokes))) == pytest.approx(0.3, abs=3e-3)
    assert float(np.degrees(polarisation.aolp(stokes))) == pytest.approx(20.0, abs=0.3)
    assert max(fit.shifts) == 0
    assert fit.warnings == ()
    plain_capture = plain(read_frame(name))
    ours = rms(polarisation.dolp(fit.stokes)[..., 0][INNER] - 0.3)
    assert ours < 0.6 * rms(degree(plain_capture)[INNER] - 0.3)


def read_frame(name: str) -> np.ndarray:
    return np.asarray(PIL.Image.open(CASES / "capture_mosaic" / name)).astype(np.float32)


def test_pictures_taken_out_of_a_frame_are_not_said_to_have_moved(tmp_path: Path) -> None:
    """Its sub-grids stand half a pixel apart; the warning tells what to do instead."""
    rng = np.random.default_rng(0)
    from scipy.ndimage import gaussian_filter

    light = 0.2 + gaussian_filter(rng.random((128, 128)), 2.0)
    frame = frame_of(through(light[..., None] * np.array([1.0, 0.1, 0.05])))
    for index, angle in enumerate(SONY):
        row, column = divmod(index, 2)
        tifffile.imwrite(tmp_path / f"I{angle:g}.tif", frame[row::2, column::2])
    warnings = " ".join(fit_capture(tmp_path).warnings)
    assert "half a pixel apart" in warnings
    assert "mosaic" in warnings
    assert "moved" not in warnings
    tifffile.imwrite(tmp_path / "frame.tif", frame)
    assert fit_capture(read_capture(tmp_path / "frame.tif", mosaic=SONY)).warnings == ()


def test_grey_that_was_saved_in_three_channels(tmp_path: Path) -> None:
    codes = (200 * frame_of(through(edges(16)))).astype(np.uint8)
    PIL.Image.fromarray(codes).save(tmp_path / "grey.png")
    PIL.Image.fromarray(np.repeat(codes[..., None], 3, -1)).save(tmp_path / "rgb.png")
    grey, rgb = (read_capture(tmp_path / f"{n}.png", mosaic=SONY) for n in ("grey", "rgb"))
    np.testing.assert_array_equal(grey.pictures, rgb.pictures)
    dark = (codes // 9).astype(np.uint8)  # as saved by the same program, or by another one
    PIL.Image.fromarray(dark).save(tmp_path / "dark_grey.png")
    PIL.Image.fromarray(np.repeat(dark[..., None], 3, -1)).save(tmp_path / "dark_rgb.png")
    less = [
        read_capture(tmp_path / f"{n}.png", mosaic=SONY, black=tmp_path / f"dark_{m}.png").pictures
        for n, m in (("grey", "grey"), ("rgb", "rgb"), ("rgb", "grey"), ("grey", "rgb"))
    ]
    # Every measured pixel is the frame's less the dark frame's.
    expected = (codes.astype(np.float32) - dark) / 255
    for number, picture in enumerate(less[0][..., 0]):
        own = np.s_[number // 2 :: 2, number % 2 :: 2]
        np.testing.assert_allclose(picture[own], expected[own], atol=1e-6)
    for other in less[1:]:
        np.testing.assert_array_equal(other, less[0])
    coloured = np.stack([codes, codes, codes // 2], axis=-1)
    PIL.Image.fromarray(coloured).save(tmp_path / "rgb.png")
    with pytest.raises(InputError, match="a grey frame, found 3 channels"):
        read_capture(tmp_path / "rgb.png", mosaic=SONY)


@pytest.mark.parametrize(("bayer", "reach"), [(None, 2), ("rggb", 6)])
def test_clipped_pixels_spoil_their_neighbours_too(
    tmp_path: Path, bayer: str | None, reach: int
) -> None:
    """A value comes from a sample beside it and its guide; its colour from two samples further."""
    frame = np.full((16, 16), 100, np.uint8)
    frame[6, 9] = 255
    PIL.Image.fromarray(frame).save(tmp_path / "f.png")
    capture = read_capture(tmp_path / "f.png", mosaic=SONY, bayer=bayer)
    assert capture.clipped.sum() == (2 * reach + 1) ** 2
    assert capture.clipped[6 - reach : 7 + reach, 9 - reach : 10 + reach].all()


def test_levels_of_a_frame(tmp_path: Path) -> None:
    frame = frame_of(through(np.broadcast_to(np.array([1.0, 0.3, 0.0]), (32, 32, 3))))
    codes = (400 + 3000 * frame).round().astype(np.uint16)
    PIL.Image.fromarray(codes).save(tmp_path / "f.png")
    PIL.Image.fromarray(np.full_like(codes, 400)).save(tmp_path / "dark.png")
    for black in (400, tmp_path / "dark.png"):
        capture = read_capture(tmp_path / "f.png", mosaic=SONY, black=black, white=4095)
        stokes = fit_capture(capture).stokes
        # Codes of 1000 and more, rounded.
        np.testing.assert_allclose(polarisation.dolp(stokes), 0.3, atol=1e-3)
        np.testing.assert_allclose(stokes[..., 0], 3000 / 3695, rtol=1e-3)


def packed(codes: np.ndarray, packing: str) -> bytes:
    """A slow, literal packer: a string of bits, or three bytes for two pixels."""
    bits = int(re.search(r"\d+", packing)[0])
    if packing.endswith("packed"):
        data = bytearray()
        flat = [int(code) for code in codes.ravel()]
        low = bits - 8
        for a, b in zip(flat[::2], flat[1::2], strict=True):
            data += bytes([a >> low, (a & (2**low - 1)) | (b & (2**low - 1)) << 4, b >> low])
        return bytes(data)
    if packing.endswith("p"):
        stream = "".join(f"{int(code):0{bits}b}"[::-1] for code in codes.ravel())
        stream += "0" * (-len(stream) % 8)
        return bytes(int(stream[i : i + 8][::-1], 2) for i in range(0, len(stream), 8))
    return codes.astype(np.uint8 if bits == 8 else "<u2").tobytes()


@pytest.mark.parametrize(
    "packing",
    ["mono8", "mono10", "mono12", "mono14", "mono16", "Mono10p", "Mono12p", "mono10packed",
     "Mono12Packed", "BayerRG12p", "PolarizeMono12Packed"],
)  # fmt: skip
def test_packed_frames(tmp_path: Path, packing: str) -> None:
    bits = int(re.search(r"\d+", packing)[0])
    codes = np.random.default_rng(0).integers(0, 1 << bits, (12, 16))
    (tmp_path / "f.raw").write_bytes(packed(codes, packing.lower()))
    picture = read_raw(tmp_path / "f.raw", (16, 12), packing)
    # The nearest float32 of a code over the largest.
    expected = codes / ((1 << bits) - 1)
    np.testing.assert_allclose(picture.linear[..., 0], expected, rtol=1e-6)
    bayer = "rggb" if "Bayer" in packing else None
    options = {"mosaic": SONY, "size": (16, 12), "packing": packing, "bayer": bayer}
    capture = read_capture(tmp_path / "f.raw", **options)
    assert capture.pictures.shape == (4, 12, 16, 3 if bayer else 1)
    if bayer:
        return
    assert capture.clipped.any() == (codes == codes.max()).any() * (codes.max() == 2**bits - 1)


def test_a_frame_without_a_header_needs_its_size(tmp_path: Path) -> None:
    for name in ("frame.raw", "frame"):
        (tmp_path / name).write_bytes(bytes(range(1, 65)))
        with pytest.raises(InputError, match=r"frame(\.raw)?: expected .*`size`, `packing`"):
            read_capture(tmp_path / name, mosaic=(90, 45, 135, 0))
        whole = {"size": (8, 8), "packing": "mono8", "mosaic": (90, 45, 135, 0)}
        assert read_capture(tmp_path / name, **whole).pictures.shape[1:3] == (8, 8)


def test_a_wrong_packing_is_doubted(tmp_path: Path) -> None:
    y, x = np.mgrid[:64, :64] / 64
    frame = frame_of(through((0.3 + 0.5 * x * y)[..., None] * np.array([1, 0.23, 0.19])))
    (tmp_path / "f.raw").write_bytes(packed((4095 * frame).astype(int), "mono12p"))
    options = {"mosaic": SONY, "size": (64, 64)}
    good = fit_capture(read_capture(tmp_path / "f.raw", packing="mono12p", **options))
    assert good.warnings == ()
    bad = fit_capture(read_capture(tmp_path / "f.raw", packing="mono12packed", **options))
    assert any("`packing`" in warning for warning in bad.warnings)


def test_unpacking_drops_the_bits_that_fill_the_last_byte() -> None:
    codes = np.array([1, 2, 3])
    data = np.frombuffer(packed(codes, "mono10p"), np.uint8)
    assert unpack(data, 10, "p")[:3].tolist() == codes.tolist()


@pytest.mark.parametrize(
    ("length", "size", "packing", "words"),
    [
        (100, (8, 8), "mono12p", "expected 96 bytes: 8 x 8 pixels of mono12p, found 100 bytes"),
        (64, (8, 8), "mono9", "packing: expected one of mono8"),
        (64, (8, 8), "mono16p", "packing: expected one of mono8"),
        (0, (0, 8), "mono8", "a pixel or more a side"),
        (0, (10_000, 10_000), "mono8", "megapixels"),
        (128, (8, 8), "mono10", "codes of 10 bits, found"),
    ],
)
def test_frames_that_do_not_fit_are_refused(
    tmp_path: Path, length: int, size: tuple[int, int], packing: str, words: str
) -> None:
    (tmp_path / "f.raw").write_bytes(b"\xff" * length)
    with pytest.raises(InputError, match=re.escape(words)):
        read_raw(tmp_path / "f.raw", size, packing)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mosaic": (0, 45, 90)}, "the four angles of a 2 x 2 square"),
        ({"mosaic": (0, 90, 0, 90)}, "three or more angles"),
        ({"mosaic": SONY, "bayer": "rgbg"}, "bayer: expected one of rggb"),
    ],
)
def test_mosaics_that_are_none_are_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_capture(CASES / "capture_mosaic/frame_mono8.png", **options)


def test_a_real_frame(shared: Path) -> None:
    """Along the dark rim of the apple light is reflected: polarised along the rim, not across."""
    capture = read_capture(shared / "captures/fruits/frame.png", mosaic=SONY)
    fit = fit_capture(capture)
    assert fit.relative_residual < 0.015
    assert capture.clipped.mean() < 0.002
    stokes = fit.stokes[:, :, 0]
    height, width = capture.clipped.shape
    y, x = np.mgrid[:height, :width]
    # The apple, read off the picture: an ellipse about (735, 635), of which the lower rim is dark.
    u, v = (x - 735) / 550, -(y - 635) / 545
    radius, azimuth = np.hypot(u, v), np.arctan2(v, u)
    rim = (radius > 0.8) & (radius < 0.95) & (v < -0.3) & (polarisation.dolp(stokes) > 0.2)
    assert rim.sum() > 20_000
    off = polarisation.aolp(stokes)[rim] - (azimuth[rim] + np.pi / 2)
    assert abs(np.degrees(np.angle(np.exp(2j * off).mean()) / 2)) < 10
    assert abs(np.exp(2j * off).mean()) > 0.9


def test_a_turned_frame_is_refused(tmp_path: Path) -> None:
    """Turned, other angles stand in the places that `mosaic` names: AoLP would be wrong unseen."""
    frame = np.full((16, 16), 100, np.uint16)
    for orientation in (1, 6):
        path = tmp_path / f"{orientation}.tif"
        tifffile.imwrite(path, frame, extratags=[(274, 3, 1, orientation, True)])
    assert read_capture(tmp_path / "1.tif", mosaic=SONY).pictures.shape == (4, 16, 16, 1)
    with pytest.raises(InputError, match="a frame that is not turned"):
        read_capture(tmp_path / "6.tif", mosaic=SONY)


SQUARE = {"mosaic": (90, 45, 135, 0)}


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"angles": (0, 45, 90, 135)}, "mosaic: expected no other angles"),
        ({"size": (12, 12)}, "mosaic: expected size with packing, found size alone"),
        ({"packing": "mono8"}, "mosaic: expected size with packing, found packing alone"),
        ({"size": (12, 12), "packing": "BayerRG8"}, "bayer: expected .* rg, found none"),
        (
            {"size": (12, 12), "packing": "BayerBG8", "bayer": "rggb"},
            "bayer: expected bayer of BayerBG8, which begins with bg, found rggb",
        ),
        ({"size": (-12, -12), "packing": "mono8"}, "a pixel or more a side, found -12 x -12"),
        ({"size": (0, 12), "packing": "mono8"}, "a pixel or more a side, found 0 x 12"),
    ],
)
def test_what_does_not_belong_together_is_refused(
    told: dict[str, Any], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "frame.raw"
    path.write_bytes(bytes(range(1, 145)))
    with pytest.raises(InputError, match=words):
        read_capture(path, **SQUARE, **told)
    colour = {"size": (12, 12), "packing": "BayerRG8", "bayer": "rggb"}
    assert read_capture(path, **SQUARE, **colour).pictures.shape == (4, 12, 12, 3)
