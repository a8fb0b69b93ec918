"""What the data classes of a scene share: frozen, strict, hashed by content."""

from __future__ import annotations

import hashlib
import json
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from malus.scenes.errors import InputError


class Model(BaseModel):
    """A frozen value without unknown keys, NaN or infinity; equal content has an equal id."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @property
    def id(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of the canonical JSON of the content."""
        return content_id(self.model_dump(mode="json"))

    @classmethod
    def parse(cls, data: Any, where: str) -> Self:
        """Validate untrusted `data`; `where` names the file in the message.

        Raises
        ------
        InputError
            One line that names the key, what was expected and what was found.
        """
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            raise _first_problem(error, where) from None


def content_id(content: Any) -> str:
    """First 16 hexadecimal digits of the SHA-256 of canonical JSON.

    Examples
    --------
    >>> content_id({"a": 1, "b": 2}) == content_id({"b": 2, "a": 1})
    True
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _first_problem(error: ValidationError, where: str) -> InputError:
    problems = error.errors(include_url=False)
    # Where a value may be one of several types, the deepest complaint is about the one meant.
    first = max(problems, key=lambda problem: len(problem["loc"]))
    key = ".".join(str(part) for part in first["loc"]) or "(top level)"
    told = first.get("ctx", {}).get("error")
    if isinstance(told, InputError):
        return InputError(f"{where}, {told.where}", told.expected, told.found, told.hint)
    missing = first["type"] == "missing"
    more = f"; {len(problems) - 1} more problem(s) follow" if len(problems) > 1 else ""
    return InputError(
        where=f"{where}, key {key}",
        expected=_expectation(first["type"], first["msg"]),
        found="nothing" if missing else repr(first["input"]),
        hint=("add this key" if missing else "correct this value") + more,
    )


def _expectation(kind: str, message: str) -> str:
    if kind == "extra_forbidden":
        return "no such key"
    for prefix in ("Input should be ", "Value error, "):
        message = message.removeprefix(prefix)
    return message
