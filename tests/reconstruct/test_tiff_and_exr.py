"""TIFF and OpenEXR as other programs write them: opacity, pages, parts, layers, windows, chroma."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import PIL.Image
import pytest
import tifffile
from click.testing import CliRunner
from pictures import SMOOTH, rewritten

from malus.bench.commands.filter import filter_command
from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.read_picture import read_picture
from malus.scenes import InputError

CASES = Path(__file__).parents[1] / "cases"
RNG = np.random.default_rng(0)


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


@pytest.mark.parametrize(
    ("dtype", "photometric", "told"),
    [
        ("int16", "minisblack", "found int16; write it as uint16 or float32"),
        ("uint32", "rgb", "found uint32; write it as uint16 or float32"),
        ("uint8", "miniswhite", "found MINISWHITE; save it with 0 for black"),
    ],
)
def test_what_to_do_about_other_numbers_is_told(
    tmp_path: Path, dtype: str, photometric: str, told: str
) -> None:
    """To convert grey codes to RGB mends none of them."""
    shape = (8, 8, 3) if photometric == "rgb" else (8, 8)
    tifffile.imwrite(tmp_path / "a.tif", np.ones(shape, dtype), photometric=photometric)
    with pytest.raises(InputError, match=told):
        read_picture(tmp_path / "a.tif")


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


@pytest.mark.parametrize("coding", ["utf-8", "cp1252"])
def test_names_in_every_alphabet_go_out_as_they_came_in(tmp_path: Path, coding: str) -> None:
    """Programs write them as UTF-8, and older ones in the code page of Windows."""
    path, texts = tmp_path / "a.tif", {270: "Größe", 271: "Gerät", 315: "Jürgen", 33432: "© Müller"}
    tags = [(code, 2, None, text.encode(coding), True) for code, text in texts.items()]
    tifffile.imwrite(path, SMOOTH, photometric="rgb", metadata=None, extratags=tags)
    copy = rewritten(path, read_picture(path))
    with tifffile.TiffFile(copy) as file:
        assert {code: file.pages.first.tags[code].value for code in texts} == texts
    np.testing.assert_array_equal(tifffile.imread(copy), SMOOTH)


def test_an_unknown_unit_of_resolution_is_none(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    PIL.Image.fromarray(SMOOTH).save(path, tiffinfo={282: 72.0, 283: 72.0, 296: 9})
    with tifffile.TiffFile(rewritten(path, read_picture(path))) as file:
        assert file.pages.first.tags[296].value == 1


def test_what_a_tiff_loses_is_told(tmp_path: Path) -> None:
    tags = [(700, 1, None, b"<x:xmpmeta/>", True)]
    tifffile.imwrite(tmp_path / "a.tif", SMOOTH, photometric="rgb", extratags=tags)
    assert read_picture(tmp_path / "a.tif").notes == ("XMP and captions after IPTC are left out",)


def test_channels_that_are_no_colours(tmp_path: Path) -> None:
    """Four angles of a polariser are no red, green, blue and opacity."""
    path, options = tmp_path / "a.tif", {"photometric": "minisblack", "planarconfig": "contig"}
    tifffile.imwrite(path, np.dstack([SMOOTH, SMOOTH[..., 0]]), **options)
    with pytest.raises(InputError, match="found four channels of grey; write RGB"):
        read_picture(path)
    assert len(read_capture(path, angles=(0, 45, 90, 135)).pictures) == 4
    tifffile.imwrite(path, SMOOTH, **options)
    assert "taken for red, green and blue" in read_picture(path).notes[0]
    tifffile.imwrite(path, SMOOTH.astype(np.float64), photometric="rgb")
    with pytest.raises(InputError, match="found float64; write it as float32"):
        read_picture(path)
