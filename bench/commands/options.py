"""What the commands share: paths, options of several commands, and the names in messages."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import click


class Folder(click.ParamType[Path]):
    """A path, or a URL of a store such as s3://bucket/folder."""

    name = "path"

    def convert(self, value: Any, param: object, ctx: object) -> Path:
        """Path of a text; a URL needs fsspec, which is imported only then."""
        del param, ctx  # click passes them to every type
        _refuse_empty(self, value)
        if isinstance(value, Path) or "://" not in str(value):
            return Path(value)
        from malus.scenes.core.remote import as_path

        return as_path(value)


class LocalPath(click.Path):
    """A path of this machine."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Path of a text, which click checks."""
        _refuse_empty(self, value)
        return super().convert(value, param, ctx)


def _refuse_empty(kind: click.ParamType[Any], value: Any) -> None:
    """Refuse what an unset variable of a shell leaves, which would be the current folder."""
    if not str(value):
        kind.fail("expected a path, found an empty text, as of an unset variable")


FOLDER = Folder()
LOCAL = LocalPath(path_type=Path)
LOCAL_FILE = LocalPath(path_type=Path, dir_okay=False)


class Numbers(click.ParamType[tuple[float, ...]]):
    """Numbers in one text, such as 0,45,90 or 640x480; `expected` says which, in messages."""

    def __init__(
        self,
        name: str,
        expected: str,
        count: int | None = None,
        separator: str = ",",
        number: type[float] = float,
    ) -> None:
        self.name, self._expected, self._count = name, expected, count
        self._separator, self._number = separator, number

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[float, ...]:
        """Parse the numbers; anything else ends in click's one-line message."""
        with suppress(ValueError):
            numbers = tuple(map(self._number, str(value).lower().split(self._separator)))
            if self._count in (None, len(numbers)):
                return numbers
        self.fail(f"expected {self._expected}, found {value!r}", param, ctx)


class Command(click.Command):
    """A command whose mistakes of input name its options, where a function names its parameters."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run it; an InputError that leaves it is told in the words of the command line."""
        try:
            return super().invoke(ctx)
        except ValueError as mistake:
            from malus.scenes.core.errors import InputError

            if not isinstance(mistake, InputError):
                raise
            raise InputError(*in_options(mistake.args, self.params)) from mistake


class Group(click.Group):
    """A group of commands whose help has them in the order of a job, each with what it does."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order in which they were added."""
        del ctx
        return list(self.commands)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the whole first sentence of each, in several lines where needed."""
        commands = {name: self.get_command(ctx, name) for name in self.list_commands(ctx)}
        with formatter.section("Commands"):
            formatter.write_dl(
                [(name, found.get_short_help_str(999)) for name, found in commands.items() if found]
            )


@contextmanager
def names_in(suite: str, given: Mapping[str, Sequence[str]]) -> Iterator[None]:
    """Say where a wrong name of a method or a metric stands: in a suite, unless it was `given`.

    Examples
    --------
    >>> from malus.scenes.core.errors import InputError
    >>> with names_in("mine.toml", {"methods": ()}):
    ...     raise InputError("method", "eq8", "eq9", "correct the name")
    Traceback (most recent call last):
        ...
    malus.scenes.core.errors.InputError: mine.toml, key methods: expected eq8, found eq9; ...
    """
    try:
        yield
    except ValueError as mistake:
        key = f"{mistake.args[0] if mistake.args else ''}s"
        if key not in ("methods", "metrics") or given.get(key):
            raise
        raise type(mistake)(f"{suite}, key {key}", *mistake.args[1:]) from None


def in_options(parts: tuple[str, ...], params: list[click.Parameter]) -> list[str]:
    """The four parts of an InputError with options in place of parameters.

    A parameter stands alone in the first part ("workers", "workers, scheduler"), and in backticks
    in any ("choose another `out`"). An option's own name stands for it too.

    Examples
    --------
    >>> params = [click.Option(["--method", "methods"]), click.Option(["--out"])]
    >>> in_options(("methods", "some", "none", "name `methods`, or another `out`"), params)
    ['--method', 'some', 'none', 'name --method, or another --out']
    >>> in_options(("method", "eq8", "eq9", "choose another"), params)[0]
    '--method'
    """
    options = {name: _told(p) for p in params for name in (p.name, _told(p).lstrip("-"))}
    where, *others = parts
    names = where.split(", ")
    if all(name in options for name in names):
        where = ", ".join(options[name] for name in names)
    return [
        re.sub(r"`(\w+)`", lambda quoted: options.get(quoted[1], quoted[0]), text)
        for text in (where, *others)
    ]


def _told(param: click.Parameter) -> str:
    return param.opts[0] if isinstance(param, click.Option) else str(param.name)


def command(name: str) -> Callable[[Callable[..., Any]], Command]:
    """Decorate a function as a command of that name."""
    return click.command(name, cls=Command)


backend_option = click.option("--backend", default="auto", help="auto, cuda, llvm or scalar.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print the numbers as JSON.")
split_option = click.option(
    "--split", type=click.Choice(("train", "val", "test")), help="Only the scenes of this split."
)
METHOD = "A method of `malus list methods`, or your own, module:object; may be repeated"
"""What `--method` takes."""

AnyFunction = Callable[..., Any]
Decorator = Callable[[AnyFunction], AnyFunction]


def together(*options: Decorator) -> Decorator:
    """A decorator that adds several options, which the help has in this order."""

    def decorated(function: AnyFunction) -> AnyFunction:
        for option in reversed(options):
            function = option(function)
        return function

    return decorated


size_options = together(
    click.option("--samples", type=int, help="Samples a pixel, instead of the suite's."),
    click.option("--resolution", type=int, help="Pixels a side, instead of the suite's."),
    click.option("--seed", type=int, help="Seed, instead of the suite's."),
)
"""Options that replace a suite's own values."""

metric_options = together(
    click.option(
        "--metric",
        "metrics",
        multiple=True,
        help="A further metric of `malus list metrics`; may be repeated.",
    ),
    click.option(
        "--profile",
        "profiles",
        multiple=True,
        type=click.Choice(("polaranything", "rgb2pol", "polarscale")),
        help="All metrics of a published benchmark, with the trivial guess beside them.",
    ),
)
"""Options that ask for further metrics, alone or as a published profile."""


def asked_metrics(metrics: Sequence[str], profiles: Sequence[str]) -> tuple[str, ...]:
    """Names of metrics, from what `metric_options` were given.

    Examples
    --------
    >>> asked_metrics(["psnr"], ["rgb2pol"])
    ('psnr', 'profile:rgb2pol')
    """
    return (*metrics, *(f"profile:{name}" for name in profiles))


work_options = together(
    click.option("--timeout", type=float, default=3600, help="Seconds a family may take [3600]."),
    click.option("--retry-failed", is_flag=True, help="Try again what failed in an earlier run."),
)
"""Options of time and of earlier failures."""
