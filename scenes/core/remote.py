"""Folders and files on this machine and elsewhere: a path, or a URL that fsspec knows.

A store elsewhere (`s3://bucket/folder`, `memory://folder`) holds whole objects: one that is put is
there entirely or not at all, so that no temporary name and no rename are needed. What writes or
reads with a library that knows files only does so here, and the whole is put or copied.
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

from malus.scenes.core.errors import InputError

_HERE = ("file://", "local://")
LAST = "scene.json"
"""The file of a folder that tells that it is whole: it is put last, and removed first."""


def as_path(path_or_url: str | Path) -> Path:
    """The file or folder of a path or a URL; a URL gives a `UPath`, which has the same methods.

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
            found = UPath(text, use_listings_cache=False)
            _ = found.fs
    except ImportError as error:
        reason = (str(error).splitlines() or ["no package for it"])[0]
        hint = "pip install that package (s3fs for s3://, gcsfs for gs://, adlfs for az://)"
        raise InputError(text, "a store whose package is installed", reason, hint) from None
    except ValueError as error:
        hint = "a path needs no ://"
        raise InputError(text, "a path, or a URL that fsspec knows", str(error), hint) from None
    return cast(Path, found)


def is_here(path: Path) -> bool:
    """Whether it is a file or folder of this machine."""
    return isinstance(path, Path)


def lstat(path: Path) -> os.stat_result:
    """Kind and size of a file itself, not of what a link leads to."""
    return path.lstat() if is_here(path) else path.stat()


@contextmanager
def readable(path: Path) -> Iterator[Path]:
    """A file of this machine with the content of `path`: itself, or a copy for a while."""
    if is_here(path):
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        with path.open("rb") as source, copy.open("wb") as target:
            shutil.copyfileobj(source, target)
        yield copy


def put_file(final: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a file of this machine, then put it elsewhere as a whole."""
    with tempfile.TemporaryDirectory() as folder:
        # The suffix stays: writers choose a format by it.
        temporary = Path(folder) / f"whole{final.suffix}"
        write(temporary)
        _put(temporary, final)


def put_folder(final: Path, write: Callable[[Path], None]) -> None:
    """Call `write` with a folder of this machine, then put its files elsewhere, `LAST` last."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder))
        files = [path for path in sorted(Path(folder).rglob("*")) if path.is_file()]
        (final / LAST).unlink(missing_ok=True)
        for file in sorted(files, key=lambda path: path.name == LAST):
            _put(file, final / file.relative_to(folder).as_posix())


def put_mark(folder: Path, name: str) -> Path:
    """An empty file whose name is not there yet: `name` with `*` replaced by something new."""
    mark = folder / name.replace("*", secrets.token_hex(4))
    mark.write_bytes(b"")
    return mark


def _put(source: Path, final: Any) -> None:
    final.parent.mkdir(parents=True, exist_ok=True)
    final.fs.put_file(str(source), final.path)
