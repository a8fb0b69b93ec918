"""`malus export`: a dataset in the formats of other tools."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from rich.console import Console

from malus.bench.datasets.export import export
from malus.bench.running.progress import with_progress
from malus.renderers.datasets.dataset import open_dataset


def export_for_command_line(
    dataset: Path, layout: str, out: Path, pixels: str, as_json: bool
) -> None:
    """Export a dataset for the command line."""
    console = Console(stderr=True)
    opened = open_dataset(dataset)
    count = with_progress(
        console, "scenes", lambda show: export(opened, layout, out, pixels, progress=show)
    )
    if as_json:
        sys.stdout.write(json.dumps({"out": str(out), "scenes": count}) + "\n")
    else:
        console.print(f"{count} scenes written to {out}", highlight=False)
