"""Motions while the fingers move: they are free at every opening on the way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.robot.manipulation.grasps import GraspCandidate
from picktree.robot.manipulation.pick_place_motions import approach
from picktree.robot.planning import CollisionChecker, PoseGoal, Request
from picktree.session import CellSession
from picktree.world import ObjectId, Pose

WALL_TOP, TCP_HEIGHT = 0.14, 0.15
"""Top of a wall, and TCP height at which open fingers of a linkage pass it and closed ones do not, m."""


def above(y: float, z: float = TCP_HEIGHT) -> Pose:
    return Pose.from_rpy((0.5, y, z), (np.pi, 0.0, 0.0))


@pytest.mark.parametrize("robot", ["gen3", "xarm6"])
def test_fingers_that_close_on_the_way_pass_a_wall_at_every_opening(robot: str, tmp_path: Path) -> None:
    (tmp_path / "wall.yaml").write_text(
        "picktree: 1\nkind: scene\nbase: sort_small\nspawn: []\nfixtures:\n"
        f"  wall: {{box: [0.3, 0.02, {WALL_TOP}], at: [0.5, 0, {WALL_TOP / 2}]}}\n",
        encoding="utf-8",
    )
    cell = CellSession(str(tmp_path / "wall.yaml"), robot=robot, backend="kinematic")
    world = cell.world
    plan = cell.perform(world.plan.to(PoseGoal((above(-0.15),)), node="test"))
    cell.perform(world.move.along(plan.trajectory, node="test"))
    over = world.plan.reached(Request(PoseGoal((above(0.15),))))
    assert over.q is not None
    grasp = GraspCandidate("closing", above(0.15, 0.1), 0.005, 0.005, 0.01, False, 0.0)
    plan = cell.perform(
        world.plan.through(approach(world, ObjectId("none"), grasp, over.q, 1.0), node="test")
    )
    checker = CollisionChecker(world.robot)
    for opening in np.linspace(grasp.opening, world.gripper.width, 5).tolist():
        checker.update(world.scene, opening)
        nearest = [checker.nearest(q, 0.05) for q in plan.trajectory.position[::5]]
        assert min(near.distance for near in nearest if near is not None) > 0.0, opening


def test_closing_fingers_do_not_straddle_a_wall(tmp_path: Path) -> None:
    (tmp_path / "wall.yaml").write_text(
        "picktree: 1\nkind: scene\nbase: sort_small\nspawn: []\nfixtures:\n"
        f"  wall: {{box: [0.2, 0.01, {WALL_TOP}], at: [0.5, 0, {WALL_TOP / 2}]}}\n",
        encoding="utf-8",
    )
    world = CellSession(str(tmp_path / "wall.yaml"), backend="kinematic").world
    straddling = Request(PoseGoal((above(0.0, WALL_TOP - 0.01),)), width=0.08)
    q = world.plan.reached(straddling).q
    assert q is not None
    checker = CollisionChecker(world.robot)
    for widths, free in (((0.08,), True), ((0.08, 0.06), True), ((0.01,), False), ((0.08, 0.01), False)):
        checker.update(world.scene, *widths)
        assert checker.free(q) is checker.nearly_free(q) is free, widths
        assert {contact.b for contact in checker.contacts(q)} == (set() if free else {"wall"})
        nearest = checker.nearest(q)
        assert nearest is not None and (nearest.distance > 0.0) is free
    assert world.plan.reached(replace(straddling, narrowest=0.01)).q is None
