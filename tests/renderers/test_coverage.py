"""The mask holds all pixels that an object covers, with corners on edges of a mesh too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from rooms import needs_arrays

from malus.renderers.families.family import render_family
from malus.renderers.rendering import render
from malus.renderers.variant import choose
from malus.scenes import (
    Camera,
    Dielectric,
    Distant,
    MeshFile,
    Placed,
    Plane,
    Sampling,
    Scene,
    Surroundings,
)

CAMERA = Camera(resolution=64)


@pytest.fixture
def globe(tmp_path: Path) -> Scene:
    """A convex mesh, some of whose meridians and parallels go through corners of pixels."""
    trimesh.creation.uv_sphere().export(tmp_path / "globe.obj")
    shape = MeshFile(path=str(tmp_path / "globe.obj"))
    surface = Dielectric(eta=1.5, alpha=0.3, body="unpolarised")
    return Scene(shape=shape, surface=surface, light=Distant(incidence_deg=30), camera=CAMERA)


def distances() -> tuple[np.ndarray, np.ndarray]:
    """From the middle of the image to the nearest and the farthest corner of each pixel."""
    at = CAMERA.half_width * np.linspace(-1, 1, CAMERA.resolution + 1)
    to_corner = np.hypot(at, at[:, None])
    corners = (to_corner[:-1, :-1], to_corner[1:, :-1], to_corner[:-1, 1:], to_corner[1:, 1:])
    return np.minimum.reduce(corners), np.maximum.reduce(corners)


FLAT = 0.997
"""Least radius of the globe, at the middles of its faces: cos² of half of 360°/62."""


@pytest.mark.parametrize("backend", ["scalar", pytest.param("llvm", marks=needs_arrays)])
def test_a_globe_has_no_holes(globe: Scene, backend: str) -> None:
    variant = choose() if backend == "llvm" else choose("scalar")
    mask = render_family([globe], Sampling(samples=2), variant).truth(globe).mask
    nearest, farthest = distances()
    assert mask[farthest < FLAT].all()
    assert not mask[farthest > 1].any()
    assert not mask[nearest > 1].any()


@needs_arrays
def test_nor_where_another_object_shows_through(globe: Scene) -> None:
    """Pixels that both objects share are of neither."""
    paint = Dielectric(eta=1.5, alpha=0.1, body="unpolarised")
    wall = Placed(shape=Plane(), surface=paint, position=(0, 0, -1), scale=3, tilt_deg=90)
    around = Surroundings(name="wall", objects=(wall,))
    truth = render(globe.model_copy(update={"surroundings": around}), Sampling(samples=2))
    nearest, farthest = distances()
    own = truth.mask & (np.abs(truth.alpha - 0.3) < 1e-6)
    walls = truth.mask & (np.abs(truth.alpha - 0.1) < 1e-6)
    assert own[farthest < FLAT].all()
    assert not own[farthest > 1].any()
    assert walls[nearest > 1].all()
    assert not walls[nearest < FLAT].any()
