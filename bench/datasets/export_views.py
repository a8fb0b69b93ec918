"""The layout of NeISF: one object from many sides, with the poses of the cameras.

Source: the README of the public code of NeISF (Li et al., CVPR 2024), whose poses are LLFF's:
a row a picture of [R | t | height, width, focal length] and two unused bounds. The columns of R are
the camera's down, right and back in the world, t is where it stands.
"""

from __future__ import annotations

import json
from collections import defaultdict
from functools import partial
from pathlib import Path

import numpy as np

from malus.bench.datasets.export_networks import NAMES, check_bands, colours, save_png
from malus.bench.running.progress import Progress
from malus.renderers.datasets.dataset import Dataset
from malus.renderers.datasets.spectral_exr import write_exr
from malus.scenes.camera import Camera
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import replace_text, write_whole
from malus.scenes.core.model import content_id
from malus.scenes.scene import Scene

LARGEST_DISTANCE = 3.0
"""Radius of the sphere that holds all cameras of NeISF; the world is scaled to fit."""

WORDS = {
    "OBJECT/images_s0, images_s1, images_s2": "img_001.exr, ...: linear Stokes components from"
    " I_000 - I_090 and I_045 - I_135, angles from the HORIZONTAL, anticlockwise as displayed; R, G"
    " and B the three bands, the longest first; black off the object",
    "OBJECT/masks": "img_001.png: 65535 on the object, three channels of 16 bits",
    "OBJECT/poses_bounds.npy": "(pictures, 17): [R | t | height, width, focal length in pixels] row"
    " by row, and two zeros; columns of R are the camera's down, right and back in the world, which"
    " is y up as malus' but scaled so that no camera is farther from the origin than 3",
    "OBJECT": "scenes that differ in nothing but the camera, named by a hash of what they share",
    "names.json": "OBJECT/img_001, ... of every scene, by its id",
    "keeps": "linear Stokes vectors of three bands, masks, poses",
    "loses": "noise, lobes, normals; where a pixel lies in the picture to half a pixel, as NeISF's"
    " rays go through the corners of pixels",
}


def objects_of(dataset: Dataset) -> dict[str, list[str]]:
    """Ids of the scenes that show the same object, by its name.

    Raises
    ------
    InputError
        A camera or a number of bands that NeISF's pictures cannot have.
    """
    objects: defaultdict[str, list[str]] = defaultdict(list)
    for scene_id in dataset.scenes:
        scene = dataset.scene(scene_id).scene
        check_bands(scene)
        objects[_object_of(scene)].append(scene_id)
    return dict(objects)


def view_names(dataset: Dataset) -> dict[str, str]:
    """Object and picture of every scene, `OBJECT/img_001`, by its id."""
    return {
        scene_id: f"{name}/img_{number:03}"
        for name, scenes in objects_of(dataset).items()
        for number, scene_id in enumerate(scenes, start=1)
    }


def write_neisf(dataset: Dataset, folder: Path, progress: Progress) -> None:
    """Write every object of a dataset with all its views.

    Raises
    ------
    InputError
        A camera without a focal length, pictures of an odd size, or another number of bands than
        one or three.
    """
    done, names = 0, view_names(dataset)
    replace_text(folder / NAMES, json.dumps(names, indent=1) + "\n")
    for name, scenes in objects_of(dataset).items():
        cameras = [dataset.scene(scene_id).scene.camera for scene_id in scenes]
        poses = np.stack([pose(camera, _scale(cameras)) for camera in cameras])
        for scene_id in scenes:
            progress(done, len(dataset), scene_id)
            _write_view(folder / name, names[scene_id].partition("/")[2], dataset, scene_id)
            done += 1
        write_whole(folder / name / "poses_bounds.npy", partial(np.save, arr=poses))


def _object_of(scene: Scene) -> str:
    """Name of what a scene shows, whatever its camera; refuses cameras that NeISF cannot have."""
    camera = scene.camera
    if camera.fov_deg is None or camera.resolution % 2:
        expected = "a perspective camera with an even number of pixels a side"
        found = f"{camera.projection}, {camera.resolution} pixels"
        hint = 'set projection = "perspective", fov_deg and distance; views go around the object'
        raise InputError(f"scene {scene.id}", expected, found, hint)
    return content_id(scene.model_dump(mode="json", exclude={"camera"}))


def _scale(cameras: list[Camera]) -> float:
    farthest = max(camera.distance or 0.0 for camera in cameras)
    return min(1.0, LARGEST_DISTANCE / farthest)


def pose(camera: Camera, scale: float = 1.0) -> Float64Array:
    """The row (17,) of a camera in `poses_bounds.npy`; `scale` is that of the world.

    Examples
    --------
    >>> camera = Camera(projection="perspective", fov_deg=90, distance=3, resolution=64)
    >>> pose(camera).reshape(-1)[:15].reshape(3, 5).tolist()
    [[0.0, 1.0, 0.0, 0.0, 64.0], [-1.0, 0.0, 0.0, 0.0, 64.0], [0.0, 0.0, 1.0, 3.0, 32.0]]
    """
    rotation, offset = camera.extrinsics()[:, :3], camera.extrinsics()[:, 3]
    right, down, forward = rotation
    position = -rotation.T @ offset * scale
    focal = camera.intrinsics()[0, 0]
    size = np.array([camera.resolution, camera.resolution, focal])
    rows = np.column_stack([down, right, -forward, position, size])
    # NumPy's focal lengths are those of a tangent: 32.000000000000004 at 90 degrees.
    return np.concatenate([rows.ravel().round(12), [0.0, 0.0]]) + 0.0


def _write_view(folder: Path, name: str, dataset: Dataset, scene_id: str) -> None:
    truth = dataset.truth(scene_id)
    stokes = np.broadcast_to(colours(truth), (*truth.mask.shape, 3, 3))
    for k in range(3):
        path = folder / f"images_s{k}" / f"{name}.exr"
        planes = {channel: stokes[:, :, c, k] for c, channel in enumerate("RGB")}
        floats = {channel: plane.astype(np.float32) for channel, plane in planes.items()}
        write_whole(path, partial(write_exr, channels=floats))
    mask = np.repeat(truth.mask[..., None], 3, axis=2).astype(np.uint16) * np.uint16(65535)
    save_png(folder / "masks" / f"{name}.png", mask)
