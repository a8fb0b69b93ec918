"""Recorded calls into Mitsuba, played again for other families, give what tracing them gives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from malus.renderers.mitsuba import shading, wavefront
from malus.renderers.mitsuba.bsdfs import bsdfs
from malus.renderers.mitsuba.lighting import radiance_map_of
from malus.renderers.mitsuba.lobe_samples import Lobes
from malus.renderers.variant import Variant, choose, mitsuba
from malus.scenes import (
    Area,
    Camera,
    Distant,
    Environment,
    Sampling,
    Sky,
    Sphere,
    Torus,
    Uniform,
)
from malus.scenes.lights.lights import Light
from malus.scenes.materials.surface import Body, Facets

CAMERA = Camera(resolution=12)
FAMILIES: list[tuple[Light, Body]] = [
    (Distant(incidence_deg=60), "polarised"),
    (Uniform(), "unpolarised"),
    (Area(incidence_deg=30), "polarised"),
    (Environment(), "unpolarised"),
    (Environment(turn_deg=70.0), "unpolarised"),
    (Sky(sun=False), "unpolarised"),  # a map of another resolution
]


@pytest.fixture
def variant() -> Variant:
    best = choose()
    if not best.vectorised:
        pytest.skip("only the scalar variant runs here")
    return best


def lobes(
    stage: wavefront.Stage,
    variant: Variant,
    light: Light,
    body: Body,
    turn: int,
    samples: int,
    seed: int | None = None,
) -> Lobes:
    etas, alpha = (1.4 + 0.1 * turn, 1.6), 0.2 + 0.1 * turn
    lit = shading.Shading(*bsdfs(variant, etas, Facets((alpha, alpha)), body), errors=True)
    return stage.render(light, lit, Sampling(samples=samples, seed=turn if seed is None else seed))


def arrays(found: Lobes) -> dict[str, Any]:
    values = vars(found).items()
    return {name: array.copy() for name, array in values if isinstance(array, np.ndarray)}


def test_what_is_played_again_is_what_is_traced(variant: Variant) -> None:
    """To the bit, with other indices, roughness, seeds and numbers of samples and pixels.

    Lights and bodies take turns, so that a recording of another kind would be found out, and what
    was rendered first is looked at last, so that nobody writes over it.
    """
    maps = {radiance_map_of(light) for light, _ in FAMILIES}
    recording, tracing = (
        {around: wavefront.Stage(mitsuba(variant), Sphere(), CAMERA, around) for around in maps}
        for _ in range(2)
    )
    for stage in tracing.values():
        stage._replay = shading.shade
    found = []
    for turn, samples in enumerate((2, 2, 6)):
        for light, body in FAMILIES:
            around = radiance_map_of(light)
            once = lobes(recording[around], variant, light, body, turn, samples)
            traced = lobes(tracing[around], variant, light, body, turn, samples)
            found.append((once, arrays(traced)))
    assert len({len(once.pixels) for once, _ in found}) > 1  # samples of the rim hit more pixels
    for once, traced in found:
        for name, values in traced.items():
            np.testing.assert_array_equal(getattr(once, name), values, err_msg=name)


def test_other_parameters_are_traced_only_once(
    variant: Variant, monkeypatch: pytest.MonkeyPatch
) -> None:
    traced = []
    sample = shading._sample
    monkeypatch.setattr(shading, "_sample", lambda *a: traced.append(1) or sample(*a))
    stage = wavefront.Stage(mitsuba(variant), Sphere(), CAMERA)
    counts = []
    for turn in range(5):
        light = Distant(incidence_deg=10.0 * turn, azimuth_deg=30.0 * turn, irradiance=1.0 + turn)
        stage.render(
            light,
            shading.Shading(
                *bsdfs(variant, (1.4 + 0.1 * turn,), Facets((0.1 + 0.1 * turn,) * 2), "polarised"),
                False,
            ),
            Sampling(samples=2),
        )
        counts.append(len(traced))
    assert counts[-1] == counts[1]  # the second call may find that a constant varies
    assert stage._replay.n_cached_recordings <= 2


def test_a_stage_remembers_only_so_many(variant: Variant, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wavefront, "RECORDINGS", 2)
    stage = wavefront.Stage(mitsuba(variant), Sphere(), CAMERA)
    for light, body in FAMILIES:
        if radiance_map_of(light) is None:
            lobes(stage, variant, light, body, 0, 2)
    assert stage._replay.n_cached_recordings <= 2


def test_kept_hits_and_shadows_are_those_that_are_traced(
    variant: Variant, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the bit, for lights and surfaces that take turns on a shape that shades itself."""
    if not variant.name.startswith("llvm"):
        pytest.skip("hits are kept on the CPU only")
    lights: list[Light] = [
        Distant(incidence_deg=60),
        Distant(incidence_deg=80),
        Uniform(),
        Area(incidence_deg=30),
    ]

    def renders(stage: wavefront.Stage) -> list[Lobes]:
        turns = [(light, turn) for turn in range(2) for light in lights]
        return [lobes(stage, variant, light, "polarised", turn, 8, seed=1) for light, turn in turns]

    def stage() -> wavefront.Stage:
        return wavefront.Stage(mitsuba(variant), Torus(), CAMERA)

    keeping = stage()
    kept = renders(keeping)
    (touched,) = keeping._touched.values()
    assert [bool(np.array(hidden).any()) for hidden in touched.hidden.values()] == [True, True]
    monkeypatch.setattr(wavefront, "MOST_KEPT_HITS", 0)
    for found, expected in zip(kept, renders(stage()), strict=True):
        for name, values in arrays(expected).items():
            assert np.array_equal(arrays(found)[name], values), name
