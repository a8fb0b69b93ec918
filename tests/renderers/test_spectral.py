"""Bands: one pass of a spectral variant, a render a band, and interpolation in η give the same.

`pplastic` takes no spectrum for its index; `roughconductor` does, and without extinction it is the
same mirror lobe. In `llvm_ad_spectral_polarized` a ray carries four wavelengths, which are fixed
here to four bands, with the rays and random numbers of our own renderer: what is left between the
ways is rounding, interpolation in η, and what Mitsuba's two BSDFs differ by.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.lobe_samples import Layout
from malus.renderers.mitsuba.shading import Shading
from malus.renderers.mitsuba.wavefront import Stage
from malus.renderers.variant import Variant, choose, mitsuba
from malus.scenes import Area, Camera, Dielectric, Distant, Sampling, Scene, Sphere
from malus.scenes.lights.lights import Light

BANDS = (420.0, 500.0, 580.0, 680.0)
SAMPLING = Sampling(samples=32, seed=7)


class FourBands(Shading):
    """Sums over samples for four bands of every BSDF."""

    @property
    def layout(self) -> Layout:
        return Layout(len(BANDS) * len(self.specular), len(BANDS) * len(self.diffuse), self.errors)

    def lobe(
        self, mi: Any, hit: Any, incoming: Any, bsdfs: Any, to_camera: Any, valid: Any
    ) -> list[Any]:
        import drjit as dr

        hit.wavelengths = type(hit.wavelengths)(*BANDS)
        values = [mi.Float(0.0) for _ in range(3 * len(BANDS) * len(bsdfs))]
        for direction, weight, _ in incoming:
            for k, bsdf in enumerate(bsdfs):
                mueller = bsdf.eval(mi.BSDFContext(), hit, direction, valid)
                mueller = to_camera @ hit.to_world_mueller(mueller, -direction, hit.wi)
                for band in range(len(BANDS)):
                    for row in range(3):
                        place = 3 * (len(BANDS) * k + band) + row
                        values[place] += dr.select(weight > 0, mueller[row, 0][band] * weight, 0.0)
        return values


@pytest.fixture
def spectral() -> Iterator[Any]:
    best = choose()
    if not best.vectorised:
        pytest.skip("only the scalar variant runs here")
    yield mitsuba(Variant(best.name.replace("mono", "spectral"), best.reason, best.llvm))
    mitsuba(best)


def mirror(mi: Any, material: Dielectric) -> Any:
    """The interface with its dispersion as a spectrum that meets the bands exactly."""
    index = [float(eta) for eta in material.indices(BANDS)]
    spectrum = {
        "type": "irregular",
        "wavelengths": ", ".join(map(str, BANDS)),
        "values": ", ".join(map(repr, index)),
    }
    nothing = {"type": "uniform", "value": 0.0}
    return mi.load_dict(
        {
            "type": "roughconductor",
            "distribution": "beckmann",
            "alpha": material.alpha,
            "eta": spectrum,
            "k": nothing,
        }
    )


@pytest.mark.parametrize(
    "light", [Distant(incidence_deg=60), Area(incidence_deg=45)], ids=lambda x: x.kind
)
def test_one_spectral_pass_is_a_render_a_band_is_interpolation(spectral: Any, light: Light) -> None:
    surface = Dielectric(material="polystyrene", alpha=0.3, albedo=0.0, body="unpolarised")
    camera = Camera(resolution=16)
    body = spectral.load_dict({"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.0}})
    shading = FourBands([mirror(spectral, surface)], [body], errors=False)
    lobes = Stage(spectral, Sphere(), camera).render(light, shading, SAMPLING)
    one_pass = lobes.specular.mean(axis=0).transpose(1, 0, 2)  # (pixels, bands, 3)
    scene = Scene(shape=Sphere(), surface=surface, light=light, camera=camera, wavelengths_nm=BANDS)
    others = [
        scene.model_copy(update={"surface": surface.model_copy(update={"material": name})})
        for name in ("water", "glycerol", "pmma", "carbon_disulfide")
    ]
    family = render_family([scene, *others], SAMPLING)
    assert len(family.nodes.values) < len(BANDS) * len(others)
    interpolated = family.truth(scene).specular.reshape(-1, len(BANDS), 3)[lobes.pixels]
    each = []
    for band in BANDS:
        single = scene.model_copy(update={"wavelengths_nm": (band,)})
        truth = render_family([single], SAMPLING).truth(single)
        each.append(truth.specular[:, :, 0].reshape(-1, 3)[lobes.pixels])
    mono = np.stack(each, axis=1)
    peak = mono[..., 0].max()
    # float32 sums of 32 samples: here the same to the last bit but one
    assert np.abs(one_pass - mono).max() < 1e-6 * peak
    # what families promise of their interpolation
    assert np.sqrt(np.mean((interpolated - mono) ** 2)) < 1e-5 * peak
    # The bands differ by more than either limit: a wrong order of them would be seen.
    assert np.abs(mono[:, 0] - mono[:, 3]).max() > 1e-2 * peak
