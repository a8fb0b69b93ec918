"""Real pictures through a rotated polariser: the fit, its checks, and the score."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import colour
import numpy as np
import PIL.Image
import pytest
import tifffile
from click.testing import CliRunner
from pictures import dome_stokes, write_capture

from malus.bench.commands.capture import capture_command
from malus.bench.scoring.capture_score import colour_differences, score_capture
from malus.reconstruct.photos import capture
from malus.reconstruct.photos.angle_convention import check_convention
from malus.reconstruct.photos.capture import Capture, conventional, read_capture
from malus.reconstruct.photos.capture_angles import in_degrees
from malus.reconstruct.photos.capture_fit import capture_summary, fit_capture, noise_by_angles
from malus.reconstruct.photos.capture_levels import level_hints
from malus.reconstruct.photos.knowledge import Knowledge
from malus.scenes import InputError, polarisation

NAMED = {f"pol_{a:03d}.tif": float(a) for a in (0, 30, 60, 90, 120, 150)}


def test_the_fit_is_exact_where_the_pictures_are(tmp_path: Path) -> None:
    stokes, _ = dome_stokes()
    write_capture(tmp_path, stokes, NAMED)
    fit = fit_capture(read_capture(tmp_path))
    # Pictures of float32 at values below one.
    np.testing.assert_allclose(fit.stokes, stokes, atol=1e-6)
    assert fit.relative_residual < 1e-6
    assert fit.warnings == ()


@pytest.mark.parametrize("zero", ["vertical", "horizontal"])
@pytest.mark.parametrize("sense", ["anticlockwise", "clockwise"])
def test_every_convention_comes_to_the_same_sinusoid(tmp_path: Path, zero: str, sense: str) -> None:
    stokes, normals = dome_stokes()
    for mark in (0, 40, 100):
        angle = conventional(mark, zero, sense) + 7.0
        write_capture(tmp_path, stokes, {f"a{mark}.tif": angle})
    fit = fit_capture(read_capture(tmp_path, zero, sense, offset_deg=7.0))
    np.testing.assert_allclose(fit.stokes, stokes, atol=1e-6)
    assert check_convention(fit, normals, normals[..., 2] > 0).doubt is None


def test_angles_from_a_file(tmp_path: Path) -> None:
    stokes, _ = dome_stokes(16)
    names = {"x.tif": 10.0, "y.tif": 80.0, "z.tif": 130.5}
    write_capture(tmp_path, stokes, names)
    (tmp_path / "angles.json").write_text(json.dumps(names))
    np.testing.assert_allclose(fit_capture(read_capture(tmp_path)).stokes, stokes, atol=1e-6)


def test_three_pictures_are_enough_and_say_that_nothing_checks_them(tmp_path: Path) -> None:
    stokes, _ = dome_stokes(16)
    write_capture(tmp_path, stokes, {f"a{a}.tif": a for a in (0, 60, 120)})
    assert any("no residual" in w for w in fit_capture(read_capture(tmp_path)).warnings)


def test_movement_and_a_changing_light_are_flagged(tmp_path: Path) -> None:
    stokes, _ = dome_stokes()
    write_capture(tmp_path, stokes, NAMED)
    moved = np.roll(tifffile.imread(tmp_path / "pol_060.tif"), 3, axis=1)
    tifffile.imwrite(tmp_path / "pol_060.tif", moved, photometric="rgb")
    dimmed = 0.8 * tifffile.imread(tmp_path / "pol_120.tif")
    tifffile.imwrite(tmp_path / "pol_120.tif", dimmed, photometric="rgb")
    warnings = " ".join(fit_capture(read_capture(tmp_path)).warnings)
    assert "moved by up to 3" in warnings
    assert "pol_060.tif" in warnings
    assert "pol_120.tif" not in warnings
    assert "light or exposure changed" in warnings


def test_the_residual_is_that_of_least_squares() -> None:
    """Of pictures that no sinusoid fits, over the mean light of pixels that are not clipped."""
    angles = (0.0, 30.0, 75.0, 110.0, 150.0)
    pictures = np.random.default_rng(4).uniform(0.2, 0.8, (5, 6, 7, 1)).astype(np.float32)
    clipped = np.zeros((6, 7), bool)
    clipped[0] = True
    pictures[:, clipped] = 1.0
    fit = fit_capture(Capture(pictures, angles, clipped, tuple("abcde"), "linear"))
    turns = 2 * np.radians(angles)
    matrix = 0.5 * np.stack([np.ones(5), -np.cos(turns), -np.sin(turns)], axis=-1)
    light = pictures.reshape(5, -1).astype(np.float64)
    left = light - matrix @ np.linalg.lstsq(matrix, light, rcond=None)[0]
    rms = np.sqrt(np.mean(left**2, axis=0))
    np.testing.assert_allclose(fit.residual.ravel(), rms, atol=1e-6)  # single precision
    good = ~clipped.ravel()
    expected = np.sqrt(np.mean(rms[good] ** 2)) / light[:, good].mean()
    assert fit.relative_residual == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("darkest", "told"), [(0.10, True), (0.06, True), (0.04, False)])
def test_a_likely_dark_level_is_told_where_none_is_given(darkest: float, told: bool) -> None:
    """From a twentieth of the brightest light on; a dark level that is given answers it."""
    light = np.linspace(darkest, 1.0, 4000, dtype=np.float32).reshape(1, 40, 100, 1)
    clipped, piled = np.zeros((40, 100), bool), np.full(1, np.inf)
    hints = [level_hints(light, clipped, piled, given) for given in (False, True)]
    assert [any("dark" in hint for hint in each) for each in hints] == [told, False]


def test_angles_are_given_in_the_order_of_numbered_names(tmp_path: Path) -> None:
    """Picture 2 stands before picture 10, as a person counts."""
    for number in (1, 2, 3, 10, 11):
        codes = np.full((4, 4), 10 * number, np.uint8)
        PIL.Image.fromarray(codes).save(tmp_path / f"shot{number}.png")
    capture = read_capture(tmp_path, linear=True, angles=(0, 30, 60, 90, 120))
    assert capture.names == tuple(f"shot{number}.png" for number in (1, 2, 3, 10, 11))
    np.testing.assert_allclose(
        255 * capture.pictures[:, 0, 0, 0], [10, 20, 30, 100, 110], rtol=1e-6
    )


@pytest.mark.parametrize("angles", [(0, 45, 90), (0.0, 13.0, 5.0)])
def test_degrees_are_not_taken_for_radians(angles: tuple[float, ...]) -> None:
    """No polariser is turned by more than two whole turns."""
    with pytest.raises(InputError, match="expected radians"):
        in_degrees(angles, "radians", "names")


@pytest.mark.parametrize(("degree", "told"), [(0.95, False), (1.1, True)])
def test_more_than_completely_polarised_light_is_told(degree: float, told: bool) -> None:
    angles = (0.0, 45.0, 90.0, 135.0)
    stokes = np.broadcast_to(np.float32([1.0, degree, 0.0]), (8, 8, 1, 3))
    pictures = np.stack([polarisation.polarised(stokes, angle) for angle in angles])
    capture = Capture(pictures, angles, np.zeros((8, 8), bool), tuple("abcd"), "linear")
    warnings = fit_capture(capture).warnings
    assert any("more than completely polarised" in text for text in warnings) == told


@pytest.mark.parametrize("zero", ["vertical", "horizontal"])
@pytest.mark.parametrize("sense", ["anticlockwise", "clockwise"])
def test_an_angle_names_the_axis_that_it_is_read_as(zero: str, sense: str) -> None:
    """30° from either mark in either sense, as a vector: x to the right, y up."""
    turn = np.radians(30.0 if sense == "anticlockwise" else -30.0)
    start = np.array([0.0, 1.0]) if zero == "vertical" else np.array([1.0, 0.0])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    axis = rotation @ start
    told = np.radians(conventional(30.0, zero, sense))  # from the vertical, anticlockwise
    assert abs(axis @ [-np.sin(told), np.cos(told)]) == pytest.approx(1.0, abs=1e-12)


def test_clipped_pixels_are_no_part_of_the_summary() -> None:
    angles, clipped = (0.0, 45.0, 90.0, 135.0), np.zeros((4, 4), bool)
    stokes = np.tile(np.float32([1.0, 0.2, 0.0]), (4, 4, 1, 1))
    clipped[:3], stokes[:3, ..., 1] = True, 0.9
    pictures = np.stack([polarisation.polarised(stokes, angle) for angle in angles])
    capture = Capture(pictures, angles, clipped, tuple("abcd"), "linear")
    numbers = capture_summary(capture, fit_capture(capture))
    assert numbers["median_dolp"] == pytest.approx(0.2, abs=1e-6)
    assert numbers["dolp_99"] == pytest.approx(0.2, abs=1e-6)


def test_one_channel_that_is_full_clips_its_pixel(tmp_path: Path) -> None:
    codes = np.full((8, 8, 3), 100, np.uint8)
    codes[2, 5, 0] = 255
    for angle in (0, 45, 90, 135):
        PIL.Image.fromarray(codes).save(tmp_path / f"p{angle}.png")
    capture = read_capture(tmp_path, linear=True)
    assert np.argwhere(capture.clipped).tolist() == [[2, 5]]


def test_clipped_pixels_are_left_out(tmp_path: Path) -> None:
    stokes, _ = dome_stokes(16)
    stokes[:4] *= 4
    for angle in (0, 45, 90, 135):
        codes = np.clip(polarisation.polarised(stokes, angle), 0, 0.5) * 510
        PIL.Image.fromarray(codes.round().astype(np.uint8)).save(tmp_path / f"p{angle}.png")
    capture = read_capture(tmp_path, linear=True)
    assert capture.clipped[:4].any()
    assert not capture.clipped[4:].any()
    fit = fit_capture(capture)
    assert any("clipped" in warning for warning in fit.warnings)
    # Rounding to 8 bits: 1/√12 of a code of about 50 on average.
    assert fit.relative_residual < 0.01


def test_a_capture_without_light_or_pixels_is_refused(tmp_path: Path) -> None:
    stokes, _ = dome_stokes(16)
    write_capture(tmp_path, stokes, NAMED)
    capture = read_capture(tmp_path)
    everywhere = np.ones_like(capture.clipped)
    with pytest.raises(InputError, match="not clipped, found none"):
        fit_capture(capture._replace(clipped=everywhere))
    for level in (capture.pictures.mean(), 2 * capture.pictures.max()):  # a black level too high
        with pytest.raises(InputError, match="with light in them"):
            fit_capture(capture._replace(pictures=capture.pictures - level))
    fit = fit_capture(capture)
    with pytest.raises(InputError, match="x: expected pixels to score, found none"):
        score_capture(capture._replace(clipped=everywhere), fit, Knowledge(), "x")


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"angles_deg": (30.0, 30.0, 210.0, 30.0, 210.0, 30.0)}, "three or more angles, different"),
        ({"angles_deg": (0.0, 45.0, 90.0, 135.0, 20.0, np.nan)}, "three or more angles, different"),
        ({"angles_deg": (0.0, 45.0, 90.0)}, "n angles"),
        ({"names": ("a.png",)}, "n names"),
        ({"clipped": np.zeros((3, 3), bool)}, "clipped as large"),
    ],
)
def test_a_capture_made_in_python_that_tells_no_sinusoid_is_refused(
    tmp_path: Path, changed: dict[str, Any], expected: str
) -> None:
    stokes, _ = dome_stokes(16)
    write_capture(tmp_path, stokes, NAMED)
    with pytest.raises(InputError, match=f"capture: expected .*{expected}"):
        fit_capture(read_capture(tmp_path)._replace(**changed))


def test_a_perfect_guess_has_skill_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from malus.bench.scoring import capture_score
    from malus.reconstruct import Components
    from malus.reconstruct.photos.estimate import Estimate

    stokes, _ = dome_stokes(24)
    write_capture(tmp_path, stokes, NAMED)
    capture = read_capture(tmp_path)
    fit = fit_capture(capture)
    perfect = Components(*np.moveaxis(fit.stokes, -1, 0))
    monkeypatch.setattr(capture_score, "estimate", lambda *_: Estimate(perfect, ()))
    score = score_capture(capture, fit, Knowledge(), "x")
    assert score["skill"] == pytest.approx(1.0)
    assert score["best_gain"] == pytest.approx(1.0)
    assert score["delta_e76"]["i_max"][0] < 1e-5
    turned = Components(perfect.image, -perfect.s1, -perfect.s2)
    monkeypatch.setattr(capture_score, "estimate", lambda *_: Estimate(turned, ()))
    assert score_capture(capture, fit, Knowledge(), "x")["skill"] == pytest.approx(-3.0)


def test_normals_make_a_mirroring_dome_predictable(tmp_path: Path) -> None:
    stokes, normals = dome_stokes()
    write_capture(tmp_path, stokes, NAMED)
    capture = read_capture(tmp_path)
    knowledge = Knowledge(normals, eta=1.5, alpha=0.01, mirror=True)
    score = score_capture(capture, fit_capture(capture), knowledge, "x")
    assert score["skill"] > 0.99
    assert score["convention"] is None


def test_colour_differences_are_colour_sciences() -> None:
    rng = np.random.default_rng(0)
    true = rng.random((50, 3, 3)) * [1.0, 0.2, 0.2] + [0.5, 0, 0]
    guess = true * [1.0, 0.5, 1.0]
    differences = colour_differences(guess, true, 2.0)

    def lab(stokes: np.ndarray) -> np.ndarray:
        xyz = colour.RGB_to_XYZ(polarisation.polarised(stokes, 30.0) / 2.0, "sRGB")
        return colour.XYZ_to_Lab(xyz, colour.RGB_COLOURSPACES["sRGB"].whitepoint)

    expected = colour.delta_E(lab(guess), lab(true), method="CIE 1976")
    # colour-science rounds its matrix to four digits in one of the two.
    assert differences["30"][0] == pytest.approx(expected.mean(), rel=1e-3)
    assert differences["30"][1] == pytest.approx(expected.std(), rel=1e-2)


def test_the_command_prints_and_writes(tmp_path: Path) -> None:
    stokes, normals = dome_stokes()
    folder, out = tmp_path / "c", tmp_path / "out"
    folder.mkdir()
    write_capture(folder, stokes, NAMED)
    np.save(tmp_path / "n.npy", normals)
    options = ["--normals", str(tmp_path / "n.npy"), "--preset", "glass", "--out", str(out)]
    result = CliRunner().invoke(capture_command, [str(folder), *options])
    assert result.exit_code == 0, result.output
    assert "skill" in result.output
    assert json.loads((out / "capture.json").read_text())["fit"]["pictures"] == 6
    assert {p.suffix for p in out.iterdir()} == {".exr", ".png", ".json"}


@pytest.mark.parametrize("as_json", [False, True])
def test_a_fit_is_kept_where_nothing_can_be_reconstructed(tmp_path: Path, as_json: bool) -> None:
    stokes, _ = dome_stokes(32)
    folder, out = tmp_path / "c", tmp_path / "out"
    folder.mkdir()
    write_capture(folder, stokes, NAMED)
    mask = np.zeros((32, 32), np.uint8)
    mask[16, 10:13] = 255  # three pixels have no shape
    PIL.Image.fromarray(mask).save(tmp_path / "m.png")
    arguments = [str(folder), "--mask", str(tmp_path / "m.png")]
    options = ["--json"] if as_json else []
    alone = CliRunner().invoke(capture_command, [*arguments, *options, "--fit-only"])
    assert alone.exit_code == 0
    result = CliRunner().invoke(capture_command, [*arguments, *options, "--out", str(out)])
    assert result.stdout == alone.stdout
    assert isinstance(result.exception, InputError)
    assert result.exception.hint.endswith("or take the fit alone, --fit-only")
    assert (out / "i_max.exr").is_file()
    assert json.loads((out / "capture.json").read_text())["fit"]["pictures"] == 6


def test_bad_folders_end_in_one_line(tmp_path: Path) -> None:
    stokes, _ = dome_stokes(16)

    def folder(name: str, angles: dict[str, float]) -> Path:
        path = tmp_path / name
        path.mkdir()
        write_capture(path, stokes, angles)
        return path

    few = folder("few", {"a0.tif": 0, "a90.tif": 90, "a180.tif": 180})
    unnamed = folder("unnamed", {"a.tif": 0, "b.tif": 60, "c.tif": 120})
    sizes = folder("sizes", {"a0.tif": 0, "a60.tif": 60})
    write_capture(sizes, stokes[:8], {"a120.tif": 120})
    listed = folder("listed", {"a.tif": 0})
    (listed / "angles.json").write_text('["a.tif"]')
    outside = folder("outside", {"a.tif": 0})
    (outside / "angles.json").write_text('{"../a.tif": 0, "b": 1, "c": 2}')
    black = tmp_path / "black"
    black.mkdir()
    write_capture(black, 0 * stokes, NAMED)
    cases = [(tmp_path / "none", "a folder"), (few, "three or more"), (unnamed, "angle"),
             (sizes, "16 x 16"), (listed, "angles.json"), (outside, "names of files"),
             (black, "unclipped light")]  # fmt: skip
    for path, word in cases:
        result = CliRunner().invoke(capture_command, [str(path), "--fit-only"])
        assert isinstance(result.exception, InputError), (path, result.exception)
        assert word in str(result.exception)
        assert "\n" not in str(result.exception)


def test_more_pictures_than_memory_holds_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stokes, _ = dome_stokes(16)
    write_capture(tmp_path, stokes, NAMED)
    monkeypatch.setattr(capture, "MAX_CAPTURE_PIXELS", len(NAMED) * 16**2)
    assert len(read_capture(tmp_path).pictures) == len(NAMED)
    monkeypatch.setattr(capture, "MAX_CAPTURE_PIXELS", len(NAMED) * 16**2 - 1)
    with pytest.raises(InputError, match=f"{len(NAMED)} pictures of 16 x 16"):
        read_capture(tmp_path)


@pytest.mark.parametrize("offset", [np.nan, np.inf])
def test_an_offset_that_is_no_angle_is_refused(tmp_path: Path, offset: float) -> None:
    with pytest.raises(InputError, match="offset: expected finite degrees, found"):
        read_capture(tmp_path, offset_deg=offset)


def test_codes_count_alike_in_either_byte_order(tmp_path: Path) -> None:
    stokes, _ = dome_stokes(16)
    light = np.stack([polarisation.polarised(stokes, angle) for angle in (0, 45, 90, 135)])
    captures = []
    for kind in ("<u2", ">u2"):
        np.save(tmp_path / "codes.npy", (2000 + 20000 * light).astype(kind))
        told = {"angles": (0, 45, 90, 135), "black": 1000 / 65535}
        captures.append(read_capture(tmp_path / "codes.npy", **told))
    assert captures[0].pictures.max() < 1
    np.testing.assert_array_equal(captures[0].pictures, captures[1].pictures)


@pytest.mark.parametrize(("name", "word"), [("zero", "up"), ("sense", "ccw")])
def test_unknown_words_for_the_angles_are_refused(tmp_path: Path, name: str, word: str) -> None:
    stokes, _ = dome_stokes(16)
    write_capture(tmp_path, stokes, NAMED)
    with pytest.raises(InputError, match=f"{name}: expected .*, found {word}"):
        read_capture(tmp_path, **{name: word})


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('{"pol_000.tif": 0, "pol_030.tif": 30, "pol_060.tif": 60, "pol_030.tif": 90}', "twice"),
        ('{"pol_000.tif": 0, "pol_030.tif": 30, "pol_060.tif": true}', "true for an angle"),
    ],
)
def test_angles_that_json_would_lose_or_change_are_refused(
    tmp_path: Path, text: str, found: str
) -> None:
    stokes, _ = dome_stokes(16)
    write_capture(tmp_path, stokes, NAMED)
    (tmp_path / "angles.json").write_text(text)
    with pytest.raises(InputError, match=found):
        read_capture(tmp_path)


@pytest.mark.parametrize("angles", [(0, 60, 120), (0, 30, 60), (0, 10, 20, 30), (0, 90, 179.5)])
def test_noise_by_angles_is_that_of_noisy_pictures(angles: tuple[float, ...]) -> None:
    draws, spread = 40_000, 1e-3
    noise = np.random.default_rng(0).normal(0, spread, (len(angles), 1, draws, 1))
    pictures = (0.5 + noise).astype(np.float32)
    dark, names = np.zeros((1, draws), bool), tuple(f"{a}" for a in angles)
    fit = fit_capture(capture.Capture(pictures, angles, dark, names, "light", one_exposure=True))
    covariance = np.cov(fit.stokes.reshape(-1, 3)[:, 1:], rowvar=False)
    measured = np.sqrt(np.linalg.eigvalsh(covariance)[-1]) / (spread * np.sqrt(8 / len(angles)))
    # Four standard deviations of a standard deviation over so many draws.
    assert noise_by_angles(angles) == pytest.approx(measured, rel=4 / np.sqrt(2 * draws))
    is_told = any("close together" in warning for warning in fit.warnings)
    assert is_told == (measured > 4)
