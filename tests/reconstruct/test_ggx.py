"""Methods that are told of GGX facets: the integrals, Smith's law, and skill on rendered truths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from malus.bench import score
from malus.bench.scoring.knowledge_ladder import RUNGS
from malus.bench.scoring.observe import observe
from malus.bench.studies.reference import reference_dolp
from malus.reconstruct import Method, Observation, get_method, specular_dolp
from malus.reconstruct.facets.facet_kernels import shadowing_ggx
from malus.reconstruct.known_light_kernels import facet_weight
from malus.reconstruct.observation import INPUTS
from malus.renderers import Truth, render
from malus.scenes import (
    Area,
    Camera,
    Conductor,
    Dielectric,
    Distant,
    Light,
    Patterned,
    Sampling,
    Scene,
    Sphere,
    Stripes,
    Uniform,
)

LAMP = Area(incidence_deg=60, azimuth_deg=30, half_angle_deg=20)


def truth_of(
    surface: Dielectric | Conductor | Patterned,
    light: Light,
    camera: Camera | None = None,
    samples: int = 512,
) -> Truth:
    camera = camera or Camera(resolution=24)
    scene = Scene(shape=Sphere(), surface=surface, light=light, camera=camera)
    return render(scene, Sampling(samples=samples))


def untold(name: str) -> Method:
    """The method without the distribution among its inputs."""
    method = get_method(name)
    return replace(method, needs=method.needs - {"distribution"})


@pytest.mark.parametrize("zenith", [1e-3, 0.6, 1.3, 1.56, np.pi / 2])
@pytest.mark.parametrize("alpha", [0.01, 0.2, 1.0])
@pytest.mark.parametrize("eta", [1.001, 1.5, 0.2 + 3.4j, 0.7])
def test_the_integral_is_that_of_the_reference(zenith: float, alpha: float, eta: complex) -> None:
    """Other nodes, other variables, another Fresnel and another form of G1."""
    reference = reference_dolp(zenith, eta, alpha**-2, "shadowed_ggx")
    found = float(specular_dolp(zenith, eta, alpha**-2, "shadowed_ggx"))
    assert abs(found - reference.value) < 1e-8 + reference.error  # the promised tolerance


@pytest.mark.parametrize("alpha", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("view_deg", [0.0, 40.0, 75.0])
def test_what_facets_are_seen_adds_up_to_the_surface(alpha: float, view_deg: float) -> None:
    """Smith's G1 belongs to its distribution: G1(V) ∫ D (V·M)₊ dM = V·N.

    Source: Heitz, "Understanding the masking-shadowing function", JCGT 3(2), 2014, Equation 14.
    """
    x, w = np.polynomial.legendre.leggauss(400)
    # Slopes r = α tan t, so that the tail that falls like a power is resolved.
    t, weight = 0.25 * np.pi * (1 + x), 0.25 * np.pi * w
    slope = alpha * np.tan(t)
    cosine = 1 / np.hypot(1, slope)
    azimuth = (np.arange(400) + 0.5) * (2 * np.pi / 400)
    view = np.radians(view_deg)
    density = [facet_weight(c, 1.0, 1 / alpha, True) / (np.pi * alpha**2) for c in cosine]
    seen = np.cos(view) + slope[:, None] * np.sin(view) * np.cos(azimuth)
    ring = np.maximum(seen, 0).mean(axis=1) * 2 * np.pi * cosine
    solid_angle = slope * cosine**3 * alpha / np.cos(t) ** 2  # dω = r cos³θ dr dφ
    area = float(np.sum(weight * np.array(density) * ring * solid_angle))
    # Beyond the last node lies a share of about 1e-5 of facets that stand on end.
    assert shadowing_ggx(np.cos(view), 1 / alpha) * area == pytest.approx(np.cos(view), rel=1e-4)


@pytest.mark.parametrize("alpha", [0.2, 0.3])
def test_told_of_ggx_the_model_is_the_renderers(alpha: float) -> None:
    """Oracle inputs under uniform light: what is left is noise. Untold it is far off."""
    # Small pixels: at α = 0.3 the specular and the diffuse polarisation nearly cancel, and what the
    # curvature within a pixel changes counts.
    camera, surface = Camera(resolution=64), Dielectric(eta=1.5, alpha=alpha, distribution="ggx")
    truth = truth_of(surface, Uniform(), camera, samples=1024)
    assert score(truth, "shadowed+body").skill > 0.99
    assert score(truth, "lights+body").skill > 0.99
    assert score(truth, untold("shadowed+body")).skill < 0.93


@pytest.mark.parametrize(
    "surface",
    [
        Dielectric(eta=1.5, alpha=0.3, distribution="ggx"),
        Conductor(eta=0.2, k=3.0, alpha=0.3, distribution="ggx"),
    ],
    ids=lambda surface: surface.kind,
)
def test_told_of_ggx_known_lights_are_exact(surface: Dielectric | Conductor) -> None:
    truth = truth_of(surface, LAMP)
    told, not_told = score(truth, "lights+body").skill, score(truth, untold("lights+body")).skill
    assert told > 0.999
    assert not_told < told - 5e-4


def test_each_pixel_with_a_view_of_its_own_has_the_same_facets() -> None:
    """The loop over pixels, which a perspective camera needs, knows GGX as the product does."""
    surface = Dielectric(eta=1.5, alpha=0.3, distribution="ggx")
    near = truth_of(
        surface, LAMP, Camera(resolution=24, projection="perspective", fov_deg=40, distance=3.5)
    )
    assert score(near, "lights+body").skill > 0.999
    assert score(near, untold("lights+body")).skill < 0.9995
    far = observe(truth_of(surface, LAMP), get_method("lights").needs)
    height, width, _ = far.image.shape
    straight = np.broadcast_to(np.array([0.0, 0.0, 1.0]), (height, width, 3))
    shared, by_pixel = (
        get_method("lights").reconstruct(observation)
        for observation in (far, replace(far, view_direction=straight))
    )
    # float32 sums over 900 directions in another order.
    np.testing.assert_allclose(by_pixel.s1, shared.s1, atol=1e-5 * float(far.image.max()))


def test_maps_of_roughness_are_told_the_distribution_too() -> None:
    parts = tuple(Dielectric(eta=1.5, alpha=alpha, distribution="ggx") for alpha in (0.15, 0.3))
    truth = truth_of(Patterned(pattern=Stripes(width=0.5), surfaces=parts), Uniform())
    assert score(truth, "shadowed+body").skill > 0.98  # pixels at the stripes' edges are mixed
    assert score(truth, untold("shadowed+body")).skill < 0.9


def test_several_distributions_are_none() -> None:
    parts = (Dielectric(eta=1.5, alpha=0.2), Dielectric(eta=1.5, alpha=0.2, distribution="ggx"))
    mixed = Patterned(pattern=Stripes(), surfaces=parts)
    scene = Scene(shape=Sphere(), surface=mixed, light=Distant(incidence_deg=60))
    assert scene.distribution is None
    ggx = scene.model_copy(update={"surface": parts[1]})
    assert (ggx.distribution, parts[0].distribution) == ("ggx", "beckmann")


def test_the_ladder_hides_the_distribution_with_the_roughness() -> None:
    assert "distribution" in INPUTS
    assert {"alpha", "distribution"} <= RUNGS["index and roughness estimated"]
    needing = {name for name in ("eq8", "visible", "shadowed", "smooth", "half_vector", "lights")
               if "distribution" in get_method(name).needs}  # fmt: skip
    assert needing == {"shadowed", "lights"}


def test_another_distribution_is_refused() -> None:
    with pytest.raises(ValueError, match="distribution: expected beckmann or ggx, found 'phong'"):
        Observation(np.ones((1, 1, 1)), np.ones((1, 1), bool), distribution="phong")  # type: ignore[arg-type]
