"""What comes into the way of a moving arm, or moves its target, is seen, stopped for and planned around."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from picktree.robot import Vision
from picktree.robot.manipulation.replanning import MAX_REPLANS
from picktree.robot.perception import BinView
from picktree.robot.planning import TrajectoryGate
from picktree.world import Box, Failure, ObjectId, Pose, perception, planning
from picktree.world.event_types import ItemDoneEvent, ReplannedEvent
from picktree.world.scene import Fixture

from .cell import Cell, items, looked, mission

LOOK = 'Observe: {camera: overhead, objects: "{items}"}'


def watched(body: str, every: str = "100 ms") -> str:
    return f"WatchScene: {{every: {every}, do: {body}}}"


def sorting(cell: Cell, item: str) -> str:
    into = cell.world.scene.destination(item)
    return f"{{Sequence: [{{Grasp: {{object: {item}}}}}, {{Place: {{object: {item}, into: {into}}}}}]}}"


def tick_until(cell: Cell, leaf: str, more: int = 0) -> None:
    while cell.leaf != leaf:
        cell.tick()
    for _ in range(more):
        cell.tick()
    assert cell.running


def lift(cell: Cell) -> None:
    """Tick until the first item is lifted a little."""
    while cell.world.scene.held is None:
        cell.tick()
    cell.tick()


def move(cell: Cell, x: float, y: float) -> None:
    """Somebody moves the first item by so much, m."""
    bodies = cell.kinematic.bodies
    body = bodies.items[0]
    bodies.put(replace(body, pose=body.pose.shifted((x, y, 0.0))))


def post_on_the_way(cell: Cell, item: str) -> Fixture:
    """A post between the hand and the bin."""
    tcp = np.array(cell.world.control.tcp.position[:2])
    into = cell.world.scene.destination(item)
    assert into is not None
    there = np.array(cell.world.scene.bins[into].pose.position[:2])
    x, y = tcp + 0.55 * (there - tcp)
    return Fixture(ObjectId("post"), Box((0.05, 0.05, 0.4)), Pose((float(x), float(y), 0.2)), "white")


def test_what_comes_into_the_way_of_what_is_carried_is_passed_by() -> None:
    cell, (block,) = looked(block=1)
    cell.start(mission(watched(sorting(cell, block))))
    lift(cell)
    post = post_on_the_way(cell, block)
    hardware = cell.kinematic
    assert hardware.room_for(post)
    hardware.put_obstacle(post)
    while cell.running:
        cell.tick()
        assert hardware.room_for(post), "the arm is in it"
    assert cell.tree.status.value == "SUCCESS"
    (event, *_) = [e for e in cell.events if isinstance(e, ReplannedEvent)]
    # It is noticed at the end of the lift or on the transfer.
    assert event.node in ("Main/WatchScene/Sequence/Grasp", "Main/WatchScene/Sequence/Place")
    assert event.cause == "planning.blocked"
    assert any("obstacle_1" in each for each in event.by)
    assert cell.score().count.sorted == 1


def test_nobody_sees_it_when_nobody_looks() -> None:
    cell, (block,) = looked(block=1)
    cell.start(mission(sorting(cell, block).removeprefix("{").removesuffix("}")))
    lift(cell)
    post = post_on_the_way(cell, block)
    hardware = cell.kinematic
    hardware.put_obstacle(post)
    free: list[bool] = []
    while cell.running:
        cell.tick()
        free.append(hardware.room_for(post))
    assert not all(free)


def test_a_target_that_moves_is_grasped_where_it_is_seen_then() -> None:
    cell, (block,) = looked(block=1)
    cell.start(mission(watched(sorting(cell, block))))
    tick_until(cell, "Grasp", 4)
    move(cell, 0.05, -0.04)
    cell.finish()
    assert (cell.tree.status.value, cell.score().count.sorted) == ("SUCCESS", 1)
    (event,) = [e for e in cell.events if isinstance(e, ReplannedEvent)]
    assert event.message == (
        f"stopped and planned anew: {block} is seen 64 mm and 1° from where it was when the arm set out"
    )
    assert (event.cause, event.object) == ("world.disturbed", block)


def test_a_target_seen_elsewhere_while_the_search_goes_on_is_not_approached() -> None:
    scene = items(block=1)
    slow = replace(scene, thinking=replace(scene.thinking, collision_check=0.01))
    cell = Cell(mission(LOOK), slow)
    cell.finish()
    belief = cell.world.scene.objects[0]
    cell.start(mission(sorting(cell, belief.id).removeprefix("{").removesuffix("}")))
    stood = cell.world.control.held_position.copy()
    tick_until(cell, "Grasp", 4)
    assert np.array_equal(cell.world.control.held_position, stood), "it still thinks"
    move(cell, 0.05, -0.04)
    cell.world.scene.put(replace(belief, pose=belief.pose.shifted((0.05, -0.04, 0.0))), "seen there")
    cell.finish()
    assert (cell.tree.status.value, cell.score().count.sorted) == ("SUCCESS", 1)
    (event,) = [e for e in cell.events if isinstance(e, ReplannedEvent)]
    assert (event.cause, event.object) == ("world.disturbed", belief.id)


def test_a_target_that_vanishes_is_told_at_once() -> None:
    cell, (block,) = looked(block=1)
    cell.start(mission(watched(sorting(cell, block))))
    tick_until(cell, "Grasp", 4)
    cell.kinematic.remove("item_00")
    cell.finish()
    assert (
        cell.told
        == f"world.unknown_object: {block} is gone: its place was seen empty while the arm was on the way"
    )
    assert not cell.happened("pick")


def test_what_is_put_where_it_would_be_let_go_sends_it_to_another_spot() -> None:
    cell, (block,) = looked(block=1)
    cell.start(mission(sorting(cell, block).removeprefix("{").removesuffix("}")))
    tick_until(cell, "Place", 2)
    into = str(cell.world.scene.destination(block))
    heights = np.full((3, 3), 0.02)
    heights[1, 1] = 0.11
    cell.world.vision.bins[into] = BinView(heights)
    cell.world.vision.observations += 1
    cell.finish()
    assert (cell.tree.status.value, cell.score().count.sorted) == ("SUCCESS", 1)
    (event,) = [e for e in cell.events if isinstance(e, ReplannedEvent)]
    assert event.message == (
        f"stopped and planned anew: something was put into {into} meanwhile: its heap is 110 mm high"
    )
    (done,) = [e for e in cell.events if isinstance(e, ItemDoneEvent)]
    assert done.spot != "cell 1,1"


def test_a_point_that_is_taken_meanwhile_is_occupied() -> None:
    cell, (block, other) = looked(block=1, can=1)
    cell.start(mission(f"Sequence: [{{Grasp: {{object: {block}, onward: false}}}}, "
                       f"{{Place: {{object: {block}, at: [0.5, 0.0, 0.0]}}}}]"))  # fmt: skip
    tick_until(cell, "Place", 8)
    known = cell.world.scene.get(other)
    cell.world.scene.put(replace(known, pose=replace(known.pose, position=(0.5, 0.0, 0.04))), "seen")
    cell.finish()
    assert cell.told == f"place.occupied: {other} stands where {block} should go"
    assert cell.world.scene.held is not None


def test_it_plans_anew_a_bounded_number_of_times(monkeypatch: pytest.MonkeyPatch) -> None:
    cell, _ = looked(block=1)

    def blocked(*_: Any) -> Failure:
        return Failure(planning.BLOCKED, "the way is not free: somebody is in it")

    monkeypatch.setattr(TrajectoryGate, "blocked", blocked)
    cell.do("GoTo: {pose: observe}")
    failure = cell.failure
    assert str(failure.cause) == "planning.blocked"
    assert len(cell.happened("replanned")) == MAX_REPLANS
    assert cell.world.control.at_rest


def test_who_is_blind_for_too_long_halts_what_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    cell, _ = looked(block=1)

    def dark(self: Vision, camera: str) -> Any:
        raise Failure(perception.NO_IMAGE, "overhead gives no image")

    monkeypatch.setattr(Vision, "capture_now", dark)
    body = "{GoTo: {pose: rest, speed: 0.05}}"
    cell.start(mission(f"WatchScene: {{every: 250 ms, blind: 1 s, do: {body}}}"))
    began = cell.world.clock.now
    cell.finish()
    assert cell.failure.message == "overhead gives no image"
    assert 1.0 < cell.world.clock.now - began < 1.5
    assert cell.rest() < 0.5
    off = cell.world.control.state.position - cell.world.robot.named("rest")
    assert np.abs(off).max() > 0.1


def test_pictures_of_a_moving_arm_do_no_harm_to_the_belief() -> None:
    """Over a whole sort: nothing that is not there, nothing lost, nothing stopped for."""
    cell = Cell(mission(LOOK), items(block=1, plate=1))
    cell.finish()
    value = cell.tree.blackboard.save()["Main/items"]
    assert isinstance(value, list)
    known = {str(o.id) for o in cell.world.scene.objects}
    looks = cell.world.vision.observations
    for item in value:
        cell.do(watched(sorting(cell, str(item))))
        assert cell.tree.status.value == "SUCCESS"
    assert {str(o.id) for o in cell.world.scene.objects} == known
    assert cell.world.vision.observations > looks + 20
    assert cell.happened("replanned") == []


def test_a_camera_that_hangs_elsewhere_sees_no_obstacle_in_the_robot_itself() -> None:
    scene = items(block=1)
    (overhead,) = scene.cameras
    off = replace(scene, cameras=(replace(overhead, error=replace(overhead.error, position=(0.008,) * 3)),))
    cell = Cell(mission(LOOK), off)
    cell.finish()
    (block,) = cell.world.scene.objects
    (body,) = cell.hardware.truth()
    assert block.role == "item"
    assert 0.008 < block.pose.distance(body.pose) < 0.016
