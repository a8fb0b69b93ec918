"""Folders on the command line: a path, or a URL of a store."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click


class Place(click.ParamType[Path]):
    """A path, or a URL such as s3://bucket/folder."""

    name = "path"

    def convert(self, value: Any, param: object, ctx: object) -> Path:
        """The path of a text; a URL needs fsspec, which is imported only then."""
        del param, ctx  # click's; nothing here depends on them
        if not str(value):  # an unset variable of a shell, which would be the current folder
            self.fail("expected a path, found an empty text; is a variable unset?")
        if isinstance(value, Path) or "://" not in str(value):
            return Path(value)
        from malus.scenes.core.remote import as_path

        return as_path(value)


PLACE = Place()
