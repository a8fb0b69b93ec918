"""The base of all data classes: frozen, strictly validated, identified by their content."""

from __future__ import annotations

import hashlib
import json
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from malus.scenes.core.errors import InputError
from malus.scenes.core.registry import lookup
from malus.scenes.core.validation import first_problem


class Model(BaseModel):
    """Frozen data without unknown keys, NaN or infinity; equal content has an equal id."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @property
    def id(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of the canonical JSON of the content."""
        return content_id(self.model_dump(mode="json"))

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
            return cls.model_validate(_tuples(data), strict=True)
        except ValidationError as error:
            raise first_problem(error, data, where) from None
        except RecursionError:
            raise InputError(
                where, "a few levels", "too many", "this is no file of malus"
            ) from None

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        for key in data if isinstance(data, dict) else ():
            lookup(str(key), cls.model_fields, "key", "one of the keys here")
        return data


def content_id(content: Any) -> str:
    """First 16 hexadecimal digits of the SHA-256 of canonical JSON.

    Examples
    --------
    >>> content_id({"a": 1, "b": 2}) == content_id({"b": 2, "a": 1})
    True
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _tuples(data: Any) -> Any:
    """The data with tuples for lists, as TOML and JSON know only these."""
    if isinstance(data, dict):
        return {key: _tuples(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return tuple(_tuples(value) for value in data)
    return data
