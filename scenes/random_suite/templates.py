"""Ranges and choices that stand for a value in a suite, and the values drawn from them.

A template is what a suite would hold, with a table of one of these keys in place of any value:
`{ uniform = [0.1, 0.5] }`, `{ log_uniform = [0.01, 1] }`, `{ integers = [0, 99] }` (ends included),
`{ choice = [...] }` (also of tables with ranges; with `weights`), `{ folder = "meshes" }`.
"""

from __future__ import annotations

import functools
import itertools
import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from malus.scenes.core.errors import InputError
from malus.scenes.core.model import FOUND_IN
from malus.scenes.core.named_file import digest_of

KINDS = ("uniform", "log_uniform", "integers", "choice", "folder")
BANDS = 100
"""Most intervals that a range is cut into, where splits share no value of it."""
OPTION = "option"
"""Key of what a choice has chosen, in the path of a value inside it."""
DIGITS = 6
"""Significant digits of a drawn number: enough, and the same on every machine."""
WEIGHT = "a number above 0 and below 1e9"
"""What a weight is, in words."""

_SUFFIXES = {
    "mesh": (".obj", ".ply", ".stl", ".off", ".glb", ".gltf"),
    "image": (".png", ".exr"),
    "environment": (".exr", ".hdr", ".pfm"),
}


@dataclass(frozen=True)
class Distribution:
    """How a number in 0..1 becomes a value.

    Attributes
    ----------
    value : function of a number in 0..1
    intervals : int
        Into how many the number may be cut: one a value where these are few, else bands.
    is_range : bool
        Whether it is a range of real numbers.
    options : sequence
        The templates of a choice.
    weights : sequence of float
        Of the options where they differ.
    integers : int
        How many whole numbers a range of them has; 0 elsewhere.
    """

    value: Callable[[float], Any]
    intervals: int
    is_range: bool = False
    options: Sequence[Any] = ()
    weights: Sequence[float] = ()
    integers: int = 0

    @property
    def cuts(self) -> tuple[float, ...]:
        """Ends of the intervals, ascending from 0 to 1."""
        count = self.intervals
        if self.weights:
            total = math.fsum(self.weights)
            return (0.0, *(part / total for part in itertools.accumulate(self.weights[:-1])), 1.0)
        whole = self.integers or count  # bands of integers end between two of them
        return tuple(place * whole // count / whole for place in range(count + 1))

    def probe(self, number: int) -> float:
        """The number-th value that is worth a test: both ends of a range in turn, or every value.

        As ends and values are passed through at different speed, they meet in every combination.
        """
        if self.is_range:
            return float(number % 2)
        cuts, place = self.cuts, number // 2 % self.intervals
        return 0.5 * (cuts[place] + cuts[place + 1])


def distribution(template: Any) -> Distribution | None:
    """The distribution that a table stands for; None for any other template.

    Raises
    ------
    InputError
        For a range or choice that is none.

    Examples
    --------
    >>> distribution({"uniform": (1.0, 3.0)}).value(0.5)
    2.0
    """
    if not isinstance(template, Mapping):
        return None
    kinds = [kind for kind in KINDS if kind in template]
    if not kinds:
        return None
    kind = kinds[0]
    beside = {"choice": {"weights"}, "folder": {"files"}}.get(kind, set())
    foreign = sorted(set(template) - {kind} - beside)
    if foreign:
        raise InputError(f"key {kind}", "nothing beside it", foreign[0], "remove one of both")
    made: Distribution = _MAKERS[kind](template)
    return made


def _uniform(template: Mapping[str, Any]) -> Distribution:
    low, high = _ends(template, "uniform", float)
    return Distribution(lambda u: _rounded(low + (high - low) * u, low, high), BANDS, True)


def _log_uniform(template: Mapping[str, Any]) -> Distribution:
    low, high = _ends(template, "log_uniform", float)
    if low <= 0:
        raise InputError("key log_uniform", "ends above 0", f"{low:g}", "correct the range")
    ratio = high / low
    return Distribution(lambda u: _rounded(low * ratio**u, low, high), BANDS, True)


def _integers(template: Mapping[str, Any]) -> Distribution:
    low, high = _ends(template, "integers", int)
    count = high - low + 1
    bands = min(count, BANDS)
    return Distribution(lambda u: min(low + int(count * u), high), bands, integers=count)


def _choice(template: Mapping[str, Any]) -> Distribution:
    options = template["choice"]
    if not isinstance(options, list | tuple) or not options:
        raise InputError("key choice", "a list of values", repr(options), "give at least one")
    if "weights" not in template:
        return _of_options(options)
    weights = _checked_weights(template["weights"], len(options))
    inner = [end / math.fsum(weights) for end in itertools.accumulate(weights[:-1])]
    pick = functools.partial(bisect_right, inner)
    return Distribution(lambda u: options[pick(u)], len(options), False, options, weights)


def _folder(template: Mapping[str, Any]) -> Distribution:
    """Choice of a folder's files, each (name, digest); before they are known, the folder itself."""
    return _of_options(template.get("files") or ((template["folder"], ""),))


_MAKERS: dict[str, Callable[[Mapping[str, Any]], Distribution]] = {
    "uniform": _uniform,
    "log_uniform": _log_uniform,
    "integers": _integers,
    "choice": _choice,
    "folder": _folder,
}


def _of_options(options: Sequence[Any]) -> Distribution:
    """Choice among options of equal weight."""
    count = len(options)
    return Distribution(lambda u: options[min(int(count * u), count - 1)], count, False, options)


def _ends(template: Mapping[str, Any], kind: str, number: type) -> tuple[Any, Any]:
    ends = template[kind]
    types = (int,) if number is int else (int, float)
    valid = (
        isinstance(ends, list | tuple)
        and len(ends) == 2
        and all(isinstance(end, types) and not isinstance(end, bool) for end in ends)
        and math.isfinite(ends[0])
        and math.isfinite(ends[1])
        and ends[0] < ends[1]
    )
    if not valid:
        expected = "two whole numbers" if number is int else "two numbers"
        hint = "correct the range"
        raise InputError(f"key {kind}", f"{expected}, the lower first", repr(ends), hint)
    return number(ends[0]), number(ends[1])


def _checked_weights(weights: Any, count: int) -> tuple[float, ...]:
    valid = (
        isinstance(weights, list | tuple) and len(weights) == count and all(map(is_weight, weights))
    )
    if not valid:
        expected = f"{WEIGHT} for each of the {count} choices"
        raise InputError("key weights", expected, repr(weights), "correct the list")
    return tuple(map(float, weights))


def is_weight(value: Any) -> bool:
    """Whether a value may weigh an item of an axis or a choice.

    Weights are divided by their sum, which must not overflow.

    Examples
    --------
    >>> is_weight(2), is_weight(0), is_weight(True), is_weight(1e308)
    (True, False, False, False)
    """
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and 0 < value < 1e9


def _rounded(value: float, low: float, high: float) -> float:
    """The value with few digits, within the range."""
    return min(max(float(f"{value:.{DIGITS}g}"), low), high)


Pick = Callable[[str, Distribution], float]
"""Chooses the number in 0..1 for the distribution at a path."""


def drawn(template: Any, pick: Pick, path: str = "") -> Any:
    """A template with a value in place of every range and choice.

    Examples
    --------
    >>> drawn({"kind": "blob", "seed": {"integers": (0, 9)}}, lambda path, _: 0.55)
    {'kind': 'blob', 'seed': 5}
    """
    node = distribution(template)
    if node is not None:
        value = node.value(pick(path, node))
        return drawn(value, pick, joined(path, OPTION)) if "choice" in template else value
    if isinstance(template, Mapping):
        values = {}
        for key, part in template.items():
            value = drawn(part, pick, joined(path, key))
            if isinstance(part, Mapping) and "folder" in part:
                values[key], values["digest"] = value
            else:
                values[key] = value
        return values
    if isinstance(template, list | tuple):
        return tuple(drawn(part, pick, joined(path, str(i))) for i, part in enumerate(template))
    return template


def joined(path: str, key: str) -> str:
    """The path of a key below a path."""
    return f"{path}.{key}" if path else key


def distributions(template: Any, path: str = "") -> Iterator[tuple[str, Distribution]]:
    """Path and distribution of every range and choice, without those inside a choice."""
    node = distribution(template)
    if node is not None:
        yield path, node
    elif isinstance(template, Mapping):
        for key, part in template.items():
            yield from distributions(part, joined(path, key))
    elif isinstance(template, list | tuple):
        for i, part in enumerate(template):
            yield from distributions(part, joined(path, str(i)))


def variants(template: Any) -> Iterator[Any]:
    """Draws that hold every choice and both ends of every range.

    Examples
    --------
    >>> list(variants({"alpha": {"uniform": (0.1, 0.3)}}))
    [{'alpha': 0.1}, {'alpha': 0.3}]
    """
    for number in range(2 * _most_values(template)):
        yield drawn(template, _Probes(number))


class _Probes:
    """Picks the number-th value worth a test; inside a choice the next only after all options."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._options: dict[str, int] = {}

    def __call__(self, path: str, node: Distribution) -> float:
        """The number in 0..1 for the distribution at a path."""
        outer = [n for inside, n in self._options.items() if f"{path}.".startswith(inside)]
        if node.options:
            self._options[f"{joined(path, OPTION)}."] = node.intervals
        place, end = divmod(self._number, 2)
        return node.probe(2 * (place // math.prod(outer)) + end)


def _most_values(template: Any) -> int:
    most = 1
    for _, node in distributions(template):
        inside = max(map(_most_values, node.options), default=1)
        values = 1 if node.is_range else node.intervals
        most = max(most, values * inside)
    return most


def with_files(template: Any, folder: Path) -> Any:
    """A template whose files have their folders and their digests, and folders their files.

    Raises
    ------
    InputError
        A file that cannot be read, a folder without a file of the kind that is needed.
    """
    if isinstance(template, list | tuple):
        return tuple(with_files(part, folder) for part in template)
    if not isinstance(template, Mapping):
        return template
    found = {key: with_files(part, folder) for key, part in template.items()}
    kind = str(template.get("kind", "measured"))
    key = "name" if kind == "environment" else "path"
    match template.get(key):
        case "studio" if kind == "environment":
            pass
        case str(name):
            file = folder / str(template.get(FOUND_IN, "")) / name
            found |= {key: file.name, "digest": digest_of(file, f"{kind} file")}
            found[FOUND_IN] = str(file.parent)
        case {"choice": _}:
            hint = 'put the files into a folder: { folder = "…" }, or write an item for each'
            raise InputError(f"key {key}", "a file, or a folder of files", "a choice", hint)
        case {"folder": str(name)} if not template[key].get("files"):
            found[key] = {"folder": name, "files": _files(folder / name, kind)}
            found[FOUND_IN] = str(folder / name)
    return found


def _files(folder: Path, kind: str) -> tuple[tuple[str, str], ...]:
    """Name and digest of every file of a kind in a folder, in order of their names."""
    suffixes = _SUFFIXES.get(kind, (".pbsdf",))
    try:
        names = sorted(path for path in folder.iterdir() if path.suffix.lower() in suffixes)
    except OSError as error:
        found = error.strerror or "none"
        raise InputError(str(folder), "a readable folder", found, "check the path") from None
    if not names:
        expected = f"files for kind {kind} ({', '.join(suffixes)})"
        raise InputError(str(folder), expected, "none", "check the path")
    return tuple((path.name, digest_of(path, f"{kind} file")) for path in names)
