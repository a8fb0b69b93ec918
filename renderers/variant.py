"""Choose the Mitsuba variant that can run here, without risking this process.

Dr.Jit loads the first libLLVM it finds; versions 14 to 16 abort the process at the first render.
Every candidate therefore renders the short form of `self_check` in a subprocess, and
`DRJIT_LIBLLVM_PATH` names the one that works before Mitsuba is imported for the first time.
"""

from __future__ import annotations

import ctypes.util
import functools
import json
import os
import re
import signal
import subprocess
import sys
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

from malus.scenes.core.errors import InputError
from malus.scenes.core.files import write_text
from malus.scenes.core.quiet import quiet

SCALAR = "scalar_spectral_polarized"
LLVM = "llvm_ad_mono_polarized"
CUDA = "cuda_ad_mono_polarized"
BACKENDS = {"cuda": CUDA, "llvm": LLVM, "scalar": SCALAR}
BROKEN_LLVM = frozenset({14, 15, 16})
"""LLVM versions that abort the process ("Cannot select fmaximum"); they are never loaded."""

_LLVM_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/opt/homebrew/opt/llvm/lib",
)


_NVIDIA = Path("/proc/driver/nvidia")

FEWEST_THREADS = 2
"""Threads of Dr.Jit, the calling one among them. Alone, that keeps numbers too small for full
precision, which the others round to zero: standard errors of 0 would be 1e-21 on one core only."""


@dataclass(frozen=True)
class Variant:
    """A usable Mitsuba variant and why it was chosen."""

    name: str
    reason: str
    llvm: str | None = None

    @property
    def vectorised(self) -> bool:
        """Whether arrays of rays can be traced from Python (LLVM and CUDA)."""
        return self.name != SCALAR


def llvm_version(path: Path) -> int | None:
    """Major version in the name of a libLLVM, following links, or None.

    Examples
    --------
    >>> llvm_version(Path("/nowhere/libLLVM-14.so.1")), llvm_version(Path("/x/libLLVM.so.19.1"))
    (14, 19)
    """
    for name in (path.name, path.resolve().name):
        match = re.search(r"libLLVM(?:-|\.so\.|\.)(\d+)", name)
        if match:
            return int(match.group(1))
    return None


def installed_llvm() -> list[Path]:
    """Every libLLVM in the usual places, newest first.

    `DRJIT_LIBLLVM_PATH`, where it is set, is the only one.
    """
    chosen = os.environ.get("DRJIT_LIBLLVM_PATH")
    if chosen:
        paths = {Path(chosen)}
    else:
        folders = [Path(f) for f in _LLVM_FOLDERS] + sorted(Path("/usr/lib").glob("llvm-*/lib"))
        names = ("libLLVM*.so*", "libLLVM*.dylib")
        paths = {p.resolve() for f in folders for name in names for p in f.glob(name)}
    files = [p for p in paths if p.is_file()]
    return sorted(files, key=lambda p: (llvm_version(p) or 0, str(p)), reverse=True)


def llvm_candidates() -> list[Path]:
    """Files that could be a working libLLVM, newest first; those known to abort are left out."""
    return [p for p in installed_llvm() if llvm_version(p) not in BROKEN_LLVM]


def _cache_file() -> Path:
    root = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(root) / "malus" / "variants.json"


@functools.cache
def made_by(renderer: str) -> str:
    """Versions of what renders: of malus, and of Mitsuba and Dr.Jit where these do.

    Looking them up takes milliseconds, and every part of a run has them in its name.

    Examples
    --------
    >>> made_by("torrance-sparrow").split()[0]
    'malus'
    """
    packages = ("malus", "mitsuba", "drjit") if renderer == "mitsuba" else ("malus",)
    return "|".join(f"{package} {version(package)}" for package in packages)


def _probe(variant: str, llvm: Path | None) -> bool:
    """Whether small renders come out right in a subprocess; the answer is cached on disk."""
    stamp = f"{llvm}:{llvm.stat().st_mtime_ns}" if llvm else _devices()
    key = f"{variant}|{stamp}|{made_by('mitsuba')}|{sys.executable}"
    answers = _read_cache()
    if key not in answers:
        passed = _self_check_in_subprocess(variant, str(llvm) if llvm else "")
        if passed is None:
            return False
        answers[key] = passed
        _write_cache(answers)
    return answers[key]


def _devices() -> str:
    """NVIDIA's driver, the cards' models, where Linux tells them, and which of them CUDA may use.

    Machines of a cluster share a cache; a job that may use no card says nothing of one that may.
    """
    try:
        lines = (_NVIDIA / "version").read_text("utf-8").splitlines()[:1]
        for file in sorted(_NVIDIA.glob("gpus/*/information")):
            lines += [line for line in file.read_text("utf-8").splitlines() if "Model" in line]
    except (OSError, ValueError):
        lines = []
    return "|".join([*lines, os.environ.get("CUDA_VISIBLE_DEVICES", "all")])


def _self_check_in_subprocess(variant: str, llvm: str) -> bool | None:
    """Whether small renders come out right; None where they did not end, as on a busy machine."""
    # It imports from where this process does: with -m alone, `numpy.py` or another `malus` in the
    # working folder would come first, and the variant fail for them.
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    try:
        process = subprocess.run(
            [sys.executable, "-P", "-m", "malus.renderers.self_check", variant, llvm],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
            env=os.environ | {"PYTHONPATH": paths},
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    # A process that was killed, as where memory is short, says nothing of the variant.
    return None if process.returncode == -signal.SIGKILL else process.returncode == 0


def forget_failures() -> None:
    """Let every variant be tried again that failed before: what made it fail may be mended.

    Examples
    --------
    >>> forget_failures()
    """
    answers = _read_cache()
    kept: dict[str, bool] = {key: passed for key, passed in answers.items() if passed}
    if kept != answers:
        _write_cache(kept)
        choose.cache_clear()


def _read_cache() -> dict[str, bool]:
    try:
        answers = json.loads(_cache_file().read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return answers if isinstance(answers, dict) else {}


def _write_cache(answers: dict[str, bool]) -> None:
    """Store the answers; where the cache cannot be written, every run probes for a second."""
    with suppress(OSError, InputError):
        write_text(_cache_file(), json.dumps(answers))


def _cuda() -> Variant | None:
    if not (Path("/dev/nvidiactl").exists() or ctypes.util.find_library("cuda")):
        return None
    return Variant(CUDA, "a CUDA device renders") if _probe(CUDA, None) else None


def _llvm() -> Variant | None:
    for path in llvm_candidates():
        if _probe(LLVM, path):
            number = llvm_version(path)
            return Variant(LLVM, f"LLVM {number or '?'} renders", str(path))
    return None


def _scalar() -> Variant:
    return Variant(SCALAR, "no working CUDA device or LLVM library found")


@functools.cache
def choose(backend: str = "auto") -> Variant:
    """The fastest variant that works: CUDA, else LLVM, else scalar; or the `backend` asked for.

    Parameters
    ----------
    backend : 'auto', 'cuda', 'llvm' or 'scalar'
        'auto' reads the environment variable MALUS_BACKEND first; an empty one is none.

    Raises
    ------
    InputError
        Unknown backend, or one that does not work here.

    Examples
    --------
    >>> choose("scalar").name
    'scalar_spectral_polarized'
    """
    where = "backend"
    if backend == "auto" and os.environ.get("MALUS_BACKEND"):
        where, backend = "MALUS_BACKEND", os.environ["MALUS_BACKEND"]
    if backend == "auto":
        return _cuda() or _llvm() or _scalar()
    if backend == "scalar":
        return Variant(SCALAR, "asked for")
    if backend not in BACKENDS:
        raise InputError(where, "auto, cuda, llvm or scalar", backend, "choose one of these")
    variant = _cuda() if backend == "cuda" else _llvm()
    if variant is None:
        hint = "`malus doctor` says what is here, and what a check of it finds"
        raise InputError(where, f"a working {backend}", "none", hint)
    return variant


def chosen_variant(backend: str | Variant) -> Variant:
    """The Mitsuba variant of a backend's name; a Variant as it is.

    Raises
    ------
    InputError
        Unknown backend, or one that does not work here.

    Examples
    --------
    >>> chosen_variant("scalar").name
    'scalar_spectral_polarized'
    """
    return backend if isinstance(backend, Variant) else choose(backend)


def unchecked(backend: str = "auto") -> Variant:
    """The variant of a backend as in `choose`, but not tested: for a check that tests it.

    Raises
    ------
    InputError
        Unknown backend, or one without a library here.
    """
    if backend == "cuda":
        return Variant(CUDA, "asked for")
    if backend == "llvm":
        path = next(iter(llvm_candidates()), None)
        if path is None:
            hint = "`malus doctor` says more"
            raise InputError("backend", "LLVM 17 or later", "no such library", hint)
        return Variant(LLVM, "asked for", str(path))
    return choose(backend)


def missing_llvm() -> str | None:
    """The path in DRJIT_LIBLLVM_PATH where it names no file, unless malus itself wrote it there."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH", os.devnull)
    return named if named not in ("", os.devnull) and not Path(named).is_file() else None


def mitsuba(variant: Variant) -> ModuleType:
    """Import Mitsuba and activate `variant`; no other module imports it for rendering."""
    if "mitsuba" in sys.modules:
        import mitsuba as mi
    else:
        # Without a path Dr.Jit would load the first libLLVM it finds, whatever its version. It
        # looks once a process: a variant without LLVM must not hide it from a later one.
        library = variant.llvm or getattr(_llvm(), "llvm", None)
        os.environ["DRJIT_LIBLLVM_PATH"] = library or os.devnull
        # Without LLVM, Mitsuba prints a warning, though LLVM was not asked for.
        with nullcontext() if library else quiet():
            import mitsuba as mi
    if mi.variant() != variant.name:
        mi.set_variant(variant.name)
        mi.set_log_level(mi.LogLevel.Error)
    import drjit as dr

    if dr.thread_count() < FEWEST_THREADS:
        dr.set_thread_count(FEWEST_THREADS)
    return mi


def use_threads(variant: Variant, threads: int) -> None:
    """Let Mitsuba use so many threads in this process, where others beside it render, too."""
    mitsuba(variant)
    import drjit as dr

    count = max(threads, FEWEST_THREADS)
    if dr.thread_count() != count:
        dr.set_thread_count(count)
