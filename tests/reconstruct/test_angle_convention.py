"""Whether a capture's angles are counted as assumed: by known normals, and by outlines alone."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from pictures import dome_stokes, write_capture
from runs import run_malus

import malus
from malus.bench.scoring.capture_score import convention_doubt, score_capture
from malus.reconstruct.photos.angle_convention import (
    OutlineTurn,
    check_convention,
    check_outlines,
)
from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.capture_fit import CaptureFit, fit_capture
from malus.reconstruct.photos.knowledge import Knowledge
from malus.scenes import Uniform


def test_a_wrong_convention_is_doubted_and_measured(tmp_path: Path) -> None:
    stokes, normals = dome_stokes()
    mask = normals[..., 2] > 0
    write_capture(tmp_path, stokes, {f"a{m}.tif": -m - 20.0 for m in (0, 45, 90, 135)})
    checked = check_convention(fit_capture(read_capture(tmp_path)), normals, mask)
    assert checked.coherence_reversed > 0.999
    assert checked.coherence < 0.5
    assert checked.rotation_reversed_deg == pytest.approx(20.0, abs=0.1)
    assert "the other way" in checked.doubt
    right = read_capture(tmp_path, "vertical", "clockwise", offset_deg=-20.0)
    assert check_convention(fit_capture(right), normals, mask).doubt is None


def fitted(stokes: np.ndarray) -> CaptureFit:
    """A fit that leaves nothing of pictures with these Stokes vectors (height, width, 3, 3)."""
    return CaptureFit(stokes.astype(np.float32), np.zeros(stokes.shape[:3], np.float32), 0, (), ())


def counted(stokes: np.ndarray, sense: float, offset_deg: float) -> np.ndarray:
    """What is fitted where the angle ϑ is taken for sense · ϑ + offset."""
    s1, s2 = stokes[..., 1], sense * stokes[..., 2]
    turned = (s1 + 1j * s2) * np.exp(2j * np.radians(offset_deg))
    return np.stack([stokes[..., 0], turned.real, turned.imag], axis=-1)


@pytest.mark.parametrize("diffuse", [1.0, -1.0])
@pytest.mark.parametrize("offset", [0.0, 20.0, 40.0, 70.0])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_outlines_tell_sense_and_turn(sense: float, offset: float, diffuse: float) -> None:
    """With diffuse light as with mirrored: a turn is known up to 90 degrees, the sense is sure."""
    stokes, normals = dome_stokes(96)
    stokes[..., 1:] *= diffuse
    mask = normals[..., 2] > 0
    turn = check_outlines(fitted(counted(stokes, sense, offset)), [mask], mask)
    told = (turn.with_outlines, turn.rotation_deg, turn.against_outlines)
    right, rotation, wrong = told if sense > 0 else (told[2], turn.rotation_reversed_deg, told[0])
    # The rest is how polarisation grows towards the rim, and light to one side.
    assert right > 0.8
    assert wrong < 0.001
    assert (rotation - sense * offset + 45) % 90 - 45 == pytest.approx(0, abs=1)
    askew = min(offset % 90, -offset % 90)
    assert (turn.doubt is None) == (sense > 0 and askew < 35)
    assert sense > 0 or "count the other way" in turn.doubt


@pytest.mark.parametrize("normals_known", [True, False])
@pytest.mark.parametrize("given", [0.0, 30.0])
@pytest.mark.parametrize("sense", ["anticlockwise", "clockwise"])
@pytest.mark.parametrize("offset", [-50.0, -20.0, 0.0, 40.0])
def test_what_the_doubt_says_mends_the_capture(
    tmp_path: Path, sense: str, offset: float, given: float, normals_known: bool
) -> None:
    """Reading again as the sentence says, in one of its ways, ends in the true Stokes vectors."""
    stokes, normals = dome_stokes(96)
    mask = normals[..., 2] > 0
    sign = -1.0 if sense == "clockwise" else 1.0
    marks = {f"a{m}.tif": sign * m + offset for m in (0, 45, 90, 135)}
    write_capture(tmp_path, stokes, marks)
    fit = fit_capture(read_capture(tmp_path, offset_deg=given))
    known = Knowledge(normals=normals, mask=mask) if normals_known else Knowledge(mask=mask)
    doubt = convention_doubt(fit, known, mask)
    # Mirrored light stands at a right angle to diffuse light, and outlines do not tell which it is.
    turn, doubted = (180, 15) if normals_known else (90, 35)
    askew = abs((offset - given + turn / 2) % turn - turn / 2) > doubted
    assert (doubt is not None) == (sign < 0 or askew)
    if doubt is None:
        return
    told = re.search(r"`offset` of (-?\d+)°(?: or (-?\d+)°)? (less|more than) the given", doubt)
    assert (told[3] == "less") == ("count the other way" in doubt) == (sign < 0)
    tried = [float(told[n]) + sign * given for n in ((1,) if normals_known else (1, 2))]
    mended = (read_capture(tmp_path, sense=sense, offset_deg=each) for each in tried)
    errors = [np.abs(fit_capture(capture).stokes - stokes).max() for capture in mended]
    # A degree and rounding of the angle, where up to 0.45 of the light is polarised.
    assert min(errors) < 2 * np.radians(1.5) * 0.45


@pytest.mark.parametrize(
    ("right", "wrong", "doubted"),
    [(0.04, 0.14, False), (0.04, 0.16, True), (0.10, 0.25, False), (0.10, 0.35, True)],
)
def test_a_doubt_needs_a_share_and_a_lead(right: float, wrong: float, doubted: bool) -> None:
    """What turns both ways alike, or hardly at all, is no evidence."""
    assert (OutlineTurn(right, 0.0, wrong, 0.0).doubt is not None) == doubted


def test_the_frame_of_the_picture_is_no_outline() -> None:
    """Half a dome at the edge of the picture tells as much; a mask of all of it tells nothing."""
    stokes, normals = dome_stokes(96)
    stokes, mask = stokes[:, 40:], normals[:, 40:, 2] > 0
    assert check_outlines(fitted(stokes), [mask], mask).against_outlines < 0.01
    reverse = check_outlines(fitted(counted(stokes, -1.0, 0.0)), [mask], mask)
    assert "count the other way" in reverse.doubt
    full = np.ones_like(mask)
    assert check_outlines(fitted(stokes), [full], full) == OutlineTurn(0.0, 0.0, 0.0, 0.0)


def test_outlines_of_one_direction_say_nothing() -> None:
    """In a narrow sector of an outline, what turns with it can hardly be told from the rest."""
    stokes, normals = dome_stokes(96)
    mask = normals[..., 2] > 0
    azimuth = np.degrees(np.arctan2(normals[..., 1], normals[..., 0]))
    seen = mask & (abs(azimuth) < 15)
    assert check_outlines(fitted(stokes), [mask], seen) == OutlineTurn(0.0, 0.0, 0.0, 0.0)
    assert check_outlines(fitted(stokes), [mask], mask & (abs(azimuth) < 90)).with_outlines > 0.1


def test_a_large_object_is_thinned_out_and_clipped_pixels_are_left_out() -> None:
    stokes, normals = dome_stokes(500)
    mask = normals[..., 2] > 0
    plain = check_outlines(fitted(stokes), [mask], mask)
    small = check_outlines(fitted(stokes[::3, ::3]), [mask[::3, ::3]], mask[::3, ::3])
    assert plain.with_outlines == pytest.approx(small.with_outlines, abs=0.02)
    spoilt, known = stokes.copy(), mask.copy()
    spoilt[20:250, 20:250, :, 1:] = 5.0
    known[20:250, 20:250] = False
    assert check_outlines(fitted(spoilt), [mask], known).with_outlines > 0.8


@pytest.mark.parametrize("body", ["polarised", "unpolarised"])
def test_rendered_objects_are_doubted_only_where_their_sense_is_reversed(body: str) -> None:
    scene = malus.Scene(
        shape=malus.Sphere(),
        surface=malus.Dielectric(eta=1.6, alpha=0.2, body=body),
        light=Uniform(),
        camera=malus.Camera(resolution=40),
    )
    truth = malus.render(scene, malus.Sampling(samples=32, seed=1))
    stokes, mask = truth.stokes, truth.mask
    assert check_outlines(fitted(stokes), [mask], mask).doubt is None
    reverse = check_outlines(fitted(counted(stokes, -1.0, 0.0)), [mask], mask)
    assert "count the other way" in reverse.doubt


def test_a_mask_is_enough_for_the_doubt(tmp_path: Path) -> None:
    """A score by a mask alone warns; the same pictures read the other way have none."""
    stokes, normals = dome_stokes(96)
    mask = normals[..., 2] > 0
    write_capture(tmp_path, stokes, {f"a{m}.tif": -float(m) for m in (0, 45, 90, 135)})
    told = Knowledge(mask=mask, eta=1.5)
    wrong = read_capture(tmp_path)
    right = read_capture(tmp_path, sense="clockwise")
    assert "against the outlines" in score_capture(wrong, knowledge=told)["convention"]
    assert score_capture(right, knowledge=told)["convention"] is None


def test_polarisation_as_weak_as_noise_says_nothing() -> None:
    """Angles read the wrong way are found at 4 % of the light, and not at 1 %."""
    stokes, normals = dome_stokes(96)
    mask = normals[..., 2] > 0
    wrong = counted(stokes, -1.0, 0.0)
    wrong[..., 1:] *= 0.05
    assert check_outlines(fitted(wrong), [mask], mask).doubt is not None
    wrong[..., 1:] *= 0.2
    assert check_outlines(fitted(wrong), [mask], mask) == OutlineTurn(0.0, 0.0, 0.0, 0.0)


def test_numbers_that_are_none_are_left_out() -> None:
    stokes, normals = dome_stokes(96)
    mask = normals[..., 2] > 0
    expected = check_outlines(fitted(stokes), [mask], mask)
    stokes[5:12, 40:50] = np.nan
    found = check_outlines(fitted(stokes), [mask], mask)
    assert found.with_outlines == pytest.approx(expected.with_outlines, abs=0.05)


@pytest.mark.parametrize("more", [["--fit-only"], ["--method", "blind"], ["--light", "0,0,1"]])
def test_one_capture_is_doubted_whatever_is_done_with_it(tmp_path: Path, more: list[str]) -> None:
    """Also where the method that is chosen cannot work on it."""
    stokes, normals = dome_stokes(96)
    write_capture(tmp_path, stokes, {f"a{m}.tif": -50.0 - m for m in (0, 45, 90, 135)})
    mask = np.where(normals[..., 2] > 0, 255, 0).astype(np.uint8)
    PIL.Image.fromarray(mask).save(tmp_path / "mask.png")
    folder = tmp_path / "pictures"
    folder.mkdir()
    for file in tmp_path.glob("*.tif"):
        file.rename(folder / file.name)
    out = ["--out", str(tmp_path / "out")]
    done = run_malus("capture", str(folder), "--mask", str(tmp_path / "mask.png"), *more, *out)
    assert "against the outlines" in done.stdout + done.stderr


def test_several_captures_say_which_is_doubted(tmp_path: Path) -> None:
    """On the console and in the results, for the one that was read with the wrong sense alone."""
    stokes, normals = dome_stokes(96)
    for name, sense in (("right", 1.0), ("wrong", -1.0)):
        folder = tmp_path / name
        folder.mkdir()
        write_capture(folder, stokes, {f"a{m}.tif": sense * m for m in (0, 45, 90, 135)})
    mask = np.where(normals[..., 2] > 0, 255, 0).astype(np.uint8)
    PIL.Image.fromarray(mask).save(tmp_path / "mask.png")
    written = [f'[[capture]]\nfolder = "{n}"\nmask = "mask.png"' for n in ("right", "wrong")]
    (tmp_path / "both.toml").write_text('methods = ["unpolarised"]\n' + "\n".join(written), "utf-8")
    done = run_malus("capture", str(tmp_path / "both.toml"), "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert "wrong: the polarisation turns against" in done.stdout
    assert "right: " not in done.stdout
    right, wrong = malus.read_results(tmp_path / "out").run["captures"]
    assert right["convention"] is None
    assert "count the other way" in wrong["convention"]


def test_a_real_capture(shared: Path) -> None:
    capture = read_capture(shared / "captures" / "kettle", "vertical", "clockwise", True, -20.0)
    fit = fit_capture(capture)
    # Stated by those who took it: I0 + I90 and I45 + I135 agree within 0.6 %.
    assert fit.relative_residual < 0.006
    assert max(fit.shifts) < 0.25
    height, width = capture.clipped.shape
    y, x = np.mgrid[:height, :width]
    # The dome of the lid's knob, read off the picture: an ellipse about (524, 370) pixels.
    u, v = (x - 524) / 60, -(y - 370) / 61
    dome = (u**2 + v**2 < 0.95) & (y < 383)
    normals = np.where(
        dome[..., None], np.dstack([u, v, np.sqrt(np.clip(1 - u**2 - v**2, 0, 1))]), 0
    )
    checked = check_convention(fit, normals.astype(np.float32), dome)
    # Of the knob alone: clockwise, 0 at 20° from the vertical.
    assert checked.coherence > 0.9
    assert abs(checked.rotation_deg) < 5
    score = score_capture(
        capture, fit, Knowledge(normals.astype(np.float32), dome, None, 1.5, 0.2), "k"
    )
    # 0.42 with the same normals; the wood is not one colour, and the light is a tent.
    assert score["skill"] > 0.3


def turn_of(name: str, **changes: object) -> OutlineTurn:
    """Of a reference capture, read as the suite of captures says but for the changes."""
    suite = malus.load_captures(Path(__file__).parents[1] / "captures" / "captures.toml")
    (entry,) = (entry for entry in suite.capture if entry.called == name)
    capture = (entry := entry.model_copy(update=changes)).read()
    objects = entry.objects(capture.clipped.shape)
    return check_outlines(fit_capture(capture), objects, ~capture.clipped)


def test_a_frame_of_a_polarisation_camera_is_not_doubted(shared: Path) -> None:
    """The sensor gives its angles, and its fruits mirror a room from above."""
    assert turn_of("fruits").doubt is None
    assert "count the other way" in turn_of("fruits", sense="clockwise").doubt


@pytest.mark.parametrize(("name", "turn"), [("car", 0.0), ("kettle", -20.0)])
def test_real_captures_that_count_clockwise(shared: Path, name: str, turn: float) -> None:
    """By outlines drawn by hand: the car and its control, and the steel and the knob of a kettle.

    The normals of the knob, made by hand, told the same 20 degrees.
    """
    found = turn_of(name, sense="anticlockwise", offset=0.0)
    assert "count the other way" in found.doubt
    assert turn_of(name).doubt is None
    # Outlines drawn by hand, and mirrored surroundings that are not even.
    assert -found.rotation_reversed_deg == pytest.approx(turn, abs=5)
