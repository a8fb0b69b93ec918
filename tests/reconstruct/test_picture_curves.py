"""Curves and transparent colours that a picture tells of: taken at its word, or refused."""

from __future__ import annotations

import io
import logging
import struct
import zlib
from pathlib import Path

import imagecodecs
import numpy as np
import PIL.Image
import PIL.ImageCms
import PIL.TiffImagePlugin
import pytest
from pictures import CODES_16, SMOOTH, rewritten

from malus.reconstruct.photos.read_picture import read_picture
from malus.reconstruct.photos.tone_curves import (
    Transfer,
    icc_transfer,
    linear_transfer,
    power_transfer,
    srgb_transfer,
)
from malus.scenes import InputError


def table_transfer(bits: int) -> Transfer:
    """The curve of a profile with a table of 17 entries, which is steep and flat by turns."""
    x = np.linspace(0.0, 1.0, 17)
    values = np.rint(65535 * (x**2.2 + 0.02 * np.sin(2 * np.pi * x) ** 2)).astype(">u2")
    tag = b"curv" + struct.pack(">II", 0, len(values)) + values.tobytes()
    head = struct.pack(">I4sII", 1, b"kTRC", 144, len(tag))
    return icc_transfer(b"\0" * 36 + b"acsp" + b"\0" * 88 + head + tag, bits, "profile")


def curves(bits: int) -> dict[str, Transfer]:
    powers = {f"power {g:.3g}": power_transfer(g, bits) for g in (1 / 2.2, 1.8, 2.2, 2.8)}
    named = {"sRGB": srgb_transfer(bits), "linear": linear_transfer(bits)}
    return powers | named | {"table": table_transfer(bits)}


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("name", list(curves(8)))
def test_every_code_comes_back_as_itself(name: str, bits: int) -> None:
    transfer = curves(bits)[name]
    codes = np.arange(1 << bits, dtype=np.uint8 if bits == 8 else np.uint16)[None, :, None]
    again = transfer.encoded(transfer.linear(codes))
    np.testing.assert_array_equal(again, codes)
    assert again.dtype == codes.dtype


@pytest.mark.parametrize("name", list(curves(8)))
def test_light_becomes_the_code_of_the_nearest_light(name: str) -> None:
    transfer = curves(8)[name]
    random = np.random.default_rng(0)
    light = np.concatenate([random.random(4000), random.random(4000) ** 8, [-0.5, -0.0, 1.5, 9e9]])
    codes = transfer.encoded(light.astype(np.float32)[None, :, None]).ravel()
    distances = np.abs(light[:, None] - transfer.table[0])
    chosen = np.take_along_axis(distances, codes[:, None].astype(int), axis=1)[:, 0]
    # Light is in single precision, so that it may lie on the other side of a middle by that much.
    assert (chosen - distances.min(axis=1) <= 2e-7 * np.abs(light)).all()
    ends = transfer.encoded(np.array([-np.inf, np.inf], np.float32)[None, :, None]).ravel()
    assert ends.tolist() == [0, 255]


def test_codes_of_one_light_keep_that_light() -> None:
    flat = np.maximum.accumulate(np.clip(np.linspace(-0.1, 1.1, 256), 0, 1).round(2))
    transfer = Transfer(flat[None], "steps")
    codes = np.arange(256, dtype=np.uint8)[None, :, None]
    light = transfer.linear(codes)
    np.testing.assert_array_equal(transfer.linear(transfer.encoded(light)), light)


def png_with(chunk: bytes, content: bytes) -> bytes:
    data = io.BytesIO()
    PIL.Image.fromarray(SMOOTH).save(data, "PNG")
    raw = struct.pack(">I", len(content)) + chunk + content
    raw += struct.pack(">I", zlib.crc32(chunk + content))
    return data.getvalue()[:33] + raw + data.getvalue()[33:]


def test_a_transparent_colour_is_told(tmp_path: Path) -> None:
    colour = struct.pack(">3H", *SMOOTH[3, 4].tolist())
    (tmp_path / "t.png").write_bytes(png_with(b"tRNS", colour))
    picture = read_picture(tmp_path / "t.png")
    assert picture.alpha is not None
    assert picture.alpha[3, 4] == 0
    assert any("transparent colour" in note for note in picture.notes)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("gamma", [1.0, 0.55])
def test_a_png_tells_its_gamma_and_keeps_it(tmp_path: Path, bits: int, gamma: float) -> None:
    codes = np.ascontiguousarray(SMOOTH if bits == 8 else CODES_16[..., :3])
    data, path = bytes(imagecodecs.png_encode(codes)), tmp_path / "a.png"
    content = struct.pack(">I", round(gamma * 1e5))
    raw = struct.pack(">I", 4) + b"gAMA" + content
    raw += struct.pack(">I", zlib.crc32(b"gAMA" + content))
    path.write_bytes(data[:33] + raw + data[33:])
    picture = read_picture(path)
    # The samples are light to the power of the chunk's number.
    np.testing.assert_allclose(picture.linear**gamma, codes / (2**bits - 1), atol=1e-6)
    assert f"gamma of {1 / gamma:.4g}" in picture.assumption
    copy = rewritten(path, picture)
    assert raw in copy.read_bytes()
    np.testing.assert_array_equal(imagecodecs.png_decode(copy.read_bytes()), codes)
    srgb = b"\0\0\0\1sRGB\0" + struct.pack(">I", zlib.crc32(b"sRGB\0"))
    path.write_bytes(data[:33] + srgb + raw + data[33:])  # which stands above gAMA
    assert "sRGB" in read_picture(path).assumption


@pytest.mark.parametrize("named", ["index", "gamma", "xmp"])
def test_a_jpeg_tells_its_gamma_and_keeps_it(tmp_path: Path, named: str) -> None:
    """Cameras in their Adobe RGB mode write no profile, but R03."""
    exif, options = PIL.Image.Exif(), {}
    if named == "xmp":
        options["xmp"] = b"<x:xmpmeta xmlns:x='adobe:ns:meta/'><exif:Gamma>22/10</exif:Gamma>"
    elif named == "gamma":
        exif.get_ifd(0x8769)[0xA500] = PIL.TiffImagePlugin.IFDRational(22, 10)
    else:
        exif.get_ifd(0x8769)[0xA001] = 65535
        exif.get_ifd(0x8769)[0xA005] = {1: "R03"}
    path = tmp_path / "a.jpg"
    PIL.Image.new("RGB", (16, 16), (128, 64, 200)).save(path, quality=100, exif=exif, **options)
    picture = read_picture(path)
    assert "gamma of 2.2" in picture.assumption or "gamma of 2.199" in picture.assumption
    light = (np.array([128, 64, 200]) / 255) ** 2.2
    np.testing.assert_allclose(picture.linear, np.broadcast_to(light, (16, 16, 3)), atol=0.01)
    again = read_picture(rewritten(path, picture))
    assert again.assumption == picture.assumption


def test_a_picture_that_says_srgb_is_no_adobe_rgb(tmp_path: Path) -> None:
    """DCF: R03 tells Adobe RGB only where the colour space is uncalibrated."""
    exif, path = PIL.Image.Exif(), tmp_path / "a.jpg"
    exif.get_ifd(0x8769)[0xA001] = 1
    exif.get_ifd(0x8769)[0xA005] = {1: "R03"}
    PIL.Image.new("RGB", (16, 16), (128, 64, 200)).save(path, exif=exif)
    assert "sRGB" in read_picture(path).assumption


@pytest.mark.parametrize(("code", "found"), [(16, "PQ"), (18, "HLG"), (9, "number 9")])
def test_curves_of_high_range_are_refused(tmp_path: Path, code: int, found: str) -> None:
    (tmp_path / "a.png").write_bytes(png_with(b"cICP", bytes([9, code, 0, 1])))
    with pytest.raises(InputError, match=found):
        read_picture(tmp_path / "a.png")
    deep = (CODES_16[..., :3] >> 6).astype(np.uint16)
    data = imagecodecs.avif_encode(deep, bitspersample=10, level=100, transfer=code)
    (tmp_path / "a.avif").write_bytes(data)
    with pytest.raises(InputError, match=found):
        read_picture(tmp_path / "a.avif")


@pytest.mark.parametrize(("code", "gamma"), [(4, 2.2), (5, 2.8), (8, 1.0)])
def test_codes_of_video_name_their_gamma(tmp_path: Path, code: int, gamma: float) -> None:
    """ITU-T H.273, table 3: BT.470 System M and System B, G, and linear light."""
    (tmp_path / "a.png").write_bytes(png_with(b"cICP", bytes([1, code, 0, 1])))
    picture = read_picture(tmp_path / "a.png")
    np.testing.assert_allclose(picture.linear, (SMOOTH / 255) ** gamma, atol=1e-6)


@pytest.mark.parametrize("bits", [8, 16])
def test_codes_of_video_stand_above_a_profile(tmp_path: Path, bits: int) -> None:
    """PNG, 3rd edition, 4.3: cICP before iCCP. A linear or PQ picture was read by the profile."""
    codes = np.ascontiguousarray(SMOOTH if bits == 8 else CODES_16[..., :3])
    srgb = PIL.ImageCms.ImageCmsProfile(PIL.ImageCms.createProfile("sRGB")).tobytes()

    def write(code: int) -> Path:
        named = b"icc\0\0" + zlib.compress(srgb)
        raw = b"".join(
            struct.pack(">I", len(content)) + name + content
            + struct.pack(">I", zlib.crc32(name + content))
            for name, content in ((b"iCCP", named), (b"cICP", bytes([1, code, 0, 1])))
        )  # fmt: skip
        data, path = bytes(imagecodecs.png_encode(codes)), tmp_path / f"{code}.png"
        path.write_bytes(data[:33] + raw + data[33:])
        return path

    picture = read_picture(write(8))
    # Single precision of values up to 1.
    np.testing.assert_allclose(picture.linear, codes / (2.0**bits - 1), atol=1e-7)
    copy = rewritten(tmp_path / "8.png", picture)
    np.testing.assert_array_equal(imagecodecs.png_decode(copy.read_bytes()), codes)
    np.testing.assert_array_equal(read_picture(copy).linear, picture.linear)
    with PIL.Image.open(copy) as image:
        assert image.info["icc_profile"] == srgb
    with pytest.raises(InputError, match="PQ"):
        read_picture(write(16))


def test_a_linear_avif_is_linear(tmp_path: Path) -> None:
    codes = np.ascontiguousarray(SMOOTH)
    data = imagecodecs.avif_encode(codes, level=100, transfer=8)
    (tmp_path / "a.avif").write_bytes(data)
    picture = read_picture(tmp_path / "a.avif")
    np.testing.assert_allclose(picture.linear, codes / 255, atol=1.01 / 255)
    again = read_picture(rewritten(tmp_path / "a.avif", picture))
    assert again.kind == "PNG"
    np.testing.assert_allclose(again.linear, picture.linear, atol=1e-6)


P3 = struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)
"""White and primaries of Display P3, for a chunk cHRM."""


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize(
    "chunks",
    [{b"gAMA": struct.pack(">I", 45455), b"cHRM": P3}, {b"cICP": bytes([12, 13, 0, 1])}],
)
def test_a_png_keeps_its_primaries(tmp_path: Path, bits: int, chunks: dict[bytes, bytes]) -> None:
    """Without them the colours of Display P3 would be shown as those of sRGB."""
    codes = np.ascontiguousarray(SMOOTH if bits == 8 else CODES_16[..., :3])
    data, path = bytes(imagecodecs.png_encode(codes)), tmp_path / "a.png"
    raw = b"".join(
        struct.pack(">I", len(content)) + name + content
        + struct.pack(">I", zlib.crc32(name + content)) for name, content in chunks.items()
    )  # fmt: skip
    path.write_bytes(data[:33] + raw + data[33:])
    picture = read_picture(path)
    assert "sRGB" in picture.assumption
    written = rewritten(path, picture).read_bytes()
    assert raw in written[: written.index(b"IDAT")]
    np.testing.assert_array_equal(imagecodecs.png_decode(written), codes)


def test_an_avif_keeps_its_primaries_in_a_png(tmp_path: Path) -> None:
    """Pillow writes AVIF with the primaries of sRGB alone."""
    data = imagecodecs.avif_encode(SMOOTH, level=100, primaries=12, transfer=13, matrix=0)
    (tmp_path / "a.avif").write_bytes(data)
    picture = read_picture(tmp_path / "a.avif")
    assert any("written as a PNG" in note for note in picture.notes)
    copy = rewritten(tmp_path / "a.avif", picture)
    assert b"\0\0\0\4cICP" + bytes([12, 13, 0, 1]) in copy.read_bytes()
    # Matrix 0 keeps red, green and blue as they are: lossless.
    np.testing.assert_array_equal(imagecodecs.png_decode(copy.read_bytes()), SMOOTH)


def test_libpng_says_nothing_of_an_interlaced_picture(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By Adam7: seven pictures of every n-th pixel, one after the other, after the PNG standard."""
    codes = CODES_16[..., :3]
    steps = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2),
             (1, 0, 2, 1))  # fmt: skip
    passes = [codes[row::down, column::right] for row, column, down, right in steps]
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for part in passes for row in part)
    height, width = codes.shape[:2]
    head = struct.pack(">2I5B", width, height, 16, 2, 0, 0, 1)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    whole = b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    )
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + whole)
    # A program that sets up no log has what is logged on its error stream.
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    picture = read_picture(tmp_path / "a.png")
    np.testing.assert_array_equal(picture.transfer.encoded(picture.linear), codes)
    assert capfd.readouterr().err == ""


def test_codes_of_video_range_in_a_png_are_refused(tmp_path: Path) -> None:
    """Black is 16 there: read as it is, nothing would be dark, and DoLP too low."""
    (tmp_path / "a.png").write_bytes(png_with(b"cICP", bytes([1, 13, 0, 0])))
    with pytest.raises(InputError, match="all of their range, found those of video"):
        read_picture(tmp_path / "a.png")
