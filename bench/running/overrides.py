"""A suite with the user's own sizes, seed and methods in place of its own."""

from __future__ import annotations

from typing import Any

from malus.renderers.variant import Variant
from malus.scenes.suite import Suite


def overridden(suite: Suite, overrides: dict[str, Any], variant: Variant) -> Suite:
    """The suite with the user's overrides, and its own smaller sizes where no array variant runs.

    Raises
    ------
    InputError
        If a value is not valid.
    """
    data = suite.model_dump(mode="json")
    smaller = suite.scalar if suite.scalar and not variant.vectorised else None
    if smaller:
        data["camera"]["resolution"] = smaller.resolution
        data["sampling"]["samples"] = smaller.samples
        data["description"] += f" ({smaller.note})"
    for section, key in (("sampling", "samples"), ("camera", "resolution"), ("sampling", "seed")):
        if overrides.get(key) is not None:
            data[section][key] = overrides[key]
    if overrides.get("methods"):
        data["methods"] = list(overrides["methods"])
    return Suite.parse(data, "command line")
