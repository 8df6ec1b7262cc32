"""Ids from view to view."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from picktree.robot.perception import update_belief
from picktree.world import BeliefObject, Box, ObjectId, PlanningScene, Pose, Shape

from .perception_pictures import (
    BALL,
    BLOCK,
    CAN,
    Robot,
    Thing,
    empty_scene,
    standing,
    view_of,
)

RED = standing(BLOCK, 0.45, -0.1, 0.2, "red")
BLUE = standing(CAN, 0.6, 0.1, 0.0, "blue")


def look(scene: PlanningScene, *things: Thing, robot: Robot | None = None, now: float = 1.0):
    return update_belief(scene, view_of(things, robot=robot, scene=scene, seed=int(now)), now)


def ids(scene: PlanningScene) -> list[str]:
    return [str(o.id) for o in scene.objects]


def test_a_first_view_names_what_it_sees() -> None:
    scene = empty_scene()
    summary = look(scene, RED, BLUE, now=2.0)
    assert sorted(ids(scene)) == ["blue_can_1", "red_block_1"]
    assert sorted(summary.new) == sorted(summary.seen) == ["blue_can_1", "red_block_1"]
    red = scene.get("red_block_1")
    assert (red.role, red.kind, red.form, red.colour, red.place) == ("item", "block", "box", "red", "table")
    assert red.last_seen == 2.0
    assert red.pose.distance(RED.pose) < 0.002


def test_an_id_stays_with_its_object() -> None:
    scene = empty_scene()
    look(scene, RED, BLUE)
    pushed = standing(BLOCK, 0.47, -0.11, 0.4, "red")
    summary = look(scene, pushed, BLUE, now=3.0)
    assert summary.new == () and summary.removed == ()
    assert sorted(summary.seen) == ["blue_can_1", "red_block_1"]
    assert scene.get("red_block_1").pose.distance(pushed.pose) < 0.002
    assert scene.get("red_block_1").last_seen == 3.0


def test_equal_neighbours_that_move_keep_their_ids_by_place() -> None:
    scene = empty_scene()
    a, b = standing(BLOCK, 0.5, -0.05, 0.2, "red"), standing(BLOCK, 0.5, 0.02, 0.3, "red")
    look(scene, a, b)
    before = {o.id: o.pose.position[1] for o in scene.objects}
    look(scene, replace(a, pose=a.pose.shifted((0, 0.02, 0))), replace(b, pose=b.pose.shifted((0, 0.02, 0))))
    after = {o.id: o.pose.position[1] for o in scene.objects}
    assert after.keys() == before.keys()
    assert all(after[k] - before[k] == pytest.approx(0.02, abs=0.003) for k in before)


def test_equal_items_that_swapped_colours_are_not_confused() -> None:
    scene = empty_scene()
    a, b = standing(BLOCK, 0.5, -0.03, 0.0, "red"), standing(BLOCK, 0.5, 0.03, 0.0, "blue")
    look(scene, a, b)
    look(scene, replace(a, colour="blue"), replace(b, colour="red"), now=2.0)
    assert sorted(ids(scene)) == ["blue_block_1", "red_block_1"]
    assert scene.get("red_block_1").pose.distance(b.pose) < 0.003


def test_what_is_seen_to_be_gone_is_removed() -> None:
    scene = empty_scene()
    look(scene, RED, BLUE)
    summary = look(scene, BLUE, now=2.0)
    assert summary.removed == ("red_block_1",)
    assert ids(scene) == ["blue_can_1"]


def test_what_is_hidden_by_the_arm_is_kept() -> None:
    scene = empty_scene()
    look(scene, RED, BLUE)
    before = scene.get("red_block_1")
    hand = Robot(Box((0.15, 0.2, 0.05)), Pose((0.45, -0.08, 0.4)))
    summary = look(scene, BLUE, Thing(hand.box, hand.pose, "white"), robot=hand, now=2.0)
    assert summary.hidden == ("red_block_1",) and summary.removed == ()
    assert scene.get("red_block_1") == before


def test_what_is_hidden_by_something_taller_is_kept() -> None:
    scene = empty_scene()
    low = standing(BALL, 0.5, -0.33, 0.0, "green")
    look(scene, low)
    screen = Thing(Box((0.1, 0.02, 0.15)), Pose((0.5, -0.29, 0.075)), "grey")
    summary = look(scene, screen, now=2.0)
    assert summary.hidden == ("green_ball_1",)
    assert [o.role for o in scene.objects] == ["item", "obstacle"]


def test_the_held_object_is_not_touched() -> None:
    scene = empty_scene()
    look(scene, RED, BLUE)
    hand = Robot(Box((0.05, 0.2, 0.05)), Pose((0.45, -0.1, 0.4)))
    in_tcp = Pose((0.0, 0.0, -0.05))
    scene.attach("red_block_1", in_tcp)
    scene.carry(hand.pose)
    before = scene.get("red_block_1")
    carried = [Thing(BLOCK, hand.pose @ in_tcp, "red"), Thing(hand.box, hand.pose, "white")]
    summary = look(scene, BLUE, *carried, robot=hand, now=2.0)
    assert scene.get("red_block_1") == before
    assert summary.seen == ("blue_can_1",) and summary.removed == ()


def test_the_held_object_stays_held_whatever_is_seen() -> None:
    scene = empty_scene()
    look(scene, RED)
    scene.attach("red_block_1", Pose())
    before = scene.get("red_block_1")
    summary = update_belief(scene, view_of([BLUE]), 2.0)
    assert scene.get("red_block_1") == before, "only the gripper's sensors may say that it is lost"
    assert summary.removed == ()


def test_an_item_that_left_its_place_keeps_its_id() -> None:
    scene = empty_scene()
    look(scene, RED, BLUE)
    rolled = standing(BLOCK, 0.6, -0.25, 1.0, "red")
    summary = look(scene, rolled, BLUE, now=2.0)
    assert summary.new == () and summary.removed == ()
    assert scene.get("red_block_1").pose.distance(rolled.pose) < 0.002


def test_an_item_seen_in_a_bin_is_believed_in_it() -> None:
    scene = empty_scene()
    look(scene, RED)
    look(scene, Thing(BLOCK, Pose((0.41, 0.39, 0.025)), "red"), now=2.0)
    assert [(str(o.id), o.place) for o in scene.objects] == [("red_block_1", "red_bin")]


def test_an_item_put_aside_stays_aside() -> None:
    scene = empty_scene()
    look(scene, RED)
    scene.put(replace(scene.get("red_block_1"), place="aside"), "given up")
    look(scene, RED, now=2.0)
    assert scene.get("red_block_1").place == "aside"


def test_an_item_put_aside_stays_aside_through_a_picture_in_another_colour() -> None:
    scene = empty_scene()
    look(scene, RED, BLUE)
    scene.put(replace(scene.get("red_block_1"), place="aside"), "given up")
    for colour, now in (("green", 2.0), ("red", 3.0)):
        look(scene, replace(RED, colour=colour), replace(BLUE, colour="green"), now=now)
        item = scene.get("red_block_1")
        assert (item.colour, item.place, item.pose.distance(RED.pose) < 0.01) == (colour, "aside", True)
        assert [o.place for o in scene.objects if o.pose.distance(BLUE.pose) < 0.01] == ["table"]


def test_an_item_put_aside_that_went_elsewhere_is_among_the_others_again() -> None:
    scene = empty_scene()
    look(scene, RED)
    scene.put(replace(scene.get("red_block_1"), place="aside"), "given up")
    look(scene, standing(BLOCK, 0.45, 0.2, 0.2, "red"), now=2.0)
    assert ids(scene) == ["red_block_1"]
    assert scene.get("red_block_1").place == "table"


def test_obstacles_are_replaced_where_they_are_seen() -> None:
    scene = empty_scene()
    wall = Thing(Box((0.1, 0.08, 0.1)), Pose((0.5, -0.15, 0.05)), "grey")
    assert look(scene, wall).unexplained == 1
    (obstacle,) = scene.objects
    assert (str(obstacle.id), obstacle.role, obstacle.kind) == ("obstacle_1", "obstacle", "unknown")
    moved = replace(wall, pose=wall.pose.shifted((0.02, 0.0, 0.0)))
    look(scene, moved, now=2.0)
    assert ids(scene) == ["obstacle_1"]
    assert scene.get("obstacle_1").pose.distance(moved.pose) < 0.02
    assert look(scene, now=3.0).removed == ("obstacle_1",)
    assert scene.objects == ()


def test_a_heading_does_not_jump_between_equal_ones() -> None:
    scene = empty_scene()
    headings: list[float] = []
    for now in range(1, 5):
        look(scene, standing(BLOCK, 0.5, 0.0, math.pi / 4, "red"), now=float(now))
        x = scene.get("red_block_1").pose.rotation()[:2, 0]
        headings.append(math.atan2(x[1], x[0]))
    assert max(headings) - min(headings) < math.radians(6)


def test_the_kind_of_a_known_object_survives_a_doubtful_look() -> None:
    scene = empty_scene()
    look(scene, RED)
    view = view_of([RED])
    doubtful = replace(view.detections[0], kind="brick", confidence=0.2)
    update_belief(scene, replace(view, detections=(doubtful,)), 5.0)
    red = scene.get("red_block_1")
    assert (red.kind, red.last_seen) == ("block", 5.0)


def test_a_view_through_the_same_eyes_changes_nothing_but_the_time() -> None:
    scene = empty_scene()
    view = view_of([RED, BLUE])
    update_belief(scene, view, 1.0)
    before = {o.id: o.pose for o in scene.objects}
    update_belief(scene, view, 2.0)
    assert {o.id: o.pose for o in scene.objects} == before


def test_seen_empty_needs_the_pixels_to_say_so() -> None:
    view = view_of([BLUE])
    shape: Shape = BLOCK
    assert view.look(shape, RED.pose, "red").is_empty
    assert not view.look(CAN, BLUE.pose, "blue").is_empty
    outside = view.look(shape, Pose((3.0, 0.0, 0.02)), "red")
    assert outside.hidden and not outside.is_empty


def test_an_item_is_believed_until_it_is_seen_missing() -> None:
    scene = empty_scene()
    scene.put(
        BeliefObject(
            "block", "box", BLOCK, "red", Pose((3, 0, 0.02)), 1e-3, 1e-2, 0.9, 0.0, id=ObjectId("red_block_9")
        ),
        "told",
    )
    summary = look(scene, BLUE)
    assert summary.hidden == ("red_block_9",)
