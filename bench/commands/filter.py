"""`malus filter`. Nothing heavy is imported before the command runs."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from malus.bench.commands.options import LOCAL, Numbers, command, together

knowledge_options = together(
    click.option("--normals", type=LOCAL, help="Normals: .npy, .exr, or a picture of (n + 1)/2."),
    click.option("--mask", type=LOCAL, help="A picture, light where the object is, or .npy."),
    click.option(
        "--labels",
        type=LOCAL,
        help="A picture or .npy of several objects: black is none, every other value is one.",
    ),
    click.option(
        "--light",
        type=Numbers("X,Y,Z", "three numbers X,Y,Z", 3),
        help="Towards a distant light: x right, y up, z to you.",
    ),
    click.option("--material", help="A material of `malus list materials`."),
    click.option("--alpha", type=float, help="Roughness, 0 to 1."),
    click.option("--preset", help="water, glass, foliage, skin or plastic."),
    click.option(
        "--illuminant",
        type=click.Choice(["neutral", "gray-world", "shades-of-grey", "highlights"]),
        help="How the colour of the light is told [default: neutral; of the method paper,"
        " gray-world].",
    ),
    click.option(
        "--separation",
        type=click.Choice(["chromaticity", "suv", "ratio"]),
        help="How glare is told from the body's colour [default: ratio; of the method paper,"
        " chromaticity, of paper-mallick, suv].",
    ),
    click.option(
        "--net-size",
        type=int,
        help="Longer side of the picture that the method net works on, in pixels"
        " [default: by its training].",
    ),
)
"""Options that say what is known besides the picture; filter and capture share them."""


def knowledge_of(shape: tuple[int, ...], given: dict[str, Any]) -> Any:
    """Knowledge about a picture of `shape` (height, width, …) from the values of those options."""
    from malus.reconstruct.photos.knowledge import read_knowledge

    height, width = shape[:2]
    others = {name: value for name, value in given.items() if name != "material"}
    return read_knowledge((height, width), material_name=given["material"], **others)


def in_words_of_options(text: str) -> str:
    """A text with options in place of the parameters that stand in backticks."""
    return re.sub(r"`(\w+)`", lambda name: f"--{name[1].replace('_', '-')}", text)


@command("filter")
@click.argument("image", type=LOCAL)
@click.option(
    "--angle",
    "angles",
    multiple=True,
    type=float,
    help="Degrees from the vertical, anticlockwise; repeat it. [default: 0 45 90 135]",
)
@click.option("--out", type=LOCAL, help="Folder [default: IMAGE's name + _polarised].")
@knowledge_options
@click.option(
    "--method",
    help="A method of `malus list methods`, such as paper, or module:object"
    " [default: by what is given].",
)
@click.option("--linear", is_flag=True, help="The file's values are linear light.")
@click.option(
    "--part", help="Which picture of IMAGE: an OpenEXR part's name, a TIFF page's number."
)
@click.option("--sweep", is_flag=True, help="Also an animation through 180°.")
@click.option("--physical", is_flag=True, help="Lose the light that a real filter takes away.")
def filter_command(
    image: Path,
    angles: tuple[float, ...],
    out: Path | None,
    linear: bool,
    part: str | None,
    sweep: bool,
    physical: bool,
    **given: Any,
) -> None:
    """Look at IMAGE through a virtual polariser.

    From a picture alone a trained network estimates the polarisation, everywhere in it;
    *_uncertainty.png shows how sure it is. With a mask or normals of one object physics does so.

    \b
    Example:
      malus filter holiday.jpg --angle 0 --angle 90
      malus filter vase.jpg --mask vase_mask.png --light 1,1,2 --angle 60
    """
    from malus.reconstruct.photos.filter import FilterOutput, filter_picture
    from malus.reconstruct.photos.read_picture import read_picture

    picture = read_picture(image, linear, part)
    knowledge = knowledge_of(picture.linear.shape, given)
    folder = out or image.with_name(f"{image.stem}_polarised")
    output = FilterOutput(angles or FilterOutput.angles_deg, sweep, physical)
    with _progress() as progress:
        filtered = filter_picture(
            picture, folder, knowledge, output, stem=image.stem, progress=progress
        )
    for statement in filtered.statements:
        click.echo(f"- {in_words_of_options(statement)}")
    for warning in filtered.warnings:
        click.echo(f"warning: {in_words_of_options(warning)}", err=True)
    click.echo(f"{len(filtered.files)} files in {folder}")


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
    """A progress bar on standard error with time left; silent where that is no terminal."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    from malus.bench.commands.console import plain_console

    console = plain_console(stderr=True)
    columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("reading", total=1.0)
        yield lambda step, share: bar.update(task, description=step, completed=share)
