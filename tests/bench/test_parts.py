"""Parts of a run know which methods they hold, by which weights and of which code of one's own."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from malus.bench.running.parts import Parts


def test_a_network_of_other_weights_is_scored_anew(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="no onnx; pip install onnx")
    from networks import edges

    model = edges(tmp_path / "mine.onnx")
    parts, names = Parts(tmp_path), ("eq8", f"net:{model}")
    parts.write("a", pd.DataFrame({"method": names}), names)
    assert parts.methods("a") == names
    edges(model, slope=0.2)
    assert parts.methods("a") == ("eq8",)
    model.unlink()
    assert parts.methods("a") == ("eq8",)


def test_the_network_that_malus_brings_is_kept(tmp_path: Path) -> None:
    parts, names = Parts(tmp_path), ("eq8", "net", "net-around")
    parts.write("a", pd.DataFrame({"method": names}), names)
    assert parts.methods("a") == names


def test_a_method_of_ones_own_is_scored_anew_when_its_code_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    module = tmp_path / "my_methods_of_parts.py"
    code = "from malus.reconstruct.methods import TRIVIAL as MINE\n"
    module.write_text(code, encoding="utf-8")
    parts, names = Parts(tmp_path), ("eq8", "my_methods_of_parts:MINE")
    parts.write("a", pd.DataFrame({"method": names}), names)
    assert parts.methods("a") == names
    module.write_text(code + "# another\n", encoding="utf-8")
    assert parts.methods("a") == ("eq8",)
    module.write_text(code, encoding="utf-8")
    assert parts.methods("a") == names
    module.unlink()
    assert parts.methods("a") == ("eq8",)
