"""The self-check passes on every variant that works here, and planted faults make it fail."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from malus.renderers import self_check, self_check_laws, self_check_scenes, variant
from malus.renderers.families import interpolated, nodes
from malus.renderers.mitsuba import bsdfs, lighting, path_traced, rays, shading, wavefront
from malus.renderers.mitsuba.kernel_warnings import KernelWarning, refused_warnings
from malus.renderers.self_check import self_check as checks
from malus.renderers.self_check_scenes import SCENES, SHORT
from malus.renderers.variant import Variant, choose
from malus.scenes import Scene
from malus.scenes.core.arrays import Float64Array


@pytest.fixture
def vectorised() -> Iterator[Variant]:
    best = choose()
    if not best.vectorised:
        pytest.skip("only the scalar variant runs here")
    # Recordings know nothing of what a test plants, and must not outlive it.
    wavefront.cached_stage.cache_clear()
    yield best
    wavefront.cached_stage.cache_clear()


def test_every_kind_agrees_with_what_is_stored(vectorised: Variant) -> None:
    done = list(checks(vectorised))
    assert {check.name for check in done} == set(SCENES) | set(self_check.LAWS)
    assert not [check for check in done if not check.passed]


def test_the_scalar_variant_agrees_where_it_renders() -> None:
    done = list(checks(choose("scalar"), short=True))
    assert {check.name for check in done} == SHORT - {"room"}
    assert not [check for check in done if not check.passed]


def failed(vectorised: Variant, *names: str) -> set[str]:
    """Which of some checks fail, with nothing kept from before."""
    return {check.name for check in checks(vectorised) if check.name in names and not check.passed}


def test_a_frame_turned_by_90_degrees_is_found(
    vectorised: Variant, monkeypatch: pytest.MonkeyPatch
) -> None:
    def turned(mi: Any, sensor: Any, ray: Any) -> Any:
        return -rays.to_camera_frame(mi, sensor, ray)

    monkeypatch.setattr(shading, "to_camera_frame", turned)
    assert failed(vectorised, "rolled camera", "malus") == {"rolled camera", "malus"}


def without_shadow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shading.CameraView, "shadow", lambda _, hit, *__: hit.t < 0)


def with_the_lamps_polariser_turned(monkeypatch: pytest.MonkeyPatch) -> None:
    angled = lighting._stokes

    def mirrored(*of_light: Any) -> list[Any]:
        s0, s1, s2 = angled(*of_light)
        return [s0, s1, -s2]

    monkeypatch.setattr(lighting, "_stokes", mirrored)


def with_roughness_across_for_along(monkeypatch: pytest.MonkeyPatch) -> None:
    update = bsdfs._update
    monkeypatch.setattr(
        bsdfs, "_update", lambda mi, pool, etas, ab: update(mi, pool, etas, ab[::-1])
    )


def with_one_seed_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (shading, wavefront):
        monkeypatch.setattr(module, "streams", lambda mi, n, seed: rays.streams(mi, n, 0 * seed))


def with_errors_too_small_by_the_root_of_two(monkeypatch: pytest.MonkeyPatch) -> None:
    stated = interpolated.Family._error
    monkeypatch.setattr(interpolated.Family, "_error", lambda *of: 0.5**0.5 * stated(*of))


def with_pixels_that_share_random_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every other row of pixels has the numbers of the one above."""

    def shared(mi: Any, number: Any, seed: Any) -> Any:
        return rays.streams(mi, number // 64 * 64 + number % 32, seed)

    for module in (shading, wavefront):
        monkeypatch.setattr(module, "streams", shared)


def with_bands_of_their_neighbours_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    weights = nodes.interpolation_weights
    monkeypatch.setattr(
        nodes, "interpolation_weights", lambda *of: np.roll(weights(*of), 1, axis=1)
    )


def with_half_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    draws = lighting._Distant.draws

    def rounded(*of: Any) -> Any:
        ((toward, weight),) = draws(*of)
        ahead = 8193.0 * weight  # of 24 binary digits 11 stay: Veltkamp's splitting
        return [(toward, ahead - (ahead - weight))]

    monkeypatch.setattr(lighting._Distant, "draws", rounded)


def with_a_sample_in_a_thousand_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    sums = wavefront.lobes_from_sums

    def lossy(blocks: Any, layout: Any, samples: int, *more: Any) -> Any:
        return sums([np.float32(0.999) * block for block in blocks], layout, samples, *more)

    monkeypatch.setattr(wavefront, "lobes_from_sums", lossy)


def with_the_light_of_the_first_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    kept: dict[int, Any] = {}

    def stale(mi: Any, light: Any, scene: Any) -> Any:
        # The scene is kept as well, lest another get its number.
        return kept.setdefault(id(scene), (lighting.sampler(mi, light, scene), scene))[0]

    monkeypatch.setattr(wavefront, "sampler", stale)


def with_a_lamp_too_polarised(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a twentieth of its degree."""
    angled = lighting._stokes
    monkeypatch.setattr(lighting, "_stokes", lambda x, y, scale: angled(x, y, 1.05 * scale))


@pytest.mark.parametrize(
    ("fault", "names"),
    [
        (with_pixels_that_share_random_numbers, {"own random numbers"}),
        (with_bands_of_their_neighbours_nodes, {"formulas"}),
        (with_half_precision, {"formulas"}),
        (with_a_sample_in_a_thousand_lost, {"formulas"}),
        (with_the_light_of_the_first_recording, {"replayed kernel"}),
        (with_a_lamp_too_polarised, {"polarised lamp"}),
        (without_shadow, {"mesh that shades itself"}),
        (with_the_lamps_polariser_turned, {"polarised lamp", "room of metal"}),
        (with_roughness_across_for_along, {"brushed metal"}),
        (with_one_seed_for_all, {"repeated render"}),
        (with_errors_too_small_by_the_root_of_two, {"repeated render"}),
    ],
)
def test_a_planted_fault_is_found(
    fault: Callable[[pytest.MonkeyPatch], None],
    names: set[str],
    vectorised: Variant,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Only these checks are done: each of the others takes kernels of its own."""
    monkeypatch.setattr(
        self_check, "LAWS", {n: law for n, law in self_check.LAWS.items() if n in names}
    )
    wanted = {n: scene for n, scene in SCENES.items() if n in names | {"area light"}}
    monkeypatch.setattr(self_check, "SCENES", wanted)
    fault(monkeypatch)
    assert failed(vectorised, *names) == names


def test_light_that_is_missing_between_objects_is_found(
    vectorised: Variant, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(path_traced, "_path", lambda *_: None)
    assert failed(vectorised, "room", "sky") == {"room"}


def test_a_render_that_fails_is_a_check_that_failed(
    vectorised: Variant, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("out of memory")

    for module in (self_check_laws, self_check_scenes):
        monkeypatch.setattr(module, "render_family", broken)
    done = list(checks(vectorised, short=True))
    assert not [check for check in done if check.passed]
    assert {check.why for check in done} == {"RuntimeError: out of memory"}


def test_a_variant_whose_renders_are_wrong_is_not_chosen(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    monkeypatch.setattr(variant, "_cache_file", lambda: tmp_path / "variants.json")

    class Done:
        returncode = 1

    monkeypatch.setattr(variant.subprocess, "run", lambda *_, **__: Done)
    assert variant._probe(variant.CUDA, None) is False


@pytest.mark.parametrize(
    ("message", "refused"),
    [
        ("jit_eval(): more than one OptiX shader binding table was used. Disabling this", True),
        ("jit_flush_malloc_cache(): Dr.Jit exhausted the available memory", False),
        ('jit_kernel_load(): discarding cache file "/x/1.bin": checksum mismatch.', False),
        ("scenes 3 of 8", False),
    ],
)
def test_what_the_renderer_warns_of_is_an_error(
    message: str, refused: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    def render() -> None:
        with refused_warnings("scene 0123"):
            sys.stderr.write(f"{message}\n")

    if refused:
        with pytest.raises(KernelWarning, match=r"scene 0123: .* jit_eval\(\): more than one"):
            render()
    else:
        render()
    assert message in capsys.readouterr().err  # nothing is swallowed


def test_a_full_kernel_cache_changes_neither_variant_nor_numbers(
    vectorised: Variant, tmp_path: Path
) -> None:
    program = f"""
import resource, sys
limit = int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
from malus.renderers.self_check import works
from malus.renderers.self_check_scenes import SCENES, rendered
from malus.renderers.variant import Variant
on_trial = Variant({vectorised.name!r}, "on trial", {vectorised.llvm!r})
truth = rendered(on_trial, SCENES["metal"], seed=1)
print(works(on_trial), truth.image.tobytes().hex())
"""
    printed = {}
    # A file of 100 bytes holds no kernel; 1 GB is no limit.
    for limit in ("100", "1000000000"):
        environment = os.environ | {"DRJIT_CACHE_DIR": str(tmp_path / limit)}
        words = [sys.executable, "-c", program, limit]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
        assert ("jit_kernel_write(): " in done.stderr) == (limit == "100")
        printed[limit] = done.stdout
    assert printed["100"] == printed["1000000000"]
    assert printed["100"].startswith("True ")


def measured_reference(
    variant: Variant, scenes: Mapping[str, Scene], runs: int = self_check.RUNS
) -> dict[str, dict[str, Any]]:
    """The content of `self_check.json` for `SCENES`: mask, mean and spread over seeds, by scene."""
    reference = {}
    for name, scene in scenes.items():
        seeds = range(1000, 1000 + runs)
        covered = self_check_scenes.rendered(variant, scene, seed=0).mask
        truths = (self_check_scenes.rendered(variant, scene, seed) for seed in seeds)
        values = np.stack([self_check_scenes.region_means(truth, covered)[0] for truth in truths])
        mean = values.mean(axis=0)
        together = np.stack([self_check.gains(of_seed, mean) for of_seed in values])
        reference[name] = {
            "covered": ["".join("01"[int(pixel)] for pixel in row) for row in covered],
            "mean": _digits(mean),
            "spread": _digits(values.std(axis=0, ddof=1)),
            "gain spread": _digits(together.std(axis=0, ddof=1)),
        }
    return reference


def _digits(values: Float64Array) -> Any:
    """Values as nested lists of seven significant digits, which hold 32 bits."""
    text = json.dumps(values.tolist())
    return json.loads(text, parse_float=lambda number: float(f"{float(number):.6e}"))


def test_stored_values_are_what_measuring_them_gives(vectorised: Variant) -> None:
    """`measured_reference` makes the file that is stored: some of its seeds agree within noise."""
    name, runs = "area light", 8
    measured = measured_reference(vectorised, {name: SCENES[name]}, runs)[name]
    file = resources.files("malus.renderers").joinpath(self_check.REFERENCE)
    stored = json.loads(file.read_text("utf-8"))[name]
    mean, spread = np.array(stored["mean"]), np.array(stored["spread"])
    error = spread * np.sqrt(1 / runs - 1 / self_check.RUNS) + 1e-6 * np.abs(mean).max()
    assert (np.abs(np.array(measured["mean"]) - mean) < self_check.LARGEST * error).all()
