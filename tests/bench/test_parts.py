"""Parts of a run know which methods they hold, by which weights and of which code of one's own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from runs import NOBODY, SMALL, SUITE

from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.parts import Parts
from malus.bench.running.runner import run
from malus.bench.running.status import status
from malus.bench.running.work import in_this_process
from malus.renderers.variant import choose
from malus.scenes import InputError
from malus.scenes.core.result_files import EXAMPLES, PARTS


def test_a_network_of_other_weights_is_scored_anew(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="no onnx; pip install onnx")
    from networks import edges

    model = edges(tmp_path / "mine.onnx")
    parts, called = Parts(tmp_path), {"eq8": "eq8", f"net:{model}": f"net:{model}"}
    parts.write("a", pd.DataFrame({"method": called}), called)
    assert parts.methods("a") == called
    edges(model, slope=0.2)
    assert parts.methods("a") == {"eq8": "eq8"}
    model.unlink()
    assert parts.methods("a") == {"eq8": "eq8"}


def test_the_network_that_malus_brings_is_kept(tmp_path: Path) -> None:
    parts, called = Parts(tmp_path), {name: name for name in ("eq8", "net", "net-around")}
    parts.write("a", pd.DataFrame({"method": called}), called)
    assert parts.methods("a") == called


def test_parts_of_earlier_versions_list_names_alone(tmp_path: Path) -> None:
    """Else `malus status` said of a finished run that all is left."""
    parts, table = Parts(tmp_path), pd.DataFrame({"method": ["eq8", "net"]})
    parts.write("a", table, {"eq8": "eq8"})
    table.attrs = {"methods": ["eq8", "net@0123456789abcdef"]}
    table.to_parquet(tmp_path / PARTS / "a.parquet")
    assert parts.methods("a") == {"eq8": "eq8"}


METHOD = """
from malus import Components, Method

def polarised(observation):
    return Components(observation.image, SHARE * observation.image, 0 * observation.image)

mine = Method("mine", frozenset(), polarised, "one share everywhere")
"""


def test_a_method_of_ones_own_is_scored_anew_where_its_file_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    def errors(module: str) -> dict[str, float]:
        """Error by method of a run that goes on in one folder, all in this process."""
        suite = SUITE.model_copy(update={"methods": ("unpolarised", "eq8", f"{module}:mine")})
        results = run(suite, tmp_path / "run", variant=NOBODY)
        values = results.table.query("metric == 'nmse'").groupby("method")["value"].mean()
        return {str(name): float(value) for name, value in values.items()}

    def write(module: str, share: str) -> None:
        code = METHOD.replace("SHARE", share)
        (tmp_path / f"{module}.py").write_text(code, encoding="utf-8")

    write("own", "0.001")
    first = errors("own")
    assert errors("own") == first
    write("own", "-0.3")
    second = errors("own")
    assert second["mine"] > first["mine"]
    assert second["eq8"] == first["eq8"]
    # Another method that calls itself the same.
    write("other", "0.001")
    assert errors("other") == first


def test_a_method_that_changes_during_a_run_is_scored_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody can tell by which of both a family was scored: it counts as neither."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "edited.py"
    file.write_text(METHOD.replace("SHARE", "0.001"), encoding="utf-8")
    suite = SUITE.model_copy(update={"methods": ("unpolarised", "edited:mine")})

    def edits(tasks: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        for task, result in in_this_process(NOBODY)(tasks):
            if "-0.3" not in file.read_text("utf-8"):
                file.write_text(METHOD.replace("SHARE", "-0.3"), encoding="utf-8")
            yield task, result

    with pytest.raises(InputError, match="give the command again"):
        run(suite, tmp_path / "run", variant=NOBODY, engine=edits)
    again = run(suite, tmp_path / "run", variant=NOBODY).table
    anew = run(suite, tmp_path / "new", variant=NOBODY).table
    pd.testing.assert_frame_equal(again, anew)


def test_a_plan_tells_methods_of_one_name_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for module in ("first", "second"):
        (tmp_path / f"{module}.py").write_text(METHOD.replace("SHARE", "0.1"), encoding="utf-8")
    suites = [
        SUITE.model_copy(update={"methods": ("unpolarised", f"{module}:mine")})
        for module in ("first", "second")
    ]
    run(suites[0], tmp_path / "run", variant=NOBODY)
    assert status(tmp_path / "run").left == 0

    def nothing(_: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(suites[1], tmp_path / "run", variant=NOBODY, engine=nothing)
    found = status(tmp_path / "run")
    assert (found.done, found.left) == (0, found.total)


def test_a_run_that_goes_on_keeps_the_images_of_the_other_methods(tmp_path: Path) -> None:
    def images(methods: tuple[str, ...], samples: int = 2) -> dict[str, np.ndarray]:
        sampling = SMALL.sampling.model_copy(update={"samples": samples})
        update = {"methods": methods, "sampling": sampling}
        run(SMALL.model_copy(update=update), tmp_path / "run", choose())
        path = min((tmp_path / "run" / EXAMPLES).glob("*.npz"))
        with np.load(path) as file:
            return {name: file[name] for name in file.files}

    first = images(("unpolarised", "eq8"))
    both = images(("unpolarised", "eq8", "visible"))
    assert both.keys() - first.keys() == {"method.visible"}
    assert all(np.array_equal(both[name], first[name]) for name in first)
    # Images of another truth are none of this one.
    assert not np.array_equal(images(("unpolarised", "eq8"), samples=4)["truth"], first["truth"])
    back = images(("unpolarised", "eq8", "visible", "shadowed"))
    assert np.array_equal(back["truth"], first["truth"])
    assert {name for name in back if name.startswith("method.")} == {"method.shadowed"}
