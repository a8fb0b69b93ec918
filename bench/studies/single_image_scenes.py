"""The scenes on which one ordinary image is measured: 24 materials on spheres and blobs."""

from __future__ import annotations

import random
from collections.abc import Sequence
from itertools import product
from typing import Any

from malus.scenes import Blob, Camera, Dielectric, Distant, Scene, Sphere
from malus.scenes.materials.materials import materials, surfaces

COLOURS = ("blue", "light_skin", "green", "foliage", "red", "yellow", "magenta")
"""Swatches of coloured bodies, some strong, some pale; materials take turns."""
INCIDENCES_DEG = (20.0, 45.0, 60.0, 80.0)
BANDS_NM = (450.0, 550.0, 650.0)


def photo_scenes(shapes: Sequence[str], every: int, resolution: int, coloured: bool) -> list[Scene]:
    """All 24 x 5 x 2 bodies x 4 lights of each shape, or of every n-th material.

    Materials take turns: with every 24th each of them comes up, with every fourth it comes up once
    on each surface and body, under another light on the next surface. The order is shuffled, always
    in the same way, so that a measurement that is stopped stands for all of them.

    Parameters
    ----------
    shapes : 'sphere', 'blob' (seed 0) or 'blobN'
    every : a divisor of 24
    resolution : pixels a side
    coloured : whether bodies have the colours of `COLOURS`; otherwise they are grey

    Examples
    --------
    >>> [len(photo_scenes(["sphere", "blob"], n, 48, coloured=False)) for n in (24, 4, 1)]
    [80, 480, 1920]
    """
    names = list(materials())
    found = []
    lit = product(surfaces(), ("unpolarised", "polarised"), INCIDENCES_DEG)
    for turn, (surface, body, incidence) in enumerate(lit):
        # Seven and 24 have no common divisor. Two bodies on a surface make eight turns: they share
        # the light of a material, and the next surface gets another.
        for index in range((7 * turn + turn // 8) % every, len(names), every):
            colour = COLOURS[(index + turn) % len(COLOURS)] if coloured else None
            made = _surface(names[index], surface, body, colour)
            found += [_scene(shape, made, incidence, resolution) for shape in shapes]
    random.Random(0).shuffle(found)
    return found


def _surface(material: str, surface: str, body: Any, colour: str | None) -> Dielectric:
    made = Dielectric.named(material, surface, body)
    return made if colour is None else made.model_copy(update={"albedo": colour})


def _scene(shape: str, surface: Dielectric, incidence: float, resolution: int) -> Scene:
    return Scene(
        shape=Sphere() if shape == "sphere" else Blob(seed=int(shape.removeprefix("blob") or 0)),
        surface=surface,
        light=Distant(incidence_deg=incidence),
        camera=Camera(resolution=resolution),
        wavelengths_nm=BANDS_NM,
    )
