"""Angles of the polariser: from lists, from JSON files, and from the names of pictures."""

from __future__ import annotations

import cmath
import itertools
import json
import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

from malus.scenes.core.errors import InputError, first_line
from malus.scenes.polarisation import FROM_VERTICAL_DEG, tell_stokes

Unit = Literal["degrees", "radians"]
Zero = Literal["vertical", "horizontal"]
Sense = Literal["anticlockwise", "clockwise"]

ANGLES_FILE = "angles.json"
_FULL_TURN = 2.0 * math.pi + 1e-3
"""Radians of a full turn, with the rounding of four digits: degrees are rarely all below it."""
_LARGEST_DEG = 720.0
"""No polariser is set to more; numbers above are dates, exposures or counts."""
_NUMBER = r"(?P<sign>[+\-−–]?)(?P<digits>\d+(?:{point}\d+)?)"
_POINTS = (r"[.,]", r"\.", r"[.,p]")
"""Signs between a number and its decimals, the usual ones first."""
_NO_POINT = r"(?!)"
"""No such sign: 2.45 is picture 2 at 45°."""
_GATHERED = 0.7
"""Length of the mean of exp(2iθ) from which angles are too close together to be meant as such."""
_NO_PICTURE = re.compile(r"dark|black|bias|flat", re.IGNORECASE)
_MINUS = "-−–"
_WORDS = {"minus": "-", "neg": "-", "plus": "+"}
_MARKED = re.compile(r"(pol|ang|theta|phi|deg|rot|^i|[^a-z]i)[^a-z0-9]*$|^\s*_?(°|deg|º)", re.I)


class Column(NamedTuple):
    """A number that the names of all pictures hold in the same place.

    Attributes
    ----------
    values : in the order of the names
    texts : what stands before and behind the number in the first name
    rest : the names without the number
    alike : whether the same text stands before it in all names, but for digits
    cut : a number whose decimals may follow a sign that also joins words, 22_5; or None
    """

    values: tuple[float, ...]
    texts: tuple[str, str]
    rest: tuple[str, ...]
    alike: bool
    cut: str | None


def conventional(angle_deg: float, zero: Zero, sense: Sense) -> float:
    """Degrees from the vertical, anticlockwise.

    Examples
    --------
    >>> conventional(90.0, "horizontal", "anticlockwise"), conventional(30, "vertical", "clockwise")
    (0.0, -30)
    """
    turned = angle_deg if sense == "anticlockwise" else -angle_deg
    return turned + FROM_VERTICAL_DEG if zero == "horizontal" else turned


def check_counting(zero: Zero | None, sense: Sense) -> None:
    """Refuse other words for where angles count from, and which way: they would count wrongly.

    Raises
    ------
    InputError
        With the words that there are.
    """
    for name, word, words in (("zero", zero, get_args(Zero)), ("sense", sense, get_args(Sense))):
        is_known = isinstance(word, str) and word in words
        if not is_known and not (name == "zero" and word is None):
            raise InputError(name, " or ".join(words), f"{word}", "choose one of them")


def in_degrees(angles: Sequence[float], unit: Unit | None, where: str) -> tuple[float, ...]:
    """Angles in degrees; those that could be radians are refused where no unit is given.

    Raises
    ------
    InputError
        An unknown unit, an angle that is not finite, or numbers that do not fit the unit.

    Examples
    --------
    >>> in_degrees([0, 45, 90], None, "names"), in_degrees([0.0, math.pi / 2], "radians", "names")
    ((0.0, 45.0, 90.0), (0.0, 90.0))
    """
    listed = ", ".join(f"{angle:g}" for angle in angles)
    if unit not in (None, "degrees", "radians"):
        raise InputError("unit", "degrees or radians", f"{unit}", "choose one of them")
    if not all(math.isfinite(angle) for angle in angles):
        raise InputError(where, "finite angles", listed, "correct them")
    largest = max((abs(angle) for angle in angles), default=0.0)
    if unit is None and 0 < largest <= _FULL_TURN:
        raise InputError(
            where,
            "angles in degrees",
            listed,
            "are they radians? Say which with `unit`; numbers that only count "
            f"pictures are no angles: name the angles in {ANGLES_FILE}",
        )
    if unit == "radians":
        if largest > 2 * _FULL_TURN:
            raise InputError(where, "radians", listed, "say degrees as `unit`")
        return tuple(round(math.degrees(angle), 10) for angle in angles)
    return tuple(float(angle) for angle in angles)


def read_angles_file(path: Path) -> dict[str, float]:
    """Angle by file name, from `angles.json`. Raises InputError."""
    example = '{"a.png": 0, "b.png": 60, "c.png": 120}'
    try:
        data = json.loads(path.read_text("utf-8-sig"), object_pairs_hook=_each_once)
        angles = {str(name): _not_boolean(angle) for name, angle in data.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(str(path), example, first_line(error), "correct it") from None
    for name, angle in angles.items():
        if not math.isfinite(angle) or Path(name).name != name:
            expected = "names of files in the folder and degrees"
            raise InputError(str(path), expected, f"{name}: {angle}", "correct it")
    return angles


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON, of which a name that stands in it twice would be read once."""
    names = [name for name, _ in pairs]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ValueError(f"{twice[0]} twice")
    return dict(pairs)


def _not_boolean(value: Any) -> float:
    """A number that is written as one: Python would take true for 1."""
    if isinstance(value, bool):
        raise ValueError(f"{str(value).lower()} for an angle")
    return float(value)


class Properties(NamedTuple):
    """What a JSON file beside a picture says of it, as polanalyser and `malus export` write it.

    `angle` is in radians from the horizontal; `full_scale` the light of the largest code, or None.
    """

    angle: float
    full_scale: float | None


def read_properties(picture: Path) -> Properties | None:
    """Properties from the JSON file that bears a picture's name; None where there is none.

    Raises
    ------
    InputError
        Where the file is no JSON, or its angle is no finite number.
    """
    path = picture.with_suffix(".json")
    if not path.is_file() or path.name == ANGLES_FILE:
        return None
    try:
        data = json.loads(path.read_text("utf-8-sig"))
        if not isinstance(data, dict) or "angle" not in data:
            return None
        angle, full_scale = _single(data["angle"]), data.get("full_scale")
        properties = Properties(angle, None if full_scale is None else _single(full_scale))
        if not all(math.isfinite(value) for value in properties if value is not None):
            raise ValueError(f"{properties}")
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        hint = "write one number of radians"
        raise InputError(str(path), 'a key "angle"', first_line(error), hint) from None
    return properties


def _single(value: Any) -> float:
    """The one number of a scalar, a list of one, or polanalyser's way to write an array."""
    if isinstance(value, dict):
        value = value["values"]
    while isinstance(value, list) and len(value) == 1:
        value = value[0]
    return _not_boolean(value)


def angles_in_names(folder: Path, names: Sequence[str]) -> dict[str, float]:
    """Angle by file name: the number that varies between the names and spans angles.

    Raises
    ------
    InputError
        Where no number does, several do, or the names hold more than one set of pictures.

    Examples
    --------
    >>> angles_in_names(Path("bust"), ["I0_16bit.png", "I60_16bit.png", "I120_16bit.png"])
    {'I0_16bit.png': 0.0, 'I60_16bit.png': 60.0, 'I120_16bit.png': 120.0}
    """
    if len(names) == 0:
        return {}
    others = [name for name in names if _NO_PICTURE.search(Path(name).stem)]
    if others and len(others) < len(names):
        raise InputError(
            str(folder / others[0]),
            "pictures of the scene alone",
            "a dark or flat frame, by its name",
            "give it as `black`, or take it out of the folder",
        )
    unnumbered = [name for name in names if not re.search(r"\d", Path(name).stem)]
    if unnumbered:
        raise InputError(
            str(folder / unnumbered[0]),
            "a name with the polariser's angle, such as pol_045.png",
            "no number",
            f"rename it, or write {ANGLES_FILE}",
        )
    stems = [_spelled(Path(name).stem) for name in names]
    columns = _columns(stems, _POINTS)
    if not any(_spread(column.values) for column in columns):
        columns = _columns(stems, (*_POINTS, _NO_POINT))
    column = _angle_column(folder, columns)
    if column.cut is not None:
        raise InputError(
            str(folder),
            "angles in the names, decimals after a point",
            f"{column.cut}",
            f"write 22.5 or 22p5 for half degrees, or name the angles in {ANGLES_FILE}",
        )
    _require_one_set(folder, names, column)
    return dict(zip(names, column.values, strict=True))


def _spelled(stem: str) -> str:
    """A name with signs that are written as words turned into signs."""
    for word, sign in _WORDS.items():
        stem = re.sub(rf"{word}[_ ]?(?=\d)", sign, stem, flags=re.IGNORECASE)
    # m45 and p45 are −45 and +45 where the letter stands alone.
    return re.sub(r"(?<![A-Za-z0-9])[mn](?=\d)", "-", stem)


def _columns(stems: Sequence[str], points: Sequence[str]) -> list[Column]:
    """Every number that stands in the same place of all names, counted from either end."""
    columns: dict[tuple[float, ...], Column] = {}
    for point in points:
        pattern = re.compile(_NUMBER.format(point=point))
        numbers = [list(pattern.finditer(stem)) for stem in stems]
        fewest = min(len(matches) for matches in numbers)
        for index in [*range(fewest), *range(-fewest, 0)]:
            matches = [of_name[index] for of_name in numbers]
            column = _column(stems, matches)
            columns.setdefault(column.values, column)
    return list(columns.values())


def _column(stems: Sequence[str], matches: Sequence[re.Match[str]]) -> Column:
    before = [stem[: m.start()] for stem, m in zip(stems, matches, strict=True)]
    behind = [stem[m.end() :] for stem, m in zip(stems, matches, strict=True)]
    digits = [float(re.sub(r"[,p_-]", ".", m["digits"])) for m in matches]
    negative = _negative(before, [m["sign"] for m in matches])
    values = tuple(-d if minus else d for d, minus in zip(digits, negative, strict=True))
    rest = tuple(f"{b}#{a}" for b, a in zip(before, behind, strict=True))
    alike = len({re.sub(r"\d+", "#", text) for text in before}) == 1
    texts = (before[0] + matches[0]["sign"], behind[0])
    return Column(values, texts, rest, alike, _cut(digits, behind))


def _cut(digits: Sequence[float], behind: Sequence[str]) -> str | None:
    """The first of the numbers 22, 67, 112, … with a 5 behind `_` or `-`: half a degree, or not.

    A 5 behind whole multiples of 45 too is a number of its own.
    """
    fives = [re.match(r"[_-]50?(?!\d)", text) for text in behind]
    halves = [(number + 0.5) % 45.0 == 22.5 for number in digits]
    if any(five and not half for five, half in zip(fives, halves, strict=True)):
        return None
    cut = (f"{n:g}{five[0]}" for n, five in zip(digits, fives, strict=True) if five)
    return next(cut, None)


def _negative(before: Sequence[str], signs: Sequence[str]) -> list[bool]:
    """Whether each number is negative: a hyphen that all names have after a word only joins."""
    minus = [sign != "" and sign in _MINUS for sign in signs]
    joined = [b != "" and (b[-1].isalnum() or b[-1] == ")") for b in before]
    if all(minus) and any(joined):
        return [False] * len(minus)
    return minus


def _angle_column(folder: Path, columns: Sequence[Column]) -> Column:
    """The one column that can be angles."""
    likely = [column for column in columns if _spans_angles(column.values)]
    # The same number may be read with its decimals and without: the longer reading is right.
    likely = [column for column in likely if not _part_of_another(column, likely)]
    preferences: tuple[Callable[[Column], bool], ...] = (
        lambda column: column.alike,
        lambda column: _spread(column.values),
        lambda column: not _counts(column.values),
        lambda column: any(_MARKED.search(text) for text in column.texts),
    )
    for is_preferred in preferences:
        likely = [column for column in likely if is_preferred(column)] or likely
    if len(likely) == 1 and not _counts(likely[0].values):
        return likely[0]
    readings = " or ".join(", ".join(f"{v:g}" for v in c.values[:6]) for c in likely or columns)
    if len(likely) > 1:
        expected, hint = "one number in the names that can be the angle", "say which"
    elif likely:
        expected, hint = (
            "angles in the names",
            "numbers that only count pictures are none: say them",
        )
    else:
        expected = "pictures at three or more angles, different modulo 180°"
        hint = "a sinusoid has three unknowns; if names do not tell the angles, say them"
    raise InputError(str(folder), expected, readings or "none", f"{hint} in {ANGLES_FILE}")


def _spread(values: Sequence[float]) -> bool:
    """Whether three or more numbers, as degrees or as radians, lie well around the half circle."""
    if not _spans_angles(values):
        return False
    as_radians = max(abs(value) for value in values) <= _FULL_TURN
    readings = [[math.radians(v) for v in values], *([values] if as_radians else [])]
    means = [sum(cmath.exp(2j * angle) for angle in angles) / len(angles) for angles in readings]
    return min(abs(mean) for mean in means) < _GATHERED


def _part_of_another(column: Column, others: Sequence[Column]) -> bool:
    """Whether a column is another one with the decimals cut off, or its decimals alone."""
    if all(value == int(value) for value in column.values):
        for other in others:
            fractional = any(value != int(value) for value in other.values)
            same = [int(v) == int(w) for v, w in zip(column.values, other.values, strict=True)]
            if other is not column and fractional and all(same):
                return True
    return False


def _spans_angles(values: Sequence[float]) -> bool:
    """Whether numbers can be degrees or radians of a polariser: three or more modulo 180°."""
    if max(abs(value) for value in values) > _LARGEST_DEG:
        return False
    return tell_stokes(values)


def _counts(values: Sequence[float]) -> bool:
    """Whether numbers go up in ones, as numbers of frames do."""
    ordered = sorted(set(values))
    return all(b - a == 1.0 for a, b in itertools.pairwise(ordered))


def _require_one_set(folder: Path, names: Sequence[str], column: Column) -> None:
    """Refuse pictures of several scenes in one folder: their sinusoids are different ones."""
    groups: dict[str, list[float]] = {}
    for name, rest, value in zip(names, column.rest, column.values, strict=True):
        groups.setdefault(f"{rest}{Path(name).suffix}", []).append(value)
    whole = [rest for rest, values in groups.items() if _spans_angles(values)]
    if len(whole) > 1:
        raise InputError(
            str(folder),
            "pictures of one scene",
            f"{len(whole)} sets: {', '.join(whole[:4])}",
            f"give each a folder of its own, or name those that belong together in {ANGLES_FILE}",
        )
    letters = [re.sub(r"\d+", "", rest) for rest in column.rest]
    of_set = {re.sub(r"\d+", "", Path(rest).stem) for rest in whole}
    foreign = [n for n, word in zip(names, letters, strict=True) if of_set and word not in of_set]
    if foreign:
        hint = f"take it out of the folder, or name the pictures' angles in {ANGLES_FILE}"
        expected = f"pictures of one set, {whole[0]}"
        raise InputError(str(folder / foreign[0]), expected, "another name", hint)


def check_angles(where: str, angles: Sequence[float]) -> None:
    """Refuse fewer than three different angles in degrees, modulo 180°.

    Raises
    ------
    InputError
        With the angles that there are.
    """
    if not tell_stokes(angles):
        listed = ", ".join(f"{angle:g}" for angle in angles)
        raise InputError(
            where,
            "pictures at three or more angles, different modulo 180°",
            listed or "none",
            "a sinusoid has three unknowns",
        )
