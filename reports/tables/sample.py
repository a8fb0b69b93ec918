"""A tiny results table with invented numbers, for examples and tests."""

from __future__ import annotations

import itertools
from typing import Any

import pandas as pd

_MATERIALS = (("water", 1.33), ("pmma", 1.49), ("polystyrene", 1.59))
_SURFACES = (("carbon", 0.4), ("obsidian", 0.15))
_LIGHTS = (("uniform", None), ("distant 60°", 60.0))
_COLOURS = {"unpolarised": 3.0, "eq8": 1.0, "half_vector": 0.25}
_FACTORS = {"unpolarised": 1.0, "eq8": 0.05, "half_vector": 0.001}


def table() -> pd.DataFrame:
    """Three materials, two surfaces, two lights; "half_vector" cannot work under uniform light.

    Examples
    --------
    >>> len(table()["scene"].unique())
    12
    """
    records: list[dict[str, Any]] = []
    for number, (light, surface, material) in enumerate(
        itertools.product(_LIGHTS, _SURFACES, _MATERIALS)
    ):
        scene = {
            "scene": f"{number:016x}",
            "shape": "sphere",
            "material": material[0],
            "eta": material[1],
            "surface": surface[0],
            "alpha": surface[1],
            "body": "unpolarised",
            "light": light[0],
            "incidence_deg": light[1],
        }
        for method in _FACTORS:
            records += _rows(scene, method)
    return pd.DataFrame.from_records(records)


def _rows(scene: dict[str, Any], method: str) -> list[dict[str, Any]]:
    common = scene | {"method": method, "knowledge": "everything", "note": ""}
    overall = {"band_nm": float("nan"), "angle_deg": float("nan"), "noise": 0.0}
    if method == "half_vector" and scene["light"] == "uniform":
        reason = {"note": "needs a distant light, found uniform"}
        return [common | overall | reason | {"metric": "inapplicable", "value": 1.0}]
    error = 1e-3 * scene["eta"] * _FACTORS[method]
    skill = 1.0 - _FACTORS[method]
    return [
        common | overall | {"metric": metric, "value": value, "noise": noise} | angle
        for angle in ({}, {"angle_deg": 0.0}, {"angle_deg": 90.0})
        for metric, value, noise in (("nmse", error, 1e-7), ("skill", skill, 0.0))
    ]


def coloured() -> pd.DataFrame:
    """The same table with colour differences, whose standard deviation is 1.

    Examples
    --------
    >>> sorted(set(coloured()["metric"]) - set(table()["metric"]))[:2]
    ['delta_e2000', 'delta_e2000_i_max']
    """
    plain = table()
    errors = plain[plain["metric"] == "nmse"]
    colours = [
        errors.assign(metric=f"{formula}{image}{end}", value=value, noise=0.1)
        for formula in ("delta_e76", "delta_e2000")
        for image in ("_i_max", "_i_min", "")
        for end, value in (("", errors["method"].map(_COLOURS)), ("_std", 1.0))
    ]
    # I_max and I_min have no angle.
    extremes = [rows[rows["angle_deg"].isna()] for rows in colours]
    kept = [
        rows if "_i_m" not in str(rows["metric"].iloc[0]) else bare
        for rows, bare in zip(colours, extremes, strict=True)
    ]
    return pd.concat([plain, *kept], ignore_index=True)


def captured() -> pd.DataFrame:
    """Colour differences of captures in two groups, called as the materials of `table`.

    Examples
    --------
    >>> captured()["light"].unique().tolist()
    ['indoor', 'outdoor']
    """
    rows = coloured()
    rows = rows[(rows["surface"] == "carbon") & (rows["method"] != "half_vector")]
    groups = rows["light"].map({"uniform": "indoor", "distant 60°": "outdoor"})
    return rows.assign(
        surface=rows["material"], body="captured", light=groups, eta=float("nan"),
        alpha=float("nan"),
    )  # fmt: skip


def laddered() -> pd.DataFrame:
    """The errors of "eq8" on the ladder of knowledge: every rung adds to them.

    Examples
    --------
    >>> sorted(laddered()["knowledge"].unique())
    ['everything', 'lobes estimated', 'normals estimated', 'single image']
    """
    plain = table()
    method = plain[plain["method"] == "eq8"]
    error = method["metric"] == "nmse"
    rungs = {"everything": 1e-3, "lobes estimated": 3e-3, "normals estimated": 7e-3}
    rungs |= {"single image": 6e-3}
    return pd.concat(
        [
            method.assign(knowledge=rung, value=method["value"].mask(error, value))
            for rung, value in rungs.items()
        ],
        ignore_index=True,
    )


def run() -> dict[str, Any]:
    """The record of such a run, as `run.json` holds it.

    Examples
    --------
    >>> run()["suite"]["name"]
    'sample'
    """
    return {
        "suite": {
            "name": "sample",
            "description": "made up",
            "renderer": "mitsuba",
            "sampling": {"samples": 64, "seed": 1},
            "camera": {"resolution": 48, "half_width": 1.05},
            "wavelengths_nm": [450.0, 550.0],
            "methods": list(_FACTORS),
        },
        "suite_id": "0123456789abcdef",
        "finished": "2026-01-02T03:04:05+00:00",
        "versions": {"malus": "0.1.0", "python": "3.11"},
        "machine": {"system": "Linux", "processor": "x86_64"},
        "variant": {"name": "scalar_spectral_polarized", "reason": "no LLVM"},
        "seconds": {"render": 1.5, "reconstruct": 0.25, "score": 0.25, "total": 2.25},
        "families": 4,
        "families_taken_over": 0,
        "scenes": 12,
        "interpolation_rms": 2e-6,
        "plan": {
            "renders": 60,
            "without_plan": 1200,
            "seconds": 1.5,
            "seconds_without": 30.0,
            "left_out": [
                _left_out("specular images", 30, 210, "smooth in the index", 180),
                _left_out("polariser images", 240, 1200, "a Stokes image holds all", 960),
                _left_out("shadow rays", 0, 4, "a convex shape casts none", 0),
                _left_out("diffuse images", 30, 30, "nothing is left out", 0),
            ],
        },
    }


def run_of_captures() -> dict[str, Any]:
    """The record of the captures of `captured`.

    Examples
    --------
    >>> [capture["name"] for capture in run_of_captures()["captures"]][:2]
    ['water', 'pmma']
    """
    plain = run()
    fit = {
        "pictures": 4, "relative_residual": 0.004, "clipped_share": 0.0, "median_dolp": 0.03,
        "assumption": "values are linear light", "hints": [], "warnings": ["moved by 2 pixels"],
    }  # fmt: skip
    captures = [
        {"name": name, "group": group, "objects": [500, 300], "fit": fit}
        for group in ("indoor", "outdoor")
        for name, _ in _MATERIALS
    ]
    kept = {key: plain[key] for key in ("finished", "versions", "machine", "seconds")}
    suite = {"name": "sample", "description": "made up", "methods": ["unpolarised", "eq8"]}
    failures = ["pot: pot: expected a folder of pictures, found none; check the path"]
    record = {"suite": suite, "captures": captures, "captures_failed": 1, "failures": failures}
    return kept | record


def _left_out(what: str, done: int, instead_of: int, why: str, renders: int) -> dict[str, Any]:
    return {"what": what, "done": done, "instead_of": instead_of, "why": why, "renders": renders}
