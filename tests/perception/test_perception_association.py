"""Ids from view to view."""

from __future__ import annotations

from dataclasses import replace

from picktree.robot.perception import update_belief
from picktree.robot.perception.view import Detection
from picktree.world import Box, PlanningScene, Pose

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
from .synthetic_view import synthetic_view

RED = standing(BLOCK, 0.45, -0.1, 0.2, "red")
BLUE = standing(CAN, 0.6, 0.1, 0.0, "blue")


def look(scene: PlanningScene, *things: Thing, robot: Robot | None = None, now: float = 1.0):
    return update_belief(scene, view_of(things, robot=robot, scene=scene, seed=int(now)), now)


def ids(scene: PlanningScene) -> list[str]:
    return [str(o.id) for o in scene.objects]


def test_what_a_first_view_names_keeps_its_name() -> None:
    scene = empty_scene()
    summary = look(scene, RED, BLUE, now=2.0)
    assert sorted(ids(scene)) == ["blue_can_1", "red_block_1"]
    assert sorted(summary.new) == sorted(summary.seen) == ["blue_can_1", "red_block_1"]
    red = scene.get("red_block_1")
    assert (red.role, red.kind, red.form, red.colour, red.place) == ("item", "block", "box", "red", "table")
    assert red.last_seen == 2.0
    assert red.pose.distance(RED.pose) < 0.002
    pushed = standing(BLOCK, 0.47, -0.11, 0.4, "red")
    summary = look(scene, pushed, BLUE, now=3.0)
    assert summary.new == () and summary.removed == ()
    assert scene.get("red_block_1").pose.distance(pushed.pose) < 0.002
    assert scene.get("red_block_1").last_seen == 3.0


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


def test_an_item_put_aside_stays_aside_through_a_picture_in_another_colour() -> None:
    scene = empty_scene()
    look(scene, RED, BLUE)
    scene.put(replace(scene.get("red_block_1"), place="aside"), "given up")
    for colour, now in (("green", 2.0), ("red", 3.0)):
        look(scene, replace(RED, colour=colour), replace(BLUE, colour="green"), now=now)
        item = scene.get("red_block_1")
        assert (item.colour, item.place, item.pose.distance(RED.pose) < 0.01) == (colour, "aside", True)
        assert [o.place for o in scene.objects if o.pose.distance(BLUE.pose) < 0.01] == ["table"]


def test_a_view_through_the_same_eyes_changes_nothing_but_the_time() -> None:
    scene = empty_scene()
    view = view_of([RED, BLUE])
    update_belief(scene, view, 1.0)
    before = {o.id: o.pose for o in scene.objects}
    update_belief(scene, view, 2.0)
    assert {o.id: o.pose for o in scene.objects} == before


def test_a_name_that_another_process_reports_is_weighed_against_the_believed_one() -> None:
    """A single wrong name changes nothing but the confidence; the object stays itself under its new name."""
    red = Detection("block", "box", BLOCK, "red", RED.pose, 0.003, 0.03, 0.9, reported=True)
    near = Pose((RED.pose.position[0] + 0.008, *RED.pose.position[1:]))
    can = replace(red, kind="can", form="cylinder", shape=CAN, colour="blue", pose=near)
    scene = empty_scene()
    found: list[tuple[str, float]] = []
    for now, seen in enumerate((red, red, can, red, can, can, can, can), start=1):
        view = replace(synthetic_view(), detections=(seen,))
        summary = update_belief(scene, view, float(now))
        assert summary.removed == () and ids(scene) == ["red_block_1"]
        one = scene.get("red_block_1")
        found.append((f"{one.colour} {one.kind}", round(one.confidence, 2)))
        assert one.last_seen == now
    believed = [("red block", c) for c in (0.9, 0.99, 0.9, 0.99, 0.9, 0.5)]
    assert found == [*believed, ("blue can", 0.9), ("blue can", 0.99)]
    scene.attach("red_block_1", Pose())
    assert update_belief(scene, replace(synthetic_view(), detections=(red, can)), 9.0).new == ()
