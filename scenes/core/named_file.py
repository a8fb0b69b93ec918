"""Files that a scene names: the hash of their content is part of the scene's id."""

from __future__ import annotations

import hashlib
from abc import abstractmethod
from pathlib import Path
from typing import ClassVar, Self

from pydantic import PrivateAttr

from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.model import Model


class NamedFile(Model):
    """Base of the parts of a scene that are read from a file; `digest` is the hash of its bytes."""

    file_kind: ClassVar[str]
    """Kind of file, for error messages."""
    digest: str = ""
    _file: Path | None = PrivateAttr(default=None)

    @property
    @abstractmethod
    def file_name(self) -> str | None:
        """The file's path in the scene; None where there is no file."""

    @property
    def file(self) -> Path:
        """The path that is read: the one in the scene, unless a dataset keeps a copy."""
        return self._file or Path(self.file_name or "")

    def read_from(self, file: Path) -> Self:
        """The same part, with the same id, read from another file."""
        moved = self.model_copy()
        moved._file = file
        return moved

    def checked(self) -> Path:
        """The path that is read, after comparing its content with the digest, if there is one.

        Raises
        ------
        InputError
            If its content does not match the digest, or it cannot be read.
        """
        actual = digest_of(self.file, self.file_kind)
        if self.digest not in ("", actual):
            expected = f"a {self.file_kind} with digest {self.digest}"
            hint = "the file changed: give the command again, or find the old one"
            raise InputError(str(self.file), expected, actual, hint)
        return self.file


def digest_of(path: Path, file_kind: str) -> str:
    """First 16 hexadecimal digits of the SHA-256 of a regular file, links followed.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    with reading(str(path), f"a readable {file_kind}", "check the path"):
        # A pipe would be waited for.
        if path.exists() and not path.is_file():
            raise InputError(str(path), f"a readable {file_kind}", "no file", "check the path")
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:16]
