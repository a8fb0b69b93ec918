"""Whole images from models of the two lobes: Equations 7 and 9 to 12, block by block.

A block of rows is small enough that what a model makes of it stays in cache, so that an image
costs little more than reading and writing it once, and memory beyond inputs and outputs stays a
few megabytes however large the image is.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.lobes import Block, BlockModel, LobeModel
from malus.reconstruct.observation import Components, Image, Observation

BLOCK_PIXELS = 1 << 16
"""Measured best of 2^12 to 2^17: smaller blocks pay for calls, larger ones leave the cache."""


def from_lobes(
    observation: Observation, specular_model: LobeModel, body_model: LobeModel | None
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
        Of the image's dtype. Pixels with an intensity that is negative or not finite, or with a
        normal that is not one, carry zeros and are False in `valid`.

    Raises
    ------
    Inapplicable
        If something that the models need is not known.
    """
    specular = observation.require("specular")
    observation.require("diffuse")
    dtype = np.result_type(specular.dtype, np.float32)
    image, s1, s2 = (np.empty(specular.shape, dtype) for _ in range(3))
    valid = np.empty(observation.mask.shape, dtype=bool)

    mirrored = specular_model(observation)
    scattered = body_model(observation) if body_model is not None else None

    def work(rows: slice) -> None:
        block = Block(_rows(observation, rows))
        valid[rows] = good = _valid(block)
        _fill(block, good, mirrored, scattered, (image[rows], s1[rows], s2[rows]))

    blocks = list(_blocks(specular.shape[:2]))
    if len(blocks) > 2:
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            list(pool.map(work, blocks))
    else:
        for rows in blocks:
            work(rows)
    return Components(image, s1, s2, valid)


def _fill(
    block: Block,
    good: NDArray[np.bool_],
    specular_model: BlockModel,
    body_model: BlockModel | None,
    out: tuple[Image, Image, Image],
) -> None:
    """Write a block; band by band, because inner loops over three bands would be all overhead."""
    image, s1, s2 = out
    specular = block.observation.require("specular")
    diffuse = block.observation.require("diffuse")
    shape = (image.shape[-1], *image.shape[:-1])
    mirrored = [np.broadcast_to(p, shape) for p in specular_model(block)]
    scattered = [np.broadcast_to(p, shape) for p in body_model(block)] if body_model else None
    np.add(specular, diffuse, out=image)
    for band in range(image.shape[-1]):
        for component, stokes in enumerate((s1, s2)):
            polarised = specular[..., band] * mirrored[component][band]
            if scattered is not None:
                polarised += diffuse[..., band] * scattered[component][band]
            stokes[..., band] = polarised
    if not good.all():
        for values in out:
            values[~good] = 0


def _blocks(shape: tuple[int, int]) -> Iterator[slice]:
    rows = max(1, BLOCK_PIXELS // max(shape[1], 1))
    for start in range(0, shape[0], rows):
        yield slice(start, min(start + rows, shape[0]))


def _rows(observation: Observation, rows: slice) -> Observation:
    """The same observation of some rows; views, nothing is copied."""
    images: dict[str, Any] = {
        name: getattr(observation, name)[rows]
        for name in ("image", "mask", "specular", "diffuse", "normals")
        if getattr(observation, name) is not None
    }
    for name, flat in (("eta", 1), ("alpha", 0)):
        value = getattr(observation, name)
        if value is not None and np.ndim(value) > flat:
            images[name] = value[rows]
    return replace(observation, **images)


def _valid(block: Block) -> NDArray[np.bool_]:
    """Pixels whose intensities are physical and whose normal, where given, is one."""
    part = block.observation
    specular, diffuse = part.require("specular"), part.require("diffuse")
    bands = [image[..., band] for image in (specular, diffuse) for band in range(image.shape[-1])]
    least, most = bands[0].copy(), bands[0].copy()
    for values in bands[1:]:
        np.minimum(least, values, out=least)
        np.maximum(most, values, out=most)
    # NaN passes through both, and compares False.
    good: NDArray[np.bool_] = (least >= 0) & (most < np.inf)
    if part.normals is not None:
        x, y, z = block.normal
        excess = x * x
        excess += y * y
        excess += z * z
        excess -= 1
        # float32 normals that were averaged and normalised again are unit to 1e-6
        good &= (np.abs(excess, out=excess) < 1e-3) & (z >= 0)
    return good
