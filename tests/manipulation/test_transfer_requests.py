"""Approach to a grasp while the fingers move: it is free at every opening on the way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from picktree.control.execution.gripper_motion import GripperControl
from picktree.manipulation.grasp.grasp_candidates import GraspCandidate
from picktree.manipulation.pick.transfer_requests import approach
from picktree.planning.collision.collision_checker import CollisionChecker
from picktree.planning.requests import PoseGoal, Request
from picktree.robots.finger_linkage import fingers_of
from picktree.robots.loading import load_robot
from picktree.session.cell import CellSession
from picktree.world.values import GripperState, ObjectId, Pose

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


class Standing:
    """Gripper whose fingers stand at `width`, m."""

    now = 0.0

    def __init__(self, width: float) -> None:
        self.width = width

    def read(self) -> GripperState:
        return GripperState(self.width, 0.0, 0.0)

    def command(self, width: float, force: float, speed: float | None = None) -> None: ...


@pytest.mark.parametrize("robot", ["gen3", "ur10e", "xarm6", "panda", "iiwa"])
def test_the_extension_covers_the_reach_of_all_openings_on_the_way(robot: str) -> None:
    gripper = load_robot(robot).gripper
    reach = fingers_of(gripper).reach
    for now, wanted in ((gripper.max_width, 0.0), (0.01, gripper.max_width), (0.04, 0.04), (0.06, 0.03)):
        fingers = Standing(now)
        control = GripperControl(fingers, fingers, gripper)
        furthest = max(reach(w) for w in np.linspace(now, wanted, 30).tolist())
        missing = furthest - reach(control.widest(wanted))
        extension = control.extension(wanted)
        assert extension == 0.0 if missing < 5e-4 else missing - 1e-3 <= extension <= missing + 5e-3
    assert (GripperControl(Standing(0.08), Standing(0.08), gripper).extension(0.0) > 0.0) == (
        gripper.linkage is not None
    )
