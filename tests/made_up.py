"""Truths and observations that nobody rendered: random, small, physical."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from malus.reconstruct import Observation
from malus.renderers import Truth
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere, Uniform
from malus.scenes.shapes.geometry import TriangleMesh, icosahedral_grid
from malus.scenes.shapes.meshes import signed_volume

BANDS = (450.0, 532.1234567, 650.0)


def icosphere(subdivisions: int = 6) -> TriangleMesh:
    """The unit sphere in 20 · 4^subdivisions triangles, with exact normals."""
    directions, faces = icosahedral_grid(subdivisions)
    corners = directions.astype(np.float32)
    return TriangleMesh(corners, faces, corners.copy())


def volume(mesh: TriangleMesh) -> float:
    """Volume inside a mesh, negative if it is inside out."""
    return signed_volume(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64))


def made_up_truth(
    seed: int = 0,
    dtype: type[np.floating] = np.float32,
    side: int = 6,
    bands: tuple[float, ...] = BANDS,
) -> Truth:
    """A truth of random numbers; every seed is another scene."""
    random = np.random.default_rng(seed)
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.3 + 0.001 * seed, alpha=0.3),
        light=Distant(incidence_deg=60),
        camera=Camera(resolution=side),
        wavelengths_nm=bands,
    )
    shape = (side, side, len(bands), 3)

    def stokes(scale: float) -> np.ndarray:
        values = scale * random.normal(size=shape)
        values[..., 0] = 2.0 * np.hypot(values[..., 1], values[..., 2]) + 0.1 * scale
        return values.astype(dtype)

    normals = random.normal(size=(side, side, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    mask = random.random((side, side)) < 0.7
    return Truth(
        scene=scene,
        specular=stokes(1.0),
        diffuse=stokes(0.5),
        normals=normals.astype(dtype),
        mask=mask,
        standard_error=np.abs(stokes(1e-3)),
        specular_noise=stokes(1e-3),
        diffuse_noise=-stokes(1e-3),
        interpolation_error={"rms": 0.1 + seed, "worst": 1 / 3},
    )


def truth_with(
    stokes: np.ndarray,
    mask: np.ndarray,
    bands: tuple[float, ...] = (450.0, 550.0, 650.0),
    noise: np.ndarray | None = None,
) -> Truth:
    """A truth whose Stokes image is given, all of it specular, with a draw of noise or without."""
    side = len(mask)
    return Truth(
        scene=Scene(
            shape=Sphere(),
            surface=Dielectric(eta=1.5, alpha=0.3),
            light=Uniform(),
            camera=Camera(resolution=side),
            wavelengths_nm=bands,
        ),
        specular=stokes,
        diffuse=np.zeros_like(stokes),
        normals=np.zeros((side, side, 3)) + np.array([0, 0, 1]),
        mask=mask,
        standard_error=np.zeros_like(stokes),
        specular_noise=np.zeros_like(stokes) if noise is None else noise,
        diffuse_noise=np.zeros_like(stokes),
    )


def random_observation(
    seed: int, alpha: float = 0.3, height: int = 6, width: int = 8, steepest: float = 0.05
) -> Observation:
    """Random intensities and normals (cos θ > `steepest`) in float64 and two bands."""
    random = np.random.default_rng(seed)
    cosine = random.uniform(steepest, 1.0, (height, width))
    turn = random.uniform(0.0, 2.0 * np.pi, (height, width))
    sine = np.sqrt(1.0 - cosine**2)
    specular, diffuse = random.random((2, height, width, 2))
    return Observation(
        image=specular + diffuse,
        mask=np.ones((height, width), dtype=bool),
        specular=specular,
        diffuse=diffuse,
        normals=np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=-1),
        eta=np.array([1.52, 1.5]),
        alpha=alpha,
        light=Distant(incidence_deg=70, azimuth_deg=20),
    )


def stored(folder: Path, *truths: Truth) -> Path:
    """Write a dataset of truths; its folder."""
    with DatasetWriter(folder) as writer:
        for truth in truths:
            writer.add(truth)
    return folder


def tensor_file(**fields: np.ndarray) -> bytes:
    """Arrays of 16-bit integers or 32-bit floats in the format of Mitsuba's tensor files."""
    numbers = {"uint16": 3, "float32": 10, "float64": 11}
    head = b"tensor_file\0\1\0" + struct.pack("<I", len(fields))
    offset = len(head) + sum(13 + len(name) + 8 * a.ndim for name, a in fields.items())
    for name, array in fields.items():
        head += struct.pack("<H", len(name)) + name.encode()
        head += struct.pack("<HBQ", array.ndim, numbers[array.dtype.name], offset)
        head += struct.pack(f"<{array.ndim}Q", *array.shape)
        offset += array.nbytes
    return head + b"".join(array.tobytes() for array in fields.values())


def tiny_pbrdf() -> dict[str, np.ndarray]:
    """Fields of a table of polarised BRDFs, the smallest that there is."""
    return {
        "phi_d": np.float32([[-3.2, 0, 3.2]]),
        "theta_d": np.float32([[0, 1.6]]),
        "theta_h": np.float32([[0, 1.6]]),
        "wvls": np.array([450, 500, 550, 600, 650], np.uint16),
        "M": np.ones((3, 2, 2, 5, 4, 4), np.float32),
    }
