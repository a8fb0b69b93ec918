"""Published test sets in the layouts of networks, made here from Stokes images that are known."""

from __future__ import annotations

import contextlib
import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from pictures import save_16_bits

import malus
from malus.bench.commands.score import score_command
from malus.bench.datasets.published_sets import score_published
from malus.scenes import InputError
from malus.scenes.polarisation import PAPER_ANGLES_DEG

SIDE = 16
NAMES = ("a", "b", "c")


def stokes_of(name: str) -> np.ndarray:
    """Smooth light, polarised by up to a half at every angle."""
    seed = NAMES.index(name)
    y, x = np.mgrid[0:SIDE, 0:SIDE] / SIDE
    light = np.stack([0.4 + 0.1 * x, 0.5 + 0 * x, 0.6 - 0.2 * y], axis=-1)
    angle = 2 * np.pi * (x + y + 0.2 * seed)[..., None]
    degree = (0.2 + 0.3 * y)[..., None]
    return np.stack([light, light * degree * np.cos(angle), light * degree * np.sin(angle)], -1)


def as_pol(folder: Path, name: str, stokes: np.ndarray) -> None:
    for degrees in (0, 45, 90, 135):
        double = 2 * np.radians(degrees)
        seen = stokes[..., 0] + stokes[..., 1] * np.cos(double) + stokes[..., 2] * np.sin(double)
        save_16_bits(folder / f"pol{degrees:03}" / f"{name}.png", seen / 2)


def as_rgb2pol(folder: Path, name: str, stokes: np.ndarray) -> None:
    save_16_bits(folder / name / "s0.png", stokes[..., 0])
    for k in (1, 2):
        save_16_bits(folder / name / f"s{k}.png", (stokes[..., k] + 1) / 2)


WRITERS = {"pol": as_pol, "rgb2pol": as_rgb2pol}
RANGES = {"pol": None, "rgb2pol": (-1.0, 1.0)}


@pytest.mark.parametrize("layout", WRITERS)
def test_skill_is_one_minus_the_missing_part(tmp_path: Path, layout: str) -> None:
    """Predictions of 0.9 of the polarisation: 1 − 0.1², and the guess beside them has none."""
    for name in NAMES:
        WRITERS[layout](tmp_path / "truth", name, stokes_of(name))
        WRITERS[layout](tmp_path / "mine", name, stokes_of(name) * [1, 0.9, 0.9])
    results = score_published(
        tmp_path / "truth", layout, predictions=tmp_path / "mine",
        metrics=["profile:polarscale"], component_range=RANGES[layout],
    )  # fmt: skip
    rows = results.headlines[results.headlines.metric == "skill"]
    skill = rows.groupby("method").value.mean()
    # 16 bits of four pictures leave 1e-5 of a tenth of the polarisation.
    assert skill["predictions"] == pytest.approx(0.99, abs=1e-4)
    assert skill["unpolarised"] == 0  # by definition: it is compared with itself
    assert len(rows) == 2 * len(NAMES)
    psnr = results.headlines[results.headlines.metric == "polarscale_psnr"]
    for name in NAMES:
        stokes = stokes_of(name)
        missing = stokes[..., 1:] / stokes[..., 0].max()
        ratios = [-10 * math.log10(np.mean((part * missing) ** 2)) for part in (1.0, 0.1)]
        own = psnr[psnr.scene == name].set_index("method").value
        assert [own["unpolarised"], own["predictions"]] == pytest.approx(ratios, abs=0.01)


@pytest.mark.parametrize("channels", [1, 3])
def test_the_error_of_the_guess_is_what_it_lacks(tmp_path: Path, channels: int) -> None:
    """I(ϑ) = ½ (s0 − s1 cos 2ϑ − s2 sin 2ϑ): the guess I/2 lacks all but the first."""
    stokes = stokes_of("a")[..., :channels, :]
    as_pol(tmp_path, "a", stokes)
    rows = score_published(tmp_path, "pol").headlines.set_index("metric").value
    s0, s1, s2 = np.moveaxis(stokes, -1, 0)
    double = 2 * np.radians(np.reshape(PAPER_ANGLES_DEG, (-1, 1, 1, 1)))
    lacking = 0.5 * (s1 * np.cos(double) + s2 * np.sin(double)) / s0.max()
    # 16 bits of four pictures leave 1e-5 of a tenth of the polarisation.
    assert rows["nmse"] == pytest.approx(np.mean(lacking**2), rel=1e-4)
    assert rows["delta_e76"] > 0  # grey is a colour, too


def test_the_mask_of_a_set_counts(tmp_path: Path) -> None:
    """What lies off it is neither right nor wrong."""
    stokes = stokes_of("a")
    as_pol(tmp_path / "truth", "a", stokes)
    mask = np.zeros((SIDE, SIDE))
    mask[4:12, 4:12] = 1
    save_16_bits(tmp_path / "truth" / "mask" / "a.png", mask)
    wrong_outside = np.where(mask[..., None, None] > 0, stokes, stokes * [1, -1, -1])
    as_pol(tmp_path / "mine", "a", wrong_outside)
    results = score_published(tmp_path / "truth", "pol", predictions=tmp_path / "mine")
    skill = results.headlines.query("metric == 'skill' and method == 'predictions'").value
    assert skill.item() == pytest.approx(1.0, abs=1e-5)


def test_methods_see_the_picture_alone(tmp_path: Path) -> None:
    """One that asks for normals is named as inapplicable, not given any."""
    as_pol(tmp_path, "a", stokes_of("a"))
    table = score_published(tmp_path, "pol", methods=["eq8"]).table
    (note,) = table[table.method == "eq8"].note
    assert "which a photograph does not tell" in note


def test_wrong_sets_are_named(tmp_path: Path) -> None:
    as_pol(tmp_path / "truth", "a", stokes_of("a"))
    with pytest.raises(InputError, match="one of pol, rgb2pol, found polaranything"):
        score_published(tmp_path / "truth", "polaranything")
    with pytest.raises(InputError, match="what the codes of s1 and s2 stand for"):
        score_published(tmp_path / "truth", "rgb2pol")
    with pytest.raises(InputError, match=r"expected NAME/s1\.png, found none"):
        score_published(tmp_path / "truth", "rgb2pol", component_range=(-1, 1))
    (tmp_path / "mine").mkdir()
    with pytest.raises(InputError, match=r"pol000/a\.png, found none"):
        score_published(tmp_path / "truth", "pol", predictions=tmp_path / "mine")
    as_pol(tmp_path / "mine", "a", stokes_of("a")[:8])
    with pytest.raises(InputError, match="pictures of one size"):
        score_published(tmp_path / "truth", "pol", predictions=tmp_path / "mine")


def test_the_command_scores_a_published_set(tmp_path: Path) -> None:
    as_pol(tmp_path / "truth", "a", stokes_of("a"))
    as_pol(tmp_path / "mine", "a", stokes_of("a"))
    out = tmp_path / "out"
    arguments = [str(tmp_path / "mine"), "--truth", str(tmp_path / "truth"), "--layout", "pol"]
    result = CliRunner().invoke(score_command, [*arguments, "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "predictions" in (out / "results.csv").read_text()
    result = CliRunner().invoke(score_command, ["--truth", str(tmp_path / "truth")])
    assert result.exit_code == 2


def test_the_command_prints_what_it_scored_and_why_not_all(tmp_path: Path) -> None:
    """The table and refusals are for people, JSON for programs: alone on standard output."""
    as_pol(tmp_path / "truth", "a", stokes_of("a"))
    arguments = ["--truth", str(tmp_path / "truth"), "--layout", "pol", "--method", "eq8"]
    arguments += ["--out", str(tmp_path / "out")]
    told = CliRunner().invoke(score_command, arguments)
    assert "unpolarised" in told.stdout
    assert "eq8 could not work on 1 of 1 scenes: needs alpha" in told.stderr
    numbers = CliRunner().invoke(score_command, [*arguments, "--json"])
    assert [row["method"] for row in json.loads(numbers.stdout)["methods"]] == ["unpolarised"]


def test_methods_count_once_and_predictions_are_no_method(tmp_path: Path) -> None:
    """Rows of one name were averaged: predictions called `unpolarised` gave the guess a skill."""
    for folder in ("truth", "mine"):
        as_pol(tmp_path / folder, "a", stokes_of("a"))
    twice = score_published(tmp_path / "truth", "pol", methods=["eq8", "eq8"]).table
    assert len(twice[twice.method == "eq8"]) == 1
    with pytest.raises(InputError, match="another name than a method's, found unpolarised"):
        score_published(
            tmp_path / "truth", "pol", predictions=tmp_path / "mine", name="unpolarised"
        )


@pytest.mark.parametrize("wrong", [(1, -1), (0, 0), (math.nan, 1), (-1, math.nan), (-math.inf, 1)])
def test_a_range_that_is_none_is_refused(tmp_path: Path, wrong: tuple[float, float]) -> None:
    """Turned round it turned every polarisation by 90°, and both sides alike: nobody saw it."""
    as_rgb2pol(tmp_path / "truth", "a", stokes_of("a"))
    with pytest.raises(InputError, match="a smaller and a larger number"):
        score_published(tmp_path / "truth", "rgb2pol", component_range=wrong)


def test_a_range_that_polarises_beyond_all_light_is_refused(tmp_path: Path) -> None:
    as_rgb2pol(tmp_path / "truth", "a", stokes_of("a"))  # by 0.2 to 0.5
    with pytest.raises(InputError, match="more in 100% of values; check `layout` or `component_r"):
        score_published(tmp_path / "truth", "rgb2pol", component_range=(-9, 9))


@pytest.mark.parametrize(("factor", "beyond"), [(2.75, 7), (3.1, 9)])
def test_noise_may_polarise_half_of_the_values_beyond_all_light(
    tmp_path: Path, factor: float, beyond: int
) -> None:
    """Degrees are 0.2 + 0.3 y: with that range, so many of 16 rows are above 1."""
    as_rgb2pol(tmp_path / "truth", "a", stokes_of("a"))
    degrees = factor * (0.2 + 0.3 * np.arange(SIDE) / SIDE)
    assert np.count_nonzero(degrees > 1) == beyond
    refused = pytest.raises(InputError, match="more in 56% of values") if beyond > 8 else None
    with refused or contextlib.nullcontext():
        score_published(tmp_path / "truth", "rgb2pol", component_range=(-factor, factor))


def test_scores_of_a_set_have_a_table_and_no_page(tmp_path: Path) -> None:
    """Neither camera nor sampling is known of it, which a page tells."""
    as_pol(tmp_path / "truth", "a", stokes_of("a"))
    score_published(tmp_path / "truth", "pol", out=tmp_path / "out")
    with pytest.raises(InputError, match="found scores of a test set; only a `table` shows them"):
        malus.report(tmp_path / "out")
    assert malus.table(tmp_path / "out").methods == ("unpolarised",)
