"""Files that a scene names: the hash of their content is part of the scene's id, no folder is."""

from __future__ import annotations

import contextlib
import hashlib
from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import Field, PrivateAttr
from pydantic.json_schema import SkipJsonSchema

from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.model import FOUND_IN, PARSED, Model


class NamedFile(Model):
    """Base of the parts of a scene that are read from a file; `digest` is the hash of its bytes.

    Made in Python, it has the digest of the file as it is at that moment, and its path becomes the
    file's name and the folder that it was `found_in`. The folder is no part of its id or of what
    it equals. Parsed data open no file: a suite looks for its own, and a dataset keeps copies.
    """

    file_kind: ClassVar[str]
    """Kind of file, for error messages."""
    file_key: ClassVar[str] = "path"
    """Field of the file's name."""
    digest: str = ""
    found_in: SkipJsonSchema[str] = Field(default="", exclude_if=lambda folder: not folder)
    _file: Path | None = PrivateAttr(default=None)
    _folder: Path | None = PrivateAttr(default=None)

    def model_post_init(self, context: Any, /) -> None:
        """Digest the file, unless there is none here or the data were parsed."""
        file = Path(self.found_in, self.file_name or "")
        if context == PARSED or not (self.file_name and file.name):
            return
        with contextlib.suppress(InputError):  # told when it is read
            self._place(file, self.digest or digest_of(file, self.file_kind))

    def __eq__(self, other: object) -> bool:
        """Whether both are of the same content, wherever it lies."""
        return type(self) is type(other) and self._content == other._content

    def __hash__(self) -> int:
        """Hash of the content."""
        return hash(self._content)

    @property
    @abstractmethod
    def file_name(self) -> str | None:
        """The file's path in the scene; None where there is no file."""

    @property
    def file(self) -> Path:
        """The path that is read: the one in the scene, unless a dataset keeps a copy."""
        return self._file or Path(self._folder or self.found_in, self.file_name or "")

    @property
    def was_found(self) -> bool:
        """Whether the file was looked up here; that of data that were only parsed was not."""
        return self._folder is not None

    def located(self, folder: Path) -> Self:
        """The same part with the digest of its file, whose path counts from a folder.

        Raises
        ------
        InputError
            If the file cannot be read, or has another digest than the part.
        """
        file = folder / self.found_in / (self.file_name or "")
        digest = digest_of(file, self.file_kind)
        if self.digest not in ("", digest):
            hint = "leave the digest out, or find the file that has it"
            expected = f"a {self.file_kind} with digest {self.digest}"
            raise InputError(str(file), expected, digest, hint)
        found = self.model_copy()
        found._place(file, digest)
        return found

    def read_from(self, file: Path) -> Self:
        """The same part, with the same id, read from another file."""
        moved = self.model_copy()
        moved._file = file
        return moved

    def checked(self) -> Path:
        """The path that is read, after comparing its content with the digest.

        Raises
        ------
        InputError
            If its content does not match the digest, there is no digest, or it cannot be read.
        """
        actual = digest_of(self.file, self.file_kind)
        if not self.digest:
            # Whatever is cached by it would outlive a change of the file.
            expected = f"a {self.file_kind} that was there when the scene was made"
            hint = "make the scene again, now that the file is there"
            raise InputError(str(self.file), expected, "a later one", hint)
        if self.digest != actual:
            expected = f"a {self.file_kind} with digest {self.digest}"
            hint = "the file changed: give the command again, or find the old one"
            raise InputError(str(self.file), expected, actual, hint)
        return self.file

    def _place(self, file: Path, digest: str) -> None:
        """Take the name, the folder and the digest of a file."""
        folder = "" if file.parent == Path() else str(file.parent)
        self.__dict__.update({self.file_key: file.name, FOUND_IN: folder, "digest": digest})
        self._folder = file.parent.absolute()

    @property
    def _content(self) -> tuple[object, ...]:
        """What is compared: where the file lies counts only as long as nobody knows its digest."""
        parts = tuple(value for key, value in self.__dict__.items() if key != FOUND_IN)
        return parts if self.digest else (*parts, self.file)


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
