"""Spots in a bin: over the lowest part of the heap, clear of the walls, with the object above the rim."""

from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.manipulation.release_poses import (
    RELEASE_RIM_HEIGHT,
    free_cells,
    heap_heights,
    put_down_poses,
    release_poses,
)
from picktree.world import BeliefObject, Box, ObjectId, Pose, bottom, extents
from picktree.world.scene import Bin

BIN = Bin(ObjectId("bin"), (0.25, 0.20, 0.10), 0.005, Pose.from_rpy((0.35, 0.55, 0.0), (0.0, 0.0, 0.4)))
BLOCK = Box((0.04, 0.05, 0.06))
IN_HAND = Pose.from_rpy((0.003, 0.0, 0.01), (3.1, 0.05, 0.4))


def lying_in_bin(x: float, y: float) -> BeliefObject:
    pose = BIN.pose @ Pose((x, y, 0.005 + 0.03))
    return BeliefObject(
        "block", "box", BLOCK, "red", pose, 0.001, 0.01, 1.0, 0.0, id=ObjectId("a"), place="bin"
    )


def test_heap_is_the_higher_of_seen_and_believed() -> None:
    seen = np.full((3, 3), np.nan)
    seen[2, 2] = 0.05
    heights = heap_heights(BIN, [lying_in_bin(-0.08, -0.06)], seen)
    assert heights[0, 0] == pytest.approx(0.06, abs=1e-9)
    assert heights[2, 2] == 0.05
    assert heights.sum() == pytest.approx(0.11, abs=1e-9)


def test_the_lowest_cell_comes_first_and_full_cells_never() -> None:
    heights = np.full((3, 3), 0.09)
    heights[2, 0] = 0.0
    heights[1, 1] = 0.2
    found = free_cells(BIN, heights, BLOCK, np.eye(3))
    assert found[0].name == "cell 2,0"
    assert "cell 1,1" not in [s.name for s in found]
    assert len(found) == 8


def test_an_object_that_reaches_into_a_cell_is_part_of_its_heap() -> None:
    plate = replace(lying_in_bin(0.0, 0.0), shape=Box((0.04, 0.12, 0.06)))
    heights = heap_heights(BIN, [plate], None)
    assert np.count_nonzero(heights) == 1
    found = {spot.name: spot.height for spot in free_cells(BIN, heights, BLOCK, np.eye(3), [plate])}
    high = {name for name, height in found.items() if height > 0.0}
    assert high == {"cell 1,0", "cell 1,1", "cell 1,2"}
    assert all(found[name] == pytest.approx(0.06) for name in high)
    elsewhere = replace(plate, place="table")
    assert not any(s.height for s in free_cells(BIN, 0 * heights, BLOCK, np.eye(3), [elsewhere]))


def test_every_spot_keeps_the_object_off_the_walls() -> None:
    reach = float(np.linalg.norm(extents(BLOCK, np.eye(3))[1][:2]))
    low, high = BIN.inside()
    for spot in free_cells(BIN, np.zeros((3, 3)), BLOCK, np.eye(3)):
        x, y, _ = BIN.pose.inverse().apply(np.array([*spot.centre, 0.0]))
        assert low[0] + reach <= x <= high[0] - reach
        assert low[1] + reach <= y <= high[1] - reach


def test_release_poses_hold_the_object_over_the_spot_above_the_rim() -> None:
    spot = free_cells(BIN, np.zeros((3, 3)), BLOCK, np.eye(3))[3]
    for tcp in release_poses(BIN, spot, BLOCK, IN_HAND, higher=0.03):
        held = tcp @ IN_HAND
        assert held.position[:2] == pytest.approx(spot.centre)
        assert bottom(BLOCK, held) == pytest.approx(0.10 + RELEASE_RIM_HEIGHT + 0.03)
        assert tcp.rotation()[2, 2] == pytest.approx(-1.0)


def test_put_down_poses_stand_on_the_point() -> None:
    for tcp in put_down_poses((0.5, -0.1, 0.02), BLOCK, IN_HAND):
        held = tcp @ IN_HAND
        assert held.position[:2] == pytest.approx((0.5, -0.1))
        assert bottom(BLOCK, held) == pytest.approx(0.02)
