"""What a camera frames, against the corners of its pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest

from malus.scenes import Camera

FAR = 2.2
"""Distance of the pinhole from the middle of the unit sphere."""


def a_pixel_is_covered(resolution: int, edge: float, perspective: bool) -> bool:
    """Whether rays through all four corners of a pixel hit the unit sphere, one by one.

    `edge` is that of the image: at the origin, or at a distance of 1 from a pinhole.
    """
    corners = edge * np.linspace(-1.0, 1.0, resolution + 1)
    hit = np.zeros((resolution + 1, resolution + 1), bool)
    for row, column in np.ndindex(hit.shape):
        x, y = corners[column], corners[row]
        nearest = np.array([x, y, 0.0])  # to the middle of the sphere
        if perspective:
            pinhole, forward = np.array([0.0, 0.0, FAR]), np.array([x, y, -1.0])
            along = forward / np.linalg.norm(forward)
            nearest = pinhole - (pinhole @ along) * along
        hit[row, column] = np.linalg.norm(nearest) <= 1.0
    return bool((hit[:-1, :-1] & hit[1:, :-1] & hit[:-1, 1:] & hit[1:, 1:]).any())


@pytest.mark.parametrize("perspective", [False, True], ids=["orthographic", "perspective"])
@pytest.mark.parametrize("resolution", [1, 2, 5, 6])
def test_a_sphere_too_small_to_cover_a_pixel_is_not_seen(
    resolution: int, perspective: bool
) -> None:
    """In steps of 2 %, so that spheres just too small and just large enough are among them."""
    seen = []
    for edge in np.geomspace(0.2, 6.0, 171).tolist():
        camera = Camera(resolution=resolution, half_width=edge)
        if perspective:
            fov_deg = 2 * math.degrees(math.atan(edge))
            camera = Camera(
                resolution=resolution, projection="perspective", fov_deg=fov_deg, distance=FAR
            )
        seen.append(camera.sees_the_object)
        assert seen[-1] == a_pixel_is_covered(resolution, edge, perspective), edge
    assert seen[0]
    assert not seen[-1]
