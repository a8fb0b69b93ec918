"""The base of all data classes: frozen, strictly validated, identified by their content."""

from __future__ import annotations

import hashlib
import json
from typing import Any, Never, Self

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, model_validator

from malus.scenes.core.errors import InputError, counted
from malus.scenes.core.registry import lookup
from malus.scenes.core.validation import first_problem

PARSED = "parsed"
"""Context of a validation by `Model.parse`: the data may come from elsewhere, no file is opened."""

FOUND_IN = "found_in"
"""Key of the folder of a file: where it lies is no part of an id, what it holds is."""


class Model(BaseModel):
    """Frozen data without unknown keys, NaN or infinity; equal content has an equal id.

    Raises
    ------
    InputError
        For a wrong value, in one line that names the parameter. Where a model is part of another
        one's data, the message begins with the outer one.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def __init__(self, /, *unnamed: Never, **data: Any) -> None:
        """Validate the values of the fields, each given by its name."""
        if unnamed:
            raise self._by_name(unnamed)
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise first_problem(error, data, type(self).__name__) from None

    # So pydantic makes nested models without it, and an error in one keeps its place.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def _by_name(cls, unnamed: tuple[object, ...]) -> InputError:
        """What to say of values without a name, of which nobody knows what they are meant for."""
        keys = [name for name in cls.model_fields if name != "kind"]
        hint = f"write key=value; known: {', '.join(keys)}" if keys else "leave it out"
        found = f"{counted(len(unnamed), 'value')} without a name: {unnamed[0]!r}"
        return InputError(cls.__name__, "every value by its name", found, hint)

    def model_dump(self, **options: Any) -> dict[str, Any]:
        """The fields as plain values, each written by its own type.

        Pydantic would choose among the types of a union by calling Python, and go on whatever
        that raises: a Ctrl-C or a SIGTERM in this moment was lost, and the work went on.
        """
        return super().model_dump(**{"serialize_as_any": True, **options})

    @property
    def id(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of the canonical JSON of the identity."""
        return content_id(self.identity)

    @property
    def identity(self) -> Any:
        """The content as plain values, without the folders of files."""
        return _without_folders(self.model_dump(mode="json"))

    @classmethod
    def parse(cls, data: Any, where: str) -> Self:
        """Validate untrusted `data`; `where` names the file in the message.

        Nothing is converted but whole numbers to floats and lists to tuples.

        Raises
        ------
        InputError
            One line that names the key, what was expected and what was found.
        """
        try:
            return cls.model_validate(_tuples(data), strict=True, context=PARSED)
        except ValidationError as error:
            raise first_problem(error, data, where) from None
        except RecursionError:
            raise InputError(
                where, "a few levels", "too many", "this is no file of malus"
            ) from None

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict):
            return data
        fields = cls.model_fields
        for key in data:
            if key not in fields:
                lookup(str(key), fields, "key", "one of the keys here")
        # What is parsed stays to the bit: drawn and stored scenes keep their ids.
        if info.context == PARSED:
            return data
        return {key: _unsigned_zeros(value) for key, value in data.items()}


def content_id(content: Any) -> str:
    """First 16 hexadecimal digits of the SHA-256 of canonical JSON.

    Examples
    --------
    >>> content_id({"a": 1, "b": 2}) == content_id({"b": 2, "a": 1})
    True
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _without_folders(content: Any) -> Any:
    """Plain values without the folders of files, at any depth."""
    if isinstance(content, dict):
        return {k: _without_folders(value) for k, value in content.items() if k != FOUND_IN}
    if isinstance(content, list | tuple):
        return [_without_folders(value) for value in content]
    return content


def _unsigned_zeros(value: Any) -> Any:
    """A value, or a list of values, with 0.0 for -0.0: these are equal, and so shall be the ids."""
    if isinstance(value, list | tuple) and type(value) in (list, tuple):
        return type(value)(map(_unsigned_zeros, value))
    return value + 0.0 if isinstance(value, float) else value


def _tuples(data: Any) -> Any:
    """The data with tuples for lists, as TOML and JSON know only these."""
    if isinstance(data, dict):
        return {key: _tuples(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return tuple(_tuples(value) for value in data)
    return data
