"""`malus capture`. Nothing heavy is imported before the command runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from malus.bench.commands.filter import knowledge_of, knowledge_options


@click.command("capture")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--zero",
    type=click.Choice(["vertical", "horizontal"]),
    default="vertical",
    show_default=True,
    help="Where the polariser's angles count from.",
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
@click.option("--linear", is_flag=True, help="The files' values are linear light.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for maps of the fit.")
@click.option("--fit-only", is_flag=True, help="Fit the pictures and reconstruct nothing.")
@click.option("--json", "as_json", is_flag=True, help="Print the numbers as JSON.")
@knowledge_options
def capture_command(
    folder: Path,
    zero: Any,
    sense: Any,
    offset: float,
    linear: bool,
    out: Path | None,
    fit_only: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Fit pictures of FOLDER through a rotated polariser, and score a reconstruction.

    Names end in the angle (pol_000.png, pol_045.png, …), or angles.json maps names to degrees.
    The reconstruction sees only the mean of the pictures, and what the options tell.

    \b
    Example:
      malus capture kettle --zero horizontal --linear --mask kettle_mask.png
    """
    import json

    from malus.bench.scoring.capture_score import score_capture, write_fit
    from malus.reconstruct.photos.capture import read_capture
    from malus.reconstruct.photos.capture_fit import capture_summary, fit_capture

    capture = read_capture(folder, zero, sense, linear, offset)
    knowledge = knowledge_of(capture.clipped.shape, given)
    fit = fit_capture(capture)
    results: dict[str, Any] = {"fit": capture_summary(capture, fit)}
    if not fit_only:
        results["score"] = score_capture(capture, fit, knowledge, str(folder))
    if out is not None:
        write_fit(out, fit, results)
    click.echo(json.dumps(results, indent=1) if as_json else _report(results))


def _report(results: dict[str, Any]) -> str:
    """The results as lines of text."""
    fit = results["fit"]
    lines = [
        f"{fit['pictures']} pictures, residual {fit['relative_residual']:.2%} of the mean, "
        f"clipped {fit['clipped_share']:.2%}, moved at most {max(fit['shifts_pixels']):.2f} pixels",
        f"degree of polarisation: median {fit['median_dolp']:.3f}, 99 % below {fit['dolp_99']:.3f}",
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
    return "\n".join(lines)
