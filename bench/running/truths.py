"""Truths of the scenes of a family: what all share is rendered once, then each is made from it.

Nothing that scores is imported here: making a dataset needs none of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache, lru_cache, partial

from malus.bench.running.family_task import FamilyResult
from malus.bench.running.plan import FamilyPlan
from malus.renderers.families.family import RenderedFamily, begin_family
from malus.renderers.families.interpolated import Family
from malus.renderers.mitsuba.translate import tessellated_ahead
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant
from malus.scenes.scene import Scene

RENDERING = ("render", "interpolate in eta")
"""Stages that make the truths."""


def truths(
    family: FamilyPlan,
    scenes: Iterable[Scene],
    renderer: str,
    variant: Variant,
    result: FamilyResult,
    errors: bool = False,
    following: FamilyPlan | None = None,
) -> Iterator[tuple[Scene, Truth]]:
    """Truths of some scenes of a family; those that fail are recorded in `result` and left out.

    All of the family is rendered, because its nodes in η follow from all of its scenes. Standard
    errors cost time, and no score needs them: they are zero without `errors`. The mesh of the
    family that is `following` is made while this one is rendered, and its kernels run while truths
    are made.
    """
    next_shape = following.scenes[0].shape if following and renderer == "mitsuba" else None
    another = next_shape if next_shape != family.scenes[0].shape else None
    with tessellated_ahead(another):
        stage, truth_of, _ = renderer_of(family, renderer, variant, result, errors)
    if following is not None:
        begin_ahead(following, renderer, variant, errors)
    for scene in scenes:
        truth = None
        with result.guard(scene), result.stage(stage):
            truth = truth_of(scene)
        if truth is not None:
            yield scene, truth


def renderer_of(
    family: FamilyPlan, renderer: str, variant: Variant, result: FamilyResult, errors: bool
) -> tuple[str, Callable[[Scene], Truth], Family | None]:
    """Function that makes the truth of a scene, and its stage; renders what all scenes share.

    The third value are the renders where scenes are interpolated from them.
    """
    if renderer == "torrance-sparrow":
        return RENDERING[0], render_torrance_sparrow, None
    with result.stage(RENDERING[0]):
        rendered = _begun(family, variant, errors)()
    family_of_one_surface = rendered if isinstance(rendered, Family) else None
    return RENDERING[1], partial(rendered.truth, standard_error=errors), family_of_one_surface


def begin_ahead(family: FamilyPlan, renderer: str, variant: Variant, errors: bool) -> None:
    """Begin to render a family, so that `renderer_of` finds it in work or done.

    What goes wrong is told by that.
    """
    if renderer == "mitsuba":
        with suppress(Exception):
            _begun(family, variant, errors)


@lru_cache(maxsize=1)
def _begun(family: FamilyPlan, variant: Variant, errors: bool) -> Callable[[], RenderedFamily]:
    """Renders of a family that were begun; the last one is kept."""
    return cache(begin_family(family.scenes, family.sampling, variant, errors=errors))
