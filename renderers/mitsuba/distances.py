"""Distances in a scene: how far its objects reach, and how far from them the camera stands."""

from __future__ import annotations

import math

from malus.scenes.scene import Scene


def scene_radius(scene: Scene) -> float:
    """Radius of a sphere around the origin that holds all objects."""
    return max(math.hypot(*p.position) + 2 * p.scale for p in scene.objects)


def camera_distance(scene: Scene) -> float:
    """Distance of the camera from the origin: an orthographic one stands beyond all objects."""
    return scene.camera.distance or 2 * scene_radius(scene)


def view_length(scene: Scene) -> float:
    """Length of rays of the camera that reach all objects."""
    return camera_distance(scene) + 2 * scene_radius(scene)
