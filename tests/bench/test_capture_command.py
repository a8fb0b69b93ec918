"""`malus capture` of several folders: what they are called, and what is said of their fits."""

from __future__ import annotations

import json
from pathlib import Path

import click
import imagecodecs
import numpy as np
import pytest
from click.testing import CliRunner, Result
from pictures import dome_stokes, write_capture

from malus.bench.commands.capture import capture_command
from malus.bench.commands.filter import in_words_of_options
from malus.bench.running.capture_suite import CaptureSuite
from malus.scenes import InputError


def dome_folder(folder: Path, marks: dict[str, float]) -> Path:
    """A capture of a dome through polarisers at `marks`, by file name."""
    folder.mkdir(parents=True)
    write_capture(folder, dome_stokes(24)[0], marks)
    return folder


def captured(*arguments: object) -> Result:
    """The command's result, of the guess alone."""
    options = [*map(str, arguments), "--method", "unpolarised"]
    return CliRunner().invoke(capture_command, options, catch_exceptions=False)


def right(*degrees: int) -> dict[str, float]:
    """Names that tell the angles."""
    return {f"pol_{angle:03d}.tif": float(angle) for angle in degrees}


def test_parameters_are_told_by_the_names_of_their_options() -> None:
    """A small object was said to need a larger --net_size, which there is not."""
    renamed = {"methods", "as_json"}
    for param in capture_command.params:
        if isinstance(param, click.Option) and param.name not in renamed:
            assert in_words_of_options(f"give `{param.name}`") == f"give {param.opts[0]}"


def test_a_bad_fit_among_several_is_told_at_once(tmp_path: Path) -> None:
    """Two pictures that changed places, as the page says too."""
    good = dome_folder(tmp_path / "good", right(0, 45, 90, 135))
    swapped = {**right(90, 135), "pol_000.tif": 45.0, "pol_045.tif": 0.0}
    bad = dome_folder(tmp_path / "bad", swapped)
    result = captured(good, bad, "--out", tmp_path / "out")
    assert "warning: bad: residual of" in result.output
    assert "good: residual" not in result.output


def test_folders_of_one_name_are_called_by_their_paths(tmp_path: Path) -> None:
    folders = [dome_folder(tmp_path / day / "kettle", right(0, 60, 120)) for day in ("mo", "tu")]
    captured(*folders, "--out", tmp_path / "out")
    run = json.loads((tmp_path / "out/run.json").read_text())
    assert [capture["name"] for capture in run["captures"]] == [str(f)[-100:] for f in folders]
    with pytest.raises(InputError, match="different names"):
        CaptureSuite.of_folders([folders[0], folders[0]])


def test_maps_do_not_go_among_the_pictures(tmp_path: Path) -> None:
    """The next fit would read them, or refuse the folder."""
    folder = dome_folder(tmp_path / "dome", right(0, 60, 120))
    options = [str(folder), "--fit-only", "--out", f"{folder}/../dome"]
    result = CliRunner().invoke(capture_command, options)
    assert "out: expected another folder than the pictures'" in str(result.exception)
    assert {path.name for path in folder.iterdir()} == set(right(0, 60, 120))


def test_methods_of_the_command_replace_those_of_the_file(tmp_path: Path) -> None:
    dome_folder(tmp_path / "dome", right(0, 45, 90, 135))
    file = tmp_path / "captures.TOML"  # some systems write endings in capitals
    file.write_text('name = "mine"\nmethods = ["blind"]\n[[capture]]\nfolder = "dome"\n')
    result = captured(file, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert {row["method"] for row in told["methods"]} == {"unpolarised"}
    assert told["run"]["suite"]["methods"] == ["unpolarised"]


def test_the_zero_mark_of_a_polariser_counts(tmp_path: Path) -> None:
    """Angles that are named 20° too small, with the offset told, are the angles that were."""
    marks = right(0, 45, 90, 135)
    plain = dome_folder(tmp_path / "plain", marks)
    turned = dome_folder(tmp_path / "turned", {k: v + 20.0 for k, v in marks.items()})
    angles = []
    for folder, options in ((plain, []), (turned, ["--offset", "20"])):
        out = tmp_path / f"{folder.name}-fit"
        arguments = [str(folder), "--linear", "--fit-only", "--out", str(out), *options]
        assert CliRunner().invoke(capture_command, arguments).exit_code == 0
        angles.append(imagecodecs.imread(out / "aolp.png") * (180 / 65535))
        polarised = imagecodecs.imread(out / "dolp.png") > 0.02 * 65535
    assert polarised.mean() > 0.2
    off = np.abs((angles[0] - angles[1] + 90) % 180 - 90)
    # The same light: float32 pictures, and codes of 0.003°, of at least 2 % polarised light.
    assert off[polarised].max() < 0.02
