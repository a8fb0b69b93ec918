"""Measured materials in suites, methods, datasets and commands; bad files are told in one line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up import tensor_file, tiny_pbrdf
from measured_tables import BANDS, CAMERAS, LIGHT, scene, table, truth_of, write

from malus.bench import run, score
from malus.bench.datasets.export import export
from malus.bench.datasets.render import render_dataset
from malus.bench.scoring.judge import Judge
from malus.bench.scoring.observe import observe
from malus.reconstruct import Components, Inapplicable, Method
from malus.reconstruct.observation import INPUTS
from malus.renderers import Truth, render
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.mitsuba.measured_bsdf import measured_bsdfs
from malus.reports import write_report
from malus.scenes import (
    Camera,
    Conductor,
    Distant,
    InputError,
    Measured,
    Placed,
    Scene,
    Sphere,
    Surroundings,
    load_suite,
)
from malus.scenes.materials.measured import open_pbrdf


def test_methods_are_told_what_is_known(tmp_path: Path) -> None:
    path = str(write(tmp_path / "a.pbsdf", **table(15.0)))
    truth = truth_of(scene(Measured(path=path), Camera(resolution=16)))
    nothing = observe(truth, INPUTS)
    assert [nothing.specular, nothing.diffuse, nothing.eta, nothing.alpha] == [None] * 4
    assert nothing.normals is not None
    assert Judge(truth).pixels.observation.specular is None
    told = truth_of(scene(Measured(path=path, eta=1.5, alpha=0.2), Camera(resolution=16)))
    seen = observe(told, INPUTS)
    assert seen.eta is not None
    assert (seen.eta.tolist(), seen.alpha) == ([1.5] * len(BANDS), 0.2)
    assert seen.specular is None
    for method in ("eq8", "half_vector+body", "lights"):
        with pytest.raises(Inapplicable, match="specular is not known"):
            score(told, method)
    assert score(truth, "unpolarised").skill == pytest.approx(0, abs=1e-6)
    best = Method("best", frozenset(), lambda seen: seen_by_a_camera(truth), "")
    assert score(truth, best).nmse == 0


def seen_by_a_camera(truth: Truth) -> Components:
    return Components(*np.moveaxis(truth.stokes, -1, 0))


SUITE = """
name = "measured"
shapes = [{ kind = "sphere" }]
materials = [{ path = "gold.pbsdf" }, { path = "iron.pbsdf" }, { path = "gold.pbsdf", eta = 1.5 }]
surfaces = ["carbon", "rust"]
bodies = ["unpolarised", "polarised"]
lights = [{ kind = "distant", incidence_deg = 60 }, { kind = "distant", incidence_deg = 30 }]
wavelengths_nm = [500, 560]
methods = ["unpolarised", "eq8"]
camera = { resolution = 12 }
sampling = { samples = 4 }
"""


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    for name in ("gold", "iron"):
        write(tmp_path / f"{name}.pbsdf", **table(15.0))
    path = tmp_path / "suite.toml"
    path.write_text(SUITE)
    return path


def test_a_run_with_measured_materials(suite: Path, tmp_path: Path) -> None:
    loaded = load_suite(suite)
    scenes = list(loaded.scenes())
    # Neither surfaces nor bodies change what was measured: a scene a light and material.
    assert len(scenes) == 6
    loads = measured_bsdfs.cache_info().misses
    results = run(loaded, tmp_path / "out")
    assert measured_bsdfs.cache_info().misses - loads == 2  # each file once, though the lights vary
    table = results.table
    assert set(table.body) == {"unknown"}
    assert set(table[table.metric == "inapplicable"].note) == {"specular is not known"}
    assert set(table[table.metric == "skill"].method) == {"unpolarised"}
    assert table.alpha.isna().all()
    assert all(path.exists() for path in write_report(results, tmp_path / "out"))


def test_a_dataset_of_measured_materials(suite: Path, tmp_path: Path) -> None:
    render_dataset(load_suite(suite), tmp_path / "data")
    one = next(load_suite(suite).scenes())
    expected = truth_of(one, 4)
    folder = tmp_path / "data" / one.id
    assert not (folder / "specular.exr").exists()
    assert not (folder / "diffuse.exr").exists()
    (tmp_path / "gold.pbsdf").unlink()
    dataset = open_folder(tmp_path / "data")
    found = dataset.truth(one.id)
    for name in ("specular", "diffuse", "standard_error", "specular_noise", "normals", "mask"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    # The dataset keeps the table: the scene renders again.
    np.testing.assert_array_equal(truth_of(found.scene, 4).stokes, expected.stokes)
    export(dataset, "numpy", tmp_path / "numpy")
    arrays = np.load(tmp_path / "numpy" / one.id / "truth.npz", allow_pickle=False)
    assert "specular" not in arrays
    np.testing.assert_array_equal(arrays["stokes"], expected.stokes)
    assert np.isnan(arrays["alpha"])


# --- bad files and bad scenes ---

TINY = tiny_pbrdf()


def without(name: str) -> dict[str, np.ndarray]:
    return {key: value for key, value in TINY.items() if key != name}


BAD: dict[str, tuple[Any, str]] = {
    "missing": (None, "a readable pBRDF file, found No such file"),
    "empty": (b"", "a tensor file"),
    "picture": (b"\x89PNG\r\n", "a tensor file"),
    "cut": (slice(0, 600), r"a file of at least \d+ bytes, found 600 bytes"),
    "header cut": (slice(0, 30), "a whole header"),
    "unpolarised": (without("M"), "a polarised BRDF, with the fields .* found phi_d, theta_d"),
    "no wavelengths": (without("wvls"), "a polarised BRDF, with the fields .*wvls"),
    "doubles": (TINY | {"M": TINY["M"].astype(float)}, "field M as float32 .* found float64"),
    "flat": (TINY | {"M": TINY["M"][..., 0]}, "field M as float32 of 6 dimensions"),
    "3 x 3": (TINY | {"M": TINY["M"][..., :3, :3]}, r"field M of shape \(3, 2, 2, 5, 4, 4\)"),
    "no directions": (
        TINY | {"phi_d": np.zeros((1, 0), np.float32)},
        "field phi_d with values, found one that holds no bytes",
    ),
    "axes of no type": (
        tensor_file(**TINY).replace(b"theta_d\2\0\x0a", b"theta_d\2\0\0"),
        "field theta_d with values, found one that holds no bytes",
    ),
    "falling": (TINY | {"theta_h": TINY["theta_h"][:, ::-1]}, "field theta_h to increase"),
    "not finite": (TINY | {"theta_d": np.float32([[0, np.nan]])}, "field theta_d to increase"),
    "degrees": (
        TINY | {name: np.degrees(TINY[name]) for name in ("phi_d", "theta_d", "theta_h")},
        "field phi_d from -3.142 to 3.142, radians, found -183.3 to 183.3",
    ),
    "from 0 to 2π": (
        TINY | {"phi_d": TINY["phi_d"] + np.float32(np.pi)},
        "field phi_d from -3.142 to 3.142, radians, found -0.058",
    ),
    "half of phi_d": (
        TINY | {"phi_d": np.float32([[0, 1.6, 3.2]])},
        "field phi_d .* found 0 to 3.2",
    ),
    "not to grazing": (
        TINY | {"theta_h": np.float32([[0, 0.7]])},
        "field theta_h from 0 to 1.571, radians, found 0 to 0.7",
    ),
    "bands": (
        TINY | {"wvls": TINY["wvls"] + np.uint16(60)},
        "bands within its table, 510 to 710 nm, found 500 nm",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_told_before_anything_is_rendered(suite: Path, name: str) -> None:
    content, message = BAD[name]
    path = suite.parent / "gold.pbsdf"
    if content is None:
        path.unlink()
    elif isinstance(content, dict):
        write(path, **content)
    elif isinstance(content, slice):
        path.write_bytes(write(path, **TINY).read_bytes()[content])
    else:
        path.write_bytes(content)
    with pytest.raises(InputError, match=rf"gold\.pbsdf: expected {message}"):
        load_suite(suite)


NO_SURFACE = {
    "infinite": (np.inf, "infinite values"),
    "negative": (-1.0, r"-[\d.]+ in all"),
    "unknown": (np.nan, "0 in all"),
}


@pytest.mark.parametrize("name", NO_SURFACE)
@pytest.mark.parametrize("band", [500.0, 525.0])
def test_values_of_no_surface_are_refused(tmp_path: Path, name: str, band: float) -> None:
    """Of the band that is rendered; single unknown or negative values are noise."""
    value, says = NO_SURFACE[name]
    mueller = TINY["M"].copy()
    mueller[0, 0, 0], mueller[1, 0, 0] = np.nan, -0.01
    path = write(tmp_path / "noisy.pbsdf", **(TINY | {"M": mueller}))
    assert np.isfinite(open_pbrdf(path).mueller_at(band)).sum() > 100
    mueller[:, :, :, 1:3] *= value
    path = write(tmp_path / "bad.pbsdf", **(TINY | {"M": mueller}))
    match = rf"bad\.pbsdf: expected finite values at {band:g} nm, .*{says}"
    with pytest.raises(InputError, match=match):
        open_pbrdf(path).mueller_at(band)
    assert open_pbrdf(path).mueller_at(600.0).shape == (3, 2, 2, 4, 4)  # of another band


@pytest.mark.parametrize("command", ["plan", "run"])
def test_commands_tell_it_in_one_line(suite: Path, command: str) -> None:
    (suite.parent / "gold.pbsdf").write_bytes(b"another")
    script = "from malus.bench.cli import main; main()"
    out = [] if command == "plan" else ["--out", str(suite.parent / "out")]
    given = [sys.executable, "-c", script, command, str(suite), *out]
    done = subprocess.run(given, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "gold.pbsdf: expected a tensor file (.pbsdf), found another file" in done.stderr
    assert not (suite.parent / "out").exists()


def test_a_table_that_changed_since_is_refused(suite: Path) -> None:
    # A table of its own: what was read before, of this content, needs no file.
    write(suite.parent / "gold.pbsdf", **table(17.0))
    one = next(load_suite(suite).scenes())
    write(suite.parent / "gold.pbsdf", **TINY)
    with pytest.raises(InputError, match="a pBRDF file with digest"):
        truth_of(one)


def test_where_a_measured_material_cannot_be() -> None:
    surface = Measured(path="a.pbsdf")
    with pytest.raises(ValueError, match=r"incidence_deg of 0\.01 or more"):
        scene(surface, Camera(), Distant(incidence_deg=0))
    scene(surface, CAMERAS["perspective rolled"], Distant(incidence_deg=0))
    beside = (Placed(shape=Sphere(), surface=surface, position=(3, 0, 0)),)
    metal = Conductor(material="gold", alpha=0.3)
    with pytest.raises(InputError, match="only in scenes without surroundings, found measured;"):
        Scene(
            shape=Sphere(),
            surface=metal,
            light=LIGHT,
            surroundings=Surroundings(name="room", objects=beside),
        )
    with pytest.raises(InputError, match="an unpolarised body, found unknown"):
        render(scene(surface, Camera()), renderer="torrance-sparrow")
