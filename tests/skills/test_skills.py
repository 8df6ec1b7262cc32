"""What single skills promise, one by one, in a cell without physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.trees import Steps
from picktree.world import Failure, world

from .cell import Cell, items, looked, mission

LOOK = 'Observe: {camera: overhead, objects: "{items}"}'


def listed(cell: Cell) -> object:
    """Look, and read what `Observe` put on the blackboard."""
    assert cell.do(LOOK) == ""
    return cell.tree.blackboard.save()["Main/items"]


def test_observe_lists_the_nearest_first_but_what_the_hand_holds_before_it() -> None:
    cell, (near, far) = looked(block=1, can=1)
    assert cell.do(f"Grasp: {{object: {far}}}") == ""
    assert cell.world.scene.held is not None
    assert cell.world.scene.held.id == far
    assert listed(cell) == [far, near]


def test_what_is_held_already_is_not_grasped_again() -> None:
    cell, (block,) = looked(block=1)
    assert cell.do(f"Sequence: [{{Grasp: {{object: {block}}}}}, {{Grasp: {{object: {block}}}}}]") == ""
    assert cell.happened("pick") == [f"pick: {block}: held"]


def test_what_is_held_and_stands_on_the_table_is_raised_and_is_held() -> None:
    """With the load taken off, the hand feels nothing: it lifts what is between the fingers a little."""
    cell, (block,) = looked(block=1)
    down = "Jog: {velocity: [0, 0, -0.05], guard: 3 N, when_stopped: succeed}"
    assert cell.do(f"Sequence: [{{Grasp: {{object: {block}, onward: false}}}}, {{{down}}}]") == ""
    low = cell.world.control.tcp.position[2]
    assert cell.do(f"Grasp: {{object: {block}}}") == ""
    assert cell.world.control.tcp.position[2] > low + 0.001
    assert cell.world.scene.held is not None


def test_what_no_hand_fits_around_has_no_candidate() -> None:
    cell, (block,) = looked(block=1)
    x, y, z = cell.world.scene.get(block).pose.position
    cell.believe("roof", (0.2, 0.2, 0.3), (x, y, z + 0.2))
    told = cell.do(f"Grasp: {{object: {block}}}")
    count = cell.failure.evidence["candidates"]
    assert cell.failure.evidence == {"object": block, "candidates": count, "tried_before": 0}
    assert told.startswith(
        f"grasp.no_candidate: none of {count} grasps of {block} is free, reachable and leads to a place: "
    )
    assert "roof" in told


def test_a_grasp_that_touched_something_is_not_tried_again_at_once() -> None:
    """The candidate is remembered as failed, whatever it failed of."""
    cell, (block,) = looked(block=1)
    (body,) = cell.kinematic.bodies.items
    cell.kinematic.bodies.put(replace(body, pose=body.pose.shifted((0.025, 0.017, 0.0))))
    assert cell.do(f"Grasp: {{object: {block}}}").startswith("world.disturbed: ")
    ((_, tried),) = cell.world.attempts.state().items()
    assert len(tried) == 1
    assert cell.do(f"Sequence: [SafeRetreat, {{{LOOK}}}, {{Grasp: {{object: {block}}}}}]") == ""


def test_a_lift_that_is_broken_off_counts_as_a_pick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fingers have closed on the object, and the next grasp finds it in the hand."""

    def blocked(*_: object) -> Steps:
        yield
        raise Failure(world.DISTURBED, "something is in the way")

    cell, (block,) = looked(block=1)
    with monkeypatch.context() as patch:
        patch.setattr("picktree.robot.manipulation.object_pick.lift", blocked)
        assert cell.do(f"Grasp: {{object: {block}, onward: false}}").startswith("world.disturbed: ")
    assert cell.do(f"Sequence: [SafeRetreat, {{Grasp: {{object: {block}}}}}]") == ""
    assert cell.happened("pick") == [f"pick: {block}: held"]


def test_what_was_tried_on_an_item_is_forgotten_when_it_is_seen_to_be_gone() -> None:
    cell, (one, other) = looked(block=1, can=1)
    cell.kinematic.remove(next(b.id for b in cell.kinematic.bodies.items if b.entry.kind in one))
    for item in (one, other):
        cell.world.attempts.failed("Main/Grasp", item, "top 0")
    assert listed(cell) == [other]
    assert cell.world.attempts.state() == {f"Main/Grasp|{other}": ["top 0"]}


def test_what_is_not_there_is_told() -> None:
    cell, (block, can) = looked(block=1, can=1)
    for body, told in (
        (
            "Observe: {camera: overhead, expect: blue_can_7}",
            "perception.not_found: blue_can_7 is not in the view of overhead",
        ),
        ("Observe: {camera: wrist}", "perception.not_found: there is no camera 'wrist'"),
        ("Grasp: {object: red_can_9}", "world.unknown_object: no object 'red_can_9' in the planning scene"),
        (f"Place: {{object: {block}, into: red_bin}}", f"grasp.slipped: {block} is not in the hand"),
    ):
        assert cell.do(body) == told
    assert cell.do(f"Grasp: {{object: {block}}}") == ""
    x, y, _ = cell.world.scene.get(can).pose.position
    occupied = f"place.occupied: {can} stands where {block} should go"
    assert cell.do(f"Place: {{object: {block}, at: [{x}, {y}, 0]}}") == occupied


def test_opened_fingers_let_go_in_the_belief_too() -> None:
    cell, (block,) = looked(block=1)
    assert cell.do(f"Sequence: [{{Grasp: {{object: {block}}}}}, OpenGripper]") == ""
    assert cell.world.scene.held is None
    believed = cell.world.scene.get(block)
    (body,) = cell.hardware.truth()
    assert (believed.place, believed.confidence) == ("table", 0.3)
    assert np.linalg.norm(np.subtract(believed.pose.position, body.pose.position)) < 0.003


def test_a_latched_stop_refuses_motion_until_a_safe_retreat_acknowledges_it() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    cell.world.control.monitor.check_tool((2.0, 0.0, 0.5))
    said = "the tool is 1100 mm outside the workspace: x = 2000 mm, at most 900 mm"
    assert cell.do("GoTo: {pose: rest}") == f"safety.stop: a safety stop is not acknowledged: {said}"
    assert cell.do("Sequence: [SafeRetreat, {GoTo: {pose: rest}}]") == ""
    assert cell.happened("safety_acknowledged") == [f"safety_acknowledged: safety.workspace: {said}"]
