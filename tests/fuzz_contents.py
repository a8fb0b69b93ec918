"""Small valid files of every kind that malus reads: contents to begin fuzzing from."""

from __future__ import annotations

import functools
import io
import json
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from made_up import BANDS, made_up_truth, stored

from malus.bench.gates.baseline import DEFAULT_RULES, Baseline, RunIdentity, write_baseline
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.tone_curves import linear_transfer, power_transfer
from malus.reconstruct.photos.write_picture import write_picture
from malus.renderers.datasets.spectral_exr import write_exr, write_spectral
from malus.reports.tables import sample

SIDE = 6
TRUTH = made_up_truth(side=SIDE)


def written(name: str, write: Callable[[Path], object]) -> Callable[[], bytes]:
    """The content of a file that a function writes."""

    def content() -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder) / name)
            return (Path(folder) / name).read_bytes()

    return content


# --- suites and meshes ---

SUITE = b"""name = "vase"
shapes = [{ kind = "torus", tilt_deg = 30 }, { kind = "sphere" }]
materials = ["pmma", { eta = 1.5 }]
surfaces = ["rust", { alpha = 0.2, albedo = 0.4 }]
bodies = ["polarised"]
lights = [{ kind = "uniform" }, { kind = "area", incidence_deg = 60, half_angle_deg = 15 }]
wavelengths_nm = [450, 550, 650]
methods = ["unpolarised", "eq8"]
camera = { resolution = 96 }
sampling = { samples = 64, seed = 1 }
"""


def mesh(kind: str) -> Callable[[], bytes]:
    def content() -> bytes:
        import trimesh

        exported = trimesh.creation.icosahedron().export(file_type=kind)
        return exported.encode() if isinstance(exported, str) else exported

    return content


_PLY = b"""ply
format %s 1.0
element vertex 4
property float x
property float y
property float z
element %s
end_header
"""
STRIPS = _PLY % (b"ascii", b"tristrips 1\nproperty list int int vertex_indices")
STRIPS += b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n7 0 1 2 3 -1 0 1\n"
POLYGONS = _PLY % (b"binary_little_endian", b"face 2\nproperty list uchar int vertex_indices")
POLYGONS += np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]]).tobytes()
POLYGONS += b"\4" + np.int32([0, 1, 2, 3]).tobytes() + b"\3" + np.int32([0, 1, 3]).tobytes()

ARROW = ((0, 0, 0), (2, 1, 0), (0, 2, 0), (1, 1, 0.5), (0.5, 1, 0))
"""Corners of a concave face."""
OBJ_CONCAVE = "".join("v {} {} {}\n".format(*corner) for corner in ARROW).encode()
OBJ_CONCAVE += b"vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 \\\n 4/1/1\nf -5//-1 -4//-1 -3//-1 -1//-1\n"
OFF_CONCAVE = "".join("{} {} {}\n".format(*corner) for corner in ARROW).encode()
OFF_CONCAVE = b"OFF # a comment\n5 2 0\n" + OFF_CONCAVE + b"4 0 1 2 3\n5 0 1 2 3 4\n"
PLY_CONCAVE = _PLY % (b"binary_little_endian", b"face 2\nproperty list uchar int vertex_indices")
PLY_CONCAVE += np.float32(ARROW[:4]).tobytes()
PLY_CONCAVE += 2 * (b"\4" + np.int32([0, 1, 2, 3]).tobytes())


# --- pictures ---


def picture(kind: str, depth: type = np.uint8) -> Callable[[], bytes]:
    def content() -> bytes:
        from PIL import Image

        codes = np.random.default_rng(1).integers(0, np.iinfo(depth).max, (8, 8, 3), depth)
        out = io.BytesIO()
        if kind == "tiff":
            import tifffile

            tifffile.imwrite(out, codes, photometric="rgb", compression="deflate")
        elif depth is np.uint16:
            import imagecodecs

            return bytes(imagecodecs.png_encode(codes))
        else:
            Image.fromarray(codes).save(out, format=kind)
        return out.getvalue()

    return content


def deep_grey() -> bytes:
    import imagecodecs

    codes = np.random.default_rng(1).integers(0, 1 << 16, (8, 8), np.uint16)
    return bytes(imagecodecs.png_encode(codes))


def colours(path: Path) -> None:
    write_exr(path, dict.fromkeys("RGB", np.full((4, 8), 0.5, np.float32)))


HDR = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + bytes([128, 128, 128, 129]) * 32

PFM = b"PF\n4 2\n-1.0\n" + np.linspace(0.1, 2.0, 24).astype("<f4").tobytes()
DEEP_PGM = b"P5\n4 2\n4095\n" + np.arange(0, 4000, 500).astype(">u2").tobytes()


def npy(path: Path) -> None:
    np.save(path, np.full((4, 4, 3), 0.5, np.float32))


def jpeg2000() -> bytes:
    import imagecodecs

    codes = np.random.default_rng(1).integers(0, 1 << 16, (8, 8, 3), np.uint16)
    data = imagecodecs.jpeg2k_encode(codes, level=0, codecformat="jp2", reversible=True)
    return bytes(data)


def with_opacity() -> bytes:
    """A JPEG 2000 file whose colours are multiplied by an opacity."""
    codes = np.full((8, 8, 4), 99, np.uint8)
    picture = Picture(
        codes[..., :3].astype(np.float32) / 255,
        "JPEG2000",
        linear_transfer(8),
        codes[..., 3],
        {"cdef": struct.pack(">13H", 4, 0, 0, 1, 1, 0, 2, 2, 0, 3, 3, 2, 0)},
        premultiplied=True,
    )
    return written("a.jp2", lambda path: write_picture(path, picture))()


def deep_avif() -> bytes:
    import imagecodecs

    codes = np.random.default_rng(1).integers(0, 1 << 10, (8, 8, 3), np.uint16)
    return bytes(imagecodecs.avif_encode(codes, bitspersample=10, level=90, transfer=8))


def with_gamma(path: Path) -> None:
    light = np.random.default_rng(1).random((8, 8, 3), np.float32)
    write_picture(
        path,
        Picture(
            light,
            "PNG",
            power_transfer(1.0, 16),
            metadata={"chunks": {b"gAMA": struct.pack(">I", 100_000)}},
        ),
    )


def with_exif() -> bytes:
    """A JPEG of a camera in its Adobe RGB mode."""
    from PIL import Image

    exif, out = Image.Exif(), io.BytesIO()
    exif.get_ifd(0x8769).update({0xA001: 65535, 0xA500: 2.2})
    exif.get_ifd(0x8769)[0xA005] = {1: "R03"}
    xmp = b"<x:xmpmeta xmlns:x='adobe:ns:meta/'><exif:Gamma>22/10</exif:Gamma></x:xmpmeta>"
    Image.new("RGB", (8, 8), (99, 5, 200)).save(out, "JPEG", exif=exif, xmp=xmp)
    return out.getvalue()


def pages(path: Path) -> None:
    import tifffile

    codes = np.random.default_rng(1).integers(1, 1 << 16, (4, 8, 8, 3), np.uint16)
    tifffile.imwrite(path, codes, photometric="rgb")


def associated_alpha(path: Path) -> None:
    import tifffile

    codes = np.full((8, 8, 4), 99, np.uint8)
    tifffile.imwrite(path, codes, photometric="rgb", extrasamples=["assocalpha"])


def stack(path: Path) -> None:
    np.save(path, np.random.default_rng(1).random((4, 8, 8, 3), np.float32))


def chroma(path: Path) -> None:
    write_exr(path, dict.fromkeys(("Y", "RY", "BY", "A"), np.full((4, 8), 0.5, np.float32)))


# --- datasets and predictions ---


@functools.cache
def dataset() -> Path:
    """A dataset of one scene, whose files are never changed."""
    return stored(Path(tempfile.mkdtemp(prefix="fuzz-")), TRUTH)


def dataset_file(name: str) -> Callable[[], bytes]:
    return lambda: (dataset() / name.format(scene=TRUTH.scene.id)).read_bytes()


def stokes_npz() -> bytes:
    out = io.BytesIO()
    np.savez_compressed(out, stokes=TRUTH.stokes)
    return out.getvalue()


def angle_npy() -> bytes:
    out = io.BytesIO()
    np.save(out, TRUTH.polarised(0))
    return out.getvalue()


# --- results ---

FAILURES = b'{"family": "sphere", "failures": [{"scene": null, "method": "eq8", "reason": "x"}]}'
PLAN = (
    b'{"suite": "a", "suite_id": "b", "methods": ["eq8"], '
    b'"families": [{"id": "0123456789abcdef", "label": "sphere", "scenes": 2}]}'
)


def table(path: Path) -> None:
    sample.table().head(50).to_parquet(path, index=False)


def baseline(path: Path) -> None:
    origin = RunIdentity(suite="gate", scenes="0", seed=1, variant="scalar")
    write_baseline(path, Baseline(origin=origin, rules=DEFAULT_RULES))


def example() -> bytes:
    meta = {"scene": "0" * 16, "label": "sphere", "wavelengths_nm": list(BANDS)}
    out = io.BytesIO()
    images = {"truth": TRUTH.stokes, "mask": TRUTH.mask, "mixed": TRUTH.mask}
    np.savez_compressed(out, **images, meta=np.array(json.dumps(meta)))
    return out.getvalue()


def spectral(path: Path) -> None:
    write_spectral(path, TRUTH.stokes, BANDS)


def spectral_of_others(path: Path) -> None:
    """Half floats, PIZ, one decimal, opacity, left-handed: what other programs write."""
    import OpenEXR

    names = [f"S{part}.{band:.1f}nm" for band in BANDS for part in range(3)]
    planes = {name: np.full((SIDE, SIDE), 0.5, np.float16) for name in [*names, "A"]}
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header | {"polarisationHandedness": "left"}, planes).write(str(path))
