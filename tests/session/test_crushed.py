"""A crushed item is listed in the result of the run, and costs its goal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.explain import explain
from picktree.session import RunRequest, Session
from picktree.world.event_types import CrushedEvent

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_a_crushed_item_is_in_the_result_and_costs_the_goal_wherever_it_lies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mission = EXAMPLES / "sort_by_colour.yaml"
    session = Session(RunRequest(mission, backend="kinematic", scene="sort_small", out=tmp_path))
    hardware, journal = session.execution.hardware, session.execution.world.journal
    truth = hardware.truth
    (can, *_) = (body.id for body in truth() if body.kind == "can")
    monkeypatch.setattr(
        hardware,
        "truth",
        lambda: tuple(replace(body, crushed=65.0 if body.id == can else 0.0) for body in truth()),
    )
    for force in (62.0, 65.0):
        told = f"{can} was crushed: left pressed with {force} N, and it bears 60 N"
        journal.note(CrushedEvent(told, object=can, finger="left", force=force, limit=60.0, time=0.0))
    result = session.run()
    (crushed,) = result.crushed
    assert (crushed.kind, crushed.force, crushed.limit) == ("can", 65.0, 60.0)
    with Run(result.log) as run:
        found = explain(run)
    (root,) = found.root_causes
    assert (root.cause, root.doubtful, len(root.items)) == ("item.crushed", False, 1)
    assert "was crushed: left pressed with 65 N, and the item withstands 60 N" in root.title
    (story,) = (item for item in found.items if item.truth.endswith("pressed with 65.0 N"))
    assert "where it belongs" not in story.truth
