"""`malus bench`: options and what is printed; the work is elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

_FOLDER = click.Path(path_type=Path, file_okay=False)
_OUT = click.option("--out", type=_FOLDER, help="Write a JSON file with the figures here.")


@click.group("bench")
def bench_command() -> None:
    """Time and error of one part, beside what a user would do without malus, in one run.

    \b
    Example:
      malus bench reconstruct --megapixels 2
    """


@bench_command.command("ratio")
@click.option("--points", type=click.IntRange(1, 10**8), default=1_000_000, show_default=True)
@_OUT
def ratio(points: int, out: Path | None) -> None:
    """Tables of one surface, and R of scattered points, beside dblquad a point.

    \b
    Example:
      malus bench ratio --points 100000
    """
    from dataclasses import asdict

    from malus.bench.studies.speed_ratio import measure_speed, report_lines

    speeds = measure_speed(points)
    _tell(report_lines(speeds), out, "ratio", [asdict(speed) for speed in speeds])


@bench_command.command("reconstruct")
@click.option("--megapixels", type=float, default=10.0, show_default=True)
@click.option("--repeats", type=click.IntRange(min=1), default=5, show_default=True)
@_OUT
def reconstruct(megapixels: float, repeats: int, out: Path | None) -> None:
    """Whole RGB images, beside copying the same bytes.

    \b
    Example:
      malus bench reconstruct --megapixels 2
    """
    from dataclasses import asdict

    from malus.bench.studies.speed_reconstruct import measure, report_lines
    from malus.scenes.core.errors import InputError

    if not 1e-5 <= megapixels <= 1000:  # nor NaN, which a click range lets through
        hint = "choose another size"
        raise InputError("--megapixels", "a number in 1e-5..1000", f"{megapixels:g}", hint)
    speeds = measure(megapixels, repeats)
    figures = [
        asdict(speed) | {"pixels_a_second": speed.pixels_a_second, "times_copy": speed.times_copy}
        for speed in speeds
    ]
    _tell(report_lines(speeds), out, "reconstruct", figures)


@bench_command.command("render")
@click.option("--resolution", type=click.IntRange(min=2), default=128, show_default=True)
@click.option("--samples", type=click.IntRange(min=2), default=64, show_default=True)
@click.option("--backend", default="auto", help="auto, cuda, llvm or scalar.")
@_OUT
def render(resolution: int, samples: int, backend: str, out: Path | None) -> None:
    """Polariser images of 24 materials, 5 surfaces and 8 bands, beside two ways by hand.

    \b
    Example:
      malus bench render --resolution 64
    """
    from dataclasses import asdict

    from malus.bench.studies.speed_render import LIGHTS, compare, report_lines
    from malus.renderers.variant import choose
    from malus.scenes.camera import Camera
    from malus.scenes.scene import Sampling

    where = "malus bench render"
    camera = Camera.parse({"resolution": resolution}, where)
    sampling = Sampling.parse({"samples": samples}, where)
    variant = choose(backend)
    lines, figures = [], []
    for light in LIGHTS:
        speeds = compare(variant, camera, sampling, light)
        lines += report_lines(speeds, light)
        figures += [{"light": light.label, "way": way} | asdict(s) for way, s in speeds.items()]
    _tell(lines, out, "render", figures)


@bench_command.command("scaling")
@click.option("--most", type=click.IntRange(48, 10**6), default=10_000, show_default=True)
@_OUT
def scaling(most: int, out: Path | None) -> None:
    """What many scenes cost besides rendering: planning, tables, files, memory, the scheduler.

    Up to `--most` scenes are measured with made-up results, in steps of ten; 1e5 and 1e6 are drawn
    on from there.

    \b
    Example:
      malus bench scaling --most 1000
    """
    from dataclasses import asdict

    from malus.bench.studies.scaling import measure, messages, report_lines

    scales, carried = measure([max(24, most // 100), most // 10, most]), messages()
    figures = [asdict(scale) for scale in scales] + [asdict(carried)]
    _tell(report_lines(scales, carried), out, "scaling", figures)


def _tell(lines: list[str], out: Path | None, name: str, figures: list[dict[str, Any]]) -> None:
    """Print the lines; write the figures as NAME.json."""
    for line in lines:
        click.echo(line)
    if out is None:
        return
    import json

    from malus.bench.running.output_folder import prepare_folder
    from malus.scenes.core.files import write_whole

    text = json.dumps(figures, indent=2, sort_keys=True) + "\n"
    path = prepare_folder(out) / f"{name}.json"
    write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
