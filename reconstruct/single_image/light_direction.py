"""Direction of a distant light from one object's shading and normals."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from malus.reconstruct.observation import Inapplicable
from malus.reconstruct.single_image.parameters import TYPICAL_ETA, check_finite, fit_parameters
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import image_frame, viewing_frame

_INCIDENCES_DEG = np.arange(5.0, 121.0, 11.5)
_AZIMUTHS_DEG = np.arange(0.0, 360.0, 22.5)
_ALPHA = 0.3
"""Roughness during the search: a wide highlight is felt from directions far from the light."""
_UNEXPLAINED = 0.25
"""Residual over the largest value above which the shading is not that of a single light."""


def estimate_direction(
    pixels: Float64Array,
    normals: Float64Array,
    refuse: bool = True,
    view_direction: Float64Array | None = None,
) -> Float64Array:
    """Unit vector (3,) towards the one distant light that explains the shading best.

    A Lambertian body with a highlight is fitted for directions on a grid; the best of them is
    refined by a simplex search.

    Parameters
    ----------
    pixels : (n,) radiances
    normals : (n, 3) unit normals, for example those that the outline suggests
    refuse : bool
        False returns the best direction also where it does not explain the shading.
    view_direction : (n, 3) array, optional
        Unit vectors towards a perspective camera, in the image frame, as the normals are.

    Returns
    -------
    ndarray of shape (3,)
        Unit vector towards the light, in the image frame.

    Raises
    ------
    InputError
        For arrays that do not belong together, no pixels, or some that are not finite.
    Inapplicable
        If the object is dark, or no direction explains its shading and `refuse` is true.

    Notes
    -----
    In the manner of Brooks and Horn, "Shape and source from shading", IJCAI (1985).

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> n = rng.normal(size=(500, 3))
    >>> n[:, 2] = abs(n[:, 2])
    >>> n /= np.linalg.norm(n, axis=1, keepdims=True)
    >>> bool(estimate_direction(np.clip(n[:, 0], 0, 1), n)[0] > 0.999)
    True
    """
    pixels, normals = np.asarray(pixels), np.asarray(normals)
    if normals.shape != (pixels.size, 3) or pixels.ndim != 1:
        found = f"{pixels.shape} and {normals.shape}"
        hint = "of several bands take the mean: pixels.mean(axis=-1)"
        raise InputError("pixels, normals", "shapes (n,) and (n, 3)", found, hint)
    check_finite(pixels)
    if not pixels.max() > 0:
        raise Inapplicable("the object is dark: no shading to read a light from")
    scaled = pixels[:, None] / pixels.max()
    if view_direction is not None:
        normals = np.asarray(viewing_frame(normals, view_direction))
        middle = mean_direction(view_direction)

    def cost(angles: Float64Array) -> float:
        light = _unit(angles)
        # For light from behind, the half vector is ill defined: such directions are ruled out.
        if light[2] < -0.9:
            return 1.0
        seen = light
        if view_direction is not None:
            seen = np.asarray(viewing_frame(image_frame(light, middle), view_direction), np.float64)
        return fit_parameters(scaled, normals, seen, "unpolarised", None, TYPICAL_ETA, _ALPHA).error

    grid = np.radians([(i, a) for i in _INCIDENCES_DEG for a in _AZIMUTHS_DEG])
    start = min(grid, key=cost)
    minimum = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-6})
    if refuse and not minimum.fun < _UNEXPLAINED:
        raise Inapplicable(
            f"no single light explains the shading: residual {minimum.fun:.0%} of its largest value"
        )
    direction = _unit(minimum.x)
    if view_direction is not None:
        direction = np.asarray(image_frame(direction, middle), np.float64)
    return direction


def mean_direction(directions: Float64Array) -> Float64Array:
    """Unit vector (3,) along the sum of those (n, 3) that are finite; (0, 0, 1) where it is zero.

    Examples
    --------
    >>> mean_direction(np.array([[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [np.nan] * 3])).tolist()
    [0.0, 0.0, 1.0]
    """
    total = directions[np.isfinite(directions).all(axis=1)].sum(axis=0, dtype=np.float64)
    length = float(np.linalg.norm(total))
    return np.asarray(total / length) if length > 0 else np.array([0.0, 0.0, 1.0])


def _unit(angles: Float64Array) -> Float64Array:
    """Unit vector (3,) at an angle from the viewer and an azimuth from +x, radians."""
    incidence, azimuth = angles
    sine = np.sin(incidence)
    return np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(incidence)])
