"""Polarisation components of a whole image from its two lobes: Equations 7 and 9 to 12.

The image is worked on in blocks of rows whose intermediate arrays stay in cache. It costs little
more than reading and writing the image once, and memory beyond inputs and outputs stays a few
megabytes however large the image is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from malus.reconstruct.lobe_models import Lobe, LobeModel, ZenithTables, on_steps
from malus.reconstruct.observation import Components, Image, Observation
from malus.reconstruct.pixel_block import Block
from malus.scenes.core.arrays import BoolArray, Float64Array
from malus.scenes.core.cores import usable_cores

BLOCK_PIXELS = 1 << 17
"""Measured best of 2^13 to 2^19: smaller blocks pay for calls, larger ones leave the cache."""


def from_lobes(
    observation: Observation, specular_model: LobeModel, diffuse_model: LobeModel | None
) -> Components:
    """Polarisation components from I_s and I_d, whose Stokes vectors add up.

    Parameters
    ----------
    observation : Observation
        Its specular and diffuse intensity must be given, besides what the models need.
    specular_model : LobeModel
    diffuse_model : LobeModel or None
        None is the paper's assumption that diffuse light is unpolarised.

    Returns
    -------
    Components
        Of the specular light's dtype, float32 at least. Pixels with an intensity that is negative,
        not finite or above half the largest number (the sum of both lobes must be a number), or
        with a normal that is not one, carry zeros and are False in `valid`.

    Raises
    ------
    Inapplicable
        If something that the models need is not given.
    """
    specular = observation.require("specular")
    observation.require("diffuse")
    from malus.reconstruct import kernels

    lobes: dict[str, Lobe] = {"specular": specular_model(observation)}
    if diffuse_model is not None:
        lobes["diffuse"] = diffuse_model(observation)
    tabulated = {name: lobe for name, lobe in lobes.items() if isinstance(lobe, ZenithTables)}
    pixelwise = {name: lobe for name, lobe in lobes.items() if not isinstance(lobe, ZenithTables)}
    table = _joined([lobe.columns for lobe in tabulated.values()])
    signs = np.array([lobe.sign for lobe in tabulated.values()], np.float64)

    dtype = np.result_type(specular.dtype, np.float32)
    image = np.empty(specular.shape, dtype)
    s1, s2 = (np.zeros(specular.shape, dtype) for _ in range(2))
    valid = np.empty(observation.mask.shape, dtype=bool)

    def reconstruct(rows: slice) -> None:
        block = Block(observation, rows)
        valid[rows] = block.valid.reshape(valid[rows].shape)
        total, block_s1, block_s2 = (
            part[rows].reshape(block.mask.size, specular.shape[2]) for part in (image, s1, s2)
        )
        intensity = {name: block.lobe(name) for name in ("specular", "diffuse")}
        np.add(intensity["specular"], intensity["diffuse"], out=total)  # I = I_d + I_s
        if tabulated:
            first, *rest = (intensity[name] for name in tabulated)
            second = rest[0] if rest else first
            fields = block_s1, block_s2
            kernels.polarise_about_normals(
                first, second, block.normals, table, signs, block.frame_length, *fields
            )
        for name, ratios in pixelwise.items():
            kernels.add_polarised(intensity[name], ratios(block), block_s1, block_s2)

    _in_threads(reconstruct, list(_blocks(specular.shape[:2])))
    return Components(image, s1, s2, valid)


def _joined(columns: Sequence[Float64Array]) -> Float64Array:
    """One table (steps + 1, columns) of all lobes and bands, on the finest of their grids."""
    if len(columns) == 1:
        return columns[0]
    steps = max((len(one) for one in columns), default=1)
    return np.hstack([np.empty((steps, 0)), *(on_steps(one, steps) for one in columns)])


def _in_threads(work: Callable[[slice], None], blocks: Sequence[slice]) -> None:
    """Do the work on every block of rows, on all cores where there are several blocks."""
    if len(blocks) > 2:
        with ThreadPoolExecutor(max_workers=usable_cores()) as pool:
            list(pool.map(work, blocks))
    else:
        for rows in blocks:
            work(rows)


def _blocks(shape: tuple[int, int]) -> Iterator[slice]:
    """Rows of an image (height, width), about `BLOCK_PIXELS` pixels at a time."""
    rows = max(1, BLOCK_PIXELS // max(shape[1], 1))
    for start in range(0, shape[0], rows):
        yield slice(start, min(start + rows, shape[0]))


def joined_deviation(
    image: Image, mask: BoolArray, parts: Sequence[tuple[BoolArray, Components]]
) -> Image | None:
    """Deviation of a picture of several objects; None where any of them states none.

    Parameters
    ----------
    image : (height, width, bands)
    mask : (height, width) bool
        Pixels of all objects. Of one that could not be told any polarisation is possible: its
        deviation is 1.
    parts : pairs of mask and components
        Of the objects that could be told.

    Examples
    --------
    >>> image, left = np.ones((1, 3, 1)), np.array([[True, False, False]])
    >>> told = Components(image, 0 * image, 0 * image, deviation=0.25 * image)
    >>> deviation = joined_deviation(image, np.array([[True, True, False]]), [(left, told)])
    >>> deviation[..., 0].tolist()
    [[0.25, 1.0, 0.0]]
    """
    result = np.zeros_like(image)
    result[mask] = 1.0
    for own, components in parts:
        if components.deviation is None:
            return None
        result[own] = components.deviation[own]
    return result
