"""Methods of other people: by name of an object, and by entry point."""

from __future__ import annotations

import importlib.metadata
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pictures import dome

from malus.bench.running.family_task import FamilyResult
from malus.bench.running.parts import Failure
from malus.bench.scoring.score import score
from malus.reconstruct import Components, Method, Observation, get_method, methods
from malus.reconstruct.methods import _installed, _methods, guarded
from malus.reconstruct.photos.estimate import estimate
from malus.reconstruct.photos.knowledge import Knowledge
from malus.renderers import render
from malus.scenes import Camera, Dielectric, Distant, InputError, Scene, Sphere

TEXT = """
from malus.reconstruct import Components, Method

def all_vertical(observation):
    image = observation.image
    return Components(image, -0.1 * image, 0 * image)

mine = Method("mine", frozenset({"normals"}), all_vertical, "a tenth, vertical")
nothing = 3
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "my_methods.py").write_text(TEXT, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_an_object_in_the_working_folder(module: Path) -> None:
    method = get_method("my_methods:mine")
    surface = Dielectric(eta=1.5, alpha=0.3, body="unpolarised")
    scene = Scene(
        shape=Sphere(),
        surface=surface,
        light=Distant(incidence_deg=60),
        camera=Camera(resolution=16),
    )
    assert score(render(scene, renderer="torrance-sparrow"), method).skill < 0


@pytest.mark.parametrize(
    "name", ["my_methods:absent", "my_methods:nothing", "no_such_module:x", "os:system", ":"]
)
def test_what_is_no_method_is_said_in_one_line(module: Path, name: str) -> None:
    with pytest.raises(InputError) as mistake:
        get_method(name)
    assert "\n" not in str(mistake.value)


FAILING = """
from malus.reconstruct import Method

def gain_of(table, name):
    return table[name]

def estimate(observation):
    table = {}
    return gain_of(table, "red")

def divide(observation):
    import fractions
    return fractions.Fraction(1, 0)

late = Method("late", frozenset(), estimate, "looks up what is not there")
library = Method("library", frozenset(), divide, "fails in another module")
short = Method("short", frozenset(), lambda: None, "takes no observation")
"""


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("late", "KeyError (failing_methods.py, line 5): 'red'"),
        ("library", "ZeroDivisionError (failing_methods.py, line 13): Fraction(1, 0)"),
        # It never came to a line of its own.
        ("short", "TypeError: <lambda>() takes 0 positional arguments but 1 was given"),
    ],
)
def test_a_failure_tells_the_line_of_ones_own_file(module: Path, name: str, reason: str) -> None:
    (module / "failing_methods.py").write_text(FAILING, "utf-8")
    one = guarded(get_method(f"failing_methods:{name}"))  # as `score` does once more
    with pytest.raises((KeyError, ZeroDivisionError, TypeError)) as caught:
        one.reconstruct(Observation(np.ones((2, 2, 1)), np.ones((2, 2), bool)))
    assert Failure.of(caught.value, method=name).reason == reason
    # An error from another process keeps it.
    assert Failure.of(pickle.loads(pickle.dumps(caught.value))).reason == reason


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 / 0", r"ZeroDivisionError \(broken_methods.py, line 1\): division by zero"),
        ("\nabsent", r"NameError \(broken_methods.py, line 2\): name 'absent' is not defined"),
        ("import sys\nsys.exit(3)", r"SystemExit \(broken_methods.py, line 2\): 3"),
        ("def f(:", r"invalid syntax \(broken_methods.py, line 1\)"),
        ("import absent_module", "No module named 'absent_module'"),
    ],
)
def test_a_module_that_cannot_be_imported_says_where(
    module: Path, monkeypatch: pytest.MonkeyPatch, text: str, words: str
) -> None:
    (module / "broken_methods.py").write_text(text + "\n", "utf-8")
    monkeypatch.delitem(sys.modules, "broken_methods", raising=False)
    with pytest.raises(InputError, match=words) as caught:
        get_method("broken_methods:mine")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("stopped", [129, 143])
def test_a_method_that_ends_the_program_fails_alone(module: Path, stopped: int) -> None:
    text = FAILING + "\n\ndef leave(observation):\n    raise SystemExit(4)\n"
    text += "mine = Method('mine', frozenset(), leave, 'ends the program')\n"
    (module / "leaving_methods.py").write_text(text, "utf-8")
    seen = Observation(np.ones((2, 2, 1)), np.ones((2, 2), bool))
    result = FamilyResult()
    method = get_method("leaving_methods:mine")
    with result.guard(method=method):
        method.reconstruct(seen)
    line = text.splitlines().index("    raise SystemExit(4)") + 1
    (failure,) = result.failures
    assert failure.method == "mine"
    assert f"(leaving_methods.py, line {line}): SystemExit, with 4" in failure.reason
    # The stop of the whole run passes: `malus run` leaves so where it is terminated.
    text = text.replace("Exit(4)", f"Exit({stopped})")
    (module / f"stopped_by_{stopped}.py").write_text(text, "utf-8")
    with pytest.raises(SystemExit):
        get_method(f"stopped_by_{stopped}:mine").reconstruct(seen)


def test_masked_values_are_no_numbers() -> None:
    """A masked array scored like any other would have the numbers that it hides."""
    image, mask = np.ones((2, 3, 1)), np.ones((2, 3), bool)
    mask[0, 0] = False

    def masked(*hidden: tuple[int, int]) -> Method:
        s1 = np.ma.array(np.full_like(image, 0.25))
        for row, column in hidden:
            s1[row, column] = np.ma.masked
        own = Components(image, s1, 0 * image)
        return guarded(Method("masked", frozenset(), lambda seen: own, "masks some"))

    seen = Observation(image, mask)
    off_the_object = masked((0, 0)).reconstruct(seen).s1
    assert type(off_the_object) is np.ndarray
    assert (off_the_object[mask] == 0.25).all()
    with pytest.raises(InputError, match=r"method masked: expected values of s1 .* 2 masked"):
        masked((0, 0), (0, 1), (1, 2)).reconstruct(seen)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"deviation": np.full((2, 2, 1), -0.1)}, "a deviation of 0 or more"),
        ({"converged": "yes"}, "True, False or None, found 'yes'"),
        ({"converged": np.ones((2, 2), bool)}, "True, False or None"),
    ],
)
def test_what_a_method_says_of_itself_is_checked(more: dict[str, Any], words: str) -> None:
    def sure(seen: Observation) -> Components:
        return Components(seen.image, 0 * seen.image, 0 * seen.image, **more)

    method = guarded(Method("sure", frozenset(), sure, "says how sure it is"))
    with pytest.raises(InputError, match=words):
        method.reconstruct(Observation(np.ones((2, 2, 1)), np.ones((2, 2), bool)))


def test_entry_points_are_methods(module: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [
        importlib.metadata.EntryPoint(name, "my_methods:mine", "malus.methods")
        for name in ("theirs", "visible")
    ]
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: entries)
    for kept in (_methods, _installed):
        kept.cache_clear()
    try:
        assert get_method("theirs").summary == "a tenth, vertical"
        assert get_method("visible").summary == "a tenth, vertical"  # in place of malus's own
        assert "eq8" in methods()
    finally:
        for kept in (_methods, _installed):
            kept.cache_clear()


def test_what_is_done_to_the_list_of_methods_costs_nobody_a_method() -> None:
    methods().clear()
    assert get_method("blind").name == "blind"
    assert {"eq8", "blind", "net"} <= methods().keys()


def test_a_method_is_a_small_declaration() -> None:
    def guess(observation: Observation) -> Components:
        return Components(observation.image, 0 * observation.image, 0 * observation.image)

    assert Method("guess", frozenset(), guess, "nothing").name == "guess"


FILTERS = """
import numpy as np
from malus.reconstruct import Components, Method

def nowhere(observation):
    image = observation.image
    return Components(image, np.full_like(image, np.nan), 0 * image)

def too_much(observation):
    return Components(observation.image, 3 * observation.image, 0 * observation.image)

def fails(observation):
    raise KeyError("weights")

def one_band(observation):
    image = observation.image[..., :1]
    return Components(image, 0 * image, 0 * image)

nowhere, too_much, fails, one_band = (
    Method(function.__name__, frozenset(), function, "wrong")
    for function in (nowhere, too_much, fails, one_band)
)
"""


@pytest.fixture
def filters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "my_filters.py").write_text(FILTERS, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "words"),
    [("nowhere", "no finite estimate: not polarised"), ("too_much", "more than fully polarised")],
)
def test_a_filter_tells_of_what_is_no_light(filters: Path, name: str, words: str) -> None:
    image = np.full((6, 6, 3), 0.5, np.float32)
    mask = np.zeros((6, 6), bool)
    mask[1:4, 1:4] = True
    found = estimate(image, Knowledge(mask=mask, method=f"my_filters:{name}"), "picture")
    assert any("9 pixels of the object" in told and words in told for told in found.warnings)
    assert np.isfinite(found.components.s1).all()
    assert not found.components.s1[~mask].any()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("fails", "method fails: .*KeyError .*line 13.: 'weights'"),
        ("one_band", "expected image of shape"),
    ],
)
def test_a_method_that_fails_in_a_filter_ends_in_one_line(
    filters: Path, name: str, words: str
) -> None:
    with pytest.raises(InputError, match=words) as mistake:
        estimate(np.ones((6, 6, 3), np.float32), Knowledge(method=f"my_filters:{name}"), "picture")
    assert "\n" not in str(mistake.value)


def test_off_the_object_surrounding_light_polarises_nothing() -> None:
    """The rest of the picture is no diffuse light of the object."""
    image, normals = dome()
    mask = normals[..., 2] > 0.6
    everywhere = np.where(normals[..., 2:] > 0, normals, [0.0, 0.6, 0.8]).astype(np.float32)
    found = estimate(image + 0.1, Knowledge(mask=mask, normals=everywhere), "picture")
    assert found.components.s1[mask].any()
    for values in (found.components.s1, found.components.s2):
        assert not values[~mask].any()
