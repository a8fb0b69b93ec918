"""What a study is: its options, what it finds, and how it is run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class StudyOption:
    """An option of a study.

    Attributes
    ----------
    name : str
        Of the keyword argument; the command line's is the same, with hyphens.
    default : Any
        Also tells the type: int, float, bool, str, or tuple of str for one that may be repeated.
    help : str
    choices : tuple of str
        All values that are allowed, where there are few.
    least, most : float, optional
        Bounds of a number, both included.
    required : bool
    is_file : bool
        The value is the path of a file.
    flag : str
        The option's name on the command line, without hyphens before it, where that is another.
    """

    name: str
    default: Any
    help: str
    choices: tuple[str, ...] = ()
    least: float | None = None
    most: float | None = None
    required: bool = False
    is_file: bool = False
    flag: str = ""


@dataclass(frozen=True)
class Findings:
    """What a study found.

    Attributes
    ----------
    lines : tuple of str
        The figures in words, one line each.
    figures : list of dict, or dict
        The figures for machines; written as NAME.json where the study has no page.
    table : DataFrame, optional
        Every case, one a row; shown before the lines.
    cells : function of a row
        The texts of a table's row.
    passed : bool
        Whether every case is as it must be; True where nothing is judged.

    Examples
    --------
    >>> from malus import run_study
    >>> findings = run_study("ratio", points=10)
    >>> findings.passed, findings.figures[0]["measure"]
    (True, 'eq8')
    """

    lines: tuple[str, ...]
    figures: Any = None
    table: pd.DataFrame | None = None
    cells: Callable[[pd.Series], list[str]] | None = None
    passed: bool = True


@dataclass(frozen=True)
class Study:
    """A benchmark, or a table of fixed cases.

    Attributes
    ----------
    name : str
        What `malus run` and `run_study` take.
    description : str
        One line for `malus list`.
    run : function of (folder or None, options as keywords) that returns Findings
    details : str
        More for the help, after the description.
    example : dict of str
        Values of options in the help's example, as typed.
    options : tuple of StudyOption
        What may be given to it, with defaults.
    has_page : bool
        It writes tables and a page into a folder, by default results/NAME. Any other writes its
        figures only where it is given a folder.

    Examples
    --------
    >>> from malus import list_studies
    >>> [option.name for option in list_studies()["render"].options]
    ['resolution', 'samples', 'backend']
    """

    name: str
    description: str
    run: Callable[..., Findings]
    details: str = ""
    example: dict[str, str] = field(default_factory=dict)
    options: tuple[StudyOption, ...] = ()
    has_page: bool = False

    @property
    def plan(self) -> str:
        """What a run of it will do, for `malus plan`."""
        written = "writes a table and a page" if self.has_page else "prints its figures"
        required = [f" --{one.flag or one.name} …" for one in self.options if one.required]
        command = f"malus bench {self.name}{''.join(required)}" if required else ""
        return (
            f"{self.name}: {self.description}. A study of fixed cases instead of a suite of scenes:"
            f" nothing is left out. `{command or f'malus run {self.name}'}` {written}"
        )


_KINDS: dict[type, tuple[type, str]] = {
    bool: (bool, "True or False"),
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
}
"""What a value has to be, in Python and in words, by the type of the default."""


def option_values(study: Study, options: dict[str, Any]) -> dict[str, Any]:
    """The options with their defaults, of their kinds and within their bounds.

    Raises
    ------
    InputError
        An unknown option, or a value of another kind or out of its range.
    """
    from malus.scenes.core.errors import InputError
    from malus.scenes.core.registry import lookup, several

    by_name = {option.name: option for option in study.options}
    for name in options:
        lookup(name, by_name, f"study {study.name}", "the name of an option")
    values = {name: options.get(name, option.default) for name, option in by_name.items()}
    for name, option in by_name.items():
        if isinstance(option.default, tuple):
            values[name] = several(values[name])
        value = values[name]
        _check_kind(option, value)
        if option.choices and value not in option.choices:
            raise InputError(name, f"one of {', '.join(option.choices)}", str(value), "choose one")
        least, most = option.least, option.most
        if (least is not None and not value >= least) or (most is not None and not value <= most):
            raise InputError(name, _range(least, most), f"{value:g}", "choose another size")
    return values


def _check_kind(option: StudyOption, value: Any) -> None:
    """Raise InputError for a value of another kind than the option's default."""
    from malus.scenes.core.errors import InputError

    kind, expected = _KINDS.get(type(option.default), (object, ""))
    if not isinstance(value, kind):
        raise InputError(option.name, expected, repr(value), "correct it")


def _range(least: float | None, most: float | None) -> str:
    """A range of numbers in words.

    Examples
    --------
    >>> _range(1e-5, 1000), _range(2, None)
    ('a number in 1e-5..1000', 'a number >= 2')
    """
    low, high = (str(bound).replace("e-0", "e-") for bound in (least, most))
    return f"a number >= {low}" if most is None else f"a number in {low}..{high}"
