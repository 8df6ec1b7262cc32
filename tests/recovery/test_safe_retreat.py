"""SafeRetreat from states that it may be called in, in a cell without physics."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from picktree.world.belief.planning_scene import BeliefObject
from picktree.world.shapes import Box
from picktree.world.values import ObjectId, Pose, Vector3

from ..skills.cell import Cell, items, mission

if TYPE_CHECKING:
    from picktree.trees.skill import Doing

LOOK = "Observe: {camera: overhead}"


def cell() -> Cell:
    """A block that was seen, the arm at home."""
    made = Cell(mission(LOOK), items(block=1))
    made.finish()
    return made


def do(cell: Cell, body: str) -> tuple[str, str]:
    """Status and cause of a mission."""
    cell.start(mission(body))
    cell.finish()
    failure = cell.tree.failure
    return cell.tree.status.value, "" if failure is None else str(failure.cause)


def believe(cell: Cell, name: str, size: Vector3, at: Vector3) -> None:
    """An obstacle that is not there."""
    known = ("obstacle", "unknown", "unknown", Box(size), "grey", Pose(at))
    cell.world.scene.put(BeliefObject(ObjectId(name), *known, 0.002, 0.0, 1.0, 0.0), "test")


def at(cell: Cell, pose: str) -> bool:
    off = cell.world.control.state.position - cell.world.robot.named(pose)
    return float(np.abs(off).max()) < 2e-3


def block(cell: Cell) -> str:
    return str(next(o.id for o in cell.world.scene.objects if o.role == "item"))


def beside_the_hand(cell: Cell) -> Vector3:
    x, y, z = cell.world.control.tcp.position
    return (x + 0.02, y + 0.06, z + 0.06)


def test_out_of_what_is_believed_about_the_hand_and_to_the_pose() -> None:
    made = cell()
    believe(made, "ghost", (0.08, 0.08, 0.08), beside_the_hand(made))
    assert do(made, "GoTo: {pose: rest}") == ("FAILURE", "planning.start_in_collision")
    assert do(made, "SafeRetreat: {pose: rest}") == ("SUCCESS", "")
    assert at(made, "rest")


def test_with_no_way_out_it_says_what_it_is_in_and_what_was_tried_and_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("picktree.manipulation.retreat.clearing.REACH", 0.03)
    made = cell()
    x, y, z = made.world.control.tcp.position
    believe(made, "ghost", (0.8, 0.8, 0.8), (x, y, z + 0.1))
    before = made.world.control.state.position
    assert do(made, "SafeRetreat: {pose: rest}") == ("FAILURE", "safety.no_retreat")
    failure = made.tree.failure
    assert failure is not None
    assert failure.message.startswith("there is no safe way to rest; the arm stays where it is: panda_")
    deep, tried = failure.evidence["depth"], failure.evidence["tried"]
    assert isinstance(deep, float)
    assert deep > 0.3
    assert isinstance(tried, list)
    directions = {str(way).partition(" ")[0] for way in tried}
    assert {"out", "back", "up", "inwards", "left", "right", "outwards", "down"} <= directions
    assert np.abs(made.world.control.state.position - before).max() < 1e-6
    assert made.world.control.at_rest


def test_a_held_object_is_kept_dropped_or_put_down_as_asked() -> None:
    for hand, holds, place in (
        ("keep", True, "hand"),
        ("open", False, "table"),
        ("put_down", False, "table"),
    ):
        made = cell()
        item = block(made)
        assert do(made, f"Grasp: {{object: {item}, onward: false}}") == ("SUCCESS", "")
        assert do(made, f"SafeRetreat: {{hand: {hand}}}") == ("SUCCESS", "")
        assert at(made, "home")
        assert made.world.scene.get(item).place == place
        assert (made.world.scene.held is not None) is holds
        (body,) = made.hardware.truth()
        high = body.pose.position[2] > 0.1
        assert high is holds


def test_what_is_put_down_stands_on_a_free_spot_when_the_nearest_is_taken() -> None:
    made = cell()
    item = block(made)
    assert do(made, f"Grasp: {{object: {item}, onward: false}}") == ("SUCCESS", "")
    x, y, _ = made.world.control.tcp.position
    believe(made, "taken", (0.04, 0.04, 0.03), (x, y, 0.015))
    assert do(made, "SafeRetreat: {hand: put_down}") == ("SUCCESS", "")
    (body,) = made.hardware.truth()
    assert 0.04 < np.hypot(body.pose.position[0] - x, body.pose.position[1] - y) < 0.3
    assert body.pose.position[2] == pytest.approx(0.02, abs=0.004)


def test_what_was_to_be_kept_and_is_gone_is_said() -> None:
    made = cell()
    item = block(made)
    assert do(made, f"Grasp: {{object: {item}, onward: false}}") == ("SUCCESS", "")
    made.hardware.remove(str(made.hardware.truth()[0].id))
    assert do(made, "SafeRetreat") == ("FAILURE", "grasp.slipped")
    assert at(made, "home")
    assert made.world.scene.held is None


def test_a_stop_is_acknowledged_and_none_is_latched_at_the_end() -> None:
    made = cell()
    made.world.control.monitor.check_tool((2.0, 0.0, 0.5))
    assert do(made, "SafeRetreat: {pose: rest}") == ("SUCCESS", "")
    assert made.world.control.monitor.stopped is None
    assert [e.partition(":")[0] for e in made.happened("safety_acknowledged")] == ["safety_acknowledged"]


def test_what_is_touched_on_the_way_home_is_left_and_gone_around(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first motion home meets something that nobody knows of: the arm goes back, and home afterwards."""
    from dataclasses import replace

    from picktree.control.execution.motions import ArmMotion
    from picktree.control.joints.soft_contact import JointImpedanceResult

    made = cell()
    assert do(made, "GoTo: {pose: rest}") == ("SUCCESS", "")
    followed, met = ArmMotion.softly, list[bool]()

    def meets(self: ArmMotion, *given: object, **more: object) -> Doing[JointImpedanceResult]:
        result: JointImpedanceResult = yield from followed(self, *given, **more)  # type: ignore[arg-type]
        met.append(bool(met) or not result.completed)
        return replace(result, completed=False, touched=True, force=7.0) if len(met) == 1 else result

    monkeypatch.setattr(ArmMotion, "softly", meets)
    assert do(made, "SafeRetreat: {pose: home}") == ("SUCCESS", "")
    assert at(made, "home")
    assert len(met) >= 2
