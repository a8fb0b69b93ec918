"""Several surfaces on one object: exact compositions of plain truths, and where each is."""

from __future__ import annotations

from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import trimesh
from pictures import ball_with_coordinates, corner
from PIL import Image

from malus.bench import observe, run, score
from malus.renderers import Truth
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.translate import tessellated
from malus.renderers.variant import choose
from malus.scenes import (
    Area,
    Camera,
    Checker,
    Conductor,
    Dielectric,
    Distant,
    ImageTexture,
    InputError,
    MeshFile,
    Noise,
    Patterned,
    Sampling,
    Scene,
    Sphere,
    Spots,
    Stripes,
    Torus,
    load_suite,
)

pytestmark = pytest.mark.skipif(
    not choose().vectorised, reason="several surfaces on one object need LLVM or CUDA"
)

FEW = Sampling(samples=16, seed=3)
MATT = Dielectric(material="pmma", alpha=0.4, albedo="red", body="polarised")
SHINY = Dielectric(material="water", alpha=0.15, albedo="blue", body="unpolarised")
GOLD = Conductor(material="gold", alpha=0.25)


def scene(surface: object, shape: object = None, light: object = None, side: int = 24) -> Scene:
    return Scene(
        shape=shape or Sphere(),
        surface=surface,
        light=light or Distant(incidence_deg=45),
        camera=Camera(resolution=side),
        wavelengths_nm=(450, 650),
    )


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_waves_of_a_noise_are_six_times_as_long_along_its_grain(axis: str) -> None:
    plain, grained = Noise(seed=3).waves(), Noise(seed=3, grain=axis).waves()
    factors = np.where(np.array(list("xyz")) == axis, 1 / 6, 1.0)
    np.testing.assert_allclose(grained[:, :3], plain[:, :3] * factors, rtol=1e-14)
    np.testing.assert_array_equal(grained[:, 3:], plain[:, 3:])


def truth_of(one: Scene, sampling: Sampling = FEW) -> Truth:
    return render_family([one], sampling).truth(one)


@pytest.mark.parametrize("pattern", [Checker(), Stripes(), Spots()], ids=lambda p: p.label)
def test_a_pattern_of_equal_surfaces_is_no_pattern(pattern: object) -> None:
    plain, patterned = (
        truth_of(scene(surface, light=Area(incidence_deg=45)))
        for surface in (MATT, Patterned(pattern=pattern, surfaces=(MATT, MATT)))
    )
    for name in ("specular", "diffuse"):
        expected = getattr(plain, name)
        # Sums of the same samples in two parts: rounding of 32-bit floats.
        np.testing.assert_allclose(
            getattr(patterned, name), expected, atol=2e-6 * float(expected.max())
        )
    np.testing.assert_array_equal(patterned.mask, plain.mask)
    np.testing.assert_array_equal(patterned.normals, plain.normals)
    # Variances are differences of second moments and squared means.
    np.testing.assert_allclose(patterned.standard_error, plain.standard_error, atol=2e-4)
    np.testing.assert_allclose(patterned.eta, np.broadcast_to(plain.eta, patterned.eta.shape))
    np.testing.assert_allclose(patterned.alpha, 0.4, rtol=1e-6)


@pytest.mark.parametrize("shape", [Sphere(), Torus()], ids=lambda s: s.label)
def test_where_pixels_are_pure_the_truth_is_that_of_their_surface(shape: object) -> None:
    one = scene(Patterned(pattern=Stripes(width=0.4), surfaces=(MATT, SHINY, GOLD)), shape)
    family = render_family([one], FEW)
    truth = family.truth(one)
    seen = 0
    for index, surface in enumerate(one.surface.surfaces):
        plain = truth_of(scene(surface, shape))
        # 16 rays and 16 samples a pixel agree on purity but for slivers at the stripes' edges.
        y = np.linspace(1.05, -1.05, 25)
        inside = np.floor(y[:-1] / 0.4 - 1e-4) == np.floor(y[1:] / 0.4 + 1e-4)
        pure = (family.shares[..., index] == 1) & truth.mask & inside[:, None]
        seen += pure.sum()
        np.testing.assert_array_equal(truth.specular[pure], plain.specular[pure])
        np.testing.assert_array_equal(truth.diffuse[pure], plain.diffuse[pure])
        np.testing.assert_allclose(
            truth.eta[pure],
            np.broadcast_to(surface.indices((450, 650)), (pure.sum(), 2)),
            rtol=1e-6,
        )
        np.testing.assert_allclose(truth.alpha[pure], surface.alpha, rtol=1e-6)
    assert seen > 0.4 * truth.mask.sum()


def test_stripes_are_where_they_should_be() -> None:
    family_scene = scene(Patterned(pattern=Stripes(width=3, axis="x"), surfaces=(MATT, GOLD)))
    shares = render_family([family_scene], FEW).shares
    # The slab 0 <= x < 3 has the first surface, −3 <= x < 0 the second.
    assert np.all(shares[8:16, 13:, 0] == 1)
    assert np.all(shares[8:16, 4:11, 1] == 1)


@pytest.mark.parametrize("projection", ["planar", "spherical"])
def test_image_textures_are_upright(tmp_path: Path, projection: str) -> None:
    """White at the upper right, as one looks at the object."""
    values = np.zeros((40, 80), np.uint8)
    values[:20, 40:60] = 255  # right of the middle, and not what is behind in the round
    if projection == "planar":
        values[:20, 60:] = 255
    Image.fromarray(values).save(tmp_path / "corner.png")
    texture = ImageTexture(path=str(tmp_path / "corner.png"), projection=projection)
    shares = render_family([scene(Patterned(pattern=texture, surfaces=(MATT, GOLD)))], FEW).shares[
        ..., 1
    ]
    quarters = {
        "upper right": shares[4:10, 14:20], "upper left": shares[4:10, 4:10],
        "lower right": shares[14:20, 14:20], "lower left": shares[14:20, 4:10],
    }  # fmt: skip
    found = {name: float(part.mean()) for name, part in quarters.items()}
    assert found.pop("upper right") == 1
    assert not any(found.values()), found


@pytest.mark.parametrize("kind", ["obj", "glb"])
def test_coordinates_of_a_mesh_that_are_a_projection_do_what_it_does(
    tmp_path: Path, kind: str
) -> None:
    """From its lower left corner up, whatever the file counts from."""
    mesh, path = ball_with_coordinates(tmp_path, kind), str(corner(tmp_path))
    seen = {}
    for projection in ("planar", "uv"):
        texture = ImageTexture(path=path, projection=projection)
        surface = Patterned(pattern=texture, surfaces=(MATT, GOLD))
        seen[projection] = render_family([scene(surface, mesh)], FEW)
    shares = [family.shares[..., 1] for family in seen.values()]
    # Rounding of the coordinates, within which a ray at an edge in the picture may change sides.
    # At the rim the picture's own edges meet, because it repeats.
    np.testing.assert_allclose(*(found[1:-1, 1:-1] for found in shares), atol=0.01)
    assert 0.2 < shares[1][4:20, 4:20].mean() < 0.3


def test_coordinates_beyond_the_picture_repeat_it(tmp_path: Path) -> None:
    """The picture at double coordinates is four of it side by side."""
    path = corner(tmp_path)
    four = tmp_path / "four.png"
    Image.fromarray(np.tile(np.asarray(Image.open(path)), (2, 2))).save(four)
    shares = []
    for picture, scale in ((path, 2.0), (four, 1.0)):
        texture = ImageTexture(path=str(picture), projection="uv")
        surface = Patterned(pattern=texture, surfaces=(MATT, GOLD))
        folder = tmp_path / str(scale)
        folder.mkdir()
        mesh = ball_with_coordinates(folder, "obj", scale)
        shares.append(render_family([scene(surface, mesh)], FEW).shares[..., 1])
    np.testing.assert_allclose(*shares, atol=0.01)
    assert 0.2 < shares[1][4:20, 4:20].mean() < 0.3


def test_seams_of_a_texture_are_smooth(tmp_path: Path) -> None:
    """Where the coordinates jump, positions and normals do not: the mesh renders as without."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    faces, corners = np.asarray(ball.faces), np.asarray(ball.vertices)
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    plain = lines + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    # Coordinates of its own for every corner of every face.
    uv = np.random.default_rng(0).random((3 * len(faces), 2))
    lines += [f"vt {u} {v}" for u, v in uv]
    lines += [f"f {a}/{3 * k + 1} {b}/{3 * k + 2} {c}/{3 * k + 3}"
              for k, (a, b, c) in enumerate(faces + 1)]  # fmt: skip
    truths = []
    for name, text in (("plain", plain), ("seams", lines)):
        path = tmp_path / f"{name}.obj"
        path.write_text("\n".join(text))
        truths.append(truth_of(scene(MATT, MeshFile(path=str(path)))))
    assert tessellated(MeshFile(path=str(path))).uv is not None
    np.testing.assert_allclose(truths[1].normals, truths[0].normals, atol=1e-6)
    # Rounding, in another order of the vertices.
    peak = truths[0].image.max()
    np.testing.assert_allclose(truths[1].stokes, truths[0].stokes, atol=1e-5 * peak)


def test_coordinates_that_are_not_there_are_told(tmp_path: Path) -> None:
    texture = ImageTexture(path=str(corner(tmp_path)), projection="uv")
    surface = Patterned(pattern=texture, surfaces=(MATT, GOLD))
    path = tmp_path / "bare.obj"
    path.write_text(trimesh.creation.icosphere(subdivisions=1).export(file_type="obj"))
    with pytest.raises(InputError, match=r"bare\.obj: expected texture coordinates for uv"):
        render_family([scene(surface, MeshFile(path=str(path)))], FEW)
    with pytest.raises(
        InputError, match='projection = "uv" only on mesh files, found sphere; choose'
    ):
        scene(surface)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_pictures_of_16_bits_have_all_of_them(tmp_path: Path, channels: int) -> None:
    codes = np.random.default_rng(0).integers(0, 65536, (5, 7, channels)).astype(np.uint16)
    content = imagecodecs.png_encode(codes[..., 0] if channels == 1 else codes)
    (tmp_path / "deep.png").write_bytes(content)
    grey = ImageTexture(path=str(tmp_path / "deep.png")).grey()
    expected = codes[..., :3] @ [0.299, 0.587, 0.114] if channels > 2 else codes[..., 0]
    np.testing.assert_allclose(grey, expected / 65535, rtol=1e-6)  # single precision


def test_grey_is_a_mixture_and_its_errors_are_honest(tmp_path: Path) -> None:
    Image.fromarray(np.full((4, 4), 51, np.uint8)).save(tmp_path / "grey.png")
    texture = ImageTexture(path=str(tmp_path / "grey.png"))
    one = scene(Patterned(pattern=texture, surfaces=(MATT, GOLD)), side=12)
    plain = [truth_of(scene(surface, side=12), Sampling(samples=512)) for surface in (MATT, GOLD)]
    mask = plain[0].mask
    expected = 0.8 * plain[0].stokes + 0.2 * plain[1].stokes
    residuals = []
    for seed in range(6):
        found = truth_of(one, Sampling(samples=64, seed=seed + 10))
        np.testing.assert_allclose(found.alpha[mask], 0.8 * 0.4 + 0.2 * 0.25, rtol=1e-5)
        error = np.hypot(found.standard_error, 0.8 * plain[0].standard_error)[mask]
        residuals.append((found.stokes - expected)[mask] / np.maximum(error, 1e-6))
    # 6 draws of some 80 pixels; s0, s1, s2 and the bands of a sample move together.
    assert 0.8 < np.mean(np.square(residuals)) < 1.25
    assert abs(np.mean(residuals)) < 0.15


def test_methods_get_the_maps_and_use_them() -> None:
    """Told η and α of every pixel, the right model is right on both materials."""
    one = scene(Patterned(pattern=Stripes(width=0.5), surfaces=(
        MATT.model_copy(update={"alpha": 0.2}), Dielectric(eta=1.8, alpha=0.3, albedo=0.2))),
        side=48)  # fmt: skip
    truth = truth_of(one, Sampling(samples=64))
    seen = observe(truth, frozenset({"eta", "alpha"}))
    assert seen.eta.shape == (48, 48, 2)
    assert seen.alpha.shape == (48, 48)
    assert score(truth, "half_vector+body").skill > 0.99


def test_patterned_truths_are_stored_to_the_bit(tmp_path: Path) -> None:
    truth = truth_of(scene(Patterned(pattern=Checker(), surfaces=(MATT, GOLD)), side=8))
    with DatasetWriter(tmp_path) as writer:
        writer.add(truth)
    found = open_folder(tmp_path).truth(truth.scene.id)
    assert found.scene == truth.scene
    assert found.eta.dtype == truth.eta.dtype
    assert found.eta.tobytes() == truth.eta.tobytes()
    assert found.alpha.tobytes() == truth.alpha.tobytes()


SUITE = """
name = "patterns"
shapes = [{ kind = "sphere" }]
materials = ["pmma", "water"]
surfaces = [{ pattern = { kind = "image", path = "mask.png" }, parts = [
    "carbon", { surface = { alpha = 0.2, albedo = "red" }, material = "gold" }, { alpha = 0.1 },
] }]
bodies = ["polarised"]
lights = [{ kind = "distant", incidence_deg = 45 }]
wavelengths_nm = [450, 650]
methods = ["eq8", "half_vector+body"]
camera = { resolution = 8 }
sampling = { samples = 4 }
"""


def test_a_suite_with_a_pattern_runs(tmp_path: Path) -> None:
    Image.fromarray(np.eye(8, dtype=np.uint8) * 255).save(tmp_path / "mask.png")
    (tmp_path / "patterns.toml").write_text(SUITE)
    suite = load_suite(tmp_path / "patterns.toml")
    scenes = list(suite.scenes())
    assert len(scenes) == 2
    assert [part.material_label for part in scenes[0].surface.surfaces] == ["pmma", "gold", "pmma"]
    found = run(suite, tmp_path / "out")
    assert found.run["families_failed"] == 0
    assert set(found.table.method) == {"eq8", "half_vector+body"}
    # Another content, another id; the name of the file says nothing.
    Image.fromarray(np.zeros((8, 8), np.uint8)).save(tmp_path / "mask.png")
    assert next(load_suite(tmp_path / "patterns.toml").scenes()).id != scenes[0].id


@pytest.mark.parametrize(
    ("content", "says"), [(None, "readable picture"), (b"no picture", "PNG or EXR")]
)
def test_bad_pictures_are_told(tmp_path: Path, content: bytes | None, says: str) -> None:
    (tmp_path / "patterns.toml").write_text(SUITE)
    if content is not None:
        (tmp_path / "mask.png").write_bytes(content)
    with pytest.raises(InputError, match=says):
        truth_of(next(load_suite(tmp_path / "patterns.toml").scenes()))
