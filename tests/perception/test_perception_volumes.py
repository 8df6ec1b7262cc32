"""Unknown volumes: unexplained depth adds blocks, rays that pass remove them, hidden blocks stay."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.perception import Perception, update_belief
from picktree.robot.perception.obstacle_volumes import (
    CELL_SIZE,
    UNSEEN_REACH,
    cell_centres,
    cell_keys,
    cells_in_body,
    cells_of,
    merge_cells,
    obstacle_from_cells,
)
from picktree.robot.perception.view import Detection
from picktree.robot.planning.collision_model import movable_bodies
from picktree.world import Array, BeliefObject, Box, Cylinder, ObjectId, PlanningScene, Pose, Sphere, inside

from .perception_pictures import (
    BLOCK,
    BRICK,
    CAN,
    LYING,
    RED_BIN,
    SCENE,
    Robot,
    Thing,
    empty_scene,
    photograph,
    standing,
    view_of,
)

POST = Thing(Box((0.06, 0.05, 0.3)), Pose.from_rpy((0.5, 0.15, 0.15), (0.0, 0.0, 0.4)), "grey")


def look(scene: PlanningScene, *things: Thing, now: float, robot: Robot | None = None) -> list[str]:
    """Look once; the reasons for what changed in the obstacles."""
    scene.take_changes()
    update_belief(scene, view_of(things, scene=scene, robot=robot, seed=int(now)), now)
    changes = scene.take_changes()
    return [c.reason for c in changes if (c.after or c.before) and (c.after or c.before).role == "obstacle"]  # pyright: ignore[reportOptionalMemberAccess]


def obstacles(scene: PlanningScene) -> list[BeliefObject]:
    return [o for o in scene.objects if o.role == "obstacle"]


def in_picture(x: float, z: float) -> bool:
    """Whether the camera sees that place above y = 0."""
    sight = view_of(()).sight
    (u, v), (h, w) = sight.pixels(np.array([[x, 0.0, z]]))[0], view_of(()).depth.shape
    return 0 <= u < w and 0 <= v < h


def taken_up(scene: PlanningScene) -> Array:
    """Middles of the cells that are taken up (n, 3), m."""
    return np.concatenate([cell_centres(cells_of(o)) for o in obstacles(scene)])


def share_covered(scene: PlanningScene, thing: Thing) -> float:
    """Return the share of the thing that blocks cover, by points drawn in it."""
    reach = 0.5 * np.array([0.5, 0.5, 0.5])
    points = thing.pose.apply(np.random.default_rng(1).uniform(-reach, reach, (200_000, 3)))
    points = points[inside(thing.shape, thing.pose, points)]
    covered = np.zeros(len(points), dtype=bool)
    for o in obstacles(scene):
        for block in o.blocks:
            covered |= inside(Box(block.size), o.pose @ Pose(block.at), points, 1e-6)
    return float(covered.mean())


def test_a_post_is_covered_wholly_and_little_else() -> None:
    for thing in (
        POST,
        Thing(Cylinder(0.04, 0.25), Pose((0.6, -0.2, 0.125)), "white"),
        Thing(Box((0.05, 0.05, 0.3)), Pose((0.5, 0.0, 0.15)), "red"),
    ):
        scene = empty_scene()
        look(scene, thing, now=1)
        assert [str(o.id) for o in obstacles(scene)] == ["obstacle_1"]
        assert share_covered(scene, thing) > 0.999
        points = taken_up(scene)
        grown = 0.022  # two cells and the noise
        shape = Box(tuple(s + 2 * grown for s in thing.shape.size)) if isinstance(thing.shape, Box) else None  # pyright: ignore[reportArgumentType]
        round_ = Cylinder(0.04 + grown, 0.25 + 2 * grown)
        assert inside(shape or round_, thing.pose, points).all()
        assert points[:, 2].min() > 0.0, "the table itself is none"


def test_it_stays_the_same_while_nothing_changes() -> None:
    scene = empty_scene()
    assert look(scene, POST, now=1) == ["depth that nothing explains"]
    reasons = [look(scene, POST, now=n) for n in range(2, 6)]
    settled = obstacles(scene)[0]
    assert reasons[-2:] == [["seen again"], ["seen again"]], "noise must not make it another each time"
    look(scene, POST, now=9)
    assert obstacles(scene)[0].blocks == settled.blocks
    assert obstacles(scene)[0].last_seen == 9.0


def test_what_is_taken_away_is_gone_with_the_next_look() -> None:
    scene = empty_scene()
    look(scene, POST, now=1)
    assert look(scene, now=2) == ["its place was seen without it"]
    assert scene.objects == ()


def test_what_moves_clears_behind_and_grows_ahead() -> None:
    scene = empty_scene()
    look(scene, POST, now=1)
    ahead = replace(POST, pose=POST.pose.shifted((0.04, 0.0, 0.0)))
    assert look(scene, ahead, now=2) == ["it was seen to take up other space"]
    assert [str(o.id) for o in obstacles(scene)] == ["obstacle_1"]
    assert share_covered(scene, ahead) > 0.999
    assert taken_up(scene)[:, 0].min() > POST.pose.position[0] - 0.03


def test_what_the_arm_hides_stays() -> None:
    scene = empty_scene()
    look(scene, POST, now=1)
    before = obstacles(scene)
    hand = Robot(Box((0.25, 0.25, 0.05)), Pose((0.5, 0.1, 0.55)))
    arm = Thing(hand.box, hand.pose, "white")
    assert look(scene, arm, now=2, robot=hand) == []
    assert obstacles(scene) == before
    assert look(scene, now=3) == ["its place was seen without it"]


def test_what_the_arm_hid_of_it_grows_when_it_is_seen() -> None:
    wall = Thing(Box((0.04, 0.4, 0.1)), Pose((0.65, -0.1, 0.05)), "grey")
    hand = Robot(Box((0.15, 0.2, 0.05)), Pose((0.62, -0.18, 0.4)))
    scene = empty_scene()
    look(scene, wall, Thing(hand.box, hand.pose, "white"), now=1, robot=hand)
    assert share_covered(scene, wall) < 0.8
    assert "it was seen to take up other space" in look(scene, wall, now=2)
    assert share_covered(scene, wall) > 0.999


def test_what_comes_may_go_on_behind_the_arm_until_it_is_seen_there() -> None:
    """More than half of a post shows beside the hand that hides the rest of it."""
    post = Thing(Box((0.06, 0.12, 0.3)), Pose((0.5, 0.15, 0.15)), "grey")
    hand = Robot(Box((0.12, 0.08, 0.05)), Pose((0.5, 0.175, 0.45)))
    scene = empty_scene()
    look(scene, post, Thing(hand.box, hand.pose, "white"), now=1, robot=hand)
    assert share_covered(scene, post) > 0.95
    points = taken_up(scene)
    assert not inside(hand.box, hand.pose, points, 0.03).any(), "the arm stands there itself"
    assert np.abs(points[:, :2] - post.pose.position[:2]).max() < 0.06 + 0.022 + UNSEEN_REACH
    look(scene, post, now=2)
    assert share_covered(scene, post) > 0.999
    assert np.abs(taken_up(scene)[:, :2] - post.pose.position[:2]).max() < 0.06 + 0.022


def test_what_comes_may_go_on_beyond_the_edge_of_the_picture() -> None:
    edge = next(x for x in np.arange(0.5, 2.0, 0.01) if not in_picture(x, 0.3))
    post = Thing(Box((0.06, 0.06, 0.3)), Pose((float(edge), 0.0, 0.15)), "grey")
    scene = empty_scene()
    look(scene, post, now=1)
    high = taken_up(scene)
    high = high[high[:, 2] > 0.2]
    assert high[:, 0].max() > edge + 0.02, "its outer half is not in the picture"
    assert look(scene, post, now=2) == ["seen again"]
    assert look(scene, now=3) == ["its place was seen without it"]


def test_what_is_known_does_not_grow_behind_the_arm() -> None:
    scene = empty_scene()
    look(scene, POST, now=1)
    before = taken_up(scene)
    for n, y in enumerate((0.10, 0.15, 0.20), 2):
        hand = Robot(Box((0.25, 0.05, 0.05)), Pose((0.5, y, 0.5)))
        look(scene, POST, Thing(hand.box, hand.pose, "white"), now=n, robot=hand)
    assert abs(len(taken_up(scene)) - len(before)) <= 0.03 * len(before)


def test_below_a_bar_that_is_seen_to_hang_there_is_room() -> None:
    bar = Thing(Box((0.3, 0.05, 0.04)), Pose((0.5, -0.36, 0.3)), "grey")
    scene = empty_scene()
    look(scene, bar, now=1)
    assert share_covered(scene, bar) > 0.99
    below = taken_up(scene)
    below = below[below[:, 2] < 0.1]
    full = len(cells_in_body(Box((0.3, 0.05, 0.1)), Pose((0.5, -0.36, 0.05))))
    assert len(below) < 0.35 * full, "rays pass below it"


def test_items_and_bins_are_not_blocked() -> None:
    scene = empty_scene()
    can = standing(CAN, 0.5, 0.06, 0.0, "blue")
    in_bin = Thing(BLOCK, Pose((0.41, 0.39, 0.025)), "red")
    at_bin = Thing(Box((0.05, 0.05, 0.3)), Pose((0.4, 0.26, 0.15)), "grey")
    for n in range(1, 3):
        look(scene, POST, can, in_bin, at_bin, now=n)
    assert [o.kind for o in scene.objects if o.role == "item"].count("can") == 1
    points = taken_up(scene)
    assert not inside(can.shape, can.pose, points).any()
    low, high = RED_BIN.inside()
    local = RED_BIN.pose.inverse().apply(points)
    assert not (np.all(local > np.array(low), axis=1) & np.all(local < np.array(high), axis=1)).any()


def test_an_item_behind_it_is_not_given_up() -> None:
    scene = empty_scene()
    low = standing(BLOCK, 0.5, -0.3, 0.0, "green")
    look(scene, low, now=1)
    assert [str(o.id) for o in scene.objects] == ["green_block_1"]
    tall = Thing(Box((0.12, 0.04, 0.35)), Pose((0.5, -0.24, 0.175)), "grey")
    look(scene, low, tall, now=2)
    assert scene.find("green_block_1") is not None
    look(scene, low, now=3)
    assert [str(o.id) for o in scene.objects] == ["green_block_1"]


def test_noise_and_flying_pixels_leave_no_specks() -> None:
    things = [standing(BLOCK, 0.4 + 0.1 * k, -0.2, 0.3 * k, "red") for k in range(2)]
    for seed in range(2):
        scene = empty_scene()
        image = photograph([*things, POST], seed=seed, noise=0.003)
        depth = image.depth.copy()
        rng = np.random.default_rng(seed)
        jump = np.abs(np.diff(depth, axis=1, prepend=depth[:, :1])) > 0.02
        flying = jump & (depth > 0) & (rng.random(depth.shape) < 0.5)
        depth[flying] = depth[flying] - rng.uniform(0.02, 0.25, int(flying.sum())).astype(np.float32)
        spoilt = replace(image, depth=depth)
        update_belief(scene, Perception(SCENE, Robot()).detect(spoilt, np.zeros(7), 0.08, None), 1.0)
        (one,) = obstacles(scene)
        assert np.hypot(one.pose.position[0] - 0.5, one.pose.position[1] - 0.15) < 0.03


def test_something_of_an_items_colour_beside_the_arm_is_seen() -> None:
    tall = Thing(Box((0.05, 0.08, 0.27)), Pose.from_rpy((0.43, 0.1, 0.135), (0, 0, 2.5)), "yellow")
    hand = Robot(Box((0.12, 0.2, 0.1)), Pose((0.42, 0.26, 0.35)))
    scene = empty_scene()
    look(scene, tall, Thing(hand.box, hand.pose, "white"), now=1, robot=hand)
    assert [str(o.id) for o in scene.objects] == ["obstacle_1"]


def test_what_turns_out_to_be_an_item_is_no_obstacle_any_more() -> None:
    scene = empty_scene()
    block = standing(BLOCK, 0.5, -0.1, 0.2, "red")
    cells = cells_in_body(Box((0.045, 0.045, 0.045)), block.pose)
    shape, pose, blocks = obstacle_from_cells(merge_cells(cells))
    scene.put(
        BeliefObject(
            "unknown",
            "unknown",
            shape,
            "red",
            pose,
            0.005,
            0.1,
            0.5,
            0.0,
            id=ObjectId("obstacle_7"),
            role="obstacle",
            blocks=blocks,
        ),
        "test",
    )
    look(scene, block, now=1)
    assert [str(o.id) for o in scene.objects] == ["red_block_1"]


def test_boxes_cover_their_cells_exactly() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        cells = cell_keys(rng.integers(-4, 5, (int(rng.integers(1, 200)), 3)))
        shape, pose, blocks = obstacle_from_cells(merge_cells(cells))
        o = BeliefObject(
            "unknown",
            "unknown",
            shape,
            "grey",
            pose,
            0,
            0,
            1,
            0,
            id=ObjectId("o"),
            role="obstacle",
            blocks=blocks,
        )
        assert np.array_equal(cells_of(o), cells)


def test_an_obstacle_of_an_older_log_is_taken_up_too() -> None:
    scene = empty_scene()
    turned = Pose.from_rpy((0.5, 0.15, 0.15), (0.0, 0.0, math.pi / 4))
    scene.put(
        BeliefObject(
            "unknown",
            "unknown",
            Box((0.06, 0.06, 0.3)),
            "grey",
            turned,
            0.005,
            0.1,
            0.5,
            0.0,
            id=ObjectId("obstacle_1"),
            role="obstacle",
        ),
        "test",
    )
    assert len(cells_of(scene.get("obstacle_1"))) * float(np.prod(CELL_SIZE)) > 0.9 * 0.06 * 0.06 * 0.3
    look(scene, Thing(Box((0.06, 0.06, 0.3)), turned, "grey"), now=1)
    (known,) = obstacles(scene)
    assert str(known.id) == "obstacle_1" and known.blocks


def test_a_ball_is_covered_down_to_the_table() -> None:
    ball = Thing(Sphere(0.06), Pose((0.6, 0.2, 0.06)), "dark_grey")
    scene = empty_scene()
    look(scene, ball, now=1)
    assert share_covered(scene, ball) > 0.97, "but for a rim of some mm on the far side"


def test_a_tower_of_an_items_colour_and_width_is_no_stack_of_items() -> None:
    for high in (0.11, 0.1243, 0.2):
        tower = Thing(
            Box((0.046, 0.047, high)), Pose.from_rpy((0.4, 0.22, high / 2), (0.0, 0.0, 1.0)), "blue"
        )
        scene = empty_scene()
        look(scene, tower, now=1)
        assert [str(o.id) for o in scene.objects] == ["obstacle_1"]


def test_a_hull_stands_for_many_blocks_where_it_is_tight() -> None:
    scene = empty_scene()
    look(scene, POST, now=1)
    (post,) = obstacles(scene)
    assert len(post.blocks) > 1
    (body,) = movable_bodies([post])
    assert body.name == "obstacle_1"
    assert inside(body.shape, body.pose, cell_centres(cells_of(post))).all()
    bent = np.concatenate(
        [cells_in_body(Box((0.3, 0.04, 0.2)), Pose()), cells_in_body(Box((0.04, 0.3, 0.2)), Pose())]
    )
    shape, pose, blocks = obstacle_from_cells(merge_cells(np.unique(bent)))
    loose = movable_bodies([replace(post, shape=shape, pose=pose, blocks=blocks)])
    assert [b.name for b in loose] == ["obstacle_1"] * len(blocks)
    assert len(blocks) == 2


def test_few_hulls_stand_for_the_blocks_of_a_bent_body() -> None:
    """Two slanting walls at a right angle: one hull would fill the corner between them."""
    walls = [
        cells_in_body(Box((0.3, 0.04, 0.2)), Pose.from_rpy((0.5 + x, y, 0.1), (0.0, 0.0, yaw)))
        for x, y, yaw in ((0.0, 0.0, 0.5), (-0.19, 0.06, 0.5 + math.pi / 2))
    ]
    cells = np.unique(np.concatenate(walls))
    shape, pose, blocks = obstacle_from_cells(merge_cells(cells))
    bent = BeliefObject(
        "unknown",
        "unknown",
        shape,
        "grey",
        pose,
        0,
        0,
        1,
        0,
        id=ObjectId("o"),
        role="obstacle",
        blocks=blocks,
    )
    bodies = movable_bodies([bent])
    assert 2 <= len(bodies) < len(blocks) / 3
    covered = [inside(body.shape, body.pose, cell_centres(cells)) for body in bodies]
    assert np.any(covered, axis=0).all()
    taken = np.unique(np.concatenate([cells_in_body(body.shape, body.pose) for body in bodies]))
    assert len(taken) < 1.25 * len(cells)


LONG = [
    standing(Cylinder(0.018, 0.26), 0.46, -0.03, 2.3, "red", lying=True),
    standing(Cylinder(0.025, 0.36), 0.55, -0.15, 0.4, "blue", lying=True),
    standing(Cylinder(0.0155, 0.17), 0.4, -0.05, -1.0, "yellow", lying=True),
    standing(Box((0.20, 0.045, 0.05)), 0.40, -0.2, 0.8, "yellow"),
    standing(Box((0.28, 0.036, 0.061)), 0.54, -0.05, -0.9, "green"),
    standing(Box((0.08, 0.08, 0.08)), 0.5, 0.1, 0.5, "green"),
    standing(Box((0.12, 0.12, 0.04)), 0.45, -0.2, 0.2, "blue"),
]
HAND = Robot(Box((0.1, 0.1, 0.1)), Pose((0.52, -0.09, 0.4)))


@pytest.mark.parametrize("thing", LONG, ids=lambda t: f"{t.colour} {t.shape}")
def test_what_is_larger_than_every_item_is_no_row_of_items(thing: Thing) -> None:
    scene = empty_scene()
    for now, robot in ((1.0, None), (2.0, HAND), (3.0, None)):
        update_belief(scene, view_of([thing], scene=scene, seed=int(now), robot=robot), now)
        assert [o.role for o in scene.objects] == ["obstacle"]
    assert share_covered(scene, thing) > 0.97


def test_flush_items_in_a_row_are_items() -> None:
    rows = (
        [standing(BLOCK, 0.40 + 0.0405 * k, -0.1, 0.0, "red") for k in range(4)],
        [standing(BRICK, 0.50, -0.2 + 0.0305 * k, 0.0, "green") for k in range(3)],
        [standing(CAN, 0.45, -0.2 + 0.0705 * k, 0.0, "blue", lying=True) for k in range(3)],
    )
    for row in rows:
        view = view_of(row)
        assert sorted(d.kind for d in view.detections) == sorted(k for k in kinds_of(row))
        assert not view.unexplained


def kinds_of(things: list[Thing]) -> list[str]:
    return [{BLOCK: "block", BRICK: "brick", CAN: "can"}[thing.shape] for thing in things]  # pyright: ignore[reportArgumentType]


PIPE = Thing(Cylinder(0.02, 0.26), Pose((0.45, -0.1, 0.02), LYING.orientation), "red")
"""A pipe as thick as a can, and 26 cm long."""


@pytest.mark.parametrize("at", [(0.45, -0.19, 0.3), (0.45, -0.01, 0.3), (0.43, -0.06, 0.35)])
def test_a_part_of_a_believed_obstacle_is_no_item(at: tuple[float, float, float]) -> None:
    """The arm leaves a piece in sight that looks like an item; and so do false detections of any kind."""
    scene = empty_scene()
    look(scene, PIPE, now=1)
    view = view_of([PIPE], scene=scene, seed=2, robot=Robot(Box((0.12, 0.2, 0.1)), Pose(at)))
    can = standing(CAN, 0.45, -0.12, 0.0, "red", lying=True)
    false = Detection("can", "cylinder", CAN, "red", can.pose, 0.001, 0.01, 0.9, math.pi)
    update_belief(scene, replace(view, detections=(*view.detections, false)), 2.0)
    assert [o.role for o in scene.objects] == ["obstacle"]


@pytest.mark.parametrize("colour", ["red", "green"])
def test_items_beside_and_against_an_obstacle_are_found(colour: str) -> None:
    items = [
        standing(BLOCK, 0.45 + 0.02 + 0.022, -0.15, 0.0, "green"),
        standing(CAN, 0.45 - 0.02 - 0.021, -0.05, 0.0, "green"),
        standing(BRICK, 0.56, -0.1, 0.5, "red"),
    ]
    thing = replace(PIPE, colour="red" if colour == "red" else "white")
    scene = empty_scene()
    look(scene, thing, now=1)
    look(scene, thing, *items, now=2)
    assert sorted(o.kind for o in scene.objects if o.role == "item") == ["block", "brick", "can"]
    assert [str(o.id) for o in obstacles(scene)] == ["obstacle_1"]
    # An item that was there first stays believed though the obstacle has come against it.
    look(scene, thing, *items, now=3)
    assert len(scene.objects) == 4


def test_an_obstacle_that_turns_out_to_be_two_items_is_none_any_more() -> None:
    two = [standing(CAN, 0.45, -0.1 + 0.0705 * k, 0.0, "red", lying=True) for k in range(2)]
    grey = [replace(one, colour="grey") for one in two]
    scene = empty_scene()
    look(scene, *grey, now=1)
    assert obstacles(scene)
    look(scene, *two, now=2)
    assert [o.kind for o in scene.objects] == ["can", "can"]


@pytest.mark.parametrize(("turn", "high"), [(0.0, 0.2), (0.3, 0.28), (1.2, 0.2)])
def test_what_comes_beside_the_arm_is_covered_up_to_the_arm(turn: float, high: float) -> None:
    hand = Robot(Box((0.12, 0.2, 0.15)), Pose((0.52, 0.1, 0.30)))
    bar = Thing(Box((0.05, 0.2, 0.05)), Pose.from_rpy((0.52, -0.06, high), (0.0, 0.0, turn)), "blue")
    scene = empty_scene()
    look(scene, bar, Thing(hand.box, hand.pose, "white"), now=1, robot=hand)
    assert [str(o.id) for o in scene.objects] == ["obstacle_1"]
    assert share_covered(scene, bar) > 0.7, "the arm itself hides the rest"


def test_a_cable_at_the_arm_is_of_the_arm() -> None:
    hand = Robot(Box((0.12, 0.2, 0.15)), Pose((0.52, 0.1, 0.30)))
    cable = Thing(Box((0.03, 0.06, 0.02)), Pose((0.52, -0.02, 0.32)), "white")
    scene = empty_scene()
    look(scene, cable, Thing(hand.box, hand.pose, "white"), now=1, robot=hand)
    assert not obstacles(scene)
