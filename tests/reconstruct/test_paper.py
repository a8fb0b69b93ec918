"""The paper's whole chain: each stage as printed, and Equation 8 where all of them are given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from click.testing import CliRunner

from malus.bench.commands.filter import filter_command
from malus.bench.scoring.observe import observe
from malus.reconstruct import Inapplicable, Observation, get_method
from malus.reconstruct.observation import INPUTS
from malus.reconstruct.photos.estimate import estimate
from malus.reconstruct.photos.knowledge import Knowledge, read_knowledge
from malus.reconstruct.single_image.blind import ChainResult, run_chain
from malus.reconstruct.single_image.paper import PAPER_SEPARATIONS, STAGES, paper, run_paper
from malus.reconstruct.single_image.separation import separate
from malus.renderers import render
from malus.renderers.truth import Truth
from malus.scenes import Camera, Dielectric, Distant, InputError, Scene, Sphere

BODY = np.array([0.3, 0.6, 1.0])[:, None]
TINT = np.array([1.2, 1.0, 0.8])


def sphere(coloured: bool = False, side: int = 24) -> Truth:
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(material="polystyrene", alpha=0.25, body="unpolarised", albedo=0.3),
        light=Distant(incidence_deg=70),
        camera=Camera(resolution=side),
        wavelengths_nm=(450, 550, 650),
    )
    truth = render(scene, renderer="torrance-sparrow")
    return replace(truth, diffuse=truth.diffuse * BODY) if coloured else truth


@pytest.mark.parametrize("method", sorted(PAPER_SEPARATIONS))
def test_with_every_stage_given_it_is_equation_8(method: str) -> None:
    truth = sphere(coloured=True)
    told = observe(truth, INPUTS)
    chain, eq8 = (get_method(name).reconstruct(told) for name in (method, "eq8"))
    inside = truth.mask
    # The same tables on the same numbers; only the order of their blocks may differ.
    np.testing.assert_allclose(chain.s1[inside], eq8.s1[inside], rtol=1e-12, atol=0)
    np.testing.assert_allclose(chain.s2[inside], eq8.s2[inside], rtol=1e-12, atol=0)
    np.testing.assert_array_equal(chain.image[inside], truth.image[inside])
    assert np.abs(chain.s1[inside]).max() > 0


@pytest.mark.parametrize("scale", [1 / 3, 200.0])
def test_the_colour_of_the_light_has_no_unit(scale: float) -> None:
    """The index follows from irradiance and picture, not from the scale of the light's colour."""
    truth = sphere(coloured=True)
    told = observe(truth, frozenset({"light", "normals"}))
    one, other = (run_paper(replace(told, illuminant=size * TINT)) for size in (1.0, scale))
    # Roughness is searched to 1e-4 of its logarithm, from pictures that differ by rounding.
    np.testing.assert_allclose(other.observation.eta, one.observation.eta, rtol=1e-4)
    np.testing.assert_allclose(other.observation.illuminant, TINT, rtol=1e-12)


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan])
def test_a_colour_that_no_light_has_is_refused_whatever_else_is_given(wrong: float) -> None:
    told = replace(observe(sphere(), INPUTS), illuminant=np.array([1.0, wrong, 1.0]))
    with pytest.raises(InputError, match="illuminant: expected values above 0"):
        run_paper(told)


def test_its_stages_are_all_that_a_method_can_be_told() -> None:
    assert INPUTS - {"distribution"} == STAGES  # Equation 8 has Beckmann's facets, told or not
    assert get_method("paper").optional == STAGES
    assert not get_method("paper").needs


@pytest.mark.parametrize("name", sorted(STAGES - {"diffuse", "light"}))
def test_a_stage_that_is_given_is_kept(name: str) -> None:
    truth = sphere(coloured=True)
    light = {"illuminant", name, *({"diffuse"} if name == "specular" else ())}
    told = observe(truth, frozenset(light))
    kept = getattr(run_paper(told).observation, name)
    np.testing.assert_array_equal(kept, getattr(told, name))


@pytest.mark.parametrize("off", [0.0, np.nan])
@pytest.mark.parametrize("chain", [run_chain, run_paper])
def test_maps_of_index_and_roughness_count_on_the_mask_alone(
    chain: Callable[[Observation], ChainResult], off: float
) -> None:
    truth = sphere()
    told = observe(truth, {"light", "normals"})
    eta, alpha = np.full(3, 1.5), 0.3
    mask = truth.mask
    maps = {"eta": np.where(mask[..., None], eta, off), "alpha": np.where(mask, alpha, off)}
    as_numbers = chain(replace(told, eta=eta, alpha=alpha)).components
    as_maps = chain(replace(told, **maps)).components
    # Means of equal numbers differ in their last digit.
    np.testing.assert_allclose(as_maps.s1, as_numbers.s1, rtol=1e-6, atol=1e-9)
    with pytest.raises(Inapplicable, match="no pixel"):
        chain(replace(told, mask=np.zeros_like(mask), **maps))


def test_equations_7_and_9_to_12_and_the_phase() -> None:
    """I_max and I_min from the lobes that the chain found, by the formulas as printed."""
    from malus.reconstruct import polarisation_ratio

    result = run_paper(observe(sphere(), frozenset()))
    found, inside = result.observation, result.observation.mask
    normals = found.require("normals")[inside].astype(np.float64)
    zenith = np.arccos(np.clip(normals[:, 2], -1, 1))[:, None]
    eta, sigma = found.require("eta")[0], found.alpha**-2.0
    ratio = polarisation_ratio(zenith, eta, sigma, measure="eq8")
    specular, diffuse = found.require("specular")[inside], found.require("diffuse")[inside]
    i_max = 0.5 * diffuse + specular / (1 + ratio)
    i_min = 0.5 * diffuse + specular * ratio / (1 + ratio)
    # The tables of ρ have an error of 1e-6 at most; R here is integrated point by point.
    scale = found.image[inside].max()
    np.testing.assert_allclose(result.components.i_max[inside], i_max, atol=2e-6 * scale)
    np.testing.assert_allclose(result.components.i_min[inside], i_min, atol=2e-6 * scale)
    azimuth = np.arctan2(normals[:, 1], normals[:, 0])
    phase = result.components.phase[inside][:, 0]
    polarised = (i_max - i_min)[:, 0] > 1e-3 * scale
    apart = np.sin(phase - azimuth)[polarised]  # ψ and ψ + π are one
    np.testing.assert_allclose(apart, 0, atol=1e-9)


def test_the_light_is_gray_worlds_over_the_whole_picture() -> None:
    truth = sphere(coloured=True)
    wall = np.where(truth.mask[..., None], truth.image, [0.2, 0.1, 0.1])
    told = Observation(wall, truth.mask, normals=truth.normals)
    result = run_paper(replace(told, specular=truth.specular[..., 0]))
    mean = wall.mean(axis=(0, 1))
    np.testing.assert_allclose(result.observation.illuminant, mean / mean.mean(), rtol=1e-12)


def test_a_coloured_light_that_is_given_changes_colours_alone() -> None:
    truth = sphere(coloured=True)
    white = run_paper(Observation(truth.image, truth.mask, illuminant=np.ones(3)))
    lit = run_paper(Observation(truth.image * TINT, truth.mask, illuminant=TINT))
    # The same picture but for the rounding of a product and a quotient, which a search enlarges.
    expected = white.components.s1 * TINT
    np.testing.assert_allclose(lit.components.s1, expected, atol=1e-4 * np.abs(expected).max())


def test_lobes_are_tans_or_mallicks() -> None:
    truth = sphere(coloured=True)
    told = Observation(truth.image, truth.mask, illuminant=np.ones(3), normals=truth.normals)
    for method, separation in PAPER_SEPARATIONS.items():
        lobes = separate(truth.image, truth.mask, method=separation)
        given = replace(told, specular=lobes.specular, diffuse=lobes.diffuse)
        expected, found = paper(given), get_method(method).reconstruct(told)
        np.testing.assert_allclose(found.s1, expected.s1, rtol=1e-9)
    assert PAPER_SEPARATIONS == {"paper": "chromaticity", "paper-mallick": "suv"}


def test_what_each_stage_found_is_told() -> None:
    told = " ".join(run_paper(observe(sphere(), frozenset())).statements)
    for words in (
        "Gray World 1.0", "by the fitted model", "% of the object's", "starts ended there",
        "one distant light, estimated", "eta 1.50, alpha 0.2", "eta is assumed",
    ):  # fmt: skip
        assert words in told
    coloured = observe(sphere(coloured=True), frozenset({"illuminant"}))
    assert "separated by colour: maximum chromaticity" in " ".join(run_paper(coloured).statements)


def test_gray_world_on_one_coloured_object_costs_its_skill_and_is_warned_of() -> None:
    """Its mean is the object's own colour: what is left is no picture of a shape."""
    truth = sphere(coloured=True)
    astray = run_paper(observe(truth, frozenset()))
    assert any("did not converge" in warning for warning in astray.warnings)
    told = observe(truth, frozenset({"illuminant"}))
    with pytest.raises(Inapplicable, match="no shape explains"):
        run_chain(replace(told, image=told.image / astray.observation.illuminant))
    true, (worse, better) = truth.stokes, (astray.components, paper(told))
    errors = [np.square((c.stokes - true)[truth.mask]).sum() for c in (worse, better)]
    assert errors[0] > 2 * errors[1]


def test_a_picture_that_nothing_explains_is_not_refused() -> None:
    """The paper has an answer for every picture."""
    truth = sphere()
    noise = 1.0 * (np.random.default_rng(0).random(truth.image.shape) > 0.5)
    result = run_paper(Observation(noise, truth.mask))
    assert result.warnings
    assert not result.components.converged
    assert any("but no single light explains" in statement for statement in result.statements)
    dark = Observation(np.zeros_like(truth.image), truth.mask)
    with pytest.raises(Inapplicable, match="dark"):
        paper(dark)


def two_objects() -> tuple[np.ndarray, np.ndarray]:
    """Two spheres side by side, one darker, and their labels 1 and 2."""
    truth = sphere()
    picture = np.concatenate([truth.image, 0.5 * truth.image], axis=1).astype(np.float32)
    return picture, np.concatenate([truth.mask * 1, truth.mask * 2], axis=1)


def test_objects_are_estimated_one_by_one() -> None:
    picture, labels = two_objects()
    both = estimate(picture, Knowledge(labels=labels, method="paper"), "two")
    for label in (1, 2):
        alone = estimate(picture, Knowledge(mask=labels == label, method="paper"), "one")
        inside = labels == label
        np.testing.assert_array_equal(both.components.s1[inside], alone.components.s1[inside])
        assert any(s.startswith(f"object {label}: eta 1.50") for s in both.statements)
    assert not both.components.s1[labels == 0].any()
    np.testing.assert_array_equal(both.components.image, picture)


def test_an_object_that_fails_costs_itself() -> None:
    picture, labels = two_objects()
    picture[labels == 2] = 0
    done = estimate(picture, Knowledge(labels=labels, method="paper"), "two")
    assert any(w.startswith("object 2 is left unpolarised") for w in done.warnings)
    assert done.components.s1[labels == 1].any()
    assert not done.components.s1[labels == 2].any()
    with pytest.raises(InputError, match="the object is dark: no shading"):
        estimate(picture, Knowledge(labels=2 * (labels == 2), method="paper"), "two")


def test_the_filter_takes_a_method_labels_and_a_separation(tmp_path: Path) -> None:
    picture, labels = two_objects()
    codes = (255 * picture / picture.max()).astype(np.uint8)
    PIL.Image.fromarray(codes).save(tmp_path / "two.png")
    PIL.Image.fromarray(labels.astype(np.uint8)).save(tmp_path / "labels.png")
    PIL.Image.fromarray(np.zeros_like(labels, dtype=np.uint8)).save(tmp_path / "black.png")
    common = [str(tmp_path / "two.png"), "--linear", "--out", str(tmp_path / "out")]
    given = ["--labels", str(tmp_path / "labels.png"), "--method", "paper", "--separation", "suv"]
    result = CliRunner().invoke(filter_command, [*common, *given])
    assert result.exit_code == 0, result.output
    assert "object 1: light's colour by Gray World" in result.output
    assert "object 2: eta 1.50" in result.output
    for wrong, words in (
        (["--method", "papier"], "method: expected one of"),
        (["--labels", str(tmp_path / "black.png")], "1 to 255 other values, one an object"),
    ):
        result = CliRunner().invoke(filter_command, [*common, *wrong])
        assert words in str(result.exception or result.output)


def test_label_images_count_from_the_darkest(tmp_path: Path) -> None:
    codes = np.array([[0, 200], [7, 200]], np.uint8)
    PIL.Image.fromarray(codes).save(tmp_path / "labels.png")
    known = read_knowledge((2, 2), labels=tmp_path / "labels.png")
    assert known.labels.tolist() == [[0, 2], [1, 2]]
    assert known.mask.tolist() == [[False, True], [True, True]]


def test_colours_are_labels_and_a_photograph_is_not(tmp_path: Path) -> None:
    colours = np.zeros((2, 2, 3), np.uint8)
    colours[0, 1], colours[1] = (0, 0, 9), (9, 0, 0)
    PIL.Image.fromarray(colours).save(tmp_path / "colours.png")
    known = read_knowledge((2, 2), labels=tmp_path / "colours.png")
    assert known.labels.tolist() == [[0, 1], [2, 2]]
    noise = np.random.default_rng(0).integers(0, 256, (40, 40, 3), dtype=np.uint8)
    PIL.Image.fromarray(noise).save(tmp_path / "photo.png")
    with pytest.raises(InputError, match="found more than 255; write labels as a PNG"):
        read_knowledge((40, 40), labels=tmp_path / "photo.png")
    with pytest.raises(InputError, match="the picture's size, 3 x 2"):
        read_knowledge((2, 3), labels=tmp_path / "colours.png")


def test_any_method_can_be_named(tmp_path: Path) -> None:
    truth = sphere(coloured=True)
    picture = truth.image.astype(np.float32)
    known = Knowledge(truth.normals.astype(np.float32), eta=1.5, alpha=0.25, method="eq8")
    done = estimate(picture, known, "ball")
    lobes = separate(picture, truth.mask)
    expected = get_method("eq8").reconstruct(
        Observation(
            picture, truth.mask, specular=lobes.specular, diffuse=lobes.diffuse,
            normals=truth.normals, eta=np.full(3, 1.5), alpha=0.25,
        )
    )  # fmt: skip
    inside = truth.mask & (truth.normals[..., 2] > 0)
    # Normals in single precision here, in double there.
    np.testing.assert_allclose(done.components.s1[inside], expected.s1[inside], atol=1e-5)
    with pytest.raises(InputError, match="normals is not known; give `normals`"):
        estimate(picture, Knowledge(mask=truth.mask, method="eq8"), "ball")
    with pytest.raises(InputError, match="light is not known"):
        estimate(picture, Knowledge(mask=truth.mask, method="blind-light"), "ball")
