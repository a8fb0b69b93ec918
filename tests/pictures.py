"""Pictures that nobody took, files of them, and a mesh that one of them is wrapped around."""

from __future__ import annotations

from pathlib import Path

import imagecodecs
import numpy as np
import PIL.Image
import tifffile
import trimesh

from malus.reconstruct.fresnel import smooth_dolp
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.tone_curves import srgb_transfer
from malus.reconstruct.photos.write_picture import write_picture
from malus.scenes import MeshFile, polarisation

SMOOTH = np.linspace(20, 230, 16 * 24).reshape(16, 24)[..., None].repeat(3, -1).astype(np.uint8)
CODES_16 = np.random.default_rng(0).integers(0, 65536, (16, 24, 4), dtype=np.uint16)


def save_16_bits(path: Path, values: np.ndarray) -> None:
    """A 16-bit PNG of values in [0, 1], written by another library than the one that reads."""
    path.parent.mkdir(parents=True, exist_ok=True)
    codes = np.rint(values.clip(0, 1) * 65535).astype(np.uint16)
    path.write_bytes(imagecodecs.png_encode(codes))


def dome(side: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Linear light of a glossy orange dome under a light at (1, 1, 2), and its normals."""
    y, x = np.mgrid[1.05 : -1.05 : side * 1j, -1.05 : 1.05 : side * 1j]
    square = x**2 + y**2
    normals = np.stack([x, y, np.sqrt(np.clip(1 - square, 0, None))], axis=-1)
    normals[square > 0.98] = 0
    light = np.array([1, 1, 2]) / np.sqrt(6)
    half = (light + [0, 0, 1]) / np.linalg.norm(light + [0, 0, 1])
    body = 0.5 * np.clip(normals @ light, 0, 1)[..., None] * [1.0, 0.6, 0.3]
    glare = 0.3 * np.clip(normals @ half, 0, 1)[..., None] ** 60
    return (body + glare).astype(np.float32), normals.astype(np.float32)


def dome_stokes(side: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Stokes image (side, side, 3, 3) of a mirror-like dome of η = 1.5, and its normals."""
    y, x = np.mgrid[1.05 : -1.05 : side * 1j, -1.05 : 1.05 : side * 1j]
    square = x**2 + y**2
    inside = square < 0.97
    cosine = np.sqrt(np.where(inside, 1 - square, 1.0))
    normals = np.where(inside[..., None], np.stack([x, y, cosine], axis=-1), 0)
    light = np.where(inside, 0.3 + 0.2 * x, 0.2)[..., None] * [1.0, 0.9, 0.8]
    rho = np.where(inside, smooth_dolp(cosine, 1.5), 0)[..., None]
    half = 0.5 * light
    azimuth = np.arctan2(y, x)[..., None]
    stokes = polarisation.stokes_from_extremes(half * (1 + rho), half * (1 - rho), azimuth)
    return stokes, normals.astype(np.float32)


def write_capture(folder: Path, stokes: np.ndarray, angles: dict[str, float]) -> None:
    """Float TIFFs of a Stokes image through polarisers at angles from the vertical."""
    for name, angle in angles.items():
        picture = polarisation.polarised(stokes, angle).astype(np.float32)
        tifffile.imwrite(folder / name, picture, photometric="rgb")


def saved_dome(folder: Path, name: str = "dome.png") -> tuple[Path, Path]:
    """An 8-bit sRGB file of the dome, and a file of its normals."""
    linear, normals = dome()
    path, beside = folder / name, folder / "normals.npy"
    PIL.Image.fromarray(srgb_transfer(8).encoded(linear)).save(path)
    np.save(beside, normals)
    return path, beside


def ball_with_coordinates(folder: Path, kind: str, scale: float = 1.0) -> MeshFile:
    """A ball whose texture coordinates are those of the planar projection, times `scale`."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    uv = scale * (0.5 + 0.5 * np.asarray(ball.vertices)[:, :2])
    ball.visual = trimesh.visual.TextureVisuals(uv=uv)
    exported = ball.export(file_type=kind)
    path = folder / f"ball.{kind}"
    path.write_bytes(exported if isinstance(exported, bytes) else exported.encode())
    return MeshFile(path=str(path))


def corner(folder: Path) -> Path:
    """A picture whose upper right quarter is white."""
    values = np.zeros((40, 40), np.uint8)
    values[:20, 20:] = 255
    PIL.Image.fromarray(values).save(folder / "corner.png")
    return folder / "corner.png"


def rewritten(path: Path, picture: Picture) -> Path:
    """A file beside `path` that malus makes of a picture as it was read."""
    copy = path.with_name(f"copy{picture.suffix}")
    write_picture(copy, picture)
    return copy
