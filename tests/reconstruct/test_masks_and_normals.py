"""Masks, label images and normals as programs write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import tifffile

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
