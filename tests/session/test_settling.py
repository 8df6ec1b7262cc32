"""A mission that ends while an item still moves, as in the tick of its last `Place`: judged at rest."""

from __future__ import annotations

from pathlib import Path

from picktree.logs import RunLog
from picktree.session import RunRequest, Session
from picktree.simulation import rests

MISSION = """\
picktree: 1
kind: mission
scene: sort_small
trees: {Main: {Delay: {delay_msec: 250, do: AlwaysSuccess}}}
"""
BUMP = """\
picktree: 1
kind: faults
scene: sort_small
faults:
  - {fault: bump, when: {at: 0.2 s}, target: {index: 0}, velocity: [0, 0, 1.5]}
"""


def test_a_run_goes_on_until_its_items_are_at_rest(tmp_path: Path) -> None:
    mission, faults = tmp_path / "m.yaml", tmp_path / "bump.yaml"
    mission.write_text(MISSION)
    faults.write_text(BUMP)
    session = Session(RunRequest(mission, faults=faults, out=tmp_path / "runs"))
    assert all(rests(body) for body in session.execution.hardware.truth())
    result = session.run()
    assert all(rests(body) for body in session.execution.hardware.truth())
    with RunLog(result.log) as log:
        # It flies for 0.3 s and then tumbles; the tree ends 0.05 s after it was thrown.
        assert log.end > 0.5
