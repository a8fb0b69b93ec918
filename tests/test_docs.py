"""The documents say what is true: their commands and examples run, their links lead somewhere.

The documents are README, the pages of the site and the files beside README. They are read for
commands, so that a new one is run as well: every line of a fenced `sh` block, every indented line
that starts like a command, every `run:` of a workflow. Every page is followed in a folder of its
own. Renders are made tiny and long suites are replaced by `quick`; a command that this file does
not know how to run fails. A block that cannot be run says why in the line above it:
`<!-- not run: REASON -->`.
The built site is tested in `test_site.py`, the tutorials in `test_tutorials.py`.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import runpy
import shlex
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
import pandas as pd
import pytest
import trimesh
from click.testing import CliRunner
from PIL import Image
from runs import no_worker_process

import malus
from malus.bench import read_results
from malus.bench.cli import cli
from malus.bench.documents.site_hooks import generated_pages, heading_anchor
from malus.bench.scoring.extra_metrics import METRICS
from malus.reconstruct import methods
from malus.renderers import render
from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere, load_suite, suite_names
from malus.scenes.suite import Suite

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "reports" / "docs"
README, FILES = ROOT / "README.md", DOCS / "files.md"
METHODS = DOCS / "guides" / "methods.md"
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md"))]

WORDS_OF_THE_README = 1000
"""More than a newcomer reads; the rest belongs into the pages of the site."""

TINY = ["--resolution", "12", "--samples", "4"]
TINY_BENCH = {
    "cores": ["--most", "1", "--every", "24", *TINY],
    "reconstruct": ["--megapixels", "0.01"],
    "scaling": ["--most", "48"],
    "paper": ["--every", "24", "--resolution", "12"],
    "separation": ["--every", "24", "--resolution", "12"],
}
STAND_IN = dict.fromkeys(suite_names(), "quick")
"""At a tiny size too, the large suites take minutes: what is tested here is the command."""

NOT_RUN = {
    "python -m pip install": "needs a network",
    "sudo apt-get": "needs a network and changes the machine",
    'cat gate.md >> "$GITHUB_STEP_SUMMARY"': "a variable of the CI service",
}
"""Commands that are documented and cannot be run here, with the reason."""

FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MARKED = re.compile(r"^<!-- not run: [^\n]+ -->\n```.*?^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(
    r"^ {4}((?:malus|make|python|pip|git|\.ci/run|sudo|apt-get)\b.*)$", re.MULTILINE
)
WORKFLOW = re.compile(r"^ *- run: (.*)$", re.MULTILINE)
FILE_NAME = re.compile(r"# (\S+\.\w+)\n")


class Block(NamedTuple):
    """A fenced block; an indented command is a block of its own."""

    language: str
    text: str


def blocks(document: Path) -> Iterator[Block]:
    text = MARKED.sub(blanked, document.read_text("utf-8"))
    found = [(m.start(), Block(m[1], m[2])) for m in FENCE.finditer(text)]
    plain = FENCE.sub(blanked, text)
    found += [(m.start(), Block("sh", m[1])) for m in INDENTED.finditer(plain)]
    yield from (block for _, block in sorted(found))


def blanked(found: re.Match[str]) -> str:
    """Blanks in its place, so that places in the text stay what they are."""
    return re.sub(r"[^\n]", " ", found[0])


def name_of(document: Path) -> str:
    return document.relative_to(ROOT).as_posix()


def commands(block: Block) -> list[str]:
    if block.language in ("yaml", "yml"):
        return WORKFLOW.findall(block.text)
    lines = block.text.replace("\\\n", " ").splitlines()
    return [bare for line in lines if (bare := re.sub(r"(^|\s+)#.*$", "", line).strip())]


def all_commands() -> list[str]:
    shell = ("sh", "bash", "console", "yaml", "yml")
    return [c for d in DOCUMENTS for b in blocks(d) if b.language in shell for c in commands(b)]


def prose(document: Path) -> str:
    return FENCE.sub("", document.read_text("utf-8"))


def code_spans(document: Path) -> list[str]:
    return [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose(document))]


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """A folder of a user's: a mesh, pictures and the guide's method; the rest the pages make."""
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "vase.obj")
    take_pictures(tmp_path)
    method = next(b for b in blocks(METHODS) if b.text.startswith("# my_method.py"))
    (tmp_path / "my_method.py").write_text(method.text, "utf-8")
    return tmp_path


def take_pictures(folder: Path) -> None:
    """A photograph of a ball, four of it through a polariser, and a polarisation camera's frame."""
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
        light=Distant(incidence_deg=40),
        camera=Camera(resolution=48),
        wavelengths_nm=(450.0, 550.0, 650.0),
    )
    truth = render(scene, renderer="torrance-sparrow")

    def save(image: np.ndarray, name: str) -> None:
        grey = np.clip(255 * image / truth.image.max(), 0, 255).astype(np.uint8)
        Image.fromarray(grey[..., ::-1].copy()).save(folder / name)

    for name in ("vase.jpg", "holiday.jpg"):
        save(truth.image, name)
    (folder / "kettle").mkdir()
    for horizontal in (0, 45, 90, 135):
        save(truth.polarised(horizontal - 90.0), f"kettle/pol_{horizontal:03d}.png")
    frame = np.empty((48, 48))  # of a polarisation camera: one angle a pixel
    for row, column, horizontal in ((0, 0, 90), (0, 1, 45), (1, 0, 135), (1, 1, 0)):
        seen = truth.polarised(horizontal - 90.0).mean(axis=-1)
        frame[row::2, column::2] = seen[row::2, column::2]
    codes = np.clip(255 * frame / truth.image.max(), 0, 255).astype(np.uint8)
    Image.fromarray(codes).save(folder / "frame.png")
    mask = Image.fromarray(255 * truth.mask.astype(np.uint8))
    for name in ("vase_mask.png", "kettle_mask.png", "frame_mask.png"):
        mask.save(folder / name)


@pytest.fixture
def no_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures take seconds a run: `finished` writes a report once."""
    for module in ("malus.reports.write", "malus.bench.public.report"):
        monkeypatch.setattr(f"{module}.write_report", lambda *_, **__: [])


def follow(document: Path, folder: Path) -> dict[str, Any]:
    """Do everything that a document shows, in its order; names of its Python examples."""
    names: dict[str, Any] = {}
    with contextlib.chdir(folder):
        for block in blocks(document):
            named = FILE_NAME.match(block.text)
            if named and block.language in ("python", "toml"):
                (folder / named[1]).write_text(block.text, "utf-8")
            elif block.language == "python":
                exec(compile(block.text, document.name, "exec"), names)
            elif block.language == "toml":
                tomllib.loads(block.text)
            elif block.language in ("sh", "bash", "console", "yaml", "yml"):
                for command in commands(block):
                    execute(command)
            else:
                assert block.language == "text", f"{document.name}: what is {block.language}?"
    return names


def execute(command: str) -> None:
    words = shlex.split(command)
    if any(command.startswith(known) for known in NOT_RUN):
        return
    if words[0] == "make":
        assert set(words[1:]) <= set(make_targets()), command
    elif words[0] == "python" and words[1].endswith(".py"):
        runpy.run_path(words[1], run_name="__main__")
    elif words[0] == "malus":
        in_process(command, tiny(words[1:]))
    else:
        pytest.fail(f"documented, but this test does not know how to run it: {command}")


def make_targets() -> list[str]:
    return re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)


def tiny(words: list[str]) -> list[str]:
    if words[0] == "bench":
        return [*words[:2], *TINY_BENCH[words[1]]]
    if words[0] not in ("run", "render"):
        return words
    renamed = [STAND_IN.get(word, word) if at == 1 else word for at, word in enumerate(words)]
    return [*renamed, *TINY]


def in_process(command: str, words: list[str]) -> None:
    """In this process: a fresh one would spend its time on imports."""
    assert words[0] in cli.commands, command
    with no_worker_process():
        result = CliRunner().invoke(cli, words)
    assert result.exit_code == 0, f"{command}: {result.exception!r}\n{result.output}"


def test_names_in_contributing_exist() -> None:
    """Functions, classes and constants in backticks are those of the sources."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    sources = "".join(
        path.read_text("utf-8")
        for folder in ("scenes", "renderers", "reconstruct", "reports", "bench", "tests")
        for path in (ROOT / folder).rglob("*.py")
    )
    for name in re.findall(r"`(?:\w+\.)*(_\w+|[a-z]+_\w+|[A-Z]\w+)`", text):
        assert re.search(rf"\b{name}\b", sources), name


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_what_a_document_shows_works(
    document: Path, workspace: Path, no_reports: None, stand_in_net: Path
) -> None:
    names = follow(document, workspace)
    promised = PROMISES.get(name_of(document).removeprefix("reports/docs/"))
    if promised:
        promised(workspace, names)


def the_skills_are_as_told(_: Path, names: dict[str, Any]) -> None:
    truth = names["truth"]
    assert malus.score(truth, "eq8").skill < 0, "the page calls it negative"
    # Both use Fresnel's equations at the one facet that mirrors: what is left is noise.
    assert malus.score(truth, "half_vector+body").skill == pytest.approx(1.0, abs=0.01)


def mine_is_scored(folder: Path, _: dict[str, Any]) -> None:
    found = read_results(folder / "results" / "mine").table
    assert set(found.method) == {"unpolarised", "eq8", "mine"}


def the_network_is_scored(folder: Path, _: dict[str, Any]) -> None:
    assert set(read_results(folder / "results" / "network").table.method) == {"eq8", "mine"}


def the_gate_has_spoken(folder: Path, _: dict[str, Any]) -> None:
    assert (folder / "gate.md").read_text("utf-8")


def the_vase_is_scored(folder: Path, _: dict[str, Any]) -> None:
    assert set(read_results(folder / "results" / "vase").table["shape"]) == {"vase", "torus"}


PROMISES: dict[str, Callable[[Path, dict[str, Any]], None]] = {
    "README.md": the_skills_are_as_told,
    "start/first_result.md": the_skills_are_as_told,
    "guides/methods.md": mine_is_scored,
    "guides/predictions.md": the_network_is_scored,
    "guides/gates.md": the_gate_has_spoken,
    "guides/scenes.md": the_vase_is_scored,
}
"""What is there after a page was followed."""


def test_readme_is_short() -> None:
    assert len(README.read_text("utf-8").split()) <= WORDS_OF_THE_README


def test_a_block_that_is_not_run_says_why() -> None:
    for document in DOCUMENTS:
        text = document.read_text("utf-8")
        markers = re.findall(r"^<!-- not run", text, re.MULTILINE)
        assert len(markers) == len(MARKED.findall(text)), (
            f"{document.name}: `not run: REASON`, then ```"
        )


def test_the_commands_were_found() -> None:
    # A broken pattern would find none and pass.
    assert len(all_commands()) >= 25
    assert commands(Block("sh", "malus list  # what\n\n# no\nmake a \\\n b\n")) == [
        "malus list",
        "make a   b",
    ]


def test_commands_in_running_text_exist() -> None:
    for document in DOCUMENTS:
        for span in code_spans(document):
            words = span.split()
            if words[0] == "make" and len(words) > 1:
                assert set(words[1:]) <= set(make_targets()), f"{document.name}: {span}"
            if words[0] != "malus" or len(words) == 1 or words[1].startswith("-"):
                continue
            assert words[1] in cli.commands, f"{document.name}: no command {span}"
            command = cli.commands[words[1]]
            known = {o for p in command.params for o in p.opts} | {"--help"}
            if isinstance(command, click.Group):
                assert len(words) == 2 or words[2] in {*command.commands, "STUDY"}, span
                known |= {o for c in command.commands.values() for p in c.params for o in p.opts}
            options = set(re.findall(r"--[\w-]+", span))
            assert options <= known, f"{document.name}: {span} has no {options - known}"


def test_every_command_is_shown_somewhere() -> None:
    shown = "".join(document.read_text("utf-8") for document in DOCUMENTS)
    for name in cli.commands:
        assert f"malus {name} " in shown, f"no page shows malus {name}"


def test_a_guide_has_every_method() -> None:
    named = set(code_spans(METHODS))
    for name in methods():
        assert name in named or name.removesuffix("+body") in named, f"the guide names no {name}"


def test_every_command_that_renders_can_be_made_tiny() -> None:
    for name in ("run", "render"):
        options = {o for p in cli.commands[name].params for o in p.opts}
        assert {"--resolution", "--samples"} <= options


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_links_and_pictures_exist(document: Path) -> None:
    text = prose(document)
    for target in re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'src="([^"]+)"', text):
        if target.startswith("https://"):
            continue
        path, _, anchor = target.partition("#")
        linked = (document.parent / path).resolve() if path else document
        if linked.is_relative_to(DOCS) and linked.relative_to(DOCS).as_posix() in MADE:
            continue  # the site has it: test_site.py follows the link
        assert linked.is_file(), f"{document.name}: {target}"
        if anchor:
            headings = re.findall(r"^#+ (.*)$", linked.read_text("utf-8"), re.MULTILINE)
            anchors = [heading_anchor(heading, "-") for heading in headings]
            assert anchor in anchors, f"{document.name}: {target}"


MADE = generated_pages()
"""Pages that no file holds."""


def test_the_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE)
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert cited
    assert newest
    assert project["version"] == cited[1] == newest[1]


def test_pictures_are_small() -> None:
    pictures = [
        *(ROOT / "reports" / "gallery").iterdir(),
        *DOCS.rglob("*.png"),
        *DOCS.rglob("*.svg"),
    ]
    assert pictures
    for picture in pictures:
        assert picture.stat().st_size < 500_000, picture


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_files_that_are_named_exist(document: Path) -> None:
    folders = r"(?:scenes|renderers|reconstruct|bench|reports|tests)/[\w./-]+"
    for span in code_spans(document):
        if re.fullmatch(folders, span):
            assert (ROOT / span).exists(), f"{document.name}: no {span}"


def test_no_machine_path_stands_in_a_document() -> None:
    for document in DOCUMENTS:
        assert not re.search(r"(?<![\w.])/(home|root|tmp|work|opt)/", document.read_text("utf-8"))


def section(document: Path, heading: str) -> str:
    text = document.read_text("utf-8")
    found = re.search(rf"^(#+) {re.escape(heading)}$(.*?)(?=^##? |^### |\Z)", text, re.M | re.S)
    assert found, f"{document.name} has no section {heading}"
    return found[2]


def first_cells(text: str) -> list[str]:
    """Code spans in the first column of the tables of a section."""
    rows = re.findall(r"^\|([^|]*)\|", text, re.MULTILINE)
    return [span for row in rows for span in re.findall(r"`([^`]+)`", row)]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with every further metric, and its report."""
    folder = tmp_path_factory.mktemp("finished")
    suite = load_suite("quick").model_dump(mode="json") | {"metrics": list(METRICS)}
    suite |= {"bodies": ["unpolarised"], "materials": ["water"], "surfaces": ["carbon"]}
    suite["camera"]["resolution"], suite["sampling"]["samples"] = 12, 4
    from malus.bench import run
    from malus.reports import write_report

    write_report(run(Suite.parse(suite, "test"), folder), folder)
    return folder


def test_files_md_has_exactly_the_columns(finished: Path) -> None:
    table = read_results(finished).table
    assert first_cells(section(FILES, "Columns of the results table")) == list_in_order(table)
    headlines = pd.read_csv(finished / "results.csv")
    assert set(table.columns) - set(headlines.columns) == {"band_nm", "angle_deg"}


def list_in_order(table: pd.DataFrame) -> list[str]:
    """Columns as the page groups them; a column that it lacks comes last and fails the test."""
    page = first_cells(section(FILES, "Columns of the results table"))
    return sorted(table.columns, key=lambda name: page.index(name) if name in page else 99)


def test_files_md_has_every_metric(finished: Path) -> None:
    table = read_results(finished).table
    text = section(FILES, "Metrics")
    assert set(METRICS) <= set(first_cells(text))
    endings = ("_std", "_i_max", "_i_min")
    for name in table.metric.unique():
        bare = re.sub(r"_\d+_\d+$", "_<from>_<to>", name)
        for ending in endings:
            bare = bare.removesuffix(ending)
        assert f"`{bare}`" in text, f"files.md has no metric {name}"


def test_files_md_has_every_file_of_a_run(finished: Path) -> None:
    text = section(FILES, "A run")
    for path in finished.iterdir():
        name = path.name.replace("_polarised_body", "")
        stem, ending = os.path.splitext(name)
        known = f"`{name}`" in text or f"`{name}/" in text
        known = known or (f"`{stem}.svg`" in text and ending in (".svg", ".png", ".csv"))
        assert known, f"files.md has no {path.name}"
    assert set(json.loads((finished / "run.json").read_text("utf-8"))) == set(
        first_cells(section(FILES, "run.json"))
    )


def test_files_md_has_every_file_of_a_scene(workspace: Path) -> None:
    folder = workspace / "quick-dataset"
    with contextlib.chdir(workspace):
        execute("malus render quick --out quick-dataset")
    scene = next(path for path in folder.iterdir() if path.is_dir())
    # Only where a suite asks for them, and where arrays are in double precision.
    asked_for = {"float64.exr", "maps.exr", "raw.tiff", "sensor.exr"}
    named = first_cells(section(FILES, "A dataset"))
    assert {path.name for path in scene.iterdir()} == set(named) - asked_for


def test_files_md_has_every_key_of_a_suite() -> None:
    assert set(first_cells(section(FILES, "A suite"))) == set(Suite.model_fields)


def test_the_picture_of_the_conventions_can_be_drawn() -> None:
    script = runpy.run_path(
        str(ROOT / "bench" / "documents" / "conventions_picture.py"), run_name="picture"
    )
    figure = script["picture"](script["mirror_ball"](resolution=16, samples=4))
    assert len(figure.axes) >= 8
    cameras = script["camera_picture"](script["lit_ball"](resolution=16, samples=4))
    assert len(cameras.axes) == 2


def test_the_help_of_every_command_is_short_of_nothing() -> None:
    for name, command in cli.commands.items():
        assert command.help, name
        undocumented = [
            p.name for p in command.params if isinstance(p, click.Option) and not p.help
        ]
        assert not undocumented, f"malus {name}: {undocumented}"


def test_make_knows_what_to_do() -> None:
    """`make run` and `make test` themselves are what CI calls; here their recipes are printed."""
    for target in ("run", "test"):
        assert f"make {target}" in all_commands()
    dry = ["make", "--dry-run", "run", "test"]
    done = subprocess.run(dry, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "malus run fig5" in done.stdout
    assert "pytest" in done.stdout
