"""The exception for a user's mistake, and the errors of other libraries turned into it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

_FOUND_CHARACTERS = 80
"""Most characters of a wrong value that a message repeats."""


class InputError(ValueError):
    """A user's mistake, described in one line; the command line turns it into exit code 2.

    Parameters
    ----------
    where : str
        File, key or parameter.
    expected : str
        What would have been right.
    found : str
        What was there instead; shortened to 80 characters.
    hint : str
        What to do about it.

    Examples
    --------
    >>> print(InputError("suite.toml, key alpha", "a number > 0", "-1", "correct this value"))
    suite.toml, key alpha: expected a number > 0, found -1; correct this value
    """

    def __init__(self, where: str, expected: str, found: str, hint: str) -> None:
        """Take the four parts as they are; `str` joins, escapes and shortens them."""
        # The four parts are the exception's args, so that it survives pickling between processes.
        super().__init__(where, expected, found, hint)
        self.where = where
        self.expected = expected
        self.found = found
        self.hint = hint

    def __str__(self) -> str:
        """One printable line, whatever the parts contain."""
        found = _shortened(printable(self.found))
        if not found.strip():  # an empty text would not be seen
            found = repr(found)
        return (
            f"{printable(self.where)}: expected {printable(self.expected)}, "
            f"found {found}; {printable(self.hint)}"
        )


def check_kind(where: str, value: object, kind: type, hint: str) -> None:
    """Raise InputError for a value of another class than a public one, `kind`.

    Examples
    --------
    >>> check_kind("error", 3, InputError, "raise one")
    Traceback (most recent call last):
        ...
    malus.scenes.core.errors.InputError: error: expected a malus.InputError, found int; raise one
    """
    if not isinstance(value, kind):
        raise InputError(where, f"a malus.{kind.__name__}", type(value).__name__, hint)


def printable(text: object) -> str:
    r"""Text with control characters, line breaks and lone surrogates written as escapes.

    What is no text is that of `str`.

    Examples
    --------
    >>> printable("two\nlines")
    'two\\nlines'
    """
    shown = str(text)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in shown)


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number with its noun.

    Examples
    --------
    >>> counted(1, "scene"), counted(2, "body", "bodies")
    ('1 scene', '2 bodies')
    """
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def _shortened(text: str) -> str:
    return text if len(text) <= _FOUND_CHARACTERS else text[: _FOUND_CHARACTERS - 3] + "..."


@contextmanager
def reading(where: str, expected: str, hint: str) -> Iterator[None]:
    """Turn whatever another library raises on a broken file into one InputError.

    Raises
    ------
    InputError
        With the first line of what was raised; an InputError passes as it is.

    Examples
    --------
    >>> with reading("notes.txt", "a number", "write one"):
    ...     float("7a")
    Traceback (most recent call last):
        ...
    malus.scenes.core.errors.InputError: notes.txt: expected a number, found could not convert ...
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(where, expected, first_line(error), hint) from None


def kind_of(error: BaseException) -> str:
    """Kind of an unforeseen exception, with the notes that were added to it: where it was raised.

    Examples
    --------
    >>> error = KeyError("gain")
    >>> error.add_note("my_method.py, line 12")
    >>> kind_of(error), kind_of(KeyError("gain"))
    ('KeyError (my_method.py, line 12)', 'KeyError')
    """
    notes = "; ".join(getattr(error, "__notes__", ()))
    return type(error).__name__ + (f" ({notes})" if notes else "")


def first_line(error: Exception) -> str:
    """The first line of an exception's message; its type's name where it has none.

    Examples
    --------
    >>> first_line(ValueError("bad header\\nat byte 7")), first_line(KeyError())
    ('bad header', 'KeyError')
    """
    reason = getattr(error, "strerror", None)  # of other libraries' errors it may be anything
    message = reason if reason and isinstance(reason, str) else str(error)
    return next(iter(message.strip().splitlines()), type(error).__name__)
