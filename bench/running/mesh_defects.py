"""What is wrong with the mesh files of a suite."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

from malus.scenes.scene import Scene
from malus.scenes.shapes.meshes import NO_NORMALS, load_mesh
from malus.scenes.shapes.shapes import MeshFile

MOST_READ = 20
"""Most mesh files that are read: a set of random scenes may draw from thousands."""


def mesh_defects(scenes: Iterable[Scene]) -> dict[str, list[str]]:
    """Defects of the first `MOST_READ` mesh files of scenes, by path; sound ones are left out.

    That a file has no normals is none: others than those of the file are used then.

    Examples
    --------
    >>> from malus.scenes import Dielectric, Sphere, Uniform
    >>> paint = Dielectric(eta=1.5, alpha=0.3)
    >>> mesh_defects([Scene(shape=Sphere(), surface=paint, light=Uniform())])
    {}
    """
    shapes = (placed.shape for scene in scenes for placed in scene.objects)
    distinct = dict.fromkeys(shape for shape in shapes if isinstance(shape, MeshFile))
    found: dict[str, list[str]] = {}
    for shape in islice(distinct, MOST_READ):
        defects = load_mesh(shape.checked(), shape.shading, shape.up)[1]
        if serious := [defect for defect in defects if defect != NO_NORMALS]:
            found[str(shape.file)] = serious
    return found
