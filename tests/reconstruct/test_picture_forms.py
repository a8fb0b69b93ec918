"""Pictures of other containers: what is kept, what is told, and what is refused."""

from __future__ import annotations

import io
import re
import struct
import tracemalloc
import zlib
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import PIL.features
import PIL.Image
import PIL.ImageCms
import pytest
import tifffile
from click.testing import CliRunner

from malus.bench.commands.filter import filter_command
from malus.reconstruct.photos import read_picture as reader
from malus.reconstruct.photos.filter import filter_picture
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.read_picture import read_picture
from malus.reconstruct.photos.write_picture import write_picture
from malus.scenes import InputError

CASES = Path(__file__).parents[1] / "cases"
RNG = np.random.default_rng(0)
SMOOTH = np.linspace(20, 230, 16 * 24).reshape(16, 24)[..., None].repeat(3, -1).astype(np.uint8)
CODES_16 = RNG.integers(0, 65536, (16, 24, 4), dtype=np.uint16)
PROFILE = PIL.ImageCms.ImageCmsProfile(PIL.ImageCms.createProfile("sRGB")).tobytes()


def rewritten(path: Path, picture: Picture) -> Path:
    copy = path.with_name(f"copy{picture.suffix}")
    write_picture(copy, picture)
    return copy


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
    not imagecodecs.ULTRAHDR.available, reason="this imagecodecs has no libultrahdr"
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


def test_deep_netpbm(tmp_path: Path) -> None:
    grey = CODES_16[..., 0]
    (tmp_path / "a.pgm").write_bytes(b"P5\n24 16\n65535\n" + grey.astype(">u2").tobytes())
    linear = read_picture(tmp_path / "a.pgm", linear=True).linear
    np.testing.assert_allclose(linear[..., 0], grey / 65535, rtol=1e-6)
    colour = CODES_16[..., :3].astype(">u2")
    (tmp_path / "a.ppm").write_bytes(b"P6\n# made up\n24 16\n65535\n" + colour.tobytes())
    with pytest.raises(InputError, match="found 16 bits"):
        read_picture(tmp_path / "a.ppm")


def test_associated_alpha_is_divided_out_and_multiplied_back(tmp_path: Path) -> None:
    """The ball is of one colour: without the division its edge would be dark."""
    path = CASES / "tiff_premultiplied/ball.tif"
    codes, picture = tifffile.imread(path), read_picture(path)
    alpha = codes[..., 3] / 65535
    partly = (alpha > 0.05) & (alpha < 0.95)
    assert partly.any()
    straight = picture.transfer.encoded(picture.linear)[partly] * alpha[partly, None]
    np.testing.assert_allclose(straight, codes[partly][:, :3], atol=1)  # rounded twice
    copy = rewritten(tmp_path / "a.tif", picture)
    np.testing.assert_array_equal(tifffile.imread(copy), codes)
    with tifffile.TiffFile(copy) as file:
        assert [int(sample) for sample in file.pages.first.extrasamples] == [1]
    out = tmp_path / "out"
    arguments = [str(path), "--normals", str(CASES / "tiff_premultiplied/normals.npy")]
    result = CliRunner().invoke(filter_command, [*arguments, "--out", str(out)])
    assert result.exit_code == 0, result.exception
    written = tifffile.imread(out / "ball_angle000.tif")
    np.testing.assert_array_equal(written[..., 3], codes[..., 3])
    assert (written[..., :3][alpha == 0] == 0).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("meaning", ["assocalpha", "unassalpha", "unspecified"])
@pytest.mark.parametrize("channels", [2, 4])
def test_alpha_of_a_tiff_keeps_its_meaning(
    tmp_path: Path, dtype: type, meaning: str, channels: int
) -> None:
    scale = 1 if dtype is np.float32 else np.iinfo(dtype).max
    values = RNG.random((12, 10, channels))
    values[:3, ..., -1] = 0
    if meaning == "assocalpha":
        values[..., :-1] *= values[..., -1:]
    values[0, ..., :-1] = 0.4  # light over a transparent pixel, which only glows
    stored = (values * scale).astype(dtype)
    path = tmp_path / "a.tif"
    photometric = "rgb" if channels == 4 else "minisblack"
    tifffile.imwrite(path, stored, photometric=photometric, extrasamples=[meaning])
    picture = read_picture(path)
    assert picture.premultiplied == (meaning == "assocalpha")
    copy = rewritten(path, picture)
    # Float32 divided and multiplied; whole codes come back as they were.
    atol = 1e-7 if dtype is np.float32 else 0
    np.testing.assert_allclose(tifffile.imread(copy), stored, atol=atol, rtol=0)
    with tifffile.TiffFile(path) as a, tifffile.TiffFile(copy) as b:
        assert a.pages.first.extrasamples == b.pages.first.extrasamples


def test_pages_are_refused_or_chosen_and_thumbnails_told(tmp_path: Path) -> None:
    path = CASES / "capture_pages/frame.tif"
    with pytest.raises(InputError, match="found 4 pages; choose a page with `part`"):
        read_picture(path)
    third = read_picture(path, linear=True, part="3")
    expected = tifffile.imread(path, key=2) / 65535
    np.testing.assert_allclose(third.linear[..., 0], expected, rtol=1e-6)
    assert third.notes == ("page 3 of 4 is read",)
    for wrong in ("0", "5", "left"):
        with pytest.raises(InputError, match="part: expected a page from 1 to 4"):
            read_picture(path, part=wrong)
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(SMOOTH, photometric="rgb")
        file.write(SMOOTH[::4, ::4], photometric="rgb", subfiletype=1)
    assert read_picture(tmp_path / "a.tif").notes == ("1 small copies in the file are left out",)


def test_planes_that_stand_apart(tmp_path: Path) -> None:
    tifffile.imwrite(
        tmp_path / "a.tif", np.moveaxis(SMOOTH, -1, 0), photometric="rgb", planarconfig="separate"
    )
    picture = read_picture(tmp_path / "a.tif")
    np.testing.assert_array_equal(picture.transfer.encoded(picture.linear), SMOOTH)


def test_exr_keeps_both_windows(tmp_path: Path) -> None:
    picture = read_picture(CASES / "exr/data_window.exr")
    copy = rewritten(tmp_path / "a.exr", picture)
    headers = []
    for path in (CASES / "exr/data_window.exr", copy):
        with OpenEXR.File(str(path), header_only=True) as file:
            windows = [file.header()[name] for name in ("dataWindow", "displayWindow")]
            headers.append(np.array(windows).tolist())
    assert headers[0] == headers[1] == [[[8, 5], [55, 52]], [[0, 0], [67, 63]]]
    np.testing.assert_array_equal(read_picture(copy).linear, picture.linear)


def test_parts_are_refused_or_chosen_by_name(tmp_path: Path) -> None:
    path = CASES / "exr/two_parts.exr"
    with pytest.raises(InputError, match="found parts left, right; choose one by its name"):
        read_picture(path)
    left, right = (read_picture(path, part=name) for name in ("left", "right"))
    np.testing.assert_allclose(right.linear, 0.5 * left.linear, rtol=1e-6)
    with pytest.raises(InputError, match="part: expected one of left, right, found middle"):
        read_picture(path, part="middle")
    mask = ["--mask", str(CASES / "exr/mask.png"), "--light", "0,0.5,1"]
    options = [*mask, "--out", str(tmp_path / "out"), "--part", "right"]
    result = CliRunner().invoke(filter_command, [str(path), *options])
    assert result.exit_code == 0, result.exception
    assert "part right is read" in result.output
    with pytest.raises(InputError, match="part: expected a file of several parts"):
        read_picture(CASES / "mpo/ball.jpg", part="right")


def write_exr(path: Path, channels: dict[str, object], **header: object) -> None:
    options = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    with OpenEXR.File(options, dict(channels)) as file:
        file.write(str(path))


@pytest.mark.parametrize("step", [1, 2])
def test_luminance_and_chroma_are_colour(tmp_path: Path, step: int) -> None:
    weights = np.array([0.2126, 0.7152, 0.0722])
    y, x = np.mgrid[:16, :24]
    rgb = np.stack([0.4 + 0.01 * x, 0.5 - 0.01 * y, 0.3 + 0 * x], axis=-1).astype(np.float32)
    luminance = (rgb @ weights).astype(np.float32)
    red, blue = (((rgb[..., i] - luminance) / luminance).astype(np.float32) for i in (0, 2))
    if step == 2:
        # OpenEXR's Python writer takes full planes and keeps every other pixel of the first rows.
        red, blue = (np.ascontiguousarray(c) for c in (red, blue))
    channels = {"Y": OpenEXR.Channel(luminance)}
    channels |= {n: OpenEXR.Channel(c, step, step) for n, c in (("RY", red), ("BY", blue))}
    write_exr(tmp_path / "a.exr", channels)
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        stored = {name: channel.pixels for name, channel in file.channels().items()}
    picture = read_picture(tmp_path / "a.exr")
    assert picture.linear.shape == (16, 24, 3)
    if step == 1:
        # Float32 of a quotient that is multiplied out again.
        np.testing.assert_allclose(picture.linear, rgb, atol=1e-6)
    sampled = picture.linear[::step, ::step]
    np.testing.assert_allclose(sampled @ weights, luminance[::step, ::step], atol=1e-6)
    back = sampled[..., 0] / luminance[::step, ::step] - 1
    np.testing.assert_allclose(back, stored["RY"], atol=1e-6)
    assert picture.notes == ("luminance and chroma are written as R, G, B",)
    again = read_picture(rewritten(tmp_path / "a.exr", picture))
    np.testing.assert_array_equal(again.linear, picture.linear)


def test_the_case_of_luminance_and_chroma() -> None:
    picture = read_picture(CASES / "exr/luminance_chroma.exr")
    with OpenEXR.File(str(CASES / "exr/luminance_chroma.exr"), separate_channels=True) as file:
        luminance = file.channels()["Y"].pixels
    np.testing.assert_allclose(
        picture.linear @ [0.2126, 0.7152, 0.0722], luminance, atol=1e-6, rtol=1e-5
    )
    assert np.ptp(picture.linear, axis=-1).max() > 0.1


def test_exr_alpha_is_divided_out_and_other_channels_go_through(tmp_path: Path) -> None:
    planes = {name: RNG.random((8, 9)).astype(np.float16) for name in ("R", "G", "B", "A", "Z")}
    planes["A"][0] = 0
    write_exr(tmp_path / "a.exr", planes, compression=OpenEXR.PIZ_COMPRESSION)
    picture = read_picture(tmp_path / "a.exr")
    alpha = planes["A"].astype(np.float32)
    expected = planes["R"] / np.where(alpha > 0, alpha, 1)
    np.testing.assert_allclose(picture.linear[..., 0], expected, rtol=1e-6)
    assert picture.notes == ("channels Z are written back as they are",)
    copy = rewritten(tmp_path / "a.exr", picture)
    with OpenEXR.File(str(copy), separate_channels=True) as file:
        assert file.header()["compression"] == OpenEXR.PIZ_COMPRESSION
        for name, plane in planes.items():
            pixels = file.channels()[name].pixels
            assert pixels.dtype == np.float16
            np.testing.assert_array_equal(pixels, plane)


def test_half_floats_do_not_overflow(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", {"Y": np.full((8, 9), 60000, np.float16)})
    picture = read_picture(tmp_path / "a.exr")
    copy = rewritten(tmp_path / "a.exr", picture.with_light(2 * picture.linear))
    assert read_picture(copy).linear.max() == np.finfo(np.float16).max


def test_tiles_are_read_and_levels_of_detail_told(tmp_path: Path) -> None:
    plane = RNG.random((64, 64)).astype(np.float32)
    for mode in (OpenEXR.ONE_LEVEL, OpenEXR.MIPMAP_LEVELS):
        tiles = OpenEXR.TileDescription()
        tiles.xSize = tiles.ySize = 16
        tiles.mode = mode
        write_exr(tmp_path / "a.exr", {"Y": plane}, type=OpenEXR.tiledimage, tiles=tiles)
        if mode == OpenEXR.ONE_LEVEL:
            np.testing.assert_array_equal(read_picture(tmp_path / "a.exr").linear[..., 0], plane)
            continue
        # OpenEXR's Python writer leaves the smaller levels out, and its reader gives up then.
        with pytest.raises(InputError, match="pixels that cannot be read"):
            read_picture(tmp_path / "a.exr")


def test_layers_are_refused_or_chosen_by_name(tmp_path: Path) -> None:
    layers = {
        f"{layer}.{name}": np.full((8, 9), value, np.float32)
        for layer, value in (("left", 0.2), ("right", 0.4))
        for name in ("R", "G", "B", "A")
    }
    path = tmp_path / "a.exr"
    write_exr(path, layers)
    with pytest.raises(InputError, match="found layers left, right"):
        read_picture(path)
    with pytest.raises(InputError, match="part: expected a layer of left, right, found middle"):
        read_picture(path, part="middle")
    picture = read_picture(path, part="right")
    np.testing.assert_allclose(picture.linear, 1.0)  # 0.4 of light under 0.4 of opacity
    copy = rewritten(path, picture)
    with OpenEXR.File(str(copy), separate_channels=True) as file:
        written = {name: channel.pixels for name, channel in file.channels().items()}
    assert set(written) == set(layers)
    for name, plane in layers.items():
        np.testing.assert_allclose(written[name], plane, rtol=1e-6)
    write_exr(path, {name: plane for name, plane in layers.items() if name.startswith("left")})
    assert read_picture(path).linear.shape == (8, 9, 3)


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


def test_a_linear_avif_is_linear(tmp_path: Path) -> None:
    codes = np.ascontiguousarray(SMOOTH)
    data = imagecodecs.avif_encode(codes, level=100, transfer=8)
    (tmp_path / "a.avif").write_bytes(data)
    picture = read_picture(tmp_path / "a.avif")
    np.testing.assert_allclose(picture.linear, codes / 255, atol=1.01 / 255)
    again = read_picture(rewritten(tmp_path / "a.avif", picture))
    assert again.kind == "PNG"
    np.testing.assert_allclose(again.linear, picture.linear, atol=1e-6)


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
