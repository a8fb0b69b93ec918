"""What `malus doctor` says about packages: which are missing, too old, or not needed."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from email.message import Message
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from runs import run_malus

from malus.bench.public import requirements
from malus.bench.public.requirements import installed_packages, unmet_requirements

NEEDED = [
    "mitsuba<3.10,>=3.9",
    "pandas>=3",
    "OpenEXR>=3.4",
    'nothing>=1; sys_platform == "plan9"',
    'h5py>=3.10; extra == "hdf5"',
    'rawpy>=0.23.1; extra == "raw"',
    'ruff>=0.6; extra == "dev"',
]
INSTALLED = {"malus": "0.2.0", "mitsuba": "3.9.1", "pandas": "2.2.0", "h5py": "3.9", "ruff": "0.1"}


@pytest.fixture
def unfit(monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment with an old pandas and h5py, without OpenEXR."""

    def version(name: str) -> str:
        if name not in INSTALLED:
            raise PackageNotFoundError(name)
        return INSTALLED[name]

    about = Message()
    for extra in ("hdf5", "raw", "dev"):
        about["Provides-Extra"] = extra
    monkeypatch.setattr(requirements, "version", version)
    monkeypatch.setattr(requirements, "requires", lambda _: NEEDED)
    monkeypatch.setattr(requirements, "metadata", lambda _: about)


@pytest.mark.usefixtures("unfit")
def test_old_and_missing_packages_are_named_with_what_to_install() -> None:
    """Also of an extra, where it is installed; tools of developers are no matter."""
    assert unmet_requirements() == {
        "pandas": "pandas>=3", "OpenEXR": "OpenEXR>=3.4", "h5py": "h5py>=3.10"
    }  # fmt: skip
    done = run_malus("doctor", "--json")
    assert done.returncode == 1
    packages = json.loads(done.stdout)["packages"]
    assert packages == {
        "malus": "0.2.0", "mitsuba": "3.9.1", "pandas": "2.2.0", "OpenEXR": None, "h5py": "3.9"
    }  # fmt: skip
    told = run_malus("doctor").stdout
    assert "missing: pip install 'OpenEXR>=3.4'" in told
    assert "2.2.0 does not fit: pip install 'pandas>=3'" in told


@pytest.mark.usefixtures("unfit")
def test_what_is_missing_is_told_also_where_nothing_can_be_imported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "malus.bench.public.doctor", None)
    done = run_malus("doctor")
    assert done.returncode == 1
    assert "OpenEXR missing: pip install 'OpenEXR>=3.4'" in done.stdout.splitlines()


@pytest.mark.usefixtures("unfit")
def test_every_command_names_what_it_cannot_import(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "malus.bench.public.lists", None)
    done = run_malus("list", "shapes")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("malus: expected the packages that malus needs, found ")
    assert line.endswith("pip install 'pandas>=3' 'OpenEXR>=3.4' 'h5py>=3.10'")


def test_an_import_that_no_package_explains_is_a_fault_of_malus(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "malus.bench.public.lists", None)
    with pytest.raises(ImportError, match="lists"):
        run_malus("list", "shapes")


def test_a_checkout_without_metadata_needs_what_nobody_knows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def nowhere(name: str) -> None:
        raise PackageNotFoundError(name)

    for reads in ("version", "requires", "metadata"):
        monkeypatch.setattr(requirements, reads, nowhere)
    assert installed_packages() == {"malus": None}
    done = run_malus("doctor")
    assert done.returncode == 1
    assert "missing: pip install '.'" in done.stdout


def test_no_numpy_is_allowed_that_pyarrow_refuses() -> None:
    """pyarrow 26 is imported with NumPy 2.0 or newer; pip does not know it."""
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8"))
    needs = map(Requirement, project["project"]["dependencies"])
    (numpy,) = (need for need in needs if need.name == "numpy")
    assert "1.26.4" not in numpy.specifier
    assert "2.0.2" in numpy.specifier  # `malus run` gives the same table with it


def test_a_library_that_is_named_and_does_not_work_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Malus looks for no other then, and installing one does not help."""
    named = tmp_path / "libLLVM-19.so"
    named.write_bytes(b"no library")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(named))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    command = [sys.executable, "-m", "malus", "doctor", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    findings = json.loads(done.stdout)
    if "cuda" in findings["variant"]:
        pytest.skip("a graphics card renders here, whatever LLVM there is")
    assert findings["advice"].startswith(f"DRJIT_LIBLLVM_PATH names {named}, which is no working")
