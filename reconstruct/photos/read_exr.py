"""OpenEXR pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from malus.reconstruct.photos.picture import Picture, check_size, divided_by_alpha
from malus.scenes.core.arrays import AnyArray, Float32Array
from malus.scenes.core.errors import InputError, counted, reading
from malus.scenes.core.quiet import quiet

_STRUCTURE = frozenset(
    {"channels", "compression", "lineOrder", "type", "tiles", "version", "chunkCount", "name"}
)
"""Parts of a header that a writer decides itself."""
_LOSSLESS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ")
_REC709 = (0.2126, 0.7152, 0.0722)
"""Luminance of OpenEXR's default primaries."""


def read_exr(path: Path, linear: bool, part: str | None = None) -> Picture:
    """An OpenEXR picture: R, G, B, or Y, or Y with chroma, of half or float; `part` by its name.

    Data and display windows are kept, and further channels as they are. Colours are divided by
    their opacity A, as OpenEXR stores them multiplied by it.

    Raises
    ------
    InputError
        Several parts where none is chosen, deep data, other channels, values that are not finite.
    """
    del linear  # OpenEXR holds light
    header, channels, names_of_parts = _decoded(path, part)
    layer = _layer(path, channels, part if part not in names_of_parts else None)
    colours, values, notes = _colours(path, channels, header, layer)
    if not np.isfinite(values).all():
        bad = int(np.count_nonzero(~np.isfinite(values)))
        raise InputError(str(path), "finite values", counted(bad, "other"), "clean the picture")
    alpha = channels.get(f"{layer}A")
    used = (*colours, f"{layer}A")
    others = {name: plane for name, plane in channels.items() if name not in used}
    if others:
        notes = (*notes, f"channels {', '.join(sorted(others))} are written back as they are")
    levels = getattr(getattr(header.get("tiles"), "mode", None), "name", "ONE_LEVEL")
    if levels != "ONE_LEVEL":
        notes = (*notes, "the largest level of detail is read; smaller ones are left out")
    if len(names_of_parts) > 1:
        notes = (*notes, f"part {part} is read, and alone in what is written")
    is_chroma = f"{layer}RY" in colours
    metadata = {
        "header": {k: _stored(v) for k, v in header.items() if k not in _STRUCTURE},
        "compression": getattr(header["compression"], "name", "").split("_")[0],
        "names": tuple(f"{layer}{name}" for name in "RGB") if is_chroma else colours,
        "alpha": f"{layer}A",
        "dtype": values.dtype,
    }
    light = values.astype(np.float32, copy=False)
    if alpha is not None:
        light = divided_by_alpha(light, alpha)
    return Picture(light, "EXR", None, alpha, metadata, alpha is not None, notes, others)


def read_exr_vectors(path: Path) -> AnyArray | None:
    """Vectors (height, width, 3) in channels X, Y, Z of an OpenEXR file; None where it has none.

    Of several layers with these channels, as renderers write them, the one is read that has
    "normal" in its name.

    Raises
    ------
    InputError
        Several parts, deep data, or layers of which none or several are called normals.
    """
    _, channels, _ = _decoded(path, None)
    names = {name.rpartition(".")[0] for name in channels if name.rpartition(".")[2] == "X"}
    layers = [(f"{name}." if name else "") for name in sorted(names)]
    layers = [layer for layer in layers if {f"{layer}Y", f"{layer}Z"} <= channels.keys()]
    if len(layers) > 1:
        called = [layer for layer in layers if "normal" in layer.lower()]
        if len(called) != 1:
            listed = ", ".join(layer.removesuffix(".") or "X, Y, Z" for layer in layers)
            expected = "one layer of X, Y, Z that is called normal"
            raise InputError(
                str(path), expected, listed, "write the normals to a file of their own"
            )
        layers = called
    if not layers:
        return None
    with reading(str(path), "channels X, Y, Z of one size", "write them in one size"):
        return np.stack([channels[f"{layers[0]}{axis}"] for axis in "XYZ"], axis=-1)


def _decoded(path: Path, part: str | None) -> tuple[dict[str, Any], dict[str, AnyArray], list[str]]:
    """Header and channels of the part that is meant, and the names of all parts."""
    import OpenEXR

    with reading(str(path), "a whole OpenEXR file", "save it again"):
        with quiet(), OpenEXR.File(str(path), header_only=True) as file:
            headers = [dict(stored.header) for stored in file.parts]
        index = _chosen(path, headers, part)
        _check_header(path, headers[index])
        with quiet(), OpenEXR.File(str(path), separate_channels=True) as file:
            parts = file.parts
            if len(parts) <= index:  # OpenEXR drops what it cannot decode
                hint = "save it again as scan lines, without levels of detail"
                raise InputError(
                    str(path), "a whole OpenEXR file", "pixels that cannot be read", hint
                )
            channels = {name: channel.pixels for name, channel in parts[index].channels.items()}
    return headers[index], channels, _names(headers)


class StoredArray(NamedTuple):
    """An array of a header, in a form that compares as a whole."""

    dtype: str
    shape: tuple[int, ...]
    content: bytes


def _stored(value: Any) -> Any:
    """A header's value with arrays in a form that compares as a whole."""
    if isinstance(value, np.ndarray):
        return StoredArray(value.dtype.str, value.shape, value.tobytes())
    return tuple(_stored(item) for item in value) if isinstance(value, tuple) else value


def restored(value: Any) -> Any:
    """The inverse, for OpenEXR's writer."""
    if isinstance(value, StoredArray):
        return np.frombuffer(value.content, dtype=value.dtype).reshape(value.shape)
    return tuple(restored(item) for item in value) if isinstance(value, tuple) else value


def _chosen(path: Path, headers: list[dict[str, Any]], part: str | None) -> int:
    """Index of the part that is meant."""
    names = _names(headers)
    if part is None and len(headers) > 1:
        hint = "choose one by its name with `part`"
        raise InputError(str(path), "one picture", f"parts {', '.join(names)}", hint)
    if part is not None and part not in names and len(headers) > 1:
        raise InputError("part", f"one of {', '.join(names)}", part, "choose one of them")
    return names.index(part) if part in names else 0


def _names(headers: list[dict[str, Any]]) -> list[str]:
    """Names of the parts, or their numbers from 1."""
    return [str(header.get("name", number)) for number, header in enumerate(headers, 1)]


def _layer(path: Path, channels: dict[str, AnyArray], wanted: str | None) -> str:
    """What stands before the colours' names: nothing, or a layer's name and a dot."""
    colours = {name.rpartition(".") for name in channels if name.rpartition(".")[2] in ("R", "Y")}
    layers = sorted(f"{layer}{dot}" for layer, dot, _ in colours)
    if wanted is not None:
        if f"{wanted}." not in layers:
            listed = ", ".join(layer[:-1] for layer in layers if layer) or "none: leave it out"
            raise InputError("part", f"a layer of {listed}", wanted, "choose one of them")
        return f"{wanted}."
    if len(layers) > 1 and "" not in layers:
        listed = ", ".join(layer[:-1] for layer in layers)
        hint = "choose one by its name with `part`"
        raise InputError(str(path), "one picture", f"layers {listed}", hint)
    return "" if "" in layers or not layers else layers[0]


def _check_header(path: Path, header: dict[str, Any]) -> None:
    """Refuse sizes and kinds of storage before a pixel is decoded."""
    window = header["dataWindow"]
    width, height = (int(b) - int(a) + 1 for a, b in zip(*window, strict=True))
    check_size(path, width, height)
    storage = getattr(header["type"], "name", str(header["type"]))
    if "deep" in storage:
        hint = "flatten it first"
        raise InputError(str(path), "one value a pixel and channel", "deep data", hint)


def _colours(
    path: Path, channels: dict[str, AnyArray], header: dict[str, Any], layer: str
) -> tuple[tuple[str, ...], AnyArray, tuple[str, ...]]:
    """Names of the colour channels, their values (height, width, 1 or 3), and notes."""
    y, red, blue = (f"{layer}{name}" for name in ("Y", "RY", "BY"))
    if {y, red, blue} <= set(channels):
        weights = _luminance_weights(header)
        values = from_luminance_chroma(channels[y], channels[red], channels[blue], weights)
        notes = ("luminance and chroma are written as R, G, B",)
        return (y, red, blue), values.astype(channels[y].dtype), notes
    choices = (tuple(f"{layer}{name}" for name in "RGB"), (y,))
    names = next((choice for choice in choices if set(choice) <= set(channels)), None)
    if names is None:
        listed = ", ".join(sorted(channels))
        raise InputError(str(path), "channels R, G, B or Y", listed, "choose another file")
    planes = [channels[name] for name in names]
    uneven = len({plane.shape for plane in planes}) > 1
    if uneven or any(plane.dtype.kind != "f" for plane in planes):
        form = "channels of different sizes" if uneven else "whole numbers"
        raise InputError(str(path), "half or float channels of one size", form, "convert it")
    return names, np.stack(planes, axis=-1), ()


def from_luminance_chroma(
    luminance: AnyArray, red: AnyArray, blue: AnyArray, weights: tuple[float, float, float]
) -> Float32Array:
    """R, G, B (height, width, 3) of Y, RY = (R − Y) / Y and BY = (B − Y) / Y.

    Chroma may have every other pixel only; it is interpolated. Source: OpenEXR, "Luminance/chroma
    images".

    Examples
    --------
    >>> y, zero = np.full((2, 2), 0.5), np.zeros((2, 2))
    >>> from_luminance_chroma(y, zero, zero, (0.2126, 0.7152, 0.0722))[0, 0].round(6).tolist()
    [0.5, 0.5, 0.5]
    """
    y = luminance.astype(np.float32)
    red, blue = (_enlarged(c.astype(np.float32), y.shape) for c in (red, blue))
    r, b = (red + 1) * y, (blue + 1) * y
    g = (y - np.float32(weights[0]) * r - np.float32(weights[2]) * b) / np.float32(weights[1])
    return np.stack([r, g, b], axis=-1)


def _enlarged(chroma: Float32Array, shape: tuple[int, ...]) -> Float32Array:
    """Chroma at every pixel, from samples at every n-th, which begin at the first."""
    if chroma.shape == shape:
        return chroma
    for axis, length in enumerate(shape):
        step = -(-length // chroma.shape[axis])
        places = np.minimum(np.arange(length) / step, chroma.shape[axis] - 1)
        low = np.floor(places).astype(int)
        high = np.minimum(low + 1, chroma.shape[axis] - 1)
        share = np.expand_dims((places - low).astype(np.float32), 1 - axis)
        lower, upper = np.take(chroma, low, axis=axis), np.take(chroma, high, axis=axis)
        chroma = lower + share * (upper - lower)
    return chroma


def _luminance_weights(header: dict[str, Any]) -> tuple[float, float, float]:
    """Luminance of R, G and B, by the header's primaries or OpenEXR's default."""
    stated = header.get("chromaticities")
    if stated is None:
        return _REC709
    pairs = np.asarray(stated, dtype=np.float64).reshape(4, 2)
    xyz = np.stack([pairs[:, 0] / pairs[:, 1], np.ones(4), (1 - pairs.sum(1)) / pairs[:, 1]])
    scale = np.linalg.solve(xyz[:, :3], xyz[:, 3])
    return float(scale[0]), float(scale[1]), float(scale[2])


def lossless_compression(name: str) -> str:
    """A file's own compression where that loses nothing, or ZIP.

    Examples
    --------
    >>> lossless_compression("PIZ"), lossless_compression("DWAA")
    ('PIZ', 'ZIP')
    """
    return name if name in _LOSSLESS else "ZIP"
