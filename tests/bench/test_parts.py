"""Parts of a run know which methods they hold, by which weights and of which code of one's own."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
import pytest
from runs import NOBODY, SUITE

from malus.bench.running.parts import Parts
from malus.bench.running.runner import run
from malus.scenes.core.result_files import PARTS


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
        """Error by method of a run that goes on in one folder, as in a process of its own."""
        monkeypatch.delitem(sys.modules, module, raising=False)
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
