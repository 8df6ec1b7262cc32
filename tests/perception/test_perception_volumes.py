"""Unknown volumes: unexplained depth adds blocks, rays that pass remove them, hidden blocks stay."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.robot.perception import Perception, update_belief
from picktree.robot.perception.obstacle_volumes import (
    CELL_SIZE,
    UNSEEN_REACH,
    cell_centres,
    cell_keys,
    cells_in_body,
    cells_of,
)
from picktree.robot.perception.view import Detection
from picktree.robot.planning.collision_model import movable_bodies
from picktree.world import (
    Array,
    BeliefObject,
    Box,
    Cylinder,
    PlanningScene,
    Pose,
    Shape,
    Sphere,
    inside,
)

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
    obstacle,
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


@pytest.mark.parametrize(
    ("thing", "grown", "covered"),
    [
        (POST, Box((0.104, 0.094, 0.344)), 0.999),
        (Thing(Cylinder(0.04, 0.25), Pose((0.6, -0.2, 0.125)), "white"), Cylinder(0.062, 0.294), 0.999),
        (Thing(Box((0.05, 0.05, 0.3)), Pose((0.5, 0.0, 0.15)), "red"), Box((0.094, 0.094, 0.344)), 0.999),
        # But for a rim of some mm on the far side.
        (Thing(Sphere(0.06), Pose((0.6, 0.2, 0.06)), "dark_grey"), Cylinder(0.082, 0.164), 0.97),
    ],
)
def test_a_thing_is_covered_wholly_and_little_else(thing: Thing, grown: Shape, covered: float) -> None:
    """Up to two cells and the noise around it."""
    scene = empty_scene()
    look(scene, thing, now=1)
    assert [str(o.id) for o in obstacles(scene)] == ["obstacle_1"]
    assert share_covered(scene, thing) > covered
    points = taken_up(scene)
    assert inside(grown, thing.pose, points).all()
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
    assert update_belief(scene, view_of([], scene=scene), 2.0).removed == ("obstacle_1",)
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
    sight = view_of(()).sight
    places = np.array([(x, 0.0, 0.3) for x in np.arange(0.5, 2.0, 0.01)])
    seen = np.all((sight.pixels(places) >= 0) & (sight.pixels(places) < (320, 240)), axis=1)
    edge = float(places[~seen][0, 0])
    post = Thing(Box((0.06, 0.06, 0.3)), Pose((edge, 0.0, 0.15)), "grey")
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
    scene.put(obstacle(cells_in_body(Box((0.045, 0.045, 0.045)), block.pose), "obstacle_7"), "test")
    look(scene, block, now=1)
    assert [str(o.id) for o in scene.objects] == ["red_block_1"]


@given(st.lists(st.tuples(*[st.integers(-4, 4)] * 3), min_size=1, max_size=60))
def test_boxes_cover_their_cells_exactly(places: list[tuple[int, int, int]]) -> None:
    cells = cell_keys(np.array(places))
    assert np.array_equal(cells_of(obstacle(cells)), cells)


def test_an_obstacle_of_an_older_log_is_taken_up_too() -> None:
    scene = empty_scene()
    turned = Pose.from_rpy((0.5, 0.15, 0.15), (0.0, 0.0, math.pi / 4))
    older = replace(obstacle(np.array([0])), shape=Box((0.06, 0.06, 0.3)), pose=turned, blocks=())
    scene.put(older, "test")
    assert len(cells_of(scene.get("obstacle_1"))) * float(np.prod(CELL_SIZE)) > 0.9 * 0.06 * 0.06 * 0.3
    look(scene, Thing(Box((0.06, 0.06, 0.3)), turned, "grey"), now=1)
    (known,) = obstacles(scene)
    assert str(known.id) == "obstacle_1" and known.blocks


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
    cross = [cells_in_body(Box(size), Pose()) for size in ((0.3, 0.04, 0.2), (0.04, 0.3, 0.2))]
    loose = movable_bodies([obstacle(np.unique(np.concatenate(cross)))])
    assert [b.name for b in loose] == ["obstacle_1"] * 2


def test_few_hulls_stand_for_the_blocks_of_a_bent_body() -> None:
    """Two slanting walls at a right angle: one hull would fill the corner between them."""
    walls = [
        cells_in_body(Box((0.3, 0.04, 0.2)), Pose.from_rpy((0.5 + x, y, 0.1), (0.0, 0.0, yaw)))
        for x, y, yaw in ((0.0, 0.0, 0.5), (-0.19, 0.06, 0.5 + math.pi / 2))
    ]
    cells = np.unique(np.concatenate(walls))
    bent = obstacle(cells)
    bodies = movable_bodies([bent])
    assert 2 <= len(bodies) < len(bent.blocks) / 3
    assert np.any([inside(body.shape, body.pose, cell_centres(cells)) for body in bodies], axis=0).all()
    taken = np.unique(np.concatenate([cells_in_body(body.shape, body.pose) for body in bodies]))
    assert len(taken) < 1.25 * len(cells)


LONG = [
    standing(Cylinder(0.018, 0.26), 0.46, -0.03, 2.3, "red", lying=True),
    standing(Cylinder(0.0155, 0.17), 0.4, -0.05, -1.0, "yellow", lying=True),
    standing(Box((0.20, 0.045, 0.05)), 0.40, -0.2, 0.8, "yellow"),
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
    for kinds, row in (
        (["block"] * 4, [standing(BLOCK, 0.40 + 0.0405 * k, -0.1, 0.0, "red") for k in range(4)]),
        (["brick"] * 3, [standing(BRICK, 0.50, -0.2 + 0.0305 * k, 0.0, "green") for k in range(3)]),
        (["can"] * 3, [standing(CAN, 0.45, -0.2 + 0.0705 * k, 0.0, "blue", lying=True) for k in range(3)]),
    ):
        view = view_of(row)
        assert [d.kind for d in view.detections] == kinds
        assert not view.unexplained


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
