"""`malus capture`. Nothing heavy is imported before the command runs."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from malus.bench.commands.filter import (
    in_words_of_options,
    knowledge_of,
    knowledge_options,
)
from malus.bench.commands.options import LOCAL, Numbers, command

if TYPE_CHECKING:
    from malus.bench.running.capture_suite import CaptureSuite
    from malus.bench.running.results import Results


_ANGLES = Numbers("A,B,…", "numbers with commas")


@command("capture")
@click.argument("folders", nargs=-1, required=True, type=LOCAL)
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
@click.option("--angles", type=_ANGLES, help="One for each page, array or picture in its order.")
@click.option(
    "--unit", type=click.Choice(["degrees", "radians"]), help="Unit of the angles as they stand."
)
@click.option("--linear", is_flag=True, help="The files' values are linear light.")
@click.option(
    "--black", help="Dark level: a code, below 1 a share of the largest, or a dark frame's file."
)
@click.option("--white", type=float, help="Level at which the sensor is full, likewise.")
@click.option("--mosaic", type=_ANGLES, help="Each is a polarisation camera's frame: 90,45,135,0.")
@click.option(
    "--bayer",
    type=click.Choice(["rggb", "bggr", "grbg", "gbrg"]),
    help="Colours over the squares of the mosaic.",
)
@click.option(
    "--size",
    type=Numbers("WxH", "WIDTHxHEIGHT", 2, "x", int),
    help="Of a frame without a header.",
)
@click.option("--packing", help="Its pixel format: mono8, mono12, mono12p, mono12packed, mono16, …")
@click.option(
    "--method",
    "methods",
    multiple=True,
    help="Methods to score on the unpolarised image, with a report; may be repeated. One that is"
    " told more, such as --separation, is scored without a report.",
)
@click.option(
    "--out",
    type=LOCAL,
    help="Folder for maps of the fit; of several captures for their results [results/captures].",
)
@click.option("--fit-only", is_flag=True, help="Fit the pictures and reconstruct nothing.")
@click.option("--json", "as_json", is_flag=True, help="Print the numbers as JSON.")
@knowledge_options
@click.pass_context
def capture_command(
    ctx: click.Context,
    /,
    folders: tuple[Path, ...],
    offset: float,
    methods: tuple[str, ...],
    out: Path | None,
    fit_only: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Fit pictures of FOLDERS through a rotated polariser, and score reconstructions.

    Names hold the angle (pol_000.png, pol_045.png, …), or angles.json maps names to degrees, or a
    JSON file stands beside each. A folder may be a TIFF of pages or a .npy stack, with --angles, or
    one frame of a polarisation camera, with --mosaic. The reconstruction sees only the mean of the
    pictures, and what the options tell.

    Several folders, or a TOML file that names folders, masks and conventions, make results like
    those of a run: tables, Table I, Figure 9, error maps and the page. So does --method. What fails
    is named and left out, and the exit code is 1 then; a method that does not apply is no failure.

    \b
    Example:
      malus capture kettle --zero horizontal --linear --mask kettle_mask.png
      malus capture frame.png --mosaic 90,45,135,0 --fit-only
      malus capture kettle vase --zero horizontal --method blind --out results/indoor
      malus capture captures.toml
    """
    given["method"] = methods[0] if methods else None
    several = len(folders) > 1 or folders[0].suffix.lower() == ".toml" or len(methods) > 1
    if several or (methods and not any(given[name] is not None for name in _OF_A_METHOD)):
        told = given | {"offset": offset, "fit_only": fit_only}
        sys.exit(_run_suite(_suite(ctx, folders, methods, told), out, as_json))
    _fit_one(folders[0], offset, out, fit_only, as_json, given)


def _fit_one(
    folder: Path,
    offset: float,
    out: Path | None,
    fit_only: bool,
    as_json: bool,
    given: dict[str, Any],
) -> None:
    """Fit one capture, score the reconstruction that the options describe, and print it.

    Where nothing can be reconstructed, the fit is written and printed before that is told.
    """
    from malus.bench.scoring.capture_score import convention_doubt, score_capture, write_fit
    from malus.reconstruct.photos.capture import read_capture
    from malus.reconstruct.photos.capture_fit import capture_summary, fit_capture
    from malus.scenes.core.errors import InputError
    from malus.scenes.core.json_text import json_text

    _check_out(out, folder)
    reading = {name: given.pop(name) for name in _READING}
    capture = read_capture(folder, offset_deg=offset, **reading)
    knowledge = knowledge_of(capture.clipped.shape, given)
    fit = fit_capture(capture)
    doubt = convention_doubt(fit, knowledge, ~capture.clipped)
    if doubt:  # at once: no method may be able to work on what was read wrongly
        click.echo(in_words_of_options(f"warning: {doubt}"), err=True)
    results: dict[str, Any] = {"fit": capture_summary(capture, fit), "convention": doubt}
    refusal = None
    if not fit_only:
        try:
            results["score"] = score_capture(capture, fit, knowledge, str(folder))
        except InputError as reason:
            hint = f"{reason.hint}, or take the fit alone, `fit_only`"
            refusal = InputError(reason.where, reason.expected, reason.found, hint)
    if out is not None:
        write_fit(out, fit, results, capture.channels)
    click.echo(json_text(results, 1) if as_json else _report(results))
    if refusal is not None:
        raise refusal


def _check_out(out: Path | None, folder: Path) -> None:
    """Refuse a folder in which maps of the fit would be read as pictures the next time."""
    from malus.scenes.core.errors import InputError

    if out is not None and out.resolve() == folder.resolve():
        hint = "choose one for the maps of the fit"
        raise InputError("out", "another folder than the pictures'", str(out), hint)


_READING = (
    "zero", "sense", "angles", "unit", "linear", "black", "white", "mosaic", "bayer", "size",
    "packing",
)  # fmt: skip
"""Options for reading pictures; the others describe the object."""


_OF_A_METHOD = (
    "normals", "light", "material", "alpha", "preset", "illuminant", "separation", "net_size",
)  # fmt: skip
"""What one method alone may be told of one capture; several are told what is in the picture."""


def _suite(
    ctx: click.Context, folders: tuple[Path, ...], methods: tuple[str, ...], told: dict[str, Any]
) -> CaptureSuite:
    """The captures that a TOML file names, or folders that are all read as the options say.

    Raises
    ------
    InputError
        An option that has no place there, or a TOML file among folders.
    """
    from malus.bench.running.capture_suite import CaptureSuite, load_captures
    from malus.scenes.core.errors import InputError

    is_file = folders[0].suffix.lower() == ".toml"
    if is_file and len(folders) > 1:
        expected, hint = "one TOML file, or folders", "name the folders in the TOML file"
        raise InputError(str(folders[0]), expected, f"{len(folders)} arguments", hint)
    allowed = {"folders", "methods", "out", "as_json"}
    if not is_file:
        of_one = {"mask", "labels"} if len(folders) == 1 else set()
        allowed |= {*_READING, "offset", *of_one}
    for param in ctx.command.params:
        given = ctx.get_parameter_source(str(param.name)) is not ParameterSource.DEFAULT
        if given and param.name not in allowed:
            expected = "options that hold for all" if not is_file else "this in the TOML file"
            hint = "write it to a [[capture]] of a TOML file, if it is one of its keys"
            raise InputError(param.opts[0], expected, "an option of one capture", hint)
    if is_file:
        suite = load_captures(folders[0])
        return suite.model_copy(update={"methods": methods}) if methods else suite
    keys = {name: value for name, value in told.items() if name in allowed and value is not None}
    keys |= {name: str(keys[name]) for name in ("mask", "labels") if name in keys}
    return CaptureSuite.of_folders(folders, methods, **keys)


def _run_suite(suite: CaptureSuite, out: Path | None, as_json: bool) -> int:
    """Run a suite of captures and print it; 1 where something failed, otherwise 0."""
    from malus.bench.commands.console import plain_console
    from malus.bench.commands.printing import print_json
    from malus.bench.public.captures import run_captures
    from malus.bench.running.progress import with_progress
    from malus.bench.running.results import headline

    folder = out if out is not None else Path("results") / suite.name
    console = plain_console(stderr=True, soft_wrap=True)
    results = with_progress(
        console, "captures", lambda show: run_captures(suite, folder, progress=show)
    )
    if as_json:
        print_json({"out": str(folder), "methods": headline(results), "run": results.run})
    else:
        _print_captures(results)
    for failure in results.run["failures"]:
        text = in_words_of_options(f"left out, {failure}")
        console.print(text)
    console.print(f"written to {folder}")
    return 1 if results.run["failures"] else 0


_SHOWN = ("capture", "method", "NMSE", "skill", "gain", "best scale", "skill at it")
"""Columns that fit 80 characters; the summary has all."""


def _print_captures(results: Results) -> None:
    """A line a capture and method."""
    from malus.bench.commands.console import plain_console
    from malus.bench.commands.printing import plain_table
    from malus.reports.tables.captures import by_capture, conventions, fit_warnings, notes

    errors = by_capture(results.table)
    shown = [errors.heads.index(head) for head in _SHOWN]
    table = plain_table(*_SHOWN)
    for line in errors.lines:
        table.add_row(*(line[column] for column in shown))
    console = plain_console(soft_wrap=True)
    console.print(table)
    for note in notes(results.table):
        console.print(note)
    for doubt in (*conventions(results.run), *fit_warnings(results.run)):
        console.print(in_words_of_options(f"warning: {doubt}"))


def _report(results: dict[str, Any]) -> str:
    """The results as lines of text."""
    fit = results["fit"]
    lines = [
        f"{fit['pictures']} pictures, residual {fit['relative_residual']:.2%} of the mean, "
        f"clipped {fit['clipped_share']:.2%}, moved at most {max(fit['shifts_pixels']):.2f} pixels",
        f"degree of polarisation of the whole picture: median {fit['median_dolp']:.3f}, "
        f"99 % below {fit['dolp_99']:.3f}",
        f"- {fit['assumption']}",
        *(f"hint: {hint}" for hint in fit["hints"]),
        *(f"warning: {warning}" for warning in fit["warnings"]),
    ]
    if "score" in results:
        score = results["score"]
        lines += [f"warning: {warning}" for warning in score["warnings"]]
        lines += [f"- {statement}" for statement in score["statements"]]
        lines.append(
            f"NMSE {score['nmse']:.2e} (doing nothing: {score['nmse_trivial']:.2e}), "
            f"skill {_number(score['skill'], 3)}, best gain {_number(score['best_gain'], 2)}"
        )
        for name, (mean, deviation) in score["delta_e76"].items():
            trivial = score["delta_e76_trivial"][name][0]
            label = name if name.startswith("i_") else f"{name}°"
            lines.append(
                f"ΔE76 {label:6s} {mean:.2f} ± {deviation:.2f} (doing nothing: {trivial:.2f})"
            )
    return in_words_of_options("\n".join(lines))


def _number(value: float, digits: int) -> str:
    """A number, or a dash where there is none."""
    return "–" if math.isnan(value) else f"{value:.{digits}f}"
