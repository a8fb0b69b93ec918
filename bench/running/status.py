"""How far a run or a dataset is: what is done, what failed and why, and what is left."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from malus.bench.running.parts import PLAN, Failure, Parts
from malus.renderers.datasets.dataset_record import DATASET, read_dataset
from malus.renderers.datasets.listed_scenes import listed_of
from malus.renderers.datasets.part_list import read_parts
from malus.scenes.core.errors import InputError, printable
from malus.scenes.core.files import read_json
from malus.scenes.core.remote import as_path
from malus.scenes.core.result_files import PARTS, RUN

MAX_PLAN_BYTES = 1 << 28

_ID = re.compile(r"[0-9a-f]{16}")


@dataclass(frozen=True)
class PartStatus:
    """How far a part of a dataset is: its name, such as `3/16`, and numbers of scenes."""

    part: str
    total: int
    done: int
    failed: int


@dataclass
class Status:
    """How far a run or a dataset is.

    Attributes
    ----------
    what : str
        'run' or 'dataset', and of which suite.
    unit : str
        What is counted: 'families' or 'scenes'.
    failed : list of (label of the family, Failure)
        One a family and reason.
    finished : bool
        Nothing is left, and the results are written.
    parts : list of PartStatus
        Parts of a dataset that are rendered one by one, as far as they have begun.

    Examples
    --------
    >>> half = Status("run of quick", "families", total=8, done=4, left=3)
    >>> half.failed_families, half.finished
    (1, False)
    """

    what: str
    unit: str
    total: int = 0
    done: int = 0
    left: int = 0
    failed: list[tuple[str, Failure]] = field(default_factory=list)
    finished: bool = False
    parts: list[PartStatus] = field(default_factory=list)

    @property
    def failed_families(self) -> int:
        """Families of which something failed."""
        return self.total - self.done - self.left

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        reasons = [
            {
                "family": label,
                "scene": failure.scene,
                "method": failure.method,
                "reason": failure.reason,
            }
            for label, failure in self.failed
        ]
        return {
            "what": self.what,
            "unit": self.unit,
            "total": self.total,
            "done": self.done,
            "failed": self.failed_families,
            "left": self.left,
            "finished": self.finished,
            "failures": reasons,
            "parts": [asdict(part) for part in self.parts],
        }


def status(folder: Path | str) -> Status:
    """Read how far a run or a dataset is; nothing is changed, also while it is being made.

    Parameters
    ----------
    folder : path or URL of a folder

    Returns
    -------
    Status
        What is done, failed and left.

    Raises
    ------
    InputError
        If the folder holds neither, or a run whose plan is lost.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> _ = (folder / "plan.json").write_text('{"suite": "a", "suite_id": "b", "methods": ["eq8"], '
    ...     '"families": [{"id": "0123456789abcdef", "label": "sphere", "scenes": 2}]}')
    >>> status(folder).left
    1
    """
    folder = as_path(folder)
    if (folder / PLAN).exists():
        return _of_run(folder)
    if (folder / DATASET).exists():
        return _of_dataset(folder)
    if (folder / PARTS).exists():
        hint = "give the same `malus run` again: it takes over what is done"
        raise InputError(str(folder / PLAN), "the plan of a run", "none, but parts of a run", hint)
    expected = f"{PLAN} of a run or {DATASET} of a dataset"
    raise InputError(
        str(folder), expected, "neither", "give the folder that `malus run` or `malus render` wrote"
    )


def _of_run(folder: Path) -> Status:
    planned = read_json(folder / PLAN, MAX_PLAN_BYTES)[0]
    try:
        families = list(_families(planned))
        methods = _called(planned["methods"])
        progress = Status(f"run of {planned['suite']}", "families", total=len(families))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            str(folder / PLAN), "the plan of a run", repr(error), "give the `malus run` again"
        ) from None
    parts = Parts(folder)
    for name, label in families:
        there = parts.methods(name)
        lacking = {
            method
            for method, reference in methods.items()
            if method not in there or reference not in (None, there[method])
        }
        failures = [
            failure
            for failure in parts.failures(name)
            if failure.method is None or failure.method in lacking
        ]
        if not lacking:
            progress.done += 1
        elif failures:
            progress.failed += [(label, failure) for failure in failures]
        else:
            progress.left += 1
    expected = {"suite_id": planned.get("suite_id"), "families_failed": progress.failed_families}
    progress.finished = not progress.left and _is_written(folder, expected)
    return progress


def _called(methods: Mapping[str, str] | Sequence[str]) -> dict[str, str | None]:
    """How each method is called; None where the plan of an earlier version lists names alone."""
    if isinstance(methods, Mapping):
        return {str(name): str(reference) for name, reference in methods.items()}
    return dict.fromkeys(map(str, methods))


def _families(planned: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for family in planned["families"]:
        # The id becomes a file name: nothing else may lead out of the folder.
        if not _ID.fullmatch(family["id"]):
            raise ValueError(family["id"])
        yield family["id"], printable(str(family["label"]))


def _is_written(folder: Path, expected: Mapping[str, Any]) -> bool:
    """Whether the results are those of these parts, not of an earlier run in the folder."""
    try:
        record = read_json(folder / RUN, MAX_PLAN_BYTES)[0]
    except InputError:
        return False
    return isinstance(record, dict) and expected.items() <= record.items()


def _of_dataset(folder: Path) -> Status:
    """How far a dataset is, by `dataset.json` and the lists of its parts; no scene is read."""
    record = read_dataset(folder)[0]
    name = printable(str((record.suite or {}).get("name", "scenes")))
    listed = listed_of(folder, record.renders)
    done, failed = len(listed.done), list(listed.failed.values())
    left = max(record.planned - done - len(failed), 0)
    failures = [
        (
            printable(scene.label),
            Failure(scene.scene, None, printable(scene.reason), scene.mendable),
        )
        for scene in failed
    ]
    parts = [
        PartStatus(each.part.label, each.part.planned, len(each.done), len(each.failed))
        for each in read_parts(folder)
        if each.part.renders == record.renders and each.part.count > 1
    ]
    total = max(record.planned, done + len(failed))
    # Lists of parts that were copied here are not opened before `malus render` has read them.
    finished = not left and len(record.scenes) + len(record.failed) >= total
    return Status(
        f"dataset of {name}", "scenes", total, done, left, failures, finished, parts=parts
    )
