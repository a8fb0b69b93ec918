"""Frames of Stokes vectors that others use instead of ours, as angles between the two.

Ours is the horizontal of the image across each ray. Where the camera is rolled or has a
perspective, frames of the world, of the camera or of each ray are others; one that points away from
the middle of the image is another for every camera.
"""

from __future__ import annotations

import numpy as np

from malus.renderers.truth import Truth
from malus.scenes.core.arrays import Float64Array
from malus.scenes.polarisation import viewing_frame

RADIAL = (
    "in the frame of the image: their axis seems to point away from its middle in every pixel,"
    " here it is +x"
)
WORLD = (
    "with the axes of the rolled image: their axis seems to be the horizontal of the scene, here"
    " +x turns with the camera"
)
ALONG_X = (
    "in the frame across each ray: their axis seems to be the camera's +x laid across the ray, here"
    " it is the horizontal across the ray"
)
MITSUBA = (
    "in the frame of the image: theirs seems to be the one that Mitsuba gives every ray"
    " (`stokes_basis`), here it is the horizontal across the ray"
)


def frame_turns(truth: Truth) -> dict[str, tuple[Float64Array, ...]]:
    """Angles (pixels of the mask,) by which other frames are turned anticlockwise from ours.

    Returns
    -------
    By what fits better in words, the frames that it points to.
    """
    camera, side = truth.scene.camera, truth.mask.shape
    every = truth.view_direction
    every = np.broadcast_to([0.0, 0.0, 1.0], (*side, 3)) if every is None else every
    view: Float64Array = every[truth.mask].astype(np.float64)
    row, column = np.nonzero(truth.mask)
    radial = np.arctan2((side[0] - 1) / 2 - row, column - (side[1] - 1) / 2)
    up = camera.axes @ np.array([0.0, 1.0, 0.0])
    return {
        WORLD: (_angle(np.cross(up, view), view),),
        ALONG_X: (_angle(np.broadcast_to([1.0, 0.0, 0.0], view.shape), view),),
        MITSUBA: (_angle(_basis(view @ camera.axes) @ camera.axes.T, view),),
        RADIAL: (radial, radial + np.pi / 2),
    }


def _angle(axes: Float64Array, view: Float64Array) -> Float64Array:
    """Angle (n,) from our axis to others (n, 3), seen against the light that travels to `view`."""
    across = viewing_frame(axes, view)
    return np.arctan2(across[:, 1], across[:, 0])


def _basis(ray: Float64Array) -> Float64Array:
    """The first of two unit vectors (n, 3) across each of `ray`, as Mitsuba chooses them.

    Source: Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
    """
    x, y, z = ray.T
    sign = np.copysign(1.0, z)
    scale = -1.0 / (sign + z)
    return np.stack([1.0 + sign * x * x * scale, sign * x * y * scale, -sign * x], axis=-1)
