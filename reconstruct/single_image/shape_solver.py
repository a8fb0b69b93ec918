"""Least squares over the normals and the surface parameters of an object.

Unknown are the stereographic coordinates (f, g) of the normal at every pixel,
n = (2f, 2g, 1 − f² − g²)/(1 + f² + g²), and ln albedo, ln level and ln alpha of the surface. With
(n_x, n_y) the image components of the normal, the residuals are

* irradiance   (a · diffuse + k · specular − I) / max I, for each picture: the whole image, or
               diffuse and specular light on their own where they were separated before;
* smoothness   ∇²(n_x, n_y), which vanishes on a sphere: curvature is free, its change is not;
* integrability  n_z³ (∂_y p − ∂_x q) with p = n_x/n_z, q = n_y/n_z, which is a polynomial,
               (1 − n_y²) ∂_y n_x − (1 − n_x²) ∂_x n_y + n_x n_y (∂_y n_y − ∂_x n_x),
               and stays finite at the occluding boundary, where the slopes do not;
* plausibility  ln level − ln(usual level), where the irradiance of the light is given, and
               ln alpha − ln(usual alpha): a wider lobe on a surface that is bent a little more
               looks the same, so that without it alpha would run away;
* the outline enters smoothness and integrability: around the object is a ring of known normals.

After Huynh and Robles-Kelly, "Simultaneous photometric invariance and shape recovery", ICCV (2009),
and Ikeuchi and Horn, "Numerical shape from shading and occluding boundaries" (1981).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.optimize import OptimizeResult, least_squares

from malus.reconstruct.observation import Inapplicable
from malus.reconstruct.single_image.jacobian_pattern import JacobianPattern
from malus.reconstruct.single_image.outline import Outline
from malus.reconstruct.single_image.parameters import ALPHA_RANGE
from malus.reconstruct.single_image.shading import BodyKind, diffuse_shading, specular_shading
from malus.reconstruct.single_image.stereographic import normals_of, plane_slopes, to_rim
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import first_line

RIM = 0.1
"""Weight of smoothness and integrability at pixels beside the outline. The outline runs somewhere
through the ring, and near it normals change like a square root of the distance: the true normals of
blobs have 4 to 8 times the bending there that they have inside, and 16 times the curl."""
_DARK = 1e-6
"""Part of the largest radiance below which a separated picture is dark: a rounding of single
precision, which is not blown up to the weight of the other picture."""
_STEP = 1e-5
"""Step of the central differences of the shading, whose second derivatives are of order one."""


@dataclass(frozen=True)
class MaskedPicture:
    """Radiance (mask pixels,) of diffuse light, specular light, or both."""

    radiance: Float64Array
    diffuse: bool = True
    specular: bool = True


@dataclass(frozen=True)
class ShapeEstimate:
    """Normals (mask pixels, 3) and surface parameters at the start or the end of a search.

    `albedo` and `level` are the weights of diffuse and specular shading, as in `SurfaceParameters`.
    """

    normals: Float64Array
    albedo: float
    level: float
    alpha: float


@dataclass(frozen=True)
class ResidualWeights:
    """Weights of the residuals beside the irradiance, whose weight is 1.

    `level` is that of ln level − ln(usual_level), the level of a typical dielectric, and `alpha`
    that of ln alpha − ln(usual_alpha).
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
    pictures : list of MaskedPicture
        The radiances to explain.
    outline : Outline
    direction : (3,) unit vector towards the light
    body : 'unpolarised' or 'polarised'
    eta : float
        Index of the body's interface.
    weights : ResidualWeights
    alpha : float, optional
        Roughness, where it is given.
    """

    def __init__(
        self,
        pictures: list[MaskedPicture],
        outline: Outline,
        direction: Float64Array,
        body: BodyKind,
        eta: float,
        weights: ResidualWeights,
        alpha: float | None = None,
    ) -> None:
        self.pictures, self.outline = pictures, outline
        self.direction, self.body, self.eta = direction, body, eta
        rim_weight = np.where(outline.at_ring, RIM, 1.0)
        self.smooth = np.sqrt(weights.smoothness) * rim_weight[outline.whole]
        self.integrable = np.sqrt(weights.integrability) * rim_weight
        self.plausible = np.sqrt(np.array([weights.level, weights.alpha]) * outline.count)
        self.usual = np.array([weights.usual_level, weights.usual_alpha])
        self.alpha = alpha
        self.pattern = JacobianPattern(outline, len(pictures))

    def solve(
        self, start: ShapeEstimate, max_steps: int, tolerance: float
    ) -> tuple[ShapeEstimate, OptimizeResult]:
        """Minimise the sum of squares by scipy's trust-region method for sparse problems.

        Raises
        ------
        Inapplicable
            Where the search meets numbers that are not finite.
        """
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                minimum = least_squares(
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
        except (ValueError, np.linalg.LinAlgError) as error:  # what scipy says of NaN and infinity
            raise Inapplicable(f"no shape explains the picture: {first_line(error)}") from None
        f, g, albedo, level, alpha = self._unpacked(minimum.x)
        normals = normals_of(*to_rim(f, g))
        return replace(start, normals=normals, albedo=albedo, level=level, alpha=alpha), minimum

    def residuals(self, x: Float64Array) -> Float64Array:
        """Residuals of irradiance, smoothness, integrability and plausibility in one array."""
        f, g, albedo, level, alpha = self._unpacked(x)
        diffuse, specular = self._shadings(f, g, alpha)
        parts = []
        for picture in self.pictures:
            model = picture.diffuse * albedo * diffuse + picture.specular * level * specular
            parts.append((model - picture.radiance) * self._scale(picture))
        components = self._with_ring(normals_of(f, g).T[:2])
        bending = (self.outline.laplacian @ components.T).T * self.smooth
        plausibility = self.plausible * np.log([level, alpha] / self.usual)
        integrability = self.integrable * self._curl(components)
        return np.concatenate([*parts, *bending, integrability, plausibility])

    def jacobian(self, x: Float64Array) -> sparse.csr_array:
        """Derivatives of the residuals; only the columns of the surface parameters are dense."""
        f, g, albedo, level, alpha = self._unpacked(x)
        diffuse, specular = self._shadings(f, g, alpha)
        by_f = self._differences(f + _STEP, g, f - _STEP, g, alpha, alpha)
        by_g = self._differences(f, g + _STEP, f, g - _STEP, alpha, alpha)
        up, down = alpha * np.exp(_STEP), alpha * np.exp(-_STEP)
        by_alpha = self._differences(f, g, f, g, up, down)[1]
        parts = []
        for picture in self.pictures:
            scale = self._scale(picture)
            a, k = scale * albedo * picture.diffuse, scale * level * picture.specular
            by_alpha_if_free = k * by_alpha * (self.alpha is None)
            parts += [a * by[0] + k * by[1] for by in (by_f, by_g)]
            parts += [a * diffuse, k * specular, by_alpha_if_free]
        plausibility = self.plausible * [1.0, float(self.alpha is None)]
        return self.pattern.filled([*parts, *self._geometry_slopes(f, g), plausibility])

    def error(self, estimate: ShapeEstimate) -> float:
        """Root mean square residual of the irradiance, over the largest value of each picture."""
        f, g, albedo, level, alpha = self._unpacked(self._packed(estimate))
        diffuse, specular = self._shadings(f, g, alpha)
        square = 0.0
        for picture in self.pictures:
            model = picture.diffuse * albedo * diffuse + picture.specular * level * specular
            residual = (model - picture.radiance) * self._scale(picture)
            square += float(np.mean(np.square(residual)))
        return float(np.sqrt(square))

    def _scale(self, picture: MaskedPicture) -> float:
        """Weight of a picture's residuals: one over its largest value and √(number of pictures).

        Two separated pictures thus weigh no more than a whole one.
        """
        largest = max(float(part.radiance.max()) for part in self.pictures)
        peak = max(float(picture.radiance.max()), _DARK * largest, np.finfo(np.float32).tiny)
        return 1.0 / (peak * np.sqrt(len(self.pictures)))

    def _shadings(
        self, f: Float64Array, g: Float64Array, alpha: float
    ) -> tuple[Float64Array, Float64Array]:
        """Diffuse and specular shading (mask pixels,)."""
        normals = normals_of(*to_rim(f, g))
        return (
            diffuse_shading(normals, self.direction, self.body, self.eta),
            specular_shading(normals, self.direction, alpha),
        )

    def _differences(
        self,
        f1: Float64Array,
        g1: Float64Array,
        f0: Float64Array,
        g0: Float64Array,
        alpha1: float,
        alpha0: float,
    ) -> tuple[Float64Array, Float64Array]:
        """Central differences of both shadings between two points 2 `_STEP` apart."""
        after, before = self._shadings(f1, g1, alpha1), self._shadings(f0, g0, alpha0)
        return (after[0] - before[0]) / (2 * _STEP), (after[1] - before[1]) / (2 * _STEP)

    def _geometry_slopes(self, f: Float64Array, g: Float64Array) -> list[Float64Array]:
        """Derivatives of smoothness and integrability by f and g, in the order of the pattern."""
        bending, curl = self.pattern.bending, self.pattern.curl
        n_x, n_y = plane_slopes(f, g)
        smooth = self.smooth[bending.rows] * bending.values
        by_x, by_y = self._curl_slopes(self._with_ring(normals_of(f, g).T[:2]))
        parts = [smooth * slope[bending.columns] for slope in (*n_x, *n_y)]
        pixels = curl.columns
        return parts + [by_x * x[pixels] + by_y * y[pixels] for x, y in zip(n_x, n_y, strict=True)]

    def _with_ring(self, components: Float64Array) -> Float64Array:
        """Components x, y (2, mask + ring pixels) of the normals, those of the ring appended."""
        return np.concatenate([components, self.outline.across.T], axis=1)

    def _derivatives(
        self, components: Float64Array
    ) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
        """∂_x n_x, ∂_y n_x, ∂_x n_y, ∂_y n_y at the mask's pixels."""
        (n_x, n_y), dx, dy = components, self.outline.dx, self.outline.dy
        return dx @ n_x, dy @ n_x, dx @ n_y, dy @ n_y

    def _curl(self, components: Float64Array) -> Float64Array:
        """Integrability n_z³ (∂_y p − ∂_x q) at the mask's pixels; 0 for normals of a surface."""
        xx, xy, yx, yy = self._derivatives(components)
        n_x, n_y = components[:, : self.outline.count]
        return np.asarray((1 - n_y**2) * xy - (1 - n_x**2) * yx + n_x * n_y * (yy - xx))

    def _curl_slopes(self, components: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Derivatives of integrability by n_x and n_y, at the entries of the pattern's `curl`."""
        xx, xy, yx, yy = self._derivatives(components)
        n_x, n_y = components[:, : self.outline.count]
        both, curl = n_x * n_y, self.pattern.curl
        by_x = [-both, 1 - n_y**2, 2 * n_x * yx + n_y * (yy - xx)]
        by_y = [n_x**2 - 1, both, n_x * (yy - xx) - 2 * n_y * xy]
        weights = [np.concatenate([part * self.integrable for part in by]) for by in (by_x, by_y)]
        return weights[0][curl.rows] * curl.values, weights[1][curl.rows] * curl.values

    def _packed(self, estimate: ShapeEstimate) -> Float64Array:
        """An estimate as the vector of unknowns: f, g, ln albedo, ln level, ln alpha."""
        n_z = np.clip(estimate.normals[:, 2], 0.0, None)
        plane = estimate.normals[:, :2] / (1.0 + n_z)[:, None]
        surface = np.log(np.maximum([estimate.albedo, estimate.level, estimate.alpha], 1e-9))
        return np.concatenate([plane[:, 0], plane[:, 1], surface])

    def _unpacked(self, x: Float64Array) -> tuple[Float64Array, Float64Array, float, float, float]:
        """f, g (mask pixels,), albedo, level and alpha from the vector of unknowns."""
        f, g = x[:-3].reshape(2, -1)
        albedo, level, alpha = np.exp(np.clip(x[-3:], -25.0, 25.0))
        return f, g, float(albedo), float(level), float(np.clip(alpha, *ALPHA_RANGE))
