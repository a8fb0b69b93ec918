"""The whole chain from one picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from malus.bench.scoring.judge import Judge
from malus.bench.scoring.observe import observe
from malus.reconstruct import Components, Inapplicable, Method, Observation, get_method
from malus.reconstruct.fresnel import smooth_dolp
from malus.reconstruct.single_image import shape
from malus.reconstruct.single_image.blind import BLIND_METHODS, blind, run_chain
from malus.renderers import render
from malus.renderers.truth import Truth
from malus.scenes import Camera, Dielectric, Distant, Sampling, Scene, Sky, Sphere, Uniform

METHODS = {entry[0]: Method(*entry) for entry in BLIND_METHODS}
COLOUR = np.array([0.3, 0.6, 1.0])[:, None]


def sphere(coloured: bool = False, incidence_deg: float = 60, side: int = 32) -> Truth:
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.25, body="unpolarised"),
        light=Distant(incidence_deg=incidence_deg),
        camera=Camera(resolution=side),
        wavelengths_nm=(450, 550, 650),
    )
    truth = render(scene, renderer="torrance-sparrow")
    return replace(truth, diffuse=truth.diffuse * COLOUR) if coloured else truth


@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize(
    ("name", "least"), [("blind", 0.8), ("blind-light", 0.9), ("blind-normals", 0.99)]
)
def test_more_knowledge_more_skill(name: str, least: float, coloured: bool) -> None:
    score = Judge(sphere(coloured)).score(METHODS[name])
    assert score.skill > least
    assert score.violations == 0


def test_index_and_roughness_are_those_of_the_surface() -> None:
    """Not those that are assumed where nothing tells them: 1.5, of which all other scenes are."""
    surface = Dielectric(eta=1.8, alpha=0.15, body="unpolarised")
    scene = sphere().scene.model_copy(update={"surface": surface})
    truth = render(scene, renderer="torrance-sparrow")
    told = Observation(truth.image, truth.mask, normals=truth.normals, light=scene.light)
    found = run_chain(told).observation
    # The search ends within 1e-4 of ln alpha.
    np.testing.assert_allclose(found.eta, 1.8, rtol=1e-4)
    assert found.alpha == pytest.approx(0.15, rel=1e-4)


@pytest.mark.parametrize("form", ["bands", "complex", "map beside a metal"])
def test_a_given_index_is_that_of_its_band(form: str) -> None:
    """Facets that mirror the light polarise as Fresnel says, at the index of the band."""
    surface = Dielectric(material="carbon_disulfide", alpha=0.25, body="unpolarised")
    scene = sphere().scene.model_copy(update={"surface": surface})
    truth = render(scene, renderer="torrance-sparrow")
    eta = scene.eta if form == "bands" else scene.eta.astype(complex)
    if form == "map beside a metal":
        eta = np.where(truth.mask[..., None], eta, 0.2 + 3j)
    told = replace(observe(truth, frozenset({"light", "normals", "specular", "diffuse"})), eta=eta)
    chain = run_chain(told)
    cosine = np.cos(np.radians(30))  # between half vector and viewer, of a light at 60°
    degree = np.hypot(chain.components.s1, chain.components.s2)[truth.mask]
    expected = smooth_dolp(cosine, scene.eta) * chain.observation.specular[truth.mask]
    # Single precision rounds light whose largest values are near 0.1.
    np.testing.assert_allclose(degree, expected, atol=1e-6)


def test_the_way_is_told() -> None:
    truth = sphere()
    chain = run_chain(observe(truth, frozenset()))
    told = " ".join(chain.statements)
    for stage in (
        "grey image where colour is needed",
        "estimated",
        "starts ended there",
        "eta is assumed",
    ):
        assert stage in told
    assert (
        run_chain(observe(sphere(coloured=True), frozenset()))
        .statements[0]
        .startswith("separated by colour")
    )


@pytest.mark.parametrize(("steps", "converged"), [(30, 1.0), (2, 0.0)])
def test_a_score_says_whether_the_search_converged(
    steps: int, converged: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shape, "_STEPS", steps)
    values = Judge(sphere(side=24)).score(METHODS["blind-light"]).values()
    assert [v.value for v in values if v.metric == "converged"] == [converged]


def test_where_nothing_is_searched_nothing_is_said_of_convergence() -> None:
    score = Judge(sphere(side=24)).score(METHODS["blind-normals"])
    assert not [v for v in score.values() if v.metric == "converged"]


@pytest.mark.parametrize("body", ["unpolarised", "polarised"])
def test_the_kind_of_body_is_read_off_its_shading(body: str) -> None:
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.25, body=body),
        light=Distant(incidence_deg=60),
        camera=Camera(resolution=32),
    )
    truth = render(scene, Sampling(samples=32))
    for needs in (frozenset({"light"}), frozenset({"light", "normals"})):
        assert run_chain(observe(truth, needs)).body == body
    assert Judge(truth).score(METHODS["blind-light"]).skill > 0.8


def test_a_turned_picture_turns_the_answer() -> None:
    truth = sphere()
    observation = observe(truth, frozenset({"light", "normals"}))
    light = observation.light
    x, y, z = np.moveaxis(np.rot90(observation.normals), -1, 0)
    turned = Observation(
        np.rot90(observation.image),
        np.rot90(observation.mask),
        normals=np.stack([-y, x, z], axis=-1),
        light=light.model_copy(update={"azimuth_deg": light.azimuth_deg + 90}),
    )
    plain, after = blind(observation), blind(turned)
    # A quarter turn changes the sign of s1 and s2.
    np.testing.assert_allclose(after.s1, -np.rot90(plain.s1), atol=1e-4)
    np.testing.assert_allclose(after.s2, -np.rot90(plain.s2), atol=1e-4)


def test_exposure_scales_the_answer_where_the_light_is_not_given() -> None:
    truth = sphere()
    observation = observe(truth, frozenset())
    bright = blind(replace(observation, image=64.0 * observation.image))
    np.testing.assert_allclose(bright.s1, 64.0 * blind(observation).s1, rtol=1e-3, atol=1e-3)


def tell(observation: Observation, name: str) -> Components:
    return get_method(name).reconstruct(observation)


@pytest.mark.parametrize("name", ["blind", "paper"])
@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_the_unit_of_a_picture_changes_nothing(name: str, scale: float) -> None:
    plain = observe(sphere(side=24), frozenset())
    usual = tell(plain, name)
    image = scale * plain.image.astype(np.float64)
    scaled = tell(replace(plain, image=image), name)
    # A search from another start ends within its tolerance: measured 2e-5 of the largest value.
    atol = 5e-4 * float(np.abs(usual.s1).max())
    np.testing.assert_allclose(scaled.s1 / scale, usual.s1, atol=atol)
    np.testing.assert_allclose(scaled.s2 / scale, usual.s2, atol=atol)


@pytest.mark.parametrize("name", ["blind", "blind-light", "blind-normals", "paper"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_pixel_that_is_not_finite_costs_itself(name: str, value: float) -> None:
    truth = sphere(side=24)
    observation = observe(truth, get_method(name).needs)
    usual = tell(observation, name)
    image = observation.image.copy()
    image[12, 12, 0] = image[0, 0] = value
    spoilt = tell(replace(observation, image=image), name)
    bad = ~np.isfinite(image).all(axis=-1)
    np.testing.assert_array_equal(spoilt.valid, usual.valid & ~bad)
    for values in (spoilt.image, spoilt.s1, spoilt.s2):
        assert not values[bad].any()
    # In the search one of some 400 pixels has its neighbour's value: measured 0.034 beside it.
    scale = float(np.abs(usual.s1).max())
    for after, before in ((spoilt.s1, usual.s1), (spoilt.s2, usual.s2)):
        np.testing.assert_allclose(after[~bad], before[~bad], atol=0.06 * scale)
    nothing = replace(observation, image=np.full_like(image, value))
    with pytest.raises(Inapplicable, match=r"no pixel (of the object )?is finite"):
        tell(nothing, name)


def test_codes_of_a_picture_are_taken_as_numbers() -> None:
    observation = observe(sphere(side=24), frozenset())
    codes = np.rint(2e4 * observation.image).astype(np.uint16)
    as_codes = blind(replace(observation, image=codes))
    as_floats = blind(replace(observation, image=codes.astype(np.float32)))
    np.testing.assert_array_equal(as_codes.s1, as_floats.s1)


def test_nothing_off_the_object_is_polarised() -> None:
    truth = sphere()
    observation = observe(truth, frozenset({"light"}))
    wall = replace(observation, image=np.where(observation.mask[..., None], observation.image, 0.3))
    components = blind(wall)
    assert not components.s1[~observation.mask].any()
    np.testing.assert_array_equal(components.image, wall.image)


def test_other_lights_metals_and_dark_pictures_say_so() -> None:
    truth = sphere()
    observation = observe(truth, frozenset())
    with pytest.raises(Inapplicable, match="distant light"):
        blind(replace(observation, light=Uniform()))
    with pytest.raises(Inapplicable, match="dark"):
        blind(replace(observation, image=0 * observation.image))
    with pytest.raises(Inapplicable, match="dielectric"):  # its real part alone is no index
        blind(replace(observation, eta=np.full(3, 0.4 + 2.4j)))


def test_where_it_says_that_it_is_less_sure_it_errs_more() -> None:
    """Renders that its constants were not chosen by: a lamp that it can explain, and a sky."""
    stated, erred = [], []
    for light in (Distant(incidence_deg=50, azimuth_deg=120), Sky(sun_elevation_deg=55)):
        scene = Scene(
            shape=Sphere(),
            surface=Dielectric(eta=1.5, alpha=0.25, body="polarised", albedo="blue"),
            light=light,
            camera=Camera(resolution=24),
            wavelengths_nm=(450.0, 550.0, 650.0),
        )
        truth = render(scene)
        estimate = blind(observe(truth, frozenset()))
        assert (estimate.deviation[truth.mask] > 0).all()
        assert not estimate.deviation[~truth.mask].any()
        lit = truth.mask[..., None] & (truth.image > 0.01 * truth.image[truth.mask].max())
        field = np.stack([estimate.s1, estimate.s2], axis=-1)
        error = (field - truth.stokes[..., 1:])[lit] / truth.image[lit][:, None]
        erred.append(float(np.sqrt(np.mean(np.square(error)))))
        stated.append(float(np.sqrt(np.mean(np.square(estimate.deviation[lit])))))
    assert erred[1] > 2 * erred[0]
    assert stated[1] > 2 * stated[0]
