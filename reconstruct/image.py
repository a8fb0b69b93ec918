"""Whole images from models of the two lobes: Equations 7 and 9 to 12, block by block.

A block of rows is small enough that what a model makes of it stays in cache, so that an image
costs little more than reading and writing it once, and memory beyond inputs and outputs stays a
few megabytes however large the image is.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.lobe_models import AboutNormals, Lobe, LobeModel
from malus.reconstruct.observation import Components, Observation
from malus.reconstruct.pixel_block import Block

BLOCK_PIXELS = 1 << 17
"""Measured best of 2^13 to 2^19: smaller blocks pay for calls, larger ones leave the cache."""


def from_lobes(
    observation: Observation, specular_model: LobeModel, diffuse_model: LobeModel | None
) -> Components:
    """Polarised parts of both lobes, added as Stokes vectors.

    Parameters
    ----------
    observation : Observation
        Its specular and diffuse intensity must be known, besides what the models need.
    specular_model, body_model : LobeModel
        No body model means an unpolarised body.

    Returns
    -------
    Components
        Of the image's dtype. Pixels with an intensity that is negative, not finite or above
        half the largest number (the sum of both lobes must be a number), or with a normal that
        is not one, carry zeros and are False in `valid`.

    Raises
    ------
    Inapplicable
        If something that the models need is not known.
    """
    specular = observation.require("specular")
    observation.require("diffuse")
    from malus.reconstruct import kernels

    lobes: dict[str, Lobe] = {"specular": specular_model(observation)}
    if diffuse_model is not None:
        lobes["diffuse"] = diffuse_model(observation)
    tabled = {name: lobe for name, lobe in lobes.items() if isinstance(lobe, AboutNormals)}
    others = {name: lobe for name, lobe in lobes.items() if not isinstance(lobe, AboutNormals)}
    table = _joined(list(tabled.values()))

    dtype = np.result_type(specular.dtype, np.float32)
    image = np.empty(specular.shape, dtype)
    s1, s2 = (np.zeros(specular.shape, dtype) for _ in range(2))
    valid = np.empty(observation.mask.shape, dtype=bool)

    def work(rows: slice) -> None:
        block = Block(observation, rows)
        valid[rows] = block.valid.reshape(valid[rows].shape)
        total, first, second = (
            part[rows].reshape(block.mask.size, specular.shape[2]) for part in (image, s1, s2)
        )
        light = {name: block.lobe(name) for name in ("specular", "diffuse")}
        np.add(light["specular"], light["diffuse"], out=total)  # Equation 7
        if tabled:
            one, *more = (light[name] for name in tabled)
            other = more[0] if more else one
            kernels.about_normals(one, other, block.normals, table, block.longest, first, second)
        for name, ratio in others.items():
            kernels.add_ratio(light[name], ratio(block), first, second)

    _in_threads(work, list(_blocks(specular.shape[:2])))
    return Components(image, s1, s2, valid)


def _joined(lobes: Sequence[AboutNormals]) -> NDArray[np.float64]:
    """The tables of all bands and lobes as columns of one, on the finest of their grids."""
    columns = [grid for lobe in lobes for grid in lobe.grids]
    finest = np.linspace(0.0, 1.0, max((column.size for column in columns), default=1))
    for k, column in enumerate(columns):
        if column.size < finest.size:
            columns[k] = np.interp(finest, np.linspace(0.0, 1.0, column.size), column)
    joined = np.stack(columns, axis=-1) if columns else np.zeros((1, 0))
    return np.concatenate([joined, joined[-1:]])  # one cell more, for x = 1 itself


def _in_threads(work: Callable[[slice], None], blocks: Sequence[slice]) -> None:
    if len(blocks) > 2:
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            list(pool.map(work, blocks))
    else:
        for rows in blocks:
            work(rows)


def _blocks(shape: tuple[int, int]) -> Iterator[slice]:
    rows = max(1, BLOCK_PIXELS // max(shape[1], 1))
    for start in range(0, shape[0], rows):
        yield slice(start, min(start + rows, shape[0]))
