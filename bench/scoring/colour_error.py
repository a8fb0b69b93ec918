"""Visible difference of an estimate from the truth: ΔE76 and ΔE2000 in CIELAB.

Bands are narrow. The integral of the observer's colour-matching functions over wavelength is a sum
over the bands' centres, each weighted by the width of its cell (half-way to its neighbours, the
outer cells symmetric). Lights have flat spectra, so that the illuminant is equal energy. White,
Y = 100, is a surface that is everywhere as bright as the brightest pixel of the true unpolarised
image in the mask: what an exposure without clipping makes of it.
"""

from __future__ import annotations

from collections.abc import Iterator

from malus.bench.scoring.metrics import PixelSums
from malus.scenes.colour import ComparedColours, DifferenceMaps, differences_from
from malus.scenes.core.arrays import FloatArray


def delta_e(
    estimated: FloatArray, true: ComparedColours, method: str = "CIE 1976"
) -> Iterator[tuple[str, float | None, PixelSums]]:
    """Sums over pixels of the colour difference of I_max, I_min, every I(ϑ), and all I(ϑ).

    Parameters
    ----------
    estimated : (pixels, bands, 3)
        Stokes vectors over the radiance of white.
    true : ComparedColours
        Of the truth: computed once for all methods.
    method : str
        "CIE 1976" or "CIE 2000", as colour-science names them.

    Yields
    ------
    (suffix, polariser angle in degrees or None, PixelSums)
    """
    yield from difference_sums(differences_from(true, estimated, method))


def difference_sums(maps: DifferenceMaps) -> Iterator[tuple[str, float | None, PixelSums]]:
    """Sums over the pixels of maps of the colour difference, as `delta_e` yields them."""
    all_angles = PixelSums()
    for suffix, angle, difference in maps:
        sums = PixelSums.of(difference)
        if angle is not None:
            all_angles = all_angles + sums
        yield suffix, angle, sums
    yield "", None, all_angles
