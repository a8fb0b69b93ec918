"""Method `net`: polarisation from a picture alone, by a network trained on malus' scenes."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from malus.reconstruct.learned.channels import at_bands, channel_weights
from malus.reconstruct.learned.network import Network, Output, network
from malus.reconstruct.learned.scale import Size, interpolated, resized
from malus.reconstruct.observation import Components, Inapplicable, Observation
from malus.scenes.core.arrays import BoolArray, Float32Array, Float64Array, FloatArray
from malus.scenes.core.errors import counted

FEWEST = 16
"""Fewest pixels that are worth looking at."""


def net(
    observation: Observation,
    weights: Path | None = None,
    side: int | None = None,
    around: bool = False,
) -> Components:
    """Polarisation components from one picture, and its mask where there is one.

    Parameters
    ----------
    observation : Observation
        `image` (height, width, bands) in linear light of any unit, `mask`, and the wavelengths of
        the bands; three bands without wavelengths are red, green and blue. Nothing else is used.
    weights : path of a file that `malus train` wrote; None is the one that malus brings
    side : int, optional
        Pixels of the longer side that larger pictures are reduced to for the network: by default
        those of its training. The sizes at which it sees them are this times its magnifications.
    around : bool
        Show the network the picture around the mask too, which is dark otherwise.

    Returns
    -------
    Components
        (height, width, bands), zero off the mask, with the standard deviation of s1/s0 and s2/s0
        that the network states. Pixels that are no number are False in `valid`.

    Raises
    ------
    Inapplicable
        Without the runtime or weights, of a picture without light, or of several bands of unknown
        wavelengths that are not three.
    InputError
        If the file of weights cannot be read.

    Notes
    -----
    The picture is divided by its mean over channels and valid pixels, so that exposure means
    nothing. It is brought to the sizes that the file of weights names (`Description.sizes`); at
    each the network sees it and its mirror image, whose polarisation is the mirrored one. All
    answers are averaged; their ratios are brought back by interpolation and multiplied by the light
    of every pixel.
    """
    model = network(weights)
    image, mask = observation.image, observation.mask
    to_channels = channel_weights(image.shape[2], observation.wavelengths_nm)
    valid = np.asarray(np.isfinite(image).all(axis=-1))
    seen = valid if around else valid & mask
    sizes = model.about.sizes((image.shape[0], image.shape[1]), side)
    output, kept = _seen_at(sizes, model, image, seen, to_channels)
    inside = valid & mask
    s1, s2, deviation = (_at_full_size(values, kept, inside, to_channels) for values in output)
    lit = np.where(inside[..., None], np.maximum(image, 0), 0)
    s1 *= lit
    s2 *= lit
    dtype = np.result_type(image.dtype, np.float32)
    return Components(
        image,
        s1.astype(dtype, copy=False),
        s2.astype(dtype, copy=False),
        valid,
        deviation=deviation,
    )


def _seen_at(
    sizes: Sequence[Size],
    model: Network,
    image: FloatArray,
    seen: BoolArray,
    to_channels: Float64Array,
) -> tuple[Output, BoolArray]:
    """Mean of what the network says of a picture at several sizes, and where it saw anything.

    The mean is taken at the size of the picture, or at the largest of `sizes` where that is less.
    """
    common = min((image.shape[0], image.shape[1]), max(sizes))
    told = []
    where = seen
    for size in sizes:
        light, kept = resized(np.maximum(image, 0), seen, size)
        _require_pixels(seen, kept)
        shown = _normalised(light @ to_channels.T.astype(np.float32), kept)
        output = _physical(_seen_both_ways(model, shown))
        if size == common:
            where = kept
        else:
            output = Output(*(interpolated(values, kept, common) for values in output))
        told.append(output)
    s1, s2, deviation = (np.stack(each) for each in zip(*told, strict=True))
    return Output(s1.mean(0), s2.mean(0), np.sqrt(np.square(deviation).mean(0))), where


def _require_pixels(seen: BoolArray, kept: BoolArray) -> None:
    """Raise Inapplicable where a picture, or what is kept of it at another size, shows too little.

    `seen` are its pixels as given, `kept` those that the network would be shown.
    """
    if (count := int(np.count_nonzero(seen))) < FEWEST:
        few = f"{counted(count, 'pixel')} of the picture or its mask: too few"
        raise Inapplicable(f"{few}, {FEWEST} are needed")
    if (count := int(np.count_nonzero(kept))) < FEWEST:
        few = f"{counted(count, 'pixel')} of the reduced picture: too few"
        raise Inapplicable(f"{few}; a larger net_size shows more")


def _normalised(light: Float32Array, seen: BoolArray) -> Float32Array:
    """Light (height, width, 3) over its mean where it is seen."""
    mean = float(light[seen].mean(dtype=np.float64))
    if not mean > 0:
        raise Inapplicable("no light in the picture")
    return light / np.float32(mean)


def _seen_both_ways(model: Network, picture: Float32Array) -> Output:
    """Mean of what the network says of a picture and of its mirror image, mirrored back.

    A mirror from left to right turns +45° into −45°: s2 changes its sign. So the picture in a
    mirror has exactly the mirrored polarisation, which training teaches a network only nearly.
    """
    plain = model.run(picture)
    mirrored = Output(*(a[:, ::-1] for a in model.run(np.ascontiguousarray(picture[:, ::-1]))))
    return Output(
        0.5 * (plain.s1 + mirrored.s1),
        0.5 * (plain.s2 - mirrored.s2),
        np.sqrt(0.5 * (plain.deviation**2 + mirrored.deviation**2)),
    )


def _physical(output: Output) -> Output:
    """Ratios that are at most completely polarised light, deviations that are not negative."""
    over: Float32Array = np.maximum(np.hypot(output.s1, output.s2), np.float32(1))
    return Output(output.s1 / over, output.s2 / over, np.maximum(output.deviation, 0))


def _at_full_size(
    values: Float32Array, kept: BoolArray, inside: BoolArray, to_channels: Float64Array
) -> Float32Array:
    """Values (height, width, 3) of the network for all bands, at the size of the picture."""
    bands = at_bands(values, to_channels)
    if kept.shape != inside.shape:
        bands = interpolated(bands, kept, (inside.shape[0], inside.shape[1]))
    bands[~inside] = 0
    return bands


def is_network(name: str | None) -> bool:
    """Whether a method of that name is a network: its function takes the `side` to work at.

    Examples
    --------
    >>> is_network("net"), is_network("net:mine.onnx"), is_network("blind"), is_network(None)
    (True, True, False, False)
    """
    return (name or "").partition(":")[0] in (NET, AROUND)


def weights_of(name: str) -> Path | None:
    """The file of a method `net:FILE`; None of the network that malus brings.

    Examples
    --------
    >>> weights_of("net:mine.onnx").name, weights_of("net")
    ('mine.onnx', None)
    """
    file = name.partition(":")[2]
    return Path(file) if file else None


def net_of_file(reference: str) -> tuple[Callable[[Observation], Components], str]:
    """Function and summary of a method `net:FILE` or `net-around:FILE`."""
    file = weights_of(reference)
    with suppress(Inapplicable):
        network(file)
    around = reference.startswith(f"{AROUND}:")
    function = functools.partial(net, weights=file, around=around)
    return function, f"the network of {reference.partition(':')[2]}"


NET, AROUND = "net", "net-around"
NET_METHODS: tuple[tuple[str, frozenset[str], Callable[[Observation], Components], str], ...] = (
    (NET, frozenset(), net, "a network trained on random scenes: the picture alone, or its mask"),
    (
        AROUND,
        frozenset(),
        functools.partial(net, around=True),
        "net, but the picture around the mask is seen too",
    ),
)
"""Name, needs, function and summary of each method; `malus.reconstruct.methods` declares them."""
