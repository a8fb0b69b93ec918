"""Parts of a run: the results of each family, kept so that a stopped run goes on later.

`plan.json` lists the families. `parts/<id>.parquet` has the rows of one, where `id` is a hash of
everything that decides them but the methods. The file lists the methods that it has, so that a
suite with one method more scores only that one. `parts/<id>.failed.json` says what could not be
done and why.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from malus.bench.running.plan import FamilyPlan
from malus.reconstruct.methods import source_of
from malus.renderers.variant import Variant, made_by
from malus.scenes.core.errors import InputError, kind_of, printable
from malus.scenes.core.files import open_regular, read_json, write_text, write_whole
from malus.scenes.core.model import content_id
from malus.scenes.core.named_file import digest_of
from malus.scenes.core.result_files import PARTS
from malus.scenes.suite import Suite

if TYPE_CHECKING:
    import pandas as pd

PLAN = "plan.json"
SCHEMA = 6
"""Number that is raised when a part's rows or attributes change: older parts are made again."""

METHODS = "methods"
"""Attribute of a part's table: the methods that it has for every scene of the family, by name."""

_MAX_BYTES = 1 << 28
_LONGEST_REASON = 500


@dataclass(frozen=True)
class Failure:
    """What could not be done, and why, in one line.

    Attributes
    ----------
    scene, method : str or None
        None means all of them.
    mendable : bool
        Whether the reason is a wrong input, which the user may have mended: it is always retried.
    stamp : str
        How the method was called, with the digest of its weights or module; empty if not known.

    Examples
    --------
    >>> Failure.of(ZeroDivisionError("by zero"), method="eq8").reason
    'ZeroDivisionError: by zero'
    """

    scene: str | None
    method: str | None
    reason: str
    mendable: bool = False
    stamp: str = ""

    @classmethod
    def of(
        cls, error: BaseException, scene: str | None = None, method: str | None = None
    ) -> Failure:
        """Describe an exception as a failure."""
        wrong_input = isinstance(error, InputError)
        reason = str(error) if wrong_input else f"{kind_of(error)}: {error}".removesuffix(": ")
        return cls(scene, method, printable(reason[:_LONGEST_REASON]), wrong_input)

    def is_final(self, retry_failed: bool) -> bool:
        """Whether a run that goes on leaves it as it is, instead of trying it again."""
        return not (retry_failed or self.mendable)


def part_id(family: FamilyPlan, suite: Suite, variant: str) -> str:
    """Hash of all that decides the rows of a family but the methods: the name of its part."""
    scored = [suite.metrics, suite.knowledge]
    decisive = [family.id, suite.renderer, *scored, variant, made_by(suite.renderer), SCHEMA]
    return content_id(decisive)


def stamped(reference: str) -> str:
    """How a method is called; with the digest of a network's weights or of a module of one's own.

    Examples
    --------
    >>> stamped("eq8"), stamped("net:missing.onnx")
    ('eq8', 'net:missing.onnx@')
    """
    source = source_of(reference)
    if source is None:
        return reference
    if not source.is_file():
        return f"{reference}@"
    status = source.stat()
    return f"{reference}@{_digest(source, status.st_mtime_ns, status.st_size)}"


def still_the_same(attributes: Mapping[str, Any]) -> dict[str, str]:
    """Methods that a part has for every scene, of its attributes: how each name was called.

    Those are left out whose weights or module have changed since. Parts of earlier versions list
    the names alone.

    Examples
    --------
    >>> still_the_same({"methods": {"eq8": "eq8", "net": "net@0123456789abcdef"}})
    {'eq8': 'eq8'}
    """
    stamps = attributes.get(METHODS, {})
    if not isinstance(stamps, dict):
        stamps = {stamp.rpartition("@")[0] or stamp: stamp for stamp in stamps}
    called = {name: (stamp.rpartition("@")[0] or stamp, stamp) for name, stamp in stamps.items()}
    return {
        name: reference
        for name, (reference, stamp) in called.items()
        if stamped(reference) == stamp
    }


@functools.lru_cache(maxsize=64)
def _digest(source: Path, _changed: int, _size: int) -> str:
    return digest_of(source, "method")


def write_plan(
    folder: Path,
    suite: Suite,
    families: Sequence[FamilyPlan],
    methods: Mapping[str, str],
    variant: Variant,
) -> None:
    """Write the list of families, and of methods and their calls, of a run for `malus status`."""
    listed = [
        {
            "id": part_id(family, suite, variant.name),
            "label": family.label,
            "scenes": len(family.scenes),
        }
        for family in families
    ]
    header = {"suite": suite.name, "suite_id": suite.id, "methods": dict(methods)}
    text = json.dumps(header | {"families": listed}, indent=1)
    write_text(folder / PLAN, text + "\n")


@dataclass(frozen=True)
class Parts:
    """The parts in the folder of a run, by name.

    Examples
    --------
    >>> import tempfile
    >>> import pandas as pd
    >>> parts = Parts(Path(tempfile.mkdtemp()))
    >>> parts.write("a", pd.DataFrame({"method": ["eq8"]}), {"eq8": "eq8"})
    >>> parts.methods("a"), parts.methods("b")
    ({'eq8': 'eq8'}, {})
    """

    folder: Path

    def table(self, name: str) -> pd.DataFrame | None:
        """Rows of a family; None where there are none, or the file is damaged."""
        if not self._path(name).exists():
            return None
        import pandas as pd

        with suppress(Exception), open_regular(self._path(name)) as file:
            return pd.read_parquet(file)  # raises anything on a broken file
        return None

    def write(self, name: str, table: pd.DataFrame, methods: Mapping[str, str]) -> None:
        """Keep the rows of a family; `methods` are those that it has for every scene.

        Each has how it is called: `eq8`, `package.module:object`, `net:FILE.onnx`.
        """
        # pandas stores attributes with the Parquet file: they come back when a run goes on.
        table.attrs[METHODS] = {method: stamped(methods[method]) for method in sorted(methods)}
        write_whole(self._path(name), lambda path: table.to_parquet(path, index=False))

    def methods(self, name: str) -> dict[str, str]:
        """Methods that a part has for every scene and how they are called; reads its footer."""
        import pyarrow.parquet as pq

        with suppress(Exception), open_regular(self._path(name)) as file:
            metadata = pq.read_schema(file).pandas_metadata or {}  # raises anything, too
            return still_the_same(metadata.get("attributes", {}))
        return {}

    def failures(self, name: str) -> tuple[Failure, ...]:
        """What of a family could not be done; a damaged record counts as none."""
        path = self._failed(name)
        if not path.exists():
            return ()
        try:
            return tuple(Failure(**entry) for entry in read_json(path, _MAX_BYTES)[0]["failures"])
        except (InputError, TypeError, KeyError):
            return ()

    def write_failures(self, name: str, label: str, failures: Sequence[Failure]) -> None:
        """Record what could not be done; without failures, remove an earlier record."""
        path = self._failed(name)
        if not failures:
            path.unlink(missing_ok=True)
            return
        record = {"family": label, "failures": [asdict(failure) for failure in failures]}
        text = json.dumps(record, indent=1)
        write_text(path, text + "\n")

    def _path(self, name: str) -> Path:
        return self.folder / PARTS / f"{name}.parquet"

    def _failed(self, name: str) -> Path:
        return self.folder / PARTS / f"{name}.failed.json"


def merged(
    old: pd.DataFrame | None, new: pd.DataFrame | None, again: Iterable[str]
) -> pd.DataFrame | None:
    """Join two tables of a family; rows of methods done `again` come from the new one alone."""
    import pandas as pd

    if old is None:
        return new
    kept = old[~old.method.isin(list(again))]
    tables = [table for table in (kept, new) if table is not None and len(table)]
    if not tables:
        return None
    table = pd.concat(tables, ignore_index=True)
    table.attrs = dict((old if new is None else new).attrs)
    return table


def in_order(table: pd.DataFrame, family: FamilyPlan, methods: Iterable[str]) -> pd.DataFrame:
    """Rows of `methods`, ordered by the family's scenes and the methods."""
    import pandas as pd

    scene_order = pd.Index(list(dict.fromkeys(family.scene_ids)))
    method_order = pd.Index(list(dict.fromkeys(methods)))
    rows = table[table.method.isin(method_order)]
    scene_rank = scene_order.get_indexer(rows.scene)
    rank = scene_rank * len(method_order) + method_order.get_indexer(rows.method)
    ordered = rows.iloc[rank.argsort(kind="stable")].reset_index(drop=True)
    ordered.attrs = dict(table.attrs)
    return ordered
