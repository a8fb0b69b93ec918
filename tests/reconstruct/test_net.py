"""Method `net`: against a network of closed form, shifted pictures, and laws of scale."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from networks import (
    SLOPE,
    SURE,
    blocks,
    blocks_by_hand,
    brought_back,
    edges,
    edges_by_hand,
    magnified,
)

from malus.reconstruct import Inapplicable, Observation, get_method
from malus.reconstruct.learned import network as network_module
from malus.reconstruct.learned.net import net
from malus.reconstruct.learned.network import network
from malus.reconstruct.learned.scale import interpolated, smaller
from malus.scenes import InputError

ROUNDING = 2e-6
"""Sums of a few numbers of single precision near 1."""


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return edges(tmp_path_factory.mktemp("net") / "edges.onnx")


def picture(height: int = 32, width: int = 32, bands: int = 3, seed: int = 0) -> np.ndarray:
    light = np.random.default_rng(seed).uniform(0.1, 0.9, (height, width, bands))
    return light.astype(np.float32)


def whole(image: np.ndarray, **told: object) -> Observation:
    return Observation(image, np.ones(image.shape[:2], bool), **told)


def test_components_are_the_networks_ratios_times_the_light(weights: Path) -> None:
    image = picture()
    result = net(whole(image), weights)
    s1, s2, deviation = edges_by_hand(image / image.mean())
    assert np.abs(s1).max() > 0.1  # else nothing is compared
    np.testing.assert_allclose(result.s1, s1 * image, atol=ROUNDING)
    np.testing.assert_allclose(result.s2, s2 * image, atol=ROUNDING)
    np.testing.assert_allclose(result.deviation, deviation, atol=ROUNDING)
    np.testing.assert_array_equal(result.image, image)


@pytest.mark.parametrize("shape", [(32, 32), (32, 64)])
def test_a_network_of_two_sizes_tells_the_mean(tmp_path: Path, shape: tuple[int, int]) -> None:
    both = edges(tmp_path / "both.onnx", magnifications=(1.0, 1.5))
    image = picture(*shape)
    result = net(whole(image), both, side=64)
    large = magnified(image, 1.5)
    plain, enlarged = edges_by_hand(image / image.mean()), edges_by_hand(large / large.mean())
    back = (brought_back(maps, shape) for maps in enlarged)
    s1, s2, deviation = zip(plain, back, strict=True)
    assert np.abs(s1[0] - s1[1]).max() > 0.05  # the sizes do not agree by themselves
    np.testing.assert_allclose(result.s1, np.mean(s1, axis=0) * image, atol=ROUNDING)
    np.testing.assert_allclose(result.s2, np.mean(s2, axis=0) * image, atol=ROUNDING)
    rms = np.sqrt(np.mean(np.square(deviation), axis=0))
    np.testing.assert_allclose(result.deviation, rms, atol=ROUNDING)


def test_a_large_picture_is_seen_at_both_sizes_and_nothing_off_the_mask(tmp_path: Path) -> None:
    """Of 192 pixels a side it sees 32 and 48, as two networks would that see one size each."""
    both = edges(tmp_path / "both.onnx", magnifications=(1.0, 1.5))
    fine = picture(192, 192)
    mask = np.zeros((192, 192), bool)
    mask[24:150, 30:180] = True
    hidden = np.where(mask[..., None], fine, 1e3).astype(np.float32)
    first, second = (net(Observation(one, mask), both) for one in (fine, hidden))
    np.testing.assert_array_equal(first.s1[mask], second.s1[mask])
    assert not first.s1[~mask].any()
    assert not first.deviation[~mask].any()
    alone = [net(Observation(fine, mask), edges(tmp_path / "a.onnx"), side=s) for s in (32, 48)]
    # What was seen at 32 pixels is brought to 48 first, and both to 192: interpolation of
    # interpolated values is off by a part of the difference between neighbours.
    mean = (alone[0].s1 + alone[1].s1) / 2
    assert np.abs(first.s1 - mean)[mask].mean() < 0.1 * np.abs(mean)[mask].mean()


@pytest.mark.parametrize("side", [None, 64])
def test_few_pixels_are_counted_in_the_picture_that_was_given(
    tmp_path: Path, side: int | None
) -> None:
    """Neither a larger network picture nor a smaller one changes how many there are."""
    both, image = edges(tmp_path / "both.onnx", magnifications=(0.5, 1.5)), picture()
    with pytest.raises(Inapplicable, match=r"^1 pixel of the picture or its mask: .* 16 are"):
        net(whole(image[:1, :1]), both, side=side)
    mask = np.zeros((32, 32), bool)
    mask[:3, :5] = True
    with pytest.raises(Inapplicable, match=r"^15 pixels of the picture or its mask: .* 16 are"):
        net(Observation(image, mask), both, side=side)
    with pytest.raises(Inapplicable, match=r"of the reduced picture: .* a larger net_size"):
        net(whole(image), both, side=4)


def test_a_picture_in_a_mirror_has_the_mirrored_polarisation(tmp_path: Path) -> None:
    # `blocks` says of s2 what no mirror may leave: its answers alone would not agree.
    of_no_symmetry = blocks(tmp_path / "blocks.onnx")
    image = picture()
    plain, mirrored = net(whole(image), of_no_symmetry), net(whole(image[:, ::-1]), of_no_symmetry)
    np.testing.assert_array_equal(mirrored.s1, plain.s1[:, ::-1])
    np.testing.assert_array_equal(mirrored.s2, -plain.s2[:, ::-1])
    np.testing.assert_array_equal(mirrored.deviation, plain.deviation[:, ::-1])
    assert np.abs(plain.s1).max() > 0.01


def test_outside_the_mask_it_is_dark_and_not_counted(weights: Path) -> None:
    image, mask = picture(), np.zeros((32, 32), bool)
    mask[4:28, 10:30] = True
    result = net(Observation(image, mask), weights)
    dark = np.where(mask[..., None], image, 0) / image[mask].mean()
    s1, _, deviation = edges_by_hand(dark)
    np.testing.assert_allclose(result.s1[mask], (s1 * image)[mask], atol=ROUNDING)
    np.testing.assert_allclose(result.deviation[mask], deviation[mask], atol=ROUNDING)
    assert not result.s1[~mask].any()
    assert not result.deviation[~mask].any()


def test_around_a_mask_it_may_see_the_picture(weights: Path) -> None:
    image, mask = picture(), np.zeros((32, 32), bool)
    mask[4:28, 10:30] = True
    result = net(Observation(image, mask), weights, around=True)
    everywhere = net(whole(image), weights)
    np.testing.assert_array_equal(result.s1[mask], everywhere.s1[mask])
    assert not result.s1[~mask].any()


def test_exposure_scales_the_light_and_nothing_else(weights: Path) -> None:
    image = picture()
    plain, brighter = (net(whole(f * image), weights) for f in (np.float32(1), np.float32(8)))
    np.testing.assert_allclose(brighter.s1, 8 * plain.s1, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(brighter.deviation, plain.deviation, rtol=1e-5)


def test_light_below_zero_counts_as_darkness(weights: Path) -> None:
    """What is left of noise after a dark level was taken away: no network was trained on it."""
    image, dark = picture(), np.zeros((32, 32, 3), bool)
    dark[10:14, 3:9] = True
    below, black = (net(whole(np.where(dark, v, image)), weights) for v in (np.float32(-0.2), 0))
    np.testing.assert_array_equal(below.s1, black.s1)
    np.testing.assert_array_equal(below.deviation, black.deviation)


def test_bands_go_in_by_falling_wavelength_and_come_back_in_their_order(weights: Path) -> None:
    image = picture()
    told = net(whole(image[..., ::-1].copy(), wavelengths_nm=(450.0, 550.0, 650.0)), weights)
    np.testing.assert_array_equal(told.s1[..., ::-1], net(whole(image), weights).s1)


def test_a_grey_picture_is_seen_as_three_equal_channels(weights: Path) -> None:
    grey = picture(bands=1)
    result = net(whole(grey), weights)
    coloured = net(whole(np.repeat(grey, 3, axis=-1)), weights)
    assert result.s1.shape == grey.shape
    np.testing.assert_allclose(result.s1, coloured.s1.mean(axis=-1, keepdims=True), atol=ROUNDING)


def test_many_bands_share_channels(weights: Path) -> None:
    falling = np.repeat(picture(), 2, axis=-1)  # red twice, green twice, blue twice
    wavelengths = (700.0, 650.0, 560.0, 540.0, 460.0, 420.0)
    result = net(whole(falling, wavelengths_nm=wavelengths), weights)
    np.testing.assert_allclose(
        result.s1[..., ::2], net(whole(picture()), weights).s1, atol=ROUNDING
    )
    np.testing.assert_array_equal(result.s1[..., ::2], result.s1[..., 1::2])


def test_bands_of_unknown_wavelengths_are_no_colours(weights: Path) -> None:
    with pytest.raises(Inapplicable, match="wavelengths of the 5 bands are not known"):
        net(whole(picture(bands=5)), weights)


def test_a_dark_picture_tells_nothing(weights: Path) -> None:
    with pytest.raises(Inapplicable, match="no light"):
        net(whole(np.zeros((8, 8, 3))), weights)


def test_pixels_that_are_no_number_are_left_out(weights: Path) -> None:
    image = picture()
    image[3, 4, 1] = np.nan
    result = net(whole(image), weights)
    assert not result.valid[3, 4]
    assert result.valid.sum() == 32 * 32 - 1
    assert np.isfinite(result.s1).all()
    assert not result.s1[3, 4].any()


def test_light_is_at_most_completely_polarised(tmp_path: Path) -> None:
    steep = edges(tmp_path / "steep.onnx", slope=5.0)
    image = picture()
    result = net(whole(image), steep)
    dolp = np.hypot(result.s1, result.s2) / image
    assert dolp.max() == pytest.approx(1.0, abs=1e-6)  # rounding of one division
    assert np.median(dolp) > 0.99  # the ratios of most pixels were too large


@pytest.mark.parametrize("shape", [(96, 128), (70, 45), (129, 33)])
def test_no_seam_tiles_equal_the_whole(weights: Path, shape: tuple[int, int]) -> None:
    model, light = network(weights), picture(*shape)
    at_once, tiled = model.run(light, 4096), model.run(light, 32)
    for one, other in zip(at_once, tiled, strict=True):
        assert one.shape == (*shape, 3)
        # Convolutions of one pixel may add in another order in another tile.
        np.testing.assert_allclose(one, other, atol=ROUNDING)


def test_tiles_begin_where_a_network_that_pools_begins(tmp_path: Path) -> None:
    model, light = network(blocks(tmp_path / "blocks.onnx")), picture(96, 112)
    expected = blocks_by_hand(light)
    for tile in (4096, 40, 16):  # 40 is no multiple of the stride
        output = model.run(light, tile)
        np.testing.assert_allclose(output.s1, expected, atol=ROUNDING)
        np.testing.assert_allclose(output.s2, -expected, atol=ROUNDING)


def test_tiles_that_overlap_less_than_the_reach_would_differ(tmp_path: Path) -> None:
    blind = network(edges(tmp_path / "short.onnx", receptive_radius=0))
    light = picture(96, 96)
    assert np.abs(blind.run(light, 32).s1 - blind.run(light, 4096).s1).max() > SLOPE / 2


def test_sides_that_are_no_multiples_of_the_stride_go_on_as_they_end(weights: Path) -> None:
    light = picture(37, 41)
    s1, s2, _ = edges_by_hand(np.pad(light, ((0, 11), (0, 7), (0, 0)), mode="edge"))
    output = network(weights).run(light)
    np.testing.assert_allclose(output.s1, s1[:37, :41], atol=ROUNDING)
    np.testing.assert_allclose(output.s2, s2[:37, :41], atol=ROUNDING)


def test_cores_change_no_bit(weights: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = network(weights).session.get_session_options()
    assert (options.intra_op_num_threads, options.inter_op_num_threads) == (1, 1)
    results = []
    for cores in (1, 4):
        monkeypatch.setattr(network_module, "usable_cores", lambda cores=cores: cores)
        results.append(network(weights).run(picture(96, 96), 32))
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_large_picture_is_averaged_over_area_and_its_ratios_interpolated(weights: Path) -> None:
    coarse = picture(32, 24)
    fine = np.repeat(np.repeat(coarse, 8, axis=0), 8, axis=1)
    fine[::2] *= 1.5  # rows in pairs, with the same mean but for a factor
    fine[1::2] *= 0.5
    small, large = net(whole(coarse), weights, side=32), net(whole(fine), weights, side=32)
    ratio = large.s1 / fine
    centre = slice(3, None, 8), slice(3, None, 8)
    # Half a fine pixel from a coarse pixel's centre, interpolation is 1/16 of the way to the next.
    expected, difference = small.s1 / coarse, np.abs(np.diff(small.s1 / coarse, axis=0)).max()
    np.testing.assert_allclose(ratio[centre], expected, atol=difference / 7)
    assert np.abs(ratio[centre] - expected).mean() < difference / 20


def test_interpolation_is_linear_in_place() -> None:
    ramp = np.linspace(0, 1, 9)[None, :, None] * np.ones((5, 1, 1))
    fine = interpolated(ramp, np.ones((5, 9), bool), (40, 72))[..., 0]
    at = (np.arange(72) + 0.5) / 8 - 0.5  # pixel centres on the axis of the coarse pixels
    inner = slice(4, -4)
    np.testing.assert_allclose(fine[:, inner], (at[inner] / 8) * np.ones((40, 1)), atol=ROUNDING)


def test_reduction_keeps_light_and_takes_none_from_off_the_mask() -> None:
    image, valid = picture(60, 90), np.zeros((60, 90), bool)
    valid[10:50, 20:71] = True
    image[~valid] = 1e6
    light, kept = smaller(image, valid, (6, 9))
    assert light.max() <= 0.9
    area = np.add.reduceat(
        np.add.reduceat(valid.astype(float), range(0, 60, 10)), range(0, 90, 10), 1
    )
    np.testing.assert_array_equal(kept, area > 0)
    total = (light * area[..., None]).sum(axis=(0, 1))
    np.testing.assert_allclose(total, image[valid].sum(axis=0), rtol=1e-5)  # single precision


def test_a_thin_object_keeps_its_polarisation(weights: Path) -> None:
    image, mask = picture(256, 256), np.zeros((256, 256), bool)
    mask[:, 101] = True
    result = net(Observation(image, mask), weights, side=32)
    assert (result.deviation[mask] >= SURE[0]).all()
    assert np.abs(result.s1[mask]).max() > 0.01 * SLOPE


def test_a_method_of_ones_own_file(weights: Path) -> None:
    method = get_method(f"net:{weights}")
    assert (method.name, method.needs, method.per_pixel) == (f"net:{weights}", frozenset(), False)
    image = picture()
    np.testing.assert_array_equal(
        method.reconstruct(whole(image)).s1, net(whole(image), weights).s1
    )
    mask = np.zeros((32, 32), bool)
    mask[8:24] = True
    seen = get_method(f"net-around:{weights}").reconstruct(Observation(image, mask))
    np.testing.assert_array_equal(seen.s1[mask], net(whole(image), weights).s1[mask])


def written(path: Path, description: str | None) -> Path:
    model = onnx.load(edges(path))
    del model.metadata_props[:]
    if description is not None:
        entry = model.metadata_props.add()
        entry.key, entry.value = "malus", description
    path.write_bytes(model.SerializeToString())
    return path


@pytest.mark.parametrize(
    ("description", "expected"),
    [
        (None, "expected a network that `malus train` wrote, found one without a description"),
        ("{", "expected a network that `malus train` wrote"),
        ("[]", "expected a table of keys, found list"),
        ('{"format": 2, "stride": 16, "receptive_radius": 5, "resolution": 32}', "key format"),
        ('{"format": 1, "stride": 16, "resolution": 32}', "receptive_radius: expected this key"),
    ],
)
def test_files_that_are_no_such_network(
    tmp_path: Path, description: str | None, expected: str
) -> None:
    path = written(tmp_path / "n.onnx", description)
    with pytest.raises(InputError) as caught:
        get_method(f"net:{path}")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_keys_that_later_versions_add_are_no_mistake(tmp_path: Path) -> None:
    about = {"format": 1, "stride": 16, "receptive_radius": 5, "resolution": 32, "ema": 0.99}
    assert network(written(tmp_path / "n.onnx", json.dumps(about))).about.margin == 16


def test_damaged_and_missing_files(tmp_path: Path) -> None:
    (tmp_path / "n.onnx").write_bytes(b"no network")
    for name, expected in (("n.onnx", "a network that"), ("m.onnx", "a file of trained weights")):
        with pytest.raises(InputError, match=f"{name}: expected {expected}"):
            get_method(f"net:{tmp_path / name}")


def test_without_the_runtime_it_says_what_to_install(
    weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(Inapplicable, match=r"needs onnxruntime: pip install 'malus\[net\]'"):
        get_method(f"net:{weights}").reconstruct(whole(picture()))


def test_methods_are_listed_without_the_runtime() -> None:
    script = (
        "import sys; from malus.reconstruct import methods; methods();"
        "print([m for m in ('onnxruntime', 'onnx', 'torch') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_what_else_is_known_is_not_used(weights: Path) -> None:
    observation = whole(picture())
    more = replace(observation, normals=picture(), eta=np.full(3, 1.5), alpha=0.2)
    np.testing.assert_array_equal(net(more, weights).s1, net(observation, weights).s1)
