"""Engines of a run: one worker process, or a Dask cluster on this machine or on many.

A task is a few kilobytes of parameters and its result is a table, so that no image passes through
the scheduler or the network but those of the few examples. This process alone writes to the folder
of the run; workers need no disk and share none.

Where a worker dies, is killed for its memory or loses its connection, Dask gives its family to
another worker. A worker whose family takes too long ends itself. A family that has killed
`ATTEMPTS` workers is recorded as failed. A worker with other versions or files ends the run
(`worker_check`), and so does a cluster without any worker.
"""

from __future__ import annotations

import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import islice
from multiprocessing import resource_tracker
from typing import Any

from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.inside_worker import at_most
from malus.bench.running.parts import Failure
from malus.bench.running.work import Engine, in_worker_process, work
from malus.bench.running.worker_check import UnfitWorker, check_workers, fit_variant, made_with
from malus.bench.running.worker_process import TIMEOUT_SECONDS, WorkerProcess, main_hidden
from malus.renderers.variant import BACKENDS, Variant
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.model import content_id

ATTEMPTS = 3
"""Workers that one family may kill before it is recorded as failed."""

WAITING = 32
"""Tasks that wait at the scheduler, besides two for every thread: enough that no worker idles."""

CONNECT_SECONDS = 30
"""Longest wait for a scheduler and its first worker."""

WITHOUT_WORKERS_SECONDS = 300.0
"""Longest wait for a worker after all were lost: as long as Dask takes to miss one."""

POLL_SECONDS = 0.02
"""Time after which it is looked again whether a task is finished."""

FILES, FILES_A_WORKER = 24, 12
"""Open files that a new cluster takes; 17 to 22, and 7 to 10 a worker, were counted."""

_one_at_a_time = threading.Lock()
"""Held during a family: Mitsuba's variant is one for all threads of a worker."""


@contextmanager
def engine(
    variant: Variant,
    workers: int | None,
    scheduler: str | None,
    timeout: float = TIMEOUT_SECONDS,
) -> Iterator[Engine]:
    """Engine for a run: one worker process, a new cluster, or one that runs already.

    Dask is imported for a cluster only.

    Parameters
    ----------
    variant : Variant
        What every worker renders with.
    workers : int, optional
        Starts a cluster of so many processes on this machine, and stops it at the end.
    scheduler : str, optional
        Address of a cluster that runs already; it is left as it is.
    timeout : float
        Seconds that a family may take.

    Raises
    ------
    InputError
        Both at once, a number of workers below one, a timeout that is not above 0, Dask missing,
        no scheduler at the address.
    """
    if workers is None and scheduler is None:
        with WorkerProcess(timeout) as worker:
            yield in_worker_process(variant, worker)
        return
    with WorkerProcess(timeout), cluster_client(workers, scheduler) as client:
        yield lambda tasks: spread(tasks, client, variant, timeout)


@contextmanager
def cluster_client(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    """Client of a new cluster of processes of this machine, or of one that runs already.

    Raises
    ------
    InputError
        Both at once, a number of workers below one, or more than this machine can start, Dask
        missing, no scheduler at the address.
    """
    if workers is not None and scheduler is not None:
        raise InputError("workers, scheduler", "one of the two", "both", "leave one out")
    if workers is not None and workers < 1:
        raise InputError("workers", "a number of at least 1", str(workers), "leave it out")
    with ExitStack() as stack:
        yield _local(workers, stack) if workers else _existing(str(scheduler), stack)


def spread(
    tasks: Iterable[FamilyTask], client: Any, variant: Variant, timeout: float = TIMEOUT_SECONDS
) -> Iterator[tuple[FamilyTask, FamilyResult]]:
    """Yield tasks and results of a cluster in the order in which they finish.

    A few tasks at a time are handed over to the scheduler.

    Raises
    ------
    InputError
        If the scheduler is lost, all workers are, or one has other versions or files.
    """
    check_workers(client)
    source = iter(tasks)
    threads = sum(client.nthreads().values())
    running = {}
    finished = _distributed().as_completed(loop=client.loop)

    def hand_over(count: int) -> None:
        for task in islice(source, count):
            made = made_with(task)
            given = (task, variant.name, timeout, made)
            future = client.submit(_remote, *given, key=_key(task, made), pure=False)
            running[future.key] = task
            finished.add(future)

    hand_over(WAITING + 2 * threads)
    while running:
        _wait_for_next(finished, client)
        future = next(finished)
        task = running.pop(future.key)
        result = _result(future)
        # The scheduler forgets the table at once: its memory does not grow with the run.
        future.release()
        yield task, result
        hand_over(1)


def _wait_for_next(finished: Any, client: Any) -> None:
    """Wait until a task is finished; not for ever while there is no worker.

    Raises
    ------
    InputError
        If there is none for `WITHOUT_WORKERS_SECONDS`.
    """
    last_seen = last_asked = time.monotonic()
    while not finished.has_ready():
        time.sleep(POLL_SECONDS)
        now = time.monotonic()
        if now < last_asked + 1.0:
            continue
        last_asked = now
        with suppress(Exception):  # a scheduler that is lost is told by the tasks
            last_seen = now if client.nthreads() else last_seen
        if now > last_seen + WITHOUT_WORKERS_SECONDS:
            found = f"none for {WITHOUT_WORKERS_SECONDS:g} s"
            hint = "start `dask worker ADDRESS`, and give the command again"
            raise InputError("scheduler", "one with a worker", found, hint)


def _remote(
    task: FamilyTask, variant: str, timeout: float, expected: dict[str, str]
) -> FamilyResult:
    """Do one task on a worker, with the worker's own variant of that name."""
    worker = _distributed().get_worker()
    stop_profiler(worker)
    with _one_at_a_time:
        own_variant = fit_variant(variant, task, expected, worker.address)
        with at_most(timeout):
            return work(task, own_variant)


def spread_parts(
    render: Callable[[str, str], None], parts: Sequence[str], client: Any, variant: Variant
) -> Iterator[str]:
    """Let a cluster call `render(part, backend)` for every part; yields those that are finished.

    A part whose workers died is left as it is: who makes the whole tries what it lacks.

    Raises
    ------
    InputError
        If the scheduler is lost, a worker has other versions, or a part tells a mistake of the
        user's.
    """
    check_workers(client)
    backends = {name: backend for backend, name in BACKENDS.items()}
    arguments = (backends[variant.name],)
    futures = {
        client.submit(_remote_part, render, part, *arguments, pure=False): part for part in parts
    }
    for future in _distributed().as_completed(list(futures), loop=client.loop):
        if future.status == "error" and isinstance(future.exception(), InputError):
            raise future.exception()
        if future.status not in ("finished", "error"):
            hint = "give the command again"
            raise InputError("scheduler", "one that answers", f"a part {future.status}", hint)
        yield futures[future]


def _remote_part(render: Callable[[str, str], None], part: str, backend: str) -> None:
    """Render a part on a worker."""
    stop_profiler(_distributed().get_worker())
    with _one_at_a_time:
        render(part, backend)


def stop_profiler(worker: Any) -> None:
    """Stop the profiler of a Dask worker, whose samples end in a deadlock or a crash of Dr.Jit.

    It holds frames of the thread that renders. Where it lets one go last, its thread frees arrays
    of Dr.Jit, and waits for a lock that the rendering thread has, which waits for Python's.
    """
    for name in ("profile", "profile-cycle"):
        callback = worker.periodic_callbacks.get(name)
        if callback is not None:
            worker.loop.add_callback(callback.stop)


def _key(task: FamilyTask, made: dict[str, str]) -> str:
    """Name of a task at the scheduler, by its content: runs on one cluster share what both need.

    `made` is of `made_with`: a method whose file has changed is another.
    """
    return f"malus-{content_id([task.id, task.methods, made, sorted(task.examples)])}"


def _result(future: Any) -> FamilyResult:
    """Result of a future that is finished; a task that failed gives a result that says so.

    Raises
    ------
    InputError
        If the scheduler is lost, or the worker is not fit for any task.
    """
    if future.status == "finished":
        return future.result()
    if future.status != "error":
        raise InputError(
            "scheduler", "one that answers", f"a task {future.status}", "give the command again"
        )
    error = future.exception()
    if isinstance(error, UnfitWorker):
        raise error
    if type(error).__name__ == "KilledWorker":
        killed = error.allowed_failures + 1  # of a cluster that was there, as its owner chose
        reason = f"{killed} workers died of it (memory, time, or a crash of the renderer)"
        return FamilyResult(failures=[Failure(None, None, reason)])
    return FamilyResult(failures=[Failure.of(error)])


def _local(workers: int, stack: ExitStack) -> Any:
    """Client of a new cluster of processes with one task each, which end with this process."""
    distributed = _distributed()
    from dask import config

    _check_open_files(workers)
    settings = {
        "distributed.scheduler.allowed-failures": ATTEMPTS - 1,
        # One task a worker: a second one that waits there would be blamed for its death too.
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.worker.profile.enabled": False,  # see `stop_profiler`
    }
    stack.enter_context(config.set(settings))
    expected, hint = f"{workers} processes that start", "start fewer, or give them more memory"
    with main_hidden(), reading("workers", expected, hint):
        start = partial(
            distributed.LocalCluster,
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            # Any free port: with none named, Dask takes 8787 and warns where another has it.
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            silence_logs=logging.CRITICAL,
            preload=__name__,  # every worker calls dask_setup
        )
        cluster = stack.enter_context(_whole(start))
    return stack.enter_context(distributed.Client(cluster))


def _whole(start: Callable[[], Any]) -> Any:
    """What `start` makes, a cluster: Dask cannot close one that is stopped while it starts.

    It starts in a thread, and whoever stops that waits until the cluster is there and closed.
    Ctrl-C reaches neither the thread nor the processes that it starts.
    """
    resource_tracker.ensure_running()  # which allows Ctrl-C in the thread that starts it
    with ThreadPoolExecutor(1, initializer=_block_interrupts) as pool:
        starting = pool.submit(start)
        try:
            return starting.result()
        except BaseException:
            with suppress(Exception):  # one that did not start is told by the first
                starting.result().close()
            raise


def _block_interrupts() -> None:
    """Block Ctrl-C in this thread, and in the processes that it starts."""
    if hasattr(signal, "pthread_sigmask"):  # not on Windows
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def _check_open_files(workers: int) -> None:
    """Refuse more workers than the limit of open files allows: Dask would only print tracebacks."""
    if sys.platform == "win32":  # which has no such limit
        return
    import resource

    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    needed = FILES + FILES_A_WORKER * workers
    if resource.RLIM_INFINITY != limit < needed:
        expected = f"a limit of at least {needed} open files for {workers} workers"
        raise InputError("workers", expected, str(limit), f"start fewer, or `ulimit -n {needed}`")


def dask_setup(worker: Any) -> None:
    """Ignore Ctrl-C in a worker: the process that started it stops it and prints one line."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _existing(address: str, stack: ExitStack) -> Any:
    """Client of the cluster whose scheduler has that address."""
    distributed = _distributed()
    # A scheduler that is lost is reported in one line here, and not once more in Dask's log.
    stack.enter_context(distributed.utils.silence_logging_cmgr(logging.CRITICAL))
    hint = "is `dask scheduler` running there?"
    with reading("scheduler", "the address of a Dask scheduler", hint):
        client = stack.enter_context(distributed.Client(address, timeout=CONNECT_SECONDS))
    hint = f"start `dask worker {address}`"
    with reading(f"scheduler {address}", "a worker", hint):
        try:
            client.wait_for_workers(1, timeout=CONNECT_SECONDS)
        except TimeoutError:
            raise InputError(
                f"scheduler {address}", "a worker", f"none in {CONNECT_SECONDS} s", hint
            ) from None
    return client


def _distributed() -> Any:
    """Import Dask's package for clusters, which is optional."""
    try:
        import distributed
    except ModuleNotFoundError:
        raise InputError(
            "workers, scheduler", "the package distributed", "none", "pip install distributed"
        ) from None
    return distributed
