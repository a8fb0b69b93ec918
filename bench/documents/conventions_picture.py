"""Draws conventions.png, the picture of conventions.md, from renders: run it in this folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from malus.renderers import Truth, render
from malus.scenes import Camera, Dielectric, Sampling, Scene, Sphere, Uniform
from malus.scenes.core.arrays import FloatArray
from malus.scenes.polarisation import dolp, polarised

PICTURE = Path(__file__).parents[2] / "reports" / "docs" / "conventions.png"
DIAGONAL = 0.5**0.5


def mirror_ball(resolution: int = 192, samples: int = 256) -> Truth:
    """A smooth dark ball under uniform light; its specular lobe is what the picture shows."""
    surface = Dielectric(eta=1.5, alpha=0.1, albedo=0.0, body="unpolarised")
    camera = Camera(resolution=resolution)
    scene = Scene(shape=Sphere(), surface=surface, light=Uniform(), camera=camera)
    return render(scene, Sampling(samples=samples))


def picture(truth: Truth) -> Figure:
    """Axes and angles, the signs of s1 and s2, DoLP, and the ball through four polarisers."""
    stokes = np.where(truth.mask[..., None], truth.specular[:, :, 0], np.nan)
    figure = Figure(figsize=(9.2, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 4)
    _axes(upper[0])
    for ax, part in ((upper[1], 1), (upper[2], 2)):
        ratio = stokes[..., part] / stokes[..., 0]
        shown = _show(ax, ratio, f"s{part} / s0", vmin=-1, vmax=1, cmap="RdBu_r")
        figure.colorbar(shown, ax=ax, shrink=0.8)
    degree = np.where(truth.mask, dolp(stokes), np.nan)
    shown = _show(upper[3], degree, "degree of polarisation", vmin=0, vmax=1, cmap="viridis")
    figure.colorbar(shown, ax=upper[3], shrink=0.8)
    root = np.sqrt(np.nanpercentile(stokes[..., 0], 99.5) * 0.9)
    for ax, angle, (x, y) in zip(lower, (0.0, 45.0, 90.0, 135.0), _DIRECTIONS, strict=True):
        radiance = np.maximum(polarised(stokes, angle), 0)
        # The root brings out the dark parts.
        _show(ax, np.sqrt(radiance), f"polariser at {angle:g}°", vmin=0, vmax=float(root))
        _arrow(ax, (-x, -y), (x, y), "tab:orange")
    return figure


_DIRECTIONS = ((0.0, 1.0), (-DIAGONAL, DIAGONAL), (-1.0, 0.0), (-DIAGONAL, -DIAGONAL))
"""Transmission axes at 0, 45, 90 and 135 degrees anticlockwise from the vertical."""


def _show(ax: Axes, values: FloatArray, title: str, cmap: str = "gray", **limits: Any) -> Any:
    ax.set_title(title, fontsize=9)
    ax.set_axis_off()
    # Row 0 is the top of the picture, so that y points up in the extent.
    return ax.imshow(values, cmap=cmap, extent=(-1.05, 1.05, -1.05, 1.05), **limits)


def _axes(ax: Axes) -> None:
    ax.set_title("as seen from the camera", fontsize=9)
    ax.set(xlim=(-1.35, 1.35), ylim=(-1.35, 1.35), aspect="equal")
    ax.set_axis_off()
    _arrow(ax, (0, 0), (1, 0), "black")
    _arrow(ax, (0, 0), (0, 1), "black")
    ax.text(1.05, 0, "x: s1 > 0", va="center", fontsize=8, ha="left", rotation=90)
    ax.text(0, 1.08, "y: polariser at 0°, s1 < 0", ha="center", fontsize=8)
    _arrow(ax, (0, 0), (0.62, 0.62), "tab:blue")
    ax.text(0.66, 0.66, "s2 > 0", color="tab:blue", fontsize=8)
    _arrow(ax, (0, 0), (-0.62, 0.62), "tab:orange")
    ax.text(-0.66, 0.7, "ϑ = 45°", color="tab:orange", fontsize=8, ha="right")
    turn = np.linspace(0.5 * np.pi, 0.75 * np.pi, 30)
    ax.plot(0.5 * np.cos(turn), 0.5 * np.sin(turn), color="tab:orange", lw=1)
    ax.plot(0, 0, "o", color="black", ms=4)
    ax.text(-0.05, -0.2, "z: towards you", fontsize=8, ha="center")
    ax.text(0, -0.75, "angles anticlockwise\nfrom the vertical", fontsize=8, ha="center")


def _arrow(ax: Axes, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "lw": 1.6}
    ax.annotate("", xy=end, xytext=start, arrowprops=style)


if __name__ == "__main__":
    picture(mirror_ball()).savefig(PICTURE, dpi=110)
