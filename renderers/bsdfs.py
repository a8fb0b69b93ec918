"""Pools of Mitsuba BSDFs whose parameters change without a new kernel."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from malus.renderers.translate import body_bsdf, interface_bsdf
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.surface import Body


def bsdfs(
    variant: Variant, etas: Sequence[float], alpha: float, body: Body
) -> tuple[list[Any], list[Any]]:
    """Interface and body BSDFs at the given indices; one body where it does not depend on η."""
    mi = mitsuba(variant)
    interface = _pool(variant, len(etas), None)
    scattering = _pool(variant, 1 if body == "unpolarised" else len(etas), body)
    _update(mi, interface, etas, alpha)
    if body == "polarised":
        _update(mi, scattering, etas, alpha)
    return interface, scattering


@functools.lru_cache(maxsize=32)
def _pool(variant: Variant, count: int, body: Body | None) -> list[Any]:
    mi = mitsuba(variant)
    describe = interface_bsdf(1.5, 0.3) if body is None else body_bsdf(1.5, 0.3, body)
    return [mi.load_dict(describe) for _ in range(count)]


def _update(mi: ModuleType, pool: Sequence[Any], etas: Sequence[float], alpha: float) -> None:
    import drjit as dr

    # The same variable in every BSDF: Dr.Jit then computes the facet distribution only once.
    shared_alpha = dr.opaque(mi.Float, alpha)
    for bsdf, eta in zip(pool, etas, strict=True):
        parameters = mi.traverse(bsdf)
        parameters["eta.value"] = dr.opaque(mi.Float, eta)
        parameters["alpha.value"] = shared_alpha
        parameters.update()
