"""A thread that writes the truths of a dataset while the next ones are rendered."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Self

from malus.bench.running.parts import Failure
from malus.bench.running.plan import FamilyPlan
from malus.renderers.datasets.dataset_record import FailedScene
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.truth import Truth


class WritingThread:
    """Writes truths in a thread of its own, one after the other, while the next is rendered.

    At most one is written at a time, so that memory holds that one and the next. As a context
    manager it waits for the last one, also after an error or Ctrl-C: no scene is left half written.

    Attributes
    ----------
    truths, bytes : int
        Number of truths that were written, and of bytes.
    """

    def __init__(self, writer: DatasetWriter, origins: Mapping[str, str]) -> None:
        self.truths = self.bytes = 0
        self._writer, self._origins = writer, origins
        self._thread = ThreadPoolExecutor(1, "malus-writes")
        self._in_work: Future[None] | None = None

    def __enter__(self) -> Self:
        """Start nothing yet."""
        return self

    def __exit__(self, *_: object) -> None:
        """Wait for what is being written; `wait` tells its errors."""
        self._thread.shutdown()

    def wait(self) -> None:
        """Wait for what is being written.

        Raises
        ------
        InputError
            If it could not be written.
        """
        if self._in_work is not None:
            self._in_work.result()
            self._in_work = None

    def begin(self, outcome: Truth | Failure, family: FamilyPlan) -> None:
        """Begin to write a truth, or to record why there is none; `wait` comes before."""
        assert self._in_work is None
        self._in_work = self._thread.submit(self._write, outcome, family)

    def _write(self, outcome: Truth | Failure, family: FamilyPlan) -> None:
        """Write a truth, or record a failure: without a scene, it is one of all without a truth."""
        writer = self._writer
        if isinstance(outcome, Truth):
            name = outcome.scene.id
            writer.add(outcome, self._origins[name])
            self.bytes += sum(file.stat().st_size for file in (writer.folder / name).iterdir())
            self.truths += 1
            return
        scenes = [scene.id for scene in family.scenes]
        for name in scenes if outcome.scene is None else [outcome.scene]:
            if name not in writer.done:
                writer.fail(
                    FailedScene(
                        scene=name,
                        origin=self._origins[name],
                        label=family.label,
                        reason=outcome.reason,
                        mendable=outcome.mendable,
                    )
                )
