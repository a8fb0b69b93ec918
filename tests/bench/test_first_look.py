"""What a newcomer does first: look at a truth, print it, and score an array of one's own."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import malus
from malus.reconstruct.photos.capture import Capture
from malus.scenes.core.errors import InputError

LINE = 1200
"""Characters that a representation may take: fifteen lines of a terminal."""


@cache
def ball() -> malus.Truth:
    """A ball of which both lobes polarise, without noise."""
    scene = malus.Scene(
        shape=malus.Sphere(),
        surface=malus.Dielectric(eta=1.5, alpha=0.3, albedo=0.02, body="unpolarised"),
        light=malus.Distant(incidence_deg=60, azimuth_deg=70),
        camera=malus.Camera(resolution=24),
        wavelengths_nm=(450, 650),
    )
    return malus.render(scene, renderer="torrance-sparrow")


def scaled(truth: malus.Truth, factor: complex) -> malus.Components:
    """An estimate whose s1 + i s2 is that of the truth times a number."""
    field = factor * (truth.stokes[..., 1] + 1j * truth.stokes[..., 2])
    return malus.Components(truth.image, field.real, field.imag)


def test_degree_and_angle_are_those_that_four_polarisers_tell() -> None:
    """The textbook's: differences of two crossed pairs over the sum of one."""
    truth, estimate = ball(), scaled(ball(), 1.0)
    for seen in (truth, estimate):
        vertical, diagonal, horizontal, other = (seen.polarised(a) for a in (0, 45, 90, 135))
        s1, s2 = horizontal - vertical, other - diagonal
        total = horizontal + vertical
        lit = total > 1e-3 * total.max()
        # Differences of the light through polarisers lose a few digits of double precision.
        np.testing.assert_allclose(seen.dolp[lit], np.hypot(s1, s2)[lit] / total[lit], atol=1e-10)
        strong = lit & (seen.dolp > 0.01)
        assert strong.sum() > 100
        turn = seen.aolp[strong] - 0.5 * np.arctan2(s2, s1)[strong]
        np.testing.assert_allclose(np.sin(turn), 0.0, atol=1e-8)
        assert np.all(seen.dolp[total == 0] == 0)


def test_a_fit_of_pictures_tells_degree_and_angle() -> None:
    """A lamp behind a polariser at 30° from the vertical is all polarised, at 120° from +x."""
    angles = (0.0, 45.0, 90.0, 135.0)
    light = [np.cos(np.radians(angle - 30.0)) ** 2 for angle in angles]
    pictures = np.ones((4, 8, 8, 1), np.float32) * np.float32(light)[:, None, None, None]
    names = tuple(f"{angle}.png" for angle in angles)
    fit = malus.fit_capture(Capture(pictures, angles, np.zeros((8, 8), bool), names, "light"))
    np.testing.assert_allclose(fit.components.dolp, 1.0, atol=1e-5)  # single precision
    np.testing.assert_allclose(np.degrees(fit.components.aolp), 120.0, atol=1e-3)


@pytest.mark.parametrize("factor", [1.0, 0.5, -1.0, 0.8 * np.exp(0.3j)])
def test_an_estimate_at_hand_has_the_skill_that_its_error_has(factor: complex) -> None:
    """Without noise: of a field that is a number c times the true one, 1 - |1 - c|²."""
    # Over the five angles s1 and s2 do not weigh alike: for complex factors only nearly so.
    slack = 1e-9 if np.isreal(factor) else 0.03
    found = malus.score(ball(), scaled(ball(), factor))
    assert found.skill == pytest.approx(1 - abs(1 - factor) ** 2, abs=slack)
    assert found.agreement.gain[0] == pytest.approx(np.real(factor), abs=1e-9)


def test_an_estimate_of_another_renderer_is_right_within_the_noise_of_the_truth() -> None:
    """Many samples of another seed: what is left is the truth's noise, which is subtracted."""
    scene = ball().scene.model_copy(update={"camera": malus.Camera(resolution=32)})
    truth = malus.render(scene, malus.Sampling(samples=64, seed=1))
    other = malus.render(scene, malus.Sampling(samples=4096, seed=2))
    found = malus.score(truth, scaled(other, 1.0))
    assert found.nmse > 0
    assert found.skill == pytest.approx(1.0, abs=0.01)


def test_an_estimate_that_does_not_fit_is_one_line() -> None:
    small = malus.Components(*np.zeros((3, 4, 4, 2)))
    with pytest.raises(InputError, match=r"expected image of shape \(24, 24, 2\)"):
        malus.score(ball(), small)
    with pytest.raises(InputError, match="Components"):
        malus.score(ball(), ball().stokes)  # type: ignore[arg-type]


def test_what_holds_arrays_is_printed_in_a_line(tmp_path_factory: pytest.TempPathFactory) -> None:
    truth = ball()
    folder = tmp_path_factory.mktemp("first") / "set"
    dataset = malus.render_dataset("quick", folder, resolution=8, samples=2)
    observation = malus.observe(truth, {"normals", "specular"})
    picture = np.full((8, 8, 3), (0.5, 0.3, 0.2), np.float32)
    objects = [
        truth,
        observation,
        scaled(truth, 0.5),
        malus.score(truth, "eq8"),
        malus.open_dataset(folder),
        malus.open_dataset(folder, split=None),
        malus.separate(picture, np.ones((8, 8), bool), method="ratio"),
        malus.estimate_illuminant(picture, method="gray-world"),
        malus.Knowledge(mask=np.ones((8, 8), bool)),
        malus.expose(truth.stokes, malus.Sensor(), wavelengths_nm=(450, 650)),
    ]
    assert dataset is not None
    for one in objects:
        text = repr(one)
        assert text.startswith(type(one).__name__ + "("), text
        assert "\n" not in text
        assert len(text) <= LINE, text
    assert "specular=<float64 24 × 24 × 2 × 3>" in repr(truth)
    assert repr(malus.open_dataset(folder).samples()).startswith("Samples(16 samples")


def test_the_name_of_a_separation_in_the_place_of_a_colour_is_told() -> None:
    picture = np.full((8, 8, 3), (0.5, 0.3, 0.2), np.float32)
    with pytest.raises(ValueError, match="illuminant: expected 3 positive values, found 'ratio'"):
        malus.separate(picture, np.ones((8, 8), bool), "ratio")
