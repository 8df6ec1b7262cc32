"""Stir: what lies in a tote is moved by strokes, in physics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.logs import RunResult
from picktree.logs.log_records import BodyRecord
from picktree.session import RunRequest, Session
from picktree.world.event_types import PushEvent

SCENE = """\
picktree: 1
kind: scene
base: tote
spawn: [{of: {assortment: 3}, colours: [red, blue], into: tote, drop: heap}]
"""
EMPTY = """\
picktree: 1
kind: scene
base: tote
spawn: []
"""
MISSION = """\
picktree: 1
kind: mission
name: stir
scene: scene.yaml
goal: "True"
trees:
  Main:
    Stir: {in: tote}
"""


def stir(folder: Path, scene: str) -> RunResult:
    (folder / "scene.yaml").write_text(scene)
    (folder / "stir.yaml").write_text(MISSION)
    return Session(RunRequest(folder / "stir.yaml", seed=5, out=folder)).run()


@pytest.fixture(scope="module")
def stirred(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    return stir(tmp_path_factory.mktemp("stir"), SCENE)


def bodies(run: Run, at: float) -> dict[str, BodyRecord]:
    truth = run.at(at).truth
    assert truth is not None
    return {body.id: body for body in truth.bodies}


def test_strokes_move_what_lies_in_the_tote(stirred: RunResult) -> None:
    assert stirred.status == "success"
    with Run(stirred.log) as run:
        before, after = (bodies(run, at) for at in (0.5, run.end))
        moved = [
            float(np.hypot(*(np.array(after[name].pose.position) - body.pose.position)[:2]))
            for name, body in before.items()
        ]
        events = [at.record for at in run.events if isinstance(at.record, PushEvent)]
    assert max(moved) > 0.01
    assert [1 <= len(event.strokes) <= 4 for event in events] == [True]


def test_no_stroke_comes_near_the_force_limit(stirred: RunResult) -> None:
    with Run(stirred.log) as run:
        assert np.linalg.norm(run.wrenches.forces, axis=1).max() < 40.0


def test_nothing_is_stirred_in_an_empty_tote(tmp_path: Path) -> None:
    result = stir(tmp_path, EMPTY)
    assert result.status == "failure"
    assert result.failures == {"push.no_stroke": 1}
    assert "tote is empty" in result.message
