"""Captures as people have them: names, units, levels, stacks, and what other programs write.

The small captures in tests/cases were made after public bug reports. In all of them the degree of
polarisation is 0.3 and its angle 20° from the horizontal, wherever a pixel is not clipped.
"""

from __future__ import annotations

import json
import re
import shutil
import tracemalloc
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import tifffile
from click.testing import CliRunner

from malus.bench.commands.capture import capture_command
from malus.bench.datasets.export import write_numpy, write_png, write_polanalyser
from malus.reconstruct.photos.capture import Capture, read_capture
from malus.reconstruct.photos.capture_angles import angles_in_names
from malus.reconstruct.photos.capture_fit import CaptureFit, fit_capture
from malus.renderers import render
from malus.scenes import Camera, Dielectric, Distant, InputError, Scene, Sphere, polarisation

CASES = Path(__file__).parents[1] / "cases"
ROUNDING = 5e-4
"""In degree of polarisation: the smallest codes, 2000, are rounded by 2.5e-4, and four are used."""


def fitted(name: str, **options: object) -> tuple[Capture, CaptureFit]:
    """A capture of tests/cases: angles count from the horizontal, codes are light."""
    capture = read_capture(CASES / name, **{"zero": "horizontal", "linear": True, **options})
    return capture, fit_capture(capture)


def assert_is_right(capture: Capture, fit: CaptureFit) -> None:
    stokes = fit.stokes[~capture.clipped]
    np.testing.assert_allclose(polarisation.dolp(stokes), 0.3, atol=ROUNDING)
    # An error of the degree turns the angle by half of it over the degree.
    angle = np.degrees(polarisation.aolp(stokes))
    np.testing.assert_allclose(angle, 20.0, atol=np.degrees(ROUNDING / 0.3))


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("capture_angle_first", {}),
        ("capture_frame_last", {}),
        ("capture_bits_in_name", {}),
        ("capture_negative", {}),
        ("capture_radians", {"unit": "radians"}),
        ("capture_pages/frame.tif", {"angles": (0, 45, 90, 135)}),
        ("capture_polanalyser", {}),
        ("capture_polanalyser", {"zero": None, "linear": False}),  # as its own layout says
        ("capture_dark_offset", {"black": 0.2}),
        ("capture_dark_offset", {"black": 13107}),
    ],
)
def test_cases_are_read_right(name: str, options: dict[str, object]) -> None:
    capture, fit = fitted(name, **options)
    assert not capture.clipped.any()
    assert_is_right(capture, fit)
    assert fit.warnings == ()


@pytest.mark.parametrize("white", [None, 4095])
def test_saturation_below_the_largest_code(white: float | None) -> None:
    capture, fit = fitted("capture_saturated_12bit", white=white)
    codes = np.stack([np.asarray(PIL.Image.open(path)) for path in files("saturated_12bit")])
    np.testing.assert_array_equal(capture.clipped, (codes == 4095).any(axis=0))
    assert_is_right(capture, fit)
    assert any("clipped" in warning for warning in fit.warnings)
    assert any("pile up" in hint for hint in capture.hints) == (white is None)
    assert capture.pictures.max() == pytest.approx(4095 / 65535 if white is None else 1.0)


def files(name: str) -> list[Path]:
    return sorted((CASES / f"capture_{name}").iterdir())


@pytest.mark.parametrize(("end", "factor"), [(1023, 1), (4095, 1), (16383, 1), (4095, 16)])
def test_a_few_pixels_at_the_end_of_fewer_bits(tmp_path: Path, end: int, factor: int) -> None:
    codes = np.random.default_rng(0).integers(100, end - 100, (4, 32, 32))
    codes[1, 4, 5:8] = end
    for angle, picture in zip((0, 45, 90, 135), codes * factor, strict=True):
        PIL.Image.fromarray(picture.astype(np.uint16)).save(tmp_path / f"p{angle}.png")
    capture = read_capture(tmp_path, linear=True)
    assert capture.clipped.sum() == 3
    codes[1, 4, 5:8] = end - 1
    for angle, picture in zip((0, 45, 90, 135), codes * factor, strict=True):
        PIL.Image.fromarray(picture.astype(np.uint16)).save(tmp_path / f"p{angle}.png")
    assert not read_capture(tmp_path, linear=True).clipped.any()


def test_a_smooth_picture_does_not_pile_up() -> None:
    """Neither at its brightest, nor where a part of it is flat."""
    capture, _ = fitted("capture_angle_first")
    assert not any("pile up" in hint for hint in capture.hints)


def test_a_dark_level_is_hinted_at_or_taken_from_dark_frames(tmp_path: Path) -> None:
    capture, fit = fitted("capture_dark_offset")
    assert any("give it as `black`" in hint for hint in capture.hints)
    assert float(np.median(polarisation.dolp(fit.stokes))) == pytest.approx(0.149, abs=1e-3)
    folder = tmp_path / "dark"
    folder.mkdir()
    for i, code in enumerate((13106, 13108)):
        dark = np.full((24, 24), code, np.uint16)
        PIL.Image.fromarray(dark).save(folder / f"dark{i}.png")
    for black in (folder, str(folder / "dark0.png")):
        capture, fit = fitted("capture_dark_offset", black=black)
        assert_is_right(capture, fit)
        assert capture.hints == ()


def test_a_dark_frame_beside_the_pictures_is_none_of_them(tmp_path: Path) -> None:
    folder = tmp_path / "capture"
    shutil.copytree(CASES / "capture_dark_offset", folder)
    PIL.Image.fromarray(np.full((24, 24), 13107, np.uint16)).save(folder / "dark_360.png")
    capture = read_capture(folder, "horizontal", linear=True, black=folder / "dark_360.png")
    assert len(capture.names) == 4
    assert_is_right(capture, fit_capture(capture))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"black": -1}, "black: expected a level that is not negative"),
        ({"white": 70000}, "white: expected a code of at most 65535"),
        ({"black": 0.5, "white": 0.4}, "white: expected a level above black"),
        ({"black": "none.png"}, "no such file"),
        ({"black": ""}, "black: expected a level, or a dark frame's path, found an empty text"),
        ({"angles": (0, 45, 90)}, "angles: expected 4 angles, one a picture, found 3"),
        ({"angles": (0, 1, 2, 3)}, "are they radians"),
        ({"angles": (0, 90, 180, 270)}, "three or more angles"),
        ({"bayer": "rggb"}, "mosaic: expected the four angles of a frame, found bayer without"),
        ({"size": (24, 24), "packing": "mono8"}, "found size and packing without it"),
    ],
)
def test_bad_options_are_named(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        fitted("capture_angle_first", **options)


def test_radians_are_asked_for_and_never_guessed() -> None:
    with pytest.raises(InputError, match=r"0, 0.7854, 1.5708, 2.3562; are they radians\?"):
        fitted("capture_radians")
    small, _ = fitted("capture_radians", unit="degrees")
    assert small.angles_deg[1] == pytest.approx(0.7854 - 90)


@pytest.mark.parametrize("unit", [None, "radians"])
def test_radians_in_angles_json(tmp_path: Path, unit: str | None) -> None:
    for path in files("angle_first"):
        shutil.copy(path, tmp_path)
    stated = {path.name: np.radians(float(path.stem.split("_")[0])) for path in tmp_path.iterdir()}
    (tmp_path / "angles.json").write_text(json.dumps(stated))
    if unit is None:
        with pytest.raises(InputError, match="are they radians"):
            read_capture(tmp_path, "horizontal", linear=True)
    else:
        capture = read_capture(tmp_path, "horizontal", linear=True, unit=unit)
        assert_is_right(capture, fit_capture(capture))


@pytest.mark.parametrize(
    ("names", "angles"),
    [
        ("0_1 45_1 90_1", (0, 45, 90)),
        ("I0_frame7 I45_frame8 I90_frame9", (0, 45, 90)),
        ("0001_0 0002_60 0003_120", (0, 60, 120)),
        ("img_10_0 img_11_45 img_12_90 img_13_135", (0, 45, 90, 135)),
        ("scene2_0_12bit scene2_45_12bit scene2_90_12bit", (0, 45, 90)),
        ("exp10_0 exp20_45 exp30_90 exp40_135", (0, 45, 90, 135)),
        ("cup_f2.8_0_iso100 cup_f2.8_45_iso100 cup_f2.8_90_iso100", (0, 45, 90)),
        ("20240101_120000_0 20240101_120005_45 20240101_120010_90", (0, 45, 90)),
        ("2024-05-01_0 2024-05-01_45 2024-05-01_90", (0, 45, 90)),
        ("pol_22.5 pol_67.5 pol_112.5", (22.5, 67.5, 112.5)),
        ("pol_22,5 pol_0 pol_67,5", (22.5, 0, 67.5)),
        ("pol_22p5deg pol_0deg pol_67p5deg", (22.5, 0, 67.5)),
        ("3_0 3_22,5 3_45 3_67,5", (0, 22.5, 45, 67.5)),
        ("1,0 1,45 1,90 1,135", (0, 45, 90, 135)),
        ("2.0 2.45 2.90 2.135", (0, 45, 90, 135)),
        ("pol_-45 pol_0 pol_45 pol_90", (-45, 0, 45, 90)),
        ("pol_+45 pol_-45 pol_0", (45, -45, 0)),
        ("pol-45 pol0 pol45", (-45, 0, 45)),
        ("pol-0 pol-45 pol-90", (0, 45, 90)),
        ("minus45 0 plus45", (-45, 0, 45)),
        ("a_m45 a_0 a_p45", (-45, 0, 45)),
        ("−45° 0° 45°", (-45, 0, 45)),
        ("-22,5_b 22,5_b 67,5_b", (-22.5, 22.5, 67.5)),
        ("I0 I45_b2 I90", (0, 45, 90)),
        ("a0 a10 a20 a30", (0, 10, 20, 30)),
        ("a0_1 a60_1 a120_1 a90_2", (0, 60, 120, 90)),  # taken again
        ("a_0_5 a_22_5 a_45_5 a_67_5", (0, 22, 45, 67)),
        ("a_22_7 a_67_7 a_112_7", (22, 67, 112)),
    ],
)
def test_the_angle_is_the_number_that_varies(names: str, angles: tuple[float, ...]) -> None:
    written = [f"{name}.png" for name in names.split()]
    assert tuple(angles_in_names(Path("x"), written).values()) == angles


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("DSC_0101 DSC_0102 DSC_0103 DSC_0104", "only count pictures"),
        ("image0 image1 image2 image3", "only count pictures"),
        ("0_90 45_135 90_180 135_225", "one number in the names that can be the angle"),
        ("s1_0 s1_60 s1_120 s2_0 s2_60 s2_120", "one scene, found 2 sets"),
        ("000_000 000_045 000_090 000_135 000_rgb", "000_rgb.png: expected pictures of one set"),
        ("a b c", "no number"),
        ("pol_0 pol_45 pol_90 dark_1", "a dark or flat frame, by its name; give it as `black`"),
        ("a0 a90 a180", "three or more angles"),
        ("pol_0 pol_22_5 pol_45 pol_67_5", "found 22_5; write 22.5"),
        ("0_0deg 22_5deg 45_0deg 67_5deg", "found 22_5; write 22.5"),
        ("a22-5 a67-5 a112-5 a157-5", "found 22-5; write 22.5"),
    ],
)
def test_names_that_tell_no_angle_are_refused(names: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        angles_in_names(Path("x"), [f"{name}.png" for name in names.split()])


def test_the_same_picture_in_two_formats_is_not_taken_twice() -> None:
    names = [f"p{angle}.{suffix}" for angle in (0, 60, 120) for suffix in ("jpg", "png")]
    with pytest.raises(InputError, match="found 2 sets"):
        angles_in_names(Path("x"), names)


def pages() -> np.ndarray:
    return tifffile.imread(CASES / "capture_pages/frame.tif", key=range(4))


@pytest.mark.parametrize("trailing", [False, True])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32, np.float64, np.int32])
def test_arrays(tmp_path: Path, dtype: type, trailing: bool) -> None:
    stack = np.moveaxis(pages(), 0, -1) if trailing else pages()
    np.save(tmp_path / "stack.npy", stack.astype(dtype))
    capture = read_capture(tmp_path / "stack.npy", "horizontal", angles=(0, 45, 90, 135))
    assert_is_right(capture, fit_capture(capture))
    for angle, page in zip((0, 45, 90, 135), pages(), strict=True):
        np.save(tmp_path / f"pol_{angle}.npy", page.astype(dtype))
    (tmp_path / "stack.npy").unlink()
    capture = read_capture(tmp_path, "horizontal")
    assert_is_right(capture, fit_capture(capture))


def test_colour_pages(tmp_path: Path) -> None:
    colour = np.repeat(pages()[..., None], 3, axis=-1)
    tifffile.imwrite(tmp_path / "a.tif", colour, photometric="rgb")
    angles = (0, 45, 90, 135)
    capture = read_capture(tmp_path / "a.tif", "horizontal", linear=True, angles=angles)
    assert capture.pictures.shape == (4, 24, 24, 3)
    assert_is_right(capture, fit_capture(capture))


@pytest.mark.parametrize("planarconfig", ["contig", "separate"])
def test_channels_of_one_page(tmp_path: Path, planarconfig: str) -> None:
    stack = pages() if planarconfig == "separate" else np.moveaxis(pages(), 0, -1)
    tifffile.imwrite(tmp_path / "a.tif", stack, photometric="minisblack", planarconfig=planarconfig)
    capture = read_capture(tmp_path / "a.tif", "horizontal", angles=(0, 45, 90, 135))
    assert_is_right(capture, fit_capture(capture))
    turned = np.rot90(stack, 1, axes=(1, 2) if planarconfig == "separate" else (0, 1))
    tifffile.imwrite(
        tmp_path / "turned.tif", turned, photometric="minisblack", planarconfig=planarconfig,
        extratags=[(274, 3, 1, 6, True)],
    )  # fmt: skip
    upright = read_capture(tmp_path / "turned.tif", "horizontal", angles=(0, 45, 90, 135))
    np.testing.assert_array_equal(upright.pictures, capture.pictures)
    with pytest.raises(InputError, match="expected 3 pages or channels, found one page of 4"):
        read_capture(tmp_path / "a.tif", angles=(0, 45, 90))


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros((4, 8, 8), complex), "real numbers"),
        (np.zeros((8, 8)), "an array (pictures, height, width)"),
        (np.full((4, 8, 8), np.nan), "finite values"),
        (np.array([{}] * 4), "array of numbers"),
    ],
)
def test_bad_arrays_are_refused(tmp_path: Path, array: np.ndarray, words: str) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(InputError, match=re.escape(words)):
        read_capture(tmp_path / "a.npy", angles=(0, 45, 90, 135))


def test_one_file_that_is_no_stack_is_told_what_it_may_be() -> None:
    with pytest.raises(InputError, match="found none; give `angles`, one for each"):
        read_capture(CASES / "capture_pages/frame.tif")
    with pytest.raises(InputError, match="`mosaic`, such as 90,45,135,0"):
        read_capture(CASES / "capture_mosaic/frame_mono8.png")


def test_polanalyser_without_one_of_its_files(tmp_path: Path) -> None:
    folder = tmp_path / "p"
    shutil.copytree(CASES / "capture_polanalyser", folder)
    (folder / "image00002.json").write_text('{"angle": {"type": "ndarray", "values": [1.5707963]}}')
    capture = read_capture(folder)
    assert_is_right(capture, fit_capture(capture))
    (folder / "image00002.json").write_text('{"angle": "north"}')
    with pytest.raises(InputError, match=r"image00002\.json"):
        read_capture(folder)
    (folder / "image00002.json").unlink()
    with pytest.raises(InputError, match=re.escape("a JSON file with an angle beside image00002")):
        read_capture(folder)


@pytest.fixture(scope="module")
def truth():
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
        light=Distant(incidence_deg=60),
        camera=Camera(resolution=16),
        wavelengths_nm=(450.0, 550.0, 650.0, 700.0),
    )
    return render(scene, renderer="torrance-sparrow")


@pytest.mark.parametrize("layout", ["numpy", "exr", "png"])
def test_what_is_exported_is_read_back(tmp_path: Path, truth, layout: str) -> None:
    if layout == "numpy":
        write_numpy(tmp_path, truth)
    else:
        write_polanalyser(tmp_path, truth, layout)
    capture = read_capture(tmp_path)
    assert capture.channels == ("450nm", "550nm", "650nm", "700nm")
    assert not capture.clipped.any()
    # Float32, or half a code of 65535 of the brightest light in each of four pictures.
    error = 1e-6 if layout != "png" else 2 / 65535
    atol = error * float(truth.image.max())
    np.testing.assert_allclose(fit_capture(capture).stokes, truth.stokes, atol=atol)


def test_a_spectral_capture_is_scored_and_written(tmp_path: Path, truth) -> None:
    write_numpy(tmp_path, truth)
    np.save(tmp_path / "normals.npy", truth.normals)
    (tmp_path / "scene").mkdir()
    (tmp_path / "truth.npz").rename(tmp_path / "scene/truth.npz")
    normals = ["--normals", str(tmp_path / "normals.npy"), "--light", "1,0,1"]
    out = tmp_path / "out"
    arguments = [str(tmp_path / "scene"), *normals, "--out", str(out)]
    result = CliRunner().invoke(capture_command, arguments)
    assert result.exit_code == 0, result.exception
    assert (out / "i_max.exr").is_file()
    assert "skill" in result.output


def test_exported_maps_are_refused_with_the_reason(tmp_path: Path, truth) -> None:
    write_png(tmp_path, truth)
    with pytest.raises(InputError, match="without intensity"):
        read_capture(tmp_path)


def test_values_that_are_light_and_not_srgb_are_hinted_at() -> None:
    capture, _ = fitted("capture_bits_in_name", linear=False)
    assert any("say `linear`" in hint for hint in capture.hints)
    capture, _ = fitted("capture_bits_in_name")
    assert not any("say `linear`" in hint for hint in capture.hints)


@pytest.mark.parametrize("is_mosaic", [False, True])
def test_reading_needs_at_most_three_times_the_decoded_pictures(
    tmp_path: Path, is_mosaic: bool
) -> None:
    codes = np.random.default_rng(0).integers(1, 1 << 16, (768, 768), dtype=np.uint16)
    for angle in (0,) if is_mosaic else (0, 45, 90, 135):
        PIL.Image.fromarray(codes // (1 + angle)).save(tmp_path / f"{angle}.png")
    mosaic = (90, 45, 135, 0) if is_mosaic else None
    path = tmp_path / "0.png" if is_mosaic else tmp_path
    read_capture(path, mosaic=mosaic)  # imports are not the pictures'
    tracemalloc.start()
    capture = read_capture(path, mosaic=mosaic)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3 * capture.pictures.nbytes


def test_the_command_names_what_it_assumed() -> None:
    arguments = [str(CASES / "capture_pages/frame.tif"), "--angles", "0,45,90,135", "--linear"]
    result = CliRunner().invoke(capture_command, [*arguments, "--fit-only", "--zero", "horizontal"])
    assert result.exit_code == 0, result.exception
    assert "- values are linear light" in result.output
    assert "median 0.300" in result.output
    for bad in (["--angles", "0,x"], ["--size", "3"], ["--unit", "turns"]):
        assert CliRunner().invoke(capture_command, [arguments[0], *bad]).exit_code == 2
