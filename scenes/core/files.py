"""Files and folders that are written as a whole or not at all, and checked before they are read."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import shutil
import socket
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, cast

from malus.scenes.core.errors import InputError, first_line, reading
from malus.scenes.core.remote import is_here, put_file, put_folder, put_mark

TEMPORARY = ".part-"
_PURPOSE = "-for-"


def replace_folder(final: Path, write: Callable[[Path], None]) -> None:
    """Call `write` with an empty folder beside `final`, then rename it: whole or not at all.

    Raises
    ------
    InputError
        Where there is no room, or no permission to write.

    Examples
    --------
    >>> base = Path(tempfile.mkdtemp())
    >>> replace_folder(base / "a", lambda folder: (folder / "b").touch())
    >>> [path.name for path in base.iterdir()]
    ['a']
    """
    if not is_here(final):
        put_folder(final, write)
        return
    temporary = aside = None
    try:
        temporary = _temporary_folder(final.parent)
        write(temporary)
        temporary.chmod(_permissions(0o777))
        if final.is_dir() and not final.is_symlink():
            # A folder that is not empty cannot be replaced by renaming: it steps aside first.
            aside = _temporary_folder(final.parent)
            os.rename(final, aside / final.name)
        os.rename(temporary, final)
    except OSError as error:
        if temporary is not None and not _is_of_writing(error, temporary):
            raise
        raise _not_written(final, "folder", error) from error
    finally:
        if aside is not None and (aside / final.name).exists() and not final.exists():
            os.rename(aside / final.name, final)  # stopped between: else neither would be left
        for left in (temporary, aside):
            if left is not None:
                shutil.rmtree(left, ignore_errors=True)


_NOT_WRITABLE = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}
"""Errors that no reading has."""


def _is_of_writing(error: OSError, temporary: Path) -> bool:
    """Whether an error is of what is written, and not of a file that is read for it."""
    name = error.filename
    is_own = name is None or str(name).startswith(str(temporary))
    return is_own or error.errno in _NOT_WRITABLE


def _not_written(final: Path, kind: str, error: OSError) -> InputError:
    reason = os.strerror(error.errno) if error.errno else str(error)
    expected, hint = f"a {kind} that can be written", "mend that and give the command again"
    return InputError(str(final), expected, reason, hint)


def add_to_folder(final: Path, write: Callable[[Path], object]) -> list[str]:
    """Call `write` with an empty folder, then move its files into `final`: all or none.

    Unlike `replace_folder` it leaves what else lies in the folder. Returns the files' names.

    Raises
    ------
    InputError
        Where the folder cannot be made or written.

    Examples
    --------
    >>> base = Path(tempfile.mkdtemp())
    >>> add_to_folder(base, lambda folder: (folder / "b").touch())
    ['b']
    """
    is_new = not final.exists()
    try:
        final.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=final, prefix=_prefix()))
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            str(final), "a folder to write to", reason, "choose another folder"
        ) from None
    try:
        write(temporary)
        names = sorted(path.name for path in temporary.iterdir())
        for name in names:  # before any is moved
            if (final / name).is_dir():
                hint = "move it away, or choose another folder"
                raise InputError(str(final / name), "a file, or none", "a folder", hint)
        for name in names:
            os.replace(temporary / name, final / name)
    except BaseException as error:
        shutil.rmtree(temporary, ignore_errors=True)
        if is_new:
            with contextlib.suppress(OSError):
                final.rmdir()
        if isinstance(error, OSError) and _is_of_writing(error, temporary):
            raise _not_written(final, "folder", error) from error
        if isinstance(error, InputError) and str(temporary) in error.where:
            where = error.where.replace(str(temporary), str(final))
            raise InputError(where, error.expected, error.found, error.hint) from error
        raise
    shutil.rmtree(temporary, ignore_errors=True)
    return names


def replace_file(final: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a temporary name beside `final`, then rename: whole or not at all.

    Raises
    ------
    InputError
        Where there is no room, or no permission to write.

    Examples
    --------
    >>> base = Path(tempfile.mkdtemp())
    >>> replace_file(base / "a.txt", lambda path: path.write_text("whole"))
    >>> [path.name for path in base.iterdir()]
    ['a.txt']
    """
    temporary = None
    try:
        if not is_here(final):
            put_file(final, write)
            return
        # The suffix stays: writers choose a format by it, or append it where it is missing.
        handle, name = tempfile.mkstemp(dir=final.parent, prefix=_prefix(), suffix=final.suffix)
        os.close(handle)
        temporary = Path(name)
        write(temporary)
        temporary.chmod(_permissions(0o666))
        os.replace(temporary, final)
    except OSError as error:
        if temporary is not None and not _is_of_writing(error, temporary):
            raise
        raise _not_written(final, "file", error) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file as `replace_file` does, and make the folders above it first.

    Raises
    ------
    InputError
        Where there is no room, or no permission to write.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, write)


def write_text(path: Path, text: str) -> None:
    """Write a text file as `write_whole` does."""
    write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def replace_text(final: Path, text: str) -> None:
    """Write a text file under a temporary name, then rename it: whole or not at all."""
    replace_file(final, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def remove_abandoned(folder: Path) -> None:
    """Remove temporary files and folders of processes of this machine that are gone."""
    of_this_machine = f"{TEMPORARY}{socket.gethostname()}-"
    for entry in _temporary(folder, of_this_machine):
        process = entry.name.removeprefix(of_this_machine).split("-")[0]
        if not process.isdigit() or _runs(int(process)) or entry.is_symlink():
            continue
        if entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        else:
            # Of two runs that clean up at once, one comes too late.
            entry.unlink(missing_ok=True)


@contextmanager
def owned(folder: Path, purpose: str) -> Iterator[None]:
    """Mark a folder as being written for a purpose; any number of processes may share that.

    The mark is an empty file, named as temporary ones are: `remove_abandoned` removes those of
    processes that are gone.

    Raises
    ------
    InputError
        While a process writes the folder for another purpose.

    Examples
    --------
    >>> folder = Path(tempfile.mkdtemp())
    >>> with owned(folder, "a"), owned(folder, "a"):
    ...     [path.name.endswith("-for-a") for path in folder.iterdir()]
    [True, True]
    """
    mark = put_mark(folder, f"{_prefix()}*{_PURPOSE}{purpose}")
    try:
        for other in _temporary(folder):
            if _PURPOSE in other.name and not other.name.endswith(f"{_PURPOSE}{purpose}"):
                hint = f"choose another `out`, wait, or if that process is gone remove {other}"
                raise InputError(
                    str(folder), "a folder that nothing else is made in", "another suite's", hint
                )
        yield
    finally:
        mark.unlink(missing_ok=True)


def is_being_written(folder: Path) -> bool:
    """Whether a process marks a folder as being written, for whatever purpose.

    Examples
    --------
    >>> folder = Path(tempfile.mkdtemp())
    >>> with owned(folder, "a"):
    ...     is_being_written(folder)
    True
    """
    return any(_PURPOSE in entry.name for entry in _temporary(folder))


def read_json(path: Path, limit: int) -> tuple[Any, str]:
    """The content of a JSON file of at most `limit` bytes, and the SHA-256 of its bytes.

    Raises
    ------
    InputError
        Missing, a link, too large, or no JSON.
    """
    raw = read_bounded(path, limit)
    with reading(str(path), "a JSON file", "write it again"):
        return json.loads(raw), hashlib.sha256(raw).hexdigest()


MISSING = "no such file"
"""What stands in the message on a file that a store does not have."""


def _why_not_open(error: OSError) -> str:
    """Reason of an error; a store says of a server that does not answer that it lacks the file."""
    cause = error.__cause__
    if isinstance(cause, OSError) and not isinstance(cause, FileNotFoundError):
        return first_line(cause)
    return error.strerror or MISSING


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file for reading; no link is followed and no pipe is waited for.

    Raises
    ------
    InputError
        If there is no such file.
    """
    try:
        if not is_here(path):
            return cast(BinaryIO, path.open("rb"))
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        found = "a link" if path.is_symlink() else _why_not_open(error)
        raise InputError(str(path), "a readable file", found, "check the path") from None
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise InputError(str(path), "a regular file", "something else", "check the path")
    return os.fdopen(handle, "rb")


def read_bounded(path: Path, limit: int) -> bytes:
    """The bytes of a regular file of at most `limit` bytes; of a larger one nothing is read.

    Raises
    ------
    InputError
        Missing, a link, or too large.
    """
    with open_regular(path) as file:
        # Python would ask for the memory of as many bytes as it shall read at most.
        size = file.seek(0, os.SEEK_END)
        if size <= limit:
            file.seek(0)
            return file.read(size)
    raise InputError(str(path), f"at most {limit} bytes", f"{size}", "is this file from malus?")


def digest(path: Path) -> tuple[int, str]:
    """Size and SHA-256 of a regular file."""
    with open_regular(path) as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
        return file.seek(0, os.SEEK_END), sha256


def check_digest(path: Path, size: int, sha256: str, hint: str) -> None:
    """Compare a file with its recorded size and hash, the size first.

    Raises
    ------
    InputError
        If it is missing, cut or changed.
    """
    with open_regular(path) as file:
        actual_size = file.seek(0, os.SEEK_END)
        if actual_size != size:
            raise InputError(str(path), f"{size} bytes", f"{actual_size} bytes", hint)
        file.seek(0)
        actual_sha256 = hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
    if actual_sha256 != sha256:
        raise InputError(str(path), f"SHA-256 {sha256}", actual_sha256, hint)


def _temporary(folder: Path, beginning: str = TEMPORARY) -> list[Path]:
    """Entries of a folder with temporary names; none where there is no folder."""
    try:
        return [entry for entry in folder.iterdir() if entry.name.startswith(beginning)]
    except (FileNotFoundError, NotADirectoryError):
        return []


def _temporary_folder(parent: Path) -> Path:
    return Path(tempfile.mkdtemp(dir=parent, prefix=_prefix()))


def _permissions(most: int) -> int:
    """Permissions of what this process makes: `most` but for its umask, as Linux tells it.

    `os.umask` tells it only by setting another, for all threads.
    """
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/self/status").read_text("utf-8", "replace").splitlines():
            if line.startswith("Umask:"):
                return most & ~int(line.split()[1], 8)
    return most & ~0o022


def _prefix() -> str:
    """Beginning of this process's temporary names, by which `remove_abandoned` knows its owner."""
    return f"{TEMPORARY}{socket.gethostname()}-{os.getpid()}-"


def _runs(process: int) -> bool:
    """Whether a process of that number is running."""
    with contextlib.suppress(PermissionError):
        try:
            os.kill(process, 0)
        except (ProcessLookupError, OverflowError):
            return False
    return True
