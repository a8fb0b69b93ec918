"""A photograph of which nothing is known: `malus filter` and `malus capture` by a network."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from click.testing import CliRunner
from networks import edges_by_hand
from pictures import saved_dome

from malus.bench.commands.filter import filter_command
from malus.reconstruct.photos.estimate import estimate
from malus.reconstruct.photos.filter import filter_picture
from malus.reconstruct.photos.knowledge import Knowledge
from malus.reconstruct.photos.picture import Picture
from malus.scenes import InputError, polarisation

pytestmark = pytest.mark.usefixtures("stand_in_net")


def photo(side: int = 32) -> np.ndarray:
    return np.random.default_rng(3).uniform(0.1, 0.9, (side, side, 3)).astype(np.float32)


def filtered(*arguments: str | Path) -> tuple[str, str]:
    result = CliRunner().invoke(filter_command, [*map(str, arguments)])
    assert result.exit_code == 0, result.output
    return result.stdout, result.stderr


def test_a_picture_alone_is_told_by_the_network(tmp_path: Path) -> None:
    path, _ = saved_dome(tmp_path)
    stdout, stderr = filtered(path, "--angle", "0", "--out", tmp_path / "out")
    assert "- method net: " in stdout
    assert "the network saw 32 x 32 pixels" in stdout
    assert "cannot know" in stdout
    assert "it expects errors of s1/s0 and s2/s0 of 0.0" in stdout
    assert "light is" not in stdout  # of the light's colour nothing was assumed
    assert not stderr
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert {"dome_uncertainty.png", "dome_angle000.png"} <= names


def test_what_is_known_is_used_as_before(tmp_path: Path) -> None:
    path, normals = saved_dome(tmp_path)
    stdout, _ = filtered(path, "--normals", normals, "--angle", "0", "--out", tmp_path / "out")
    assert "method net" not in stdout
    assert not (tmp_path / "out" / "dome_uncertainty.png").exists()
    for told in (["--light", "1,1,2"], ["--material", "pmma"], ["--alpha", "0.3"]):
        result = CliRunner().invoke(filter_command, [str(path), *told])
        assert "no outline" in str(result.exception)  # of `blind`, which can use it


def test_what_a_network_cannot_use_is_a_warning(tmp_path: Path) -> None:
    path, _ = saved_dome(tmp_path)
    arguments = ["--method", "net", "--light", "1,1,2", "--alpha", "0.3", "--out", tmp_path / "o"]
    _, stderr = filtered(path, *arguments)
    assert "warning: the network does not use light, alpha" in stderr


def test_the_filter_is_the_networks_ratios_through_equation_1() -> None:
    image = photo()
    components = filter_picture(Picture(image, "EXR", None)).components
    s1, s2, _ = edges_by_hand(image / image.mean())
    stokes = np.stack([image, s1 * image, s2 * image], axis=-1)
    for angle in (0.0, 30.0, 90.0):
        expected = polarisation.polarised(stokes, angle)
        # Single precision of a sum of three products.
        np.testing.assert_allclose(components.polarised(angle), expected, atol=3e-6)


def test_the_map_of_uncertainty_is_the_stated_deviation(tmp_path: Path) -> None:
    image = photo()
    filter_picture(Picture(image, "EXR", None), tmp_path, stem="p")
    with PIL.Image.open(tmp_path / "p_uncertainty.png") as read:
        written = np.asarray(read).astype(np.float64) / 65535
    deviation = edges_by_hand(image / image.mean())[2]
    expected = (deviation * image).sum(axis=-1) / image.sum(axis=-1)
    np.testing.assert_allclose(written, expected, atol=1e-5)  # steps of 16 bits


def test_objects_are_seen_one_by_one() -> None:
    image, labels = photo(), np.zeros((32, 32), int)
    labels[:12], labels[20:] = 1, 2
    both = estimate(image, Knowledge(labels=labels, method="net"), "p").components
    for label in (1, 2):
        mask = labels == label
        alone = estimate(image, Knowledge(mask=mask, method="net"), "p").components
        np.testing.assert_array_equal(both.s1[mask], alone.s1[mask])
        np.testing.assert_array_equal(both.deviation[mask], alone.deviation[mask])
    assert not both.deviation[labels == 0].any()


@pytest.mark.parametrize("others", [(), (3,)])
def test_nothing_is_sure_of_an_object_that_is_refused(others: tuple[int, ...]) -> None:
    image, labels = photo(), np.zeros((32, 32), int)
    labels[:12], labels[20, :3] = 1, 2
    for label in others:
        labels[22:] = label
    done = estimate(image, Knowledge(labels=labels, method="net"), "p")
    assert any(w.startswith("object 2 is left unpolarised") for w in done.warnings)
    assert (done.components.deviation[labels == 2] == 1).all()
    assert not done.components.deviation[labels == 0].any()
    alone = estimate(image, Knowledge(mask=labels == 1, method="net"), "p").components
    for name in ("s1", "s2", "deviation"):
        one, two = (getattr(c, name)[labels == 1] for c in (done.components, alone))
        np.testing.assert_array_equal(one, two)


def test_normals_do_not_change_what_a_network_sees() -> None:
    image, normals = photo(), np.zeros((32, 32, 3), np.float32)
    normals[8:24, 8:24, 2] = 1
    told = estimate(image, Knowledge(normals=normals, method="net"), "p").components
    alone = estimate(image, Knowledge(method="net"), "p").components
    for name in ("s1", "s2", "deviation"):
        np.testing.assert_array_equal(getattr(told, name), getattr(alone, name))


def test_the_size_that_the_network_sees_can_be_chosen(tmp_path: Path) -> None:
    path, _ = saved_dome(tmp_path)
    stdout, _ = filtered(path, "--net-size", "24", "--out", tmp_path / "out")
    assert "the network saw 24 x 24 pixels" in stdout


def test_without_the_runtime_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, normals = saved_dome(tmp_path)
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    result = CliRunner().invoke(filter_command, [str(path), "--out", str(tmp_path / "out")])
    assert isinstance(result.exception, InputError)
    assert str(result.exception) == (
        "method net: expected the package onnxruntime, found nothing; pip install 'malus[net]', or"
        " give --mask or --normals and another --method"
    )
    assert not (tmp_path / "out").exists()
    filtered(path, "--normals", normals, "--angle", "0", "--out", tmp_path / "out")


def test_a_picture_smaller_than_a_glance_is_refused() -> None:
    with pytest.raises(InputError, match=r"9 pixels of the picture .* 16 are needed; give"):
        estimate(photo(3), Knowledge(), "p")
    with pytest.raises(InputError, match="give `normals`, `mask`"):  # no network
        estimate(photo(3), Knowledge(light=(0.0, 0.0, 1.0)), "p")
