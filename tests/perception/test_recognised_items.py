"""Items that another process has recognised: grey ones, which perception itself takes for obstacles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.perception import Perception, segmentation
from picktree.robot.perception.view import PerceivedView
from picktree.world import Pose, RecognisedItem

from .perception_pictures import BLOCK, CAN, DOWN, PLATE, SCENE, Robot, Thing, photograph, standing

CELL = replace(SCENE, bins=())
THINGS = {
    "block": standing(BLOCK, 0.42, -0.1, 0.3, "red"),
    "can": standing(CAN, 0.6, 0.1, 0.0, "blue"),
    "plate": standing(PLATE, 0.55, -0.15, 0.7, "green"),
}
PICTURE = photograph([replace(each, colour="grey") for each in THINGS.values()], scene=CELL)
COLOURS = segmentation.labels(photograph(list(THINGS.values()), noise=0.0, scene=CELL).colour)


def reported(kind: str, *, masked: bool = True) -> RecognisedItem:
    rows, columns = np.nonzero(np.equal(COLOURS, segmentation.label_of(THINGS[kind].colour)))
    if not masked:
        mask = np.zeros(COLOURS.shape, bool)
        mask[rows.min() - 3 : rows.max() + 4, columns.min() - 3 : columns.max() + 4] = True
        rows, columns = np.nonzero(mask)
    return RecognisedItem(kind, THINGS[kind].colour, 0.7, rows, columns, masked)


def seen(*items: RecognisedItem) -> PerceivedView:
    work = Perception(CELL, Robot()).understand(PICTURE, np.zeros(7), 0.08, None, reported=items)
    while True:
        try:
            next(work)
        except StopIteration as done:
            return done.value


def error(view: PerceivedView, thing: Thing, kind: str) -> float:
    (found,) = (d for d in view.detections if d.kind == kind)
    assert (found.colour, found.place, found.confidence) == (thing.colour, "table", 0.7)
    return found.pose.distance(thing.pose)


@pytest.mark.parametrize("masked", [True, False])
def test_a_mask_or_a_box_is_enough_for_a_pose(masked: bool) -> None:
    view = seen(*(reported(kind, masked=masked) for kind in THINGS))
    assert view.unexplained == ()
    assert all(error(view, thing, kind) < 0.003 for kind, thing in THINGS.items())


def test_an_item_is_placed_at_its_reported_pose_on_its_support() -> None:
    """Height and tilt of a reported pose are noise as long as the item may rest on the table. Any other item
    stays an obstacle, and of two items at one place there is one."""
    block = THINGS["block"]
    wrong = Pose((0.003, 0.002, 0.004)) @ block.pose @ Pose.from_rpy((0, 0, 0), (0.03, 0.02, 0.04))
    item = replace(reported("block"), pose=DOWN.inverse() @ wrong, sigma_position=0.003, sigma_angle=0.03)
    boxed = replace(reported("block", masked=False), pose=item.pose, sigma_position=0.003, confidence=0.5)
    for items in ((item,), (boxed, item), (replace(boxed, confidence=0.7),)):
        view = seen(*items)
        assert len(view.unexplained) == 1  # the can; a plate of 6 mm is too thin
        (found,) = view.detections
        assert found.confidence == 0.7 and found.sigma_position == 0.003
        assert found.pose.position == pytest.approx((0.423, -0.098, 0.02), abs=1e-3)
        assert found.pose.rotation()[2, 2] == pytest.approx(1.0, abs=1e-6)
        assert found.pose.rpy()[2] == pytest.approx(0.34, abs=0.01)
    # Above every support it floats: nothing is moved there.
    high = replace(item, pose=DOWN.inverse() @ Pose((0.0, 0.0, 0.03)) @ block.pose)
    assert seen(high).detections[0].pose.position[2] == pytest.approx(0.05, abs=2e-3)
    vague = replace(item, sigma_position=0.02)
    assert seen(vague).detections == () and len(seen(vague).unexplained) == 2
    assert math.isclose(seen(item).detections[0].sigma_angle, 0.03)
