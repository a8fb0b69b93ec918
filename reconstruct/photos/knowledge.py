"""What is given besides a photograph, checked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from malus.reconstruct.methods import get_method
from malus.reconstruct.observation import as_mask
from malus.reconstruct.photos.by_network import check_side
from malus.reconstruct.photos.masks_and_normals import read_labels, read_mask, read_normals
from malus.reconstruct.single_image.illuminant import ILLUMINANTS
from malus.reconstruct.single_image.separation import check_separation
from malus.scenes.core.arrays import BoolArray, Float32Array, IntArray
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.errors import InputError
from malus.scenes.core.registry import lookup
from malus.scenes.materials.materials import material


class Preset(NamedTuple):
    """Index, roughness, and whether all light is specular, as from water and window panes."""

    eta: float
    alpha: float
    mirror: bool


PRESETS = {
    "water": Preset(1.333, 0.05, True),
    "glass": Preset(1.52, 0.02, True),
    "foliage": Preset(1.45, 0.3, False),
    "skin": Preset(1.40, 0.35, False),
    "plastic": Preset(1.50, 0.2, False),
}
"""Indices of Jacquemoud and Baret (1990) for leaves and Tearney et al. (1995) for skin; the
roughnesses are middling values of such surfaces, not measurements of one."""


@dataclass(frozen=True)
class Knowledge:
    """What is given besides the picture; None is estimated or assumed.

    Attributes
    ----------
    normals : (height, width, 3) float32, zero where there is none
    mask : (height, width) bool
    light : (x, y, z) towards a distant light, in the image frame
    eta, alpha : refractive index and Beckmann roughness
    mirror : all light is specular
    illuminant : name of an estimator of the light's colour; None is the method's own: Gray World of
        the paper's methods, 'neutral' of all others
    separation : name of the method that tells the lobes apart by colour; None is the method's own:
        'chromaticity' of `paper`, 'suv' of `paper-mallick`, 'ratio' of all others
    labels : (height, width) whole numbers, 0 off all objects; each is estimated on its own
    method : name of a method, or `package.module:object`; None chooses by what is given
    net_size : longer side of the picture that the network sees, in pixels; None is its own

    Examples
    --------
    >>> Knowledge(labels=np.array([[0, 1, 2]])).mask.tolist()
    [[False, True, True]]
    """

    __repr__ = brief_repr

    normals: Float32Array | None = None
    mask: BoolArray | None = None
    light: tuple[float, float, float] | None = None
    eta: float | None = None
    alpha: float | None = None
    mirror: bool = False
    illuminant: str | None = None
    separation: str | None = None
    labels: IntArray | None = None
    method: str | None = None
    net_size: int | None = None

    def __post_init__(self) -> None:
        """Refuse unknown names and values that are none.

        Objects with labels are the mask, or what it leaves of them.
        """
        _check_values(self.light, self.eta, self.alpha)
        if self.mask is not None:
            object.__setattr__(self, "mask", as_mask(self.mask))
        if self.labels is not None:
            labels = np.asarray(self.labels)
            if labels.dtype.kind not in "iub" or labels.ndim != 2:
                found = f"{labels.dtype} of {labels.ndim} dimensions"
                raise InputError("labels", "whole numbers (height, width)", found, "convert them")
            object.__setattr__(self, "labels", labels)
            labelled = np.asarray(labels != 0)
            mask = labelled if self.mask is None else labelled & self.mask
            object.__setattr__(self, "mask", mask)
        if self.method is not None:
            get_method(self.method)
        check_side(self.net_size, self.method, self.is_nothing)
        if self.illuminant is not None:
            lookup(self.illuminant, ILLUMINANTS, "illuminant", "the name of an estimator")
        if self.separation is not None:
            check_separation(self.separation, "separation")

    @property
    def is_nothing(self) -> bool:
        """True where only the picture, and maybe the light's colour, is known and no method named.

        Examples
        --------
        >>> Knowledge().is_nothing, Knowledge(light=(0.0, 0.0, 1.0)).is_nothing
        (True, False)
        """
        return not (self.physical or self.method is not None or self.mask is not None)

    @property
    def physical(self) -> tuple[str, ...]:
        """What is known of shape, light and surface, which a network has no use for."""
        told = [name for name in _PHYSICAL if getattr(self, name) is not None]
        return (*told, "preset") if self.mirror else tuple(told)


_PHYSICAL = ("normals", "light", "eta", "alpha", "separation")


def read_knowledge(
    shape: tuple[int, int],
    normals: Path | str | None = None,
    mask: Path | str | None = None,
    light: tuple[float, float, float] | None = None,
    material_name: str | None = None,
    alpha: float | None = None,
    preset: str | None = None,
    illuminant: str | None = None,
    separation: str | None = None,
    labels: Path | str | None = None,
    method: str | None = None,
    net_size: int | None = None,
) -> Knowledge:
    """Read and check what is given besides a picture of `shape` (height, width).

    Parameters
    ----------
    shape : (height, width) of the picture
    normals, mask : path, optional
        Files of the picture's size, see `malus filter --help`.
    light : (x, y, z), optional
        Towards a distant light: right, up, to the viewer.
    material_name : str, optional
        A material of `list_materials`, for its refractive index.
    alpha : float, optional
        Beckmann roughness, in (0, 1].
    preset : str, optional
        A name of `PRESETS`, for index, roughness, and whether all light is mirrored.
    illuminant, separation : str, optional
        Names of the estimator of the light's colour and of the separation of the lobes.
    labels : path, optional
        A picture of the same size, black off all objects: every other value is an object.
    method : str, optional
        Name of a method, or `package.module:object`.
    net_size : int, optional
        Longer side of the picture that the network sees, in pixels.

    Returns
    -------
    Knowledge
        What was given, read and checked.

    Raises
    ------
    InputError
        Files of another size, a light of no direction, unknown names, alpha outside (0, 1], a
        mirror without normals or with a light.

    Examples
    --------
    >>> read_knowledge((48, 64), light=(1.0, 1.0, 2.0), material_name="pmma").eta is not None
    True
    """
    typical = None if preset is None else lookup(preset, PRESETS, "preset")
    if typical is not None and typical.mirror and (normals is None or light is not None):
        raise InputError(
            "preset",
            f"`normals` and no `light` for {preset}, as a mirror shows what is around it",
            "no `normals`" if normals is None else "`light`",
            "a mirror's shading tells neither shape nor light",
        )
    _check_values(light, None, alpha)
    eta = material(material_name).eta_d if material_name else typical.eta if typical else None
    return Knowledge(
        read_normals(normals, shape) if normals else None,
        read_mask(mask, shape) if mask else None,
        light,
        eta,
        alpha if alpha is not None else typical.alpha if typical else None,
        bool(typical and typical.mirror),
        illuminant,
        separation,
        read_labels(labels, shape) if labels else None,
        method,
        net_size,
    )


def _check_values(
    light: tuple[float, float, float] | None, eta: float | None, alpha: float | None
) -> None:
    """Refuse a light of no direction, and an index or a roughness that no surface has."""
    hint = "correct this value"
    if eta is not None and not (_is_number(eta) and 1 < eta < np.inf):
        raise InputError("eta", "a refractive index above 1", f"{eta}", hint)
    if alpha is not None and not (_is_number(alpha) and 0 < alpha <= 1):
        raise InputError("alpha", "a roughness in (0, 1]", f"{alpha}", hint)
    if light is None:
        return
    vector = np.asarray(light)
    fits = vector.shape == (3,) and vector.dtype.kind in "iuf"
    if not (fits and 1e-6 < float(np.linalg.norm(vector)) < np.inf):
        raise InputError("light", "a direction X,Y,Z that is not zero", f"{light}", hint)


def _is_number(value: object) -> bool:
    return np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"  # type: ignore[arg-type]
