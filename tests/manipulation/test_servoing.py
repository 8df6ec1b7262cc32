"""Visual servoing: which patch is which object, and that a grasp goes where the hand sees its object."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from picktree.robot.manipulation.visual_servoing import match_patches
from picktree.robot.perception import TrackedSighting
from picktree.robot.perception.known_object_fitting import split_at_depth_steps
from picktree.robot.perception.segmentation import Pixels
from picktree.trees import NodeStatus
from picktree.world import Array, BeliefObject, Box, ObjectId, Pose
from picktree.world.scene import SceneDescription, load_scene

from ..skills.cell import Cell, mission

OVERHEAD_OFF = Pose.from_rpy((0.006, 0.005, 0.002), (0.01, 0.008, 0.031))
HAND_OFF = Pose.from_rpy((0.005, -0.005, 0.0037), (0.02, -0.018, 0.022))
LOOK = mission("Observe: {camera: overhead}")
BLOCK = Box((0.04, 0.04, 0.04))


def block(name: str, x: float, y: float = 0.0) -> BeliefObject:
    pose = Pose((x, y, 0.02))
    return BeliefObject("block", "box", BLOCK, "red", pose, 0.001, 0.01, 1.0, 0.0, id=ObjectId(name))


def seen(name: str, patch: int, x: float, y: float = 0.0, misfit: float = 0.3) -> TrackedSighting:
    return TrackedSighting(ObjectId(name), patch, Pose((x, y, 0.02)), 3e-4, 0.01, misfit, 1.0)


def test_the_only_patch_is_the_target() -> None:
    found = match_patches(block("a", 0.0), [block("a", 0.0)], [seen("a", 1, 0.008)])
    assert found.target is not None
    assert (found.target.patch, found.ambiguous, found.seen) == (1, False, 1)


def test_a_neighbour_of_its_colour_is_not_taken_for_the_target() -> None:
    a, b = block("a", 0.0), block("b", 0.041)
    sightings = [seen(name, patch, x) for name in "ab" for patch, x in ((1, 0.008), (2, 0.049))]
    for target, patch in ((a, 1), (b, 2)):
        found = match_patches(target, [a, b], sightings)
        assert found.target is not None
        assert found.target.patch == patch
        assert [s.patch for s in found.others] == [3 - patch]


def test_a_hidden_target_is_not_found_in_its_neighbour() -> None:
    a, b = block("a", 0.0), block("b", 0.030)
    found = match_patches(a, [a, b], [seen("a", 2, 0.031), seen("b", 2, 0.031)])
    assert (found.target, found.ambiguous) == (None, False)
    assert [(s.object, s.patch) for s in found.others] == [("b", 2)]


def test_a_neighbour_that_was_corrected_before_does_not_make_it_ambiguous() -> None:
    a, b = block("a", 0.0), block("b", 0.0, 0.1)
    found = match_patches(a, [a, b], [seen("a", 1, 0.014), seen("b", 2, 0.001, 0.1)])
    assert found.target is not None
    assert (found.target.patch, found.ambiguous) == (1, False)


def test_what_stands_around_tells_which_of_two_it_is() -> None:
    a, far = block("a", 0.0), block("far", 0.0, 0.1)
    both = [seen("a", 1, -0.012), seen("a", 2, 0.014)]
    assert match_patches(a, [a], both).ambiguous
    told = match_patches(a, [a, far], [*both, seen("far", 3, 0.013, 0.1)])
    assert told.target is not None
    assert (told.target.patch, told.ambiguous) == (2, False)


def test_what_does_not_fit_is_no_target() -> None:
    found = match_patches(block("a", 0.0), [block("a", 0.0)], [seen("a", 1, 0.002, misfit=math.inf)])
    assert (found.target, found.ambiguous, found.seen) == (None, False, 1)


@cache
def off(overhead: Pose = OVERHEAD_OFF, wrist: Pose = HAND_OFF) -> SceneDescription:
    """Four items, both cameras 8 mm and 2° off."""
    scene = load_scene("three_bins_wrist")
    spawn = replace(
        scene.spawn[0], counts={"block": 1, "can": 1, "plate": 1, "brick": 1}, gap=0.03, lying=0.0
    )
    one, other = scene.cameras
    cameras = (replace(one, error=overhead), replace(other, error=wrist))
    return replace(scene, spawn=(spawn,), cameras=cameras)


def grasped(kind: str, *, servo: bool) -> tuple[Cell, BeliefObject, Pose]:
    """Return the cell as the fingers began to close on the item, its belief, and its true pose."""
    cell = Cell(LOOK, off(), "kinematic", 3)
    cell.finish()
    target = next(o for o in cell.world.scene.objects if o.kind == kind)
    true = min(cell.hardware.truth(), key=lambda body: body.pose.distance(target.pose)).pose
    cell.start(mission(f"Grasp: {{object: {target.id}, servo: {str(servo).lower()}, onward: false}}"))
    cell.tick()
    while cell.running and not cell.world.scene.get(target.id).attached:
        target = cell.world.scene.get(target.id)
        cell.tick()
    return cell, target, true


@pytest.mark.parametrize("kind", ["block", "can", "plate"])
def test_errors_of_both_cameras_are_made_up_for(kind: str) -> None:
    cell, belief, true = grasped(kind, servo=True)
    assert math.dist(belief.pose.position[:2], true.position[:2]) < 0.0015
    assert cell.happened("servo")
    assert cell.finish() is NodeStatus.SUCCESS


def test_without_servoing_the_hand_goes_where_the_camera_said() -> None:
    cell, belief, true = grasped("block", servo=False)
    assert math.dist(belief.pose.position[:2], true.position[:2]) > 0.004
    assert not cell.happened("servo")


def test_what_the_same_picture_showed_is_moved_with_the_target() -> None:
    cell, _, _ = grasped("block", servo=True)
    truth = cell.hardware.truth()
    for other in cell.world.scene.objects:
        if other.role == "item" and not other.attached:
            away = min(math.dist(other.pose.position[:2], body.pose.position[:2]) for body in truth)
            assert away < 0.006, other.id


def test_what_the_hand_does_not_see_is_not_touched() -> None:
    cell = Cell(LOOK, off(), "kinematic", 3)
    cell.finish()
    before = {o.id: o for o in cell.world.scene.objects}
    bins = dict(cell.world.vision.bins)
    cell.start(mission("Observe: {camera: wrist}"))
    cell.finish()
    after = {o.id: o for o in cell.world.scene.objects}
    assert set(after) == set(before)
    unseen = [name for name, o in after.items() if o.last_seen == before[name].last_seen]
    assert unseen
    assert all(after[name] == before[name] for name in unseen)
    assert set(cell.world.vision.bins) == set(bins)


def test_a_cell_without_a_camera_on_the_hand_does_as_before() -> None:
    scene = replace(off(), cameras=off().cameras[:1])
    cell = Cell(LOOK, scene, "kinematic", 3)
    cell.finish()
    assert cell.world.vision.hand is None
    target = next(o for o in cell.world.scene.objects if o.kind == "block")
    cell.start(mission(f"Grasp: {{object: {target.id}}}"))
    assert cell.finish() is NodeStatus.SUCCESS
    assert not cell.happened("servo")


def patch_of(depth: Array) -> tuple[Pixels, Pixels]:
    rows, columns = np.nonzero(depth > 0)
    return rows, columns


def test_two_of_one_colour_part_where_the_depth_steps() -> None:
    depth = np.full((30, 40), 0.20)
    depth[:, 22:] = 0.23
    depth[4::3, 21:23] = 0.0  # lost at the edge
    everything = np.nonzero(np.ones_like(depth))
    (left_rows, left), (right_rows, right) = split_at_depth_steps(depth, *everything)
    assert max(abs(int(left.max()) - 21), abs(int(right.min()) - 22)) <= 1
    assert len(left_rows) + len(right_rows) == depth.size


def test_a_slanted_face_is_one_piece() -> None:
    depth = 0.20 + 0.003 * np.arange(40)[None, :] + np.zeros((30, 1))
    assert len(split_at_depth_steps(depth, *patch_of(depth))) == 1
