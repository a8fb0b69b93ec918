"""Random scenes: what they are drawn from, and the draw of each by its number."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from malus.scenes.camera import Camera
from malus.scenes.core.errors import InputError
from malus.scenes.core.model import PARSED, Model
from malus.scenes.materials.surface import Body, Surface
from malus.scenes.random_suite.clutter import Clutter, place, rested
from malus.scenes.random_suite.sequence import Numbers
from malus.scenes.random_suite.splits import (
    Portion,
    SplitName,
    Splits,
    identity,
    portions,
    separate,
)
from malus.scenes.random_suite.templates import (
    WEIGHT,
    Distribution,
    distributions,
    drawn,
    is_weight,
    joined,
    variants,
    with_files,
)
from malus.scenes.scene import Scene, Wavelengths
from malus.scenes.suite_surfaces import (
    ALL_MATERIALS,
    ALL_SURFACES,
    SuiteMaterial,
    SuiteSurface,
    scene_surface,
)
from malus.scenes.surroundings import Placed

Templates = tuple[Any, ...]

AXES = {
    "shape": "shapes",
    "material": "materials",
    "surface": "surfaces",
    "body": "bodies",
    "light": "lights",
    "camera": "cameras",
    "surroundings": "surroundings",
}
"""Key of each axis in a suite."""

EMPTY = "none"
"""Item of `surroundings` that stands for a scene without any."""

BORDER = 0.005
"""Part of a band next to each of its ends that is left out, so that no value is in two bands."""


class RandomScenes(Model):
    """What the scenes of a random suite are drawn from.

    The axes are those of any suite, with ranges and choices in place of any value (see
    `malus.scenes.random_suite.templates`); an item with a `weight` of 2 is drawn twice as often.
    Keys of `cameras` replace those of the suite's camera. `surroundings` have `objects` as in any
    suite, which without a `surface` draw it from the axes, and `clutter`, or are `"none"`.

    Scene `i` follows from the axes, the seed and `i` alone: a larger `count` adds scenes.

    Examples
    --------
    >>> flat = RandomScenes(count=4, shapes=({"kind": "sphere"},), materials=("pmma",),
    ...     surfaces=({"alpha": {"uniform": (0.1, 0.4)}},), lights=({"kind": "uniform"},))
    >>> len({draws.scene(0).id for draws in [flat.draws(Camera(), (550.0,)), flat.draws(
    ...     Camera(), (550.0,))]})
    1
    """

    count: int = Field(ge=1, le=10_000_000)
    seed: int = Field(default=1, ge=0, lt=1 << 53)
    shapes: Templates = Field(min_length=1)
    materials: Annotated[Templates, ALL_MATERIALS] = Field(min_length=1)
    surfaces: Annotated[Templates, ALL_SURFACES] = Field(min_length=1)
    bodies: Templates = Field(default=("unpolarised",), min_length=1)
    lights: Templates = Field(min_length=1)
    cameras: Templates = Field(default=({},), min_length=1)
    surroundings: Templates = Field(default=(EMPTY,), min_length=1)

    @field_validator(*AXES.values())
    @classmethod
    def _files_from_here(cls, value: Templates, info: ValidationInfo) -> Templates:
        # A suite that is read has its files in its own folder: see `with_files`.
        if info.context == PARSED:
            return value
        try:
            found: Templates = with_files(value, Path())
        except InputError:  # told when it is read
            return value
        return found

    @model_validator(mode="after")
    def _ranges(self) -> Self:
        for axis, key in AXES.items():
            for number, item in enumerate(getattr(self, key)):
                with_key = f"key {key}.{number}"
                try:
                    template, _ = _weighted(item)
                    list(distributions(template))
                except InputError as error:
                    where = f"{with_key}, {error.where}"
                    raise InputError(where, error.expected, error.found, error.hint) from None
                if axis == "surroundings" and template != EMPTY:
                    SurroundingsTemplate.parse(template, with_key)
        return self

    def items(self, axis: str) -> list[tuple[Any, float]]:
        """Templates of an axis with their weights."""
        return [_weighted(item) for item in getattr(self, AXES[axis])]

    def with_files(self, folder: Path) -> Self:
        """The same with the files of folders, and the digest of every file.

        Raises
        ------
        InputError
            A file that cannot be read, an empty folder.
        """
        changed = {key: with_files(getattr(self, key), folder) for key in AXES.values()}
        return self.model_copy(update=changed)

    def draws(
        self, camera: Camera, wavelengths_nm: Wavelengths, splits: Splits | None = None
    ) -> SceneDraws:
        """The scenes by their numbers; `camera` has the keys that are not drawn."""
        return SceneDraws(self, camera, wavelengths_nm, splits)


class SurroundingsTemplate(Model):
    """Keys of an item of `surroundings`, all of which may hold ranges and choices."""

    name: str = Field(min_length=1, max_length=100)
    objects: tuple[dict[str, Any], ...] = ()
    clutter: Any = None


class DrawnSurface(Model):
    """What a surface is made from, as drawn."""

    material: SuiteMaterial
    surface: SuiteSurface
    body: Body

    @property
    def made(self) -> Surface:
        """The surface of a scene."""
        return scene_surface(self.material, self.surface, self.body)


class SceneDraws:
    """The scenes of a random suite, each by its number and independently of the others.

    Parameters
    ----------
    random : RandomScenes
    camera : Camera
        With the keys that are not drawn.
    wavelengths_nm : tuple of float
    splits : Splits, optional
    """

    def __init__(
        self,
        random: RandomScenes,
        camera: Camera,
        wavelengths_nm: Wavelengths,
        splits: Splits | None = None,
    ) -> None:
        self.random, self.splits = random, splits
        self._camera, self._wavelengths_nm = camera, wavelengths_nm
        self._items = {axis: random.items(axis) for axis in AXES}
        self._identities = {
            axis: [identity(template) for template, _ in items]
            for axis, items in self._items.items()
        }

    def split(self, index: int) -> SplitName | None:
        """The split of a scene; None where the suite has none."""
        if self.splits is None:
            return None
        return self.splits.split_at(Numbers(self.random.seed, index)("split"))

    def content(self, index: int) -> dict[str, Any]:
        """What is drawn for a scene, by axis, as plain values."""
        numbers, split = Numbers(self.random.seed, index), self.split(index)

        def draw(axis: str, name: str = "") -> Any:
            return self._draw(axis, numbers, split, name)

        def surface(name: str = "") -> dict[str, Any]:
            return {axis: draw(axis, name) for axis in ("material", "surface", "body")}

        content = {"shape": draw("shape"), **surface()}
        content |= {"light": draw("light"), "camera": draw("camera")}
        around = draw("surroundings")
        if around != EMPTY:
            objects = [
                {"surface": surface(f"object {number} "), **thing}
                for number, thing in enumerate(around.get("objects", ()))
            ]
            if around.get("clutter") is not None:
                clutter = Clutter.parse(around["clutter"], "clutter")
                camera = self._camera_of(content["camera"])
                spots = place(clutter, objects, camera, numbers)
                for number, spot in spots.items():
                    name = f"clutter {number} "
                    own = {"shape": draw("shape", name), "surface": surface(name)}
                    objects.append(own | spot)
                if clutter.rest:
                    objects = rested(clutter, content["shape"], objects, len(spots))
            if objects:
                content["surroundings"] = {"name": around["name"], "objects": tuple(objects)}
        return content

    def scene(self, index: int) -> Scene:
        """A scene by its number, from 0.

        Raises
        ------
        InputError
            If what is drawn does not fit together.
        """
        return self.made(self.content(index), f"scene {index}")

    def made(self, content: Mapping[str, Any], where: str) -> Scene:
        """The scene of a drawn content; `where` begins messages."""
        parts = {axis: content[axis] for axis in ("material", "surface", "body")}
        around = content.get("surroundings")
        return Scene.parse(
            {
                "shape": content["shape"],
                "surface": DrawnSurface.parse(parts, where).made,
                "light": content["light"],
                "camera": self._camera_of(content["camera"]),
                "wavelengths_nm": self._wavelengths_nm,
                "surroundings": around
                and {
                    "name": around["name"],
                    "objects": tuple(_placed(thing, where) for thing in around["objects"]),
                },
            },
            where,
        )

    def examples(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Contents that hold every item and choice, and both ends of every range, with their key.

        Of the other axes each has its first item.
        """
        first = {axis: next(variants(items[0][0])) for axis, items in self._items.items()}
        first.pop("surroundings")
        yield "key random, first of every axis", first
        for axis, items in self._items.items():
            for number, (template, _) in enumerate(items):
                for variant in variants(template):
                    key = f"key random.{AXES[axis]}.{number}"
                    if axis != "surroundings":
                        yield key, first | {axis: variant}
                    elif variant != EMPTY:
                        yield key, self._example_around(first, variant)

    def _example_around(self, first: dict[str, Any], around: Mapping[str, Any]) -> dict[str, Any]:
        if around.get("clutter") is not None:
            Clutter.parse(around["clutter"], "clutter")
        surface = {axis: first[axis] for axis in ("material", "surface", "body")}
        objects = tuple({"surface": surface, **thing} for thing in around.get("objects", ()))
        own = {"surroundings": {"name": around["name"], "objects": objects}} if objects else {}
        return first | own

    def _camera_of(self, values: Mapping[str, Any]) -> Camera:
        return Camera.parse(self._camera.model_dump(mode="json") | dict(values), "camera")

    @cached_property
    def _portions(self) -> dict[tuple[str, SplitName | None], tuple[list[Portion], list[float]]]:
        """Portions of every axis in every split, and the ends of their shares in 0..1."""
        result = {}
        for axis, items in self._items.items():
            parts: dict[Any, list[Portion]] = {None: portions(items, cut=False)}
            if self.splits is not None:
                parts = dict.fromkeys(self.splits.shares, parts[None])
                if axis in self.splits.disjoint:
                    order = Numbers(self.random.seed, 0).plain
                    parts = dict(separate(portions(items, cut=True), self.splits, axis, order))
            for split, own in parts.items():
                total = sum(part.weight for part in own)
                ends = [end / total for end in accumulate(part.weight for part in own)]
                result[axis, split] = (own, ends)
        return result

    def _draw(self, axis: str, numbers: Numbers, split: SplitName | None, name: str) -> Any:
        """A value of an axis, of the portions of a split.

        One number chooses the portion, and what is left of it a value in the portion: both are
        stratified then.
        """
        own, ends = self._portions[axis, split]
        number = numbers(f"{name}{axis}")
        place = min(bisect_right(ends, number), len(own) - 1)
        part, begin = own[place], ends[place - 1] if place else 0.0
        within = (number - begin) / (ends[place] - begin)
        if part.high - part.low < 1:
            within = BORDER + (1 - 2 * BORDER) * within
        number = part.low + (part.high - part.low) * min(max(within, 0.0), 1 - 2**-40)
        template = self._items[axis][part.item][0]
        own_path = self._identities[axis][part.item]

        def pick(path: str, _: Distribution) -> float:
            return number if path == own_path else numbers(joined(f"{name}{axis}", path))

        return drawn(template, pick)


def least_and_most_pixels(own: int, cameras: Iterable[Any] = ()) -> tuple[int, int]:
    """Pixels a side of the smallest and of the largest picture.

    Parameters
    ----------
    own : int
        Of the suite's camera, for those that are drawn without.
    cameras : templates of a random suite

    Examples
    --------
    >>> least_and_most_pixels(128), least_and_most_pixels(128, [{"resolution": 16}, {}])
    ((128, 128), (16, 128))
    """
    drawn = (camera for template in cameras for camera in variants(template))
    sides = [int(camera.get("resolution", own)) for camera in drawn] or [own]
    return min(sides), max(sides)


def _placed(thing: Mapping[str, Any], where: str) -> Placed:
    """An object of the surroundings, with its own surface or one that was drawn."""
    surface = thing["surface"]
    if isinstance(surface, Mapping) and "surface" in surface:
        surface = DrawnSurface.parse(surface, where).made
    return Placed.parse({**thing, "surface": surface}, where)


def _weighted(item: Any) -> tuple[Any, float]:
    """Template and weight of an item of an axis.

    Raises
    ------
    InputError
        For a weight that is not above 0.
    """
    if not isinstance(item, Mapping) or "weight" not in item:
        return item, 1.0
    weight = item["weight"]
    if not is_weight(weight):
        raise InputError("key weight", WEIGHT, repr(weight), "correct this value")
    return {key: value for key, value in item.items() if key != "weight"}, float(weight)
