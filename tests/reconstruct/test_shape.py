"""Shape and parameters from one picture: derivatives, known shapes, and failures said out loud."""

from __future__ import annotations

import math

import numpy as np
import pytest
from reference.fresnel import reflectances as reference_reflectances
from scipy.optimize import nnls

from malus.reconstruct.observation import Inapplicable
from malus.reconstruct.single_image import shape
from malus.reconstruct.single_image.convergence import Convergence
from malus.reconstruct.single_image.light_direction import estimate_direction
from malus.reconstruct.single_image.outline import outline_of
from malus.reconstruct.single_image.parameters import _weights, fit_parameters
from malus.reconstruct.single_image.shading import (
    BodyKind,
    diffuse_shading,
    facet_reflectance,
    index_of,
    specular_shading,
)
from malus.reconstruct.single_image.shape import GivenParameters, recover_shape
from malus.reconstruct.single_image.shape_solver import (
    MaskedPicture,
    ResidualWeights,
    ShapeEstimate,
    ShapeProblem,
)
from malus.renderers import render
from malus.renderers.truth import Truth
from malus.scenes import Blob, Camera, Dielectric, Distant, Sampling, Scene, Sphere


def sphere(
    alpha: float = 0.25, eta: float = 1.5, incidence_deg: float = 45, side: int = 36
) -> Truth:
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=eta, alpha=alpha, body="unpolarised"),
        light=Distant(incidence_deg=incidence_deg),
        camera=Camera(resolution=side),
    )
    return render(scene, renderer="torrance-sparrow")


def mean_angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip((a * b).sum(axis=-1), -1, 1))).mean())


def light_of(truth: Truth) -> np.ndarray:
    return np.array(truth.scene.light.direction)


def problem(
    truth: Truth, separated: bool = False, cut: int = 0
) -> tuple[ShapeProblem, ShapeEstimate]:
    """The object's left `cut` columns may lie beyond the picture's edge."""
    mask = truth.mask[:, cut:]
    radiance = truth.image[:, cut:][mask][:, 0]
    pictures = [MaskedPicture(radiance)]
    if separated:
        pictures = [
            MaskedPicture(0.7 * radiance, specular=False),
            MaskedPicture(0.3 * radiance, diffuse=False),
        ]
    weights = ResidualWeights(1e-3, 0.1, 1e-4, 0.1)
    solver = ShapeProblem(pictures, outline_of(mask), light_of(truth), "polarised", 1.5, weights)
    return solver, ShapeEstimate(truth.normals[:, cut:][mask], 0.9, 0.2, 0.3)


@pytest.mark.parametrize("separated", [False, True])
@pytest.mark.parametrize("cut", [0, 6])
def test_jacobian_is_the_derivative_of_the_residuals(separated: bool, cut: int) -> None:
    solver, estimate = problem(sphere(side=20), separated, cut)
    x = solver._packed(estimate)
    x[:-3] *= 0.9
    direction = np.random.default_rng(0).normal(size=x.size)
    step = 1e-6
    numeric = (solver.residuals(x + step * direction) - solver.residuals(x - step * direction)) / (
        2 * step
    )
    # Both use central differences of the shading with second-order errors of 1e-10 relative.
    np.testing.assert_allclose(solver.jacobian(x) @ direction, numeric, atol=1e-6)


def test_a_true_sphere_has_no_bending_and_no_curl() -> None:
    truth = sphere(side=40)
    outline = outline_of(truth.mask)
    y, x = np.mgrid[19.5:-20:-1, -19.5:20] / outline.size
    # Extended to the ring, where the true field is known too: differences are then exact.
    field = np.stack([np.concatenate([v[outline.mask], v[outline.ring]]) for v in (x, y)])
    assert np.abs(outline.laplacian @ field.T).max() < 1e-9
    solver, _ = problem(truth)
    assert np.abs(solver._curl(field)).max() < 1e-9


def test_a_true_blob_bends_as_much_beside_the_outline_as_inside() -> None:
    scene = Scene(
        shape=Blob(),
        surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
        light=Distant(incidence_deg=45),
        camera=Camera(resolution=48),
    )
    truth = render(scene, Sampling(samples=16))
    solver, _ = problem(truth)
    field = np.concatenate([truth.normals[truth.mask][:, :2], solver.outline.across])
    bending = np.linalg.norm(solver.outline.laplacian @ field, axis=1) * solver.smooth
    beside = solver.outline.at_ring[solver.outline.whole]
    ratio = float(np.median(bending[beside]) / np.median(bending[~beside]))
    # Unweighted it is 3.8 here, and 8 on a picture reduced by two: smoothness would rule the rim.
    assert 1 / 4 < ratio < 3


def test_a_twisted_field_has_curl() -> None:
    outline = outline_of(sphere(side=40).mask)
    y, x = np.mgrid[19.5:-20:-1, -19.5:20] / outline.size
    swirl = np.stack([np.concatenate([v[outline.mask], v[outline.ring]]) for v in (-y, x)])
    solver, _ = problem(sphere(side=40))
    assert np.abs(solver._curl(0.5 * swirl)).min() > 0.1


def test_the_outline_of_a_disc_inflates_to_a_sphere() -> None:
    truth = sphere()
    components = outline_of(truth.mask).inflated()
    n_z = np.sqrt(np.clip(1 - (components**2).sum(axis=1), 0, None))
    # A ring a pixel wide in a radius of 23 shifts the rim by 2 %, 1° on average.
    assert mean_angle_deg(np.column_stack([components, n_z]), truth.normals[truth.mask]) < 2


@pytest.mark.parametrize("eta", [1.1, 1.33, 1.5, 2.0, 2.9])
@pytest.mark.parametrize("incidence_deg", [0.0, 45.0, 80.0])
def test_reflectance_is_fresnels_and_index_of_inverts_it(eta: float, incidence_deg: float) -> None:
    light = np.array(Distant(incidence_deg=incidence_deg).direction)
    perpendicular, parallel = reference_reflectances(math.radians(incidence_deg / 2), eta)
    reflectance = facet_reflectance(light, eta)
    assert reflectance == pytest.approx(0.5 * (perpendicular + parallel), rel=1e-9)
    assert index_of(light, reflectance) == pytest.approx(eta, rel=1e-8)


def test_specular_light_is_a_literal_microfacet_formula() -> None:
    alpha, light = 0.3, np.array([0.6, 0.0, 0.8])
    normal = np.array([0.28, 0.0, 0.96])
    half = np.array([0.6, 0.0, 1.8]) / math.hypot(0.6, 1.8)
    cosine = float(normal @ half)
    tangent2 = 1 / cosine**2 - 1
    facets = math.exp(-tangent2 / alpha**2) / (math.pi * alpha**2 * cosine**4)
    # Both directions are within 25° of the normal, where a rough surface of 0.3 masks nothing.
    expected = facets / (4 * 0.96)
    assert specular_shading(normal, light, alpha) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("body", ["unpolarised", "polarised"])
@pytest.mark.parametrize("alpha", [0.1, 0.3, 0.5])
def test_parameters_come_back_from_the_models_own_picture(body: str, alpha: float) -> None:
    truth = sphere()
    normals, light = truth.normals[truth.mask], light_of(truth)
    level = 3.0 * facet_reflectance(light, 1.6)
    pixels = 0.5 * diffuse_shading(normals, light, body, 1.6) + level * specular_shading(
        normals, light, alpha
    )
    fit = fit_parameters(pixels[:, None], normals, light, body, irradiance=3.0)
    assert fit.eta == pytest.approx(1.6, abs=0.01)
    assert fit.alpha == pytest.approx(alpha, rel=0.01)
    assert fit.error < 1e-3


def test_weights_are_never_negative() -> None:
    truth = sphere()
    normals, light = truth.normals[truth.mask], light_of(truth)
    dimple = 1.0 - 0.9 * specular_shading(normals, light, 0.3)[:, None]
    fit = fit_parameters(dimple, normals, light, "unpolarised", irradiance=1.0)
    assert fit.albedo.min() >= 0
    assert fit.level.min() >= 0


@pytest.mark.parametrize("apart", [1.0, 0.01])
@pytest.mark.parametrize("seed", range(20))
def test_weights_are_those_of_non_negative_least_squares(seed: int, apart: float) -> None:
    """Against Lawson and Hanson's algorithm, of either sign and of both; also of shadings that
    differ by a hundredth, as those of a rough surface that is lit from the viewer."""
    random = np.random.default_rng(seed)
    diffuse, specular = random.uniform(0, 1, (2, 30))
    specular = apart * specular + (1 - apart) * diffuse
    true = random.normal(size=(2, 4))
    noise = 0.1 * apart * random.normal(size=(30, 4))
    pixels = np.stack([diffuse, specular], axis=-1) @ true + noise
    weights, error = _weights(pixels, diffuse, specular)
    exact = [nnls(np.stack([diffuse, specular], axis=-1), band) for band in pixels.T]
    # Normal equations square the condition number, 1 over `apart`.
    np.testing.assert_allclose(weights.T, [found for found, _ in exact], atol=1e-12 / apart**3)
    left = np.array([norm for _, norm in exact])
    assert error == pytest.approx(np.sqrt(np.sum(left**2) / pixels.size), rel=1e-12)


def test_without_an_irradiance_eta_is_assumed_and_says_so() -> None:
    truth = sphere()
    fit = fit_parameters(
        truth.image[truth.mask], truth.normals[truth.mask], light_of(truth), "unpolarised"
    )
    assert not fit.eta_known
    assert any("eta is assumed" in note for note in fit.notes)
    brighter = fit_parameters(
        8.0 * truth.image[truth.mask], truth.normals[truth.mask], light_of(truth), "unpolarised"
    )
    assert brighter.error == pytest.approx(fit.error, rel=1e-6)  # over the largest value


def test_only_what_was_searched_runs_into_a_bound() -> None:
    theta = np.linspace(0, 1.4, 400)
    normals = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=-1)
    facing = np.array([0.0, 0.0, 1.0])
    # Smoother than any roughness that is searched, and darker than any index.
    specular = 1e-6 * specular_shading(normals, facing, 0.02)
    pixels = (diffuse_shading(normals, facing, "unpolarised") + specular)[:, None]
    fit = fit_parameters(pixels, normals, facing, "unpolarised", irradiance=1.0)
    assert [note.split(" ran")[0] for note in fit.notes] == ["eta", "alpha"]
    given = fit_parameters(
        pixels, normals, facing, "unpolarised", irradiance=1.0, eta=fit.eta, alpha=0.02
    )
    assert given.notes == ()


@pytest.mark.parametrize(("alpha", "incidence_deg"), [(0.15, 30), (0.3, 60)])
def test_a_sphere_its_index_and_roughness(alpha: float, incidence_deg: float) -> None:
    truth = sphere(alpha, 1.5, incidence_deg)
    light = truth.scene.light
    recovered = recover_shape(
        truth.image, truth.mask, light_of(truth), GivenParameters(light.irradiance)
    )
    assert recovered.convergence.converged
    # Measured 0.7°; the truth's masking is another than the model's, on purpose.
    assert mean_angle_deg(recovered.normals[truth.mask], truth.normals[truth.mask]) < 2.5
    assert recovered.parameters.eta == pytest.approx(1.5, abs=0.08)
    assert recovered.parameters.alpha == pytest.approx(alpha, rel=0.25)
    assert recovered.parameters.body == "unpolarised"


def test_a_search_cut_short_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = sphere(side=24)
    arguments = (
        truth.image,
        truth.mask,
        light_of(truth),
        GivenParameters(truth.scene.light.irradiance),
    )
    whole = recover_shape(*arguments).convergence
    assert whole.converged
    assert whole.residual < 0.008
    assert whole.starts == 2
    assert not any("did not converge" in warning for warning in whole.warnings)
    monkeypatch.setattr(shape, "_STEPS", 2)
    short = recover_shape(*arguments).convergence
    assert not short.at_minimum
    assert not short.converged
    assert "did not converge: the search for a shape ran out of steps" in short.warnings[0]


def test_a_picture_that_is_not_explained_is_no_convergence() -> None:
    convergence = Convergence(at_minimum=True, residual=0.02, agreed=2, starts=2)
    assert not convergence.converged
    assert "2.0% of the largest value unexplained" in convergence.warnings[0]


def test_starts_that_disagree_are_a_warning() -> None:
    convergence = Convergence(at_minimum=True, residual=0.001, agreed=1, starts=2)
    assert convergence.converged
    assert "1 of 2 starts" in convergence.warnings[0]


def candidate(body: BodyKind, cost: float) -> shape._Candidate:
    return shape._Candidate(ShapeEstimate(np.zeros((1, 3)), 1.0, 0.1, 0.3), body, 1.5, cost)


@pytest.mark.parametrize(
    ("polarised", "unpolarised", "answer", "decided"),
    [
        (1.0, 1.28, "polarised", True),
        (1.0, 1.02, "unpolarised", False),  # the most on those that do not, and passed for such
        (1.02, 1.0, "unpolarised", False),  # as little the other way round
        (1.04, 1.0, "unpolarised", True),
    ],
)
def test_a_body_that_hardly_explains_more_is_not_taken_for_polarised(
    polarised: float, unpolarised: float, answer: str, decided: bool
) -> None:
    both = [candidate("polarised", polarised), candidate("unpolarised", unpolarised)]
    best, rival = shape._chosen(sorted(both, key=lambda c: c.cost))
    convergence = Convergence(True, 0.001, 2, 2, rival)
    assert (best.body, convergence.decided) == (answer, decided)
    assert len(convergence.warnings) == (not decided)
    # Of one kind alone there is nothing to decide.
    assert shape._chosen(both[:1]) == (both[0], math.inf)


def test_given_parameters_are_kept() -> None:
    truth = sphere()
    given = GivenParameters(irradiance=None, eta=1.7, alpha=0.25, body="unpolarised")
    parameters = recover_shape(truth.image, truth.mask, light_of(truth), given).parameters
    assert (parameters.eta, parameters.alpha, parameters.body) == (1.7, 0.25, "unpolarised")


def test_a_smaller_copy_is_searched_and_the_whole_is_answered() -> None:
    truth = sphere(side=100)
    recovered = recover_shape(
        truth.image, truth.mask, light_of(truth), GivenParameters(math.pi), size=30
    )
    np.testing.assert_allclose(np.linalg.norm(recovered.normals[truth.mask], axis=-1), 1, rtol=1e-6)
    assert not recovered.normals[~truth.mask].any()
    assert mean_angle_deg(recovered.normals[truth.mask], truth.normals[truth.mask]) < 3


def test_noise_is_not_a_shape() -> None:
    truth = sphere(side=32)
    noise = np.random.default_rng(0).random(truth.image.shape)
    with pytest.raises(Inapplicable, match="no shape explains the picture"):
        recover_shape(noise, truth.mask, light_of(truth), GivenParameters(math.pi))


@pytest.mark.parametrize(
    ("mask", "reason"),
    [
        (np.zeros((20, 20), bool), "mask is empty"),
        (np.eye(20, dtype=bool)[:, ::-1] & (np.arange(20) < 5), "too few"),
        (np.ones((20, 20), bool), "no outline"),
    ],
)
def test_masks_that_hold_no_shape(mask: np.ndarray, reason: str) -> None:
    with pytest.raises(Inapplicable, match=reason):
        recover_shape(np.ones((20, 20, 1)), mask, np.array([0.0, 0.0, 1.0]))


def test_a_dark_object_has_no_shape() -> None:
    truth = sphere(side=24)
    with pytest.raises(Inapplicable, match="dark"):
        recover_shape(0 * truth.image, truth.mask, light_of(truth))


@pytest.mark.parametrize("incidence_deg", [10, 45, 80])
def test_the_light_is_found_from_shading(incidence_deg: float) -> None:
    truth = sphere(incidence_deg=incidence_deg)
    direction = estimate_direction(truth.image[truth.mask].mean(axis=1), truth.normals[truth.mask])
    assert math.degrees(math.acos(min(1.0, float(direction @ light_of(truth))))) < 2


@pytest.mark.parametrize("factor", [1e-3, 1.0, 30.0])
def test_a_picture_that_is_all_specular_light_is_told_in_one_line(factor: float) -> None:
    """A nearly pure blue picture, whose colours leave nothing to the body, or less than nothing."""
    y, x = np.mgrid[1:-1:32j, -1:1:32j]
    mask = x**2 + y**2 < 0.8
    facing = np.sqrt(np.clip(1 - (x**2 + y**2) / 0.8, 0, None))
    blue = np.stack([1e-4 * facing, 1e-4 * facing, facing], axis=-1).astype(np.float32)
    for specular in (blue * factor, -blue * factor, blue * 1e30):
        normals, reason = np.zeros(3), "no shape explains the picture"
        try:
            shape = recover_shape(blue, mask, np.array([0.0, 0.6, 0.8]), None, specular, size=16)
            normals = shape.normals
        except Inapplicable as refusal:
            reason = str(refusal)
        assert np.isfinite(normals).all()
        assert reason.startswith("no shape explains the picture")
        assert len(reason) < 120


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_a_shape_does_not_depend_on_the_unit_of_its_picture(scale: float) -> None:
    """Nor its index, where the light is given in that unit too."""
    truth = sphere(side=24)
    given = GivenParameters(irradiance=np.pi, body="unpolarised")
    usual = recover_shape(truth.image, truth.mask, light_of(truth), given)
    image = scale * truth.image.astype(np.float64)
    given = GivenParameters(irradiance=scale * np.pi, body="unpolarised")
    scaled = recover_shape(image, truth.mask, light_of(truth), given)
    # The search starts as far from its end as the logarithm of the unit's scale says, a factor of
    # two at most: its steps differ, and it ends within its tolerance. Measured: 2e-5.
    np.testing.assert_allclose(scaled.normals, usual.normals, atol=5e-4)
    before, after = usual.parameters, scaled.parameters
    np.testing.assert_allclose(after.albedo, scale * before.albedo, rtol=1e-3)
    np.testing.assert_allclose(after.level, scale * before.level, rtol=1e-2)
    assert after.eta == pytest.approx(before.eta, rel=1e-3)
