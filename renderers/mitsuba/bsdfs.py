"""Pools of Mitsuba BSDFs whose parameters change without a new kernel."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from malus.renderers.mitsuba.measured_bsdf import measured_bsdfs
from malus.renderers.mitsuba.translate import diffuse_bsdf, specular_bsdf
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.surface import AnyBody

Index = float | complex


def bsdfs(
    variant: Variant,
    etas: Sequence[Index],
    alpha: float,
    body: AnyBody,
    measured: Measured | None = None,
) -> tuple[list[Any], list[Any]]:
    """Interface and body BSDFs at the given indices; one body where it does not depend on η.

    Of a `measured` material, at the given wavelengths in nm, in place of the interface.
    """
    mi = mitsuba(variant)
    if measured is not None:
        return measured_bsdfs(variant, measured, tuple(etas)), [_pool(variant, 1, body)[0][0]]
    interface = _pool(variant, len(etas), None, body == "none")
    scattering = _pool(variant, len(etas) if body == "polarised" else 1, body)
    _update(mi, interface, etas, alpha)
    if body == "polarised":
        _update(mi, scattering, etas, alpha)
    return [bsdf for bsdf, _ in interface], [bsdf for bsdf, _ in scattering]


@functools.lru_cache(maxsize=32)
def _pool(
    variant: Variant, count: int, body: AnyBody | None, metal: bool = False
) -> list[tuple[Any, Any]]:
    """BSDFs, each with its parameters: to ask a BSDF for them takes as long as to set them."""
    mi = mitsuba(variant)
    some: Index = 1.5 + 1j if metal else 1.5
    describe = specular_bsdf(some, 0.3) if body is None else diffuse_bsdf(some, 0.3, body)
    loaded = [mi.load_dict(describe) for _ in range(count)]
    return [(bsdf, mi.traverse(bsdf)) for bsdf in loaded]


def _update(
    mi: ModuleType, pool: Sequence[tuple[Any, Any]], etas: Sequence[Index], alpha: float
) -> None:
    import drjit as dr

    # The same variable in every BSDF: Dr.Jit then computes the facet distribution only once.
    shared_alpha = dr.opaque(mi.Float, alpha)
    for (_, parameters), eta in zip(pool, etas, strict=True):
        parameters["eta.value"] = dr.opaque(mi.Float, eta.real)
        if isinstance(eta, complex):
            parameters["k.value"] = dr.opaque(mi.Float, eta.imag)
        parameters["alpha.value"] = shared_alpha
        parameters.update()
