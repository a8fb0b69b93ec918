"""Ordinary pictures in and out: every form, profiles, orientation."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from pathlib import Path

import imagecodecs
import numpy as np
import PIL.Image
import PIL.ImageCms
import pytest
import tifffile

from malus.reconstruct.photos.picture import Picture, upright
from malus.reconstruct.photos.read_picture import read_picture
from malus.reconstruct.photos.tone_curves import icc_transfer, srgb_transfer
from malus.reconstruct.photos.write_picture import write_picture
from malus.scenes import InputError

RNG = np.random.default_rng(0)
CODES_8 = RNG.integers(0, 256, (12, 18, 3), dtype=np.uint8)
CODES_16 = RNG.integers(0, 65536, (12, 18, 3), dtype=np.uint16)
PROFILE = PIL.ImageCms.ImageCmsProfile(PIL.ImageCms.createProfile("sRGB")).tobytes()


def write_everything(folder: Path) -> list[Path]:
    """The same random picture in every form."""
    exif = PIL.Image.Exif()
    exif[271] = "a maker"
    picture = PIL.Image.fromarray(CODES_8)
    picture.save(folder / "rgb.png", icc_profile=PROFILE, exif=exif, dpi=(300, 300))
    picture.save(folder / "rgb.jpg", icc_profile=PROFILE, exif=exif, dpi=(300, 300))
    PIL.Image.fromarray(CODES_8[..., 0]).save(folder / "grey.png")
    PIL.Image.fromarray(CODES_16[..., 0]).save(folder / "grey16.png")
    PIL.Image.fromarray(np.dstack([CODES_8, CODES_8[..., 0]])).save(folder / "alpha.png")
    tifffile.imwrite(
        folder / "rgb16.tif", CODES_16, photometric="rgb", iccprofile=PROFILE, resolution=(300, 300)
    )
    floats = RNG.random((12, 18, 3)).astype(np.float32)
    tifffile.imwrite(folder / "float.tif", floats, photometric="rgb")
    write_picture(folder / "float.exr", Picture(floats, "EXR", None))
    return sorted(folder.iterdir())


def test_a_picture_goes_out_as_it_came_in(tmp_path: Path) -> None:
    for path in write_everything(tmp_path):
        picture = read_picture(path)
        copy = path.with_name("copy_" + path.name)
        write_picture(copy, picture)
        again = read_picture(copy)
        assert again.metadata == picture.metadata, path.name
        assert again.linear.shape == picture.linear.shape
        # JPEG is lossy, most of all on noise; everything else keeps every code.
        if picture.kind != "JPEG":
            np.testing.assert_array_equal(again.linear, picture.linear)
        if picture.alpha is not None:
            np.testing.assert_array_equal(again.alpha, picture.alpha)
        assert not list(tmp_path.glob(".part-*"))


def test_sixteen_bit_colour_png_keeps_bits_and_metadata(tmp_path: Path) -> None:
    plain, rich = tmp_path / "a.png", tmp_path / "b.png"
    plain.write_bytes(imagecodecs.png_encode(CODES_16))
    picture = read_picture(plain)
    np.testing.assert_array_equal(picture.transfer.encoded(picture.linear), CODES_16)
    metadata = {"icc_profile": PROFILE, "dpi": (300.0, 300.0), "text": {"Title": "noise"}}
    write_picture(rich, Picture(picture.linear, "PNG", picture.transfer, None, metadata))
    with PIL.Image.open(rich) as image:
        assert image.info["icc_profile"] == PROFILE
        assert image.info["dpi"] == pytest.approx((300, 300), rel=1e-3)
        assert image.text["Title"] == "noise"


def grey_profile(curve: bytes) -> bytes:
    """The least that `icc_transfer` reads: a signature, and one tone curve."""
    table = struct.pack(">I4sII", 1, b"kTRC", 144, len(curve))
    return b"\0" * 36 + b"acsp" + b"\0" * 88 + table + curve


def parametric(kind: int, *numbers: float) -> bytes:
    stored = [int(number * 65536) for number in numbers]
    return struct.pack(f">4s4xH2x{len(stored)}i", b"para", kind, *stored)


def test_curves_of_a_profile_are_used(tmp_path: Path) -> None:
    x = np.linspace(0, 1, 256)
    np.testing.assert_allclose(
        icc_transfer(PROFILE, 8, "x").table[0], srgb_transfer(8).table[0], atol=2e-5
    )
    profile = grey_profile(struct.pack(">4s4xIH2x", b"curv", 1, int(2.2 * 256)))
    # 2.2 is stored in 1/256.
    expected = x ** (int(2.2 * 256) / 256)
    np.testing.assert_allclose(icc_transfer(profile, 8, "x").table[0], expected, rtol=1e-12)
    PIL.Image.fromarray(CODES_8[..., 0]).save(tmp_path / "g.png", icc_profile=profile)
    read = read_picture(tmp_path / "g.png")
    np.testing.assert_allclose(read.linear[..., 0], expected[CODES_8[..., 0]], rtol=1e-6)
    assert "embedded" in read.assumption


G, A, B, C, D, E, F = 2.0, 0.75, 0.25, 0.125, 0.5, 0.0625, 0.03125
"""Parameters of curves, in whole 1/65536: stored without rounding."""


@pytest.mark.parametrize(
    ("numbers", "light"),
    [
        ((G,), lambda x: x**G),
        ((G, A, -B), lambda x: (A * x - B) ** G if x >= B / A else 0.0),
        ((G, A, -B, C), lambda x: (A * x - B) ** G + C if x >= B / A else C),
        ((G, A, B, C, D), lambda x: (A * x + B) ** G if x >= D else C * x),
        ((G, A, B, C, D, E, F), lambda x: (A * x + B) ** G + E if x >= D else C * x + F),
    ],
    ids=["type 0", "type 1", "type 2", "type 3", "type 4"],
)
def test_parametric_curves_are_those_of_the_standard(
    numbers: tuple[float, ...], light: Callable[[float], float]
) -> None:
    """ICC.1:2022, parametricCurveType, code by code."""
    kind = {1: 0, 3: 1, 4: 2, 5: 3, 7: 4}[len(numbers)]
    table = icc_transfer(grey_profile(parametric(kind, *numbers)), 8, "x").table[0]
    np.testing.assert_allclose(table, [light(code / 255) for code in range(256)], rtol=1e-12)


@pytest.mark.parametrize(
    "profile",
    [
        b"nonsense",
        PROFILE[:200],
        PROFILE[:132],
        grey_profile(parametric(1, 2.0, 0.0, 0.5)),  # breaks at −b/a
    ],
    ids=["nonsense", "cut short", "no tags", "curve that breaks"],
)
def test_a_damaged_profile_says_so(profile: bytes) -> None:
    with pytest.raises(InputError, match="profile"):
        icc_transfer(profile, 8, "x")


def test_a_curve_that_is_infinite_says_so_and_warns_of_nothing() -> None:
    with pytest.raises(InputError, match="rising tone curves"):
        icc_transfer(grey_profile(parametric(0, -1.0)), 8, "x")


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_is_what_pillow_makes_of_it(orientation: int) -> None:
    import PIL.ImageOps

    exif = PIL.Image.Exif()
    exif[274] = orientation
    data = io.BytesIO()
    PIL.Image.fromarray(CODES_8).save(data, "PNG", exif=exif)
    expected = PIL.ImageOps.exif_transpose(PIL.Image.open(data))
    np.testing.assert_array_equal(upright(CODES_8, orientation), np.asarray(expected))


@pytest.mark.parametrize("form", ["jpg", "webp", "png"])
@pytest.mark.parametrize(
    "written", ['tiff:Orientation="6"', "<tiff:Orientation>6</tiff:Orientation>"]
)
def test_what_is_upright_is_not_turned_again(tmp_path: Path, form: str, written: str) -> None:
    """Photo editors write the orientation twice; who shows the result reads the second."""
    import PIL.ImageOps
    import PIL.PngImagePlugin

    exif, xmp = PIL.Image.Exif(), f"<x:xmpmeta xmlns:x='adobe:ns:meta/'>{written}</x:xmpmeta>"
    exif[274] = 6
    options: dict[str, object] = {"xmp": xmp.encode()}
    if form == "png":
        texts = PIL.PngImagePlugin.PngInfo()
        texts.add_itxt("XML:com.adobe.xmp", xmp)
        texts.add_text("Raw profile type exif", "as Exif says")
        options = {"pnginfo": texts}
    path, out = tmp_path / f"turned.{form}", tmp_path / f"upright.{form}"
    PIL.Image.fromarray(CODES_8).save(path, exif=exif, **options)
    picture = read_picture(path)
    assert picture.turned
    write_picture(out, picture)
    with PIL.Image.open(out) as shown:
        assert shown.size == (12, 18)
        assert PIL.ImageOps.exif_transpose(shown).size == (12, 18)
    assert not read_picture(out).turned


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_the_curve_of_television_rises(bits: int) -> None:
    """Rec. 709's constants are rounded: at their joint it falls by 5e-5."""
    curve = parametric(3, 1 / 0.45, 1 / 1.099, 0.099 / 1.099, 1 / 4.5, 0.081)
    table = icc_transfer(grey_profile(curve), bits, "x").table[0]
    assert np.all(np.diff(table) >= 0)
    x = np.linspace(0, 1, 1 << bits)
    expected = np.where(x < 0.081, x / 4.5, ((np.maximum(x, 0.081) + 0.099) / 1.099) ** (1 / 0.45))
    np.testing.assert_allclose(table, expected, atol=1e-4)
