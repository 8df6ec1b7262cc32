"""Faults of an item are felt, named and recovered from; the others still reach their bins."""

from __future__ import annotations

from pathlib import Path

from picktree.logs import RunLog, RunResult
from picktree.session import RunRequest, Session
from picktree.simulation import Backend

from .cell import EXAMPLES

GRASP = "Main/Repeat/Sequence/ForEach/SortOne/Recover/Sequence/Grasp"
SNATCHED = "{fault: remove, when: {node: Grasp, start: 2, delay: 500 ms}, target: {nearest_to: object}}"
SLIPPERY = (
    "{fault: friction, when: {node: Grasp, start: 2}, target: {nearest_to: object}, "
    "friction: 0.05, mass: 500 g}"
)


def run_with(fault: str, folder: Path, backend: Backend, **parameters: str) -> RunResult:
    faults = folder / "faults.yaml"
    faults.write_text(f"picktree: 1\nkind: faults\nfaults:\n  - {fault}\n")
    request = RunRequest(
        EXAMPLES / "sort_by_colour.yaml",
        scene="sort_small",
        seed=3,
        parameters=parameters,
        faults=faults,
        out=folder,
        backend=backend,
    )
    return Session(request).run()


def story(result: RunResult, *kinds: str) -> list[str]:
    """Events of these kinds in their order, with the cause or the object that they are about."""
    with RunLog(result.log) as log:
        events = [at.record for at in log.events() if at.record.kind in kinds]
    return [f"{e.kind} {e.data.get('cause') or e.data.get('object') or e.data.get('item')}" for e in events]


def failed_nodes(result: RunResult) -> set[tuple[str, str]]:
    """Node and cause of every leaf's failure, from the log alone."""
    with RunLog(result.log) as log:
        leaves = {node.path for node in log.tree().nodes if not node.children}
        nodes = [node for at in log.ticks() for node in at.record.nodes]
    return {(n.path, n.cause) for n in nodes if n.path in leaves and n.status == "FAILURE" and n.ticked}


def test_an_item_snatched_away_between_observation_and_grasp(tmp_path: Path) -> None:
    result = run_with(SNATCHED, tmp_path, "kinematic")
    assert (result.status, result.message) == ("incomplete", "")
    assert (result.items.sorted, result.items.misplaced, result.items.left) == (3, 0, 1)
    assert result.failures == {"grasp.missed": 1, "world.unknown_object": 2}
    assert result.recoveries == {"grasp.missed": 1, "world.unknown_object": 1}
    assert {(n, c) for n, c in failed_nodes(result) if n == GRASP} == {
        (GRASP, "grasp.missed"),
        (GRASP, "world.unknown_object"),
    }
    told = story(result, "fault", "pick", "recovery", "handled", "item_done")
    assert told[:4] == ["pick blue_plate_1", "item_done blue_plate_1", "fault item_02", "pick red_ball_1"]
    assert told[4] == "recovery grasp.missed"
    assert told[-5:] == [
        "handled world.unknown_object",
        "pick red_block_1",
        "item_done red_block_1",
        "pick green_can_1",
        "item_done green_can_1",
    ]
    with RunLog(result.log) as log:
        lines = [at.record for at in log.lines()]
        last = log.belief_at(result.sim_seconds)
    assert ("WARNING", "item_02 is snatched away") in {(line.level, line.message) for line in lines}
    errors = [line.message for line in lines if line.level == "ERROR" and line.name == GRASP]
    assert errors[0].startswith("grasp.missed: red_ball_1: the fingers met and hold nothing (opening ")
    assert last is not None
    assert "red_ball_1" not in {body.id for body in last.record.bodies}


def test_a_slippery_heavy_item_in_physics(tmp_path: Path) -> None:
    result = run_with(SLIPPERY, tmp_path, "physics", rounds="1")
    assert (result.status, result.message) == ("incomplete", "")
    # Where it is left it may be dented: slipping away it meets the fingers with all its weight.
    assert (result.items.sorted, result.items.misplaced + result.items.left) == (3, 1)
    assert set(result.failures) == {"grasp.slipped"}
    assert set(result.recoveries) == {"grasp.slipped"}
    assert failed_nodes(result) == {(GRASP, "grasp.slipped")}
    told = story(result, "fault", "pick", "recovery", "handled", "item_done")
    assert told[2:6] == ["fault item_02", *["pick red_ball_1"] * 2, "recovery grasp.slipped"]
    assert told.count("recovery grasp.slipped") == 3
    assert told[-5:-3] == ["handled grasp.slipped", "pick red_block_1"]
    assert told[-1] == "item_done green_can_1"
