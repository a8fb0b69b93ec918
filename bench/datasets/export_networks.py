"""The layouts of published networks: pictures of codes, named by the number of the scene.

What each keeps and loses stands in `LAYOUTS`; `names.json` beside the pictures tells which scene
has which number, and `splits.json` the splits of a dataset that has them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from malus.bench.datasets.layouts import FROM_HORIZONTAL_DEG, red_first
from malus.reconstruct.photos.png16 import to_16bit
from malus.renderers.truth import Truth
from malus.scenes import polarisation
from malus.scenes.core.arrays import Float64Array, FloatArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import write_whole
from malus.scenes.scene import Scene

NAMES = "names.json"
"""File that tells what every scene is called in a layout."""

WriteNumbered = Callable[[Path, str, Truth], None]
"""Writes the files of one scene, of a name, into a folder that all scenes share."""


@dataclass(frozen=True)
class NetworkLayout:
    """A layout: how a scene is written, and what of it stays."""

    write: WriteNumbered
    words: Mapping[str, str]


def save_png(path: Path, codes: NDArray[np.uint16]) -> None:
    """Write one or three channels of 16 bits as PNG."""
    import imagecodecs

    grey = codes.ndim == 3 and codes.shape[2] == 1
    content = np.ascontiguousarray(codes[..., 0] if grey else codes)
    encoded = imagecodecs.png_encode(content)
    write_whole(path, lambda temporary: temporary.write_bytes(encoded))


def check_bands(scene: Scene) -> None:
    """Raise InputError for a scene with another number of bands than a picture has channels."""
    bands = len(scene.wavelengths_nm)
    if bands not in (1, 3):
        hint = "render three bands; bands are written as channels, the longest first"
        raise InputError(scene.label, "1 or 3 bands", str(bands), hint)


def colours(truth: Truth) -> FloatArray:
    """Stokes images (height, width, 1 or 3, 3), black off the object.

    Raises
    ------
    InputError
        Where the scene has another number of bands than a picture has channels.
    """
    check_bands(truth.scene)
    order = red_first(truth.scene.wavelengths_nm)
    return np.where(truth.mask[..., None, None], truth.stokes[:, :, order], 0)


def write_components(folder: Path, name: str, truth: Truth) -> None:
    """`NAME/s0.png` to `s3.png`, each scaled to its own smallest and largest value."""
    stokes = colours(truth)
    s3 = np.zeros_like(stokes[..., 0])
    if truth.s3 is not None:
        seen = truth.s3[:, :, red_first(truth.scene.wavelengths_nm)]
        s3 = np.where(truth.mask[..., None], seen, 0)
    for k, component in enumerate((*np.moveaxis(stokes, -1, 0), s3)):
        low, high = float(component.min()), float(component.max())
        scale = high - low if high > low else 1.0
        save_png(folder / name / f"s{k}.png", to_16bit((component - low) / scale))


def write_polarisers(folder: Path, name: str, truth: Truth) -> None:
    """`pol000/NAME.png` to `pol135`, `normal/NAME.png`, `mask/NAME.png`."""
    stokes = colours(truth).astype(np.float64)
    full_scale = float(stokes[..., 0].max()) or 1.0
    for angle in FROM_HORIZONTAL_DEG:
        seen = polarisation.polarised(stokes, angle + polarisation.FROM_VERTICAL_DEG)
        save_png(folder / f"pol{angle:03}" / f"{name}.png", to_16bit(seen / full_scale))
    save_png(folder / "normal" / f"{name}.png", to_16bit((truth.normals + 1.0) / 2.0))
    _save_mask(folder, name, truth)


def write_angle_and_degree(folder: Path, name: str, truth: Truth) -> None:
    """`AoLP_16bit/NAME.png`, `DoLP_16bit/NAME.png`, `mask/NAME.png`; of the mean of the bands."""
    stokes: Float64Array = colours(truth).astype(np.float64).mean(axis=2)
    angle = polarisation.aolp(stokes)
    signed = np.where(angle > np.pi / 2, angle - np.pi, angle)
    save_png(folder / "AoLP_16bit" / f"{name}.png", to_16bit(signed / np.pi + 0.5))
    save_png(folder / "DoLP_16bit" / f"{name}.png", to_16bit(polarisation.dolp(stokes)))
    _save_mask(folder, name, truth)


def _save_mask(folder: Path, name: str, truth: Truth) -> None:
    save_png(folder / "mask" / f"{name}.png", to_16bit(truth.mask.astype(np.float64)))


LAYOUTS: Mapping[str, NetworkLayout] = {
    "rgb2pol": NetworkLayout(
        write_components,
        {
            "NAME/s0.png ... s3.png": "Stokes components, red, green and blue the three bands, the"
            " longest first; 16 bits, each file from its own smallest value (0) to its largest"
            " (65535), black off the object; s2 > 0 at +45 degrees anticlockwise as displayed; s3"
            " right-handed, and all 0 where the scene has none",
            "keeps": "the pictures of the components, as the RGB-to-Polarization benchmark"
            " has them",
            "loses": "scale and zero of every component, noise, lobes, normals, mask",
        },
    ),
    "pol": NetworkLayout(
        write_polarisers,
        {
            "pol000, pol045, pol090, pol135": "linear intensity behind a polariser whose angle"
            " counts from the HORIZONTAL, anticlockwise as displayed; 65535 is the scene's largest"
            " s0; red, green and blue the three bands, the longest first",
            "normal": "(n + 1) / 2 of x to the right, y up, z towards the viewer",
            "mask": "65535 on the object",
            "keeps": "linear Stokes vectors of three bands to 16 bits, normals, mask",
            "loses": "the radiance of full scale, noise, lobes",
        },
    ),
    "polaranything": NetworkLayout(
        write_angle_and_degree,
        {
            "AoLP_16bit": "angle from the horizontal, anticlockwise, -90 degrees (0) to 90 (65535),"
            " of the Stokes vectors' mean over the bands",
            "DoLP_16bit": "degree of linear polarisation, 0 to 1, of the same",
            "mask": "65535 on the object",
            "keeps": "angle and degree of polarisation of the mean of the bands, mask",
            "loses": "the picture itself, bands, noise, lobes, normals",
        },
    ),
}
"""Layouts by the name that `malus export` and `malus score` take."""
