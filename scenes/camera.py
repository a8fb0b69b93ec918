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
    """A pinhole or orthographic camera that looks at the origin; square images.

    It stands on the world's +z unless `azimuth_deg` or `elevation_deg` move it around the object:
    the *world's* axes are those of a camera that is neither moved nor rolled (x right, y up, z
    towards it), and objects and lights stay in the world. The *image frame* (x right, y up, z
    towards the viewer) is the camera's own.

    Attributes
    ----------
    resolution : pixels of a side
    half_width : half the width of the image of an `orthographic` camera, in scene units
    projection : 'orthographic', all rays parallel, or 'perspective', through a pinhole
    fov_deg : horizontal field of view of a `perspective` camera, from edge to edge
    distance : from the pinhole of a `perspective` camera to the origin; objects have radius 1
    roll_deg : turn of the camera about its axis, anticlockwise as the photographer sees it. The
        world, with its lights, appears turned clockwise by as much.
    azimuth_deg : where the camera stands around the object, about the vertical (+y): from +z (0)
        over the right, +x (90), to behind the object (180), as a sky's sun counts
    elevation_deg : its angle above the horizontal plane; at 90 it looks straight down, and its
        horizontal is that of the same azimuth

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
    azimuth_deg: float = Field(default=0.0, ge=-360, le=360, exclude_if=_at_default(0.0))
    elevation_deg: float = Field(default=0.0, ge=-90, le=90, exclude_if=_at_default(0.0))

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
        rolled = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return rolled @ self._upright_axes() if self.moved else rolled

    @property
    def moved(self) -> bool:
        """Whether the camera stands elsewhere than on the world's +z.

        Examples
        --------
        >>> Camera(roll_deg=30).moved, Camera(azimuth_deg=30).moved
        (False, True)
        """
        return self.azimuth_deg != 0.0 or self.elevation_deg != 0.0

    @property
    def label(self) -> str:
        """End of a scene's name in tables: where a camera stands that was moved.

        Examples
        --------
        >>> Camera(azimuth_deg=30, elevation_deg=20).label
        ' from 30°, 20° up'
        """
        return f" from {self.azimuth_deg:g}°, {self.elevation_deg:g}° up" if self.moved else ""

    def _upright_axes(self) -> Float64Array:
        """The axes of the same camera without its roll."""
        azimuth, elevation = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        (sin_a, cos_a), (sin_e, cos_e) = (
            (math.sin(angle), math.cos(angle)) for angle in (azimuth, elevation)
        )
        return np.array(
            [
                [cos_a, 0.0, -sin_a],
                [-sin_e * sin_a, cos_e, -sin_e * cos_a],
                [cos_e * sin_a, sin_e, cos_e * cos_a],
            ]
        )

    def intrinsics(self) -> Float64Array:
        """Matrix K (3, 3) from points in front of the camera to pixels, as OpenCV counts both.

        In OpenCV's camera frame x points right, y down and z forward, and pixel (0, 0) is the
        centre of the upper left one. A `perspective` camera shows the point (x, y, z) at column u
        and row v with (u, v, 1) = K (x, y, z) / z; an `orthographic` one with
        (u, v, 1) = K (x, y, 1), so that K then holds pixels per scene unit.

        Source: OpenCV's documentation, "Camera Calibration and 3D Reconstruction" (calib3d).

        Examples
        --------
        >>> Camera(resolution=100, half_width=2).intrinsics().tolist()
        [[25.0, 0.0, 49.5], [0.0, 25.0, 49.5], [0.0, 0.0, 1.0]]
        """
        edge = self.half_width
        if self.fov_deg is not None:
            edge = math.tan(math.radians(0.5 * self.fov_deg))
        scale, middle = 0.5 * self.resolution / edge, 0.5 * (self.resolution - 1)
        return np.array([[scale, 0.0, middle], [0.0, scale, middle], [0.0, 0.0, 1.0]])

    def extrinsics(self) -> Float64Array:
        """Matrix [R | t] (3, 4) from the world to OpenCV's camera frame.

        A point X of the world is at R X + t, with x to the right, y down and z forward. The camera
        of an `orthographic` image stands nowhere: its z counts from the plane through the origin
        that is parallel to the image.

        Examples
        --------
        A camera 3 in front of the origin, which its z axis points at:

        >>> Camera(projection="perspective", fov_deg=40, distance=3).extrinsics().tolist()
        [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 3.0]]
        """
        rotation = np.diag([1.0, -1.0, -1.0]) @ self.axes
        distance = 0.0 if self.distance is None else self.distance
        # Adding 0.0 makes 0.0 of -0.0.
        return np.column_stack([rotation, [0.0, 0.0, distance]]) + 0.0

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


class Views(Model):
    """Cameras in equal steps all around the object, at one elevation: an axis of a suite.

    Attributes
    ----------
    count : number of cameras
    elevation_deg : their elevation
    azimuth_deg : azimuth of the first one; the next stands to its right, 360° / count farther

    Examples
    --------
    >>> [camera.azimuth_deg for camera in Views(count=3).cameras(Camera())]
    [0.0, 120.0, -120.0]
    """

    count: int = Field(ge=1, le=3600)
    elevation_deg: float = Field(default=0.0, ge=-90, le=90)
    azimuth_deg: float = Field(default=0.0, ge=-360, le=360)

    def cameras(self, camera: Camera) -> tuple[Camera, ...]:
        """The cameras, each a copy of `camera` that stands elsewhere."""
        azimuths = (self.azimuth_deg + 360.0 * k / self.count for k in range(self.count))
        return tuple(
            camera.model_copy(
                update={
                    "azimuth_deg": math.remainder(azimuth, 360.0),
                    "elevation_deg": self.elevation_deg,
                }
            )
            for azimuth in azimuths
        )
