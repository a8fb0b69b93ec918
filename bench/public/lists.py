"""What there is to choose from: suites, studies, methods, materials, shapes, lights, …

Every function returns a dictionary from the name that a suite or a command takes to what it names.
"""

from __future__ import annotations

from typing import Any, get_args

from malus.bench.studies.registry import STUDIES
from malus.bench.studies.study import Study
from malus.reconstruct import Method, methods
from malus.reports.tables.metric_definitions import DEFINITIONS, MetricDefinition
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.model import Model
from malus.scenes.lights.lights import Light
from malus.scenes.maps import ALWAYS, MAPS, MapDefinition
from malus.scenes.materials.albedo import swatches
from malus.scenes.materials.materials import Material, NamedSurface, materials, surfaces
from malus.scenes.materials.metals import Metal, metals
from malus.scenes.sensor import presets
from malus.scenes.shapes.patterns import Pattern
from malus.scenes.shapes.shapes import Shape
from malus.scenes.suite import Suite, load_suite, suite_names


def list_suites() -> dict[str, Suite]:
    """The suites that malus brings, by name.

    Examples
    --------
    >>> list_suites()["quick"].methods
    ('unpolarised', 'eq8', 'visible', 'half_vector')
    """
    return {name: load_suite(name) for name in suite_names()}


def list_studies() -> dict[str, Study]:
    """Benchmarks and studies with cases of their own, by name, for `run_study`.

    Examples
    --------
    >>> list_studies()["stress"].description
    'Stiff and extreme cases, each with its error and a verdict'
    """
    return dict(STUDIES)


def list_methods() -> dict[str, Method]:
    """Methods of reconstruction, by name: those of malus and of installed packages.

    Raises
    ------
    InputError
        If a package names a method that cannot be loaded.

    Examples
    --------
    >>> sorted(list_methods()["half_vector"].needs)
    ['diffuse', 'eta', 'light', 'specular']
    """
    return methods()


def list_metrics() -> dict[str, MetricDefinition]:
    """Metrics of a results table, by name: definition, unit, direction and source.

    A `*` in a name stands for what differs among several, such as the polariser angle.

    Examples
    --------
    >>> list_metrics()["polarscale_psnr"].better
    'higher'
    """
    return {definition.name: definition for definition in DEFINITIONS}


def list_materials() -> dict[str, Material]:
    """Plastics and liquids, by name, with their index of refraction.

    Examples
    --------
    >>> round(list_materials()["pmma"].eta_d, 3)
    1.493
    """
    return dict(materials())


def list_metals() -> dict[str, Metal]:
    """Metals, by name, with their complex index of refraction.

    Examples
    --------
    >>> list_metals()["gold"].eta([550.0]).imag.round(1).tolist()
    [2.5]
    """
    return dict(metals())


def list_surfaces() -> dict[str, NamedSurface]:
    """Surfaces, by name: roughness and albedo.

    Examples
    --------
    >>> 0 < list_surfaces()["rust"].alpha < 1
    True
    """
    return dict(surfaces())


def list_swatches() -> dict[str, Float64Array]:
    """Colours that `albedo` may name: reflectances of shape (36,), every 10 nm from 380 to 730 nm.

    Examples
    --------
    >>> list_swatches()["red"].shape
    (36,)
    """
    return swatches()


def list_patterns() -> dict[str, type[Model]]:
    """Patterns that put several surfaces on one object, by their `kind`.

    Examples
    --------
    >>> sorted(list_patterns())
    ['checker', 'image', 'noise', 'spots', 'stripes']
    """
    return _kinds(Pattern)


def list_shapes() -> dict[str, type[Model]]:
    """Shapes, by their `kind`.

    Examples
    --------
    >>> sorted(list_shapes())
    ['blob', 'lathe', 'mesh', 'sphere', 'superquadric', 'torus']
    """
    return _kinds(Shape)


def list_lights() -> dict[str, type[Model]]:
    """Lights, by their `kind`.

    Examples
    --------
    >>> sorted(list_lights())
    ['area', 'distant', 'environment', 'interior', 'sky', 'uniform']
    """
    return _kinds(Light)


def list_maps() -> dict[str, MapDefinition]:
    """Maps of a dataset by name: those that every one holds, then those that a suite may ask for.

    Examples
    --------
    >>> list_maps()["depth"].unit
    'scene units'
    """
    return ALWAYS | {str(name): definition for name, definition in MAPS.items()}


def list_sensors() -> dict[str, dict[str, Any]]:
    """Published values of polarisation cameras' image sensors, by the name of their `preset`.

    Examples
    --------
    >>> list_sensors()["imx250mzr"]["bit_depth"]
    12
    """
    return presets()


def _kinds(union: object) -> dict[str, type[Model]]:
    """Classes of a union of scene data, by the `kind` that a suite writes."""
    members: tuple[type[Model], ...] = get_args(get_args(union)[0])
    return {str(member.model_fields["kind"].default): member for member in members}
