"""How a search for a shape ended, and warnings: a wrong shape can look as good as a right one."""

from __future__ import annotations

import math
from typing import NamedTuple

EXPLAINED = 0.008
"""Residual below which a picture counts as explained: 2 of 255 grey levels."""
UNDECIDED = 1.03
"""Ratio of the costs of both kinds of body below which the picture does not decide between them.
Measured on grey blobs, cost with the true kind over cost with the other: 1.003 to 1.016 for
unpolarised bodies, which were taken for polarised; 1.004 to 1.036 for polarised ones lit at 20°."""

STATED = 0.021, 4.9
"""Standard deviation of s1/s0 and of s2/s0 where the picture is explained exactly, and what a
residual of 1 would add to it (root of the sum of squares). Most likely values for the errors of
`blind` on 34 renders of 40 x 40 pixels under lamps, near and wide, and skies."""


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

    @property
    def deviation(self) -> float:
        """Standard deviation of s1/s0, and of s2/s0, to expect: the same for the whole picture.

        Examples
        --------
        >>> [round(Convergence(True, residual, 2, 2).deviation, 3) for residual in (0.001, 0.02)]
        [0.022, 0.1]
        """
        exact, slope = STATED
        return math.hypot(exact, slope * self.residual)

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
