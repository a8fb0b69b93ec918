"""Draws the pictures of the glossary, most of them from renders: run it in this folder.

Each picture is a function of a few truths and has the name of its file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import malus
from malus.reconstruct import Components, specular_dolp
from malus.reconstruct.fresnel import reflectances
from malus.renderers import Truth
from malus.scenes.core.arrays import FloatArray
from malus.scenes.polarisation import aolp, dolp, extremes, phase

FOLDER = Path(__file__).parents[2] / "reports" / "docs" / "start" / "glossary"
HEIGHT = 1.15
"""Inches; every picture is a strip of square panels."""


class Balls(NamedTuple):
    """Truths that the pictures show: an orange ball under a lamp, and three dark ones."""

    lit: Truth
    rough: tuple[Truth, ...]


ROUGHNESS = (0.05, 0.15, 0.4)


def balls(resolution: int = 112, samples: int = 256) -> Balls:
    """Render them, at any size."""
    sampling = malus.Sampling(samples=samples)
    camera = malus.Camera(resolution=resolution)

    def ball(surface: malus.Dielectric, light: malus.Light) -> Truth:
        scene = malus.Scene(
            shape=malus.Sphere(), surface=surface, light=light, camera=camera, wavelengths_nm=(550,)
        )
        return malus.render(scene, sampling)

    lamp = malus.Area(incidence_deg=55, azimuth_deg=60, half_angle_deg=30)
    lit = malus.Dielectric(eta=1.5, alpha=0.2, albedo=0.3, body="polarised")
    dark = [malus.Dielectric(eta=1.5, alpha=alpha, albedo=0.05) for alpha in ROUGHNESS]
    narrow = malus.Area(incidence_deg=45, azimuth_deg=60, half_angle_deg=5, radiance=60)
    return Balls(ball(lit, lamp), tuple(ball(surface, narrow) for surface in dark))


def _strip(panels: int) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure(figsize=(HEIGHT * panels * 1.02, HEIGHT * 1.17), layout="constrained", dpi=110)
    figure.get_layout_engine().set(w_pad=0.02, h_pad=0.02)
    return figure, figure.subplots(1, panels, squeeze=False)[0]


def _show(ax: Axes, values: FloatArray, title: str, truth: Truth, **how: Any) -> None:
    ax.set_title(title, fontsize=7, pad=2)
    ax.set_axis_off()
    ax.imshow(np.where(truth.mask, values, np.nan), **{"cmap": "gray", "vmin": 0, **how})


def _images(truth: Truth, named: dict[str, FloatArray], **how: Any) -> Figure:
    """Pictures side by side, on one scale."""
    figure, axes = _strip(len(named))
    top = max(float(np.nanpercentile(image[truth.mask], 99.7)) for image in named.values())
    for ax, (title, image) in zip(axes, named.items(), strict=True):
        _show(ax, image, title, truth, **{"vmax": top, **how})
    return figure


def _band(values: FloatArray) -> FloatArray:
    return values[:, :, 0]


def polariser(shown: Balls) -> Figure:
    """The same ball through a polariser at four angles."""
    truth = shown.lit
    return _images(truth, {f"{a}°": _band(truth.polarised(a)) for a in (0, 45, 90, 135)})


def extremes_of_light(shown: Balls) -> Figure:
    """Most and least light of each pixel."""
    most, least = extremes(_band(shown.lit.stokes))
    return _images(shown.lit, {"I_max": most, "I_min": least})


def phase_angle(shown: Balls) -> Figure:
    """At which angle a pixel is brightest."""
    turned = np.degrees(phase(_band(shown.lit.stokes)))
    return _images(shown.lit, {"ψ, 0° to 180°": turned}, cmap="hsv", vmax=180)


def stokes(shown: Balls) -> Figure:
    """The three numbers of every pixel that a camera can measure."""
    vectors = _band(shown.lit.stokes)
    figure, axes = _strip(3)
    top = float(np.percentile(vectors[shown.lit.mask, 0], 99.7))
    _show(axes[0], vectors[..., 0], "s0", shown.lit, vmax=top)
    for part in (1, 2):
        ratio = vectors[..., part] / top
        _show(axes[part], ratio, f"s{part}", shown.lit, cmap="RdBu_r", vmin=-0.15, vmax=0.15)
    return figure


def degree(shown: Balls) -> Figure:
    """The polarised share of the light."""
    share = dolp(_band(shown.lit.stokes))
    return _images(shown.lit, {"DoLP, 0 to 0.6": share}, cmap="viridis", vmax=0.6)


def angle(shown: Balls) -> Figure:
    """The direction in which light oscillates."""
    turned = np.degrees(aolp(_band(shown.lit.stokes)))
    return _images(shown.lit, {"AoLP, 0° to 180°": turned}, cmap="hsv", vmax=180)


def lobes(shown: Balls) -> Figure:
    """Specular and diffuse light, and their sum."""
    truth = shown.lit
    parts = {"specular": truth.specular, "diffuse": truth.diffuse, "both": truth.stokes}
    return _images(truth, {name: _band(part)[..., 0] for name, part in parts.items()})


def body(_: Balls) -> Figure:
    """A ray that the surface mirrors, and one that scatters in the body below."""
    figure, (ax,) = _strip(1)
    figure.set_size_inches(HEIGHT * 1.9, HEIGHT * 1.17)
    ax.set_axis_off()
    ax.set(xlim=(-1.6, 1.6), ylim=(-0.9, 1.1))
    ax.fill_between([-1.6, 1.6], -0.9, 0, color="#e8c9a4")
    ax.plot([-1.6, 1.6], [0, 0], color="#7a5a36", lw=1.5)
    _arrow(ax, (-1.1, 0.9), (-0.35, 0.02), "black")
    _arrow(ax, (-0.35, 0.02), (0.4, 0.9), "tab:blue")
    inside = np.array(
        [(-0.35, 0), (-0.1, -0.35), (0.25, -0.2), (0.1, -0.55), (0.65, -0.4), (0.8, 0)]
    )
    ax.plot(*inside.T, color="tab:red", lw=1)
    _arrow(ax, (0.8, 0.0), (1.1, 0.9), "tab:red")
    for x, y, text, ink in (
        (0.1, 0.95, "specular", "tab:blue"),
        (1.15, 0.95, "diffuse", "tab:red"),
        (-1.2, -0.6, "body", "#7a5a36"),
    ):
        ax.text(x, y, text, fontsize=7, ha="center", color=ink)
    return figure


def _arrow(ax: Axes, start: tuple[float, float], end: tuple[float, float], ink: str) -> None:
    ax.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": ink, "lw": 1.2})


def roughness(shown: Balls) -> Figure:
    """The same lamp mirrored by three surfaces."""
    named = {
        f"α = {alpha:g}": np.sqrt(_band(truth.image))
        for alpha, truth in zip(ROUGHNESS, shown.rough, strict=True)
    }
    return _images(shown.rough[0], named)


def _plot() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(HEIGHT * 2, HEIGHT * 1.5), layout="constrained", dpi=110)
    ax = figure.subplots()
    ax.tick_params(labelsize=6)
    ax.spines[["top", "right"]].set_visible(False)
    return figure, ax


def refractive_index(_: Balls) -> Figure:
    """Reflectance against the angle of incidence, for the two directions of oscillation."""
    figure, ax = _plot()
    degrees = np.linspace(0, 89, 90)
    across, along = reflectances(np.cos(np.radians(degrees)), 1.5)
    ax.plot(degrees, across, label="across the plane of incidence")
    ax.plot(degrees, along, label="in it")
    ax.set_title("reflectance (η = 1.5) against incidence/°", fontsize=7)
    ax.legend(fontsize=6, frameon=False)
    return figure


def family(_: Balls) -> Figure:
    """A few nodes in the index, and what is interpolated between them."""
    figure, ax = _plot()
    zenith = np.radians(60.0)
    index, nodes = np.linspace(1.3, 1.8, 60), np.linspace(1.3, 1.8, 5)
    ax.plot(index, [float(specular_dolp(zenith, eta, 0.2)) for eta in index], color="tab:blue")
    ax.plot(
        nodes, [float(specular_dolp(zenith, eta, 0.2)) for eta in nodes], "o", color="tab:orange"
    )
    ax.set_title("a pixel against η: rendered, interpolated", fontsize=7)
    return figure


def observation(shown: Balls) -> Figure:
    """What a method may see: the picture, the mask, the normals."""
    truth = shown.lit
    figure, axes = _strip(3)
    top = float(np.percentile(_band(truth.image)[truth.mask], 99.7))
    _show(axes[0], _band(truth.image), "picture", truth, vmax=top)
    axes[1].imshow(truth.mask, cmap="gray")
    colours = np.where(truth.mask[..., None], 0.5 + 0.5 * truth.normals, 1.0)
    axes[2].imshow(np.clip(colours, 0, 1))
    for ax, title in zip(axes[1:], ("mask", "normals"), strict=True):
        ax.set_title(title, fontsize=7, pad=2)
        ax.set_axis_off()
    return figure


def _estimate(truth: Truth) -> Components:
    observed = malus.observe(truth, malus.get_method("eq8").needs)
    return malus.get_method("eq8").reconstruct(observed)


def error(shown: Balls) -> Figure:
    """Truth, estimate, and the square of their difference."""
    truth = shown.lit
    true, estimated = _band(truth.polarised(60)), _band(_estimate(truth).polarised(60))
    figure, axes = _strip(3)
    top = float(np.percentile(_band(truth.image)[truth.mask], 99.7))
    _show(axes[0], true, "true", truth, vmax=top)
    _show(axes[1], estimated, "estimated", truth, vmax=top)
    _show(axes[2], ((true - estimated) / top) ** 2, "difference²", truth, cmap="magma")
    return figure


def skill(_: Balls) -> Figure:
    """The scale of skills."""
    figure = Figure(figsize=(HEIGHT * 2.6, HEIGHT * 0.8), layout="constrained", dpi=110)
    ax = figure.subplots()
    ax.set(xlim=(-2.1, 1.25), ylim=(-1, 1))
    ax.set_axis_off()
    _arrow(ax, (0.0, 0), (-2.1, 0), "tab:red")
    ax.plot([0, 1], [0, 0], color="tab:green", lw=4)
    for x, text in ((-1.0, "worse\n−1"), (0.0, "the guess\n0"), (1.0, "perfect\n1")):
        ax.plot([x], [0], "o", color="black", ms=4)
        ax.text(x, 0.2, text, fontsize=7, ha="center", va="bottom")
    ax.text(-1.9, -0.65, "without end", fontsize=7, color="tab:red")
    return figure


def noise(shown: Balls) -> Figure:
    """The two halves of a render with few samples, and their difference."""
    truth = malus.render(shown.lit.scene, malus.Sampling(samples=8))
    one, other = (_band(half.stokes)[..., 1] for half in truth.halves())
    how = {"cmap": "RdBu_r", "vmin": -0.1, "vmax": 0.1}
    return _images(
        truth, {"s1, one half": one, "the other": other, "difference": one - other}, **how
    )


def mosaic(shown: Balls) -> Figure:
    """A polarisation camera's raw frame, and a corner of it."""
    truth = shown.lit
    sensor = malus.Sensor(preset="imx250mzr", extinction_ratio=300)
    frame = malus.expose(truth.stokes, sensor).raw[0].astype(float)
    figure, axes = _strip(2)
    middle = frame.shape[0] // 2
    for ax, part, title in (
        (axes[0], frame, "raw frame"),
        (axes[1], frame[middle : middle + 8, middle : middle + 8], "8 × 8 pixels"),
    ):
        ax.imshow(part, cmap="gray", vmin=0)
        ax.set_title(title, fontsize=7, pad=2)
        ax.set_axis_off()
    return figure


PICTURES: dict[str, Callable[[Balls], Figure]] = {
    "polariser": polariser,
    "stokes": stokes,
    "dolp": degree,
    "aolp": angle,
    "phase": phase_angle,
    "extremes": extremes_of_light,
    "lobes": lobes,
    "body": body,
    "roughness": roughness,
    "index": refractive_index,
    "observation": observation,
    "nmse": error,
    "skill": skill,
    "noise": noise,
    "family": family,
    "mosaic": mosaic,
}
"""Every picture of the glossary, by the name of its file."""


def main() -> None:
    """Draw all of them anew."""
    shown = balls()
    for name, draw in PICTURES.items():
        draw(shown).savefig(FOLDER / f"{name}.png")


if __name__ == "__main__":
    main()
