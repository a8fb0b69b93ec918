"""Cores and memory that this process and others beside it may use, also of graphics cards."""

from __future__ import annotations

import math
import os
import subprocess
from contextlib import suppress
from pathlib import Path


def usable_cores() -> int:
    """Number of cores that this process may use: those of its affinity, where there is one.

    A scheduler or `taskset` may allow fewer than the machine has.

    Examples
    --------
    >>> 1 <= usable_cores() <= (os.cpu_count() or 1)
    True
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def free_memory(root: Path = Path("/")) -> float:
    """Bytes that new processes may take: of the machine, or of a container that has fewer.

    Infinite where the system does not tell, which is so but for Linux.

    Examples
    --------
    >>> free_memory() > 0
    True
    """
    free = math.inf
    with suppress(OSError, ValueError, IndexError):
        lines = (root / "proc/meminfo").read_text(encoding="ascii").splitlines()
        free = min(1024.0 * int(line.split()[1]) for line in lines if "MemAvailable:" in line)
    with suppress(OSError, ValueError, KeyError):  # "max" where there is no limit
        group = root / "sys/fs/cgroup"
        limit, used = (int((group / f"memory.{name}").read_text()) for name in ("max", "current"))
        details = (group / "memory.stat").read_text(encoding="ascii").splitlines()
        files = int(dict(line.split(maxsplit=1) for line in details)["inactive_file"])
        free = min(free, max(0, limit - used + files))  # files that were read give way
    return free


def free_card_memory() -> float:
    """Bytes that new processes may take of the NVIDIA card with the least; 0 where nobody tells.

    So it is where a card takes one process only, or is divided into several.

    Examples
    --------
    >>> free_card_memory() >= 0
    True
    """
    asked = "memory.free,compute_mode,mig.mode.current"
    command = ["nvidia-smi", f"--query-gpu={asked}", "--format=csv,noheader,nounits"]
    try:
        told = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True)
        cards = [line.split(", ") for line in told.stdout.strip().splitlines()]
        shared = all(mode == "Default" and parts != "Enabled" for _, mode, parts in cards)
        return min(float(free) for free, _, _ in cards) * 2.0**20 * shared
    except (OSError, ValueError, subprocess.SubprocessError):
        return 0.0
