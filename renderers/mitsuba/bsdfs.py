"""Mitsuba BSDFs that are loaded once; new parameters need no new kernel."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from malus.renderers.mitsuba.measured_bsdf import measured_bsdfs
from malus.renderers.mitsuba.translate import diffuse_bsdf, specular_bsdf
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.surface import AnyBody, Distribution, Facets

Index = float | complex


def bsdfs(
    variant: Variant,
    etas: Sequence[Index],
    facets: Facets,
    body: AnyBody,
    measured: Measured | None = None,
) -> tuple[list[Any], list[Any]]:
    """BSDFs of both lobes at the given indices; one diffuse BSDF where it does not depend on η.

    For a `measured` material, `etas` are wavelengths in nm, and its table stands in place of the
    specular lobe.
    """
    mi = mitsuba(variant)
    if measured is not None:
        return measured_bsdfs(variant, measured, tuple(etas)), [_pool(variant, 1, body)[0][0]]
    along, across = facets.alphas
    kind = facets.distribution, along == across
    specular = _pool(variant, len(etas), None, body == "none", *kind)
    diffuse = _pool(variant, len(etas) if body == "polarised" else 1, body)
    _update(mi, specular, etas, facets.alphas)
    if body == "polarised":
        _update(mi, diffuse, etas, facets.alphas)
    return [bsdf for bsdf, _ in specular], [bsdf for bsdf, _ in diffuse]


@functools.lru_cache(maxsize=32)
def _pool(
    variant: Variant,
    count: int,
    body: AnyBody | None,
    metal: bool = False,
    distribution: Distribution = "beckmann",
    isotropic: bool = True,
) -> list[tuple[Any, Any]]:
    """BSDFs of a lobe, specular where `body` is None, each with its parameters.

    The parameters are kept because asking Mitsuba for them takes as long as setting them.
    """
    mi = mitsuba(variant)
    any_index: Index = 1.5 + 1j if metal else 1.5
    facets = Facets((0.3, 0.3 if isotropic else 0.4), distribution)
    description = (
        specular_bsdf(any_index, facets) if body is None else diffuse_bsdf(any_index, facets, body)
    )
    loaded = [mi.load_dict(description) for _ in range(count)]
    return [(bsdf, mi.traverse(bsdf)) for bsdf in loaded]


def _update(
    mi: ModuleType,
    pool: Sequence[tuple[Any, Any]],
    etas: Sequence[Index],
    alphas: tuple[float, float],
) -> None:
    """Set index and roughness of every BSDF of a pool."""
    import drjit as dr

    # The same variable in every BSDF: Dr.Jit then computes the facet distribution only once.
    along, across = (dr.opaque(mi.Float, alpha) for alpha in alphas)
    for (_, parameters), eta in zip(pool, etas, strict=True):
        parameters["eta.value"] = dr.opaque(mi.Float, eta.real)
        if isinstance(eta, complex):
            parameters["k.value"] = dr.opaque(mi.Float, eta.imag)
        if "alpha.value" in parameters:
            parameters["alpha.value"] = along
        else:
            parameters["alpha_u.value"], parameters["alpha_v.value"] = along, across
        parameters.update()
