"""Families of objects with several surfaces: the truth is the sum of those of each surface.

Every surface is rendered with the same rays, and only the samples that fall on it are shaded. Light
from one reflection is a sum over samples, so that truths of surfaces can be added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from malus.renderers.families.interpolated import Family, with_pooled_error
from malus.renderers.family_key import FamilyKey
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import AnyArray, Float32Array
from malus.scenes.materials.surface import Patterned
from malus.scenes.scene import Scene


def with_part(scene: Scene, index: int) -> Scene:
    """The scene with one of its surfaces on the whole object."""
    assert isinstance(scene.surface, Patterned)
    return scene.model_copy(update={"surface": scene.surface.surfaces[index]})


@dataclass(frozen=True)
class PatternedFamily:
    """A family for each surface, shaded only where the pattern has that surface.

    Attributes
    ----------
    families : Families, one a surface
    shares : (height, width, surfaces)
        Share of each surface in the area of a pixel.
    samples : int
        Samples a pixel, of which each fell on one surface.
    """

    key: FamilyKey
    families: tuple[Family, ...]
    shares: Float32Array
    samples: int

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        """The truth of one scene; `eta` and `alpha` are means over each pixel.

        Raises
        ------
        ValueError
            If the scene belongs to another family.
        """
        if FamilyKey.of(scene) != self.key:
            raise ValueError(f"scene {scene.id}: expected a scene of this family")
        parts = [
            family.unpooled_truth(with_part(scene, index), standard_error)
            for index, family in enumerate(self.families)
        ]
        eta = np.stack([part.eta for part in parts])
        alpha = np.array([part.alpha for part in parts])
        truth = replace(
            parts[0],
            scene=scene,
            specular=_sum([part.specular for part in parts]),
            diffuse=_sum([part.diffuse for part in parts]),
            specular_noise=_sum([part.specular_noise for part in parts]),
            diffuse_noise=_sum([part.diffuse_noise for part in parts]),
            standard_error=self._error(parts) if standard_error else parts[0].standard_error,
            interpolation_error={
                name: max(part.interpolation_error[name] for part in parts)
                for name in parts[0].interpolation_error
            },
            eta_map=self.shares @ eta,
            alpha_map=self.shares @ alpha,
        )
        return with_pooled_error(truth, self.samples) if standard_error else truth

    def _error(self, parts: list[Truth]) -> AnyArray:
        """Standard error: a sample is on one surface, so two have covariance -mean times mean."""
        means = [part.stokes for part in parts]
        crossed = _sum(means) ** 2 - _sum([mean**2 for mean in means])
        variance = _sum([part.standard_error**2 for part in parts]) - crossed / (self.samples - 1)
        # Rounding can leave a tiny negative variance where all samples are equal.
        return np.sqrt(np.maximum(variance, 0))


def _sum(images: list[AnyArray]) -> AnyArray:
    return np.sum(images, axis=0, dtype=images[0].dtype)
