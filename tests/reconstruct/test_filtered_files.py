"""What `malus filter` leaves in its folder, and what of the light its files cannot hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from malus.bench.commands.filter import filter_command
from malus.reconstruct.fresnel import smooth_dolp
from malus.reconstruct.photos.filter import FilterOutput, filter_picture
from malus.reconstruct.photos.knowledge import Knowledge
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.read_picture import read_picture
from malus.reconstruct.photos.tone_curves import linear_transfer, srgb_transfer
from malus.reconstruct.photos.write_picture import write_picture

TILT = np.pi / 3
MIRROR = Knowledge(
    np.tile(np.array([0, np.sin(TILT), np.cos(TILT)], np.float32), (8, 40, 1)),
    eta=1.5, alpha=0.01, mirror=True,
)  # fmt: skip
RAMP = np.tile(np.linspace(0.02, 0.98, 40, dtype=np.float32), (8, 1))[..., None]


def ramp(bits: int = 16) -> Picture:
    transfer = srgb_transfer(bits)
    return Picture(transfer.linear(transfer.encoded(RAMP)), "TIFF", transfer)


def test_pictures_of_angles_that_are_no_longer_asked_for_go(tmp_path: Path) -> None:
    filter_picture(ramp(), tmp_path, MIRROR, FilterOutput((0.0, 30.0), sweep=True), stem="w")
    # A photograph through a real filter, and what another picture left.
    for name in ("w_angle045.tif", "w2_angle030.tif"):
        (tmp_path / name).write_bytes(b"of somebody else")
    again = filter_picture(ramp(), tmp_path, MIRROR, FilterOutput((60.0,)), stem="w")
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {path.name for path in again.files} | {"w_angle045.tif", "w2_angle030.tif"}
    assert "w_angle060.tif" in left


def test_light_that_exposure_takes_beyond_white_is_told(tmp_path: Path) -> None:
    """I_max and I_min of the files did not add up to the picture, and nothing said so."""
    share = 0.5 * (1 + float(smooth_dolp(np.cos(TILT), 1.5)))  # I_max of this mirror over I
    told = filter_picture(ramp(), tmp_path, MIRROR, FilterOutput((0.0,)), stem="w")
    (warning,) = told.warnings
    expected = float(np.mean(2 * share * RAMP > 1.005))
    assert f"{expected:.1%} of the pixels are brighter than white" in warning
    largest, least = (read_picture(tmp_path / f"w_{n}.tif").linear for n in ("imax", "imin"))
    lost = ~np.isclose(0.5 * (largest + least), RAMP, atol=1e-3)  # steps of 16 bits of sRGB
    assert np.mean(lost) == pytest.approx(expected, abs=1 / 40)
    kept = filter_picture(ramp(), tmp_path, MIRROR, FilterOutput((0.0,), physical=True), stem="w")
    assert kept.warnings == ()
    light = [read_picture(tmp_path / f"w_{name}.tif").linear for name in ("imax", "imin")]
    np.testing.assert_allclose(light[0] + light[1], RAMP, atol=1e-3)


@pytest.mark.parametrize("kind", ["floats", "nothing written", "8 bits"])
def test_light_is_not_said_to_be_lost_where_it_is_not(kind: str, tmp_path: Path) -> None:
    """Floats have no white; white that stays unpolarised is hardly above itself."""
    picture, knowledge, out = Picture(RAMP, "EXR", None), MIRROR, tmp_path
    if kind == "nothing written":
        picture, out = ramp(), None
    if kind == "8 bits":
        picture = Picture(linear_transfer(8).linear(np.full((8, 40, 1), 254, np.uint8)), "PNG",
                          linear_transfer(8))  # fmt: skip
        knowledge = Knowledge(method="unpolarised")
    assert filter_picture(picture, out, knowledge, stem="w").warnings == ()


def test_the_command_tells_it_in_words_of_options(tmp_path: Path) -> None:
    write_picture(tmp_path / "w.tif", ramp())
    np.save(tmp_path / "n.npy", MIRROR.normals)
    options = ["--normals", str(tmp_path / "n.npy"), "--preset", "glass"]
    result = CliRunner().invoke(filter_command, [str(tmp_path / "w.tif"), *options])
    assert "clipped there, and maybe at other angles: --physical keeps all light" in result.output
