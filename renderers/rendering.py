"""Render one scene, by Mitsuba or from the Torrance-Sparrow formulas."""

from __future__ import annotations

from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, chosen_variant
from malus.scenes.core.errors import InputError, check_kind
from malus.scenes.scene import Sampling, Scene


def render(
    scene: Scene,
    sampling: Sampling | None = None,
    renderer: str = "mitsuba",
    backend: str | Variant = "auto",
) -> Truth:
    """Render the truth of one scene.

    Parameters
    ----------
    scene : Scene
        What to look at.
    sampling : Sampling, optional
        Samples a pixel and seed; the Torrance-Sparrow renderer ignores it.
    renderer : 'mitsuba' or 'torrance-sparrow'
        The second is for spheres under distant lights, without Mitsuba.
    backend : 'auto', 'cuda', 'llvm' or 'scalar'
        What Mitsuba renders with; by default the fastest that works.

    Returns
    -------
    Truth
        Stokes images of both lobes, normals, and the noise.

    Raises
    ------
    InputError
        No scene or sampling, an unknown renderer or backend, or a scene that it cannot render.

    Examples
    --------
    >>> from malus.scenes import Camera, Dielectric, Scene, Sphere, Uniform
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3), light=Uniform(),
    ...               camera=Camera(resolution=8))
    >>> render(scene).image.shape
    (8, 8, 1)
    """
    sampling = Sampling() if sampling is None else sampling
    hint = "`malus.run` and `malus.render_dataset` render the scenes of a suite"
    check_kind("scene", scene, Scene, hint)
    check_kind("sampling", sampling, Sampling, "give malus.Sampling(samples=…, seed=…)")
    if renderer == "torrance-sparrow":
        return render_torrance_sparrow(scene)
    if renderer != "mitsuba":
        raise InputError("renderer", "mitsuba or torrance-sparrow", renderer, "choose one of them")
    from malus.renderers.families.family import render_family

    return render_family([scene], sampling, chosen_variant(backend)).truth(scene)
