"""Suites: lists of shapes, materials, lights, ... whose product is the scenes, and the methods.

A random suite has ranges and choices in place of lists: see `malus.scenes.random_suite`.

A suite is a TOML file; files that it names are found from its folder and become part of its id by
their content.
"""

from __future__ import annotations

import itertools
import math
import tomllib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import Field, ValidationInfo, field_validator, model_validator

from malus.scenes.camera import Camera, Views
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.model import Model
from malus.scenes.core.registry import FolderName
from malus.scenes.core.validation import near
from malus.scenes.lights.lights import Environment, Light
from malus.scenes.maps import MapNames
from malus.scenes.materials.measured import Measured, open_pbrdf
from malus.scenes.materials.surface import Body, Surface
from malus.scenes.random_suite.random_scenes import (
    RandomScenes,
    SceneDraws,
    least_and_most_pixels,
)
from malus.scenes.random_suite.splits import DRAWN_MATERIALS, Splits, refuse_own_values
from malus.scenes.scene import DEPTH_AMONG_OBJECTS, Sampling, Scene, Wavelengths
from malus.scenes.sensor import Sensor, located
from malus.scenes.shapes.patterns import ImageTexture
from malus.scenes.shapes.shapes import MeshFile, Shape
from malus.scenes.suite_surfaces import (
    ALL_MATERIALS,
    ALL_SURFACES,
    SuiteMaterial,
    SuiteSurface,
    scene_surface,
    stand_in,
)
from malus.scenes.surroundings import Placed, Surroundings

_AXES = ("shapes", "materials", "surfaces", "lights", "bodies", "surroundings", "views")
_BODIES: tuple[Body, ...] = ("unpolarised",)
AnyShape = TypeVar("AnyShape", bound=Model)
Renderer = Literal["mitsuba", "torrance-sparrow"]
Knowledge = Literal["everything", "ladder"]
"""Whether methods get every input exactly, or are also scored on the ladder of estimated inputs."""

MAX_SUITE_BYTES = 1 << 20
MOST_SCENES = 10_000_000
"""Most scenes of a suite: a plan holds every one of them in memory."""


def _is_empty(value: Any) -> bool:
    return not value


class ScalarSizes(Model):
    """Smaller images and fewer samples where only the scalar variant runs, ten times slower."""

    samples: int = Field(ge=2, multiple_of=2)
    resolution: int = Field(ge=1)

    @property
    def note(self) -> str:
        """Note for the description when these sizes are used."""
        return (
            f"reduced to {self.resolution}² pixels and {self.samples} samples, because only the "
            "scalar variant runs here; `malus doctor` tells how to mend it"
        )


class Suite(Model):
    """Lists whose product is the scenes, and the methods and metrics that score them.

    `"all"` as `materials` or `surfaces` stands for every one that malus brings. With `random` the
    scenes are drawn instead, and may belong to `splits`. `maps` and `sensor` say what a dataset
    holds beside its Stokes images, `licence` is that of a dataset; runs ignore them.

    Examples
    --------
    >>> len(list(load_suite("quick").scenes())) > 0
    True
    """

    name: FolderName = Field(min_length=1, max_length=100)
    description: str = ""
    shapes: tuple[Shape, ...] = Field(default=(), min_length=1, exclude_if=_is_empty)
    materials: Annotated[tuple[SuiteMaterial, ...], ALL_MATERIALS] = Field(
        default=(), min_length=1, exclude_if=_is_empty
    )
    surfaces: Annotated[tuple[SuiteSurface, ...], ALL_SURFACES] = Field(
        default=(), min_length=1, exclude_if=_is_empty
    )
    lights: tuple[Light, ...] = Field(default=(), min_length=1, exclude_if=_is_empty)
    bodies: tuple[Body, ...] = Field(default=_BODIES, min_length=1)
    surroundings: tuple[Surroundings, ...] = Field(default=(), exclude_if=_is_empty)
    random: RandomScenes | None = Field(default=None, exclude_if=_is_empty)
    splits: Splits | None = Field(default=None, exclude_if=_is_empty)
    licence: str = Field(default="", max_length=1000, exclude_if=_is_empty)
    wavelengths_nm: Wavelengths
    methods: tuple[str, ...] = Field(min_length=1)
    metrics: tuple[str, ...] = ()
    renderer: Renderer = "mitsuba"
    knowledge: Knowledge = Field(
        default="everything", exclude_if=lambda knowledge: knowledge == "everything"
    )
    camera: Camera = Camera()
    views: Views | None = Field(default=None, exclude_if=lambda value: value is None)
    sampling: Sampling = Sampling()
    scalar: ScalarSizes | None = None
    maps: MapNames = Field(default=(), exclude_if=lambda names: not names)
    sensor: Sensor | None = Field(default=None, exclude_if=lambda sensor: sensor is None)

    @field_validator("methods", "metrics")
    @classmethod
    def _each_once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(names))

    @field_validator("sampling")
    @classmethod
    def _usual_depth(cls, sampling: Sampling, info: ValidationInfo) -> Sampling:
        # Named or left out, the usual depth among objects is the same, and so is the suite's id.
        usual = sampling.max_depth == DEPTH_AMONG_OBJECTS and info.data.get("surroundings")
        return sampling.model_copy(update={"max_depth": None}) if usual else sampling

    @model_validator(mode="after")
    def _axes_or_random(self) -> Self:
        given = [axis for axis in _AXES if getattr(self, axis) not in ((), _BODIES, None)]
        if self.random is not None:
            if given:
                hint = f"move {given[0]} below [random]"
                raise InputError(f"key {given[0]}", "no axis beside [random]", "one", hint)
            return self
        for axis in _AXES[:4]:
            if not getattr(self, axis):
                raise InputError(f"key {axis}", "this key", "nothing", "add this key")
        if self.splits is not None:
            hint = "remove it, or draw the scenes with [random]"
            raise InputError("key splits", "splits of random scenes only", "no [random]", hint)
        return self

    @model_validator(mode="after")
    def _scenes_fit(self) -> Self:
        if self.draws is not None:
            if self.random is not None and self.splits is not None:
                items = {name: self.random.items(name) for name in DRAWN_MATERIALS}
                refuse_own_values(items, self.splits)
            for key, content in self.draws.examples():
                for placed in self.draws.made(content, key).objects:
                    placed.surface.indices(self.wavelengths_nm)
            return self
        axes = self.shapes, self.surroundings or (None,), self.lights, self.surfaces, self.bodies
        count = math.prod(map(len, axes)) * len(self.materials) * len(self._cameras)
        if count > MOST_SCENES:
            raise ValueError(f"at most {MOST_SCENES:,} scenes, which are {count:,} here")
        # Every item once is enough, and stays quick where the axes multiply to very many.
        materials = ((material, self.surfaces[0]) for material in self.materials)
        surfaces = ((stand_in(self.materials), surface) for surface in self.surfaces)
        for material, surface in itertools.chain(materials, surfaces):
            for surroundings in axes[1]:
                made_of = scene_surface(material, surface, self.bodies[0])
                camera = self._cameras[0]
                scene = self._scene(self.shapes[0], surroundings, camera, self.lights[0], made_of)
                for placed in scene.objects:
                    placed.surface.indices(self.wavelengths_nm)
        return self

    @property
    def draws(self) -> SceneDraws | None:
        """The scenes of a random suite by their numbers; None for a suite of axes."""
        if self.random is None:
            return None
        return self.random.draws(self.camera, self.wavelengths_nm, self.splits)

    @model_validator(mode="after")
    def _sensor_fits(self) -> Self:
        if self.sensor is not None:
            self.sensor.check_fits(self.wavelengths_nm, self.least_and_most_pixels[0])
        return self

    @property
    def least_and_most_pixels(self) -> tuple[int, int]:
        """Pixels a side of the smallest and of the largest picture, which differ where drawn."""
        cameras = self.random.cameras if self.random else ()
        return least_and_most_pixels(self.camera.resolution, cameras)

    @property
    def scene_count(self) -> int:
        """How many scenes there are; those of a random suite are not drawn for it."""
        return self.random.count if self.random else sum(1 for _ in self.scenes())

    def scenes(self) -> Iterator[Scene]:
        """All distinct scenes, those of one family of renders one after another."""
        if self.random is not None and self.draws is not None:
            yield from map(self.draws.scene, range(self.random.count))
            return
        around = self.surroundings or (None,)
        families = itertools.product(
            self.shapes, around, self._cameras, self.lights, self.surfaces, self.bodies
        )
        yielded = set()
        for shape, surroundings, camera, light, surface, body in families:
            for material in self.materials:
                made_of = scene_surface(material, surface, body)
                scene = self._scene(shape, surroundings, camera, light, made_of)
                # A metal has no body: its scene is the same for every body.
                if scene not in yielded:
                    yielded.add(scene)
                    yield scene

    @model_validator(mode="after")
    def _views_or_a_moved_camera(self) -> Self:
        if self.views and self.camera.moved:
            raise ValueError("no azimuth_deg and elevation_deg of the camera beside views")
        return self

    @property
    def _cameras(self) -> tuple[Camera, ...]:
        return self.views.cameras(self.camera) if self.views else (self.camera,)

    def _scene(
        self,
        shape: Shape,
        surroundings: Surroundings | None,
        camera: Camera,
        light: Light,
        surface: Surface,
    ) -> Scene:
        content = {
            "shape": shape,
            "surface": surface,
            "light": light,
            "camera": camera,
            "wavelengths_nm": self.wavelengths_nm,
            "surroundings": surroundings,
        }
        return Scene.parse(content, f"suite {self.name}")


def suite_names() -> tuple[str, ...]:
    """Names of the suites that malus brings.

    Examples
    --------
    >>> "fig5" in suite_names()
    True
    """
    folder = resources.files("malus.scenes") / "suites"
    names = (entry.name for entry in folder.iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml")))


def load_suite(name_or_path: str | Path) -> Suite:
    """Read and validate a suite, by the name of one that malus brings or by a TOML file's path.

    Parameters
    ----------
    name_or_path : str or Path
        Such as `quick`, or `drawn.toml`.

    Returns
    -------
    Suite
        The suite, with every value checked.

    Raises
    ------
    InputError
        Unknown suite, unreadable or malformed file, wrong key or value: one line that names the
        file, the key, what was expected and what was found.

    Examples
    --------
    >>> load_suite("quick").name
    'quick'
    """
    text, where = _suite_text(name_or_path)
    with reading(where, "a TOML file", "correct the syntax"):
        data = tomllib.loads(text)
    suite = Suite.parse(data, where)
    code = [name for name in suite.methods if ":" in name]
    if code:
        hint = "a suite names no code: leave it out, and name it as a method of the run"
        raise InputError(f"{where}, key methods", "names of methods", code[0], hint)
    folder = Path(where).parent
    if suite.sensor is not None:
        sensor = located(suite.sensor, folder, where)
        sensor.check_fits(suite.wavelengths_nm, suite.least_and_most_pixels[0])
        suite = suite.model_copy(update={"sensor": sensor})
    shapes = tuple(_with_mesh(shape, folder) for shape in suite.shapes)
    lights = tuple(_with_map(light, folder) for light in suite.lights)
    surfaces = tuple(_with_picture(surface, folder) for surface in suite.surfaces)
    bands = suite.wavelengths_nm
    materials = tuple(_with_measured_table(item, folder, bands) for item in suite.materials)
    around = tuple(_with_files(surroundings, folder) for surroundings in suite.surroundings)
    files: dict[str, Any] = {
        "shapes": shapes,
        "materials": materials,
        "lights": lights,
        "surfaces": surfaces,
    }
    if suite.random is not None:
        files = {"random": suite.random.with_files(folder)}
    return suite.model_copy(update=files | {"surroundings": around})


def _suite_text(name_or_path: str | Path) -> tuple[str, str]:
    """Text of a suite's file, and its path."""
    if str(name_or_path) in suite_names():
        entry = resources.files("malus.scenes") / "suites" / f"{name_or_path}.toml"
        return entry.read_text("utf-8"), str(entry)
    path = Path(name_or_path)
    if path.suffix != ".toml":
        raise InputError(
            "suite",
            f"one of {', '.join(suite_names())}, or the path of a .toml file",
            str(name_or_path),
            near(str(name_or_path), suite_names()) or "`malus list suites` shows them",
        )
    with reading(str(path), "a readable file", "check the path"), path.open("rb") as file:
        raw = file.read(MAX_SUITE_BYTES + 1)
    if len(raw) > MAX_SUITE_BYTES:
        raise InputError(str(path), "at most 1 MiB", "a larger file", "is this a suite?")
    try:
        return raw.decode("utf-8"), str(path)
    except UnicodeDecodeError:
        raise InputError(str(path), "UTF-8 text", "other bytes", "save it as UTF-8") from None


def _with_files(surroundings: Surroundings, folder: Path) -> Surroundings:
    """Surroundings whose files have their folders and their digests."""

    def with_files(placed: Placed) -> Placed:
        files = {"shape": _with_mesh(placed.shape, folder)}
        return placed.model_copy(update=files | {"surface": _with_picture(placed.surface, folder)})

    objects = tuple(with_files(placed) for placed in surroundings.objects)
    return surroundings.model_copy(update={"objects": objects})


def _with_mesh(shape: AnyShape, folder: Path) -> AnyShape:
    """A shape whose mesh file, if any, has its folder and its digest."""
    if not isinstance(shape, MeshFile):
        return shape
    return shape.located(folder)


def _with_picture(surface: Any, folder: Path) -> Any:
    """A surface whose picture, if any, has its folder and its digest."""
    pattern = getattr(surface, "pattern", None)
    if not isinstance(pattern, ImageTexture):
        return surface
    return surface.model_copy(update={"pattern": pattern.located(folder)})


def _with_measured_table(
    material: SuiteMaterial, folder: Path, wavelengths_nm: Wavelengths
) -> SuiteMaterial:
    """A material whose measured table, if any, has its folder, its digest, and the bands."""
    if not isinstance(material, Measured):
        return material
    found = material.located(folder)
    open_pbrdf(found.file).check_bands(wavelengths_nm)
    return found


def _with_map(light: Light, folder: Path) -> Light:
    """A light whose radiance map, if it is a file, has its folder and its digest."""
    if not isinstance(light, Environment) or light.file_name is None:
        return light
    return light.located(folder)
