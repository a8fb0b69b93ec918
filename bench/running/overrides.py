"""From a user's choices of sizes, seed, methods and metrics to a Suite."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from malus.renderers.variant import Variant
from malus.scenes.core.registry import several
from malus.scenes.suite import Suite, load_suite


def chosen_suite(
    suite: Suite | str | Path,
    variant: Variant,
    *,
    samples: int | None = None,
    resolution: int | None = None,
    seed: int | None = None,
    methods: Sequence[str] = (),
    metrics: Sequence[str] = (),
) -> Suite:
    """A suite with some of its values replaced.

    Parameters
    ----------
    suite : Suite, or the name of one that malus brings, or the path of a TOML file
        One that is named takes its own smaller sizes where no array variant renders; a Suite is
        taken as it is.
    variant : Variant
    samples, resolution, seed : int, optional
        Samples a pixel, pixels a side, and seed, in place of the suite's.
    methods : sequence of str
        Names of methods, or one, in place of the suite's; empty leaves those.
    metrics : sequence of str
        Names of metrics besides the suite's. With a profile the trivial guess is scored too.

    Raises
    ------
    InputError
        Unknown suite, unreadable file, or a value that is not valid.

    Examples
    --------
    >>> suite = chosen_suite("quick", Variant("scalar_spectral_polarized", "asked for"), seed=7)
    >>> suite.name, suite.sampling.seed
    ('quick', 7)
    """
    values = {"samples": samples, "resolution": resolution, "seed": seed}
    loaded = suite if isinstance(suite, Suite) else load_suite(suite)
    all_metrics = tuple(dict.fromkeys((*loaded.metrics, *several(metrics))))
    all_methods = several(methods) or loaded.methods
    if all_metrics:  # what scores takes its time to import
        from malus.bench.scoring.extra_metrics import with_guess

        all_methods = with_guess(all_methods, all_metrics)
    changed = (all_methods, all_metrics) != (loaded.methods, loaded.metrics)
    given = changed or any(value is not None for value in values.values())
    if isinstance(suite, Suite) and not given:
        return suite
    data: dict[str, Any] = loaded.model_dump(mode="json")
    if not isinstance(suite, Suite) and loaded.scalar and not variant.vectorised:
        data["camera"]["resolution"] = loaded.scalar.resolution
        data["sampling"]["samples"] = loaded.scalar.samples
        data["description"] += f" ({loaded.scalar.note})"
    for section, key in (("sampling", "samples"), ("camera", "resolution"), ("sampling", "seed")):
        if values[key] is not None:
            data[section][key] = values[key]
    data["methods"], data["metrics"] = list(all_methods), list(all_metrics)
    asked = Suite.parse(data, "the values asked for")
    # Its files are those of the suite that was loaded: data do not tell in which folder they lie.
    changes = ("description", "camera", "sampling", "methods", "metrics")
    return loaded.model_copy(update={name: getattr(asked, name) for name in changes})
