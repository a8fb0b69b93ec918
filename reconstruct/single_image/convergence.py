"""How a search for a shape ended, and warnings: a wrong shape can look as good as a right one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from malus.scenes.core.arrays import FloatArray

EXPLAINED = 0.008
"""Residual below which a picture counts as explained: 2 of 255 grey levels."""
UNDECIDED = 1.03
"""Ratio of the costs of both kinds of body below which the picture does not decide between them.
Measured on grey blobs, cost with the true kind over cost with the other: 1.003 to 1.016 for
unpolarised bodies, which were taken for polarised; 1.004 to 1.036 for polarised ones lit at 20°."""

STATED = 0.022, 2.2, 0.63
"""Standard deviation of s1/s0 and of s2/s0 where the picture is explained exactly and nothing is
polarised; what a residual of 1 adds, and what a degree of polarisation of 1 adds (roots of sums of
squares). Most likely values for the errors of `blind` on 61 renders of 40 x 40 pixels under lamps,
near and wide, and skies. Values from 34 of them, whose errors they rank by a correlation of 0.56,
rank those of the others, of other shapes, surfaces and lights, by 0.96; there the mean squared
error is 1.29 times what they state."""


class Convergence(NamedTuple):
    """How a search from several starts ended.

    Attributes
    ----------
    at_minimum : bool
        The optimiser stopped because nothing improved, not because it ran out of steps.
    residual : float
        Root mean square of what the shape leaves unexplained, over the picture's largest value.
    agreed, starts : int
        How many starts of the search ended at this minimum, and how many there were for this kind
        of body.
    rival : float
        Cost of the best shape with the other kind of body over the cost of this one; infinite
        where only one kind was searched, below 1 where an unpolarised body was preferred.
    """

    at_minimum: bool
    residual: float
    agreed: int
    starts: int
    rival: float = math.inf

    @property
    def converged(self) -> bool:
        """True if a minimum was found and it explains the picture.

        Examples
        --------
        >>> Convergence(True, 0.004, 2, 2).converged, Convergence(True, 0.05, 2, 2).converged
        (True, False)
        """
        return self.at_minimum and self.residual < EXPLAINED

    def deviation(self, dolp: FloatArray) -> FloatArray:
        """Standard deviation of s1/s0, and of s2/s0, to expect at an estimated DoLP (any shape).

        Examples
        --------
        >>> Convergence(True, 0.02, 2, 2).deviation(np.array([0.0, 0.5])).round(3).tolist()
        [0.049, 0.319]
        """
        exact, of_residual, of_dolp = STATED
        return np.sqrt(exact**2 + (of_residual * self.residual) ** 2 + (of_dolp * dolp) ** 2)

    @property
    def decided(self) -> bool:
        """True if the chosen kind of body explains the picture clearly better than the other.

        Where neither does, the unpolarised body is chosen, because it is the safer one.

        Examples
        --------
        >>> [Convergence(True, 0.004, 2, 2, rival).decided for rival in (1.3, 1.01, 0.98)]
        [True, False, False]
        """
        return self.rival >= UNDECIDED

    @property
    def statement(self) -> str:
        """How the search ended, in words.

        Examples
        --------
        >>> Convergence(True, 0.004, 1, 2).statement
        'the shape leaves 0.4% of the largest value unexplained; 1 of 2 starts ended there'
        """
        steps = "" if self.at_minimum else "the search for a shape ran out of steps; "
        return (
            f"{steps}the shape leaves {self.residual:.1%} of the largest value unexplained; "
            f"{self.agreed} of {self.starts} starts ended there"
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the shape, in words; empty where there are none.

        Examples
        --------
        >>> Convergence(True, 0.004, 2, 2).warnings
        ()
        """
        warnings = []
        if not self.converged:
            warnings.append(f"the search for a shape did not converge: {self.statement}")
        elif self.agreed < self.starts:
            warnings.append(
                f"the shape is one of several that explain the picture: {self.statement}; "
                "roughness and normals are uncertain"
            )
        if not self.decided:
            warnings.append(
                "the body is undecided and taken for unpolarised: a polarised one explains the "
                f"picture as well (at {self.rival:.0%} of the cost); given normals would decide "
                "it, material and roughness would not"
            )
        return tuple(warnings)
