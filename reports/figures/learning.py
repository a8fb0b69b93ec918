"""The course of a training: error on new examples, and skill on scenes that it never sees."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from malus.reports.figures.style import PALETTE, SOFT, drawable, style


def figure_learning(history: Sequence[dict[str, float]], name: str) -> Figure:
    """Loss and validation skill against steps; the best skill is marked.

    Parameters
    ----------
    history : sequence of dict
        With `step` and `skill`, one a validation, and `loss` but for that before the first step.
    name : str
        Of the network, for the title.
    """
    steps = [row["step"] for row in history]
    skills = [row["skill"] for row in history]
    with style():
        figure = Figure(figsize=(7.0, 2.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        losses = [(row["step"], row["loss"]) for row in history if "loss" in row]
        left.plot(*zip(*losses, strict=True), color=PALETTE[1])
        left.set_title("loss")
        right.axhline(0.0, color=SOFT, linewidth=0.8, linestyle="--")
        right.plot(steps, skills, color=PALETTE[0])
        if history:
            # Of equals the last, which training keeps.
            best = max(range(len(skills)), key=lambda k: (skills[k], k))
            right.plot(steps[best], skills[best], "o", color=PALETTE[0])
        right.set_title("median skill on scenes kept aside")
        for axes in (left, right):
            axes.set_xlabel("steps")
        figure.suptitle(drawable(name), x=0.01, ha="left", fontsize=9.5)
    return figure
