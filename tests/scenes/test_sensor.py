"""A sensor's frames obey what is known of image sensors, and wrong ones are refused in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import trapezoid

from malus.scenes import InputError, load_suite
from malus.scenes.core.colour_science import colour_science
from malus.scenes.polarisation import analyser, polarised
from malus.scenes.sensor import SensitivityFile, Sensor, presets
from malus.scenes.sensor_frame import expose, seen

SUITE = """
name = "tiny"
shapes = [{ kind = "sphere" }]
materials = ["water"]
surfaces = ["carbon"]
lights = [{ kind = "uniform" }]
wavelengths_nm = [450, 550, 650]
methods = ["unpolarised"]
camera = { resolution = 16 }
"""


def field(s1: float, s2: float, side: int = 8, bands: int = 1) -> np.ndarray:
    return np.tile([1.0, s1, s2], (side, side, bands, 1))


def test_a_photon_transfer_curve_gives_gain_and_read_noise() -> None:
    """The variance of frames grows with their mean by the gain, from the read noise on."""
    sensor = Sensor(full_well=8000, read_noise=6.0, dark_level=64, bit_depth=12, gain=0.45)
    side, levels = 128, np.linspace(200, 6000, 9)
    means, variances = [], []
    for number, electrons in enumerate(levels):
        exposed = sensor.model_copy(update={"exposure": 2.0 * electrons})
        pair = [expose(field(0, 0, side), exposed, seed=(number, k)).raw[0] for k in (0, 1)]
        first, second = (frame.astype(float) for frame in pair)
        means.append(0.5 * (first.mean() + second.mean()) - sensor.dark_level)
        variances.append(0.5 * np.var(first - second))
    gain, _ = np.polyfit(means, variances, 1, w=1 / np.array(variances))
    # A variance of 16384 differences is known to 1.1 %, the slope of nine to about 0.5 %.
    assert gain == pytest.approx(0.45, rel=0.025)
    dark = sensor.model_copy(update={"exposure": 1e-9})
    frames = [expose(field(0, 0, side), dark, seed=(k,)).raw[0].astype(float) for k in (0, 1)]
    quantisation = 1 / 12
    noise = np.sqrt(0.5 * np.var(frames[0] - frames[1]) - quantisation) / gain
    assert noise == pytest.approx(6.0, rel=0.04)
    assert frames[0].mean() == pytest.approx(64, abs=5 * 0.45 * 6.0 / side)


@pytest.mark.parametrize(
    ("stokes", "bright", "dark"),
    [((1, 0), (1, 1), (0, 0)), ((0, 1), (0, 1), (1, 0)), ((-1, 0), (0, 0), (1, 1))],
)
def test_polarisers_stand_where_camera_makers_say(
    stokes: tuple[float, float], bright: tuple[int, int], dark: tuple[int, int]
) -> None:
    """90, 45, 135 and 0 degrees from the horizontal: the signs are those of Stokes vectors."""
    sensor = Sensor(exposure=1e5, full_well=1e6, bit_depth=16)
    electrons = expose(field(*stokes), sensor).electrons[0]
    # Noise of 1e5 electrons is 0.3 %.
    assert electrons[bright] == pytest.approx(1e5, rel=0.02)
    assert electrons[dark] == pytest.approx(0, abs=20)
    assert electrons.mean() == pytest.approx(5e4, rel=0.02)


def test_the_analyser_is_the_polariser_of_the_conventions() -> None:
    stokes = np.array([1.3, 0.4, -0.7])
    for angle in (0.0, 20.0, 45.0, 133.0):
        ideal = analyser(np.array(angle)) @ stokes
        assert ideal == pytest.approx(polarised(stokes, angle), rel=1e-12)
    # A real one passes 1/9 of what is polarised across: 0.1 of all to 0.9 along.
    across = analyser(np.array(0.0), extinction_ratio=9.0) @ np.array([1.0, 1.0, 0.0])
    assert across == pytest.approx(0.1, rel=1e-12)


def test_noise_follows_from_seed_and_frame_alone() -> None:
    sensor = Sensor(read_noise=3.0, exposure=1000.0)
    three = np.random.default_rng(1).uniform(0.5, 1.0, (8, 8, 3, 3)) * [1.0, 0.3, 0.3]
    bands = (450.0, 550.0, 650.0)
    frame = expose(three, sensor, bands, seed=(7, 3))
    again = expose(three, sensor, bands, seed=(7, 3))
    assert np.array_equal(frame.raw, again.raw)
    two = expose(three[:, :, :2], sensor, bands[:2], seed=(7, 3))
    assert np.array_equal(frame.raw[:2], two.raw)
    others = [expose(three, sensor, bands, seed=seed).raw for seed in ((7, 4), (8, 3))]
    assert not any(np.array_equal(frame.raw, other) for other in others)
    one, *same = (expose(three, sensor, bands, seed=s).raw for s in (7, (7,), np.int64(7)))
    assert all(np.array_equal(one, each) for each in same)  # one number, as everywhere else
    alike = expose(field(0.5, 0.5, 16, 2), sensor, bands[:2]).raw.astype(float)
    # Uncorrelated: of 256 pixels to 0.06; the mosaic is taken out.
    noise = [
        f.reshape(8, 2, 8, 2) - f.reshape(8, 2, 8, 2).mean(axis=(0, 2), keepdims=True)
        for f in alike
    ]
    assert abs(np.corrcoef(*(part.ravel() for part in noise))[0, 1]) < 0.3


def test_pixels_saturate_and_exposure_finds_the_brightest() -> None:
    sensor = Sensor(full_well=1000, bit_depth=10, exposure=1e9)
    assert (expose(field(0, 0), sensor).raw == 1023).all()
    light = field(0, 0, side=64)
    light[:32] *= 0.25
    automatic = expose(light, Sensor(full_well=1e6, fill=0.8, bit_depth=16))
    assert automatic.exposure * 0.5 == pytest.approx(0.8e6, rel=1e-12)
    assert expose(0 * light, Sensor()).raw.max() == 0  # no light, no exposure to find


@pytest.mark.parametrize("dark_level", [0.0, 240.0])
def test_a_full_well_reaches_the_largest_number(dark_level: float) -> None:
    """Where no gain is given: 12 bits end at 4095, the dark level among them."""
    sensor = Sensor(full_well=8000.0, dark_level=dark_level)
    assert dark_level + 8000.0 * sensor.digital_gain == pytest.approx(4095, rel=1e-12)


def test_a_well_holds_no_more_than_it_is_deep() -> None:
    """Where numbers reach farther than the well, the well ends them."""
    sensor = Sensor(
        full_well=1000, bit_depth=16, gain=1.0, dark_level=100, read_noise=0.0, exposure=1e9
    )
    assert (expose(field(0, 0), sensor).raw == 1000 + 100).all()


@pytest.mark.parametrize(
    ("light", "words"),
    [
        ([-1.0, 0.0, 0.0], "16 values of less"),
        ([1.0, 3.0, 0.0], "16 values of less"),
        ([1.0, -0.9, 0.9], "16 values of less"),
        ([np.nan, 0.0, 0.0], "finite real numbers"),
        ([1.0, 0.0], r"found \(4, 4, 1, 2\)"),
    ],
)
def test_what_is_no_light_makes_no_picture(light: list[float], words: str) -> None:
    """Its negative part would be cut off to a dark picture without a word."""
    stokes = np.broadcast_to(light, (4, 4, 1, len(light)))
    with pytest.raises(InputError, match=words):
        expose(stokes, Sensor())


def test_blur_moves_light_and_loses_none() -> None:
    light = np.zeros((32, 32, 1, 3))
    light[16, 16, 0, 0] = 1.0
    sensor = Sensor(exposure=1e8, full_well=1e9, bit_depth=16, gain=1e-3)
    sharp, blurred = (
        expose(light, sensor.model_copy(update={"blur_px": sigma})).electrons[0]
        for sigma in (0.0, 2.0)
    )
    # Numbers of 1000 electrons are rounded: at most 500 in each of 1024 pixels.
    assert blurred.sum() == pytest.approx(sharp.sum(), abs=512e3)
    rows = np.arange(32) - 16
    spread = (blurred.sum(axis=1) * rows**2).sum() / blurred.sum()
    assert spread == pytest.approx(4.0, rel=0.05)  # the variance, cut off at four sigma


def test_a_spread_of_angles_is_a_fixed_pattern() -> None:
    sensor = Sensor(angle_spread_deg=2.0, exposure=1e8, full_well=1e9, bit_depth=16)
    one, other = (expose(field(0, 1, 64), sensor, seed=(k,)).electrons[0] for k in (0, 1))
    horizontal = one[1::2, 1::2], other[1::2, 1::2]
    deviation = [values / 5e7 - 1 for values in horizontal]
    # I = (1 + sin 2e) / 2 at 0 degrees: of 1024 polarisers the spread is known to 2 %.
    assert np.std(deviation[0]) == pytest.approx(2 * np.radians(2.0), rel=0.1)
    assert np.corrcoef(*(d.ravel() for d in deviation))[0, 1] > 0.99


def test_bayer_squares_see_their_colour() -> None:
    sensor = Sensor(bayer="grbg", sensitivities="nikon-5100", full_well=1e8, bit_depth=16)
    bands = (450.0, 550.0, 650.0)
    light = field(0, 0, 16, 3) * np.array([0.2, 1.0, 0.5])[:, None]
    frame = expose(light, sensor, bands)
    ideal = seen(light, frame.channels)[0, 0, :, 0] * np.array(frame.channels.responses)
    squares = frame.electrons[0].reshape(8, 2, 8, 2).mean(axis=(1, 3))[:2, :2]
    names = np.array(list("grbg")).reshape(2, 2)
    for row, column in np.ndindex(2, 2):
        expected = ideal[frame.channels.names.index(names[row, column])]
        assert squares[row, column] == pytest.approx(0.5 * frame.exposure * expected, rel=0.01)


def test_channels_are_means_over_their_sensitivity() -> None:
    channels = Sensor(sensitivities="flat").channels((400.0, 500.0, 700.0))
    # Cells of 100, 150 and 200 nm, as scenes.colour cuts the spectrum.
    assert channels.weights[0] == pytest.approx((100 / 450, 150 / 450, 200 / 450))
    assert channels.wavelengths_nm[0] == pytest.approx(np.dot(channels.weights[0], (400, 500, 700)))


def test_a_colours_response_is_the_integral_of_its_own_curve() -> None:
    curves = colour_science().MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    integrals = trapezoid(curves.values, curves.wavelengths, axis=0)
    expected = dict(zip(curves.labels, integrals / integrals.max(), strict=True))
    sensor = Sensor(bayer="rggb", sensitivities="nikon-5100")
    channels = sensor.channels(tuple(np.arange(400.0, 701.0, 10.0)))
    responses = dict(zip(channels.names, channels.responses, strict=True))
    for colour in ("red", "green", "blue"):
        # Less than 1 % of a curve lies beyond 400 and 700 nm, or between its trapezia and cells.
        assert responses[colour[0]] == pytest.approx(expected[colour], rel=0.01)
    assert abs(expected["red"] - expected["blue"]) > 0.1  # else they could be swapped


def test_curves_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "curves.csv"
    path.write_text("wavelength_nm,r,g,b\n400,0,0,2\n500,0,2,0\n600,2,0,0\n700,0,0,0\n", "utf-8")
    sensor = Sensor(sensitivities=SensitivityFile(path=str(path)), bayer="rggb")
    channels = sensor.channels((450.0, 500.0, 600.0))
    assert channels.names == ("b", "g", "r")
    assert channels.weights[0] == pytest.approx((1, 0, 0))  # blue ends at 500 nm
    suite = tmp_path / "suite.toml"
    suite.write_text(
        f'{SUITE}[sensor]\nbayer = "rggb"\nsensitivities = {{ path = "curves.csv" }}\n'
    )
    found = load_suite(suite).sensor
    assert found is not None
    assert isinstance(found.sensitivities, SensitivityFile)
    assert found.sensitivities.digest
    digest = found.sensitivities.digest
    named = suite.read_text().replace('.csv"', f'.csv", digest = "{digest}"')
    suite.write_text(named)  # it was looked for in the current folder, before the suite's
    assert load_suite(suite).sensor == found
    suite.write_text(named.replace(digest, "0" * 16))
    with pytest.raises(InputError, match=f"digest {'0' * 16}, found {digest}; leave the digest"):
        load_suite(suite)
    other = path.read_text("utf-8").replace("400,0,0,2", "400,0,0,1")
    path.write_text(other, "utf-8")
    with pytest.raises(InputError, match="digest"):
        found.channels((450.0, 500.0, 600.0))


@pytest.mark.parametrize(
    ("table", "bayer", "expected"),
    [
        (
            "nm,a\n400,1\n700,1\n",
            "rggb",
            r"3 column\(s\) of .*/curves.csv, found 1; bayer is",
        ),
        ("nm,r,g,b\n400,0,0,1\n550,0,1,0\n700,1,0,0\n", None, r"1 column\(s\) of .*give bayer"),
    ],
)
def test_a_sensor_made_in_python_has_the_channels_of_its_file(
    tmp_path: Path, table: str, bayer: Any, expected: str
) -> None:
    path = tmp_path / "curves.csv"
    path.write_text(table, "utf-8")
    sensor = Sensor(sensitivities=SensitivityFile(path=str(path)), bayer=bayer)
    light = np.tile([1.0, 0.0, 0.0], (12, 12, 3, 1))
    with pytest.raises(InputError, match=f"^sensor, key sensitivities: expected {expected}"):
        expose(light, sensor, (450.0, 550.0, 650.0))


RED_GREEN_BLUE = np.array([[450, 1, 2, 9], [550, 3, 8, 4], [650, 7, 5, 6]], float)


@pytest.mark.parametrize(
    ("names", "order"),
    [
        ("", [0, 1, 2, 3]),
        ("wavelength_nm,r,g,b\n", [0, 1, 2, 3]),
        ("nm,first,second,third\n", [0, 1, 2, 3]),
        ("\ufeffwavelength_nm,blue,green,red\n", [0, 3, 2, 1]),
        ("nm, Green (rel.), B_sens, RED\n", [0, 2, 3, 1]),
    ],
)
def test_columns_are_known_by_their_names(tmp_path: Path, names: str, order: list[int]) -> None:
    rows = "".join(",".join(map(repr, row)) + "\n" for row in RED_GREEN_BLUE[:, order].tolist())
    (tmp_path / "curves.csv").write_text(names + rows, "utf-8")
    curves = SensitivityFile(path=str(tmp_path / "curves.csv")).curves()
    np.testing.assert_array_equal(curves, RED_GREEN_BLUE)


@pytest.mark.parametrize("names", ["nm,r,g,g", "nm,r,g,alpha", "r,g,b,nm", "nm,red,green"])
def test_names_that_contradict_each_other_are_refused(tmp_path: Path, names: str) -> None:
    (tmp_path / "curves.csv").write_text(f"{names}\n450,1,2,9\n550,3,8,4\n", "utf-8")
    with pytest.raises(InputError, match=f"one named r, g and b each, found {names}; name"):
        SensitivityFile(path=str(tmp_path / "curves.csv")).curves()


def test_a_file_without_names_keeps_its_first_line(tmp_path: Path) -> None:
    path = tmp_path / "curves.csv"
    path.write_text("450,0.9\n550,0.8\n", "utf-8")
    assert SensitivityFile(path=str(path)).curves().tolist() == [[450, 0.9], [550, 0.8]]
    path.write_text("", "utf-8")
    with pytest.raises(InputError, match="2 or 4 columns of numbers, found 0"):
        SensitivityFile(path=str(path)).curves()
    path.write_text("450,x\n550,0.8\n", "utf-8")
    with pytest.raises(InputError, match="below one line of names, found could not convert"):
        SensitivityFile(path=str(path)).curves()


def test_bands_off_the_measured_tables_are_refused() -> None:
    sensor = Sensor(bayer="rggb", sensitivities="nikon-5100")
    with pytest.raises(InputError, match=r"bands in its table, 380 to 780 nm, found 790 nm"):
        sensor.channels((450.0, 550.0, 790.0))


def test_presets_are_whole_and_what_is_given_wins() -> None:
    for name, values in presets().items():
        given: dict[str, Any] = {"extinction_ratio": 300.0, "sensitivities": "nikon-5100"}
        keys = {key: given[key] for key in values["needs"]}
        sensor = Sensor(preset=name, **keys)
        assert sensor.full_well == values["full_well"]
        assert values["source"]
        assert Sensor(preset=name, **keys, read_noise=9.0).read_noise == 9.0
        assert Sensor.parse(sensor.model_dump(mode="json"), "again") == sensor


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ('[sensor]\npreset = "imx250mzr"', "expected extinction_ratio beside this preset"),
        ('[sensor]\npreset = "imx250"', "did you mean imx250mzr"),
        ("[sensor]\nread_noise = -1", "key sensor.read_noise: expected greater than or equal to 0"),
        ('[sensor]\nbayer = "rggb"', "expected sensitivities of red, green and blue with bayer"),
        ('[sensor]\nsensitivities = "nikon-5100"', "expected bayer, the order"),
        ("[sensor]\nmosaic = [0, 90, 0, 90]", "expected three different directions in mosaic"),
        ("[sensor]\ndark_level = 5000", "expected a dark_level below the largest number, 4095"),
        ("[sensor]\ngane = 2", "did you mean gain?"),
        (
            '[sensor]\nsensitivities = { path = "none.csv" }',
            "expected a readable sensitivity table",
        ),
        ('[sensor]\nsensitivities = { path = "bad.csv" }', "expected a CSV file of numbers"),
        (
            '[sensor]\nsensitivities = { path = "far.csv" }',
            "expected bands in its table, 1400 to 1500 nm, found 450 nm",
        ),
        (
            '[sensor]\nsensitivities = { path = "blind.csv" }',
            "expected bands that every channel sees",
        ),
        ('maps = ["depht"]', "did you mean depth"),
        ('maps = "depth"', "key maps: expected a list"),
        ('maps = ["uv", "uv"]', "expected every map once"),
    ],
)
def test_a_malformed_table_ends_in_one_line(tmp_path: Path, lines: str, expected: str) -> None:
    (tmp_path / "bad.csv").write_text("nm,a\n400,red\n", "utf-8")
    (tmp_path / "far.csv").write_text("nm,a\n1400,1\n1500,1\n", "utf-8")
    (tmp_path / "blind.csv").write_text("nm,a\n400,0\n700,0\n710,1\n", "utf-8")
    (tmp_path / "suite.toml").write_text(f"{SUITE}{lines}\n", "utf-8")
    with pytest.raises(InputError) as caught:
        load_suite(tmp_path / "suite.toml")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_maps_that_are_always_there_may_be_named(tmp_path: Path) -> None:
    path = tmp_path / "suite.toml"
    path.write_text(f'{SUITE}maps = ["uv", "specular", "standard_error", "depth"]\n', "utf-8")
    assert load_suite(path).maps == ("depth", "uv")


def test_suites_without_them_have_their_old_record() -> None:
    record = load_suite("quick").model_dump(mode="json")
    assert not {"maps", "sensor"} & record.keys()


def test_angles_in_radians_are_asked_about(tmp_path: Path) -> None:
    sensor = "[sensor]\nmosaic = [1.5708, 0.7854, 2.3562, 0]\n"
    (tmp_path / "suite.toml").write_text(SUITE + sensor, encoding="utf-8")
    with pytest.raises(InputError, match="mosaic in degrees; are these radians"):
        load_suite(tmp_path / "suite.toml")


RANDOM = """
name = "drawn"
wavelengths_nm = [450, 550, 650]
methods = ["unpolarised"]
camera = { resolution = 16 }
[sensor]
bayer = "rggb"
sensitivities = "nikon-5100"
[random]
count = 2
shapes = [{ kind = "sphere" }]
materials = ["water"]
surfaces = ["carbon"]
lights = [{ kind = "uniform" }]
cameras = [{ resolution = { choice = [%s, 19] } }]
"""


def test_every_drawn_resolution_fits_the_mosaic(tmp_path: Path) -> None:
    path = tmp_path / "suite.toml"
    path.write_text(RANDOM % 3, encoding="utf-8")
    with pytest.raises(InputError, match="a resolution of 12 or more for its mosaic, found 3"):
        load_suite(path)
    path.write_text(RANDOM % 12, encoding="utf-8")
    assert load_suite(path).scene_count == 2
