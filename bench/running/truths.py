"""Truths of the scenes of a family: what all share is rendered once, then each is made from it.

Nothing that scores is imported here: making a dataset needs none of it.
"""

from __future__ import annotations

import pickle
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache, partial

from malus.bench.running.family_task import FamilyResult
from malus.bench.running.plan import FamilyPlan
from malus.renderers.families.family import RenderedFamily, begin_family, is_complete
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
        renders = renders_of(family, renderer, variant, result, errors)
    if following is not None:
        begin_ahead(following, renderer, variant, errors)
    for scene in scenes:
        truth = None
        with result.guard(scene), result.stage(renders.stage):
            truth = renders.truth_of(scene)
        if truth is not None:
            yield scene, truth


@dataclass(frozen=True)
class Renders:
    """What the scenes of a family share, rendered, and how the truth of each is made of it.

    Attributes
    ----------
    stage : str
        Of the run, in which a truth is made.
    truth_of : function of a scene
    first_scene : Scene
    family : Family or None
        The renders from which all scenes are interpolated, where they are.
    """

    stage: str
    truth_of: Callable[[Scene], Truth]
    first_scene: Scene
    family: Family | None = None

    @cached_property
    def first(self) -> Truth:
        """The truth of the first scene, whose pixels and normals are those of all."""
        return self.truth_of(self.first_scene)


def renders_of(
    family: FamilyPlan, renderer: str, variant: Variant, result: FamilyResult, errors: bool
) -> Renders:
    """Render what all scenes of a family share."""
    if renderer == "torrance-sparrow":
        return Renders(RENDERING[0], render_torrance_sparrow, family.scenes[0])
    with result.stage(RENDERING[0]):
        rendered = _finished(family, variant, errors)
    return _made_of(rendered, family, errors)


def _made_of(rendered: RenderedFamily, family: FamilyPlan, errors: bool) -> Renders:
    family_of_one_surface = rendered if isinstance(rendered, Family) else None
    truth_of = partial(rendered.truth, standard_error=errors)
    return Renders(RENDERING[1], truth_of, family.scenes[0], family_of_one_surface)


@dataclass(frozen=True)
class RenderedApart:
    """Renders of a family for another process, which needs no renderer to make truths of them.

    Attributes
    ----------
    content : bytes
        The renders, pickled: who only hands them on loads nothing.
    seconds : dict of stage to seconds
    """

    content: bytes
    seconds: defaultdict[str, float]

    def renders(self, family: FamilyPlan) -> Renders:
        """The renders, for truths without standard errors."""
        return _made_of(pickle.loads(self.content), family, False)


def rendered_apart(
    family: FamilyPlan, variant: Variant, result: FamilyResult
) -> RenderedApart | None:
    """Render a family for another process, or return None where truths need the renderer again."""
    with result.stage(RENDERING[0]):
        rendered = _finished(family, variant, False)
        if not is_complete(rendered):
            return None
        content = pickle.dumps(rendered, pickle.HIGHEST_PROTOCOL)
    return RenderedApart(content, result.seconds)


def begin_ahead(family: FamilyPlan, renderer: str, variant: Variant, errors: bool) -> None:
    """Begin to render a family, so that `renders_of` finds it in work or done.

    What goes wrong is told by that.
    """
    if renderer == "mitsuba":
        with suppress(Exception):
            _begun(family, variant, errors)


def _finished(family: FamilyPlan, variant: Variant, errors: bool) -> RenderedFamily:
    """Renders of a family, begun before or now; those that failed are begun anew next time."""
    try:
        return _begun(family, variant, errors)()
    except BaseException:
        _begun.cache_clear()
        raise


@lru_cache(maxsize=1)
def _begun(family: FamilyPlan, variant: Variant, errors: bool) -> Callable[[], RenderedFamily]:
    """Renders of a family that were begun; the last one is kept."""
    return cache(begin_family(family.scenes, family.sampling, variant, errors=errors))
