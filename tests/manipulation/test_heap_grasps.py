"""Grasps from a height map alone: bars and walls of known heights, without a scene."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from picktree.robot.manipulation.heap_grasps import (
    MORE_TILTED,
    STAGES,
    STRICT_TIER,
    TILTED,
    VERTICAL,
    colour_between,
    grasps,
)
from picktree.robot.manipulation.heap_views import surfaces
from picktree.robot.perception import LABEL_NAMES
from picktree.robot.perception.heap_mapping import heap_object
from picktree.world import Array, ObjectId, Pose
from picktree.world.heap_geometry import BarredPlace, Heap, HeapRegion, HeightMap
from picktree.world.robot_model import load_robot
from picktree.world.scene import Bin

GRIPPER = load_robot("panda").gripper
TOTE = Bin(ObjectId("tote"), (0.3, 0.3, 0.12), 0.004, Pose((0.5, 0.0, 0.0)), is_tote=True)
FLOOR = 0.004


def heap(heights: Array, labels: NDArray[np.uint8] | None = None) -> Heap:
    walls = np.ones(heights.shape, dtype=np.bool_)
    walls[2:-2, 2:-2] = False
    labels = np.zeros(heights.shape, dtype=np.uint8) if labels is None else labels
    frame = Pose((0.35, -0.15, 0.0))
    return Heap(HeightMap.of(frame, 0.002, (FLOOR, 0.12), heights, walls, labels))


def floor() -> Array:
    return np.full((150, 150), FLOOR)


def bar(x: int = 75, y: int = 75) -> Array:
    """Bar of 60 × 24 × 30 mm along x, with its middle at a cell."""
    heights = floor()
    heights[x - 15 : x + 15, y - 6 : y + 6] = FLOOR + 0.03
    return heights


def vertical(one: Heap):
    return next(grasps(one, GRIPPER, [(STRICT_TIER, (VERTICAL,))]))


def test_the_best_grasp_of_a_bar_closes_across_its_middle_and_stays_above_the_floor():
    best = vertical(heap(bar()))[0]
    x, y, z = best.tcp_in_world.position
    assert (x, y) == pytest.approx((0.5, 0.0), abs=0.012)
    assert abs(best.tcp_in_world.rotation()[1, 1]) > math.cos(math.radians(16))
    assert best.expected_width == pytest.approx(0.024, abs=0.005)
    assert FLOOR + 0.001 < z - GRIPPER.tip < FLOOR + 0.03 - 0.009
    assert best.opening > best.expected_width


def test_the_hand_is_centred_on_what_lies_between_the_pads():
    for y in (72, 74, 77):
        for one in vertical(heap(bar(y=y))):
            if abs(one.tcp_in_world.rotation()[1, 1]) < 0.99:
                continue
            middle = -0.15 + 0.002 * y
            assert one.tcp_in_world.position[1] == pytest.approx(middle, abs=0.002)


def test_a_roof_that_would_slip_out_of_the_fingers_is_not_gripped():
    heights = floor()
    across = np.abs(np.arange(150) - 75)
    roof = np.maximum(FLOOR, FLOOR + 0.03 - 0.002 * across)  # 45° on each side
    heights[60:90] = roof
    across_it = [one for one in vertical(heap(heights)) if abs(one.tcp_in_world.rotation()[1, 1]) > 0.7]
    assert not across_it


def test_the_fingers_do_not_pinch_the_end_of_a_thing():
    reach = [one.tcp_in_world.position[0] - 0.5 for one in vertical(heap(bar()))]
    assert reach
    # The bar ends 30 mm from its middle: more than half of the pad's width of 17.6 mm lies on it.
    assert max(map(abs, reach)) < 0.030 + 0.001


def test_an_empty_tote_has_no_grasps_and_no_object():
    assert all(not stage for stage in grasps(heap(floor()), GRIPPER))
    assert heap_object(HeapRegion.of(TOTE), heap(floor()).map, 1.0) is None


def test_nothing_unseen_is_free():
    heights = bar()
    heights[40:110, 82:120] = np.nan
    for one in vertical(heap(heights)):
        tips = [one.tcp_in_world.apply(np.array([0.0, side * one.opening / 2, 0.0])) for side in (-1, 1)]
        cells = [(round((p[0] - 0.35) / 0.002), round((p[1] + 0.15) / 0.002)) for p in tips]
        assert all(np.isfinite(heights[cell]) for cell in cells)


def test_a_wall_is_not_gripped():
    heights = floor()
    assert not vertical(heap(heights))
    heights[:5] = 0.12
    assert not vertical(heap(heights))


def test_no_wall_is_between_the_fingers():
    heights = floor()
    heights[60:90, 9:21] = FLOOR + 0.10  # 14 mm from the wall: a finger fits outside of the tote only
    heights[60:90, 69:81] = FLOOR + 0.10
    found = next(grasps(heap(heights), GRIPPER, [(STRICT_TIER, (VERTICAL, TILTED))]))
    assert len(found) > 10
    for one in found:
        for side in (-1, 1):
            tip = one.tcp_in_world.apply(np.array([0.0, side * one.opening / 2, GRIPPER.tip]))
            assert abs(tip[0] - 0.5) < 0.15 and abs(tip[1]) < 0.15


def test_a_bar_beside_a_wall_is_reached_by_tilting_alone():
    beside = heap(bar(y=146 - 8))
    assert not vertical(beside)
    tilted = next(grasps(beside, GRIPPER, [(STRICT_TIER, (TILTED,))]))
    assert tilted and all(one.tilted for one in tilted)
    back = tilted[0].pre_grasp(0.08)
    assert back.apply(np.array([0.0, 0.0, GRIPPER.tip]))[2] > TOTE.size[2]
    assert abs(back.position[1] - tilted[0].tcp_in_world.position[1]) > 0.01


@pytest.mark.parametrize("spread", [0, 3])
def test_the_palm_has_room_up_to_a_wall_of_known_place_however_wide_its_depth_spreads(spread: int):
    def across(y: int) -> int:
        heights = bar(y=y)
        heights[:, 2 : 2 + spread] = 0.12
        return sum(abs(one.tcp_in_world.rotation()[1, 1]) > 0.99 for one in vertical(heap(heights)))

    # The palm reaches 105.5 mm to each side, and the wall ends at 4 mm.
    assert across(57)
    assert not across(53)


def test_what_lies_up_to_a_wall_is_as_high_beside_it_as_further_in():
    heights = floor()
    heights[60:90, 2:16] = FLOOR + 0.03
    heights[:, 2:4] = 0.12
    solid, things = surfaces(heap(heights).map)
    assert np.allclose(solid[62:88, 2:14], FLOOR + 0.03) and np.allclose(things[62:88, 2:14], FLOOR + 0.03)
    assert np.allclose(solid[100:140, 2:14], FLOOR) and np.allclose(solid[:, :2], 0.12)


def test_a_leaning_hand_closes_level_so_that_the_pads_lie_flat_on_upright_sides():
    beside = heap(bar(y=146 - 8))
    leaning = [
        one for stage in grasps(beside, GRIPPER, [(STRICT_TIER, (TILTED, MORE_TILTED))]) for one in stage
    ]
    assert leaning
    for one in leaning:
        assert one.tcp_in_world.rotation()[2, 1] == pytest.approx(0.0, abs=1e-9)
        assert one.tcp_in_world.rotation()[2, 2] > -0.95


def test_a_place_that_failed_is_barred_until_its_depth_changes():
    there = heap(bar())
    best = vertical(there)[0]
    x, y, _ = there.map.frame.inverse().apply(np.array(best.tcp_in_world.position))
    barred = replace(there, barred=(BarredPlace.of(there.map, x, y),))
    assert best.name not in {one.name for one in vertical(barred)}
    moved = replace(barred, map=heap(bar() + 0.004 * (bar() > FLOOR)).map)
    near = [one for one in vertical(moved) if one.tcp_in_world.distance(best.tcp_in_world) < 0.012]
    assert near


def test_a_grasp_that_is_not_sure_waits_until_other_approaches_are_searched():
    def best(stage: int) -> float:
        found = next(grasps(low, GRIPPER, STAGES[stage : stage + 1]), ())
        return min((one.score for one in found), default=math.inf)

    heights = floor()
    heights[60:90, 69:81] = FLOOR + 0.02
    heights[60:90, 82:94] = FLOOR + 0.012  # a neighbour that leaves little room for a finger
    low = heap(heights)
    assert all(one.score <= STAGES[0][0].score for one in next(grasps(low, GRIPPER, STAGES[:1])))
    assert best(2) <= min(best(0), best(1))


def test_the_path_cuts_no_corner_between_the_walls():
    best = vertical(heap(bar()))[0]
    for approach in (0.05, 0.08, 0.15):
        way = best.pre_grasp(approach).position[2] - best.tcp_in_world.position[2]
        tips = best.pre_grasp(approach).position[2] - GRIPPER.tip - best.rounded(approach, 0.05)
        assert way >= approach and tips > TOTE.size[2]
    assert replace(best, enclosed=0.0).rounded(0.08, 0.05) == 0.05


def test_two_colours_between_the_pads_come_last():
    labels = np.zeros((150, 150), dtype=np.uint8)
    labels[60:90, 69:75], labels[60:90, 75:81] = 1, 2
    mixed, plain = vertical(heap(bar(), labels))[0], vertical(heap(bar(), np.clip(labels, 0, 1)))[0]
    assert mixed.score > plain.score + 1.0


def test_the_colour_of_a_thing_is_the_one_between_the_pads():
    labels = np.full((150, 150), 1, dtype=np.uint8)
    labels[69:81, 69:81] = 2
    there = heap(bar(), labels)
    best = vertical(there)[0]
    in_map = there.map.frame.inverse() @ best.tcp_in_world
    middle = replace(in_map, position=(0.15, 0.15, in_map.position[2]))
    assert colour_between(there.map, middle, GRIPPER.tip, 0.02) == LABEL_NAMES[2]
    assert colour_between(heap(bar()).map, middle, GRIPPER.tip, 0.02) == "grey"


def test_two_searches_give_the_same_grasps():
    assert list(grasps(heap(bar()), GRIPPER)) == list(grasps(heap(bar()), GRIPPER))


def test_a_heap_is_an_obstacle_of_columns_that_cover_it():
    there = heap_object(HeapRegion.of(TOTE), heap(bar()).map, 1.0)
    assert there is not None and there.role == "heap"
    points = np.array([(0.5, 0.0, FLOOR + 0.029), (0.5, 0.05, FLOOR + 0.029)])
    local = points - np.array(there.pose.position)
    within = [
        any(np.all(np.abs(p - np.array(b.at)) <= np.array(b.size) / 2 + 1e-9) for b in there.blocks)
        for p in local
    ]
    assert within == [True, False]


def test_unseen_cells_keep_what_was_seen_before():
    before, now = heap(bar()).map, bar()
    now[60:70] = np.nan
    assert np.allclose(heap(now).map.over(before).heights(), before.heights(), atol=1e-4)
    assert np.isnan(heap(now).map.over(None).heights()[60:70, 10:140]).all()
