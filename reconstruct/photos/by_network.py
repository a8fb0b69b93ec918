"""The learned method on a photograph: what it worked with, and what it cannot know, in words."""

from __future__ import annotations

import functools

from malus.reconstruct.learned.net import is_network, weights_of
from malus.reconstruct.learned.network import INSTALL, network, require_runtime
from malus.reconstruct.methods import get_method
from malus.reconstruct.observation import Components, Inapplicable, Observation
from malus.scenes.core.errors import InputError

DEFAULT = "net"
"""Method of a photograph of which nothing is known but the picture."""
CANNOT_KNOW = (
    "it cannot know materials, lights or what a lens did: it learned on rendered scenes how such"
    " pictures are polarised, and where it is unsure its polarisation may be wrong or too weak"
)


def check_side(side: int | None, method: str | None, is_default: bool) -> None:
    """Refuse a size of the network's picture that is none, or that another method would ignore.

    Raises
    ------
    InputError
        Naming the parameter `net_size`.
    """
    if side is None:
        return
    if side < 1:
        raise InputError("net_size", "a number of pixels from 1 on", f"{side}", "correct it")
    if not (is_default or is_network(method)):
        expected = "the method net, which works on a picture made smaller"
        raise InputError(
            "net_size", expected, f"the method {method}" if method else "another", "leave it out"
        )


def by_network(
    observation: Observation, name: str, side: int | None, unused: tuple[str, ...]
) -> tuple[Components, tuple[str, ...], tuple[str, ...]]:
    """Components by a network, statements, and warnings; `unused` names what it is given in vain.

    Raises
    ------
    InputError
        Without the runtime.
    Inapplicable
        As `net` does.
    """
    try:
        require_runtime()
    except Inapplicable:
        hint = f"{INSTALL}, or give `mask` or `normals` and another `method`"
        raise InputError("method net", "the package onnxruntime", "nothing", hint) from None
    method = get_method(name)
    components = functools.partial(method.reconstruct, side=side)(observation)  # type: ignore[call-arg]
    shape = (observation.mask.shape[0], observation.mask.shape[1])
    seen = network(weights_of(name)).about.sizes(shape, side)
    sizes = ", ".join(f"{width} x {height}" for height, width in seen)
    statements = (
        f"method {method.name}: {method.summary}",
        f"the network saw {sizes} pixels; its ratios are interpolated between them",
        CANNOT_KNOW,
    )
    warnings = (f"the network does not use {', '.join(unused)}",) if unused else ()
    return components, statements, warnings
