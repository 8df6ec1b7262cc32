"""What pushes up on the hand without physics: what was come down upon, and nothing beside it."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.kinematic.contact_forces import KinematicContacts
from picktree.world import GRAVITY, Pose, bottom

from ..control.control_cell import DOWN, Cell
from .simulated_cell import CATALOGUE
from .test_kinematic import above

LYING = Pose.from_rpy((0.0, 0.0, 0.0), (math.pi / 2, 0.0, 0.0))


def test_a_foot_stands_upon_what_it_came_down_upon() -> None:
    feet = KinematicContacts()
    block = [("table", 0.0), ("block", 0.04)]
    assert feet.top("tip", 0.0401, block) == 0.04
    assert feet.top("tip", 0.0390, block) == 0.04
    assert feet.top("tip", 0.0300, block) == 0.04
    assert feet.top("tip", 0.0300, [("table", 0.0)]) == 0.0
    assert feet.top("tip", 0.0300, block) == 0.0


def test_what_was_entered_from_the_side_gives_way_until_it_is_left_upwards() -> None:
    feet = KinematicContacts()
    block = [("block", 0.04)]
    assert feet.top("tip", 0.02, []) is None
    assert feet.top("tip", 0.02, block) is None
    assert feet.top("tip", 0.035, block) is None
    assert feet.top("tip", 0.041, block) == 0.04
    assert feet.top("tip", 0.038, block) == 0.04


def test_a_foot_of_which_nothing_is_known_stands_upon_what_is_a_little_higher() -> None:
    feet = KinematicContacts()
    assert feet.top("tip", 0.037, [("block", 0.04)]) == 0.04
    feet.forget()
    assert feet.top("tip", 0.030, [("block", 0.04)]) is None


def test_fingers_that_open_next_to_a_block_are_not_pushed_up() -> None:
    cell = Cell(items=1)
    pose = cell.hardware.truth()[0].pose
    cell.run(cell.grip.close(30.0))
    x, y, _ = pose.position
    yaw = 2 * math.atan2(pose.orientation[2], pose.orientation[3])
    aside = Pose((x, y, 0.02), DOWN) @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, -yaw % (math.pi / 2)))
    beside = aside @ Pose((0.0, 0.045, 0.0))
    above(cell, Pose(beside.position, pose.orientation), 0.15)
    above(cell, Pose(beside.position, pose.orientation), 0.03)
    cell.run(cell.grip.open())
    assert cell.loop.wrist.force == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_a_lying_cylinder_that_is_held_weighs_what_it_weighs() -> None:
    """Its lowest point is on its round side, and not at a corner of what encloses it."""
    can = next(entry for entry in CATALOGUE if entry.kind == "can")
    cell = Cell(items=1)
    assert isinstance(cell.hardware, KinematicHardware)
    bodies = cell.hardware.bodies
    body = bodies.items[0]
    x, y, _ = body.pose.position
    lying = Pose.from_rpy((x, y, bottom(can.shape, LYING) * -1.0), (math.pi / 2, 0.0, math.pi / 2))
    bodies.put(replace(body, entry=can, pose=lying))
    cell.go(x, y, 0.15)
    cell.go(x, y, 0.02)
    assert cell.run(cell.grip.close(30.0)) == pytest.approx(0.04, abs=1e-4)
    cell.run(cell.loop.settle())
    assert -can.mass * GRAVITY <= cell.loop.wrist.force[2] <= 1e-3
