"""Hostile files for every reader: `python tests/fuzz.py --minutes 10`.

Hypothesis changes valid files; a child process with little memory reads them. Anything but a result
or an InputError is a finding: it is shrunk and kept in tests/reference/fuzz, which test_fuzz.py
replays. `--guided READER` lets atheris look for new paths through the code instead (Linux;
`pip install atheris`).
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import resource
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from malus.bench.running.worker_process import WorkerProcess

SEEDS = Path(__file__).parent / "reference" / "fuzz"
MEMORY_BYTES = 3 << 30
"""More than a reader may take for these tiny files, above what Python and its libraries map."""
SECONDS = 60.0
ROUND = 200

TOKENS = (
    b"nan", b"inf", b"-1", b"1e999", b"99999999999999999999", b"{}", b"[]", b"null", b'""', b"\0",
    b"\n", b"../", b"/etc/passwd", b"\xff\xfe", b"[" * 2000, b'"' + b"x" * 5000 + b'"', b"0x7fff",
)  # fmt: skip
NUMBERS = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 0x7FFFFFFFFFFFFFFF)


def changed(content: bytes, changes: list[tuple[str, float, int]]) -> bytes:
    """A content with changes: (kind, place as a share of the length, number)."""
    raw = bytearray(content)
    for kind, share, number in changes:
        at = int(share * len(raw))
        if kind == "flip" and at < len(raw):
            raw[at] ^= 1 << number % 8
        elif kind == "byte" and at < len(raw):
            raw[at] = number % 256
        elif kind == "cut":
            del raw[at:]
        elif kind == "drop":
            del raw[at : at + number % 64]
        elif kind == "repeat":
            raw[at:at] = raw[at : at + 1 + number % 64] * (1 + number % 40)
        elif kind == "number":
            value = NUMBERS[number % len(NUMBERS)]
            size = 8 if value > 0xFFFFFFFF else 4
            order = "<" if number % 2 else ">"
            raw[at : at + size] = struct.pack(order + ("Q" if size == 8 else "I"), value)
        elif kind == "token":
            raw[at : at + number % 8] = TOKENS[number % len(TOKENS)]
    return bytes(raw)


def limited_verdict(name: str, content: bytes) -> Iterator[str | None]:
    """The verdict, in a child whose memory is bounded."""
    from fuzz_readers import READERS, verdict

    if resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY:
        for each, reader in READERS.items():
            verdict(each, reader.valid())  # imports what it needs
        # What libraries print about a broken file is no finding, and there is much of it.
        for stream in (1, 2):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
        mapped = int(Path("/proc/self/statm").read_text("ascii").split()[0])
        limit = mapped * resource.getpagesize() + MEMORY_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    yield verdict(name, content)


def search(
    child: WorkerProcess, name: str, valid: bytes, known: set[str], seed: int
) -> tuple[int, str, bytes]:
    """One round on a reader: the executions, and what was found anew, shrunk."""
    from hypothesis import HealthCheck, Phase, given, settings
    from hypothesis import seed as seeded
    from hypothesis import strategies as st

    from malus.bench.running.worker_process import Died

    kinds = ("flip", "byte", "cut", "drop", "repeat", "number", "token")
    change = st.tuples(st.sampled_from(kinds), st.floats(0, 1), st.integers(0, 1 << 16))
    count, found, worst = 0, "", b""

    @seeded(seed)
    @settings(
        max_examples=ROUND,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @given(st.lists(change, min_size=1, max_size=6))
    def holds(changes: list[tuple[str, float, int]]) -> None:
        nonlocal count, found, worst
        content = changed(valid, changes)
        count += 1
        try:
            (wrong,) = child.stream(limited_verdict, name, content)
        except Died as death:
            wrong = str(death)
        if wrong and wrong not in known:
            found, worst = wrong, content
            raise AssertionError(wrong)

    try:
        holds()
    except AssertionError:
        known.add(found)
    return count, found, worst


def fuzz(minutes: float, names: list[str], seed: int) -> int:
    """Rounds over all readers until the time is over; the number of findings."""
    from fuzz_readers import READERS

    from malus.bench.running.worker_process import WorkerProcess

    executions = dict.fromkeys(names, 0)
    known: dict[str, set[str]] = {name: set() for name in names}
    ends = time.monotonic() + 60 * minutes
    child = WorkerProcess(SECONDS)
    while time.monotonic() < ends:
        for name in names:
            seed += 1
            count, found, content = search(child, name, READERS[name].valid(), known[name], seed)
            executions[name] += count
            if found:
                path = SEEDS / f"{name}.{hashlib.sha256(content).hexdigest()[:8]}"
                path.write_bytes(content)
                sys.stdout.write(f"FOUND {path.name}: {found}\n")
            if time.monotonic() > ends:
                break
    child.__exit__()
    for name, count in executions.items():
        sys.stdout.write(f"{count:8d} {name}\n")
    findings = sum(map(len, known.values()))
    sys.stdout.write(f"{sum(executions.values()):8d} in all, {findings} findings\n")
    return findings


def guided(name: str, minutes: float) -> None:
    """Let atheris mutate towards new branches of malus and the pure Python parsers.

    Only modules that are imported here are instrumented: no other function of this file that was
    called before may import malus, and none is imported at the top.
    """
    import atheris

    with atheris.instrument_imports(include=["malus", "tomllib", "trimesh", "json"]):
        from fuzz_readers import READERS, verdict

    def one(content: bytes) -> None:
        wrong = verdict(name, content)
        if wrong:
            raise AssertionError(wrong)

    corpus = Path(__file__).resolve().parents[1] / "build" / "fuzz" / name
    corpus.mkdir(parents=True, exist_ok=True)
    (corpus / "valid").write_bytes(READERS[name].valid())
    options = [f"-max_total_time={int(60 * minutes)}", "-rss_limit_mb=4096", "-timeout=60"]
    atheris.Setup([sys.argv[0], *options, f"-artifact_prefix={SEEDS}/{name}.", str(corpus)], one)
    atheris.Fuzz()


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=random.randrange(1 << 30))
    parser.add_argument("--reader", action="append", help="only this reader; may be repeated")
    parser.add_argument("--guided", help="let atheris search this reader")
    options = parser.parse_args()
    SEEDS.mkdir(exist_ok=True)
    if options.guided:
        guided(options.guided, options.minutes)
        return
    from fuzz_readers import READERS

    sys.exit(fuzz(options.minutes, options.reader or list(READERS), options.seed) > 0)


if __name__ == "__main__":
    main()
