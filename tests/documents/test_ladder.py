"""The ladder of examples, 01_one_pick to 10_recover: one idea each, and each mission reaches its goal."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from picktree.session import RunRequest, Session

from ..rooms import ROOT

STEPS = sorted((ROOT / "examples").glob("[01][0-9]_*.yaml"))
SORTED = {"01_one_pick": 1, "05_condition": 3}
"""Number of items that a step sorts in `sort_small` with seed 0; the other steps sort all four."""


def test_it_has_ten_steps_that_begin_with_their_idea() -> None:
    assert [file.name[:2] for file in STEPS] == [f"{number:02}" for number in range(1, 11)]
    for number, file in enumerate(STEPS, 1):
        modeline, idea, *lines = file.read_text(encoding="utf-8").splitlines()
        assert modeline.startswith("# yaml-language-server:")
        assert re.match(rf"# Step {number}, .*\.$", idea), file.name
        assert len(lines) <= 38, file.name


def test_the_tutorial_goes_along_the_steps() -> None:
    tutorial = (ROOT / "docs" / "first-mission.md").read_text(encoding="utf-8")
    places = [tutorial.find(file.name) for file in STEPS]
    assert -1 not in places
    assert places == sorted(places)


@pytest.mark.parametrize("file", STEPS, ids=lambda file: file.stem)
def test_a_step_reaches_its_goal(file: Path, tmp_path: Path) -> None:
    request = RunRequest(file, backend="kinematic", scene="sort_small", seed=0, out=tmp_path)
    result = Session(request).run()
    assert result.reached
    assert result.items.sorted == SORTED.get(file.stem, 4)
    assert result.failures == {}
