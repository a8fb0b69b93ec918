"""Convert Stokes images to named channels and back, by the names of OpenEXR's spectral layout.

Source: Fichet, Pacanowski and Wilkie, "An OpenEXR Layout for Spectral Images", JCGT 10(3), 2021.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from malus.scenes.core.arrays import AnyArray, FloatArray

Channels = dict[str, AnyArray]


def channel_name(component: int, wavelength_nm: float) -> str:
    """Name of a Stokes component at a wavelength.

    Examples
    --------
    >>> channel_name(1, 550.0)
    'S1.550,000000nm'
    """
    return f"S{component}.{band_name(wavelength_nm)}"


def band_name(wavelength_nm: float) -> str:
    """A wavelength as the layout's own library prints it, with six decimals and a comma.

    Examples
    --------
    >>> band_name(550.0)
    '550,000000nm'
    """
    return f"{wavelength_nm:.6f}nm".replace(".", ",")


def stokes_channels(
    stokes: FloatArray, wavelengths_nm: Sequence[float], prefix: str = ""
) -> dict[str, FloatArray]:
    """The planes (height, width) of a Stokes image (height, width, bands, 3) by channel name.

    Raises
    ------
    ValueError
        If two bands are so near that they have one name.

    Examples
    --------
    >>> list(stokes_channels(np.zeros((2, 2, 1, 3)), [550.0]))
    ['S0.550,000000nm', 'S1.550,000000nm', 'S2.550,000000nm']
    """
    planes = {
        prefix + channel_name(component, wavelength): stokes[:, :, band, component]
        for band, wavelength in enumerate(wavelengths_nm)
        for component in range(3)
    }
    if len(planes) != 3 * len(wavelengths_nm):
        raise ValueError("wavelengths_nm: expected bands at least 1e-6 nm apart")
    return planes


def stokes_from_channels(
    channels: Mapping[str, AnyArray], wavelengths_nm: Sequence[float], prefix: str = ""
) -> FloatArray:
    """The Stokes image (height, width, bands, 3) of `stokes_channels`, in the channels' type."""
    bands = [
        np.stack(
            [channels[prefix + channel_name(component, nm)] for component in range(3)], axis=-1
        )
        for nm in wavelengths_nm
    ]
    return np.stack(bands, axis=2)
