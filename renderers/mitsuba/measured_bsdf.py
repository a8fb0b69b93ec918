"""Mitsuba's `measured_polarized` BSDF, a band at a time.

In a mono variant the plugin serves one wavelength, but keeps the whole table: 1 GB a band for the
361 x 91 x 91 directions of Baek et al. It is therefore given a file with that band alone, 0.2 GB.
"""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path
from typing import Any

from malus.renderers.variant import Variant, mitsuba
from malus.scenes.core.quiet import quiet
from malus.scenes.materials.measured import PBRDF, Measured, open_pbrdf

ALPHA_SAMPLE = 0.1
"""Roughness for which directions are drawn where none is known: the plugin's own."""


@functools.lru_cache(maxsize=1)
def measured_bsdfs(
    variant: Variant, material: Measured, wavelengths_nm: tuple[float | complex, ...]
) -> list[Any]:
    """BSDFs of a measured material, one a band; the last material's are kept.

    Raises
    ------
    InputError
        A file with another content than the material's digest tells, a damaged one, a band that it
        does not hold.
    """
    table = open_pbrdf(material.checked())
    bands = [wavelength.real for wavelength in wavelengths_nm]
    table.check_bands(bands)
    alpha = ALPHA_SAMPLE if material.alpha is None else material.alpha
    return [_bsdf(variant, table, wavelength, alpha) for wavelength in bands]


def _bsdf(variant: Variant, table: PBRDF, wavelength_nm: float, alpha: float) -> Any:
    mi = mitsuba(variant)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "band.pbsdf"
        with quiet():  # it tells what it writes
            mi.tensor_io.write(
                str(file),
                # The plugin reads five wavelengths, whatever their number: others follow this one.
                wvls=table.wavelengths_nm[:1],
                **{name: axis[None] for name, axis in table.axes.items()},
                M=table.at(wavelength_nm)[:, :, :, None],
            )
        return mi.load_dict(
            {
                "type": "measured_polarized",
                "filename": str(file),
                "wavelength": float(wavelength_nm),
                "alpha_sample": alpha,
            }
        )
