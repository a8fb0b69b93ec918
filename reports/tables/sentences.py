"""Sentences that the summary and the page share, with the numbers of the run in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from malus.reports.tables.formats import listed, scientific
from malus.reports.tables.rows import (
    PAPER_METHOD,
    PAPER_RANGE,
    TRIVIAL,
    distinct,
    extrapolated_materials,
    not_finite,
    overall_rows,
    unverified_surfaces,
)
from malus.scenes.core.errors import counted
from malus.scenes.random_suite.random_scenes import least_and_most_pixels

PAPER = f"The paper's Figure 5: NMSE in {PAPER_RANGE} for every material and surface."
SKILL = (
    "NMSE alone says little: that of the trivial guess I(ϑ) = I/2 is small too. Skill is"
    " 1 − NMSE / NMSE of that guess: 1 is perfect, 0 no better than doing nothing, negative is"
    " worse."
)
NOISE = (
    "Monte Carlo noise of the truth adds to every NMSE: the expected part stands beside it, and is"
    " subtracted from the method's and the trivial guess's NMSE before their skill is formed."
)
UNMIXED = (
    "Unmixed is the skill without the pixels that see more than one normal, as at the sharp edges"
    " of a part: a method is told one normal there, which belongs to neither face."
)
CIRCULAR = (
    "Where a metal mirrors light that is polarised already, the truth has a fourth Stokes"
    " component, s3. No polariser shows it and no method estimates it; rms over the object, over"
    " the peak."
)
ERROR_MAPS = (
    "Colour difference of every pixel between reconstruction and truth, scaled as in the paper's"
    " Figures 6 to 8: black is no error, white is 10 just noticeable differences of 2.3 each."
)
TABLE1 = (
    "Colour difference in CIELAB, mean ± standard deviation over the pixels of all scenes, each"
    " scene counted alike, and normalised mean squared error; in brackets the standard deviation"
    " of the scenes' means. A ΔE76 of 2.3 is one just noticeable difference. White is the"
    " brightest pixel of the true unpolarised image. The paper's scenes are photographs and not"
    " known in detail; nor is over what its deviations are taken."
)
PAIRS = (
    "Is each method really better than the next? Both are compared on every scene that they share;"
    " ± is half of a 95 % interval of the mean difference (Student's t). The scenes of a suite are"
    " a grid and not drawn at random: the interval tells how consistent a difference is over them,"
    " not what other scenes would give. A method that left scenes out is compared with the best of"
    " the others."
)
COMPARISON = (
    "Every run beside the first, method by method under each light and body. Scenes of both runs"
    " are compared one by one, others by their means. A difference counts where its interval over"
    " scenes leaves out zero; the intervals are so wide that chance alone makes one comparison of"
    " twenty show a change. Noise of a render moves all scenes of a seed together, so that no"
    " interval over scenes sees it: runs whose images differ are compared by gain, rotation and"
    " facing skill, weighted by true polarised energy, whose noise every scene tells."
)
CAPTURES = (
    "Real pictures through a polariser: the truth is the sinusoid of Equation 1 that fits them,"
    " noise included, and methods see its unpolarised image and the objects' masks alone. The scale"
    " is the factor on the estimated s1 and s2 that fits the true ones best; below zero they are"
    " turned by 90°."
)
CAPTURED_TABLE1 = (
    "Colour difference in CIELAB, mean ± standard deviation over the pixels of all captures of a"
    " group, each capture counted alike, and normalised mean squared error; in brackets the"
    " standard deviation of the captures' means. A method that could not work on some captures has"
    " means over fewer, which do not compare. A ΔE76 of 2.3 is one just noticeable difference."
    " White is the brightest pixel of the unpolarised image; channels are taken for the primaries"
    " of sRGB. The paper's captures are others; over what its deviations are taken is not known."
)
PRICES = (
    "A truth that a method's own physics contains tells nothing of real surfaces. Here each"
    " assumption is broken alone: by the scene, by a wrong input, or by an estimate from the"
    " picture in place of an input. The price is the skill that is lost."
)
LADDER = (
    "A method is told everything, then has one thing after another estimated for it, down to the"
    " single image. Each part is what its error grows by at that step."
)
PLAN = (
    "Before anything is rendered, what the scenes do not need is left out; no result changes by it."
    " Without a plan there would be one render for every scene, band, polariser angle and lobe; its"
    " time is the measured time of one render, times their number."
)
PRECISION = (
    "Every point is a setting that somebody could choose. Filled and joined: nothing else is both"
    " faster and more accurate. Seconds are medians of several runs on one machine."
)
STRESS = (
    "Limits, singular points and hostile inputs: each with its error against a slow reference where"
    " there is one, and the rule that it must not break."
)
SEPARATION = (
    "Each picture is separated by colour into diffuse and specular light, under white light that"
    " is known. The paper names two ways: Tan et al.'s maximum chromaticity-intensity space"
    " (chromaticity), which it uses, and Mallick et al.'s partial differential equations (suv)."
    " Dispersion makes specular light bluish: no way that takes it for white can reach zero."
)
NO_SKILL = (
    "The Monte Carlo noise is too large to tell a skill in these scenes: the trivial guess does not"
    " rise above it, or the method answers to it with more than its whole error."
)


def no_negative_skill(table: pd.DataFrame) -> str:
    """A sentence for a table where no skill of the paper's method is negative.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> no_negative_skill(table().query("method != 'eq8'"))
    'eq8 was not run.'
    """
    if PAPER_METHOD not in distinct(table["method"]):
        return f"{PAPER_METHOD} was not run."
    skills = overall_rows(table, "skill")
    if skills.loc[skills["method"] == PAPER_METHOD, "value"].isna().all():
        return f"{PAPER_METHOD} has no skill on any scene of this suite."
    return f"The skill of {PAPER_METHOD} is negative nowhere in this suite."


def no_scene_without_skill(table: pd.DataFrame) -> str:
    """A sentence for a table where the noise hides the skill of no method that was scored.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> no_scene_without_skill(table().query("method == 'unpolarised'"))
    'No method but the trivial guess was scored.'
    """
    skills = overall_rows(table, "skill")
    skills = skills[skills["method"] != TRIVIAL]
    if skills.empty:
        return "No method but the trivial guess was scored."
    if not_finite(table, skills).any():
        return "The noise is small enough everywhere; an estimate that is not finite has no skill."
    return "Every scene has a skill: the noise is small enough everywhere."


def interpolation(run: dict[str, Any]) -> str:
    """A sentence on the error of interpolation in η; where there is none, nothing was held out."""
    if not run["interpolation_rms"] > 0:
        return "Every refractive index was rendered: nothing was interpolated."
    return (
        "Interpolation in η instead of one render a material and band: error at most"
        f" {scientific(run['interpolation_rms'])} of the peak (rms, measured)."
    )


def failures(run: dict[str, Any]) -> Iterator[str]:
    """A sentence on what failed in a run, if anything did: no number of the page counts it."""
    failed = run.get("families_failed", 0)
    if failed:
        first = next(iter(run.get("failures", ())), "no reason is known")
        yield (
            f"{failed} of {run['families']} families of scenes failed, wholly or for some methods:"
            " what failed is missing from all numbers here, which may be the hardest scenes."
            f" The first: {first}"
        )


def what_was_run(table: pd.DataFrame, run: dict[str, Any]) -> Iterator[str]:
    """Sentences on scenes, sampling, interpolation error, roughness values and versions."""
    suite, sampling = run["suite"], run["suite"]["sampling"]
    axes = ("shape", "material", "surface", "light")
    counts = ", ".join(
        counted(table[name].nunique(), name, many)
        for name, many in [*((name, "") for name in axes), ("body", "bodies")]
    )
    bands = suite["wavelengths_nm"]
    most = "at most " if sampling.get("target") else ""  # then only as many as the noise asks for
    yield (
        f"{counted(table['scene'].nunique(), 'scene')}: {counts}; {counted(len(bands), 'band')}"
        f" from {bands[0]:g} to {bands[-1]:g} nm; {_sides(suite)} pixels square."
    )
    yield (
        f"Renderer {suite['renderer']}, variant {run['variant']['name']}"
        f" ({run['variant']['reason']}), {most}{sampling['samples']} samples a pixel,"
        f" seed {sampling['seed']}."
    )
    yield interpolation(run)
    yield from doubts(table)
    yield from extrapolation(table, bands)
    versions = listed([f"{name} {version}" for name, version in run["versions"].items()])
    yield f"Finished {run['finished']}; {versions}."
    taken = run.get("families_taken_over", 0)
    if taken:
        yield (
            f"{taken} of {run['families']} families were taken over from an earlier run: their"
            " time is not among the stages."
        )


def _sides(suite: Mapping[str, Any]) -> str:
    """Pixels a side of the cameras of a suite, also of one that draws them."""
    random = suite.get("random") or {}
    sides = least_and_most_pixels(suite["camera"]["resolution"], random.get("cameras", ()))
    return " to ".join(map(str, dict.fromkeys(sides)))


def doubts(table: pd.DataFrame) -> Iterator[str]:
    """A sentence on the roughness values that nobody has verified, if there are any."""
    names = unverified_surfaces(table)
    if len(names) == 1:
        yield (
            f"The roughness value of {names[0]} is an unverified stand-in: nobody has compared it"
            " with the printed source, and it is a rendering parameter rather than a measurement."
        )
    elif names:
        yield (
            f"{len(names)} roughness values are unverified stand-ins ({listed(names)}): nobody has"
            " compared them with the printed source, and they are rendering parameters rather"
            " than measurements."
        )


def extrapolation(table: pd.DataFrame, bands_nm: Sequence[float]) -> Iterator[str]:
    """A sentence on refractive indices at bands beyond the data of their material, if any."""
    found = extrapolated_materials(table, bands_nm)
    if found:
        by_bands: dict[str, list[str]] = {}
        for name, bands in found.items():
            by_bands.setdefault(listed([f"{band:g}" for band in bands]), []).append(name)
        places = "; ".join(f"at {bands} nm {listed(names)}" for bands, names in by_bands.items())
        yield (
            f"The refractive index of {counted(len(found), 'material')} is extrapolated, by the"
            f" formula of its data, at bands beyond these: {places}."
        )
