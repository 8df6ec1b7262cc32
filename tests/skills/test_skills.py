"""What single skills promise, one by one, in a cell without physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.simulation.kinematic import KinematicHardware
from picktree.trees import Steps
from picktree.world import BeliefObject, Box, Failure, ObjectId, world

from .cell import Cell, items, mission

LOOK = 'Observe: {camera: overhead, objects: "{items}"}'


def listed(cell: Cell) -> list[str]:
    """Look, and read what `Observe` put on the blackboard."""
    cell.start(mission(LOOK))
    cell.finish()
    value = cell.tree.blackboard.save()["Main/items"]
    assert isinstance(value, list)
    return [str(item) for item in value]


def test_observe_lists_the_nearest_first_but_what_the_hand_holds_before_it() -> None:
    cell = Cell(mission(LOOK), items(block=1, can=1))
    near, far = listed(cell)
    cell.start(mission(f"Grasp: {{object: {far}}}"))
    cell.finish()
    held = cell.world.scene.held
    assert held is not None
    assert held.id == far
    assert listed(cell) == [far, near]


def test_what_is_held_already_is_not_grasped_again() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    (block,) = listed(cell)
    cell.start(mission(f"Sequence: [{{Grasp: {{object: {block}}}}}, {{Grasp: {{object: {block}}}}}]"))
    cell.finish()
    assert (cell.tree.status.value, cell.tree.failure) == ("SUCCESS", None)
    assert cell.happened("pick") == [f"pick: {block}: held"]


def test_what_is_held_and_stands_on_the_table_is_raised_and_is_held() -> None:
    """With the load taken off, the hand feels nothing: it lifts what is between the fingers a little."""
    cell = Cell(mission(LOOK), items(block=1))
    (block,) = listed(cell)
    down = "Jog: {velocity: [0, 0, -0.05], guard: 3 N, when_stopped: succeed}"
    cell.start(mission(f"Sequence: [{{Grasp: {{object: {block}, onward: false}}}}, {{{down}}}]"))
    cell.finish()
    assert cell.tree.failure is None
    low = cell.world.control.tcp.position[2]
    cell.start(mission(f"Grasp: {{object: {block}}}"))
    cell.finish()
    assert cell.tree.failure is None
    assert cell.world.control.tcp.position[2] > low + 0.001
    assert cell.world.scene.held is not None


def test_what_was_held_and_is_gone_has_slipped() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    (block,) = listed(cell)
    cell.start(mission(f"Grasp: {{object: {block}, onward: false}}"))
    cell.finish()
    hardware = cell.hardware
    assert isinstance(hardware, KinematicHardware)
    hardware.remove("item_00")
    for _ in range(20):
        cell.wait()
    assert fails(cell, f"Grasp: {{object: {block}}}") == "grasp.slipped"
    assert message(cell) == f"{block} was in the hand and is gone: opening 0.0 mm"
    assert cell.world.scene.held is None


def test_what_no_hand_fits_around_has_no_candidate() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    (block,) = listed(cell)
    pose = cell.world.scene.get(block).pose
    known = ("unknown", "unknown", Box((0.2, 0.2, 0.3)), "grey", pose.shifted((0.0, 0.0, 0.2)))
    cell.world.scene.put(
        BeliefObject(*known, 0.002, 0.0, 1.0, 0.0, id=ObjectId("roof"), role="obstacle"), "seen"
    )
    assert fails(cell, f"Grasp: {{object: {block}}}") == "grasp.no_candidate"
    failure = cell.tree.failure
    assert failure is not None
    count = failure.evidence["candidates"]
    assert failure.evidence == {"object": block, "candidates": count, "tried_before": 0}
    assert message(cell).startswith(
        f"none of {count} grasps of {block} is free, reachable and leads to a place: "
    )
    assert "roof" in message(cell)


def test_a_full_hand_cannot_grasp() -> None:
    cell = Cell(mission(LOOK), items(block=1, can=1))
    one, other = listed(cell)
    cell.start(mission(f"Sequence: [{{Grasp: {{object: {one}}}}}, {{Grasp: {{object: {other}}}}}]"))
    cell.finish()
    assert cell.tree.failure is not None
    assert str(cell.tree.failure.cause) == "grasp.no_candidate"
    assert cell.tree.failure.message == f"the hand is not free: it holds {one}"
    assert cell.tree.failure.evidence == {"object": other, "held": one}


def test_a_grasp_that_touched_something_is_not_tried_again_at_once() -> None:
    """The candidate is remembered as failed, whatever it failed of."""
    cell = Cell(mission(LOOK), items(block=1))
    (block,) = listed(cell)
    hardware = cell.hardware
    assert isinstance(hardware, KinematicHardware)
    (body,) = hardware.bodies.items
    hardware.bodies.put(replace(body, pose=body.pose.shifted((0.025, 0.017, 0.0))))
    assert fails(cell, f"Grasp: {{object: {block}}}") == "world.disturbed"
    ((_, tried),) = cell.world.attempts.state().items()
    assert len(tried) == 1
    cell.start(mission(f"Sequence: [SafeRetreat, {{{LOOK}}}, {{Grasp: {{object: {block}}}}}]"))
    cell.finish()
    assert cell.tree.failure is None


def test_a_lift_that_is_broken_off_counts_as_a_pick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fingers have closed on the object, and the next grasp finds it in the hand."""

    def blocked(*_: object) -> Steps:
        yield
        raise Failure(world.DISTURBED, "something is in the way")

    cell = Cell(mission(LOOK), items(block=1))
    (block,) = listed(cell)
    with monkeypatch.context() as patch:
        patch.setattr("picktree.robot.manipulation.object_pick.lift", blocked)
        assert fails(cell, f"Grasp: {{object: {block}, onward: false}}") == "world.disturbed"
    cell.start(mission(f"Sequence: [SafeRetreat, {{Grasp: {{object: {block}}}}}]"))
    cell.finish()
    assert cell.tree.failure is None
    assert cell.happened("pick") == [f"pick: {block}: held"]


def fails(cell: Cell, body: str) -> str:
    """The cause in which a mission ends."""
    cell.start(mission(body))
    cell.finish()
    assert cell.tree.failure is not None
    return str(cell.tree.failure.cause)


def message(cell: Cell) -> str:
    assert cell.tree.failure is not None
    return cell.tree.failure.message


def test_observe_says_what_it_misses() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    assert fails(cell, "Observe: {camera: overhead, expect: blue_can_7}") == "perception.not_found"
    assert message(cell) == "blue_can_7 is not in the view of overhead"
    assert fails(cell, "Observe: {camera: wrist}") == "perception.not_found"
    assert message(cell) == "there is no camera 'wrist'"


def test_what_was_tried_on_an_item_is_forgotten_when_it_is_seen_to_be_gone() -> None:
    cell = Cell(mission(LOOK), items(block=1, can=1))
    one, other = listed(cell)
    hardware = cell.hardware
    assert isinstance(hardware, KinematicHardware)
    hardware.remove(next(b.id for b in hardware.bodies.items if b.entry.kind in one))
    for item in (one, other):
        cell.world.attempts.failed("Main/Grasp", item, "top 0")
    assert listed(cell) == [other]
    assert cell.world.attempts.state() == {f"Main/Grasp|{other}": ["top 0"]}


def test_grasp_of_what_nobody_knows() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    assert fails(cell, "Grasp: {object: red_can_1}") == "world.unknown_object"
    assert message(cell) == "no object 'red_can_1' in the planning scene"


def test_place_needs_something_in_the_hand_and_a_place_for_it() -> None:
    cell = Cell(mission(LOOK), items(block=1, can=1))
    block, can = listed(cell)
    assert fails(cell, f"Place: {{object: {block}, into: red_bin}}") == "grasp.slipped"
    assert message(cell) == f"{block} is not in the hand"
    cell.start(mission(f"Grasp: {{object: {block}}}"))
    cell.finish()
    assert fails(cell, f"Place: {{object: {block}, into: black_bin}}") == "world.unknown_object"
    assert message(cell) == "there is no bin 'black_bin'"
    x, y, _ = cell.world.scene.get(can).pose.position
    assert fails(cell, f"Place: {{object: {block}, at: [{x}, {y}, 0]}}") == "place.occupied"
    assert message(cell) == f"{can} stands where {block} should go"


def test_place_at_a_point_stands_the_object_there() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    (block,) = listed(cell)
    cell.start(
        mission(
            f"Sequence: [{{Grasp: {{object: {block}}}}}, {{Place: {{object: {block}, at: [0.5, 0.2, 0]}}}}]"
        )
    )
    cell.finish()
    assert (cell.tree.status.value, cell.tree.failure) == ("SUCCESS", None)
    (body,) = cell.hardware.truth()
    assert np.linalg.norm(np.subtract(body.pose.position, (0.5, 0.2, 0.02))) < 0.004
    assert cell.world.scene.held is None
    assert cell.world.scene.get(block).place == "table"


def test_opened_fingers_let_go_in_the_belief_too() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    (block,) = listed(cell)
    cell.start(mission(f"Sequence: [{{Grasp: {{object: {block}}}}}, OpenGripper]"))
    cell.finish()
    assert cell.world.scene.held is None
    believed = cell.world.scene.get(block)
    (body,) = cell.hardware.truth()
    assert (believed.place, believed.confidence) == ("table", 0.3)
    assert np.linalg.norm(np.subtract(believed.pose.position, body.pose.position)) < 0.003


def test_a_latched_stop_refuses_motion_until_a_safe_retreat_acknowledges_it() -> None:
    cell = Cell(mission(LOOK), items(block=1))
    cell.world.control.monitor.check_tool((2.0, 0.0, 0.5))
    assert fails(cell, "GoTo: {pose: rest}") == "safety.stop"
    said = "the tool is 1100 mm outside the workspace: x = 2000 mm, at most 900 mm"
    assert message(cell) == f"a safety stop is not acknowledged: {said}"
    cell.start(mission("Sequence: [SafeRetreat, {GoTo: {pose: rest}}]"))
    cell.finish()
    assert (cell.tree.status.value, cell.tree.failure) == ("SUCCESS", None)
    assert cell.happened("safety_acknowledged") == [f"safety_acknowledged: safety.workspace: {said}"]
