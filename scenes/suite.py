"""A suite: axes whose product is the scenes, the methods to score, and the sampling."""

from __future__ import annotations

import itertools
import math
import tomllib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

from pydantic import Field, field_validator, model_validator

from malus.scenes.camera import Camera
from malus.scenes.core.errors import InputError
from malus.scenes.core.model import Model
from malus.scenes.core.named_file import digest_of
from malus.scenes.core.registry import FolderName
from malus.scenes.core.validation import near
from malus.scenes.lights.lights import Environment, Light
from malus.scenes.materials.materials import materials, surfaces
from malus.scenes.materials.measured import Measured, open_pbrdf
from malus.scenes.materials.surface import Body, Surface
from malus.scenes.scene import Sampling, Scene, Wavelengths
from malus.scenes.shapes.patterns import ImageTexture
from malus.scenes.shapes.shapes import MeshFile, Shape
from malus.scenes.suite_surfaces import Finish, Index, Substance, coated
from malus.scenes.surroundings import Placed, Surroundings

AnyShape = TypeVar("AnyShape", bound=Model)
Renderer = Literal["mitsuba", "torrance-sparrow"]
Knowledge = Literal["everything", "ladder"]
"""Whether methods are told all that they need, or are also scored on every rung below that."""

MAX_SUITE_BYTES = 1 << 20
MOST_SCENES = 10_000_000
"""Of a suite: its axes multiply, and a plan holds every scene."""


class Smaller(Model):
    """Sizes for machines where only the scalar variant runs, ten times slower."""

    samples: int = Field(ge=2, multiple_of=2)
    resolution: int = Field(ge=1)

    @property
    def note(self) -> str:
        """What the description says where these sizes are used."""
        return (
            f"reduced to {self.resolution}² pixels and {self.samples} samples, because only the "
            "scalar variant runs here; `malus doctor` tells how to mend it"
        )


class Suite(Model):
    """Axes whose product is the scenes; `"all"` stands for every material or surface known.

    Examples
    --------
    >>> len(list(load_suite("quick").scenes())) > 0
    True
    """

    name: FolderName = Field(min_length=1, max_length=100)
    description: str = ""
    shapes: tuple[Shape, ...] = Field(min_length=1)
    materials: tuple[Substance, ...] = Field(min_length=1)
    surfaces: tuple[Finish, ...] = Field(min_length=1)
    lights: tuple[Light, ...] = Field(min_length=1)
    bodies: tuple[Body, ...] = Field(default=("unpolarised",), min_length=1)
    surroundings: tuple[Surroundings, ...] = Field(default=(), exclude_if=lambda value: not value)
    wavelengths_nm: Wavelengths
    methods: tuple[str, ...] = Field(min_length=1)
    metrics: tuple[str, ...] = ()
    renderer: Renderer = "mitsuba"
    knowledge: Knowledge = Field(default="everything", exclude_if=lambda told: told == "everything")
    camera: Camera = Camera()
    sampling: Sampling = Sampling()
    scalar: Smaller | None = None

    @field_validator("materials", mode="before")
    @classmethod
    def _all_materials(cls, value: Any) -> Any:
        return tuple(materials()) if value == "all" else value

    @field_validator("surfaces", mode="before")
    @classmethod
    def _all_surfaces(cls, value: Any) -> Any:
        return tuple(surfaces()) if value == "all" else value

    @model_validator(mode="after")
    def _scenes_fit(self) -> Self:
        axes = self.shapes, self.surroundings or (None,), self.lights, self.surfaces, self.bodies
        count = math.prod(map(len, axes)) * len(self.materials)
        if count > MOST_SCENES:
            raise ValueError(f"at most {MOST_SCENES:,} scenes, which are {count:,} here")
        # Every item once is enough, and stays quick where the axes multiply to very many.
        materials = ((substance, self.surfaces[0]) for substance in self.materials)
        surfaces = ((Index(eta=1.5), finish) for finish in self.surfaces)
        for substance, finish in itertools.chain(materials, surfaces):
            for surroundings in axes[1]:
                own = coated(substance, finish, self.bodies[0])
                scene = self._scene(self.shapes[0], surroundings, self.lights[0], own)
                for placed in scene.objects:
                    placed.surface.indices(self.wavelengths_nm)
        return self

    def scenes(self) -> Iterator[Scene]:
        """Every scene, in an order that keeps scenes of one family of renders together."""
        around = self.surroundings or (None,)
        families = itertools.product(self.shapes, around, self.lights, self.surfaces, self.bodies)
        seen = set()
        for shape, surroundings, light, rough, body in families:
            for substance in self.materials:
                scene = self._scene(shape, surroundings, light, coated(substance, rough, body))
                # A metal has no body, so that its scene is the same for every one.
                if scene not in seen:
                    seen.add(scene)
                    yield scene

    def _scene(
        self, shape: Shape, surroundings: Surroundings | None, light: Light, surface: Surface
    ) -> Scene:
        content = {
            "shape": shape,
            "surface": surface,
            "light": light,
            "camera": self.camera,
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
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(where, "a TOML file", str(error), "correct the syntax") from None
    suite = Suite.parse(data, where)
    code = [name for name in suite.methods if ":" in name]
    if code:
        hint = "code is named on the command line: --method package.module:object"
        raise InputError(f"{where}, key methods", "names of methods", code[0], hint)
    folder = Path(where).parent
    shapes = tuple(_mesh_file(shape, folder) for shape in suite.shapes)
    lights = tuple(_map_file(light, folder) for light in suite.lights)
    finishes = tuple(_painted(finish, folder) for finish in suite.surfaces)
    substances = tuple(_table_file(one, folder, suite.wavelengths_nm) for one in suite.materials)
    around = tuple(_files_around(surroundings, folder) for surroundings in suite.surroundings)
    files = {"shapes": shapes, "materials": substances, "lights": lights, "surfaces": finishes}
    return suite.model_copy(update=files | {"surroundings": around})


def _suite_text(name_or_path: str | Path) -> tuple[str, str]:
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
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_SUITE_BYTES + 1)
        if len(raw) > MAX_SUITE_BYTES:
            raise InputError(str(path), "at most 1 MiB", "a larger file", "is this a suite?")
        return raw.decode("utf-8"), str(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(str(path), "a readable file", reason, "check the path") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "UTF-8 text", "other bytes", "save it as UTF-8") from None


def _files_around(surroundings: Surroundings, folder: Path) -> Surroundings:
    def known(placed: Placed) -> Placed:
        files = {"shape": _mesh_file(placed.shape, folder)}
        return placed.model_copy(update=files | {"surface": _painted(placed.surface, folder)})

    objects = tuple(known(placed) for placed in surroundings.objects)
    return surroundings.model_copy(update={"objects": objects})


def _mesh_file(shape: AnyShape, folder: Path) -> AnyShape:
    if not isinstance(shape, MeshFile):
        return shape
    path, digest = _known_by_content(folder / shape.path, "mesh file")
    return shape.model_copy(update={"path": path, "digest": digest})


def _painted(paint: Any, folder: Path) -> Any:
    pattern = getattr(paint, "pattern", None)
    if not isinstance(pattern, ImageTexture):
        return paint
    path, digest = _known_by_content(folder / pattern.path, pattern.what)
    known = pattern.model_copy(update={"path": path, "digest": digest})
    return paint.model_copy(update={"pattern": known})


def _table_file(substance: Substance, folder: Path, wavelengths_nm: Wavelengths) -> Substance:
    if not isinstance(substance, Measured):
        return substance
    path, digest = _known_by_content(folder / substance.path, substance.what)
    open_pbrdf(Path(path)).check_bands(wavelengths_nm)
    return substance.model_copy(update={"path": path, "digest": digest})


def _map_file(light: Light, folder: Path) -> Light:
    if not isinstance(light, Environment) or light.name == "studio":
        return light
    path, digest = _known_by_content(folder / light.name, "radiance map")
    return light.model_copy(update={"name": path, "digest": digest})


def _known_by_content(path: Path, what: str) -> tuple[str, str]:
    """A file's path seen from the suite's folder, and the hash that makes it part of the id."""
    return str(path), digest_of(path, what)
