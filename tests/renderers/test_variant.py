"""Choosing a variant must never risk the process."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from malus.bench.public.doctor import doctor
from malus.renderers import render, variant
from malus.renderers.families.family import render_family
from malus.scenes import Camera, Dielectric, InputError, Sampling, Scene, Sphere, Uniform


@pytest.fixture
def no_libraries(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(variant, "_LLVM_FOLDERS", (str(tmp_path),))
    monkeypatch.setattr(variant, "_cache_file", lambda: tmp_path / "cache" / "variants.json")
    return tmp_path


def test_versions_that_abort_are_no_candidates(
    no_libraries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = (
        "libLLVM-14.so.1",
        "libLLVM-15.so",
        "libLLVM-16.so",
        "libLLVM.so.19.1",
        "libLLVM-22.so",
    )
    for name in names:
        (no_libraries / name).write_bytes(b"not a library")
    mine = [p.name for p in variant.llvm_candidates() if p.parent == no_libraries]
    assert mine == ["libLLVM-22.so", "libLLVM.so.19.1"]
    for name in names[:3]:
        monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(no_libraries / name))
        assert variant.llvm_candidates() == []


def test_a_cache_that_cannot_be_written_leaves_no_file(
    no_libraries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every run left one more, where a quota was used up."""

    def no_room(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", no_room)
    variant._write_cache({"a": True})
    assert list((no_libraries / "cache").iterdir()) == []


@pytest.mark.parametrize(
    ("named", "told"), [("/nowhere", "/nowhere"), ("", None), (os.devnull, None)]
)
def test_a_library_that_is_not_there_is_told_unless_malus_named_it(
    monkeypatch: pytest.MonkeyPatch, named: str, told: str | None
) -> None:
    """Where none works malus itself names no file, so that Dr.Jit loads none."""
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", named)
    assert variant.missing_llvm() == told


def test_a_link_without_a_number_is_known_by_what_it_points_to(no_libraries: Path) -> None:
    (no_libraries / "libLLVM-14.so.1").write_bytes(b"")
    (no_libraries / "libLLVM.so").symlink_to(no_libraries / "libLLVM-14.so.1")
    assert not [p for p in variant.llvm_candidates() if p.parent == no_libraries]


def test_a_library_that_does_not_work_is_survived_and_remembered(no_libraries: Path) -> None:
    broken = no_libraries / "libLLVM-19.so"
    broken.write_bytes(b"not a library")
    assert variant._probe(variant.LLVM, broken) is False
    assert (no_libraries / "cache" / "variants.json").exists()
    assert variant._read_cache() != {}


def test_a_probe_that_came_to_no_end_is_made_again(
    no_libraries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A machine that was too busy once must not render slowly for ever."""

    def endless(*_: object, **__: object) -> None:
        raise subprocess.TimeoutExpired("python", 120)

    library = no_libraries / "libLLVM-19.so"
    library.write_bytes(b"")
    monkeypatch.setattr(variant.subprocess, "run", endless)
    assert variant._probe(variant.LLVM, library) is False
    assert variant._read_cache() == {}


def test_what_one_card_does_is_not_believed_of_others(
    no_libraries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Jobs and machines of a cluster share a home, and with it the answers."""
    monkeypatch.setattr(variant, "_NVIDIA", no_libraries)
    card = no_libraries / "gpus" / "0000:01:00.0" / "information"
    card.parent.mkdir(parents=True)
    works: list[bool] = []
    monkeypatch.setattr(variant, "_self_check_in_subprocess", lambda *_: works.pop())

    def probed(driver: str, model: str, may_use: str | None, answer: bool | None) -> bool:
        (no_libraries / "version").write_text(f"NVRM version: {driver}\nGCC version: 12\n")
        card.write_text(f"Model: \t\t {model}\nIRQ: \t\t 17\n")
        if may_use is None:
            monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
        else:
            monkeypatch.setenv("CUDA_VISIBLE_DEVICES", may_use)
        works[:] = [] if answer is None else [answer]
        return variant._probe(variant.CUDA, None)

    assert probed("580", "NVIDIA H200", "", answer=False) is False
    assert probed("580", "NVIDIA H200", None, answer=True) is True
    assert probed("580", "NVIDIA K80", None, answer=False) is False
    assert probed("590", "NVIDIA K80", None, answer=True) is True
    assert probed("580", "NVIDIA H200", None, answer=None) is True  # remembered


def test_a_probe_that_was_killed_is_made_again(
    no_libraries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel kills where memory is short; nothing else sends this signal."""

    class Killed:
        returncode = -9

    monkeypatch.setattr(variant.subprocess, "run", lambda *_, **__: Killed)
    library = no_libraries / "libLLVM-19.so"
    library.write_bytes(b"")
    assert variant._probe(variant.LLVM, library) is False
    assert variant._read_cache() == {}


def test_files_of_the_working_folder_do_not_hide_a_variant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a checkout called malus, or a script called random.py, nothing else is imported."""
    for name in ("malus", "numpy", "random", "types"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('imported')")
    monkeypatch.chdir(tmp_path)
    best = variant.choose()
    assert variant._self_check_in_subprocess(best.name, best.llvm or "") is True


def test_a_failure_is_tried_again_once_the_doctor_is_asked(
    no_libraries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = no_libraries / "libLLVM-19.so"
    library.write_bytes(b"")
    monkeypatch.setattr(variant, "_self_check_in_subprocess", lambda *_: False)
    assert variant._probe(variant.LLVM, library) is False
    monkeypatch.setattr(variant, "_self_check_in_subprocess", lambda *_: True)
    assert variant._probe(variant.LLVM, library) is False  # remembered
    with monkeypatch.context() as patched:
        patched.setattr(variant, "_cuda", lambda: None)
        patched.setenv("DRJIT_LIBLLVM_PATH", str(library))
        assert doctor()["llvm"] == str(library)
    variant.choose.cache_clear()


def test_a_cache_that_is_damaged_is_no_cache(no_libraries: Path) -> None:
    cache = no_libraries / "cache" / "variants.json"
    cache.parent.mkdir()
    cache.write_text("{", "utf-8")
    assert variant._read_cache() == {}


def test_unknown_backend() -> None:
    with pytest.raises(InputError, match="cuda, llvm or scalar"):
        variant.choose("metal")


def test_one_scene_is_rendered_by_the_backend_that_is_asked_for() -> None:
    """Only the environment could choose one, and only before the first render."""
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.3),
        light=Uniform(),
        camera=Camera(resolution=6),
    )
    sampling = Sampling(samples=4)
    asked = render(scene, sampling, backend="scalar")
    same = render_family([scene], sampling, variant.choose("scalar")).truth(scene)
    assert asked.stokes.any()
    np.testing.assert_array_equal(asked.stokes, same.stokes)
    with pytest.raises(InputError, match="backend: expected auto, cuda, llvm or scalar"):
        render(scene, sampling, backend="metal")


def test_a_backend_from_the_environment_is_named_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who set it gave no --backend; set to nothing it is not set, as other variables are."""
    best = variant.choose()
    choose = variant.choose.__wrapped__  # type: ignore[attr-defined]
    monkeypatch.setenv("MALUS_BACKEND", "metal")
    with pytest.raises(InputError, match=r"^MALUS_BACKEND: expected auto, .* found metal"):
        choose()
    monkeypatch.setenv("MALUS_BACKEND", "")
    assert choose() == best


def test_variants_follow_one_another_in_one_process() -> None:
    """Dr.Jit looks for LLVM once: the scalar variant first must not hide it from what follows."""
    if not variant.choose().vectorised:
        pytest.skip("only the scalar variant runs here")
    script = (
        "from malus.renderers.self_check_scenes import rendered, SCENES\n"
        "from malus.renderers.variant import choose\n"
        "for backend, vectorised in (('scalar', False), ('auto', True), ('scalar', False)):\n"
        "    variant = choose(backend)\n"
        "    assert variant.vectorised == vectorised\n"
        "    assert rendered(variant, SCENES['uniform light'], seed=1).image.max() > 0\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
