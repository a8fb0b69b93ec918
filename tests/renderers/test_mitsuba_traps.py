"""What `traps.md` says of Mitsuba's polarised variants, where no other test shows it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from malus.renderers.variant import choose, mitsuba

SCALAR = choose("scalar")
"""Every wheel of Mitsuba has it; what is shown here does not depend on the variant."""


def stokes(bsdf: dict[str, Any], roll_deg: float = 0.0, batch: bool = False) -> np.ndarray:
    """(height, width, 3): green of s0, s1 and s2 of a sphere in uniform light, 16 samples."""
    mi = mitsuba(SCALAR)
    film = {"type": "hdrfilm", "width": 12, "height": 12, "filter": {"type": "box"}}
    look = mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
    camera = {
        "type": "orthographic",
        "to_world": look @ mi.ScalarTransform4f().rotate([0, 0, 1], roll_deg),
        "film": film,
    }
    if batch:
        camera = {"type": "batch", "one": camera, "film": film}
    scene = {
        "type": "scene",
        "sphere": {"type": "sphere", "material": bsdf},
        "light": {"type": "constant"},
        "sensor": camera,
        "integrator": {"type": "stokes", "inner": {"type": "direct", "hide_emitters": True}},
    }
    image = np.asarray(mi.render(mi.load_dict(scene), spp=16, seed=1))
    # The picture itself comes first, then red, green and blue of each component.
    return image[..., -12:].reshape(12, 12, 4, 3)[..., :3, 1]


def largest_dolp(bsdf: dict[str, Any]) -> float:
    s0, s1, s2 = np.moveaxis(stokes(bsdf), -1, 0)
    return float((np.hypot(s1, s2) / np.where(s0 > 0, s0, np.inf)).max())


@pytest.mark.parametrize(
    "kind",
    ["roughdielectric", "roughplastic", "plastic", "principled", "thindielectric", "diffuse"],
)
def test_most_bsdfs_depolarise_in_silence(kind: str) -> None:
    assert largest_dolp({"type": kind}) == 0.0


@pytest.mark.parametrize(
    "bsdf", [{"type": "pplastic"}, {"type": "roughconductor", "eta": 1.5, "k": 0.0}]
)
def test_some_bsdfs_polarise(bsdf: dict[str, Any]) -> None:
    # Near the limb a dielectric of 1.5 polarises most of what it mirrors; the body dilutes it.
    assert largest_dolp(bsdf) > 0.1


def test_the_stokes_integrator_writes_srgb_whatever_the_film() -> None:
    """A film of luminance in a spectral variant: three colours a component all the same."""
    mi = mitsuba(SCALAR)
    film = {"type": "hdrfilm", "width": 4, "height": 4, "pixel_format": "luminance"}
    integrator = {"type": "stokes", "inner": {"type": "direct"}}
    scene = mi.load_dict(
        {
            "type": "scene",
            "sphere": {"type": "sphere"},
            "light": {"type": "constant"},
            "sensor": {"type": "orthographic", "film": film},
            "integrator": integrator,
        }
    )
    names = [f"S{component}.{colour}" for component in range(4) for colour in "RGB"]
    assert scene.integrator().aov_names() == names


def test_pplastic_takes_no_spectrum_for_its_index() -> None:
    mi = mitsuba(SCALAR)
    spectrum = {"type": "spectrum", "value": [(400, 1.5), (700, 1.4)]}
    with pytest.raises(RuntimeError, match="int_ior"):
        mi.load_dict({"type": "pplastic", "int_ior": spectrum})


def test_a_batch_gives_a_rolled_sensor_another_frame() -> None:
    """A sphere in uniform light looks the same from a rolled camera; its Stokes vectors too."""
    material = {"type": "pplastic", "alpha": 0.1}
    upright, alone = stokes(material), stokes(material, roll_deg=45)
    batch = stokes(material, roll_deg=45, batch=True)
    noise, off = (np.abs(image - upright)[..., 1:].mean() for image in (alone, batch))
    assert off > 5 * noise  # measured: 12 times; without a roll both are the same to the bit
