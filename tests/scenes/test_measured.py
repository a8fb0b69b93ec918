"""Measured materials: a table made of a known material renders as that material.

No measured file is brought along. The tables here are tabulated from Mitsuba's `pplastic` on
Rusinkiewicz' angles; its polarised body gives them an s2 whose sign tells every mistake of
handedness. "A New Change of Variables for Efficient BRDF Representation", Rusinkiewicz, 1998.
"""

from __future__ import annotations

import functools
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up import tensor_file, tiny_pbrdf

from malus.bench import run, score
from malus.bench.datasets.export import export
from malus.bench.datasets.render import render_dataset
from malus.bench.scoring.judge import Judge
from malus.bench.scoring.observe import INPUTS, observe
from malus.reconstruct import Components, Inapplicable, Method
from malus.renderers import Truth, render
from malus.renderers.datasets.dataset import open_dataset
from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.measured_bsdf import measured_bsdfs
from malus.renderers.mitsuba.translate import specular_bsdf
from malus.renderers.variant import Variant, choose, mitsuba
from malus.reports import write_report
from malus.scenes import (
    Area,
    Camera,
    Conductor,
    Dielectric,
    Distant,
    InputError,
    Light,
    Measured,
    Placed,
    Sampling,
    Scene,
    Sphere,
    Surroundings,
    Uniform,
    load_suite,
)
from malus.scenes.materials.surface import Facets

TABLE_NM = (450, 500, 550, 600, 650)
ETAS = (1.40, 1.45, 1.50, 1.55, 1.60)
ALPHA, ALBEDO = 0.3, 0.4
BANDS = (475.0, 550.0, 650.0)
INVALID = np.nan
"""What the files of Baek et al. hold where a direction lies below the surface."""


def directions(step_deg: float) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Axes of a table, directions to light and viewer, and what is perpendicular to both.

    The half vector tilts towards +x; `t` and `b` are the axes about it from which phi_d counts.
    """
    quarter = round(90 / step_deg)
    axes = [
        np.linspace(-np.pi, np.pi, 4 * quarter + 1),
        np.linspace(0, np.pi / 2, quarter + 1),
        np.linspace(0, np.pi / 2, quarter + 1),
    ]
    phi_d, theta_d, theta_h = np.meshgrid(*axes, indexing="ij")
    zero = np.zeros_like(theta_h)
    h = np.stack([np.sin(theta_h), zero, np.cos(theta_h)], axis=-1)
    t = np.stack([np.cos(theta_h), zero, -np.sin(theta_h)], axis=-1)
    b = np.array([0.0, 1.0, 0.0])
    c, s = np.cos(phi_d)[..., None], np.sin(phi_d)[..., None]
    along, upright = np.sin(theta_d)[..., None] * (c * t + s * b), np.cos(theta_d)[..., None] * h
    return axes, upright + along, upright - along, c * b - s * t


def mueller(mi: Any, eta: float, light: np.ndarray, viewer: np.ndarray, axis: np.ndarray) -> Any:
    """BRDF (..., 4, 4) of the material, 1/sr, Stokes vectors about `axis` on both sides."""

    def vectors(values: np.ndarray) -> Any:
        return mi.Vector3f(values.reshape(-1, 3).T.astype(np.float32))

    bsdf = mi.load_dict(
        specular_bsdf(eta, Facets((ALPHA, ALPHA)))
        | {"diffuse_reflectance": {"type": "uniform", "value": ALBEDO}}
    )
    hit = mi.SurfaceInteraction3f()
    hit.wi, to_light, across = vectors(viewer), vectors(light), vectors(axis)
    value = bsdf.eval(mi.BSDFContext(), hit, to_light)
    basis = mi.mueller.stokes_basis
    turned = mi.mueller.rotate_mueller_basis(
        value, -to_light, basis(-to_light), across, hit.wi, basis(hit.wi), across
    )
    flat = np.array([[np.asarray(turned[i, j][0]) for j in range(4)] for i in range(4)])
    matrices = np.moveaxis(flat, 2, 0).reshape(*light.shape[:-1], 4, 4)
    valid = (light[..., 2] > 1e-6) & (viewer[..., 2] > 1e-6)
    cosine = np.where(valid, light[..., 2], 1.0)[..., None, None]
    return np.where(valid[..., None, None], matrices / cosine, INVALID)


def write(path: Path, **fields: np.ndarray) -> Path:
    path.write_bytes(tensor_file(**fields))
    return path


@functools.cache
def table(step_deg: float) -> dict[str, np.ndarray]:
    best = choose()
    if not best.vectorised:
        pytest.skip("only the scalar variant runs here: it evaluates no arrays")
    axes, light, viewer, axis = directions(step_deg)
    values = [mueller(mitsuba(best), eta, light, viewer, axis) for eta in ETAS]
    fields = dict(zip(("phi_d", "theta_d", "theta_h"), axes, strict=True))
    return {name: a[None].astype(np.float32) for name, a in fields.items()} | {
        "wvls": np.array(TABLE_NM, np.uint16),
        "M": np.stack(values, axis=3).astype(np.float32),
    }


CAMERAS = {
    "orthographic": Camera(resolution=24),
    "perspective rolled": Camera.model_validate(
        {"resolution": 24, "projection": "perspective", "fov_deg": 62, "distance": 2.0}
        | {"roll_deg": 25}
    ),
}
LIGHT = Distant(incidence_deg=50, azimuth_deg=35)


def scene(
    surface: Measured | Dielectric,
    camera: Camera,
    light: Light = LIGHT,
    bands: tuple[float, ...] = BANDS,
) -> Scene:
    return Scene(shape=Sphere(), surface=surface, light=light, camera=camera, wavelengths_nm=bands)


def truth_of(one: Scene, samples: int = 8, variant: Variant | None = None, seed: int = 1) -> Truth:
    return render_family([one], Sampling(samples=samples, seed=seed), variant).truth(one)


def analytic(camera: Camera) -> np.ndarray:
    """Stokes images of the material itself; half way between two wavelengths it is their mean."""

    def at(eta: float) -> np.ndarray:
        surface = Dielectric(eta=eta, alpha=ALPHA, albedo=ALBEDO, body="polarised")
        return truth_of(scene(surface, camera)).stokes[:, :, 0]

    return np.stack([0.5 * (at(1.40) + at(1.45)), at(1.50), at(1.60)], axis=2)


def between_the_horizons(truth: Truth) -> np.ndarray:
    """Pixels whose table cells hold no direction below the surface: 24° away, two cells of 6°."""
    view = np.array([0.0, 0.0, 1.0]) if truth.view_direction is None else truth.view_direction
    assert isinstance(truth.scene.light_in_image, Distant)
    cosines = truth.normals @ np.array(truth.scene.light_in_image.direction)
    pixels: np.ndarray = truth.mask & (cosines > 0.4) & ((truth.normals * view).sum(axis=-1) > 0.4)
    assert pixels.sum() > 100
    return pixels


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
def test_a_table_of_a_material_renders_as_that_material(tmp_path: Path, camera: Camera) -> None:
    """Linear interpolation: an error of second order in the step of the table.

    A step half as large leaves a quarter of it, so that the two pictures differ by three times the
    error of the finer one: 0.33, and 0.5 with the part of higher order. A wrong sign, axis or
    frame is an error of the size of the signal, whatever the step.
    """
    expected = analytic(camera)
    coarse, fine = (
        truth_of(
            scene(Measured(path=str(write(tmp_path / f"{step}.pbsdf", **table(step)))), camera)
        )
        for step in (6.0, 3.0)
    )
    assert not fine.diffuse.any()
    pixels = between_the_horizons(fine)
    for component in range(3):
        true, rough, good = (
            s[pixels][..., component] for s in (expected, coarse.stokes, fine.stokes)
        )
        error = rms(good - true)
        assert error < 0.5 * rms(rough - good)
        assert 2.5 < rms(rough - true) / error < 5.5
        assert error < 0.01 * rms(true)  # so that the signal is far above what is asserted


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64))))


def test_under_a_lamp_only_noise_is_left(tmp_path: Path) -> None:
    """Directions drawn from lamp and BSDF: another sampler than a distant light's."""
    lamp = Area(incidence_deg=50, azimuth_deg=35, half_angle_deg=10)
    surface = Measured(path=str(write(tmp_path / "a.pbsdf", **table(3.0))), alpha=ALPHA)
    known = Dielectric(eta=1.5, alpha=ALPHA, albedo=ALBEDO, body="polarised")
    camera = Camera(resolution=16)
    ours, theirs = (
        truth_of(scene(one, camera, lamp, (550.0,)), samples=256, seed=seed)
        for seed, one in enumerate((surface, known))
    )
    cosines = ours.normals @ np.array(lamp.direction)
    pixels = ours.mask & (cosines > 0.5) & (ours.normals[..., 2] > 0.4)
    error = np.hypot(ours.standard_error, theirs.standard_error)[pixels]
    residual = (ours.stokes - theirs.stokes)[pixels] / error
    # Mean of some hundred squares of normal numbers, and what the table is off by.
    assert pixels.sum() > 60
    assert 0.6 < np.mean(residual**2) < 1.5


def test_the_self_test_of_the_conventions(tmp_path: Path) -> None:
    """Mirrored light under a uniform sky (physics.md): the signs on three limbs."""
    surface = Measured(path=str(write(tmp_path / "a.pbsdf", **table(6.0))))
    one = scene(surface, Camera(resolution=24), Uniform(), (550.0,))
    truth = truth_of(one, samples=256)
    y, x = np.mgrid[:24, :24] - 11.5
    # At zenith angles of 45 to 65°, where mirrored light outweighs that of the body.
    ring = (np.hypot(x, y) > 8) & (np.hypot(x, y) < 10.5)
    s1, s2 = truth.stokes[:, :, 0, 1], truth.stokes[:, :, 0, 2]
    assert np.mean(s1[ring & (x > 3 * abs(y))]) < 0 < np.mean(s1[ring & (-y > 3 * abs(x))])
    assert np.mean(s2[ring & (x > abs(y) / 2) & (-y > abs(x) / 2)]) < 0


def test_one_band_of_a_table_is_what_the_plugin_makes_of_all(tmp_path: Path) -> None:
    path = write(tmp_path / "a.pbsdf", **table(6.0))
    variant = choose()
    mi = mitsuba(variant)
    rng = np.random.default_rng(1)
    light, viewer = (
        v / np.linalg.norm(v, axis=0)
        for v in (rng.uniform([[-1], [-1], [0.5]], 1, (3, 50)) for _ in range(2))
    )
    hit = mi.SurfaceInteraction3f()
    hit.wi = mi.Vector3f(viewer.astype(np.float32))

    def column(bsdf: Any) -> np.ndarray:
        value = bsdf.eval(mi.BSDFContext(), hit, mi.Vector3f(light.astype(np.float32)))
        return np.array([np.asarray(value[i, 0][0]) for i in range(3)])

    for wavelength, ours in zip(
        BANDS, measured_bsdfs(variant, Measured(path=str(path)), BANDS), strict=True
    ):
        whole = {"type": "measured_polarized", "filename": str(path), "wavelength": wavelength}
        expected = column(mi.load_dict(whole))
        # Rounding of 32-bit floats, which interpolate in another order.
        np.testing.assert_allclose(column(ours), expected, atol=2e-6 * np.abs(expected).max())


def test_vectorised_and_scalar_truths_agree(tmp_path: Path) -> None:
    surface = Measured(path=str(write(tmp_path / "a.pbsdf", **table(15.0))))
    one = scene(surface, Camera(resolution=12))
    best = choose()
    ours, theirs = truth_of(one, 64, best), truth_of(one, 64, choose("scalar"), seed=2)
    both = between(ours, theirs)
    error = np.hypot(ours.standard_error, theirs.standard_error)[both]
    residual = (ours.stokes - theirs.stokes)[both] / np.maximum(error, 1e-6)
    # Student's t with 7 degrees of freedom (8 batches), variance 7/5; pixels and bands correlate.
    assert 0.4 < np.mean(residual**2) < 2.0


def between(ours: Truth, theirs: Truth) -> np.ndarray:
    return ours.mask & theirs.mask & (ours.image[..., 0] > 0)


# --- what methods are told, and what is stored ---


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
    dataset = open_dataset(tmp_path / "data")
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
    with pytest.raises(ValueError, match="measured surfaces only in scenes without surroundings"):
        Scene(
            shape=Sphere(),
            surface=metal,
            light=LIGHT,
            surroundings=Surroundings(name="room", objects=beside),
        )
    with pytest.raises(InputError, match="an unpolarised body, found unknown"):
        render(scene(surface, Camera()), renderer="torrance-sparrow")
