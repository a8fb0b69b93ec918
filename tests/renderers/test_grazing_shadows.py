"""Shadows: of light that grazes, as long as the angle makes them, and of objects far away."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rooms import needs_arrays

from malus.renderers import render
from malus.scenes import (
    Area,
    Camera,
    Dielectric,
    Distant,
    MeshFile,
    Placed,
    Plane,
    Polariser,
    Sampling,
    Scene,
    Sphere,
    Surroundings,
)
from malus.scenes.lights.lights import Light

FIN_AT, LONG = 0.5, 0.6
"""Where on a floor from -1 to 1 a fin stands that a lamp on the right shines at, and how long its
shadow is."""


PAPER = Dielectric(eta=1.5, alpha=0.3, albedo=0.8, body="unpolarised")
STRAIGHT_UP = {"incidence_deg": 90.0, "azimuth_deg": 90.0}
ABOVE: list[Light] = [
    Distant.model_validate(STRAIGHT_UP),
    Area.model_validate(STRAIGHT_UP | {"half_angle_deg": 10.0}),
    Area.model_validate(STRAIGHT_UP | {"half_angle_deg": 10.0, "polarised": Polariser()}),
]


def floor_with_fin(path: Path, height: float) -> MeshFile:
    """A floor that faces the camera, and a fin on it that the camera sees as a line."""
    corners = [(x, y, 0.0) for x, y in ((-1, -0.5), (1, -0.5), (1, 0.5), (-1, 0.5))]
    corners += [(FIN_AT, y, z) for y, z in ((-0.5, 0.0), (0.5, 0.0), (0.5, height), (-0.5, height))]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + ["f 1 2 3 4", "f 5 6 7 8"]
    path.write_text("\n".join(lines), "utf-8")
    return MeshFile(path=str(path), shading="flat")


def profile(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Places from -1 to 1 along the floor, and radiance there over that of the lit end."""
    truth = render(scene, Sampling(samples=64, max_depth=2))
    columns = np.flatnonzero(truth.mask.any(axis=0))
    image = np.where(truth.mask, truth.image[..., 0], 0.0)[:, columns]
    assert truth.mask[truth.mask.any(axis=1)][:, columns].all()
    # The floor ends within a pixel of the outermost that it covers.
    place = 2 * (np.arange(len(columns)) + 0.5) / len(columns) - 1
    mean = image.sum(axis=0) / truth.mask[:, columns].sum(axis=0)
    return place, mean / np.median(mean[place > FIN_AT + 0.1])


@pytest.mark.parametrize("among_objects", [False, pytest.param(True, marks=needs_arrays)])
@pytest.mark.parametrize(
    ("light", "least_deg", "most_deg"),
    [
        (Distant(incidence_deg=89.4, azimuth_deg=0), 0.6, 0.6),
        (Distant(incidence_deg=86, azimuth_deg=0), 4.0, 4.0),
        (Area(incidence_deg=86, azimuth_deg=0, half_angle_deg=0.2, radiance=100), 3.8, 4.2),
    ],
    ids=["0.6°", "4°", "wide"],
)
def test_a_shadow_is_as_long_as_the_lamp_is_low(
    tmp_path: Path, light: Light, least_deg: float, most_deg: float, among_objects: bool
) -> None:
    middle = 0.5 * (least_deg + most_deg)
    height = LONG * np.tan(np.radians(middle))
    shape = floor_with_fin(tmp_path / "fin.obj", height)
    paint = Dielectric(eta=1.5, alpha=0.3, body="unpolarised")
    hidden = Placed(shape=Plane(), surface=paint, position=(0, 0, -3), scale=0.1)
    around = Surroundings(name="nothing near", objects=(hidden,)) if among_objects else None
    scene = Scene(
        shape=shape, surface=paint, light=light, camera=Camera(resolution=96), surroundings=around
    )
    place, radiance = profile(scene)
    # Behind the fin, to the left; rounding lifts the places that rays start from by about 2e-4.
    lifted = 4e-4 / np.tan(np.radians(least_deg))
    shortest, longest = (height / np.tan(np.radians(a)) for a in (most_deg, least_deg))
    pixel = 3.0 / len(place)
    dark = (place < FIN_AT - pixel) & (place > FIN_AT - shortest + lifted + pixel)
    lit = (place > FIN_AT + pixel) | (place < FIN_AT - longest - pixel)
    assert dark.sum() > 0.2 * len(place)
    assert lit.sum() > 0.5 * len(place)
    assert (radiance[dark] == 0).all()
    # Lit alike all over; a wide lamp is noisy.
    np.testing.assert_allclose(radiance[lit], 1, rtol=1e-3 if isinstance(light, Distant) else 0.1)


@needs_arrays
@pytest.mark.parametrize("light", ABOVE, ids=lambda light: light.label)
def test_a_roof_far_above_hides_the_light_along_every_path(light: Light) -> None:
    """From the ball, and from the floor whose light would reach it: all of it is dark."""
    floor = Placed(shape=Plane(), surface=PAPER, position=(0, -1, 0), scale=3)
    roof = Placed(shape=Plane(), surface=PAPER, position=(0, 100, 0), scale=60)
    images = [
        render(
            Scene(
                shape=Sphere(),
                surface=PAPER,
                light=light,
                camera=Camera(resolution=12),
                surroundings=Surroundings(name="roof", objects=objects),
            ),
            Sampling(samples=16, max_depth=3),
        ).image
        for objects in ((floor,), (floor, roof))
    ]
    assert images[0].max() > 0.1
    assert not images[1].any()
