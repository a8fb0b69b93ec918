"""Memory of `malus render`: truths are streamed to disk, however many scenes there are.

Measured on 24² pixels: 522 MB for 100 scenes and 493 MB for 1000 of ten families, 510 MB and
491 MB where every hundred scenes are ten families more; Mitsuba and its compiler take nearly all.
"""

from __future__ import annotations

import gc
import shlex
import subprocess
import sys
from pathlib import Path

from malus.bench.datasets.render import render_dataset
from malus.renderers import Truth
from malus.scenes import Suite


def many(scenes: int) -> Suite:
    return Suite.model_validate(
        {
            "name": "many",
            "shapes": [{"kind": "sphere"}],
            "materials": [{"eta": 1.3 + 0.01 * k} for k in range(scenes // 2)],
            "surfaces": ["carbon"],
            "lights": [{"kind": "uniform"}, {"kind": "distant", "incidence_deg": 60}],
            "wavelengths_nm": [450, 550, 650],
            "methods": ["eq8"],
            "camera": {"resolution": 8},
            "sampling": {"samples": 2},
        }
    )


def test_truths_do_not_pile_up(tmp_path: Path) -> None:
    alive = []

    def count(done: int, total: int, label: str) -> None:
        # Not isinstance, which asks the dead objects behind weak references of other tests.
        alive.append(sum(type(thing) is Truth for thing in gc.get_objects()))

    gc.collect()  # what other tests left behind
    done = render_dataset(many(24), tmp_path / "data", progress=count)
    assert done["rendered"] == 24
    # One in hand, and one that the next is made beside.
    assert 1 <= max(alive) - min(alive) <= 2


def test_what_a_process_used_counts() -> None:
    """Behind a shell, because a process begins with the peak of the one that started it."""
    script = "from malus.bench.running.progress import peak_memory; {}; print(peak_memory())"
    peaks = []
    for work in ("pass", "b'x' * 300_000_000"):
        python = shlex.join([sys.executable, "-c", script.format(work)])
        command = ["sh", "-c", f"{python}; true"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        peaks.append(int(done.stdout))
    assert 290e6 < peaks[1] - peaks[0] < 330e6
