"""The command line as a user meets it: what it prints, where, and its exit codes."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pandas as pd
import pytest
from made_up import made_up_truth
from runs import one_line, run_malus, run_malus_process

from malus.bench import read_results
from malus.bench.cli import main
from malus.bench.public.lists import list_metrics
from malus.bench.running.output_folder import FOLDERS, prepare_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.self_check import Check
from malus.renderers.variant import choose
from malus.scenes import InputError
from malus.scenes.core.result_files import HEADLINES, PARTS, RUN, TABLE
from malus.scenes.random_suite.random_scenes import SceneDraws

TINY = ["--resolution", "12", "--samples", "4"]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "quick"
    done = run_malus("run", "quick", "--out", str(out), *TINY)
    assert done.returncode == 0, done.stderr
    return out


def test_a_run_leaves_results_report_and_record(finished: Path) -> None:
    names = {path.name for path in finished.iterdir()}
    assert {TABLE, HEADLINES, RUN, "summary.md", "figure5.svg"} <= names
    assert not [name for name in names if name.endswith(".png")]
    results = read_results(finished)
    assert set(results.table.method) == {"unpolarised", "eq8", "visible", "half_vector"}
    assert results.run["suite"]["sampling"]["samples"] == 4
    assert results.run["versions"]["mitsuba"].startswith("3.9")
    assert results.run["seconds"]["total"] > 0
    inapplicable = results.table[results.table.metric == "inapplicable"]
    assert set(inapplicable.light) == {"uniform"}
    assert set(inapplicable.method) == {"half_vector"}
    assert "distant" in inapplicable.note.iloc[0]
    assert not list(finished.rglob(".*")), "temporary files left behind"


def test_a_second_run_takes_over_what_is_there(finished: Path) -> None:
    before = pd.read_parquet(finished / TABLE)
    part = next((finished / PARTS).glob("*.parquet"))
    part.unlink()
    # In a process of its own: nothing that a library prints may stand beside the JSON.
    done = run_malus_process("run", "quick", "--out", str(finished), *TINY, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["methods"]
    pd.testing.assert_frame_equal(pd.read_parquet(finished / TABLE), before)
    run = json.loads((finished / RUN).read_text("utf-8"))
    assert run["families_taken_over"] == run["families"] - 1


def test_another_seed_is_another_run(finished: Path) -> None:
    done = run_malus("run", "quick", "--out", str(finished), *TINY, "--seed", "9")
    assert done.returncode == 0
    assert json.loads((finished / RUN).read_text("utf-8"))["families_taken_over"] == 0


def bad_mesh(folder: Path, content: str) -> str:
    mesh = folder / "mesh.obj"
    mesh.write_text(content, "utf-8")
    suite = folder / "suite.toml"
    suite.write_text(
        'name = "m"\nshapes = [{ kind = "mesh", path = "mesh.obj" }]\nmaterials = ["water"]\n'
        'surfaces = ["carbon"]\nlights = [{ kind = "uniform" }]\nwavelengths_nm = [500]\n'
        'methods = ["eq8"]\ncamera = { resolution = 8 }\nsampling = { samples = 2 }\n',
        "utf-8",
    )
    return str(suite)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["run", "nosuch"], "fig5"),
        (["run", "mendet"], "did you mean mended?"),
        (["run", "/nonexistent/suite.toml"], "No such file"),
        (["run", "quick", "--samples", "3"], "multiple of 2"),
        (["run", "quick", "--samples", "many"], "not a valid integer"),
        (["run", "quick", "--method", "magic"], "eq8"),
        (["run", "quick", "--method", "eq88"], "did you mean eq8"),
        (["run", "quick", "--backend", "vulkan"], "llvm"),
        (["run", "quick", "--out", "/proc/nowhere"], "output folder"),
        (["run", "quick", "--out", ""], "expected a path, found an empty text"),
        (["bench", "reconstruct", "--megapixels", "nan"], "a number in 1e-5..1000, found nan"),
        (["bench", "render", "--samples", "3"], "key samples: expected a multiple of 2, found 3"),
        (["run", "quick", "--workers", "0"], "--workers': 0 is not in the range x>=1"),
        (["score", "data", "--name", "mine"], "--name is of --predictions, or of --truth"),
        (["score", "data", "--layout", "pol"], "--layout is of --predictions, or of --truth"),
        (["export", "data", "--format", "png", "--out", "o", "--pixels", "png"], "polanalyser"),
        (["doctor", "--backend", "llvm"], "--backend is of --check"),
        (["plan", "precision", "--backend", "llvm"], "and precision is a study"),
        (["capture", "x", "--angles", "0,a"], "--angles': expected numbers with commas, found"),
        (["capture", "x", "--size", "640"], "expected WIDTHxHEIGHT, found '640'"),
        (["capture", "x", "--size", "6.5x4"], "expected WIDTHxHEIGHT, found '6.5x4'"),
        (["filter", "x", "--light", "1,2"], "expected three numbers X,Y,Z, found '1,2'"),
        (["list", "xyz"], "or leave it out for all"),
        (["list", "method"], "found method; did you mean methods"),
        (["report", "r", "--table", "csv", "--png"], "--png: expected no --table beside it"),
        (["report", "r", "--table", "csv", "--with", "s"], "--with: expected no --table"),
        (["frobnicate"], "frobnicate"),
        (["lst"], "No such command 'lst'. Did you mean 'list'? See `"),
        (["run", "quick", "--frobnicate"], "--frobnicate"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_bad_input_is_one_line_and_exit_code_2(arguments: list[str], says: str) -> None:
    done = run_malus(*arguments)
    assert done.returncode == 2
    assert says in one_line(done.stderr)


@pytest.mark.parametrize("key", ["methods", "metrics"])
@pytest.mark.parametrize("word", ["run", "plan"])
def test_a_wrong_name_is_told_where_it_stands(tmp_path: Path, key: str, word: str) -> None:
    """In the suite's file, not in an option that nobody gave."""
    suite = Path(bad_mesh(tmp_path, ""))
    lines = [line for line in suite.read_text("utf-8").splitlines() if not line.startswith(key)]
    suite.write_text("\n".join([*lines, f'{key} = ["nosuch"]\n']), "utf-8")
    done = run_malus(word, str(suite))
    assert done.returncode == 2
    assert one_line(done.stderr).startswith(f"malus: {suite}, key {key}: expected one of")


@pytest.mark.parametrize(
    "option", [("--method", "nosuch"), ("--metric", "nosuch"), ("--workers", "0")]
)
def test_a_mistake_is_all_that_is_printed(option: tuple[str, str]) -> None:
    """The suite's description stood before it."""
    done = run_malus("run", "quick", *option)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert not done.stdout


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("run", "quick", "--out", "paper"), "goes on where it was"),
        (("run", "stress"), "begins anew"),
        (("run", "--out", "results/new", "--seed=2", "stress"), "begins anew"),
        (("train", "dataset", "--ablate"), "begins anew"),
        (("train", "dataset", "--steps", "9"), "goes on from its last validation"),
        (("train", "dataset", "--out", "other.onnx"), "begins anew"),
        (("export", "data"), "begins anew"),
        ((), "begins anew"),
    ],
)
def test_a_stop_tells_what_the_same_command_does(
    words: tuple[str, ...], says: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A training keeps nothing before its first validation, and said that it goes on."""

    def stopped(**_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("malus.bench.cli.cli.main", stopped)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.onnx.training").mkdir()
    (tmp_path / "net.onnx.training" / "state.npz").touch()
    done = run_malus(*words)
    assert (done.returncode, done.stderr) == (130, f"malus: stopped; the same command {says}\n")


@pytest.mark.parametrize("module", ["click", "malus.bench.commands.train"])
def test_a_stop_while_commands_are_imported_is_one_line(module: str, tmp_path: Path) -> None:
    script = (
        "import sys\n"
        "class Stops:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == '{module}': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Stops())\n"
        "from malus.bench.cli import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stderr) == (130, "malus: stopped; nothing was written\n")


def test_a_process_ends_with_one_line_and_exit_code_2() -> None:
    done = run_malus_process("run", "nosuch")
    assert done.returncode == 2
    assert "fig5" in one_line(done.stderr)
    assert not done.stdout


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "mesh.obj"),
        ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "mesh.obj"),
        ("v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "mesh.obj"),
    ],
    ids=["empty", "NaN", "no extent"],
)
def test_bad_meshes_are_one_line_and_exit_code_2(tmp_path: Path, content: str, says: str) -> None:
    done = run_malus("run", bad_mesh(tmp_path, content), "--out", str(tmp_path / "out"))
    assert done.returncode == 2, done.stderr
    assert says in one_line(done.stderr)


@pytest.mark.parametrize("study", ["stress", "precision"])
def test_a_study_has_a_plan_and_takes_no_options_of_suites(study: str) -> None:
    planned = run_malus("plan", study)
    assert planned.returncode == 0, planned.stderr
    assert f"`malus run {study}`" in planned.stdout
    for option, value in (("--samples", "4"), ("--seed", "0")):
        refused = run_malus("run", study, option, value)
        assert refused.returncode == 2
        assert f"found {option}; leave it out" in refused.stderr


def test_a_run_into_a_dataset_is_refused_and_loses_nothing(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path) as writer:
        writer.add(made_up_truth())
    before = contents(tmp_path)
    done = run_malus("run", "quick", *TINY, "--out", str(tmp_path))
    assert done.returncode == 2
    assert "expected a new folder, or a run, found a dataset; choose another --out" in done.stderr
    assert contents(tmp_path) == before


@pytest.mark.parametrize("what", sorted(set(FOLDERS.values())))
@pytest.mark.parametrize("mark", FOLDERS)
def test_a_folder_takes_what_one_command_writes(tmp_path: Path, mark: str, what: str) -> None:
    (tmp_path / mark).write_text("all that there is", "utf-8")
    before = contents(tmp_path)
    if FOLDERS[mark] == what:
        assert prepare_folder(tmp_path, what) == tmp_path
    else:
        with pytest.raises(InputError, match=f"{what}, found {FOLDERS[mark]}"):
            prepare_folder(tmp_path, what)
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("error", "ending"),
    [
        (MemoryError("Unable to allocate 10.7 PiB"), " (Unable to allocate 10.7 PiB)"),
        (MemoryError(), ""),
        (
            ImportError("a.so: failed to map segment from shared object"),
            " (a.so: failed to map segment from shared object)",
        ),
    ],
    ids=["size", "unknown", "library"],
)
def test_too_little_memory_is_one_line(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: Exception,
    ending: str,
) -> None:
    def needs_much(**_: object) -> None:
        raise error

    monkeypatch.setattr("malus.bench.cli.cli.main", needs_much)
    monkeypatch.setattr("malus.bench.cli.signal.signal", lambda *_: None)
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    said = capsys.readouterr().err
    expected = "malus: expected enough memory, found too little; ask for less at once"
    assert said == f"{expected}{ending}\n"


def test_lists_name_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without drawing the scenes of a random suite, which takes half a minute for `photos`."""
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.delattr(SceneDraws, "scene")
    done = run_malus("list")
    assert done.returncode == 0
    for name in ("fig5", "half_vector", "polystyrene", "obsidian", "torus", "incidence_deg"):
        assert name in done.stdout


def test_doctor_tells_the_variant_as_json() -> None:
    done = run_malus("doctor", "--json")
    assert done.returncode == 0
    found = json.loads(done.stdout)
    assert found["variant"].endswith("_polarized")
    assert found["packages"]["mitsuba"]


def test_no_llvm_means_scalar_and_says_how_to_mend_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nonexistent")
    done = run_malus_process("doctor", "--json")
    found = json.loads(done.stdout)
    assert found["variant"] in ("scalar_spectral_polarized", "cuda_ad_mono_polarized")
    if found["variant"].startswith("scalar"):
        assert "libllvm19" in found["advice"]


def test_every_command_has_an_example_in_its_help() -> None:
    from malus.bench.cli import cli

    for name, command in cli.commands.items():
        assert f"malus {name}" in (command.help or ""), name


@pytest.mark.parametrize("group", [(), ("bench",)])
def test_the_list_of_commands_tells_what_each_does(group: tuple[str, ...]) -> None:
    """The whole sentence; what begins the job comes first."""
    from malus.bench.cli import cli

    told = run_malus(*group, "--help").stdout
    listed = " ".join(told.split("Commands:")[1].split())
    commands = cli.commands["bench"].commands if group else cli.commands
    for name, command in commands.items():
        assert f"{name} {command.get_short_help_str(999)}" in listed
    assert "..." not in listed
    assert group or listed.startswith("run ")


def test_version() -> None:
    done = run_malus("--version")
    assert done.returncode == 0
    assert version("malus") in done.stdout


def test_doctor_checks_what_renders_here() -> None:
    done = run_malus("doctor", "--check", "--json")
    assert done.returncode == 0, done.stdout
    checks = json.loads(done.stdout)
    assert {"uniform light", "furnace", "brewster"} <= {check["name"] for check in checks}
    assert all(check["passed"] for check in checks)


def test_a_check_that_fails_is_exit_code_1(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = Check("sky", "σ from stored values", 9.0, 6.0, 0.1, passed=False)
    monkeypatch.setattr("malus.bench.public.doctor.checks_of", lambda *_: iter([wrong]))
    done = run_malus("doctor", "--check")
    assert done.returncode == 1
    assert "FAILED" in done.stdout
    assert "1 check, 1 failed" in done.stdout


def test_doctor_says_that_the_library_named_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nonexistent")
    monkeypatch.setattr("malus.bench.public.doctor.choose", lambda: choose("scalar"))
    done = run_malus("doctor")
    assert "DRJIT_LIBLLVM_PATH names /nonexistent, where no file is" in done.stdout


def test_errors_are_one_line_where_nobody_watches_a_bar(tmp_path: Path) -> None:
    """A bar of progress left an empty line in logs, before the error."""
    (tmp_path / "a.toml").write_text('[[capture]]\nfolder = "nowhere"\n')
    done = run_malus("capture", str(tmp_path / "a.toml"), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "nowhere: expected a folder of pictures" in line
    assert not (tmp_path / "out").exists()


def test_names_to_copy_are_whole_in_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    """80 columns cut `polaranything_aolp_mae_deg` to `polaranythi…`."""
    monkeypatch.setenv("COLUMNS", "80")
    told = run_malus("list", "metrics").stdout
    assert all(f" {name} " in told for name in list_metrics())
