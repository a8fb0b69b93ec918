"""Stokes images in OpenEXR files that other programs write, and other programs reading ours.

Each file of tests/cases/spectral_exr is an image of 8 × 6 pixels whose s1 is 0.2 s0 and whose s2 is
−0.1 s0 as the file counts it; `colour_science_*.exr` were written by colour-science 0.4.7 with
OpenImageIO 3.2, six bands 40 nm apart.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import scipy.constants
from made_up import made_up_truth
from runs import check_predictions

from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.datasets.spectral_exr import read_spectral, write_exr, write_spectral
from malus.renderers.datasets.stokes_channels import component_and_wavelength
from malus.scenes import InputError

CASES = Path(__file__).parents[1] / "cases" / "spectral_exr"
SHAPE = (6, 8)
BANDS = (450.0, 550.0, 650.0)
POLARISED = np.float32([1.0, 0.2, -0.1])


@pytest.mark.parametrize("name", ["one_decimal", "half", "piz", "alpha", "left_handed"])
def test_files_of_other_programs_are_read(name: str) -> None:
    stokes = read_spectral(CASES / f"{name}.exr", SHAPE, BANDS)
    assert stokes.shape == (*SHAPE, 3, 3)
    assert stokes.dtype == np.float32
    levels = stokes[0, 0, :, 0] / stokes[0, 0, 1, 0]
    half = 1e-3 if name == "half" else 1e-6  # 11 bits, two roundings
    np.testing.assert_allclose(levels, np.array(BANDS) / 550.0, rtol=half)
    turned = POLARISED * ([1, 1, -1] if name == "left_handed" else [1, 1, 1])
    np.testing.assert_allclose(stokes, stokes[..., :1] * turned, rtol=2e-3 if half > 1e-5 else 1e-6)


@pytest.mark.parametrize(("kind", "rounding"), [("float32", 1e-6), ("float16", 2e-3)])
def test_what_colour_science_wrote_is_read(kind: str, rounding: float) -> None:
    """Three of its six bands; it prints one decimal and no handedness."""
    bands = (450.0, 570.0, 650.0)
    stokes = read_spectral(CASES / f"colour_science_{kind}.exr", SHAPE, bands)
    y, x = np.mgrid[:6, :8]
    s0 = (0.5 + 0.05 * x + 0.02 * y)[..., None] * (np.array(bands) / 550.0)
    np.testing.assert_allclose(stokes, s0[..., None] * POLARISED, rtol=rounding)


def test_colour_science_reads_and_writes_the_same_images(tmp_path: Path) -> None:
    pytest.importorskip("OpenImageIO", reason="colour-science reads pictures with it")
    from colour.io import fichet2021

    random = np.random.default_rng(3).random((*SHAPE, 6, 3), np.float32)
    bands = tuple(450.0 + 40.0 * band for band in range(6))
    write_spectral(tmp_path / "ours.exr", random, bands)
    components = fichet2021.read_spectral_image_Fichet2021(tmp_path / "ours.exr")
    for component in range(3):
        wavelengths, values = components[f"S{component}"]
        np.testing.assert_allclose(wavelengths, bands)
        np.testing.assert_array_equal(values, random[..., component])
    polarised = fichet2021.Specification_Fichet2021(is_emissive=True, is_polarised=True)
    theirs = tmp_path / "theirs.exr"
    fichet2021.write_spectral_image_Fichet2021(components, theirs, "float32", polarised)
    np.testing.assert_array_equal(read_spectral(theirs, SHAPE, bands), random)


def written(
    path: Path,
    names: list[str],
    compression: str = "ZIP",
    dtype: str = "float32",
    **attributes: str,
) -> Path:
    """A file with these channels, each of another constant that tells its Stokes component."""
    levels = {"S0": 1.0, "S1": 0.2, "S2": -0.1}
    planes = {name: np.full(SHAPE, levels.get(name[:2], 0.7), dtype) for name in names}
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION")}
    OpenEXR.File(header | {"type": OpenEXR.scanlineimage} | attributes, planes).write(str(path))
    return path


def triple(wavelength: str) -> list[str]:
    return [f"S{component}.{wavelength}" for component in range(3)]


@pytest.mark.parametrize(
    "wavelength",
    ["550nm", "550,0nm", "550.000nm", "549,96nm", "0,55um", "5.5E-7m", "545,0772THz", "5,5e2nm"],
)
def test_a_band_is_found_by_the_value_of_its_wavelength(tmp_path: Path, wavelength: str) -> None:
    path = written(tmp_path / "a.exr", triple(wavelength))
    stokes = read_spectral(path, SHAPE, [550.0])
    np.testing.assert_array_equal(stokes[0, 0, 0], POLARISED)


@pytest.mark.parametrize(("wavelength", "found"), [("549,95nm", True), ("550,06nm", False)])
def test_a_band_is_no_farther_than_half_of_one_decimal(
    tmp_path: Path, wavelength: str, found: bool
) -> None:
    """As far as a program is off that prints one; further away is another band."""
    path = written(tmp_path / "a.exr", triple(wavelength))
    if found:
        read_spectral(path, SHAPE, [550.0])
    else:
        with pytest.raises(InputError, match="no such channel"):
            read_spectral(path, SHAPE, [550.0])


@pytest.mark.parametrize(("handedness", "sign"), [("right", 1), ("left", -1)])
def test_handedness_is_of_s2_and_s3(tmp_path: Path, handedness: str, sign: int) -> None:
    """Both count about the ray's direction; s1 has no sense of rotation."""
    names = [f"S{component}.550nm" for component in range(4)]
    path = written(tmp_path / "a.exr", names, polarisationHandedness=handedness)
    stokes = read_spectral(path, SHAPE, [550.0], components=4)[0, 0, 0]
    np.testing.assert_array_equal(stokes, np.float32([1.0, 0.2, -0.1 * sign, 0.7 * sign]))


@pytest.mark.parametrize("compression", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "HTJ2K32", "PXR24"])
def test_every_lossless_compression_is_read(tmp_path: Path, compression: str) -> None:
    if not hasattr(OpenEXR, f"{compression}_COMPRESSION"):
        pytest.skip("OpenEXR before 3.4")
    names = [*triple("550nm"), "A", "depth.Z"]
    path = written(tmp_path / "a.exr", names, compression, "float16")
    stokes = read_spectral(path, SHAPE, [550.0])
    np.testing.assert_array_equal(stokes[0, 0, 0], POLARISED.astype(np.float16))


def test_tiles_are_read(tmp_path: Path) -> None:
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 16
    planes = {name: np.full(SHAPE, 0.5, np.float32) for name in triple("550nm")}
    header = {"type": OpenEXR.tiledimage, "tiles": tiles, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, planes).write(str(tmp_path / "a.exr"))
    assert (read_spectral(tmp_path / "a.exr", SHAPE, [550.0]) == 0.5).all()


@pytest.mark.parametrize(
    ("names", "changes", "says"),
    [
        (triple("551nm"), {}, "expected channel S0.550,000000nm, found no such channel"),
        (triple("550nm")[:2], {}, "channel S2.550,000000nm"),
        (triple("550nm") + triple("550,0nm"), {}, "expected one channel S0.550,000000nm"),
        (triple("550nm"), {"compression": "DWAA"}, "found DWAA_COMPRESSION"),
        (triple("550nm"), {"compression": "PXR24"}, "expected float16"),
        (triple("550nm"), {"dtype": "uint32"}, "expected float16 or float32"),
        (triple("550nm"), {"polarisationHandedness": "both"}, "expected right or left"),
        ([f"S{i}.{c}" for i in range(4) for c in "RGB"] + ["Y"], {}, "colours instead of bands"),
    ],
)
def test_what_cannot_be_kept_is_refused(
    tmp_path: Path, names: list[str], changes: dict[str, str], says: str
) -> None:
    path = written(tmp_path / "a.exr", names, **changes)  # type: ignore[arg-type]
    with pytest.raises(InputError) as refusal:
        read_spectral(path, SHAPE, [550.0])
    assert says in str(refusal.value)


def test_one_channel_does_not_stand_for_two_bands(tmp_path: Path) -> None:
    path = written(tmp_path / "a.exr", triple("550,0nm"))
    with pytest.raises(InputError, match="for more than one band"):
        read_spectral(path, SHAPE, [549.99, 550.01])


def test_bands_a_millionth_apart_are_told_apart(tmp_path: Path) -> None:
    """Names that malus writes have six decimals, and bands of a suite may be that near."""
    bands = (550.0, 550.000001)
    stokes = np.random.default_rng(0).random((*SHAPE, 2, 3), np.float32)
    write_spectral(tmp_path / "a.exr", stokes, bands)
    np.testing.assert_array_equal(read_spectral(tmp_path / "a.exr", SHAPE, bands), stokes)


@pytest.mark.parametrize("handedness", ["right", "left"])
def test_predictions_of_either_handedness_score_alike(tmp_path: Path, handedness: str) -> None:
    truth = made_up_truth(bands=BANDS)
    with DatasetWriter(tmp_path / "dataset") as writer:
        writer.add(truth)
    sign = -1.0 if handedness == "left" else 1.0
    planes = {
        f"S{i}.{nm:.1f}nm".replace(".", ",").replace(",", ".", 1): truth.stokes[:, :, band, i]
        * (sign if i == 2 else 1.0)
        for band, nm in enumerate(BANDS)
        for i in range(3)
    }
    file = tmp_path / "mine" / f"{truth.scene.id}.exr"
    file.parent.mkdir()
    write_exr(file, planes, {"polarisationHandedness": handedness})
    dataset = open_folder(tmp_path / "dataset")
    predictions, problems = check_predictions(dataset, file.parent, lambda *_: None)
    assert not problems
    np.testing.assert_array_equal(predictions.stokes(dataset.scene(truth.scene.id)), truth.stokes)


@pytest.mark.parametrize(("short", "factor"), [
    ("Y", "yotta"), ("Z", "zetta"), ("E", "exa"), ("P", "peta"), ("T", "tera"), ("G", "giga"),
    ("M", "mega"), ("k", "kilo"), ("h", "hecto"), ("da", "deka"), ("d", "deci"), ("c", "centi"),
    ("m", "milli"), ("u", "micro"), ("n", "nano"), ("p", "pico"),
])  # fmt: skip
def test_prefixes_of_units_are_those_of_the_si(short: str, factor: str) -> None:
    size = getattr(scipy.constants, factor)
    for unit, value in (("m", 550e-9 / size), ("Hz", scipy.constants.c / 550e-9 / size)):
        # Seventeen digits say a double exactly; nine decimals of a nanometre are kept.
        told = component_and_wavelength(f"S2.{value:.17e}{short}{unit}")
        assert told is not None
        assert told[0] == 2
        assert told[1] == pytest.approx(550.0, rel=1e-11)
