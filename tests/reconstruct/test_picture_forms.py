"""Pictures of other containers: what is kept, what is told, and what is refused."""

from __future__ import annotations

import io
import re
import struct
import tracemalloc
from pathlib import Path

import imagecodecs
import numpy as np
import PIL.features
import PIL.Image
import PIL.ImageCms
import pytest
import tifffile
from click.testing import CliRunner
from pictures import CODES_16, SMOOTH, rewritten

from malus.bench.commands.filter import filter_command
from malus.reconstruct.photos import read_picture as reader
from malus.reconstruct.photos.filter import filter_picture
from malus.reconstruct.photos.masks_and_normals import read_labels, read_mask
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.read_picture import read_picture
from malus.reconstruct.photos.write_picture import write_picture
from malus.scenes import InputError

CASES = Path(__file__).parents[1] / "cases"
RNG = np.random.default_rng(0)
PROFILE = PIL.ImageCms.ImageCmsProfile(PIL.ImageCms.createProfile("sRGB")).tobytes()


def test_an_mpo_is_the_jpeg_that_it_is(tmp_path: Path) -> None:
    picture = read_picture(CASES / "mpo/ball.jpg")
    with PIL.Image.open(CASES / "mpo/ball.jpg") as image:
        first = np.asarray(image.convert("RGB"))
    np.testing.assert_array_equal(picture.transfer.encoded(picture.linear), first)
    assert picture.notes == ("the file holds 2 pictures: the first is read",)
    with PIL.Image.open(rewritten(tmp_path / "a", picture)) as image:
        assert image.format == "JPEG"
    options = ["--mask", str(CASES / "mpo/mask.png"), "--light", "0,0.5,1"]
    out = ["--out", str(tmp_path / "out")]
    result = CliRunner().invoke(filter_command, [str(CASES / "mpo/ball.jpg"), *options, *out])
    assert result.exit_code == 0, result.exception
    assert "the file holds 2 pictures" in result.output


def test_an_ultra_hdr_jpeg_is_its_standard_range(tmp_path: Path) -> None:
    """A gain map behind the picture, announced in its XMP: what Android's cameras write."""
    data = io.BytesIO()
    xmp = b'<x:xmpmeta xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0"/>'
    PIL.Image.fromarray(SMOOTH).save(data, "JPEG", xmp=xmp, quality=95)
    gain = io.BytesIO()
    PIL.Image.fromarray(SMOOTH[..., 0]).save(gain, "JPEG")
    (tmp_path / "u.jpg").write_bytes(data.getvalue() + gain.getvalue())
    picture = read_picture(tmp_path / "u.jpg")
    assert any("gain map" in note for note in picture.notes)
    with PIL.Image.open(rewritten(tmp_path / "u.jpg", picture)) as image:
        assert "xmp" not in image.info


@pytest.mark.skipif(
    not getattr(getattr(imagecodecs, "ULTRAHDR", None), "available", False),
    reason="this imagecodecs has no libultrahdr",
)
def test_an_ultra_hdr_jpeg_of_another_program(tmp_path: Path) -> None:
    y, x = np.mgrid[:64, :64] / 64
    light = np.stack([2 * x, 2 * y, x * y, np.ones_like(x)], axis=-1).astype(np.float16)
    (tmp_path / "u.jpg").write_bytes(imagecodecs.ultrahdr_encode(light))
    picture = read_picture(tmp_path / "u.jpg")
    assert picture.linear.shape == (64, 64, 3)
    assert any("gain map" in note for note in picture.notes)


@pytest.mark.parametrize("lossless", [True, False])
def test_webp_keeps_how_it_was_compressed_and_its_profile(tmp_path: Path, lossless: bool) -> None:
    path = tmp_path / "a.webp"
    PIL.Image.fromarray(SMOOTH).save(path, lossless=lossless, icc_profile=PROFILE)
    picture = read_picture(path)
    copy = rewritten(path, picture)
    assert (b"VP8L" in copy.read_bytes()) == lossless
    again = read_picture(copy)
    assert again.metadata == picture.metadata
    if lossless:
        np.testing.assert_array_equal(again.linear, picture.linear)


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("bits", [8, 12, 16])
def test_jpeg_2000_keeps_every_bit(tmp_path: Path, bits: int, channels: int) -> None:
    codes = (CODES_16[..., :channels] >> (16 - bits)).astype(np.uint8 if bits == 8 else np.uint16)
    codes = codes[..., 0] if channels == 1 else codes
    path = tmp_path / "a.jp2"
    path.write_bytes(
        imagecodecs.jpeg2k_encode(
            codes, level=0, codecformat="jp2", reversible=True, bitspersample=bits
        )
    )
    picture = read_picture(path, linear=True)
    expected = codes if channels == 1 else codes[..., : 3 if channels == 4 else channels]
    scaled = expected.reshape(picture.linear.shape) / (2**bits - 1)
    np.testing.assert_allclose(picture.linear, scaled, rtol=1e-6)
    copy = rewritten(path, picture)
    np.testing.assert_array_equal(imagecodecs.jpeg2k_decode(copy.read_bytes()), codes)


def test_jpeg_2000_keeps_its_profile(tmp_path: Path) -> None:
    path = tmp_path / "a.jp2"
    picture = read_png(tmp_path)
    write_picture(
        path,
        Picture(picture.linear, "JPEG2000", picture.transfer, metadata={"icc_profile": PROFILE}),
    )
    again = read_picture(path)
    assert again.metadata == {"icc_profile": PROFILE}
    assert "embedded" in again.assumption
    with PIL.Image.open(path) as image:  # another program still reads it
        np.testing.assert_array_equal(np.asarray(image), SMOOTH)


def read_png(folder: Path) -> Picture:
    PIL.Image.fromarray(SMOOTH).save(folder / "smooth.png")
    return read_picture(folder / "smooth.png")


@pytest.mark.skipif(not PIL.features.check("avif"), reason="this Pillow has no AVIF")
def test_avif_of_eight_bits_stays_avif(tmp_path: Path) -> None:
    path = tmp_path / "a.avif"
    PIL.Image.fromarray(SMOOTH).save(path, quality=100, icc_profile=PROFILE)
    picture = read_picture(path)
    again = read_picture(rewritten(path, picture))
    assert again.kind == "AVIF"
    assert again.metadata["icc_profile"] == PROFILE
    # AVIF is lossy: three codes of an even gradient.
    assert np.abs(again.linear - picture.linear).max() < 3 * np.diff(picture.transfer.table).max()


@pytest.mark.parametrize(
    ("space", "channels", "found"),
    [(12, 4, "CMYK inks"), (14, 3, "CIELAB"), (21, 3, "ROMM RGB"), (20, 3, "colour space 20")],
)
def test_colour_spaces_of_jpeg_2000_are_srgb_and_grey(
    tmp_path: Path, space: int, channels: int, found: str
) -> None:
    """ISO 15444-1 and -2, enumerated spaces: inks were taken for red, green, blue and opacity."""
    data = bytes(imagecodecs.jpeg2k_encode(CODES_16[..., :channels], level=0, codecformat="jp2"))
    at = data.index(b"colr") + 4 + 3
    assert data[at : at + 4] == bytes([0, 0, 0, 16])
    path = tmp_path / "a.jp2"
    path.write_bytes(data[:at] + bytes([0, 0, 0, space]) + data[at + 4 :])
    with pytest.raises(InputError, match=f"grey or RGB of 8 to 16 bits, found {found}"):
        read_picture(path)


@pytest.mark.parametrize("bits", [10, 12])
@pytest.mark.parametrize("channels", [3, 4])
def test_avif_of_more_bits_is_written_as_png(tmp_path: Path, bits: int, channels: int) -> None:
    deep, path = (CODES_16[..., :channels] >> (16 - bits)).astype(np.uint16), tmp_path / "a.avif"
    path.write_bytes(imagecodecs.avif_encode(deep, bitspersample=bits, level=100))  # lossless
    picture = read_picture(path, linear=True)
    # The nearest of 16 bits.
    np.testing.assert_allclose(picture.linear, deep[..., :3] / (2**bits - 1), atol=0.6 / 65535)
    assert any(f"AVIF of {bits} bits" in note for note in picture.notes)
    copy = rewritten(path, picture)
    assert copy.suffix == ".png"
    written = imagecodecs.png_decode(copy.read_bytes())
    np.testing.assert_array_equal(np.rint(written / 65535 * (2**bits - 1)), deep)


def test_heic_of_more_bits_is_written_as_png(tmp_path: Path) -> None:
    heif = pytest.importorskip("pillow_heif", reason="reads HEIC")
    codes = np.ascontiguousarray(CODES_16[..., :3])
    path = tmp_path / "a.heic"
    image = heif.from_bytes(mode="RGB;16", size=codes.shape[1::-1], data=codes.tobytes())
    image.save(path, quality=-1, chroma=444, matrix_coefficients=0)  # lossless, of 10 bits
    picture = read_picture(path, linear=True)
    assert np.abs(picture.linear - codes / 65535).max() < 2 / 1023
    assert rewritten(path, picture).suffix == ".png"


@pytest.mark.parametrize("kind", [1, 2])
def test_jpeg_2000_keeps_what_its_opacity_is(tmp_path: Path, kind: int) -> None:
    """A half transparent grey whose values are multiplied by its opacity, or not."""
    codes = np.empty((8, 8, 4), np.uint8)
    codes[..., :3], codes[..., 3] = 64, 128
    plain = bytes(imagecodecs.jpeg2k_encode(codes, level=0, codecformat="jp2", reversible=True))
    definition = struct.pack(">13H", 4, 0, 0, 1, 1, 0, 2, 2, 0, 3, 3, kind, 0)
    box = struct.pack(">I4s", 8 + len(definition), b"cdef") + definition
    at = plain.index(b"jp2h") - 4
    length = struct.unpack_from(">I", plain, at)[0]
    longer = struct.pack(">I", length + len(box))
    path = tmp_path / "a.jp2"
    path.write_bytes(plain[:at] + longer + plain[at + 4 : at + length] + box + plain[at + length :])
    picture = read_picture(path, linear=True)
    expected = 64 / 255 if kind == 1 else 64 / 128
    np.testing.assert_allclose(picture.linear, expected, rtol=1e-6)
    copy = rewritten(path, picture)
    assert box in copy.read_bytes()
    np.testing.assert_array_equal(imagecodecs.jpeg2k_decode(copy.read_bytes()), codes)
    other = struct.pack(">13H", 4, 0, kind, 0, 1, 0, 1, 2, 0, 2, 3, 0, 3)
    path.write_bytes(path.read_bytes().replace(definition, other))
    with pytest.raises(InputError, match="opacity that is not the last channel"):
        read_picture(path)


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    (tmp_path / "a.heic").write_bytes(b"\0\0\0\x18ftypheic")
    monkeypatch.setattr(reader.importlib, "import_module", missing)
    with pytest.raises(InputError, match="pip install pillow-heif"):
        read_picture(tmp_path / "a.heic")


@pytest.mark.parametrize("suffix", ["bmp", "ppm"])
def test_plain_containers(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    PIL.Image.fromarray(SMOOTH).save(path)
    copy = rewritten(path, read_picture(path))
    assert copy.suffix == path.suffix
    with PIL.Image.open(copy) as image:
        np.testing.assert_array_equal(np.asarray(image), SMOOTH)


def test_moving_pictures_are_refused(tmp_path: Path) -> None:
    frames = [PIL.Image.fromarray(codes) for codes in (SMOOTH, 255 - SMOOTH, SMOOTH[::-1])]
    for suffix in ("webp", "png"):
        frames[0].save(tmp_path / f"a.{suffix}", save_all=True, append_images=frames[1:])
        with pytest.raises(InputError, match="expected one picture, found 3"):
            read_picture(tmp_path / f"a.{suffix}")


@pytest.mark.parametrize("name", ["a.jp2", "a.webp", "a.avif", "a.bmp", "a.ppm", "a.mpo"])
def test_damaged_files_end_in_one_line(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(RNG.bytes(300))
    with pytest.raises(InputError, match=re.escape(name)):
        read_picture(tmp_path / name)


@pytest.mark.parametrize("kind", ["png", "tif", "exr", "jp2", "webp"])
def test_reading_needs_at_most_three_times_the_decoded_picture(tmp_path: Path, kind: str) -> None:
    """NumPy's memory is what is traced: codes and light; what a codec holds inside is not."""
    side, path = 512, tmp_path / f"a.{kind}"
    codes = RNG.integers(0, 256, (side, side, 3), dtype=np.uint8)
    if kind == "tif":
        tifffile.imwrite(path, codes, photometric="rgb")
    elif kind == "exr":
        write_picture(path, Picture(codes.astype(np.float32) / 255, "EXR", None))
    elif kind == "jp2":
        path.write_bytes(imagecodecs.jpeg2k_encode(codes, level=0, codecformat="jp2"))
    else:
        PIL.Image.fromarray(codes).save(path)
    read_picture(path)  # imports are not the picture's
    tracemalloc.start()
    picture = read_picture(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3 * picture.linear.nbytes


def test_notes_are_among_the_statements() -> None:
    filtered = filter_picture(
        Picture(np.full((8, 8, 3), [0.5, 0.3, 0.1], np.float32), "EXR", None, notes=("a note",)),
        knowledge=_flat(),
    )
    assert "a note" in filtered.statements


def _flat():
    from malus.reconstruct.photos.knowledge import Knowledge

    return Knowledge(np.tile(np.array([0, 0.6, 0.8], np.float32), (8, 8, 1)))


def test_what_is_left_out_is_told(tmp_path: Path) -> None:
    codes = np.full((4, 4, 3), 90, np.uint8)
    # tifffile writes no Exif: another tag gets its number.
    tifffile.imwrite(tmp_path / "a.tif", codes, extratags=[(34664, 4, 1, 8, True)])
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        offset = file.pages.first.tags[34664].offset
    data = bytearray((tmp_path / "a.tif").read_bytes())
    struct.pack_into("<H", data, offset, 34665)
    (tmp_path / "a.tif").write_bytes(data)
    assert any("Exif is left out" in note for note in read_picture(tmp_path / "a.tif").notes)
    caption = b"Photoshop 3.0\x008BIM\x04\x04\x00\x00\x00\x00\x00\x0c\x1c\x02x\x00\x07caption"
    plain = io.BytesIO()
    PIL.Image.fromarray(codes).save(plain, "JPEG")
    marked = b"\xff\xed" + struct.pack(">H", len(caption) + 2) + caption
    (tmp_path / "a.jpg").write_bytes(plain.getvalue()[:2] + marked + plain.getvalue()[2:])
    assert any("IPTC are left out" in note for note in read_picture(tmp_path / "a.jpg").notes)


def test_a_mask_does_not_hide_in_transparency(tmp_path: Path) -> None:
    """A cut-out is white everywhere: all of the picture would be the object."""
    cut_out = np.full((6, 8, 4), 255, np.uint8)
    cut_out[:3, :, 3] = 0
    PIL.Image.fromarray(cut_out).save(tmp_path / "cut_out.png")
    for read in (read_mask, read_labels):
        with pytest.raises(InputError, match="an opaque picture, found transparent parts"):
            read(tmp_path / "cut_out.png", (6, 8))
    cut_out[..., :3] = 255 * (cut_out[..., 3:] > 0)
    cut_out[..., 3] = 255
    PIL.Image.fromarray(cut_out).save(tmp_path / "mask.png")
    assert read_mask(tmp_path / "mask.png", (6, 8)).sum() == 24
