"""Mitsuba's `measured_polarized` BSDF of a measured material, loaded for one band at a time.

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
"""Roughness by which directions are drawn where none is known: the plugin's default."""


@functools.lru_cache(maxsize=1)
def measured_bsdfs(
    variant: Variant, material: Measured, wavelengths_nm: tuple[float | complex, ...]
) -> list[Any]:
    """BSDFs of a measured material, one a band; those of the last material stay loaded.

    Raises
    ------
    InputError
        If the file is damaged, its content does not match the material's digest, or a band lies
        outside it.
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
        with quiet():  # Mitsuba prints the names of what it writes
            mi.tensor_io.write(
                str(file),
                # The plugin always reads five wavelengths: four more numbers follow this one.
                wvls=table.wavelengths_nm[:1],
                **{name: axis[None] for name, axis in table.axes.items()},
                M=table.mueller_at(wavelength_nm)[:, :, :, None],
            )
        return mi.load_dict(
            {
                "type": "measured_polarized",
                "filename": str(file),
                "wavelength": float(wavelength_nm),
                "alpha_sample": alpha,
            }
        )
