"""Masks, label images and normals as programs write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import PIL.Image
import pytest
import tifffile
from runs import formula_dataset

from malus.reconstruct.photos.masks_and_normals import read_labels, read_mask, read_normals
from malus.reconstruct.photos.read_picture import read_picture
from malus.scenes import InputError

LEFT = np.arange(48).reshape(6, 8) % 8 < 3


def unit_vectors() -> np.ndarray:
    """Directions (6, 8, 3) all over the half sphere towards the camera."""
    vectors = np.random.default_rng(0).normal(size=(6, 8, 3))
    vectors[..., 2] = np.abs(vectors[..., 2])
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize("suffix", ["png", "tif", "bmp"])
def test_masks_of_one_bit(tmp_path: Path, suffix: str) -> None:
    """Pillow writes arrays of bool so."""
    path = tmp_path / f"mask.{suffix}"
    PIL.Image.fromarray(LEFT).save(path)
    np.testing.assert_array_equal(read_mask(path, (6, 8)), LEFT)
    with pytest.raises(InputError, match="1 bit a pixel"):
        read_picture(path)


@pytest.mark.parametrize("largest", [True, 1, 255, 1.0])
def test_masks_in_arrays(tmp_path: Path, largest: object) -> None:
    """As `numpy.save` writes them, which was refused though normals were read so."""
    np.save(tmp_path / "mask.npy", np.where(LEFT, largest, type(largest)(0)))
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.npy", (6, 8)), LEFT)
    with pytest.raises(InputError, match="the picture's size, 6 x 8"):
        read_mask(tmp_path / "mask.npy", (8, 6))


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (0.3 + 0.4 * LEFT, "True and False, 0 and 1"),
        (np.repeat(LEFT[..., None], 3, -1), "one number a pixel"),
        (np.zeros((6, 8)), "an object"),
        (np.full((6, 8), "a"), "one number a pixel"),
        (np.full((6, 8), None), "an array of numbers"),
    ],
)
def test_arrays_that_are_no_masks(tmp_path: Path, array: np.ndarray, words: str) -> None:
    np.save(tmp_path / "mask.npy", array)
    with pytest.raises(InputError, match=rf"mask\.npy: expected {words}"):
        read_mask(tmp_path / "mask.npy", (6, 8))


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.int64, np.float32])
def test_labels_in_arrays(tmp_path: Path, dtype: type) -> None:
    """Numbers of any size, as segmentations have them; they count from the smallest."""
    labels = np.where(LEFT, 7, 0).astype(dtype)
    labels[4:] = 90
    np.save(tmp_path / "labels.npy", labels)
    read = read_labels(tmp_path / "labels.npy", (6, 8))
    np.testing.assert_array_equal(read, np.where(labels == 90, 2, labels == 7))
    np.save(tmp_path / "labels.npy", np.where(LEFT, 1, -1))
    with pytest.raises(InputError, match="labels from 0, which is no object"):
        read_labels(tmp_path / "labels.npy", (6, 8))


@pytest.mark.parametrize("suffix", ["png", "tif", "bmp"])
def test_labels_of_a_palette(tmp_path: Path, suffix: str) -> None:
    labels = LEFT.astype(np.uint8)
    labels[4:] += 1
    image = PIL.Image.fromarray(labels).convert("P")
    # Index 2 is darker than 1, as colours of a palette may be: objects count by colour.
    image.putpalette([0, 0, 0, 200, 0, 0, 0, 0, 90])
    image.save(tmp_path / f"labels.{suffix}")
    read = read_labels(tmp_path / f"labels.{suffix}", (6, 8))
    np.testing.assert_array_equal(read, np.array([0, 2, 1])[labels])


def test_a_transparent_palette_is_refused(tmp_path: Path) -> None:
    image = PIL.Image.fromarray(LEFT.astype(np.uint8)).convert("P")
    image.putpalette([0, 0, 0, 255, 255, 255])
    image.save(tmp_path / "mask.png", transparency=1)
    with pytest.raises(InputError, match="a palette"):
        read_mask(tmp_path / "mask.png", (6, 8))


@pytest.mark.parametrize("is_halved", [False, True])
def test_normals_in_a_tiff_of_floats(tmp_path: Path, is_halved: bool) -> None:
    """Vectors as they are, and ½ (n + 1), which is never below 0."""
    vectors = unit_vectors()
    stored = 0.5 * (vectors + 1) if is_halved else vectors
    tifffile.imwrite(tmp_path / "normals.tif", stored, photometric="rgb")
    # Rounding of single precision, twice.
    np.testing.assert_allclose(read_normals(tmp_path / "normals.tif", (6, 8)), vectors, atol=3e-7)


def write_colours(path: Path, values: np.ndarray) -> None:
    planes = {
        n: np.ascontiguousarray(values[..., k]) for k, n in enumerate("RGBA"[: len(values.T)])
    }
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(path))


@pytest.mark.parametrize("kind", ["npy", "bytes", "exr", "layer"])
def test_encoded_normals_are_no_vectors(tmp_path: Path, kind: str) -> None:
    """½ (n + 1) read as n turned all normals to the upper right, by up to 1 in a component."""
    vectors = unit_vectors()
    encoded = 0.5 * (vectors + 1)
    path = tmp_path / ("n.exr" if kind in ("exr", "layer") else "n.npy")
    if kind == "exr":
        write_colours(path, encoded)
    elif kind == "layer":
        write_layers(path, {"normals": encoded})
    else:
        np.save(path, np.rint(255 * encoded).astype(np.uint8) if kind == "bytes" else encoded)
    with pytest.raises(InputError, match=r"unit vectors, found none below 0.*as of \(n \+ 1\)/2"):
        read_normals(path, (6, 8))


@pytest.mark.parametrize("kind", ["npy", "exr", "tif"])
def test_unit_vectors_to_the_upper_right_are_vectors(tmp_path: Path, kind: str) -> None:
    """None is below 0, as of a wall from below: a TIFF of them was taken for ½ (n+1)."""
    vectors, path = np.abs(unit_vectors()), tmp_path / f"n.{kind}"
    vectors[0] = 0  # off the object
    if kind == "exr":
        write_colours(path, vectors.astype(np.float16))
    elif kind == "tif":
        tifffile.imwrite(path, vectors, photometric="rgb")
    else:
        np.save(path, vectors)
    # Half floats have eleven bits.
    np.testing.assert_allclose(read_normals(path, (6, 8)), vectors, atol=1e-3)


@pytest.mark.parametrize("suffix", ["png", "tif", "exr"])
def test_there_is_no_normal_where_all_is_transparent(tmp_path: Path, suffix: str) -> None:
    """What stood below was taken for normals off the object."""
    vectors, path = unit_vectors(), tmp_path / f"n.{suffix}"
    opacity = np.where(LEFT, 255, 0)[..., None]
    if suffix == "exr":
        write_colours(path, np.concatenate([vectors, opacity / 255], -1).astype(np.float32))
    else:
        codes = np.concatenate([np.rint(127.5 * (vectors + 1)), opacity], -1).astype(np.uint8)
        PIL.Image.fromarray(codes).save(path)
    read = read_normals(path, (6, 8))
    assert not read[~LEFT].any()
    # A step of 8 bits is 1/128 of a component.
    np.testing.assert_allclose(read[LEFT], vectors[LEFT], atol=0.01)


def write_layers(path: Path, layers: dict[str, np.ndarray]) -> None:
    """An OpenEXR file with channels X, Y, Z of every layer, beside colours."""
    planes = {"R": np.zeros((6, 8), np.float32)}
    for layer, vectors in layers.items():
        planes |= {
            f"{layer}.{a}": np.ascontiguousarray(vectors[..., k]) for k, a in enumerate("XYZ")
        }
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(path))


def test_normals_in_layers_of_an_exr(tmp_path: Path) -> None:
    """As renderers write them: X, Y, Z of a layer among others."""
    vectors, path = unit_vectors(), tmp_path / "passes.exr"
    for name in ("sh_normal", "ViewLayer.Normal"):
        write_layers(path, {name: vectors, "Position": -7 * vectors})
        np.testing.assert_allclose(read_normals(path, (6, 8)), vectors, atol=1e-6)  # of one float
    write_layers(path, {"normals": vectors, "shading_normals": vectors})
    with pytest.raises(InputError, match=r"one layer of X, Y, Z .* normals, shading_normals"):
        read_normals(path, (6, 8))
    sampling = {"X": 1, "Y": 2, "Z": 2}  # every other pixel of two of them
    plane = np.zeros((6, 8), np.float32)
    planes = {f"N.{axis}": OpenEXR.Channel(plane, n, n) for axis, n in sampling.items()}
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(path))
    with pytest.raises(InputError, match="channels X, Y, Z of one size"):
        read_normals(path, (6, 8))


def test_normals_of_a_scene_of_malus(tmp_path: Path) -> None:
    """The file of a data set is taken as it is; off the object there is no normal."""
    dataset = formula_dataset(tmp_path)
    truth = next(iter(dataset.truths()))
    path = dataset.path / truth.scene.id / "geometry.exr"
    read = read_normals(path, truth.mask.shape)
    np.testing.assert_allclose(read[truth.mask], truth.normals[truth.mask], atol=1e-6)
    assert not read[~truth.mask].any()
