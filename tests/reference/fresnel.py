"""Textbook Fresnel reflectances in mpmath, cancellations and all: the digits are simply many."""

from __future__ import annotations

from mpmath import mp, mpf

DIGITS = 60  # η = 1 ± 1e-12 costs 24 digits in F, twice that near Brewster's angle


def reflectances(incidence: mpf, eta: complex) -> tuple[mpf, mpf]:
    """(F_⊥, F_∥) at angle `incidence` (radians, an mpf) for index n + ik."""
    with mp.workdps(DIGITS):
        index = mp.mpc(complex(eta))
        cosine = mp.cos(incidence)
        inside = mp.sqrt(1 - (mp.sin(incidence) / index) ** 2)  # Snell; imaginary past critical
        perpendicular = (cosine - index * inside) / (cosine + index * inside)
        parallel = (index * cosine - inside) / (index * cosine + inside)
        return abs(perpendicular) ** 2, abs(parallel) ** 2
