"""The virtual filter: pictures in and out, what goes through it, and bad input."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import PIL.Image
import PIL.ImageCms
import pytest
import tifffile
from click.testing import CliRunner
from matplotlib import colormaps
from pictures import dome, saved_dome

from malus.bench.commands.filter import filter_command
from malus.reconstruct import Components
from malus.reconstruct.photos import filter as filter_module
from malus.reconstruct.photos.estimate import estimate
from malus.reconstruct.photos.filter import FilterOutput, filter_picture, polarised
from malus.reconstruct.photos.knowledge import PRESETS, Knowledge, read_knowledge
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.read_picture import read_picture
from malus.reconstruct.photos.tone_curves import linear_transfer, srgb_transfer
from malus.reconstruct.single_image import shape
from malus.reconstruct.single_image.shading import diffuse_shading
from malus.scenes import InputError, polarisation

RNG = np.random.default_rng(0)
CODES_8 = RNG.integers(0, 256, (12, 18, 3), dtype=np.uint8)


@pytest.mark.parametrize("light", [None, (1.0, 1.0, 2.0)])
def test_crossed_angles_add_up_to_the_picture(
    tmp_path: Path, light: tuple[float, float, float] | None
) -> None:
    linear, normals = dome()
    picture = Picture(linear, "EXR", None)
    knowledge = Knowledge(normals=normals, light=light)
    angles = (20.0, 110.0)
    done = filter_picture(
        picture, tmp_path, knowledge, FilterOutput(angles, physical=True), stem="d"
    )
    crossed = sum(read_picture(tmp_path / f"d_angle{a:03.0f}.exr").linear for a in angles)
    np.testing.assert_allclose(crossed, linear, rtol=1e-5, atol=1e-6)
    i_max, i_min = (read_picture(tmp_path / f"d_i{k}.exr").linear for k in ("max", "min"))
    np.testing.assert_allclose(i_max + i_min, linear, rtol=1e-5, atol=1e-6)
    assert (i_max - i_min)[normals[..., 2] > 0].max() > 0.01
    assert not (i_max - i_min)[normals[..., 2] == 0].any()
    assert len(done.files) == 7


@pytest.mark.parametrize("suffix", ["exr", "tif"])
def test_floats_below_zero_go_through_the_filter(tmp_path: Path, suffix: str) -> None:
    """Noise around black, and colours beyond the primaries."""
    light = (RNG.random((12, 18, 3)) - 0.3).astype(np.float32)
    kind = {"exr": "EXR", "tif": "TIFF"}[suffix]
    unpolarised = Knowledge(method="unpolarised")
    for physical, gain in ((False, 1.0), (True, 0.5)):
        output = FilterOutput((30.0,), physical=physical)
        filter_picture(Picture(light, kind, None), tmp_path, unpolarised, output, stem="a")
        written = read_picture(tmp_path / f"a_angle030.{suffix}").linear
        np.testing.assert_array_equal(written, gain * light)


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 45.0, 100.0, 180.0])
def test_the_light_through_a_polariser_is_equation_1(angle_deg: float) -> None:
    planes = np.random.default_rng(1).random((3, 5, 5, 3))
    expected = polarisation.polarised(np.moveaxis(planes, 0, -1), angle_deg)
    np.testing.assert_allclose(polarised(Components(*planes), angle_deg), expected, atol=1e-12)


def test_a_filter_takes_glare_of_water_away_at_brewsters_angle(tmp_path: Path) -> None:
    brewster = np.arctan(1.333)
    normal = [0.0, np.sin(brewster), np.cos(brewster)]
    normals = np.tile(np.array(normal, np.float32), (6, 6, 1))
    picture = Picture(np.full((6, 6, 3), 0.4, np.float32), "EXR", None)
    knowledge = Knowledge(normals, eta=1.333, alpha=0.01, mirror=True)
    filter_picture(picture, tmp_path, knowledge, FilterOutput((0.0, 90.0), physical=True), stem="w")
    # Light from a level surface swings horizontally, so that a vertical filter stops it.
    assert read_picture(tmp_path / "w_angle000.exr").linear.max() < 0.004
    assert read_picture(tmp_path / "w_angle090.exr").linear.min() > 0.396


def test_maps_of_an_earlier_estimate_go(tmp_path: Path) -> None:
    normals = np.tile(np.array([0, 0.6, 0.8], np.float32), (6, 6, 1))
    picture = Picture(np.full((6, 6, 3), 0.4, np.float32), "EXR", None)
    knowledge = Knowledge(normals, eta=1.333, alpha=0.01, mirror=True)
    for name in ("w_uncertainty.png", "w_sweep.gif", "other_uncertainty.png", "w_notes.txt"):
        (tmp_path / name).write_bytes(b"before")
    filter_picture(picture, tmp_path, knowledge, stem="w")
    kept = {path.name for path in tmp_path.iterdir() if path.read_bytes() == b"before"}
    assert kept == {"other_uncertainty.png", "w_notes.txt"}
    assert not list(tmp_path.glob("w_uncertainty*")) + list(tmp_path.glob("w_sweep*"))


def test_two_angles_of_one_name_are_refused(tmp_path: Path) -> None:
    """One file would be lost; 0° and 180° are the same picture."""
    normals = np.tile(np.array([0, 0.6, 0.8], np.float32), (6, 6, 1))
    picture = Picture(np.full((6, 6, 3), 0.4, np.float32), "EXR", None)
    knowledge = Knowledge(normals, eta=1.333, alpha=0.01, mirror=True)
    with pytest.raises(InputError, match=r"two that are called angle045\.12"):
        filter_picture(picture, tmp_path / "out", knowledge, FilterOutput((45.121, 45.124)))
    assert not (tmp_path / "out").exists()
    filter_picture(picture, tmp_path / "out", knowledge, FilterOutput((0.0, 180.0)), stem="w")


def test_the_command_writes_the_pictures_own_form(tmp_path: Path) -> None:
    path, normals = saved_dome(tmp_path)
    out = tmp_path / "out"
    arguments = [str(path), "--normals", str(normals), "--angle", "60", "--sweep"]
    result = CliRunner().invoke(filter_command, [*arguments, "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert {p.name for p in out.iterdir()} == {
        f"dome_{name}" for name in ("angle060.png", "imax.png", "imin.png", "dolp.png", "aolp.png",
                                    "sheet.png", "sweep.gif")
    }  # fmt: skip
    with PIL.Image.open(out / "dome_angle060.png") as image:
        assert (image.mode, image.size) == ("RGB", (64, 64))
    with PIL.Image.open(out / "dome_dolp.png") as image:
        assert image.mode.startswith("I;16")
    assert "taken for sRGB" in result.output


def test_a_search_that_failed_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, normals = saved_dome(tmp_path)
    mask = tmp_path / "mask.png"
    PIL.Image.fromarray((np.load(normals)[..., 2] > 0).astype(np.uint8) * 255).save(mask)
    monkeypatch.setattr(shape, "_STEPS", 2)
    arguments = [str(path), "--mask", str(mask), "--light", "1,1,2", "--out", str(tmp_path / "o")]
    result = CliRunner().invoke(filter_command, arguments)
    assert result.exit_code == 0, result.output
    assert "warning: the search for a shape did not converge" in result.stderr


def test_an_undecided_body_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    light, (_, normals) = np.array([1, 1, 2]) / np.sqrt(6), dome()
    inside = normals[..., 2] > 0
    linear = np.zeros((*inside.shape, 3))
    linear[inside] = 0.5 * diffuse_shading(normals[inside], light, "polarised", 1.5)[:, None]
    PIL.Image.fromarray(srgb_transfer(8).encoded(linear)).save(tmp_path / "dome.png")
    PIL.Image.fromarray(inside.astype(np.uint8) * 255).save(tmp_path / "mask.png")
    monkeypatch.setattr(shape, "UNDECIDED", np.inf)
    files = [str(tmp_path / name) for name in ("dome.png", "mask.png", "out")]
    arguments = [files[0], "--mask", files[1], "--light", "1,1,2", "--out", files[2]]
    result = CliRunner().invoke(filter_command, arguments)
    assert result.exit_code == 0, result.output
    assert result.stderr.count("warning: the body is undecided and taken for unpolarised") == 1
    assert "body taken for unpolarised" in result.stdout


def test_a_coloured_light_changes_no_degree_of_polarisation() -> None:
    """Gray World takes the tint for the light's: s1 and s2 of a channel scale as its light does."""
    linear, normals = dome(32)
    white = linear / linear[normals[..., 2] > 0].mean(axis=0)
    tint = np.array([1.5, 0.9, 0.6], np.float32)
    told = Knowledge(normals, eta=1.5, alpha=0.2, mirror=True, illuminant="gray-world")
    plain, tinted = (estimate(light, told, "dome").components for light in (white, white * tint))
    for one, other in ((plain.s1, tinted.s1), (plain.s2, tinted.s2)):
        assert np.abs(one).max() > 0.1
        np.testing.assert_allclose(other, one * tint, atol=1e-6 * np.abs(one).max())  # float32


def test_exposure_makes_up_for_one_stop(tmp_path: Path) -> None:
    linear, normals = dome()
    picture = Picture(linear, "EXR", None)
    for physical in (False, True):
        output = FilterOutput((0.0,), physical=physical)
        filter_picture(picture, tmp_path, Knowledge(normals), output, stem=f"{physical}")
    bright, dim = (read_picture(tmp_path / f"{p}_angle000.exr").linear for p in (False, True))
    np.testing.assert_allclose(bright, 2 * dim, rtol=1e-6)


def test_the_sheet_shows_degree_and_angle_in_their_colours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A turn by 180° is one round of the colours; light that is not polarised has no angle."""
    shown: dict[str, np.ndarray] = {}

    def keep(path: Path, thumbnails: list[tuple[str, np.ndarray]], _: list[str]) -> None:
        shown.update(thumbnails)
        path.touch()

    monkeypatch.setattr(filter_module, "write_sheet", keep)
    linear, normals = dome()
    filter_picture(Picture(linear, "EXR", None), tmp_path, Knowledge(normals), stem="d")
    dolp, aolp = (
        np.asarray(PIL.Image.open(tmp_path / f"d_{name}.png")) / 65536 for name in ("dolp", "aolp")
    )
    polarised_enough = dolp > 0.01
    assert np.ptp(aolp[polarised_enough]) > 0.9
    for tile, values, colours in (
        ("dolp 0 to 1", dolp, "viridis"),
        ("aolp 0 to 180°", aolp, "twilight"),
    ):
        expected = 255 * colormaps[colours](values)[..., :3]
        # Colours of 256 steps, of values that were stored in 65536.
        off = np.abs(shown[tile] - expected)[polarised_enough]
        assert np.median(off) < 1
        assert off.max() < 6, tile
    assert (shown["aolp 0 to 180°"][dolp == 0] == 128).all()


def huge_png() -> bytes:
    """The header of a picture of 100 megapixels, and hardly a pixel."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    header = struct.pack(">IIBBBBB", 20000, 5000, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b"")
    )  # fmt: skip


def bad_pictures(folder: Path) -> dict[str, str]:
    """Pictures that cannot be filtered, and a word of each complaint."""
    PIL.Image.fromarray(CODES_8).convert("CMYK").save(folder / "cmyk.jpg")
    PIL.Image.fromarray(CODES_8).convert("1").save(folder / "bit.png")
    PIL.Image.fromarray(CODES_8).convert("P").save(folder / "palette.png")
    PIL.Image.fromarray(0 * CODES_8).save(folder / "dark.png")
    PIL.Image.fromarray(CODES_8[:1, :1]).save(folder / "pixel.png")
    tifffile.imwrite(folder / "float64.tif", RNG.random((4, 4, 3)), photometric="rgb")
    tifffile.imwrite(folder / "nan.tif", np.full((4, 4), np.nan, np.float32))
    data = io.BytesIO()
    PIL.Image.fromarray(np.tile(CODES_8, (20, 20, 1))).save(data, "JPEG")
    (folder / "cut.jpg").write_bytes(data.getvalue()[:9000])
    (folder / "cut.tif").write_bytes(b"II*\0\x08\0\0\0\xff")
    (folder / "cut.exr").write_bytes(b"v/1\x01 nothing")
    (folder / "text.png").write_text("not a picture")
    (folder / "huge.png").write_bytes(huge_png())
    return {
        "cmyk.jpg": "CMYK", "bit.png": "1 bit", "palette.png": "palette", "dark.png": "all-dark",
        "pixel.png": "too few", "float64.tif": "float64", "nan.tif": "finite", "cut.jpg": "whole",
        "cut.tif": "whole", "cut.exr": "whole", "text.png": "whole", "huge.png": "100 megapixels",
        "none.png": "no such file", "photo.webp": ".webp",
    }  # fmt: skip


@pytest.mark.usefixtures("stand_in_net")
def test_bad_pictures_end_in_one_line_and_no_output(tmp_path: Path) -> None:
    for name, word in bad_pictures(tmp_path).items():
        out = tmp_path / "out"
        result = CliRunner().invoke(filter_command, [str(tmp_path / name), "--out", str(out)])
        assert isinstance(result.exception, InputError), (name, result.exception)
        line = str(result.exception)
        assert word in line, line
        assert "\n" not in line
        assert not out.exists(), name


def test_bad_options_end_in_one_line_and_no_output(tmp_path: Path) -> None:
    path, normals = saved_dome(tmp_path)
    PIL.Image.fromarray(CODES_8).save(tmp_path / "small.png")
    PIL.Image.new("L", (64, 64)).save(tmp_path / "empty.png")
    PIL.Image.new("L", (64, 64), 2).save(tmp_path / "labels.png")
    np.save(tmp_path / "flat.npy", np.zeros((64, 64)))
    grey = tmp_path / "grey.png"
    PIL.Image.fromarray(np.asarray(PIL.Image.open(path).convert("L"))).save(grey)
    good = ["--normals", str(normals)]
    cases = [
        (path, ["--mask", str(tmp_path / "small.png")], "64 x 64"),
        (path, ["--mask", str(tmp_path / "empty.png")], "an object"),
        (path, ["--mask", str(tmp_path / "labels.png")], "of several objects are --labels"),
        (path, ["--normals", str(tmp_path / "small.png")], "64 x 64"),
        (path, ["--normals", str(tmp_path / "flat.npy")], "three values"),
        (path, [*good, "--alpha", "7"], "(0, 1]"),
        (path, [*good, "--preset", "wood"], "plastic"),
        (path, [*good, "--material", "unobtainium"], "material"),
        (path, [*good, "--light", "0,0,0"], "not zero"),
        (path, ["--preset", "water"], "no --normals"),
        (path, [*good, "--preset", "glass", "--light", "0,0,1"], "no --light"),
        (path, [*good, "--angle", "nan"], "degrees"),
        (grey, good, "grey image where colour is needed"),
        (path, ["--method", "blind"], "no outline"),
        (path, ["--net-size", "0"], "--net-size: expected a number of pixels"),
        (path, [*good, "--net-size", "64"], "--net-size: expected the method net"),
    ]
    for picture, options, word in cases:
        out = tmp_path / "out"
        result = CliRunner().invoke(filter_command, [str(picture), *options, "--out", str(out)])
        assert isinstance(result.exception, InputError), (options, result.exception)
        assert word in str(result.exception), str(result.exception)
        assert not out.exists()


@pytest.mark.parametrize("value", [0.0, np.nan, -1.0])
def test_normals_of_which_none_is_one_are_told_by_their_file(tmp_path: Path, value: float) -> None:
    """The picture is not to blame: it would be called dark."""
    path, normals = saved_dome(tmp_path)
    np.save(normals, np.full((*dome()[0].shape[:2], 3), value))
    result = CliRunner().invoke(filter_command, [str(path), "--normals", str(normals)])
    assert "normals.npy: expected unit vectors, z towards the camera" in str(result.exception)


def test_a_failure_half_way_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    linear, normals = dome()

    def broken(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("malus.reconstruct.photos.filter._maps", broken)
    picture = Picture(linear, "EXR", None)
    with pytest.raises(KeyboardInterrupt):
        filter_picture(picture, tmp_path / "out", Knowledge(normals))
    assert not (tmp_path / "out").exists()


def test_clipped_highlights_are_told(tmp_path: Path) -> None:
    linear, normals = dome()
    table = linear_transfer(8)
    codes = table.encoded(3 * linear)
    picture = Picture(table.linear(codes), "PNG", table)
    done = filter_picture(picture, tmp_path, Knowledge(normals, light=(1, 1, 2)))
    assert any("clipped" in warning for warning in done.warnings)
    white = Picture(np.ones_like(linear), "PNG", table)
    with pytest.raises(InputError, match="expected light that is not clipped"):
        filter_picture(white, tmp_path / "w", Knowledge(normals))


@pytest.mark.parametrize("separation", ["ratio", "suv", "chromaticity"])
def test_every_separation_serves_a_picture_of_surrounding_light(separation: str) -> None:
    linear, normals = dome()
    picture = Picture(linear, "EXR", None)
    filtered = filter_picture(picture, knowledge=Knowledge(normals, separation=separation))
    assert filtered.files == ()
    specular = np.hypot(filtered.components.s1, filtered.components.s2)
    assert specular[normals[..., 2] > 0].max() > 0.01


def test_what_a_named_method_lacks_is_told_once_and_nothing_else_is_asked_for() -> None:
    """Every object lacks the same, and a light would not help a method that needs none."""
    labels = np.repeat([1, 2, 3], 4)[:, None] * np.ones((1, 8), int)
    knowledge = Knowledge(labels=labels, method="eq8")
    picture = Picture(RNG.random((12, 8, 3)).astype(np.float32), "PNG", None)
    with pytest.raises(InputError, match=r"found normals is not known; give `normals`$"):
        filter_picture(picture, None, knowledge)


def test_unknown_names_are_refused() -> None:
    with pytest.raises(InputError, match=r"separation: expected .*, found 'x'; known: .*suv"):
        Knowledge(separation="x")
    with pytest.raises(InputError, match=r"illuminant: expected .*; known: neutral"):
        Knowledge(illuminant="x")


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_presets_are_physical(name: str, tmp_path: Path) -> None:
    np.save(tmp_path / "n.npy", np.tile(np.array([0, 0, 1.0]), (4, 4, 1)))
    knowledge = read_knowledge((4, 4), normals=tmp_path / "n.npy", preset=name)
    assert 1 < knowledge.eta < 2
    assert 0 < knowledge.alpha <= 1
