"""Commands about datasets: render, export, score. Nothing heavy is imported before it is needed."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from malus.bench.commands.options import PLACE


@click.command("render")
@click.argument("suite")
@click.option("--out", type=PLACE, required=True, help="Folder or URL of the dataset.")
@click.option("--samples", type=int, help="Samples a pixel, instead of the suite's.")
@click.option("--resolution", type=int, help="Pixels a side, instead of the suite's.")
@click.option("--seed", type=int, help="Seed, instead of the suite's.")
@click.option("--backend", default="auto", help="auto, cuda, llvm or scalar.")
@click.option("--timeout", type=float, default=3600, help="Seconds a family may take [3600].")
@click.option("--retry-failed", is_flag=True, help="Try again what failed in an earlier run.")
@click.option("--json", "as_json", is_flag=True, help="Print what was done as JSON.")
def render_command(
    suite: str,
    out: Path,
    samples: int | None,
    resolution: int | None,
    seed: int | None,
    backend: str,
    timeout: float,
    retry_failed: bool,
    as_json: bool,
) -> None:
    """Render SUITE as a dataset: Stokes images of both lobes, normals and errors as OpenEXR.

    Stopped half-way, the same command goes on where it was. A scene that cannot be rendered is
    recorded and left out, and the exit code is 1 then; `malus status` tells why.

    \b
    Example:
      malus render quick --out quick-dataset
    """
    from malus.bench.commands.render import render_for_command_line

    overrides = {"samples": samples, "resolution": resolution, "seed": seed}
    if render_for_command_line(suite, out, overrides, backend, as_json, timeout, retry_failed):
        sys.exit(1)


@click.command("export")
@click.argument("dataset", type=PLACE)
@click.option(
    "--format",
    "layout",
    type=click.Choice(["numpy", "png", "polanalyser"]),
    required=True,
    help="numpy: one .npz a scene; png: AoLP and DoLP; polanalyser: one image an angle.",
)
@click.option("--out", type=PLACE, required=True, help="Folder to write to.")
@click.option(
    "--pixels",
    type=click.Choice(["exr", "png"]),
    default="exr",
    help="Of polanalyser's images: lossless floats, or 16 bits.",
)
@click.option("--json", "as_json", is_flag=True, help="Print what was done as JSON.")
def export_command(dataset: Path, layout: str, out: Path, pixels: str, as_json: bool) -> None:
    """Write DATASET in the format of other tools; conventions.json beside it says what is what.

    \b
    Example:
      malus export quick-dataset --format numpy --out quick-numpy
    """
    from malus.bench.commands.export import export_for_command_line

    export_for_command_line(dataset, layout, out, pixels, as_json)


@click.command("score")
@click.argument("dataset", type=PLACE)
@click.option("--method", "methods", multiple=True, help="A method; may be given several times.")
@click.option("--predictions", type=PLACE, help="Folder of somebody else's images.")
@click.option("--name", default="predictions", help="What the predictions are called in tables.")
@click.option("--out", type=PLACE, help="Folder of the results [default: results/scores].")
@click.option("--json", "as_json", is_flag=True, help="Print the numbers as JSON.")
def score_command(
    dataset: Path,
    methods: tuple[str, ...],
    predictions: Path | None,
    name: str,
    out: Path | None,
    as_json: bool,
) -> None:
    """Score methods, or images that were made elsewhere, on a stored DATASET.

    Predictions are one file a scene, <scene>.npz: `stokes` (height, width, bands, 3), or `i_max`,
    `i_min` and `phase` (height, width, bands), phase in radians anticlockwise from the vertical.
    Also <scene>.exr in the spectral layout of the dataset, or a folder <scene>/ with one
    <degrees>.npy (height, width, bands) for each of three or more polariser angles.

    \b
    Example:
      malus score quick-dataset --method eq8 --method shadowed+body
      malus score quick-dataset --predictions my-network --name mine
    """
    from malus.bench.commands.score import score_for_command_line

    folder = out if out is not None else Path("results") / "scores"
    score_for_command_line(dataset, methods, predictions, name, folder, as_json)
