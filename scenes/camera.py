"""Cameras, and the frame of their images."""

from __future__ import annotations

import math
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.model import Model

HALF_WIDTH = 1.05
"""Half the width of an orthographic image by default: the unit sphere and a margin."""


def _at_default(default: Any) -> Any:
    """Condition to leave a key out at its default: scenes from before it keep their id."""
    return lambda value: value == default


class Camera(Model):
    """A pinhole or orthographic camera on +z that looks at the origin; square images.

    Attributes
    ----------
    resolution : pixels of a side
    half_width : half the width of the image of an `orthographic` camera, in scene units
    projection : 'orthographic' or 'perspective'
    fov_deg : horizontal field of view of a `perspective` camera, from edge to edge
    distance : from the pinhole of a `perspective` camera to the origin; objects have radius 1
    roll_deg : turn of the camera about its axis, anticlockwise as the photographer sees it. The
        world, with its lights, stays: it appears turned clockwise by as much. The *image frame*
        (x right, y up, z towards the viewer) turns with the camera, and the world's axes are
        those of a camera that is not rolled.

    Examples
    --------
    >>> wide = Camera(resolution=64, projection="perspective", fov_deg=60, distance=2.5)
    >>> wide.view_directions().shape
    (64, 64, 3)
    """

    resolution: int = Field(default=128, ge=1, le=8192)
    half_width: float = Field(default=HALF_WIDTH, ge=1e-3)
    projection: Literal["orthographic", "perspective"] = Field(
        default="orthographic", exclude_if=_at_default("orthographic")
    )
    fov_deg: float | None = Field(default=None, gt=0, lt=170, exclude_if=_at_default(None))
    distance: float | None = Field(default=None, gt=1, le=1e4, exclude_if=_at_default(None))
    roll_deg: float = Field(default=0.0, ge=-360, le=360, exclude_if=_at_default(0.0))

    @model_validator(mode="after")
    def _one_projection(self) -> Self:
        perspective_keys = [self.fov_deg is not None, self.distance is not None]
        if self.projection == "perspective" and not all(perspective_keys):
            raise ValueError("fov_deg and distance of a perspective camera")
        if self.projection == "perspective" and self.half_width != HALF_WIDTH:
            raise ValueError("no half_width, but fov_deg and distance, of a perspective camera")
        if self.projection == "orthographic" and any(perspective_keys):
            raise ValueError('fov_deg and distance only with projection = "perspective"')
        return self

    @property
    def axes(self) -> Float64Array:
        """The image frame's x, y and z in world coordinates, the rows of a (3, 3) rotation.

        Examples
        --------
        >>> Camera(roll_deg=90).axes.round(9).tolist()[1]  # up in the image: to the world's left
        [-1.0, 0.0, 0.0]
        """
        roll = math.radians(self.roll_deg)
        sine, cosine = (math.sin(roll), math.cos(roll)) if self.roll_deg else (0.0, 1.0)
        return np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    @property
    def sees_the_object(self) -> bool:
        """Whether the unit sphere, which every object fits, covers a pixel from corner to corner.

        Examples
        --------
        >>> Camera(resolution=64, half_width=1e9).sees_the_object
        False
        """
        if self.fov_deg is None or self.distance is None:
            radius = 1.0 / self.half_width
        else:  # of the cone that touches the sphere, where the image is 2 wide
            cone = math.tan(math.asin(1.0 / self.distance))
            radius = cone / math.tan(math.radians(0.5 * self.fov_deg))
        # In pixels; four of an even number meet in the middle, where an odd one has one.
        return 0.5 * radius * self.resolution >= (
            math.sqrt(0.5) if self.resolution % 2 else math.sqrt(2)
        )

    def view_directions(self) -> Float64Array | None:
        """Unit vectors (height, width, 3) towards the camera from the point at each pixel's centre.

        In the image frame; None for an orthographic camera: (0, 0, 1) everywhere.

        Examples
        --------
        >>> narrow = Camera(resolution=1, projection="perspective", fov_deg=40, distance=3)
        >>> narrow.view_directions().tolist()
        [[[0.0, 0.0, 1.0]]]
        """
        if self.fov_deg is None:
            return None
        edge = math.tan(math.radians(0.5 * self.fov_deg))
        across = edge * ((2.0 * np.arange(self.resolution) + 1.0) / self.resolution - 1.0)
        x, y = np.meshgrid(across, -across)
        toward = np.stack([0.0 - x, 0.0 - y, np.ones_like(x)], axis=-1)
        result: Float64Array = toward / np.linalg.norm(toward, axis=-1, keepdims=True)
        return result
