"""Files and folders on this machine, or in a store elsewhere whose URL fsspec understands.

A store elsewhere (`s3://bucket/folder`, `memory://folder`) holds whole objects: one that is put is
there entirely or not at all, so that no temporary name and no rename are needed. A library that
knows local files only writes to a temporary one, which is then copied to the store as a whole.
"""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote

from malus.scenes.core.errors import InputError, first_line

_HERE = ("file://", "local://")
LAST = "scene.json"
"""The file that marks a folder as complete: it is copied last, and removed first."""


def as_path(path_or_url: str | Path) -> Path:
    """A path or URL as a `Path`; a URL of a store gives a `UPath`, which has the same methods.

    Raises
    ------
    InputError
        A URL of a protocol that is unknown, or whose package is not installed.

    Examples
    --------
    >>> as_path("results/quick").name, as_path("memory://results/quick").name
    ('quick', 'quick')
    """
    text = str(path_or_url)
    if isinstance(path_or_url, Path) or "://" not in text:
        return Path(path_or_url)
    if text.startswith(_HERE):
        return Path(unquote(text.split("://", 1)[1]))
    from upath import UPath

    try:
        with warnings.catch_warnings():
            # Protocols that UPath has no class of its own for work all the same.
            warnings.simplefilter("ignore", UserWarning)
            # Others write there too: what was listed a minute ago may be old.
            path = UPath(text, use_listings_cache=False)
            _ = path.fs
    except ImportError as error:
        reason = first_line(error)
        hint = "pip install that package (s3fs for s3://, gcsfs for gs://, adlfs for az://)"
        raise InputError(text, "a store whose package is installed", reason, hint) from None
    except ValueError as error:
        hint = "a path needs no ://"
        raise InputError(text, "a path, or a URL that fsspec knows", str(error), hint) from None
    return cast(Path, path)


def is_here(path: Path) -> bool:
    """Whether a path is on this machine, not in a store elsewhere."""
    return isinstance(path, Path)


def lstat(path: Path) -> os.stat_result:
    """Kind and size of a file itself, not of the target of a link."""
    return path.lstat() if is_here(path) else path.stat()


@contextmanager
def readable(path: Path) -> Iterator[Path]:
    """A local file with the content of `path`: itself, or a temporary copy of a remote one."""
    if is_here(path):
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        with path.open("rb") as source, copy.open("wb") as target:
            shutil.copyfileobj(source, target)
        yield copy


def put_file(final: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a temporary local file, then copy it to the store as a whole."""
    with tempfile.TemporaryDirectory() as folder:
        # The suffix stays: writers choose a format by it.
        temporary = Path(folder) / f"whole{final.suffix}"
        write(temporary)
        _put(temporary, final)


def put_folder(final: Path, write: Callable[[Path], None]) -> None:
    """Call `write` with a temporary local folder, then copy its files to the store, `LAST` last.

    Files of an older folder that the new one lacks are removed.
    """
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder))
        files = [path for path in sorted(Path(folder).rglob("*")) if path.is_file()]
        (final / LAST).unlink(missing_ok=True)
        names = {file.relative_to(folder).as_posix() for file in files}
        for old in list(final.rglob("*")) if final.is_dir() else ():
            if old.is_file() and old.relative_to(final).as_posix() not in names:
                old.unlink()
        for file in sorted(files, key=lambda path: path.name == LAST):
            _put(file, final / file.relative_to(folder).as_posix())


def put_mark(folder: Path, name: str) -> Path:
    """Create an empty file in a folder, named `name` with `*` replaced by a random number."""
    mark = folder / name.replace("*", secrets.token_hex(4))
    mark.write_bytes(b"")
    return mark


def _put(source: Path, final: Any) -> None:
    final.parent.mkdir(parents=True, exist_ok=True)
    final.fs.put_file(str(source), final.path)
