"""Two equal scenes of a random suite are refused where they fall into different parts, too."""

from __future__ import annotations

from pathlib import Path

import pytest
from runs import NOBODY

from malus.bench.datasets.render import render_dataset
from malus.renderers.datasets import dataset_writer
from malus.scenes import InputError, Suite

SUITE = Suite.parse(
    {
        "name": "drawn",
        "wavelengths_nm": [550],
        "methods": ["unpolarised"],
        "renderer": "torrance-sparrow",
        "camera": {"resolution": 8},
        "random": {
            "count": 4,
            "seed": 11,
            "shapes": [{"kind": "sphere"}],
            "materials": [{"eta": {"choice": [1.4, 1.5, 1.6]}}],
            "surfaces": [{"alpha": {"choice": [0.2, 0.3]}, "albedo": 0.4}],
            "lights": [{"kind": "distant", "incidence_deg": 60}],
        },
        "splits": {"train": 0.5, "test": 0.5},
    },
    "test",
)


def test_the_suite_has_a_scene_in_two_parts_and_splits() -> None:
    assert SUITE.draws is not None
    ids = [SUITE.draws.scene(number).id for number in range(4)]
    assert ids[1] == ids[2]  # of the second part of two, and of the first
    assert len(set(ids)) == 3
    assert [SUITE.draws.split(number) for number in (1, 2)] == ["test", "train"]


@pytest.mark.parametrize(("first", "second", "own"), [("1/2", "2/2", 1), ("2/2", "1/2", 2)])
def test_a_later_part_is_refused_before_anything_is_rendered(
    tmp_path: Path, first: str, second: str, own: int
) -> None:
    """Both were done and the dataset never whole, without a word; the later split counted."""
    render_dataset(SUITE, tmp_path, NOBODY, part=first)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    told = f"part {second}: expected scenes that differ, found scene {own} equal to scene {3 - own}"
    with pytest.raises(InputError, match=f"{told} of part {first}; draw a range"):
        render_dataset(SUITE, tmp_path, NOBODY, part=second)
    after = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert {path for path in after if path.is_file()} == {p for p in before if p.is_file()}
    assert all(after[path] == time for path, time in before.items() if path.is_file())
    # A part that goes on is none that is equal to itself.
    assert render_dataset(SUITE, tmp_path, NOBODY, part=first)["taken_over"] == 2


def test_parts_begun_together_are_told_at_their_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When a part begins, the list of the other may not be there yet."""
    render_dataset(SUITE, tmp_path, NOBODY, part="1/2")
    monkeypatch.setattr(dataset_writer, "check_parts_differ", lambda *_: None)
    with pytest.raises(InputError, match="scene 1 equal to scene 2 of part 1/2"):
        render_dataset(SUITE, tmp_path, NOBODY, part="2/2")
