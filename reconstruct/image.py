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

from malus.reconstruct.block import Block
from malus.reconstruct.lobes import BlockModel, LobeModel
from malus.reconstruct.observation import Components, Image, Observation

BLOCK_PIXELS = 1 << 17
"""Measured best of 2^13 to 2^19: smaller blocks pay for calls, larger ones leave the cache."""


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
    dtype = np.result_type(specular.dtype, np.float32)
    image, s1, s2 = (np.empty(specular.shape, dtype) for _ in range(3))
    valid = np.empty(observation.mask.shape, dtype=bool)

    mirrored = specular_model(observation)
    scattered = body_model(observation) if body_model is not None else None

    def work(rows: slice) -> None:
        block = Block(_rows(observation, rows))
        valid[rows] = block.valid
        _add_lobes(block, image[rows])
        _polarise(block, mirrored, scattered, s1[rows], s2[rows])

    blocks = list(_blocks(specular.shape[:2]))
    if len(blocks) > 2:
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            list(pool.map(work, blocks))
    else:
        for rows in blocks:
            work(rows)
    return Components(image, s1, s2, valid)


def _add_lobes(block: Block, out: Image) -> None:
    """I = I_d + I_s, Equation 7; zero where a pixel is not valid."""
    lobes = (block.observation.require("specular"), block.observation.require("diffuse"))
    if block.all_valid:
        np.add(*lobes, out=out)
        return
    out[...] = 0
    np.add(*lobes, out=out, where=block.valid[..., None])


def _polarise(
    block: Block,
    specular_model: BlockModel,
    body_model: BlockModel | None,
    s1: Image,
    s2: Image,
) -> None:
    """Write s1 and s2; plane by plane, as loops over three bands would be all overhead."""
    specular, mirrored = block.lobe("specular"), specular_model(block)
    diffuse, scattered = [], None
    if body_model is not None:
        diffuse, scattered = block.lobe("diffuse"), body_model(block)
    for band, lobe in enumerate(specular):
        polarised = lobe * mirrored.degree[band]
        cos2, sin2 = mirrored.cos2[band], mirrored.sin2[band]
        if scattered is None:
            np.multiply(polarised, cos2, out=s1[..., band])
            np.multiply(polarised, sin2, out=s2[..., band])
            continue
        other = diffuse[band] * scattered.degree[band]
        if scattered.cos2[band] is cos2:  # one frame for both lobes
            polarised += other
            np.multiply(polarised, cos2, out=s1[..., band])
            np.multiply(polarised, sin2, out=s2[..., band])
        else:
            np.add(polarised * cos2, other * scattered.cos2[band], out=s1[..., band])
            np.add(polarised * sin2, other * scattered.sin2[band], out=s2[..., band])


def _blocks(shape: tuple[int, int]) -> Iterator[slice]:
    rows = max(1, BLOCK_PIXELS // max(shape[1], 1))
    for start in range(0, shape[0], rows):
        yield slice(start, min(start + rows, shape[0]))


def _rows(observation: Observation, rows: slice) -> Observation:
    """The same observation of some rows; views, nothing is copied."""
    images: dict[str, Any] = {
        name: getattr(observation, name)[rows]
        for name in ("image", "mask", "specular", "diffuse", "normals", "view")
        if getattr(observation, name) is not None
    }
    for name, flat in (("eta", 1), ("alpha", 0)):
        value = getattr(observation, name)
        if value is not None and np.ndim(value) > flat:
            images[name] = value[rows]
    return replace(observation, **images)
