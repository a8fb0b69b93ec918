"""The public names of malus.reconstruct: imported late, documented, and reached by name."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys

import numpy as np
import pytest

import malus
import malus.reconstruct as public
from malus.scenes import InputError

IMAGE = np.full((16, 16, 2), [3.0, 1.0])
MASK = np.ones((16, 16), bool)


def test_an_import_brings_neither_scipy_nor_numba() -> None:
    script = (
        "import sys, malus.reconstruct;"
        "print([name for name in ('scipy', 'numba', 'skimage') if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", public.__all__)
def test_every_name_has_a_docstring_with_an_example(name: str) -> None:
    assert ">>>" in (inspect.getdoc(getattr(public, name)) or "")
    assert name in dir(public)


def test_a_module_of_a_public_name_does_not_hide_it() -> None:
    """`methods` is both a function and a module: the function is what the package gives."""
    import malus.reconstruct.methods

    assert callable(malus.reconstruct.methods)
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = public.no_such_name  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", public.separations())
def test_a_picture_without_highlights_is_diffuse(name: str) -> None:
    parts = public.separate(IMAGE, MASK, method=name)
    # One colour, whose histogram of chromaticity has bins 1/200 of [1/2, 1] wide.
    np.testing.assert_allclose(parts.diffuse, IMAGE, rtol=0.02)


@pytest.mark.parametrize("name", public.illuminants())
def test_an_illuminant_is_estimated_by_name(name: str) -> None:
    ramp = np.linspace(0, 3, 64).reshape(8, 8, 1) * [1.2, 0.8]
    image = np.tile(ramp + [0.3, 0.9], (2, 2, 1))
    illuminant = public.estimate_illuminant(image, MASK, name)
    assert illuminant.colour.mean() == pytest.approx(1.0)
    colour = public.illuminants()[name](image, MASK).colour
    np.testing.assert_array_equal(illuminant.colour, colour)


def test_unknown_names_are_told() -> None:
    with pytest.raises(InputError, match="found 'nothing'; known: chromaticity, suv, ratio"):
        public.separate(IMAGE, MASK, method="nothing")
    with pytest.raises(InputError, match="found 'nothing'; known: neutral"):
        public.estimate_illuminant(IMAGE, method="nothing")


@pytest.mark.parametrize("package", ["scenes", "renderers", "reconstruct", "bench", "reports"])
def test_a_name_of_malus_is_the_same_in_its_packages(package: str) -> None:
    module = importlib.import_module(f"malus.{package}")
    shared = set(module.__all__) & set(malus.__all__)
    # `malus.bench.run` takes a Suite and writes no report, as it says.
    differ = {name for name in shared if getattr(module, name) is not getattr(malus, name)}
    assert differ == ({"run"} if package == "bench" else set())
