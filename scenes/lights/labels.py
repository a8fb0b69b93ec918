"""Names of lights in tables."""

from __future__ import annotations

from malus.scenes.core.model import Model
from malus.scenes.core.named_file import NamedFile


def other_keys(light: Model, *named: str) -> str:
    """End of a light's name: every key that is not at its default, but for those named already.

    Of a file, which its light names itself, no key is told.

    Examples
    --------
    >>> from malus.scenes import Sky
    >>> other_keys(Sky(sun_azimuth_deg=90, turbidity=5), "sun_elevation_deg")
    ' sun azimuth 90° turbidity 5'
    """
    told = {
        key: getattr(light, key)
        for key, field in type(light).model_fields.items()
        if key not in (*named, *NamedFile.model_fields) and getattr(light, key) != field.default
    }
    return "".join(f" {_words(key, value)}" for key, value in told.items())


def _words(key: str, value: float) -> str:
    """A key and its value: "half angle 15°"."""
    unit = "°" if key.endswith("_deg") else " nm" if key.endswith("_nm") else ""
    name = key.removesuffix("_deg").removesuffix("_nm").replace("_", " ")
    return f"{name} {value:g}{unit}"
