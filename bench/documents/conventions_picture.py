"""Draws the pictures of conventions.md from renders: run it in this folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from malus.renderers import Truth, render
from malus.scenes import Camera, Dielectric, Distant, Sampling, Scene, Sphere, Uniform
from malus.scenes.core.arrays import FloatArray
from malus.scenes.polarisation import dolp, polarised

DOCUMENTS = Path(__file__).parents[2] / "reports" / "docs"
STANDS = {"azimuth_deg": 40.0, "elevation_deg": 25.0}
"""Where the camera of the second picture stands."""
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


def lit_ball(resolution: int = 256, samples: int = 64) -> Truth:
    """A ball lit from the world's top, seen by a camera that was moved around it."""
    surface = Dielectric(eta=1.5, alpha=0.3, albedo=0.7)
    lens = {"projection": "perspective", "fov_deg": 45.0, "distance": 4.0}
    camera = Camera.model_validate(lens | STANDS | {"resolution": resolution})
    light = Distant(incidence_deg=50, azimuth_deg=100)
    scene = Scene(shape=Sphere(), surface=surface, light=light, camera=camera)
    return render(scene, Sampling(samples=samples))


def camera_picture(truth: Truth) -> Figure:
    """A camera in the world, and its image with the world's axes where K [R | t] has them."""
    figure = Figure(figsize=(9.2, 4.2), layout="constrained")
    world = figure.add_subplot(1, 2, 1, projection="3d")
    _world(world, truth.scene.camera)
    image = figure.add_subplot(1, 2, 2)
    image.set_title("its image: axes drawn at K (R X + t)", fontsize=9)
    grey = truth.image[..., 0] / truth.image.max()
    image.imshow(np.sqrt(np.where(truth.mask, grey, 0.15)), cmap="gray", vmin=0, vmax=1)
    for axis, name in zip(1.5 * np.eye(3), "xyz", strict=True):
        (u, v), (u0, v0) = (_pixel(truth.scene.camera, point) for point in (axis, axis / 1.5))
        _arrow(image, (u0, v0), (u, v), "tab:orange")
        image.annotate(name, (u, v), color="tab:orange", fontsize=11)
    image.set(xlabel="u: columns from the left", ylabel="v: rows from the top")
    return figure


def _pixel(camera: Camera, point: FloatArray) -> tuple[float, float]:
    """Column and row of a point of the world, by the matrices of a perspective camera."""
    x, y, z = camera.extrinsics() @ [*point, 1.0]
    u, v, _ = camera.intrinsics() @ [x / z, y / z, 1.0]
    return float(u), float(v)


def _world(ax: Any, camera: Camera) -> None:
    """World axes, the camera's place with its angles, and the axes of OpenCV's camera frame.

    Matplotlib's vertical is its z: (x, y, z) of the world are drawn at (x, −z, y).
    """

    def line(*points: Any, **style: Any) -> None:
        x, y, z = np.array(points, dtype=float).T
        ax.plot(x, -z, y, **style)

    def text(point: Any, words: str, **style: Any) -> None:
        ax.text(point[0], -point[2], point[1], words, fontsize=8, **style)

    for axis, name in zip(1.8 * np.eye(3), ("x", "y (up)", "z: unmoved camera"), strict=True):
        line(np.zeros(3), axis, color="tab:orange")
        text(1.08 * axis, name, color="tab:orange")
    stand = 3.0 * camera.axes[2]
    for rotated, name in zip(camera.extrinsics()[:, :3], ("x", "y", "z: forward"), strict=True):
        line(stand, stand + 0.8 * rotated, color="tab:blue")
        text(stand + 0.9 * rotated, name, color="tab:blue")
    below = stand * [1, 0, 1]
    line(np.zeros(3), stand, color="0.6", lw=0.8)
    line(np.zeros(3), below, stand, color="0.6", lw=0.8, ls=":")
    azimuth = np.radians(np.linspace(0, camera.azimuth_deg, 20))
    turn = 1.2 * np.stack([np.sin(azimuth), 0 * azimuth, np.cos(azimuth)], axis=-1)
    line(*turn, color="0.3")
    text(turn[14] * 1.1, "azimuth_deg", va="top")
    elevation = np.radians(np.linspace(0, camera.elevation_deg, 20))
    level = below / np.linalg.norm(below)
    rise = np.cos(elevation)[:, None] * level + np.sin(elevation)[:, None] * [0, 1, 0]
    line(*(2.0 * rise), color="0.3")
    text(2.1 * rise[6], "elevation_deg")
    ax.set_title("the world, and a camera by OpenCV's axes", fontsize=9)
    ax.set_box_aspect((1, 1, 1), zoom=1.7)
    ax.set(xlim=(-0.6, 2.8), ylim=(-2.9, 0.5), zlim=(-0.6, 2.8))
    ax.set_axis_off()
    ax.view_init(elev=18, azim=-105)


if __name__ == "__main__":
    picture(mirror_ball()).savefig(DOCUMENTS / "conventions.png", dpi=110)
    camera_picture(lit_ball()).savefig(DOCUMENTS / "cameras.png", dpi=110)
