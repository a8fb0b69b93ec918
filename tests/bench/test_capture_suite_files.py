"""Files of a suite of captures: where they are found from, what is left of a failure, and ids."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile
from networks import edges
from pictures import dome_stokes, write_capture

import malus
from malus.scenes import InputError, polarisation

ANGLES = {f"pol_{angle:03d}.tif": float(angle) for angle in (0, 45, 90, 135)}


def dome_folder(folder: Path) -> Path:
    folder.mkdir(parents=True)
    write_capture(folder, dome_stokes(24)[0], ANGLES)
    return folder


@pytest.mark.parametrize("from_there", [False, True])
def test_weights_are_found_from_the_file_that_names_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, from_there: bool
) -> None:
    """They were found from the working folder, unlike pictures and masks."""
    suite = tmp_path / "suite"
    dome_folder(suite / "dome")
    edges(suite / "mine.onnx")
    methods = 'methods = ["net:mine.onnx", "unpolarised"]\n'
    (suite / "two.toml").write_text(f'{methods}[[capture]]\nfolder = "dome"\n', "utf-8")
    monkeypatch.chdir(suite if from_there else tmp_path)
    path = Path("two.toml" if from_there else "suite/two.toml")
    results = malus.run_captures(path, tmp_path / "out", report=False)
    called = "net:mine.onnx" if from_there else "net:suite/mine.onnx"
    assert set(results.table.method) == {called, "unpolarised"}
    assert results.run["failures"] == []


def test_weights_that_lie_where_one_is_are_still_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "suite").mkdir()
    edges(tmp_path / "mine.onnx")
    methods = (
        'methods = ["net-around:mine.onnx", "net:none.onnx", "net", "package.module:method"]\n'
    )
    path = tmp_path / "suite" / "two.toml"
    path.write_text(f'{methods}[[capture]]\nfolder = "dome"\n', "utf-8")
    monkeypatch.chdir(tmp_path)
    found = malus.load_captures("suite/two.toml").methods
    assert found == (
        "net-around:mine.onnx", "net:suite/none.onnx", "net", "package.module:method",
    )  # fmt: skip


@pytest.mark.parametrize("held", [False, True])
def test_a_failure_leaves_no_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, held: bool
) -> None:
    """The folder of all results was left, empty."""
    monkeypatch.chdir(tmp_path)
    if held:
        (tmp_path / "results").mkdir()
    with pytest.raises(InputError, match="found 2 that failed"):
        malus.run_captures(["nothing", "nowhere"], methods=["unpolarised"])
    with pytest.raises(InputError, match="found 1 that failed"):
        malus.run_captures(["nothing"], tmp_path / "a" / "b" / "c", methods=["unpolarised"])
    assert [path.name for path in tmp_path.rglob("*")] == (["results"] if held else [])


def test_the_id_of_a_capture_is_of_the_content_of_its_dark_frames(tmp_path: Path) -> None:
    """It was of their path: another folder was another capture, and another frame was not."""
    ids = []
    for folder, level in (("a", 100), ("b", 100), ("c", 200)):
        place = tmp_path / folder
        (place / "pot").mkdir(parents=True)
        for name, angle in ANGLES.items():
            light = polarisation.polarised(np.array([0.5, 0.1, 0.1]), angle)
            tifffile.imwrite(place / "pot" / name, np.full((9, 9), round(6e4 * light), np.uint16))
        tifffile.imwrite(place / "dark.tif", np.full((9, 9), level, np.uint16))
        keys = 'folder = "pot"\nlinear = true\nblack = "dark.tif"\n'
        (place / "x.toml").write_text(f'methods = ["unpolarised"]\n[[capture]]\n{keys}', "utf-8")
        results = malus.run_captures(place / "x.toml", place / "out", report=False)
        ids.append(results.run["captures"][0]["scene"])
    assert ids[0] == ids[1]
    assert ids[1] != ids[2]


def test_texts_may_begin_with_a_mark_of_their_encoding(tmp_path: Path) -> None:
    """Editors of Windows write one, which JSON and TOML do not know."""
    for number, angle in enumerate(ANGLES.values()):
        (tmp_path / "a").mkdir(exist_ok=True)
        light = polarisation.polarised(np.array([0.5, 0.1, 0.1]), angle)
        tifffile.imwrite(tmp_path / "a" / f"{number}.tif", np.full((9, 9), light, np.float32))
        # polanalyser's angles are radians from the horizontal.
        text = json.dumps({"angle": np.radians(angle + 90.0)})
        (tmp_path / "a" / f"{number}.json").write_text(text, "utf-8-sig")
    fit = malus.fit_capture(tmp_path / "a")
    np.testing.assert_allclose(fit.stokes[0, 0, 0], [0.5, 0.1, 0.1], atol=1e-6)
    for path in (tmp_path / "a").glob("*.json"):
        path.unlink()
    listed = {f"{number}.tif": angle for number, angle in enumerate(ANGLES.values())}
    (tmp_path / "a" / "angles.json").write_text(json.dumps(listed), "utf-8-sig")
    again = malus.fit_capture(tmp_path / "a")
    np.testing.assert_allclose(again.stokes, fit.stokes, atol=1e-6)
    (tmp_path / "x.toml").write_text('[[capture]]\nfolder = "a"\n', "utf-8-sig")
    assert malus.load_captures(tmp_path / "x.toml").capture[0].called == "a"
