"""What is no scene, truth or method is told in one line; one name is a list of one."""

from __future__ import annotations

import inspect
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import PIL.Image
import pytest
from runs import NOBODY, SUITE, formula_dataset, one_line, run_malus

import malus
from malus.bench import read_results, run
from malus.bench.running.overrides import chosen_suite
from malus.bench.running.parts import Failure
from malus.bench.running.status import Status
from malus.bench.studies.study import option_values
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.scenes import Camera, Dielectric, Distant, InputError, Scene, Sphere
from malus.scenes.core.errors import first_line
from malus.scenes.core.result_files import RUN, TABLE
from malus.scenes.polarisation import stokes_from_extremes

SCENE = Scene(
    shape=Sphere(),
    surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    light=Distant(incidence_deg=60),
    camera=Camera(resolution=8),
)
TINY_SUITE = """
name = "mine"
renderer = "torrance-sparrow"
shapes = [{ kind = "sphere" }]
materials = ["water"]
surfaces = ["carbon"]
lights = [{ kind = "distant", incidence_deg = 60 }, { kind = "distant", incidence_deg = 20 }]
wavelengths_nm = [550]
methods = ["unpolarised"]
camera = { resolution = 8 }
"""
ANYTHING = cast(Any, malus)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ANYTHING.render("quick"), "scene: expected a malus.Scene, found str"),
        (lambda: ANYTHING.render(SCENE, 32), "sampling: expected a malus.Sampling, found int"),
        (lambda: ANYTHING.score("eq8", SCENE), "truth: expected a malus.Truth, found str"),
        (
            lambda: ANYTHING.compare("results"),
            "^results: expected a list of folders of runs, found results",
        ),
    ],
)
def test_what_is_of_another_kind_is_told(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()


@pytest.mark.parametrize("name", ["compare", "gate", "report", "table", "update_baseline"])
def test_finished_runs_are_called_results_wherever_they_are_given(name: str) -> None:
    """As on the command line; errors call them so, too."""
    assert next(iter(inspect.signature(getattr(malus, name)).parameters)) == "results"


TAKING = [
    name
    for name in malus.__all__
    if name != "read_knowledge"  # without a file to read it looks at no shape
    and inspect.isfunction(function := getattr(malus, name))
    and any(p.default is p.empty for p in inspect.signature(function).parameters.values())
]
"""Functions that must be given something."""


@pytest.mark.parametrize(
    "value", [None, 3, np.zeros(3), object()], ids=["None", "number", "array", "object"]
)
@pytest.mark.parametrize("name", TAKING)
def test_a_value_of_another_kind_is_a_wrong_value_or_a_wrong_type(
    name: str, value: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No error of an attribute deep inside, whatever stands for all that must be given."""
    monkeypatch.chdir(tmp_path)
    function = getattr(malus, name)
    needed = [p for p in inspect.signature(function).parameters.values() if p.default is p.empty]
    with pytest.raises((ValueError, TypeError)):
        function(*[value] * len(needed))


@pytest.mark.parametrize("name", ["blind", "paper", "run_chain", "run_paper"])
def test_who_gives_a_truth_to_a_chain_is_told_what_it_takes(name: str) -> None:
    truth = malus.render(SCENE, renderer="torrance-sparrow")
    with pytest.raises(InputError, match=r"a malus.Observation, found Truth; give malus.Obs"):
        getattr(malus, name)(truth)


def test_a_score_needs_a_method() -> None:
    truth = malus.render(SCENE, renderer="torrance-sparrow")
    with pytest.raises(InputError, match="a Method, the name of one, or Components, found None"):
        malus.score(truth, cast(Any, None))


def test_a_method_that_is_given_as_an_object_is_held_to_the_picture() -> None:
    """A phase without its last axis is broadcast to another picture."""
    truth = malus.render(SCENE, renderer="torrance-sparrow")

    def flat(observation: malus.Observation) -> malus.Components:
        image = observation.image
        stokes = stokes_from_extremes(0.6 * image, 0.4 * image, 0 * image[..., 0])
        return malus.Components(stokes[..., 0], stokes[..., 1], stokes[..., 2])

    with pytest.raises(InputError, match=r"expected image of shape .* found shape \(8, 8, 8\)"):
        malus.score(truth, malus.Method("flat", frozenset(), flat, "without its last axis"))


@pytest.mark.parametrize("needs", ["alpha", ["alpha"], ("alpha",), {"alpha"}])
def test_what_a_method_needs_may_be_a_list(needs: Any) -> None:
    truth = malus.render(SCENE, renderer="torrance-sparrow")
    assert malus.observe(truth, needs).alpha == 0.3
    asked: list[object] = []

    def reconstruct(observation: malus.Observation) -> malus.Components:
        asked.append(observation.alpha)
        return malus.get_method("unpolarised").reconstruct(observation)

    method = malus.Method("mine", needs, reconstruct, "asks for the roughness", optional=needs)
    assert method.needs == method.optional == {"alpha"}
    malus.score(truth, method)
    assert asked == [0.3] * len(asked)
    assert asked


@pytest.mark.parametrize("name", ["i_min", "phase"])
def test_extremes_are_of_one_shape(name: str) -> None:
    """A square image and a phase without its last axis were broadcast to another picture."""
    arrays = dict.fromkeys(("i_max", "i_min", "phase"), np.ones((16, 16, 1)))
    with pytest.raises(ValueError, match=rf"{name}: expected shape \(16, 16, 1\)"):
        malus.Components.from_extremes(**arrays | {name: np.ones((16, 16))})
    bands = {key: np.ones((4, 4, 3)) for key in arrays} | {name: np.ones((4, 4, 1))}
    assert malus.Components.from_extremes(**bands).stokes.shape == (4, 4, 3, 3)


def test_one_name_is_a_list_of_one(tmp_path: Path) -> None:
    """To Python a string is a sequence of letters."""
    suite = chosen_suite("quick", NOBODY, methods="eq8", metrics="psnr")
    assert "eq8" in suite.methods
    assert set(suite.methods) <= {"eq8", "unpolarised"}
    assert suite.metrics == ("psnr",)
    dataset = formula_dataset(tmp_path / "dataset")
    table = malus.score_dataset(dataset, "eq8").table
    assert table.method.unique().tolist() == ["eq8"]
    results = malus.run(SUITE, tmp_path / "run", backend=NOBODY, report=False)
    assert malus.table(results, "skill").text("csv") == malus.table(results, ["skill"]).text("csv")
    values = {"every": 24, "levels": "blind", "shapes": "blob3", "stage": "chain"}
    asked = option_values(malus.list_studies()["single-image"], values)
    assert (asked["levels"], asked["shapes"]) == (("blind",), ("blob3",))


def test_one_folder_is_a_list_of_one(tmp_path: Path) -> None:
    """So are a capture, its method, a study beside a run, and a published set's method."""
    for angle, code in ((0, 120), (45, 90), (90, 60), (135, 90)):
        grey = PIL.Image.fromarray(np.full((8, 8), code, np.uint8))
        (tmp_path / "card").mkdir(exist_ok=True)
        grey.save(tmp_path / "card" / f"pol_{angle:03d}.png")
    one = malus.run_captures(tmp_path / "card", tmp_path / "a", methods="unpolarised", report=False)
    assert one.table.method.unique().tolist() == ["unpolarised"]
    malus.run(SUITE, tmp_path / "run", backend=NOBODY, report=False)
    with pytest.raises(InputError, match=f"{tmp_path}/run/run.json"):
        malus.report(tmp_path / "run", beside=str(tmp_path / "run"))
    malus.export(formula_dataset(tmp_path / "dataset"), "pol", tmp_path / "set")
    scored = malus.score_published(tmp_path / "set", "pol", methods="unpolarised")
    assert scored.table.method.unique().tolist() == ["unpolarised"]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("points", "many", "points: expected a whole number, found 'many'"),
        ("points", 2.5, "points: expected a whole number, found 2.5"),
        ("points", None, "points: expected a whole number, found None"),
        ("megapixels", "1", "megapixels: expected a number, found '1'"),
        ("coloured", "no", "coloured: expected True or False, found 'no'"),
    ],
)
def test_options_of_a_study_are_of_their_kind(name: str, value: object, words: str) -> None:
    """Text was compared with a number; a number with a fraction failed in the middle."""
    of = {"points": "ratio", "megapixels": "reconstruct", "coloured": "single-image"}[name]
    study = malus.list_studies()[of]
    with pytest.raises(InputError, match=words):
        option_values(study, {name: value} | ({"stage": "chain"} if of == "single-image" else {}))


MESH = """
name = "mesh"
shapes = [{ kind = "mesh", path = "a.obj" }]
materials = ["pmma"]
surfaces = ["carbon"]
lights = [{ kind = "uniform" }]
wavelengths_nm = [550]
methods = ["eq8"]
"""


def test_files_of_a_suite_are_found_from_wherever_it_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As by a worker of a cluster that stands in another folder, also where options change it."""
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "ascii")
    (tmp_path / "files" / "mesh.toml").write_text(MESH, encoding="ascii")
    monkeypatch.chdir(tmp_path)
    suites = [chosen_suite("files/mesh.toml", NOBODY, samples=samples) for samples in (None, 6)]
    monkeypatch.chdir("/")
    for suite in suites:
        assert suite.shapes[0].file == tmp_path / "files" / "a.obj"
        assert pickle.loads(pickle.dumps(suite)).shapes[0].checked().is_file()
    assert suites[1].sampling.samples == 6


@pytest.mark.parametrize(
    "record",
    ["[]", "null", '{"suite": 3}', "{}", '{"suite": {}}', '{"suite": {"name": "a"}, "seconds": 4}'],
)
def test_a_record_of_something_else_is_no_run(record: str, tmp_path: Path) -> None:
    run(SUITE, tmp_path, NOBODY)
    assert read_results(tmp_path).run["suite"]["name"] == SUITE.name
    (tmp_path / RUN).write_text(record, encoding="ascii")
    with pytest.raises(InputError, match=r"finished run, found a run\.json that is the record"):
        read_results(tmp_path)
    for command in (("compare", str(tmp_path), str(tmp_path)), ("report", str(tmp_path))):
        done = run_malus(*command)
        assert done.returncode == 2
        assert "the record of something else" in one_line(done.stderr)


@pytest.mark.parametrize("missing", ["noise", "note", "rows"])
def test_an_incomplete_table_is_told_in_one_line(missing: str, tmp_path: Path) -> None:
    results = run(SUITE, tmp_path, NOBODY)
    table = results.table[:0] if missing == "rows" else results.table.drop(columns=missing)
    table.to_parquet(tmp_path / TABLE)
    with pytest.raises(InputError, match=f"found a table without {missing}; `malus run`"):
        read_results(tmp_path)


@pytest.mark.parametrize(
    "missing", ["interpolation_rms", "seconds", "variant", "variant.reason", "suite.sampling.seed"]
)
def test_an_incomplete_record_is_told_in_one_line(missing: str, tmp_path: Path) -> None:
    record = run(SUITE, tmp_path, NOBODY).run
    malus.report(tmp_path)
    *outer, key = missing.split(".")
    part = record
    for name in outer:
        part = part[name]
    del part[key]
    (tmp_path / RUN).write_text(json.dumps(record), "utf-8")
    with pytest.raises(InputError, match=rf"run\.json: expected the key {missing}"):
        malus.report(tmp_path)


def test_a_run_of_which_all_failed_tells_how_it_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("malus.bench.running.truths.render_torrance_sparrow", None)
    with pytest.raises(InputError, match=r"2 that failed.*; `retry_failed` tries them again"):
        run(SUITE, tmp_path, NOBODY)
    told = run_malus("status", str(tmp_path))
    assert "0 done, 2 failed, 0 left" in told.stdout
    assert "--retry-failed tries the failed ones again" in told.stdout
    assert "goes on where it was" not in told.stdout


def test_what_a_next_run_does_with_failures_is_told_by_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wrong input is tried again by every run: the user may have mended it."""

    def refuses_steep_light(scene: Scene) -> malus.Truth:
        if scene.light.label == "distant 60°":
            raise InputError("mine.obj", "a mesh", "none", "give one")
        return render_torrance_sparrow(scene)

    monkeypatch.setattr("malus.bench.running.truths.render_torrance_sparrow", refuses_steep_light)
    (tmp_path / "mine.toml").write_text(TINY_SUITE, "utf-8")
    data = str(tmp_path / "data")
    told = run_malus("render", str(tmp_path / "mine.toml"), "--out", data)
    assert told.returncode == 1
    assert "a next run tries again what failed for a wrong input, and leaves out" in told.stderr
    mended = "The same command tries again what failed for a wrong input"
    assert f"{mended}.\n" in run_malus("status", data).stdout
    failed = [("sphere", Failure(None, None, "why", mendable)) for mendable in (True, False)]
    progress = Status("dataset of mine", "scenes", total=2, failed=failed, finished=True)
    monkeypatch.setattr("malus.bench.running.status.status", lambda _: progress)
    assert f"{mended}, --retry-failed the others.\n" in run_malus("status", data).stdout


def test_errors_of_other_libraries_have_a_first_line() -> None:
    class Odd(Exception):
        strerror = 7

    assert first_line(Odd("bad header\nat 7")) == "bad header"
    assert first_line(OSError(28, "No space left on device")) == "No space left on device"
