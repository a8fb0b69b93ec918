"""`malus capture`. Nothing heavy is imported before the command runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from malus.bench.commands.filter import (
    in_words_of_options,
    knowledge_of,
    knowledge_options,
)
from malus.bench.commands.options import command


class Angles(click.ParamType[tuple[float, ...]]):
    """Numbers with commas, such as 0,45,90,135."""

    name = "A,B,…"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Parse numbers; anything else ends in click's one-line message."""
        try:
            return tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"expected numbers with commas, found {value!r}", param, ctx)


class Size(click.ParamType[tuple[int, int]]):
    """WIDTHxHEIGHT in pixels."""

    name = "WxH"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Parse width and height; anything else ends in click's one-line message."""
        try:
            width, height = (int(part) for part in str(value).lower().split("x"))
        except ValueError:
            self.fail(f"expected WIDTHxHEIGHT, found {value!r}", param, ctx)
        return width, height


@command("capture")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--zero",
    type=click.Choice(["vertical", "horizontal"]),
    help="Where the polariser's angles count from [default: vertical; of cameras' mosaics and "
    "polanalyser's files, horizontal].",
)
@click.option(
    "--sense",
    type=click.Choice(["anticlockwise", "clockwise"]),
    default="anticlockwise",
    show_default=True,
    help="Which way they count, as seen in the pictures.",
)
@click.option(
    "--offset", type=float, default=0.0, help="Degrees of the 0 mark from --zero, anticlockwise."
)
@click.option("--angles", type=Angles(), help="One for each page, array or picture in its order.")
@click.option(
    "--unit", type=click.Choice(["degrees", "radians"]), help="Unit of the angles as they stand."
)
@click.option("--linear", is_flag=True, help="The files' values are linear light.")
@click.option(
    "--black", help="Dark level: a code, below 1 a share of the largest, or a dark frame's file."
)
@click.option("--white", type=float, help="Level at which the sensor is full, likewise.")
@click.option(
    "--mosaic", type=Angles(), help="FOLDER is a polarisation camera's frame: 90,45,135,0."
)
@click.option(
    "--bayer",
    type=click.Choice(["rggb", "bggr", "grbg", "gbrg"]),
    help="Colours over the squares of the mosaic.",
)
@click.option("--size", type=Size(), help="Of a frame without a header.")
@click.option("--packing", help="Its pixel format: mono8, mono12, mono12p, mono12packed, mono16, …")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for maps of the fit.")
@click.option("--fit-only", is_flag=True, help="Fit the pictures and reconstruct nothing.")
@click.option("--json", "as_json", is_flag=True, help="Print the numbers as JSON.")
@knowledge_options
def capture_command(
    folder: Path,
    offset: float,
    out: Path | None,
    fit_only: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Fit pictures of FOLDER through a rotated polariser, and score a reconstruction.

    Names hold the angle (pol_000.png, pol_045.png, …), or angles.json maps names to degrees, or a
    JSON file stands beside each. FOLDER may be a TIFF of pages or a .npy stack, with --angles, or
    one frame of a polarisation camera, with --mosaic. The reconstruction sees only the mean of the
    pictures, and what the options tell.

    \b
    Example:
      malus capture kettle --zero horizontal --linear --mask kettle_mask.png
      malus capture frame.png --mosaic 90,45,135,0 --fit-only
    """
    import json

    from malus.bench.scoring.capture_score import score_capture, write_fit
    from malus.reconstruct.photos.capture import read_capture
    from malus.reconstruct.photos.capture_fit import capture_summary, fit_capture

    reading = {name: given.pop(name) for name in _READING}
    capture = read_capture(folder, offset_deg=offset, **reading)
    knowledge = knowledge_of(capture.clipped.shape, given)
    fit = fit_capture(capture)
    results: dict[str, Any] = {"fit": capture_summary(capture, fit)}
    if not fit_only:
        results["score"] = score_capture(capture, fit, knowledge, str(folder))
    if out is not None:
        write_fit(out, fit, results, capture.channels)
    click.echo(json.dumps(results, indent=1) if as_json else _report(results))


_READING = (
    "zero", "sense", "angles", "unit", "linear", "black", "white", "mosaic", "bayer", "size",
    "packing",
)  # fmt: skip
"""Options for reading FOLDER; the others describe the object."""


def _report(results: dict[str, Any]) -> str:
    """The results as lines of text."""
    fit = results["fit"]
    lines = [
        f"{fit['pictures']} pictures, residual {fit['relative_residual']:.2%} of the mean, "
        f"clipped {fit['clipped_share']:.2%}, moved at most {max(fit['shifts_pixels']):.2f} pixels",
        f"degree of polarisation: median {fit['median_dolp']:.3f}, 99 % below {fit['dolp_99']:.3f}",
        f"- {fit['assumption']}",
        *(f"hint: {hint}" for hint in fit["hints"]),
        *(f"warning: {warning}" for warning in fit["warnings"]),
    ]
    if "score" in results:
        score = results["score"]
        if score["convention"]:
            lines.append(f"warning: {score['convention']}")
        lines += [f"warning: {warning}" for warning in score["warnings"]]
        lines += [f"- {statement}" for statement in score["statements"]]
        lines.append(
            f"NMSE {score['nmse']:.2e} (doing nothing: {score['nmse_trivial']:.2e}), "
            f"skill {score['skill']:.3f}, best gain {score['best_gain']:.2f}"
        )
        for name, (mean, deviation) in score["delta_e76"].items():
            trivial = score["delta_e76_trivial"][name][0]
            label = name if name.startswith("i_") else f"{name}°"
            lines.append(
                f"ΔE76 {label:6s} {mean:.2f} ± {deviation:.2f} (doing nothing: {trivial:.2f})"
            )
    return in_words_of_options("\n".join(lines))
