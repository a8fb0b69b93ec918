"""Metals: complex Fresnel reflectances, the limit k = 0, both renderers, and the methods."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plain import against_scalar

from malus.bench import score
from malus.renderers import Truth
from malus.renderers.families.family import render_family
from malus.scenes import (
    Area,
    Camera,
    Conductor,
    Dielectric,
    Distant,
    InputError,
    Light,
    Sampling,
    Scene,
    Sphere,
    Uniform,
    load_suite,
)
from malus.scenes.materials.metals import metal, metals

BANDS = (450.0, 550.0, 650.0)


def scene(
    surface: Conductor | Dielectric, light: Light | None = None, resolution: int = 16
) -> Scene:
    return Scene(
        shape=Sphere(),
        surface=surface,
        light=light or Distant(incidence_deg=80),
        camera=Camera(resolution=resolution),
        wavelengths_nm=BANDS,
    )


def truth_of(one: Scene, samples: int = 16) -> Truth:
    return render_family([one], Sampling(samples=samples)).truth(one)


def reflectances(cosine: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Born and Wolf, Principles of Optics, 1.5.2 and 14.2: perpendicular and parallel."""
    refracted = np.sqrt(1 - (1 - cosine**2) / eta**2 + 0j)
    perpendicular = (cosine - eta * refracted) / (cosine + eta * refracted)
    parallel = (eta * cosine - refracted) / (eta * cosine + refracted)
    return np.abs(perpendicular) ** 2, np.abs(parallel) ** 2


@pytest.mark.parametrize("name", ["gold", "silver", "chromium"])
def test_one_facet_polarises_as_complex_fresnel_says(name: str) -> None:
    """Under a distant light every facet that reflects has one normal, whatever the roughness."""
    truth = truth_of(scene(Conductor(material=name, alpha=0.2)))
    # The light and the viewer are 80° apart, the half vector 40° from both.
    perpendicular, parallel = reflectances(np.cos(np.radians(40.0)), metal(name).eta(BANDS))
    expected = (perpendicular - parallel) / (perpendicular + parallel)
    stokes = truth.stokes[truth.mask]
    lit = stokes[..., 0] > 0.01 * stokes[..., 0].max()
    dolp = np.hypot(stokes[..., 1], stokes[..., 2]) / np.where(lit, stokes[..., 0], 1)
    for band, value in enumerate(expected):
        # 32-bit floats: s1 and s2 are small differences of reflectances near one.
        np.testing.assert_allclose(dolp[:, band][lit[:, band]], value, atol=3e-6)
    assert not truth.diffuse.any()
    assert truth.eta.dtype == np.complex128


def test_a_nearly_smooth_ball_mirrors_the_sky_as_fresnel_says() -> None:
    truth = truth_of(scene(Conductor(material="gold", alpha=0.02), Uniform(), 24), samples=64)
    cosine = truth.normals[truth.mask][:, 2, None].astype(float)
    facing = cosine[:, 0] > 0.6
    perpendicular, parallel = reflectances(cosine, metal("gold").eta(BANDS))
    expected = np.stack([0.5 * (perpendicular + parallel), 0.5 * (perpendicular - parallel)], -1)
    found = truth.stokes[truth.mask]
    polarised = np.hypot(found[..., 1], found[..., 2])
    error = truth.standard_error[truth.mask]
    # Facets of slope 0.02 and a pixel's width blur what is smooth in the angle: 2e-3 of R.
    slack = 2e-3 + 5 * error
    assert np.all(np.abs(found[..., 0] - expected[..., 0])[facing] < slack[..., 0][facing])
    assert np.all(np.abs(polarised - expected[..., 1])[facing] < slack[..., 1][facing])


def test_without_absorption_it_is_the_interface_of_a_dielectric() -> None:
    metallic = truth_of(scene(Conductor(eta=1.5, k=0.0, alpha=0.3)))
    clear = truth_of(scene(Dielectric(eta=1.5, alpha=0.3)))
    # Two codes of Mitsuba's in 32-bit floats: complex and real Fresnel.
    np.testing.assert_allclose(
        metallic.specular, clear.specular, atol=2e-6 * float(clear.specular.max())
    )
    np.testing.assert_array_equal(metallic.mask, clear.mask)


@pytest.mark.parametrize("light", [Distant(incidence_deg=60), Area(incidence_deg=45)], ids=str)
def test_vectorised_and_scalar_truths_agree(light: Light) -> None:
    residual = against_scalar(scene(Conductor(material="copper", alpha=0.3), light))
    # Student's t, variance 7/5; pixels and bands correlate.
    assert 0.4 < np.mean(residual**2) < 1.8
    assert abs(np.mean(residual)) < 0.3


def test_metals_of_one_roughness_share_their_renders() -> None:
    scenes = [scene(Conductor(material=name, alpha=0.3)) for name in metals()]
    family = render_family(scenes, Sampling(samples=4))
    assert len(family.nodes.values) == len(metals()) * len(BANDS)
    for one in scenes[:2]:
        alone = render_family([one], Sampling(samples=4)).truth(one)
        np.testing.assert_array_equal(family.truth(one).stokes, alone.stokes)
    with pytest.raises(ValueError, match="this family's indices"):
        family.truth(scene(Conductor(eta=1.0, k=2.0, alpha=0.3)))


@pytest.mark.parametrize(
    ("method", "light"),
    [("half_vector", Distant(incidence_deg=60)), ("shadowed", Uniform())],
    ids=["half_vector", "shadowed"],
)
@pytest.mark.parametrize("name", ["gold", "iron"])
def test_methods_with_the_physics_find_the_polarisation(
    method: str, light: Light, name: str
) -> None:
    truth = truth_of(scene(Conductor(material=name, alpha=0.2), light, 32), samples=256)
    assert score(truth, method).skill >= 0.99


def test_reflectances_are_those_of_the_metals() -> None:
    """Normal incidence, against what every handbook says of freshly evaporated films."""
    found = {name: np.abs((item.eta(BANDS) - 1) / (item.eta(BANDS) + 1)) ** 2
             for name, item in metals().items()}  # fmt: skip
    assert np.all(found["silver"] > 0.95)
    assert np.all((found["aluminium"] > 0.89) & (found["aluminium"] < 0.93))
    assert np.all((found["iron"] > 0.45) & (found["iron"] < 0.6))
    assert np.all((found["chromium"] > 0.5) & (found["chromium"] < 0.7))
    for coloured in ("gold", "copper"):
        assert found[coloured][0] < 0.6
        assert found[coloured][2] > 0.93


def test_metals_in_a_suite(tmp_path: Path) -> None:
    path = tmp_path / "metals.toml"
    path.write_text(
        """
name = "metals"
shapes = [{ kind = "sphere" }]
materials = ["gold", "water", { eta = 1.1, k = 2.5 }, { eta = 1.4 }]
surfaces = ["carbon"]
bodies = ["unpolarised", "polarised"]
lights = [{ kind = "uniform" }]
wavelengths_nm = [550]
methods = ["eq8"]
"""
    )
    scenes = list(load_suite(path).scenes())
    # A metal has no body: its scene is there once.
    assert [one.surface.material_label for one in scenes] == [
        "gold", "water", "eta 1.1 + 2.5i", "eta 1.4", "water", "eta 1.4",
    ]  # fmt: skip
    for one in scenes:
        assert Scene.model_validate_json(one.model_dump_json()) == one
    path.write_text(path.read_text().replace('"gold"', '"god"'))
    with pytest.raises(InputError, match="god"):
        load_suite(path)


@pytest.mark.parametrize(
    "keys", [{"eta": 0.5}, {"k": 3.0}, {"material": "gold", "k": 3.0, "eta": 1.0}, {}]
)
def test_one_index_of_a_metal(keys: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="either material, or eta and k"):
        Conductor(alpha=0.3, **keys)


def test_a_table_ends_where_it_ends() -> None:
    with pytest.raises(InputError, match="within its table"):
        metal("gold").eta(1600.0)
