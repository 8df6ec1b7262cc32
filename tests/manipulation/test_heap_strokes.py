"""Strokes from a height map alone: bars and walls of known heights, without a scene."""

from __future__ import annotations

import math

import numpy as np
import pytest

from picktree.robot.manipulation.heap_stirring import (
    POSTURES,
    HeapStroke,
    Posture,
    heap_changed,
    heap_strokes,
)
from picktree.world import Array, Pose
from picktree.world.heap_geometry import HeightMap
from picktree.world.planar_geometry import PlanarPose
from picktree.world.robot_model import load_robot

GRIPPER = load_robot("panda").gripper
FLOOR, RIM = 0.004, 0.12
CORNER = Pose((0.35, -0.15, 0.0))


def tote(heights: Array, frame: Pose = CORNER) -> HeightMap:
    walls = np.ones(heights.shape, dtype=np.bool_)
    walls[2:-2, 2:-2] = False
    labels = np.zeros(heights.shape, dtype=np.uint8)
    return HeightMap.of(frame, 0.002, (FLOOR, RIM), heights, walls, labels)


def floor(side: int = 150) -> Array:
    return np.full((side, side), FLOOR)


def bar(x: int, y: int, side: int = 150) -> Array:
    """Bar of 40 × 60 × 30 mm along y with its middle at a cell, in a tote of `side` cells squared."""
    heights = floor(side)
    heights[x - 10 : x + 10, y - 15 : y + 15] = FLOOR + 0.03
    return heights


def swept(one: HeapStroke, heap: HeightMap) -> Array:
    """Heights of the map below the finger tips along a stroke, m."""
    inverse, found = heap.frame.inverse(), list[float]()
    for way in np.linspace(0.0, one.length, 40):
        at = one.start @ PlanarPose(float(way), 0.0)
        x, y, _ = inverse.apply(np.array([at.x, at.y, 0.0]))
        found.append(float(heap.heights()[int(x / heap.cell), int(y / heap.cell)]))
    return np.array(found)


@pytest.mark.parametrize("robot", ["panda", "panda_long_fingers"])
def test_fingers_do_not_meet_a_wall_on_the_way(robot: str) -> None:
    gripper = load_robot(robot).gripper
    half = gripper.pads[0][0].size[1]
    for one in heap_strokes(tote(bar(40, 60)), gripper):
        if one.posture.open:
            continue
        for way in (0.0, one.length):
            at = one.start @ PlanarPose(way, 0.0)
            assert max(abs(at.x - 0.5), abs(at.y)) < 0.146 - min(half, gripper.pads[0][0].size[0] / 2)


def test_an_empty_tote_has_no_strokes() -> None:
    assert heap_strokes(tote(floor()), GRIPPER) == []


def test_a_thing_in_the_middle_is_pushed_from_a_free_place_beside_it() -> None:
    heap = tote(bar(75, 75))
    best = next(one for one in heap_strokes(heap, GRIPPER) if not one.drags)
    heights = swept(best, heap)
    assert heights[0] < best.tips < FLOOR + 0.03
    assert heights.max() > best.tips


def test_what_has_a_crest_is_dragged_off_the_wall_behind_it() -> None:
    heights = floor()
    heights[3:25, 60:90] = FLOOR + 0.03
    heights[25:35, 60:90] = FLOOR + 0.045
    heap = tote(heights)
    best = next(one for one in heap_strokes(heap, GRIPPER) if one.drags)
    assert math.cos(best.start.yaw) > 0.7
    x, y, _ = heap.frame.inverse().apply(np.array([best.start.x, best.start.y, 0.0]))
    assert heap.heights()[int(x / heap.cell), int(y / heap.cell)] == pytest.approx(FLOOR + 0.03)
    assert best.tips > FLOOR + 0.03


@pytest.mark.parametrize("cell", [(12, 150), (150, 232)])
def test_a_smooth_thing_against_a_wall_is_pushed_along_it(cell: tuple[int, int]) -> None:
    """The hand leans away from the wall, or stands upright where it has room."""
    heap = tote(bar(*cell, side=250))
    best = heap_strokes(heap, GRIPPER)[0]
    assert not best.drags
    assert best.posture.side != 0
    assert swept(best, heap).max() > best.tips
    lean = best.start.yaw + best.posture.side * math.pi / 2
    inwards = np.array([125, 125]) - cell
    assert np.array([math.cos(lean), math.sin(lean)]) @ inwards > 0


def test_fingers_that_fit_between_wall_and_thing_push_it_off() -> None:
    """The palm has no room above that place, unless the hand leans away from the wall."""
    strokes = heap_strokes(tote(bar(35, 75)), GRIPPER)
    best = next(one for one in strokes if not one.drags)
    assert best.start.x < 0.35 + 0.05
    assert math.cos(best.start.yaw) > 0.9
    assert best.posture.name == "leaning ahead"


def test_an_open_finger_reaches_behind_a_thing_where_the_palm_keeps_closed_ones_off() -> None:
    """The palm is 206 mm wide: closed fingers stay 103 mm off a wall that it stands across to."""
    heap = tote(bar(36, 30))
    off = [one for one in heap_strokes(heap, GRIPPER) if math.cos(one.start.yaw) > 0.9]
    assert off and all(one.posture.open for one in off)
    best = off[0]
    beside = np.array([-math.sin(best.start.yaw), math.cos(best.start.yaw)])
    reach = GRIPPER.max_width / 2 + GRIPPER.pads[0][0].size[1] / 2
    pushed = np.array([best.start.x, best.start.y]) - reach * beside
    x, y = pushed - CORNER.position[:2]
    assert x < 0.052 and y < 0.09


def test_a_tote_that_is_turned_has_the_same_strokes_turned() -> None:
    plain = heap_strokes(tote(bar(35, 75)), GRIPPER)[0]
    quarter = Pose((0.35, -0.15, 0.0), (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)))
    turned = heap_strokes(tote(bar(35, 75), quarter), GRIPPER)[0]
    assert turned.name == plain.name
    assert math.cos(turned.start.yaw - plain.start.yaw - math.pi / 2) == pytest.approx(1.0)
    there = quarter @ CORNER.inverse() @ Pose((plain.start.x, plain.start.y, 0.0))
    assert (turned.start.x, turned.start.y) == pytest.approx(there.position[:2], abs=1e-9)


def test_the_higher_of_two_things_is_stroked_first() -> None:
    heights = bar(45, 75)
    heights[90:110, 60:90] = FLOOR + 0.015
    x = CORNER.inverse().apply(np.array([heap_strokes(tote(heights), GRIPPER)[0].start.x, 0.0, 0.0]))[0]
    assert x < 0.15


def test_what_was_never_seen_is_not_free() -> None:
    heights = floor()
    heights[5:145, 5:145] = np.nan
    heights[65:85, 60:90] = FLOOR + 0.03
    assert [one for one in heap_strokes(tote(heights), GRIPPER) if not one.drags] == []


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("posture", POSTURES)
def test_the_hand_leans_as_its_posture_says_with_its_tips_on_the_stroke(
    posture: Posture, flipped: bool
) -> None:
    one = HeapStroke("", PlanarPose(0.5, 0.1, 0.4), 0.05, 0.02, posture, drags=False, worth=1.0)
    pose = one.tcp_at(0.03, GRIPPER.tip, flipped)
    tips = pose.apply(np.array([0.0, 0.0, GRIPPER.tip]))
    ahead = np.array([math.cos(0.4), math.sin(0.4), 0.0])
    assert tips == pytest.approx([0.5 + 0.03 * ahead[0], 0.1 + 0.03 * ahead[1], 0.02])
    left = np.array([-ahead[1], ahead[0], 0.0])
    lean = ahead if posture.side == 0 else posture.side * left
    z, y = pose.rotation()[:, 2], pose.rotation()[:, 1]
    assert -z @ lean == pytest.approx(math.sin(posture.tilt))
    assert y @ lean == pytest.approx(0.0, abs=1e-9)
    assert z[2] == pytest.approx(-math.cos(posture.tilt))


def test_a_heap_has_changed_when_a_thing_lies_elsewhere_and_not_when_edges_flicker() -> None:
    rng = np.random.default_rng(1)
    before = bar(75, 75)
    flicker = before + rng.normal(0.0, 0.001, before.shape)
    flicker[64, 60:90] = FLOOR + 0.03
    assert not heap_changed(tote(before), tote(flicker))
    assert heap_changed(tote(before), tote(bar(80, 75)))
    assert heap_changed(tote(before), tote(floor()))
