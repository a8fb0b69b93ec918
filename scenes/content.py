"""Files that a scene names are known by their content: its hash is part of the scene's id."""

from __future__ import annotations

import hashlib
from pathlib import Path

from malus.scenes.errors import InputError


def digest_of(path: Path, what: str) -> str:
    """First 16 hexadecimal digits of the SHA-256 of a regular file, links followed.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        # A pipe would be waited for.
        if path.exists() and not path.is_file():
            raise InputError(str(path), f"a readable {what}", "no file", "check the path")
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:16]
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(str(path), f"a readable {what}", reason, "check the path") from None


def check_content(path: Path, digest: str, what: str) -> None:
    """Compare a file with the digest in a scene, where there is one.

    Raises
    ------
    InputError
        If the file is another one, or cannot be read.
    """
    found = digest_of(path, what)
    if digest not in ("", found):
        hint = "the file changed: give the command again, or find the old one"
        raise InputError(str(path), f"a {what} with digest {digest}", found, hint)
