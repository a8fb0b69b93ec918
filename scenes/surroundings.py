"""Objects around a scene's own shape: further shapes, floors and walls."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.model import Model
from malus.scenes.materials.surface import Surface
from malus.scenes.shapes.shapes import ShapeOrPlane

Coordinate = Annotated[float, Field(ge=-1000, le=1000)]


class Placed(Model):
    """One object among several: shape, surface, position, scale and orientation.

    The shape, which fits the unit sphere, is tilted by `tilt_deg` about +x (its top comes towards
    the viewer), turned by `turn_deg` about the vertical (its front goes to the right), scaled and
    moved to `position`, all in the world, whose unit is the radius of the scene's own shape.

    Examples
    --------
    >>> from malus.scenes import Dielectric, Plane
    >>> paint = Dielectric(eta=1.5, alpha=0.3)
    >>> Placed(shape=Plane(), surface=paint, position=(0, -1, 0), scale=12).scale
    12.0
    """

    shape: ShapeOrPlane
    surface: Surface
    position: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    scale: float = Field(default=1.0, gt=0, le=1000)
    tilt_deg: float = Field(default=0.0, ge=-360, le=360)
    turn_deg: float = Field(default=0.0, ge=-360, le=360)

    @property
    def rotation(self) -> Float64Array:
        """Rotation matrix (3, 3) of the tilt, then the turn.

        Examples
        --------
        >>> from malus.scenes import Dielectric, Plane
        >>> paint = Dielectric(eta=1.5, alpha=0.3)
        >>> wall = Placed(shape=Plane(), surface=paint, tilt_deg=90)
        >>> (wall.rotation @ [0, 1, 0]).round(9).tolist()  # its upper side faces the viewer
        [0.0, 0.0, 1.0]
        """
        tilt, turn = np.radians([self.tilt_deg, self.turn_deg])
        about_x = [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]
        about_y = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
        return np.array(about_y) @ np.array(about_x)


class Surroundings(Model):
    """Objects around the scene's own shape; light is reflected between all of them.

    Examples
    --------
    >>> from malus.scenes import Dielectric, Plane
    >>> paint = Dielectric(eta=1.5, alpha=0.3)
    >>> floor = Placed(shape=Plane(), surface=paint, position=(0, -1, 0))
    >>> len(Surroundings(name="desk", objects=(floor,)).objects)
    1
    """

    name: str = Field(min_length=1, max_length=100)
    objects: tuple[Placed, ...] = Field(min_length=1, max_length=64)
