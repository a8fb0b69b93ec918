"""What a page shows works: each is followed from its top, in a folder of its own."""

from __future__ import annotations

import contextlib
import re
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from documents import (
    DOCUMENTS,
    MARKED,
    METHODS,
    ROOT,
    Block,
    all_commands,
    blocks,
    commands,
    execute,
    name_of,
)
from PIL import Image

import malus
from malus.bench import read_results
from malus.bench.cli import cli
from malus.renderers import render
from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere

FILE_NAME = re.compile(r"# (\S+\.\w+)\n")


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
    # The module that has it comes last: one first imported after that would keep the replacement.
    for module in ("bench.public.captures", "bench.public.report", "reports.write"):
        monkeypatch.setattr(f"malus.{module}.write_report", lambda *_, **__: [])


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


def test_every_command_that_renders_can_be_made_tiny() -> None:
    for name in ("run", "render"):
        options = {o for p in cli.commands[name].params for o in p.opts}
        assert {"--resolution", "--samples"} <= options


def test_make_knows_what_to_do() -> None:
    """`make run` and `make test` themselves are what CI calls; here their recipes are printed."""
    for target in ("run", "test"):
        assert f"make {target}" in all_commands()
    dry = ["make", "--dry-run", "run", "test"]
    done = subprocess.run(dry, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "malus run fig5" in done.stdout
    assert "pytest" in done.stdout
