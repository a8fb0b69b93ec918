"""`malus export`: a dataset in the formats of other tools."""

from __future__ import annotations

from pathlib import Path

import click

from malus.bench.commands.options import FOLDER, command, split_option

FORMATS = (
    "numpy", "png", "polanalyser", "webdataset", "hdf5", "rgb2pol", "pol", "polaranything",
    "neisf",
)  # fmt: skip


@command("export")
@click.argument("dataset", type=FOLDER)
@click.option(
    "--format",
    "layout",
    type=click.Choice(FORMATS),
    required=True,
    help="See above.",
)
@click.option("--out", type=FOLDER, required=True, help="Folder to write to.")
@click.option(
    "--pixels",
    type=click.Choice(["exr", "png"]),
    help="Of polanalyser's images: lossless floats, or 16 bits [default: exr].",
)
@split_option
@click.option("--json", "as_json", is_flag=True, help="Print what was done as JSON.")
def export_command(
    dataset: Path, layout: str, out: Path, pixels: str | None, split: str | None, as_json: bool
) -> None:
    """Write DATASET in the format of other tools; conventions.json beside it says what is what.

    \b
    numpy          one .npz a scene: all arrays
    png            16-bit AoLP and DoLP of every band
    polanalyser    one image a polariser angle and band, with --pixels
    webdataset     tar shards of .npy, to train: all arrays, uncompressed
    hdf5           one file: all arrays, compressed (needs h5py)
    rgb2pol        NNNN/s0.png to s3.png, each on its own scale
    pol            pol000 to pol135, normal, mask: linear, 16 bits
    polaranything  AoLP_16bit, DoLP_16bit, mask: of the mean of the bands
    neisf          one object from many sides: images_s0 to s2, masks, poses_bounds.npy

    \b
    Example:
      malus export quick-dataset --format numpy --out quick-numpy
    """
    if pixels is not None and layout != "polanalyser":
        raise click.UsageError("--pixels is of --format polanalyser")
    from malus.bench.commands.console import plain_console
    from malus.bench.commands.printing import print_json
    from malus.bench.datasets.export import export
    from malus.bench.running.progress import with_progress
    from malus.renderers.datasets.dataset import open_folder

    opened = open_folder(dataset)
    missing = max(0, opened.record.planned - len(opened))
    opened.check_begun()
    chosen = opened if split is None else opened.of_split(split)
    console = plain_console(stderr=True)
    count = with_progress(
        console, "scenes", lambda show: export(chosen, layout, out, pixels or "exr", show)
    )
    if as_json:
        print_json({"out": str(out), "scenes": count, "missing": missing})
    else:
        if missing:
            console.print(not_rendered(missing, dataset))
        console.print(f"{count} scenes written to {out}")


def not_rendered(missing: int, dataset: Path) -> str:
    """A sentence on the scenes that a dataset lacks."""
    return f"{missing} more of the suite are not rendered; see `malus status {dataset}`"
