"""The truth: against direct renders, Mitsuba's own integrator, and formulas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plain import against_scalar
from scipy import stats

from malus.renderers import render
from malus.renderers.families.family import Family, render_family
from malus.renderers.families.nodes import Nodes
from malus.renderers.mitsuba.translate import (
    diffuse_bsdf,
    emitter,
    sensor,
    shape_object,
    specular_bsdf,
)
from malus.renderers.torrance_sparrow import sphere_normals
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Area,
    Blob,
    Camera,
    Dielectric,
    Distant,
    Environment,
    InputError,
    Sampling,
    Scene,
    Sky,
    Sphere,
    Torus,
    Uniform,
)
from malus.scenes.lights.lights import Light
from malus.scenes.materials.materials import surfaces
from malus.scenes.materials.surface import Facets
from malus.scenes.polarisation import dolp
from malus.scenes.shapes.shapes import Shape

LIGHTS = (
    Uniform(),
    Distant(incidence_deg=20),
    Distant(incidence_deg=80),
    Area(incidence_deg=45),
    Environment(),
)

TINY = Camera(resolution=16)
FEW = Sampling(samples=16, seed=3)


def scene_at(eta: float, light: Light, shape: Shape | None = None, **surface: object) -> Scene:
    known = {"alpha": 0.3, "albedo": 0.5, "body": "polarised"} | surface
    return Scene(
        shape=shape or Sphere(), surface=Dielectric(eta=eta, **known), light=light, camera=TINY
    )


def family(light: Light, low: float, high: float, **surface: object) -> Family:
    scenes = [scene_at(eta, light, **surface) for eta in np.linspace(low, high, 12)]
    return render_family(scenes, FEW)


@pytest.mark.parametrize("light", LIGHTS, ids=lambda light: light.label)
@pytest.mark.parametrize("surface", sorted(surfaces()))
def test_interpolated_truth_equals_direct_renders(light: Light, surface: str) -> None:
    """At 8 held-out indices, both lobes: rms within 1e-5 of the peak (the promise of the plan)."""
    alpha = surfaces()[surface].alpha
    low, high = 1.3246, 1.69508  # the 24 materials over 400 to 700 nm
    interpolated = family(light, low, high, alpha=alpha)
    worst = 0.0
    for eta in low + (high - low) * (np.arange(8) + 0.37) / 8:
        scene = scene_at(eta, light, alpha=alpha)
        direct = render_family([scene], FEW).truth(scene)
        ours = interpolated.truth(scene)
        for lobe in ("specular", "diffuse"):
            expected = getattr(direct, lobe)
            difference = getattr(ours, lobe) - expected
            peak = expected[..., 0].max()
            worst = max(worst, float(np.abs(difference).max() / peak))
            assert np.sqrt(np.mean(difference.astype(float) ** 2)) <= 1e-5 * peak
    print(f"{light.label}, {surface}: worst pixel {worst:.1e} of the peak")  # noqa: T201


@pytest.mark.parametrize(("low", "high"), [(1.1, 2.5), (1.5, 4.0)])
def test_indices_far_apart_or_near_that_of_air_are_interpolated_as_well(
    low: float, high: float
) -> None:
    """As above, where the error model of similar indices asks for no number of nodes at all."""
    wanted = np.linspace(low, high, 40)
    scenes = [scene_at(eta, Uniform()) for eta in wanted]
    interpolated = render_family(scenes, FEW)
    assert isinstance(interpolated, Family)
    assert interpolated.interpolation_error["rms"] <= 1e-5
    for scene in scenes[1::13]:
        expected = render_family([scene], FEW).truth(scene).diffuse
        difference = interpolated.truth(scene).diffuse.astype(float) - expected
        assert np.sqrt(np.mean(difference**2)) <= 1e-5 * expected[..., 0].max()


def test_one_index_needs_no_nodes_to_interpolate_between() -> None:
    nodes = Nodes.of(np.array([1.5, 1.5]), count=4)
    assert nodes.rendered == (1.5,)
    assert nodes.weights(np.array([1.5])).tolist() == [[1.0]]


@pytest.mark.parametrize("count", [1, 2, 3, 6, 8, 200])
@pytest.mark.parametrize(("low", "high"), [(1.5, 1.5), (1.45, 1.55), (1.33, 1.7), (1.1, 2.5)])
def test_no_more_is_rendered_and_copied_from_a_card_than_is_wanted(
    low: float, high: float, count: int
) -> None:
    wanted = np.linspace(low, high, count)
    nodes = Nodes.of(wanted)
    assert len(nodes.rendered) <= len(np.unique(wanted))
    # To the bit where nothing is interpolated; else their weights are those of a mean.
    np.testing.assert_allclose(nodes.weights(wanted).sum(axis=1), 1.0, atol=1e-12)


def test_measured_interpolation_error_sees_too_few_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("malus.renderers.families.nodes.node_count", lambda *_: 2)
    assert family(Uniform(), 1.33, 1.69).interpolation_error["rms"] > 1e-4


def test_a_family_refuses_strangers() -> None:
    rendered = family(Uniform(), 1.45, 1.55)
    with pytest.raises(ValueError, match="this family"):
        rendered.truth(scene_at(1.5, LIGHTS[1]))
    with pytest.raises(ValueError, match="eta"):
        rendered.truth(scene_at(1.7, Uniform()))


@pytest.mark.parametrize(
    ("light", "shape"),
    [
        (Uniform(), Sphere()),
        (Uniform(), Torus()),
        (Distant(incidence_deg=60), Blob()),
        (Area(incidence_deg=40), Sphere()),
        (Area(incidence_deg=100, half_angle_deg=30), Torus()),
        (Environment(), Sphere()),
        (Environment(), Blob()),
        (Sky(), Torus()),
    ],
    ids=lambda x: x.label,
)
def test_vectorised_and_scalar_truths_agree(light: Light, shape: Shape) -> None:
    residual = against_scalar(scene_at(1.5, light, shape))
    # Student's t, variance 7/5.
    assert 0.5 < np.mean(residual**2) < 1.6
    # Some 400 pixels, correlated in s0 to s2: the mean strays by less than a fifth.
    assert abs(np.mean(residual)) < 0.2


@pytest.mark.parametrize("half_angle", [0.02, 0.1, 0.5])
def test_a_narrow_lamp_is_parallel_light(half_angle: float) -> None:
    """The solid angle 2π (1 − cos) has half its digits left at 0.02°, none of them in 32 bits."""
    irradiance = np.pi * np.sin(np.radians(half_angle)) ** 2
    lamp = Area(incidence_deg=60, half_angle_deg=half_angle, radiance=1.0 / irradiance)
    sums = [
        render_family([scene], FEW).truth(scene).image.sum(dtype=np.float64)
        for scene in (
            scene_at(1.5, light) for light in (lamp, Distant(incidence_deg=60, irradiance=1.0))
        )
    ]
    # Cosines change by half an angle squared, 4e-5; the rim of the shade by more on fewer pixels.
    assert sums[0] == pytest.approx(sums[1], rel=1e-3)


def test_the_largest_seed_renders_without_llvm_too() -> None:
    scene = scene_at(1.5, Uniform())
    largest = Sampling(samples=2, seed=(1 << 28) - 1)
    assert render_family([scene], largest, choose("scalar")).truth(scene).image.max() > 0
    with pytest.raises(ValueError, match="268435456"):  # of which 16 would need more than 32 bits
        Sampling(samples=2, seed=1 << 28)


def test_lobes_add_up_to_the_full_render() -> None:
    """At depth 2 pplastic with both lobes is the sum of ours, by Mitsuba's own integrator."""
    variant = choose()
    mi = mitsuba(variant)
    light = Distant(incidence_deg=60)
    scene = scene_at(1.5, light, albedo=0.4)
    truth = render_family([scene], Sampling(samples=64), variant).truth(scene)
    both = specular_bsdf(1.5, Facets((0.3, 0.3))) | {
        "diffuse_reflectance": {"type": "uniform", "value": 0.4}
    }
    window = {"type": "uniform", "wavelength_min": 554.5, "wavelength_max": 555.5, "value": 1.0}
    full = mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(mi, TINY) | ({} if variant.vectorised else {"srf": window}),
            "shape": shape_object(mi, Sphere(), mi.load_dict(both)),
            "light": emitter(mi, light),
            "integrator": {"type": "path", "max_depth": 2, "hide_emitters": True},
        }
    )
    image = np.asarray(mi.render(full, spp=64, seed=8))
    image = image[..., 1 if image.shape[-1] >= 3 else 0][truth.mask]
    if not variant.vectorised:
        image *= truth.image[truth.mask].sum() / image.sum()
    error = np.sqrt(2) * truth.standard_error[:, :, 0, 0][truth.mask]
    residual = (truth.image[..., 0][truth.mask] - image) / np.maximum(error, 1e-6)
    assert 0.5 < np.mean(residual**2) < 1.6  # about 110 pixels: ± 0.14 is one deviation


@pytest.mark.parametrize("light", [Uniform(), Area(incidence_deg=45)], ids=lambda x: x.kind)
def test_standard_errors_and_halves_are_honest(light: Light) -> None:
    """Twenty seeds: a pixel's residuals over its standard error are χ² with 19 degrees of freedom.

    Kolmogorov and Smirnov's test asks for the whole distribution over the pixels. Honest errors
    fail one of six tests at 1e-3 in one of 170 runs, and the seeds are fixed.
    """
    seeds, scene = 20, scene_at(1.5, light)
    truths = [
        render_family([scene], Sampling(samples=64, seed=seed)).truth(scene)
        for seed in range(seeds)
    ]
    mask = truths[0].mask
    stokes = np.stack([truth.stokes[mask] for truth in truths]).astype(np.float64)
    error = np.stack([truth.standard_error[mask] for truth in truths])
    expected = (error.astype(np.float64) ** 2).mean(axis=0)
    squares = ((stokes - stokes.mean(axis=0)) ** 2).sum(axis=0) / expected
    lit = expected[:, 0, 0] > 1e-3 * expected[:, 0, 0].max()
    for component in range(3):
        found = squares[lit, 0, component]
        assert stats.kstest(found, stats.chi2(seeds - 1).cdf).pvalue > 1e-3
        # An error that is off by a sixth would be seen.
        assert stats.kstest(found * 1.16**2, stats.chi2(seeds - 1).cdf).pvalue < 1e-3
    noise = np.stack([(t.specular_noise + t.diffuse_noise)[mask] for t in truths])
    assert (noise**2).mean(axis=(0, 1, 2)) == pytest.approx(
        (error**2).mean(axis=(0, 1, 2)), rel=0.15
    )


def test_same_seed_same_bits() -> None:
    scene = scene_at(1.5, Uniform(), Blob())
    first, second = (render_family([scene], FEW).truth(scene) for _ in range(2))
    assert first.stokes.tobytes() == second.stokes.tobytes()
    other = render_family([scene], Sampling(samples=16, seed=4)).truth(scene)
    assert first.stokes.tobytes() != other.stokes.tobytes()


def test_the_mask_does_not_depend_on_the_samples() -> None:
    scene = scene_at(1.5, Uniform(), Torus())
    masks = [
        render_family([scene], Sampling(samples=8, seed=seed)).truth(scene).mask
        for seed in range(6)
    ]
    assert all((mask == masks[0]).all() for mask in masks)
    assert 0.2 < masks[0].mean() < 0.6


def test_halves_average_to_the_truth() -> None:
    scene = scene_at(1.5, Uniform())
    truth = render_family([scene], FEW).truth(scene)
    a, b = truth.halves()
    assert (a.stokes + b.stokes) / 2 == pytest.approx(truth.stokes, abs=1e-6)
    assert np.abs(a.stokes - b.stokes).max() > 1e-4
    for half in (a, b):  # twice the variance, and no second draw of it
        np.testing.assert_allclose(half.standard_error, 2**0.5 * truth.standard_error, rtol=1e-6)
        assert not half.specular_noise.any()


@pytest.mark.parametrize("surface", sorted(surfaces()))
@pytest.mark.parametrize("body", ["polarised", "unpolarised"])
def test_every_surface_polarises(surface: str, body: str) -> None:
    """`roughdielectric` and most BSDFs depolarise in silence; ours must not."""
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric.named("pmma", surface, body),  # type: ignore[arg-type]
        light=Uniform(),
        camera=TINY,
    )
    truth = render_family([scene], FEW).truth(scene)
    assert dolp(truth.specular)[truth.mask].max() > 0.3
    assert (dolp(truth.diffuse)[truth.mask].max() > 0.02) == (body == "polarised")


def test_depolarising_bsdfs_are_used_nowhere() -> None:
    sources = list((Path(__file__).parents[2] / "renderers").rglob("*.py"))
    assert sources
    depolarising = ("roughdielectric", "roughplastic", '"plastic"', "principled", "thindielectric")
    for source in sources:
        text = source.read_text("utf-8")
        assert not [name for name in depolarising if name in text], source.name


class TestTorranceSparrow:
    """Our own formulas against Mitsuba, on the same sphere under the same distant light."""

    LIGHT = Distant(incidence_deg=60, azimuth_deg=35)

    def pair(self, albedo: float = 0.0) -> tuple[np.ndarray, ...]:
        scene = Scene(
            shape=Sphere(),
            surface=Dielectric(eta=1.5, alpha=0.3, albedo=albedo, body="unpolarised"),
            light=self.LIGHT,
            camera=Camera(resolution=128),
        )
        mitsuba_truth = render(scene, Sampling(samples=32))
        formula = render(scene, renderer="torrance-sparrow")
        lit = mitsuba_truth.mask & formula.mask & (formula.image[..., 0] > 0.002)
        return scene, mitsuba_truth, formula, lit

    def test_polarisation_of_the_mirror_lobe_is_the_same(self) -> None:
        """DoLP and AoLP depend on Fresnel at the half vector alone: the same to rounding."""
        _, theirs, ours, lit = self.pair()
        for stokes in (1, 2):
            a = theirs.stokes[lit][..., stokes] / theirs.image[lit]
            b = ours.stokes[lit][..., stokes] / ours.image[lit]
            # float32 sums of 256 samples
            assert a == pytest.approx(b, abs=2e-5)

    def test_radiance_differs_by_the_masking_terms_alone(self) -> None:
        """Smith's term (Mitsuba) against V-cavities (Torrance and Sparrow): explained exactly."""
        scene, theirs, ours, lit = self.pair()
        normals, _ = sphere_normals(scene.camera)
        light = np.array(self.LIGHT.direction)
        half = light + np.array([0, 0, 1])
        half /= np.linalg.norm(half)
        n_l, n_v, n_h = (np.clip(normals @ v, 1e-9, 1) for v in (light, np.array([0, 0, 1]), half))
        # Torrance and Sparrow's term as printed, written apart from the code under test.
        cavities = np.minimum(1, np.minimum(2 * n_h * n_v / half[2], 2 * n_h * n_l / half[2]))
        smith = smith_g1(n_l, 0.3) * smith_g1(n_v, 0.3)
        differ = lit & (np.abs(smith / cavities - 1) > 0.03)
        assert differ.sum() > 10
        ratio = theirs.image[differ][:, 0] / ours.image[differ][:, 0]
        # Left over: Mitsuba averages over a pixel, the formula looks at its centre, and noise.
        assert np.median(np.abs(ratio / (smith / cavities)[differ] - 1)) < 0.02
        assert np.median(np.abs(ratio - 1)) > 0.03

    def test_body_is_lambert(self) -> None:
        _, theirs, ours, lit = self.pair(albedo=0.5)
        a, b = theirs.diffuse[..., 0, 0][lit], ours.diffuse[..., 0, 0][lit]
        assert np.median(np.abs(a / b - 1)) < 0.02  # a pixel's mean against its centre
        assert np.abs(ours.diffuse[..., 1:]).max() == 0

    @pytest.mark.parametrize(
        "change",
        [
            {"light": {"kind": "uniform"}},
            {"shape": {"kind": "torus"}},
            {"surface": {"eta": 1.5, "alpha": 0.3, "body": "polarised"}},
        ],
    )
    def test_refuses_what_the_formulas_do_not_cover(self, change: dict[str, object]) -> None:
        plain = {
            "shape": {"kind": "sphere"},
            "surface": {"eta": 1.5, "alpha": 0.3, "body": "unpolarised"},
            "light": {"kind": "distant", "incidence_deg": 30},
        }
        with pytest.raises(InputError, match="torrance-sparrow"):
            render(Scene.model_validate(plain | change), renderer="torrance-sparrow")


def smith_g1(cosine: np.ndarray, alpha: float) -> np.ndarray:
    """Smith's masking for Beckmann slopes, Walter et al. 2007, the rational approximation."""
    a = cosine / (alpha * np.sqrt(np.maximum(1 - cosine**2, 1e-12)))
    rational = (3.535 * a + 2.181 * a**2) / (1 + 2.276 * a + 2.577 * a**2)
    return np.where(a < 1.6, rational, 1.0)


def test_unknown_renderer() -> None:
    with pytest.raises(InputError, match="renderer: expected mitsuba or torrance-sparrow"):
        render(scene_at(1.5, Uniform()), renderer="pbrt")


@pytest.mark.parametrize("body", ["polarised", "unpolarised"])
def test_bodies_are_linear_in_the_albedo(body: str) -> None:
    """Bodies are rendered at albedo 1 and scaled afterwards: Mitsuba itself must be linear."""
    mi = mitsuba(choose())
    hit = mi.SurfaceInteraction3f()
    hit.wi = mi.Vector3f(0.6, 0.0, 0.8)
    wo = mi.Vector3f(-0.48, 0.36, 0.8)
    values = []
    for albedo in (1.0, 0.3):
        description = diffuse_bsdf(1.5, Facets((0.3, 0.3)), body)  # type: ignore[arg-type]
        key = "reflectance" if body == "unpolarised" else "diffuse_reflectance"
        description[key] = {"type": "uniform", "value": albedo}
        mueller = mi.load_dict(description).eval(mi.BSDFContext(), hit, wo)
        values.append(float(np.ravel(np.asarray(mueller[0, 0]))[0]))
    assert values[1] == pytest.approx(0.3 * values[0], rel=1e-6)  # float32
