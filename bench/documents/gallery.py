"""Draws the gallery: every light, body, surface, shape, room as a picture, from suites beside it.

`make gallery` writes it; `python -m malus.bench.documents.gallery FOLDER photo rooms` draws some
of it. Each picture is rendered, none is drawn by hand.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from malus.bench.scoring.judge import Judge
from malus.bench.scoring.observe import observe
from malus.reconstruct import Inapplicable, get_method
from malus.reconstruct.learned.network import network
from malus.reconstruct.photos.filter import filter_picture
from malus.reconstruct.photos.knowledge import Knowledge
from malus.reconstruct.photos.picture import Picture
from malus.renderers import Truth, render
from malus.reports.figures import stokes_pictures as pictures
from malus.reports.figures.sheets import Tile, write_sheet
from malus.scenes import Scene, Suite, load_suite, polarisation
from malus.scenes.colour import preview

SUITES = Path(__file__).parent / "suites"

METHOD = "shadowed+body"
"""The method of the photo's last picture."""

_DARKEST = "the least light through any polariser, and degree of polarisation"

ANGLES_DEG = (0.0, 90.0)
"""Polariser angles of the photo: across the light that a table reflects, and along it."""


@dataclass(frozen=True)
class Contents:
    """A sheet of the gallery: suites, and what tells one of their scenes from the next."""

    suites: tuple[str, ...]
    caption: Callable[[Scene], str]


def _material_and_body(scene: Scene) -> str:
    return f"{scene.surface.material_label}, body: {scene.surface.body}"


def _room_and_light(scene: Scene) -> str:
    return f"{scene.surroundings.name}, {scene.light.label}" if scene.surroundings else ""


SHEETS = {
    "lights": Contents(("lights",), lambda scene: scene.light.label),
    "bodies": Contents(("bodies",), _material_and_body),
    "surfaces": Contents(("surfaces",), lambda scene: scene.surface.label),
    "materials": Contents(("materials", "metals"), lambda scene: scene.surface.material_label),
    "shapes": Contents(("shapes",), lambda scene: scene.shape.label),
    "patterns": Contents(("patterns",), lambda scene: scene.surface.label),
    "rooms": Contents(("indoor", "outdoor"), _room_and_light),
}
"""By file name; a suite is one beside this module, or one that malus brings."""


def gallery(out: Path, names: Sequence[str] = (), scale: float = 1.0) -> list[Path]:
    """Render the suites and write their sheets into a folder.

    Parameters
    ----------
    out : path of a folder, made if it is missing
    names : sequence of str
        Keys of `SHEETS`, "photo" or "filter"; all by default.
    scale : float
        Factor on the resolution and on the square root of the samples of all suites.

    Returns
    -------
    list of Path
    """
    written = []
    for name in names or ("photo", *SHEETS, "filter"):
        path = out / f"{name}.jpg"
        _WRITERS.get(name, _write_contents)(path, scale)
        written.append(path)
    return written


def suite_of(name: str, scale: float = 1.0) -> Suite:
    """A suite of the gallery, or one that malus brings, at a part of its size."""
    path = SUITES / f"{name}.toml"
    suite = load_suite(path if path.exists() else name)
    resolution = max(8, round(scale * suite.camera.resolution))
    samples = max(2, 2 * round(scale**2 * suite.sampling.samples / 2))
    return suite.model_copy(
        update={
            "camera": suite.camera.model_copy(update={"resolution": resolution}),
            "sampling": suite.sampling.model_copy(update={"samples": samples}),
        }
    )


def _write_contents(path: Path, scale: float) -> None:
    """In colour and as degree of polarisation: one scene for each caption."""
    contents = SHEETS[path.stem]
    scenes: dict[str, tuple[Scene, Suite]] = {}
    for suite in (suite_of(name, scale) for name in contents.suites):
        for scene in suite.scenes():
            scenes.setdefault(contents.caption(scene), (scene, suite))
    tiles = [
        _in_colour_and_degree(caption, render(scene, suite.sampling))
        for caption, (scene, suite) in scenes.items()
    ]
    write_sheet(path, tiles, columns=min(4, len(tiles)), side=160, letters=12)


def _in_colour_and_degree(caption: str, truth: Truth) -> Tile:
    bands, stokes = truth.scene.wavelengths_nm, truth.stokes
    white, most = pictures.white_of(stokes, bands), pictures.most_of(stokes, bands)
    photograph = pictures.photograph(stokes, bands, white)
    return Tile(caption, [photograph, pictures.degree(stokes, bands, most)], most)


def _write_photo(path: Path, scale: float) -> None:
    suite = suite_of("photo", scale)
    truth = render(next(suite.scenes()), suite.sampling)
    write_sheet(path, photo_tiles(truth), columns=3, side=round(524 * min(1.0, scale)), letters=22)


def photo_tiles(truth: Truth) -> list[Tile]:
    """A scene as seen, through the polariser, its polarisation, and a method's estimate of it."""
    bands, stokes = truth.scene.wavelengths_nm, truth.stokes
    white = pictures.white_of(stokes, bands)
    method = get_method(METHOD)
    estimate = method.reconstruct(observe(truth, method.needs)).stokes
    # Where a method says nothing, the picture has nothing.
    estimate = np.where(truth.mask[..., None, None], estimate, 0.0)
    skill = Judge(truth).score(method).skill
    most = pictures.most_of(stokes, bands)
    return [
        Tile("What a camera sees", [pictures.photograph(stokes, bands, white)]),
        *(
            Tile(
                f"Through a polariser at {angle:g}°",
                [pictures.through_polariser(stokes, bands, white, angle)],
            )
            for angle in ANGLES_DEG
        ),
        Tile("Angle of polarisation", [pictures.angle(stokes, bands)], wheel=True),
        Tile("Degree of polarisation: truth", [pictures.degree(stokes, bands, most)], most),
        Tile(
            f"Its estimate by {METHOD}: skill {skill:.2f}",
            [pictures.degree(estimate, bands, most)],
            most,
        ),
    ]


def _write_filter(path: Path, scale: float) -> None:
    """Before and after `malus filter`: what is told of the picture is the object's mask."""
    suite = suite_of("filter", scale)
    rows = [filter_tiles(render(scene, suite.sampling)) for scene in suite.scenes()]
    tiles = [tile for row in rows for tile in row]
    write_sheet(path, tiles, columns=len(rows[0]), side=240, letters=14)


def filter_tiles(truth: Truth) -> list[Tile]:
    """A photograph, what `malus filter` makes of it at its darkest, and what a filter would."""
    bands, stokes = truth.scene.wavelengths_nm, truth.stokes
    white, most = pictures.white_of(stokes, bands), pictures.most_of(stokes, bands)
    light = np.ascontiguousarray(preview(truth.image, bands) / white, dtype=np.float32)
    told = {"malus filter, told the mask": Knowledge(mask=truth.mask)}
    with suppress(Inapplicable):  # a copy without weights, or without what runs them
        network()
        told["malus filter, told nothing"] = Knowledge(method="net")
    tiles = [Tile("A photograph", [pictures.encoded(light)])]
    for caption, knowledge in told.items():
        filtered = filter_picture(Picture(light, "EXR", None), knowledge=knowledge).components
        least = pictures.encoded(2.0 * filtered.i_min)
        degree = pictures.degree(filtered.stokes, bands, most)
        tiles.append(Tile(f"{caption}: {_DARKEST}", [least, degree], most))
    least = pictures.encoded(2.0 * preview(polarisation.extremes(stokes)[1], bands) / white)
    degree = pictures.degree(stokes, bands, most)
    return [*tiles, Tile("The same in truth", [least, degree], most)]


_WRITERS: dict[str, Callable[[Path, float], None]] = {
    "photo": _write_photo,
    "filter": _write_filter,
}
"""Writers of the sheets that are no list of scenes."""


if __name__ == "__main__":
    gallery(Path(sys.argv[1]), sys.argv[2:])
