"""Compiled loops start where nothing can be cached, and beside Mitsuba's own compiler."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from malus.reconstruct import kernels

NUMBA = "from malus.reconstruct import specular_dolp; print(float(specular_dolp(0.9, 1.5, 20.0)))"
MITSUBA = (
    "import malus.scenes as s; from malus.renderers import render; "
    "scene = s.Scene(shape=s.Sphere(), light=s.Distant(incidence_deg=60), "
    "surface=s.Dielectric(eta=1.5, alpha=0.3, body='unpolarised'), camera=s.Camera(resolution=8)); "
    "print(float(render(scene).image.max()))"
)


def test_a_folder_that_cannot_be_written_costs_the_cache_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As in a container whose packages and home belong to somebody else."""
    plain = numba.njit

    def refusing(*arguments: object, cache: bool = False, **options: object) -> object:
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return plain(*arguments, **options)

    monkeypatch.setattr(numba, "njit", refusing)
    add = kernels.compiled(kernels.add_polarised.py_func)  # type: ignore[attr-defined]
    s1, s2 = np.zeros((2, 1, 1))
    add(np.full((1, 1), 2.0), np.array([[[0.25, 0.5]]]), s1, s2)
    assert (s1.item(), s2.item()) == (0.5, 1.0)


@pytest.mark.parametrize("order", [(NUMBA, MITSUBA), (MITSUBA, NUMBA)])
def test_two_compilers_in_one_process(order: tuple[str, str]) -> None:
    """numba brings its LLVM, Dr.Jit loads the system's; whichever comes first, both work."""
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(order)],
        capture_output=True,
        text=True,
        env=os.environ,
        cwd=Path(__file__).parent,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    values = [float(line) for line in done.stdout.split()]
    assert len(values) == 2
    assert all(value > 0.1 for value in values)
