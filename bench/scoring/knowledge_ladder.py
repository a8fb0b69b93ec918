"""The ladder of knowledge: one thing after another is estimated instead of told.

Every rung takes one thing more from what a method is told and puts in its place what the chain
for one ordinary image (`malus.reconstruct.single_image.blind`) finds without it, down to the
picture alone.
What is estimated comes from the picture as rendered and is held for the draw of its noise: the
noise of a rung is what the method makes of that draw.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from malus.bench.scoring.masked_pixels import MaskedPixels
from malus.bench.scoring.observe import KNOWN, observe
from malus.reconstruct import Inapplicable, Observation
from malus.reconstruct.single_image.blind import run_chain

EVERYTHING = "everything"
RUNGS: dict[str, frozenset[str]] = {
    "lobes estimated": frozenset({"specular", "diffuse"}),
    "normals estimated": frozenset({"normals"}),
    "index and roughness estimated": frozenset({"eta", "alpha"}),
    "light estimated": frozenset({"light"}),
}
"""What each rung no longer tells, besides what those before it did not."""


def rungs(sight: MaskedPixels) -> Iterator[tuple[str, Observation | Inapplicable]]:
    """What methods are given at every rung below `EVERYTHING`, or why the chain finds nothing.

    Yields
    ------
    (name of the rung, Observation as `Sight.known` is, or the reason)

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=24))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> name, seen = next(rungs(Sight.of(truth)))
    >>> name, seen.alpha
    ('lobes estimated', 0.3)
    """
    untold: frozenset[str] = frozenset()
    for name, more in RUNGS.items():
        untold |= more
        try:
            yield name, _estimated(sight, untold)
        except Inapplicable as reason:
            yield name, reason


def _estimated(sight: MaskedPixels, untold: frozenset[str]) -> Observation:
    """`sight.known` with what the chain finds in place of all that is untold."""
    truth, known = sight.truth, sight.known
    found = run_chain(observe(truth, KNOWN - untold)).observation
    picture = truth.image[truth.mask]
    mirrored = found.require("specular")[truth.mask]
    share = np.divide(mirrored, picture, out=np.zeros_like(picture), where=picture > 0)
    specular = (known.image * np.clip(share, 0.0, 1.0)).astype(known.image.dtype)
    filled = replace(known, specular=specular, diffuse=known.image - specular)
    if "normals" in untold:
        normals = found.require("normals")[truth.mask].astype(known.image.dtype)
        filled = replace(filled, normals=np.stack([normals, normals]))
    others = untold & {"eta", "alpha", "light"}
    return replace(filled, **{name: getattr(found, name) for name in others})
