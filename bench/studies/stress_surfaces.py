"""Stress study: images of perspective cameras, of maps of surfaces, and of metals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from malus.bench.studies.stress_images import ImageCase, planted
from malus.reconstruct import Observation

Change = Callable[[Observation], Observation]


def _from_near(observation: Observation) -> Observation:
    """View the object through a perspective camera: each pixel has its own view direction."""
    height, width = observation.mask.shape
    y, x = np.meshgrid(np.linspace(-0.4, 0.4, height), np.linspace(0.4, -0.4, width), indexing="ij")
    direction = np.stack([x, y, np.ones_like(x)], axis=-1)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    normals = observation.normals.copy()  # type: ignore[union-attr]
    away = np.sum(normals * direction, axis=-1) <= 0.0
    normals[away] = direction[away]
    return replace(
        observation, view_direction=direction.astype(observation.image.dtype), normals=normals
    )


def _metal(observation: Observation) -> Observation:
    """Make the object of gold, which has no diffuse light."""
    eta = np.array([1.3 + 1.9j, 0.4 + 2.4j, 0.15 + 3.4j])
    return replace(observation, eta=eta, diffuse=np.zeros_like(observation.diffuse))


def _mapped(observation: Observation) -> Observation:
    """Give index and roughness as maps, equal everywhere."""
    shape = observation.mask.shape
    eta, alpha = np.asarray(observation.eta), observation.alpha
    return replace(observation, eta=np.tile(eta, (*shape, 1)), alpha=np.full(shape, alpha))


def _two_objects(observation: Observation) -> Observation:
    """Make columns of glass and metal take turns."""
    mapped = _mapped(_metal(observation))
    eta, alpha = np.array(mapped.eta), np.array(mapped.alpha)
    eta[:, ::2], alpha[:, ::2] = 1.5, 1e-3
    return replace(mapped, eta=eta, alpha=alpha)


def _textured(observation: Observation) -> Observation:
    """Give every pixel another index, from 0.6 to 4, and another roughness."""
    mapped = _mapped(observation)
    size = mapped.mask.size
    alpha = np.geomspace(1e-3, 3.0, size).reshape(mapped.mask.shape)
    eta = np.geomspace(0.6, 4.0, 3 * size).reshape(mapped.image.shape)
    return replace(mapped, eta=eta, alpha=alpha)


def _both_changes(first: Change, second: Change) -> Change:
    """The second change applied to the result of the first."""
    return lambda observation: second(first(observation))


def surface_cases() -> list[ImageCase]:
    """Extreme images with perspective cameras, maps of surfaces and metals."""
    near, mapped = partial(_both_changes, _from_near), partial(_both_changes, _mapped)
    return [
        ImageCase("perspective camera", _from_near, False),
        ImageCase("view straight up", near(planted("view_direction", (0, 1, 0))), True),  # type: ignore[arg-type]
        ImageCase("view of length two", near(planted("view_direction", (0, 0, 2))), True),  # type: ignore[arg-type]
        ImageCase("NaN in a view", near(planted("view_direction", np.nan, 2)), True),
        ImageCase("view from behind", near(planted("view_direction", (0, 0, -1))), True),  # type: ignore[arg-type]
        ImageCase("metal", _metal, False),
        ImageCase("metal seen from near", _both_changes(_metal, _from_near), False),
        ImageCase("maps of one surface", _mapped, False),
        ImageCase("maps of glass and metal", _two_objects, False),
        ImageCase("maps of glass and metal seen from near", near(_two_objects), False),
        ImageCase("every pixel another surface", _textured, False),
        ImageCase("index 0 in a map", mapped(planted("eta", 0.0, 1)), True),
        ImageCase("negative index in a map", mapped(planted("eta", -1.5)), True),
        ImageCase("NaN index in a map", mapped(planted("eta", np.nan, 2)), True),
        ImageCase("infinite index in a map", mapped(planted("eta", np.inf)), True),
        ImageCase("roughness 0 in a map", mapped(planted("alpha", 0.0)), True),
        ImageCase("NaN roughness in a map", mapped(planted("alpha", np.nan)), True),
    ]
