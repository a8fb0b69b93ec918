"""Convert Stokes images to named channels and back, by the names of OpenEXR's spectral layout.

Source: Fichet, Pacanowski and Wilkie, "An OpenEXR Layout for Spectral Images", JCGT 10(3), 2021.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from malus.scenes.core.arrays import AnyArray, FloatArray

Channels = dict[str, AnyArray]

NAME_TOLERANCE_NM = 0.0501
"""Most that a band's centre in a channel's name may be off: half of the last digit where a program
prints one decimal, as colour-science does."""

_SPECTRAL_NAME = re.compile(
    r"S([0-3])\.(\d{1,20}(?:[.,]\d{0,20})?(?:[Ee][+-]?\d{1,2})?)"
    r"(Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p)?(m|Hz)"
)
_PREFIXES = {
    "Y": 1e24, "Z": 1e21, "E": 1e18, "P": 1e15, "T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2,
    "da": 1e1, None: 1.0, "d": 1e-1, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9, "p": 1e-12,
}  # fmt: skip
_LIGHT_NM_PER_SECOND = 299_792_458e9


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


def component_and_wavelength(name: str) -> tuple[int, float] | None:
    """Stokes component and wavelength in nm that a channel's name tells, in any unit of the layout.

    The number may have a comma or a point and any number of decimals; None for other names.

    Examples
    --------
    >>> component_and_wavelength("S1.550,0nm"), component_and_wavelength("S2.0.55um")
    ((1, 550.0), (2, 550.0))
    >>> round(component_and_wavelength("S0.545THz")[1], 2), component_and_wavelength("S0.R")
    (550.08, None)
    """
    match = _SPECTRAL_NAME.fullmatch(name)
    if match is None:
        return None
    component, number, prefix, unit = match.groups()
    value = float(number.replace(",", ".")) * _PREFIXES[prefix]
    if unit == "Hz":
        value = _LIGHT_NM_PER_SECOND / value if value > 0 else 0.0
    else:
        value = round(value * 1e9, 9)
    return int(component), value


def matching_channels(
    names: Iterable[str], wavelengths_nm: Sequence[float], component: int
) -> list[list[str]]:
    """For each band, the channels of a Stokes component whose wavelength is that of the band.

    Of several within `NAME_TOLERANCE_NM` those that are nearest. More than one is ambiguous.

    Examples
    --------
    >>> matching_channels(["S0.550,0nm", "S0.550,04nm", "S1.450nm"], [550.04, 450.0], 0)
    [['S0.550,04nm'], []]
    """
    parsed = {name: component_and_wavelength(name) for name in names}
    values = {name: value[1] for name, value in parsed.items() if value and value[0] == component}
    matches = []
    for nm in wavelengths_nm:
        distance = {name: abs(value - nm) for name, value in values.items()}
        least = min(distance.values(), default=np.inf)
        near = [name for name, off in distance.items() if off == least <= NAME_TOLERANCE_NM]
        matches.append(sorted(near))
    return matches
