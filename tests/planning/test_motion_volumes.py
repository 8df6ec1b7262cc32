"""Plans and queries keep clear of a volume, and name it, whatever it is made of."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from picktree.robot.perception.obstacle_volumes import Keys, cells_in_body
from picktree.robot.planning import CollisionChecker, JointGoal
from picktree.robot.planning.trajectory_verifier import TrajectoryVerifier
from picktree.world import Box, ConvexMesh, Failure, PlanningScene, Pose

from ..perception.perception_pictures import obstacle
from .motion_cell import HOME, MODEL, Cell, run, table_scene


def bent(x: float, y: float) -> Keys:
    """Two walls at a corner: no hull is tight about them."""
    one = cells_in_body(Box((0.3, 0.04, 0.9)), Pose((x, y, 0.45)))
    other = cells_in_body(Box((0.04, 0.3, 0.9)), Pose((x, y, 0.45)))
    return np.union1d(one, other)


def post(x: float, y: float) -> Keys:
    return cells_in_body(Box((0.08, 0.06, 0.9)), Pose.from_rpy((x, y, 0.45), (0.0, 0.0, 0.5)))


def seen(cells: Keys) -> PlanningScene:
    scene = table_scene()
    scene.put(obstacle(cells), "test")
    return scene


@pytest.mark.parametrize(("make", "hull"), [(bent, False), (post, True)])
def test_a_plan_goes_round_it(make: Callable[[float, float], Keys], hull: bool) -> None:
    scene = seen(make(0.4, 0.0))
    assert isinstance(scene.get("obstacle_1").shape, ConvexMesh) is hull
    cell = Cell(scene, seed=3)
    left, right = HOME.copy(), HOME.copy()
    left[0], right[0] = 0.9, -0.9
    cell.at = left
    plan, _ = run(cell.plan.to(JointGoal(right)))
    assert plan.planner != "direct", "it is in the way"
    assert TrajectoryVerifier(MODEL).judge(plan.trajectory, scene, 0.08) == ()


def test_a_contact_names_it() -> None:
    tool = MODEL.tcp(HOME).position
    scene = seen(bent(tool[0], tool[1]))
    collision = CollisionChecker(MODEL)
    collision.update(scene, 0.08)
    assert {contact.b for contact in collision.contacts(HOME)} == {"obstacle_1"}
    cell = Cell(scene)
    pose = MODEL.tcp(HOME)
    assert {contact.b for contact in cell.queries.hand_contacts(pose, 0.08)} == {"obstacle_1"}
    cell.at = HOME + np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(Failure) as failure:
        run(cell.plan.to(JointGoal(HOME)))
    assert failure.value.cause.name == "planning.goal_in_collision"
    assert "obstacle_1" in failure.value.message


def test_queries_follow_it_as_it_grows_and_goes() -> None:
    scene = seen(post(0.5, 0.2))
    cell = Cell(scene)
    probe = Box((0.02, 0.02, 0.02))
    at, beside = Pose((0.5, 0.2, 0.3)), Pose((0.5, 0.3, 0.3))
    assert [c.b for c in cell.queries.free(probe, at)] == ["obstacle_1"]
    assert cell.queries.free(probe, beside) == []
    scene.put(obstacle(np.union1d(post(0.5, 0.2), post(0.5, 0.3))), "more of it was seen")
    assert {c.b for c in cell.queries.free(probe, beside)} == {"obstacle_1"}
    scene.remove("obstacle_1", "its place was seen without it")
    assert cell.queries.free(probe, at) == []
