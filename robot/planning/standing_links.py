"""Links of the arm that stand on a fixture: both may touch, as a turret and the table under it."""

from __future__ import annotations

from itertools import product

import numpy as np

from ...world.belief.planning_scene import PlanningScene
from ...world.robot_model.model import RobotModel, pose_of
from ...world.scene.description import Fixture
from ...world.shapes import corners
from .collision_checker import CollisionChecker, robot_geometry

MAX_GAP, MAX_DEPTH = 0.005, 0.02
"""Greatest gap between a link and the fixture under it, and how deep it may be sunk in, m."""


def standing_pairs(model: RobotModel, scene: PlanningScene) -> tuple[tuple[str, str], ...]:
    """Return each pair of a link and the fixture on which it stands.

    Such a link turns about the vertical alone, so that its gap to the ground under it never changes. Links
    that no joint moves are never checked against the surroundings.
    """
    if not model.standing_links:
        return ()
    lowest = _lowest(model)
    under = [f.id for f in scene.fixtures.values() if lowest - MAX_GAP <= _top(f) <= lowest + MAX_DEPTH]
    if not under:
        return ()
    checker = CollisionChecker(model)
    checker.update(scene, 0.0)
    touching = checker.contacts(model.named("home"))
    return tuple((c.a, c.b) for c in touching if c.a in model.standing_links and c.b in under)


def _lowest(model: RobotModel) -> float:
    """Return the height of the lowest point of the links that turn on their ground, m."""
    first = model.full.getJointId(model.description.joints[0])
    # All of them turn about the vertical: their heights are the same at each configuration.
    joint = pose_of(model.full.jointPlacements[first])
    lowest = np.inf
    for o in robot_geometry(model):
        if o.parentJoint == first:
            o.geometry.computeLocalAABB()
            low, high = o.geometry.aabb_local.min_, o.geometry.aabb_local.max_
            box = np.array(list(product(*zip(low.tolist(), high.tolist(), strict=True))))
            lowest = min(lowest, float((joint @ pose_of(o.placement)).apply(box)[:, 2].min()))
    return lowest


def _top(fixture: Fixture) -> float:
    return float(fixture.pose.apply(corners(fixture.shape))[:, 2].max())
