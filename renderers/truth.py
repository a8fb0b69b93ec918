"""The truth of a scene: the image of a perfect polarisation camera, with both lobes apart."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from malus.scenes import polarisation
from malus.scenes.core.arrays import AnyArray, BoolArray, FloatArray, NumberArray
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.maps import MapName
from malus.scenes.scene import Scene
from malus.scenes.sensor_frame import SensorFrame


@dataclass(frozen=True)
class Truth:
    """Stokes images of one scene, for the specular and the diffuse lobe, and their noise.

    Attributes
    ----------
    scene : Scene
        What was rendered.
    specular, diffuse : (height, width, bands, 3)
        Linear Stokes images of the light reflected at the surface and of the light that left the
        body, in W m⁻² sr⁻¹ nm⁻¹ under lights of the scene's radiance. Their sum is the image.
        Unless `scene.lobes_known`, `specular` holds all of the light.
    normals : (height, width, 3)
        Mean unit shading normals in the image frame; zero off the object.
    mask : (height, width) bool
        Pixels that the object covers entirely.
    standard_error : (height, width, bands, 3)
        Standard error of the sum of both lobes; among several objects, and where few samples of
        a pixel are lit, the variances of neighbouring pixels enter too
        (`malus.renderers.mitsuba.pooled`).
    specular_noise, diffuse_noise : (height, width, bands, 3)
        Half the difference of two independent half renders: one draw of the error of `specular`
        and `diffuse`. Passed through a method, it gives the noise of the method's score.
    interpolation_error : dict
        Error of interpolating the family in η, over the image's peak: 'rms' and 'worst' of a
        held-out render.
    samples : int or None
        Samples a pixel, where the target of the sampling decided the number.
    eta_map : (height, width, bands) or None
        Relative refractive index where it varies over the image, complex if any is. None where it
        is that of the scene's surface everywhere. `eta` returns the one that applies.
    alpha_map : (height, width) or None
        Roughness where it varies over the image, likewise; `alpha` returns it.
    normal_spread : (height, width) or None
        How far the normals within a pixel differ, degrees: the angle whose cosine is the length of
        the mean of all unit normals in it. None where nobody measured it.
    maps : dict of (height, width, ...) by name
        Further maps that a dataset stores, see `malus.scenes.maps`; a dataset reads them apart.
    frame : SensorFrame or None
        What a polarisation camera makes of the Stokes image, likewise.
    s3, s3_noise, s3_standard_error : (height, width, bands) or None
        Fourth Stokes component of the image, all of it in the specular lobe, one draw of its error,
        and its standard error. None where it is zero by the laws of reflection
        (`malus.scenes.scene.may_be_circular`).

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> surface = Dielectric(eta=1.5, alpha=0.3, body="unpolarised")
    >>> scene = Scene(shape=Sphere(), surface=surface, light=Distant(incidence_deg=60),
    ...               camera=Camera(resolution=8))
    >>> render(scene, renderer="torrance-sparrow").polarised(angle_deg=30).shape
    (8, 8, 1)
    """

    __repr__ = brief_repr

    scene: Scene
    specular: FloatArray
    diffuse: FloatArray
    normals: FloatArray
    mask: BoolArray
    standard_error: FloatArray
    specular_noise: FloatArray
    diffuse_noise: FloatArray
    interpolation_error: dict[str, float] = field(default_factory=dict)
    samples: int | None = None
    eta_map: NumberArray | None = None
    alpha_map: FloatArray | None = None
    normal_spread: FloatArray | None = None
    maps: Mapping[MapName, AnyArray] = field(default_factory=dict)
    frame: SensorFrame | None = None
    s3: FloatArray | None = None
    s3_noise: FloatArray | None = None
    s3_standard_error: FloatArray | None = None

    @property
    def eta(self) -> NumberArray:
        """Relative refractive index, (bands,) or (height, width, bands); complex for metals.

        NaN where it is unknown.
        """
        return self.scene.eta if self.eta_map is None else self.eta_map

    @property
    def alpha(self) -> float | FloatArray:
        """Roughness, one number or (height, width); NaN where it is unknown.

        Of anisotropic facets the geometric mean of both.
        """
        alpha = self.scene.surface.isotropic_alpha if self.alpha_map is None else self.alpha_map
        return math.nan if alpha is None else alpha

    @property
    def stokes(self) -> FloatArray:
        """Stokes image (height, width, bands, 3) of both lobes together."""
        return self.specular + self.diffuse

    @property
    def image(self) -> FloatArray:
        """Unpolarised image (height, width, bands), as an ordinary camera takes it."""
        return self.specular[..., 0] + self.diffuse[..., 0]

    @property
    def dolp(self) -> FloatArray:
        """Degree of linear polarisation (height, width, bands), 0 to 1; 0 where there is no light.

        Noise raises it where little is polarised: see `standard_error`.
        """
        return polarisation.dolp(self.stokes)

    @property
    def aolp(self) -> FloatArray:
        """Angle of linear polarisation (height, width, bands): radians in [0, π), from +x."""
        return polarisation.aolp(self.stokes)

    @property
    def view_direction(self) -> FloatArray | None:
        """Unit vectors (height, width, 3) towards the camera in the image frame.

        None for an orthographic camera: (0, 0, 1) everywhere.
        """
        directions = self.scene.camera.view_directions()
        return None if directions is None else directions.astype(self.normals.dtype)

    def polarised(self, angle_deg: float) -> FloatArray:
        """Image (height, width, bands) through a polariser at an angle from the vertical."""
        return polarisation.polarised(self.stokes, angle_deg)

    def halves(self) -> tuple[Truth, Truth]:
        """Two truths from independent halves of the samples; their mean is this one."""
        return self._shifted(1.0), self._shifted(-1.0)

    def _shifted(self, sign: float) -> Truth:
        """The truth of the first (sign 1) or the second (sign -1) half of the samples."""
        # An independent half has twice the variance of the mean of two.
        shifted = replace(
            self,
            specular=self.specular + sign * self.specular_noise,
            diffuse=self.diffuse + sign * self.diffuse_noise,
            standard_error=self.standard_error * np.sqrt(2.0, dtype=self.standard_error.dtype),
            specular_noise=np.zeros_like(self.specular_noise),
            diffuse_noise=np.zeros_like(self.diffuse_noise),
        )
        if self.s3 is None or self.s3_noise is None or self.s3_standard_error is None:
            return shifted
        return replace(
            shifted,
            s3=self.s3 + sign * self.s3_noise,
            s3_noise=np.zeros_like(self.s3_noise),
            s3_standard_error=self.s3_standard_error
            * np.sqrt(2.0, dtype=self.s3_standard_error.dtype),
        )
