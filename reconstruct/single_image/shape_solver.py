"""One sum of squares over the normals and the surface of an object, and its minimiser.

Unknown are the stereographic coordinates (f, g) of the normal at every pixel,
n = (2f, 2g, 1 − f² − g²)/(1 + f² + g²), and ln albedo, ln level and ln alpha of the surface. With
(n_x, n_y) the image components of the normal, the residuals are

* irradiance   (a · body + k · mirrored − I) / max I, for each picture: the whole image, or body
               light and mirrored light on their own where a separation came before;
* smoothness   ∇²(n_x, n_y), which vanishes on a sphere: curvature is free, its change is not;
* integrability  n_z³ (∂_y p − ∂_x q) with p = n_x/n_z, q = n_y/n_z, which is a polynomial,
               (1 − n_y²) ∂_y n_x − (1 − n_x²) ∂_x n_y + n_x n_y (∂_y n_y − ∂_x n_x),
               and stays finite at the occluding boundary, where the slopes do not;
* plausibility  ln level − ln(usual level), where the irradiance of the light is known, and
               ln alpha − ln(usual alpha): a wider lobe on a surface that is bent a little more
               looks the same, so that without it alpha would run away;
* the outline enters smoothness and integrability: around the object is a ring of known normals.

After Huynh and Robles-Kelly, "Simultaneous photometric invariance and shape recovery", ICCV (2009),
and Ikeuchi and Horn, "Numerical shape from shading and occluding boundaries" (1981).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import OptimizeResult, least_squares

from malus.reconstruct.single_image.jacobian_pattern import Pattern
from malus.reconstruct.single_image.outline import Outline
from malus.reconstruct.single_image.parameters import ALPHA_RANGE
from malus.reconstruct.single_image.shading import BodyKind, diffuse_shading, specular_shading
from malus.reconstruct.single_image.stereographic import normals_of, plane_slopes, to_rim

Floats = NDArray[np.float64]

RIM = 0.1
"""Weight of smoothness and integrability at pixels beside the outline. There the outline runs
somewhere through the ring, and the normal's change has a root in it: the true normals of blobs have
4 to 8 times the bending there that they have inside, and 16 times the curl."""
_STEP = 1e-5
"""Of the central differences of the shading, whose second derivatives are of order one."""


@dataclass(frozen=True)
class Picture:
    """Radiance (mask pixels,) that holds body light, mirrored light, or both."""

    radiance: Floats
    body: bool = True
    mirrored: bool = True


@dataclass(frozen=True)
class Guess:
    """Where a search starts or ended: normals (mask pixels, 3) and the surface."""

    normals: Floats
    albedo: float
    level: float
    alpha: float


@dataclass(frozen=True)
class Weights:
    """How much each residual counts beside the irradiance, whose weight is 1.

    `level` pulls ln level towards `usual_level`, what a typical dielectric would mirror, and
    `alpha` pulls ln alpha towards `usual_alpha`.
    """

    smoothness: float
    integrability: float
    level: float = 0.0
    usual_level: float = 1.0
    alpha: float = 0.0
    usual_alpha: float = 0.3


class ShapeProblem:
    """Residuals and sparse Jacobian for one object, light and kind of body.

    Parameters
    ----------
    pictures : what was seen
    outline : of the object
    direction : (3,) unit vector towards the light
    body : kind of body, with the index `eta` of its interface
    weights : of smoothness and integrability
    alpha : float, optional
        Roughness, where it is known.
    """

    def __init__(
        self,
        pictures: list[Picture],
        outline: Outline,
        direction: Floats,
        body: BodyKind,
        eta: float,
        weights: Weights,
        alpha: float | None = None,
    ) -> None:
        self.pictures, self.outline = pictures, outline
        self.direction, self.body, self.eta = direction, body, eta
        trust = np.where(outline.at_ring, RIM, 1.0)
        self.smooth = np.sqrt(weights.smoothness) * trust[outline.whole]
        self.integrable = np.sqrt(weights.integrability) * trust
        self.plausible = np.sqrt(np.array([weights.level, weights.alpha]) * outline.count)
        self.usual = np.array([weights.usual_level, weights.usual_alpha])
        self.alpha = alpha
        self.pattern = Pattern(outline, len(pictures))

    def solve(self, start: Guess, max_steps: int, tolerance: float) -> tuple[Guess, OptimizeResult]:
        """Minimise by scipy's trust-region method for sparse least squares."""
        found = least_squares(
            self.residuals,
            self._packed(start),
            jac=self.jacobian,
            method="trf",
            tr_solver="lsmr",
            tr_options={"regularize": True, "atol": 1e-4, "btol": 1e-4, "maxiter": 300},
            ftol=tolerance,
            xtol=1e-6,
            gtol=1e-10,
            max_nfev=max_steps,
        )
        f, g, albedo, level, alpha = self._unpacked(found.x)
        normals = normals_of(*to_rim(f, g))
        return replace(start, normals=normals, albedo=albedo, level=level, alpha=alpha), found

    def residuals(self, x: Floats) -> Floats:
        """Residuals of all kinds in one array."""
        f, g, albedo, level, alpha = self._unpacked(x)
        shaded, mirrored = self._shadings(f, g, alpha)
        parts = []
        for picture in self.pictures:
            model = picture.body * albedo * shaded + picture.mirrored * level * mirrored
            parts.append((model - picture.radiance) * self._scale(picture))
        field = self._with_ring(normals_of(f, g).T[:2])
        bending = (self.outline.laplacian @ field.T).T * self.smooth
        unusual = self.plausible * np.log([level, alpha] / self.usual)
        return np.concatenate([*parts, *bending, self.integrable * self._curl(field), unusual])

    def jacobian(self, x: Floats) -> sparse.csr_array:
        """Derivatives of the residuals, sparse but for the columns of the surface."""
        f, g, albedo, level, alpha = self._unpacked(x)
        shaded, mirrored = self._shadings(f, g, alpha)
        by_f = self._differences(f + _STEP, g, f - _STEP, g, alpha, alpha)
        by_g = self._differences(f, g + _STEP, f, g - _STEP, alpha, alpha)
        up, down = alpha * np.exp(_STEP), alpha * np.exp(-_STEP)
        by_alpha = self._differences(f, g, f, g, up, down)[1]
        parts = []
        for picture in self.pictures:
            scale = self._scale(picture)
            a, k = scale * albedo * picture.body, scale * level * picture.mirrored
            by_alpha_if_free = k * by_alpha * (self.alpha is None)
            parts += [a * by[0] + k * by[1] for by in (by_f, by_g)]
            parts += [a * shaded, k * mirrored, by_alpha_if_free]
        pulls = self.plausible * [1.0, float(self.alpha is None)]
        return self.pattern.filled([*parts, *self._geometry_slopes(f, g), pulls])

    def error(self, guess: Guess) -> float:
        """Root mean square residual of the irradiance, over the largest value of each picture."""
        f, g, albedo, level, alpha = self._unpacked(self._packed(guess))
        shaded, mirrored = self._shadings(f, g, alpha)
        square = 0.0
        for p in self.pictures:
            miss = p.body * albedo * shaded + p.mirrored * level * mirrored - p.radiance
            square += float(np.mean(np.square(miss * self._scale(p))))
        return float(np.sqrt(square))

    def _scale(self, picture: Picture) -> float:
        # Over the root of the count, so that a separated picture weighs no more than a whole one.
        peak = max(float(picture.radiance.max()), np.finfo(np.float64).tiny)
        return 1.0 / (peak * np.sqrt(len(self.pictures)))

    def _shadings(self, f: Floats, g: Floats, alpha: float) -> tuple[Floats, Floats]:
        normals = normals_of(*to_rim(f, g))
        return (
            diffuse_shading(normals, self.direction, self.body, self.eta),
            specular_shading(normals, self.direction, alpha),
        )

    def _differences(
        self, f1: Floats, g1: Floats, f0: Floats, g0: Floats, alpha1: float, alpha0: float
    ) -> tuple[Floats, Floats]:
        after, before = self._shadings(f1, g1, alpha1), self._shadings(f0, g0, alpha0)
        return (after[0] - before[0]) / (2 * _STEP), (after[1] - before[1]) / (2 * _STEP)

    def _geometry_slopes(self, f: Floats, g: Floats) -> list[Floats]:
        """Of smoothness and integrability, by f and g, in the order of the pattern."""
        bending, curl = self.pattern.bending, self.pattern.curl
        n_x, n_y = plane_slopes(f, g)
        smooth = self.smooth[bending.rows] * bending.values
        by_x, by_y = self._curl_slopes(self._with_ring(normals_of(f, g).T[:2]))
        parts = [smooth * slope[bending.columns] for slope in (*n_x, *n_y)]
        at = curl.columns
        return parts + [by_x * x[at] + by_y * y[at] for x, y in zip(n_x, n_y, strict=True)]

    def _with_ring(self, components: Floats) -> Floats:
        return np.concatenate([components, self.outline.across.T], axis=1)

    def _derivatives(self, field: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """∂_x n_x, ∂_y n_x, ∂_x n_y, ∂_y n_y at the mask's pixels."""
        dx, dy = self.outline.dx, self.outline.dy
        return dx @ field[0], dy @ field[0], dx @ field[1], dy @ field[1]

    def _curl(self, field: Floats) -> Floats:
        xx, xy, yx, yy = self._derivatives(field)
        n_x, n_y = field[:, : self.outline.count]
        return np.asarray((1 - n_y**2) * xy - (1 - n_x**2) * yx + n_x * n_y * (yy - xx))

    def _curl_slopes(self, field: Floats) -> tuple[Floats, Floats]:
        """Of integrability by n_x and n_y, at the entries of the pattern's `curl`."""
        xx, xy, yx, yy = self._derivatives(field)
        n_x, n_y = field[:, : self.outline.count]
        both, curl = n_x * n_y, self.pattern.curl
        by_x = [-both, 1 - n_y**2, 2 * n_x * yx + n_y * (yy - xx)]
        by_y = [n_x**2 - 1, both, n_x * (yy - xx) - 2 * n_y * xy]
        weights = [np.concatenate([part * self.integrable for part in by]) for by in (by_x, by_y)]
        return weights[0][curl.rows] * curl.values, weights[1][curl.rows] * curl.values

    def _packed(self, guess: Guess) -> Floats:
        n_z = np.clip(guess.normals[:, 2], 0.0, None)
        plane = guess.normals[:, :2] / (1.0 + n_z)[:, None]
        surface = np.log(np.maximum([guess.albedo, guess.level, guess.alpha], 1e-9))
        return np.concatenate([plane[:, 0], plane[:, 1], surface])

    def _unpacked(self, x: Floats) -> tuple[Floats, Floats, float, float, float]:
        f, g = x[:-3].reshape(2, -1)
        albedo, level, alpha = np.exp(np.clip(x[-3:], -25.0, 25.0))
        return f, g, float(albedo), float(level), float(np.clip(alpha, *ALPHA_RANGE))
