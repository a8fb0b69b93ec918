"""Which pixels the object covers entirely, whatever the samples: those whose corners all hit it.

A mask that asked the random samples would gain and lose pixels of the rim from seed to seed, and
scores that live at the rim would jump with it.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


def inside(mi: ModuleType, scene: Any, resolution: int) -> Mask:
    """Pixels (resolution²,) whose four corners hit the only shape of `scene`."""
    corner = np.linspace(0.0, 1.0, resolution + 1, dtype=np.float32)
    x, y = (grid.ravel() for grid in np.meshgrid(corner, corner))
    sensor = scene.sensors()[0]
    if mi.variant().startswith("scalar"):
        rays = (sensor.sample_ray(0, 0, [a, b], [0.5, 0.5])[0] for a, b in zip(x, y, strict=True))
        hit = np.array([scene.ray_test(ray) for ray in rays])
    else:
        ray, _ = sensor.sample_ray(0.0, 0.0, mi.Point2f(x, y), mi.Point2f(0.5))
        hit = np.asarray(scene.ray_test(ray))
    hit = hit.reshape(resolution + 1, resolution + 1)
    return (hit[:-1, :-1] & hit[1:, :-1] & hit[:-1, 1:] & hit[1:, 1:]).ravel()
