"""JSON that every reader takes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


def json_text(values: Any, indent: int | None = None, sort_keys: bool = False) -> str:
    """Plain values as JSON; numbers that are not finite, which JSON does not have, are null.

    Examples
    --------
    >>> json_text({"skill": float("nan"), "angles": (0.0, 45.0)})
    '{"skill": null, "angles": [0.0, 45.0]}'
    """
    return json.dumps(_plain(values), indent=indent, sort_keys=sort_keys, allow_nan=False)


def _plain(values: Any) -> Any:
    if isinstance(values, Mapping):
        return {key: _plain(value) for key, value in values.items()}
    if isinstance(values, (list, tuple)):
        return [_plain(value) for value in values]
    return None if isinstance(values, float) and not math.isfinite(values) else values
