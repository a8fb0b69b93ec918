"""What is done to training pictures keeps the physics: every step has a law of its own."""

from __future__ import annotations

import numpy as np
import pytest

jax = pytest.importorskip("jax", reason="no jax; pip install jax optax onnx onnxruntime")

from malus.bench.learning.augment import (  # noqa: E402
    HIGHLIGHT,
    Batch,
    augmented,
    before_others,
    ratios,
    without_surroundings,
)
from malus.bench.learning.camera import Camera, in_blocks, photographed, random_camera  # noqa: E402
from malus.bench.learning.colours import blurred, mixed, random_blur, random_mixture  # noqa: E402
from malus.bench.learning.objective import loss  # noqa: E402
from malus.bench.learning.warp import Motion, moved, random_motion, with_picture  # noqa: E402
from malus.scenes import polarisation  # noqa: E402

SIDE = 64
ROUNDING = 1e-5
"""Single precision, with a few operations."""


def motion(
    mirror: float = 1.0,
    turn_deg: float = 0.0,
    zoom: float = 1.0,
    shift: tuple[float, float] = (0.0, 0.0),
) -> Motion:
    return Motion(
        *map(np.float32, (mirror, np.radians(turn_deg), zoom)), np.array(shift, np.float32)
    )


def places(side: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """x to the right and y up of every pixel, from -1 to 1."""
    steps = (np.arange(side) - (side - 1) / 2) / (side / 2)
    return np.broadcast_to(steps, (side, side)), np.broadcast_to(-steps[:, None], (side, side))


def field(x: np.ndarray, y: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Stokes vectors (…, 3, 3), smooth, polarised along `azimuth` from +x."""
    s0 = 1.0 + 0.5 * np.cos(2 * x) * np.cos(y)
    degree = 0.4 * (x**2 + y**2)
    stokes = np.stack(
        [s0, s0 * degree * np.cos(2 * azimuth), s0 * degree * np.sin(2 * azimuth)], -1
    )
    return np.repeat(stokes[..., None, :], 3, axis=-2).astype(np.float32)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize("turn_deg", [-160.0, 0.0, 37.0, 90.0])
def test_a_radial_field_stays_radial(mirror: float, turn_deg: float) -> None:
    """Light polarised along the radius looks the same however a picture is turned or mirrored."""
    x, y = places()
    azimuth = np.arctan2(y, x)
    light = field(np.hypot(x, y), 0 * y, azimuth)
    seen, valid = moved(light, np.ones((SIDE, SIDE), bool), motion(mirror, turn_deg), SIDE)
    middle = np.hypot(x, y) < 0.9
    assert np.asarray(valid)[middle].all()
    # Bilinear interpolation over a curvature of about 3 per unit² and pixels of 1/32: 3 / 32² / 8,
    # and near the centre, where the direction changes within a pixel, 0.4 of a pixel squared.
    np.testing.assert_allclose(np.asarray(seen)[middle], light[middle], atol=3e-3)


def test_what_lies_to_the_right_goes_up_when_turned_left() -> None:
    """A quarter turn anticlockwise: from +x to +y, from horizontal to vertical polarisation."""
    light = np.zeros((SIDE, SIDE, 3, 3), np.float32)
    light[SIDE // 2, -8] = [1.0, 0.5, 0.25]
    seen, _ = moved(light, np.ones((SIDE, SIDE), bool), motion(turn_deg=90), SIDE)
    seen = np.asarray(seen)
    row, column = np.unravel_index(seen[..., 0, 0].argmax(), (SIDE, SIDE))
    assert (row, column) == (7, SIDE // 2)
    np.testing.assert_allclose(seen[row, column, 0], [1.0, -0.5, -0.25], atol=1e-3)  # interpolated


def test_a_shift_is_to_the_right_and_up() -> None:
    light = np.zeros((SIDE, SIDE, 3, 3), np.float32)
    light[40, 20] = 1.0
    seen, _ = moved(light, np.ones((SIDE, SIDE), bool), motion(shift=(3.0, 5.0)), SIDE)
    row, column = np.unravel_index(np.argmax(seen[..., 0, 0]), (SIDE, SIDE))
    assert (row, column) == (40 - 5, 20 + 3)


def test_turned_light_agrees_with_the_conventions() -> None:
    """Turning the picture is turning the axis the other way (scenes/polarisation.py)."""
    random = np.random.default_rng(0)
    stokes = random.normal(size=(5, 3)).astype(np.float32)
    for turn_deg in (-70.0, 10.0, 125.0):
        seen = with_picture(stokes, motion(turn_deg=turn_deg))
        expected = polarisation.in_turned_frame(stokes, np.full(5, -np.radians(turn_deg)))
        np.testing.assert_allclose(seen, expected, atol=ROUNDING)


@pytest.mark.parametrize(
    ("fov_deg", "turn_deg", "mirror", "worst_deg"),
    [(40, 0, -1, 0), (60, 0, -1, 0), (40, 20, 1, 1.3), (60, 20, 1, 3.2), (40, 90, 1, 6.7)]
    + [(60, 90, 1, 14.5), (60, 180, 1, 0)],
)
def test_pixels_off_the_centre_of_a_wide_field_turn_nearly_with_the_picture(
    fov_deg: float, turn_deg: float, mirror: float, worst_deg: float
) -> None:
    x, y = np.tan(np.radians(fov_deg / 2)) * np.stack(places(512))
    view = np.stack([-x, -y, np.ones_like(x)], -1)
    view /= np.linalg.norm(view, axis=-1, keepdims=True)
    # Light that oscillates at 30° in the frame of its pixel, as a vector of space.
    frame = polarisation.viewing_frame(np.eye(3)[:, None, None], view)  # of the image's axes
    vector = np.einsum("axyk,k->xya", frame, [np.cos(np.pi / 6), np.sin(np.pi / 6), 0])
    cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turned = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ np.diag([mirror, 1, 1])
    seen = polarisation.viewing_frame(vector @ turned.T, view @ turned.T)
    true = np.stack([np.ones_like(x), seen[..., 0] ** 2 - seen[..., 1] ** 2,
                     2 * seen[..., 0] * seen[..., 1]], -1)  # fmt: skip
    before = np.array([1.0, np.cos(np.pi / 3), np.sin(np.pi / 3)])
    told = np.asarray(with_picture(before, motion(mirror, turn_deg)))
    error = polarisation.aolp(true) - polarisation.aolp(told)
    worst = np.abs((np.degrees(error) + 90) % 180 - 90).max()
    assert worst == pytest.approx(worst_deg, abs=0.1)  # told to a tenth, half a pixel inside


def test_magnified_pictures_keep_their_middle_and_know_their_edge() -> None:
    x, y = places()
    light = field(x, y, 0 * x)
    seen, valid = moved(light, np.ones((SIDE, SIDE), bool), motion(zoom=2.0), SIDE)
    expected = field(x / 2, y / 2, 0 * x)
    np.testing.assert_allclose(seen, expected, atol=3e-3)  # bilinear, as above
    assert np.asarray(valid).all()
    _, valid = moved(light, np.ones((SIDE, SIDE), bool), motion(zoom=0.5), SIDE)
    # A square of half the side, less the pixels at its edge.
    assert np.asarray(valid).sum() == pytest.approx((SIDE / 2) ** 2, rel=0.08)


def test_motions_stay_in_their_range() -> None:
    keys, least = jax.random.split(jax.random.key(0), 400), np.repeat(np.float32([0.5, 1.0]), 200)
    many = jax.vmap(random_motion, (0, None, None, 0))(keys, 20, 64, least)
    assert float(np.abs(many.turn).max()) <= np.radians(20) + ROUNDING
    assert 0.5 <= float(many.zoom.min()) < 0.6 < 1.8 < float(many.zoom.max()) <= 2.0
    assert 1.0 <= float(many.zoom[200:].min()) < 1.1
    assert 0.4 < float((many.mirror > 0).mean()) < 0.6  # 4 standard deviations of 400 coins


def test_white_balance_keeps_the_ratios_and_grey_makes_channels_alike() -> None:
    random = np.random.default_rng(1)
    light = random.uniform(0.1, 1.0, (4, 3, 3)).astype(np.float32)
    balanced = mixed(light, np.diag([0.5, 1.0, 2.0]).astype(np.float32))
    np.testing.assert_allclose(ratios(balanced), ratios(light), rtol=ROUNDING)
    exchanged = np.float32([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    np.testing.assert_array_equal(mixed(light, exchanged), light[:, [1, 2, 0]])
    grey = np.asarray(mixed(light, np.full((3, 3), 1 / 3, np.float32)))
    np.testing.assert_allclose(grey[:, 0], light.mean(axis=1), rtol=ROUNDING)
    np.testing.assert_array_equal(grey[:, 0], grey[:, 2])


def test_mixtures_and_blurs_never_polarise_beyond_all_light() -> None:
    """Mixtures with weights of at least 0 of physical light are physical."""
    random = np.random.default_rng(2)
    light = random.normal(size=(12, 12, 3, 3)).astype(np.float32)
    light[..., 0] = np.hypot(light[..., 1], light[..., 2])  # fully polarised
    for number in range(20):
        key = jax.random.key(number)
        weights = random_mixture(key)
        assert float(weights.min()) >= 0
        seen = np.asarray(blurred(mixed(light, weights), random_blur(key)))
        assert (np.hypot(seen[..., 1], seen[..., 2]) <= seen[..., 0] * (1 + ROUNDING)).all()


def test_a_blur_is_the_gaussian_of_its_width() -> None:
    point = np.zeros((15, 15, 1), np.float32)
    point[7, 7] = 1.0
    seen = np.asarray(blurred(point, np.float32(1.0)))[..., 0]
    steps = np.arange(-3, 4)
    line = np.exp(-0.5 * steps**2) / np.exp(-0.5 * steps**2).sum()
    np.testing.assert_allclose(seen[4:11, 4:11], np.outer(line, line), atol=ROUNDING)
    np.testing.assert_allclose(blurred(point, np.float32(0.0)), point, atol=ROUNDING)


def camera(**changes: float) -> Camera:
    ideal = {"white": 4.0, "shot": 0.0, "read": 0.0, "eight_bits": 0.0, "jpeg": 0.0, "tone": 1.0}
    return Camera(**{name: np.float32(value) for name, value in (ideal | changes).items()})


def test_cameras_saturate_and_tell_where() -> None:
    picture = np.random.default_rng(3).uniform(0, 8, (16, 16, 3)).astype(np.float32)
    seen, lit = photographed(jax.random.key(0), picture, camera())
    np.testing.assert_allclose(seen, np.minimum(picture, 4.0), rtol=ROUNDING)
    np.testing.assert_array_equal(lit, picture < 4.0)


def test_eight_bits_cost_half_a_code() -> None:
    picture = np.random.default_rng(4).uniform(0, 4, (16, 16, 3)).astype(np.float32)
    seen, _ = photographed(jax.random.key(0), picture, camera(eight_bits=1.0))
    codes, before = (255 * (np.asarray(p) / 4) ** (1 / 2.2) for p in (seen, picture))
    assert np.abs(codes - before).max() <= 0.5 + 1e-2  # powers in single precision at 255
    np.testing.assert_allclose(codes, codes.round(), atol=1e-2)


@pytest.mark.parametrize("level", [1.0, 0.25])
def test_noise_has_the_deviation_that_is_asked_for(level: float) -> None:
    """The variance of electrons is as the light: a quarter of it has half the deviation."""
    picture = np.full((96, 96, 3), level, np.float32)
    seen, _ = photographed(jax.random.key(0), picture, camera(shot=0.02, read=0.01))
    expected = np.hypot(0.02 * np.sqrt(level), 0.01)
    assert float(seen.std()) == pytest.approx(expected, rel=0.03)  # 4 / √(2 · 27648)


def test_blocks_lose_fine_detail_first() -> None:
    """The transform is orthonormal: no coarseness, no change; much of it leaves the means."""
    codes = np.random.default_rng(5).uniform(100, 120, (16, 16, 3)).astype(np.float32)
    np.testing.assert_allclose(in_blocks(codes, np.float32(1e-4)), codes, atol=1e-2)
    coarse = np.asarray(in_blocks(codes, np.float32(20.0)))
    assert coarse[:8, :8].std(axis=(0, 1)).max() < 1e-3 < codes[:8, :8].std()
    # The mean of a block is rounded to 20/8 codes.
    assert np.abs(coarse[:8, :8].mean((0, 1)) - codes[:8, :8].mean((0, 1))).max() <= 1.25 + 1e-3


def test_a_collage_shows_another_picture_with_its_own_truth() -> None:
    mask = np.array([[[True, False]] * 2, [[False, True]] * 2])
    light = np.stack([np.full((2, 2, 3, 3), 1.0 + k, np.float32) for k in range(2)])
    light[~mask] = 0.0
    light[0, 1, 1] = 0.5  # an edge, half covered
    seen, valid = before_others(light, mask, np.array([True, False]))
    assert np.asarray(seen)[0, ..., 0, 0].tolist() == [[1.0, 2.0], [1.0, 0.5]]
    assert np.asarray(valid)[0].tolist() == [[True, True], [True, False]]
    np.testing.assert_array_equal(seen[1], light[1])
    np.testing.assert_array_equal(valid[1], mask[1])


def test_surroundings_are_cut_off_where_that_is_chosen() -> None:
    light = np.ones((2, 1, 2, 3, 3), np.float32)
    seen = without_surroundings(light, np.array([[[True, False]]] * 2), np.array([True, False]))
    assert np.asarray(seen)[:, 0, :, 0, 0].tolist() == [[1.0, 0.0], [1.0, 1.0]]


def test_new_examples_are_physical_and_their_picture_has_a_mean_of_one() -> None:
    x, y = places()
    light = np.repeat(field(x, y, x + y)[None], 6, axis=0).astype(np.float16)
    mask = np.repeat((np.hypot(x, y) < 0.8)[None], 6, axis=0)
    batch = augmented(jax.random.key(0), light, mask, 180.0, 32)
    picture, target, weight = map(np.asarray, batch)
    assert picture.shape == (6, 32, 32, 3)
    assert target.shape == (6, 32, 32, 3, 2)
    assert np.isfinite(picture).all()
    assert np.isfinite(target).all()
    assert np.isfinite(weight).all()
    assert np.linalg.norm(target, axis=-1).max() <= 0.8 + 1e-2  # that of the field, half precision
    assert weight.max() > 0
    assert (picture[weight > 0] >= 0).all()


def test_pixels_weigh_by_their_light_up_to_a_highlight() -> None:
    """Grey halves of 1 and 3, and a spot: weights are as the light, whatever the exposure."""
    picture = np.ones((64, 64), np.float32)
    picture[:, 32:] = 3
    picture[28:36, 12:20] = 500
    light = np.zeros((12, 64, 64, 3, 3), np.float16)
    light[..., 0] = picture[..., None]
    batch = augmented(jax.random.key(1), light, np.ones((12, 64, 64), bool), 0.0, 64)
    ratios_of_halves = []
    for weight in np.asarray(batch.weight)[..., 0]:
        assert weight.max() <= HIGHLIGHT
        flat = weight[(weight > 0) & (weight < 0.9 * HIGHLIGHT)]
        counts, edges = np.histogram(np.log(flat), bins=200)
        first, second = np.sort(edges[np.argsort(counts)[-2:]])
        ratios_of_halves.append(np.exp(second - first))
    # Blurred and clipped ones among them differ; bins are some percent wide.
    assert np.median(ratios_of_halves) == pytest.approx(3, rel=0.1)


def batch_of(target: float, weight: float) -> Batch:
    """One picture of 8² pixels that is polarised along +x."""
    ratios_there = np.zeros((1, 8, 8, 3, 2), np.float32)
    ratios_there[..., 0] = target
    return Batch(np.ones((1, 8, 8, 3)), ratios_there, np.full((1, 8, 8, 3), weight, np.float32))


def test_a_picture_that_is_hardly_polarised_pulls_no_more_than_others() -> None:
    """Beyond twice the size of what is there, its error counts as it is, and no larger."""
    dark = batch_of(target=0.01, weight=0.01)  # too dark for the likelihood of deviations
    estimate = np.full((1, 8, 8, 3, 2), 0.2, np.float32)
    wrong, much_worse = (float(loss(k * estimate, np.ones((1, 8, 8, 3)), dark)) for k in (1, 5))
    assert wrong == pytest.approx(much_worse, rel=ROUNDING)
    half_right = np.where(np.arange(2) == 0, 0.5 * 0.01, 0.0) * np.ones_like(estimate)
    assert float(loss(half_right, np.ones((1, 8, 8, 3)), dark)) < 0.1 * wrong


def test_the_best_deviation_to_state_is_that_of_a_component() -> None:
    """Errors of 0.3 in s1/s0 and 0.4 in s2/s0 have an rms of √(0.25/2); there the loss is least."""
    bright = batch_of(target=0.5, weight=1.0)
    estimate = bright.target + np.array([0.3, 0.4], np.float32)
    best = np.sqrt((0.3**2 + 0.4**2) / 2)

    def stated(scale: float) -> float:
        return loss(estimate, scale * best * np.ones((1, 8, 8, 3)), bright)

    assert float(jax.grad(stated)(1.0)) == pytest.approx(0.0, abs=ROUNDING)
    assert min(float(stated(0.9)), float(stated(1.1))) > float(stated(1.0))


def test_cameras_are_different() -> None:
    many = jax.vmap(random_camera)(jax.random.split(jax.random.key(1), 300))
    assert 0.1 < float((many.white > 100).mean()) < 0.3  # one in five, 4 standard deviations
    assert float(many.eight_bits.mean()) > 0.2
    assert float(many.jpeg[many.eight_bits < 0.5].max()) == 0.0
