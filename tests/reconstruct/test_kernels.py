"""Compiled loops start where nothing can be cached, and beside Mitsuba's own compiler."""

from __future__ import annotations

import errno
import importlib
import os
import subprocess
import sys
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba.core.caching import CacheImpl

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
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    add = kernels.compiled(kernels.add_polarised.py_func)  # type: ignore[attr-defined]
    s1, s2 = np.zeros((2, 1, 1))
    add(np.full((1, 1), 2.0), np.array([[[0.25, 0.5]]]), s1, s2)
    assert (s1.item(), s2.item()) == (0.5, 1.0)


@pytest.mark.parametrize(
    ("normal", "valid"),
    [
        ((0.0, 0.6, 0.8), True),
        ((0.0, 0.60024, 0.80032), True),
        ((0.0, 0.606, 0.808), False),
        ((0.0, 0.594, 0.792), False),
        ((0.6, 0.8, -5e-7), True),
        ((0.6, 0.8, -1e-5), False),
        ((np.nan, 0.6, 0.8), False),
    ],
)
def test_normals_have_length_one_and_face_the_viewer(
    normal: tuple[float, float, float], valid: bool
) -> None:
    """To 5e-4, and to 1e-6 behind a limb: as much as single precision and averages may do."""
    light, found = np.ones((1, 1)), np.zeros(1, bool)
    kernels.mark_valid_pixels(light, light, np.array([normal]), 1e30, found)
    assert found.item() == valid


CALLER = """
from callee import FACTOR, scaled
from malus.reconstruct.kernels import compiled

@compiled
def total(values):
    return FACTOR * scaled(values[0])
"""
CALLEE = """
from malus.reconstruct.kernels import compiled

FACTOR = {factor}

@compiled
def scaled(value):
    return {expression}
"""


def test_machine_code_follows_what_a_loop_takes_from_other_modules(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numba looks at the file of the loop alone: after an upgrade it would compute old numbers."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "caller.py").write_text(CALLER)
    cached = []

    def total(factor: float, expression: str) -> float:
        source = CALLEE.format(factor=factor, expression=expression)
        (tmp_path / "callee.py").write_text(source)
        importlib.invalidate_caches()
        for name in ("caller", "callee"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        kernels._file_digest.cache_clear()  # files do not change while a process runs
        loop = importlib.import_module("caller").total
        value = float(loop(np.array([3.0])))
        cached.append(sum(loop.stats.cache_hits.values()))
        return value

    assert total(2.0, "value + 1") == 8.0
    assert total(2.0, "value + 1") == 8.0
    assert total(2.0, "value + 5") == 16.0
    assert total(4.0, "value + 5") == 32.0
    assert cached == [0, 1, 0, 0]


LOOP = """
from malus.reconstruct.kernels import compiled

@compiled
def doubled(values):
    return 2 * values[0]
"""


@pytest.fixture
def begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Any]:
    """Gives the same loop as often as it is called, each time as a new process has it."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "kept_loop.py").write_text(LOOP)
    importlib.invalidate_caches()

    def begin() -> Any:
        monkeypatch.delitem(sys.modules, "kept_loop", raising=False)
        return importlib.import_module("kept_loop").doubled

    return begin


def hits(loop: Any) -> int:
    return sum(loop.stats.cache_hits.values())


def test_a_full_disk_costs_the_cache_only(
    begun: Callable[[], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the user's home, where there is room for the results: the run ended, and named neither."""

    def no_room(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile._open_for_write", no_room)
    assert begun()(np.array([3.0])) == 6.0


@pytest.mark.parametrize("ending", [".nbi", ".nbc"])
def test_a_file_that_a_power_cut_left_empty_is_made_again(
    begun: Callable[[], Any], ending: str
) -> None:
    """Every run ended in a traceback, until somebody removed it."""
    values = np.array([3.0])
    loop = begun()
    loop(values)
    (path,) = Path(loop._cache._cache_file._cache_path).glob(f"kept_loop.*{ending}")
    path.write_bytes(b"")
    found = [(loop(values), hits(loop)) for loop in (begun(), begun())]
    assert found == [(6.0, 0), (6.0, 1)]


def test_machine_code_of_other_types_is_not_run(begun: Callable[[], Any]) -> None:
    """Two processes that compile at once may give theirs one name, and the last one's is there."""
    single, double = (np.array([3.0], dtype) for dtype in (np.float32, np.float64))
    loop = begun()
    assert (loop(single), loop(double)) == (6.0, 6.0)
    files = sorted(Path(loop._cache._cache_file._cache_path).glob("kept_loop.*.nbc"))
    one, other = (path.read_bytes() for path in files)
    files[0].write_bytes(other)
    files[1].write_bytes(one)
    loop = begun()
    assert (loop(double), loop(single), hits(loop)) == (6.0, 6.0, 0)


def test_machine_code_follows_the_fields_of_an_argument() -> None:
    """Fields are found by their place: in another order they are other numbers."""
    loop = kernels.compiled(kernels.add_polarised.py_func)  # type: ignore[attr-defined]
    codegen = loop.targetctx.codegen()

    def key(fields: str) -> object:
        signature = numba.typeof((namedtuple("Pair", fields)(1.0, 2.0), 3))
        return loop._cache._index_key(tuple(signature), codegen)[-1]

    assert key("x y") == key("x y") != key("y x")


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


PRODUCT = """
import sys
import numba, numpy as np
from malus.reconstruct import kernels
total = kernels.compiled(lambda values: np.sum(values))
assert total(np.ones(3)) == 3
print("scipy.linalg" in sys.modules)
one = np.array([[1.0, 2.0], [3.0, 4.0]])
print((numba.njit(lambda a: np.dot(a, a))(one) == one @ one).all())
"""


def test_loops_load_no_linear_algebra_and_products_of_matrices_work() -> None:
    """Numba looks for BLAS with its first loop, which loads all of `scipy.linalg`."""
    command = [sys.executable, "-c", PRODUCT]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
