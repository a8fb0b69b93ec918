"""Division of a random suite's scenes into training, validation and test, and of the values."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from malus.scenes.core.errors import InputError
from malus.scenes.core.model import Model
from malus.scenes.core.named_file import NamedFile
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.surface import RoughSurface, surfaces_on
from malus.scenes.random_suite.templates import distributions, variants
from malus.scenes.scene import Scene

SplitName = Literal["train", "val", "test"]
Disjoint = Literal["shape", "material", "surface", "light", "camera"]


class Splits(Model):
    """Shares of the scenes for training, validation and test, and what these do not share.

    Every value of a `disjoint` axis belongs to one split: an item, a file of a folder or a choice
    as it is, a range in bands (see `separate`). The others are drawn alike in all splits.

    Examples
    --------
    >>> Splits(train=0.8, val=0.1, test=0.1, disjoint=("shape", "light")).split_at(0.85)
    'val'
    """

    train: float = Field(default=0.0, ge=0, le=1)
    val: float = Field(default=0.0, ge=0, le=1)
    test: float = Field(default=0.0, ge=0, le=1)
    disjoint: tuple[Disjoint, ...] = ()

    @model_validator(mode="after")
    def _whole(self) -> Self:
        total = math.fsum(self.shares.values())
        if abs(total - 1) > 1e-9:
            hint = "correct the shares of train, val and test"
            raise InputError("key train", "shares that add up to 1", f"{total:g}", hint)
        return self

    @property
    def shares(self) -> dict[SplitName, float]:
        """Share of the scenes by split, without those that are empty."""
        shares: dict[SplitName, float] = {"train": self.train, "val": self.val, "test": self.test}
        return {name: share for name, share in shares.items() if share}

    def split_at(self, number: float) -> SplitName:
        """The split of a number in 0..1, on which the splits lie one after the other."""
        end = 0.0
        for name, share in self.shares.items():
            end += share
            if number < end:
                return name
        return name


@dataclass(frozen=True)
class Portion:
    """A part of what an axis can give: an item, or an interval of the number that identifies it.

    Attributes
    ----------
    item : int
        Number of the axis' template.
    low, high : float
        Interval of the number in 0..1 that is drawn for the item's identity.
    weight : float
        Share of the draws of the axis.
    """

    item: int
    low: float
    high: float
    weight: float


def identity(template: Any) -> str | None:
    """Path of the range or choice that makes values of a template different; None without one.

    A folder of files before all, for a mesh or a map stays the same however it is turned; then the
    range or choice that can be cut most finely, so that every split has a share of it. An item
    with one file is that file.

    Examples
    --------
    >>> identity({"kind": "distant", "incidence_deg": {"uniform": (20, 90)}, "azimuth_deg": 30})
    'incidence_deg'
    """
    nodes = dict(distributions(template))
    named = {path for path in nodes if path.split(".")[-1] in ("path", "name")}
    if named:
        return min(named)
    if _names_a_file(template):
        return None
    return max(nodes, key=lambda path: nodes[path].intervals, default=None)


def _names_a_file(template: Any) -> bool:
    if isinstance(template, dict):
        parts = template.values()
        return bool({"path", "name"} & set(template)) or any(map(_names_a_file, parts))
    return isinstance(template, tuple) and any(map(_names_a_file, template))


def portions(items: Sequence[tuple[Any, float]], cut: bool) -> list[Portion]:
    """Portions of the items of an axis, which are pairs of template and weight.

    One an item, or `cut` by the values of what identifies it: one a file, choice or band of a
    range.
    """
    total = math.fsum(weight for _, weight in items)
    result = []
    for number, (template, weight) in enumerate(items):
        cuts: Sequence[float] = (0.0, 1.0)
        path = identity(template) if cut else None
        if path is not None:
            cuts = dict(distributions(template))[path].cuts
        result += [
            Portion(number, low, high, weight / total * (high - low))
            for low, high in pairwise(cuts)
        ]
    return result


def separate(
    parts: Sequence[Portion], splits: Splits, axis: str, order: Any
) -> dict[SplitName, list[Portion]]:
    """Share out the portions of an axis among the splits, so that each has its share of the draws.

    `order` gives a number for a name, by which the portions of an item are shuffled: which of its
    values belong to a split follows from the suite's seed. Where other items have values for all
    splits, one of fewer values than splits stays whole in the largest: it would fill most of
    a small one, which should be drawn like the others.

    Raises
    ------
    InputError
        If there are fewer values than splits.
    """
    shares = splits.shares
    if len(parts) < len(shares):
        hint = f"give more of them, or leave {axis} out of `disjoint`"
        raise InputError(
            f"key splits.disjoint, {axis}", f"at least {len(shares)} values", str(len(parts)), hint
        )
    counts = Counter(part.item for part in parts)
    whole = [part for part in parts if counts[part.item] < len(shares)]
    cut = [part for part in parts if counts[part.item] >= len(shares)]
    result: dict[SplitName, list[Portion]] = {name: [] for name in shares}
    if cut:
        result[max(shares, key=lambda name: shares[name])] += whole
    shared = sorted(
        cut or whole, key=lambda part: (part.item, order(f"{axis} {part.item} {part.low}"))
    )
    lacking = dict.fromkeys(shares, 0.0)
    for left, part in zip(range(len(shared), 0, -1), shared, strict=True):
        empty = [name for name in shares if not result[name]]
        for name, share in shares.items():
            lacking[name] += share * part.weight
        # The last ones go to splits that would stay empty.
        candidates = empty if empty and left <= len(empty) else list(shares)
        chosen = max(candidates, key=lambda name: lacking[name])
        lacking[chosen] -= part.weight
        result[chosen].append(part)
    return {name: sorted(found, key=lambda p: (p.item, p.low)) for name, found in result.items()}


DRAWN_MATERIALS = ("material", "surface", "surroundings")
"""Axes whose items may hold materials."""


def refuse_own_values(items: Mapping[str, Sequence[tuple[Any, float]]], splits: Splits) -> None:
    """Refuse a random suite whose splits would share values that no axis hands out.

    Bands and items of an axis are shared out among the splits; what objects of the surroundings,
    parts of a pattern, or a second range of the same index have of their own is not. `items` are
    pairs of template and weight by axis.

    Raises
    ------
    InputError
        Naming the first of them.
    """
    if len(splits.shares) < 2:
        return
    own = list(_own_values(items))
    if "material" in splits.disjoint:
        own += _overlapping(items["material"])
    for key, axis, found in own:
        if axis in splits.disjoint:
            hint = f"let every object draw its {axis}, or leave {axis} out of `disjoint`"
            raise InputError(f"key random.{key}", f"every {axis} in one split", found, hint)


def _own_values(
    items: Mapping[str, Sequence[tuple[Any, float]]],
) -> Iterator[tuple[str, str, str]]:
    """Key, axis, and words of what objects and parts of patterns have of their own."""
    for number, (around, _) in enumerate(items["surroundings"]):
        objects = around.get("objects", ()) if isinstance(around, Mapping) else ()
        for place, thing in enumerate(objects):
            key = f"surroundings.{number}.objects.{place}"
            shape = thing.get("shape")
            if not (isinstance(shape, Mapping) and shape.get("kind") == "plane"):
                yield f"{key}.shape", "shape", "a shape of its own"
            for axis in ("material", "surface") if "surface" in thing else ():
                yield f"{key}.surface", axis, f"a {axis} of its own"
    for number, (surface, _) in enumerate(items["surface"]):
        parts = surface.get("parts", ()) if isinstance(surface, Mapping) else ()
        for place, part in enumerate(parts if isinstance(parts, tuple) else ()):
            if isinstance(part, Mapping) and "material" in part:
                yield f"surfaces.{number}.parts.{place}", "material", "a material of its own"


def _overlapping(materials: Sequence[tuple[Any, float]]) -> Iterator[tuple[str, str, str]]:
    """The same of ranges of the index in several items that have indices in common."""
    known: list[tuple[float, float]] = []
    for number, (template, _) in enumerate(materials):
        if not isinstance(template, Mapping) or set(template) != {"eta"}:
            continue  # metals, whose indices are pairs, and materials with names
        first = (
            v["eta"][0] if isinstance(v["eta"], tuple) else v["eta"] for v in variants(template)
        )
        ends = [float(eta) for eta in first if isinstance(eta, float | int)]
        low, high = min(ends, default=0.0), max(ends, default=0.0)
        if any(low < other_high and other_low < high for other_low, other_high in known):
            yield f"materials.{number}.eta", "material", f"{low:g} to {high:g}, as in others"
        known.append((low, high))


def values_of(scene: Scene, axis: Disjoint) -> set[str]:
    """Names of what a scene has of an axis, over all its objects; files by their digest.

    Planes are floors and walls and count as no shape.

    Examples
    --------
    >>> from malus.scenes import Dielectric, Scene, Sphere, Uniform
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3), light=Uniform())
    >>> values_of(scene, "material")
    {'eta 1.5'}
    """
    if axis == "light":
        return {_name(scene.light)}
    if axis == "camera":
        return {scene.camera.id}
    if axis == "shape":
        return {_name(placed.shape) for placed in scene.objects if placed.shape.kind != "plane"}
    parts = [part for placed in scene.objects for part in surfaces_on(placed.surface)]
    if axis == "material":
        return {_name(p) if isinstance(p, Measured) else p.material_label for p in parts}
    return {p.id if isinstance(p, Measured) else _surface_name(p) for p in parts}


_OF_OTHER_AXES = {"kind", "material", "eta", "k", "body"}


def _surface_name(part: RoughSurface) -> str:
    """All that the axis of surfaces gives, but for the name of the roughness, which says no more.

    Conductors are told without `kind`: the material makes them so.
    """
    own = part.model_dump(exclude=_OF_OTHER_AXES | {"roughness"})
    return " ".join(str(value) for value in own.values())


def _name(value: Any) -> str:
    """A name of equal content, whatever the position of what comes from a file."""
    if isinstance(value, NamedFile):
        return value.digest or value.file_name or str(getattr(value, "name", value.id))
    return str(value.id)


def check_leaks(
    scenes: Iterable[tuple[Scene, str, SplitName]], splits: Splits
) -> dict[Disjoint, dict[str, SplitName]]:
    """The split of every value of the disjoint axes, of scenes with their ids and splits.

    Raises
    ------
    InputError
        If a scene, or a value of a disjoint axis, is in two splits.
    """
    seen: dict[str, SplitName] = {}
    found: dict[Disjoint, dict[str, SplitName]] = {axis: {} for axis in splits.disjoint}
    for scene, scene_id, split in scenes:
        if seen.setdefault(scene_id, split) != split:
            _refuse_leak("scene", scene_id, seen[scene_id], split, scene_id)
        for axis in splits.disjoint:
            for value in sorted(values_of(scene, axis)):
                other = found[axis].setdefault(value, split)
                if other != split:
                    _refuse_leak(axis, value, other, split, scene_id)
    return found


def _refuse_leak(axis: str, value: str, one: str, other: str, scene_id: str) -> None:
    """Raise the InputError of a value in two splits."""
    if axis == "scene":
        hint = "give a range in place of a choice, so that scenes differ"
    else:
        hint = f"let every object draw its {axis}, or leave {axis} out of `disjoint`"
    where, expected = f"splits, scene {scene_id}", f"every {axis} in one split"
    raise InputError(where, expected, f"{value} in {one} and {other}", hint)
