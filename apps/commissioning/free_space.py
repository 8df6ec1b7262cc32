"""Free space over an arm's table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from picktree.robot.planning import CollisionChecker
from picktree.world import Array, PlanningScene
from picktree.world.robot_model import MOVING, RobotModel, urdf_parser

from .link_geometry import LinkGeometry

TABLE = "the table"


TABLE_CLEARANCE = 0.01
"""Least height of moving links above the table, m."""


MIN_UPRIGHT_COSINE = 0.99
"""Least cosine between the vertical and the axis of a first joint whose link is mounted on the table."""


EXPLAINED_CONFIGURATIONS = 200
"""Number of random configurations that explain a lack of free ones."""


class SpaceOverTable:
    """Test of configurations of an arm whose table is at z = 0 in the world.

    Links that cannot move against the table, or only turn about the vertical, may touch it: the base is
    mounted on it.
    """

    def __init__(
        self, model: RobotModel, tree: urdf_parser.UrdfTree, solids: Mapping[str, LinkGeometry]
    ) -> None:
        self._model = model
        self._width = model.description.gripper.max_width
        self._shut, self._opened = CollisionChecker(model), CollisionChecker(model)
        self._opened.update(PlanningScene((), ()), self._width)
        self._hulls = {link: solids[link].hull() for link in _moving_links(model, tree) if link in solids}

    def free(self, q: Array) -> bool:
        """Whether the arm at q touches neither itself nor the table, with open and shut fingers."""
        return self._shut.free(q) and self._opened.free(q) and self._lowest(q)[1] >= TABLE_CLEARANCE

    def _lowest(self, q: Array) -> tuple[str, float]:
        """Return the link that is lowest at q, and its height above the table, m."""
        poses = self._model.link_poses(q, self._width)
        heights = ((link, float(poses[link].apply(hull)[:, 2].min())) for link, hull in self._hulls.items())
        return min(heights, key=lambda pair: pair[1], default=("", np.inf))

    def obstacle(self, seed: int = 0) -> str:
        """Return a sentence on the two bodies that touch in most random configurations."""
        generator = np.random.default_rng([seed, 4])
        pairs: Counter[tuple[str, str]] = Counter()
        least: dict[tuple[str, str], float] = {}
        for _ in range(EXPLAINED_CONFIGURATIONS):
            q = generator.uniform(self._model.planned_lower, self._model.planned_upper)
            link, height = self._lowest(q)
            depths = {(c.a, c.b): -c.distance for c in (*self._shut.contacts(q), *self._opened.contacts(q))}
            if height < TABLE_CLEARANCE:
                depths[link, TABLE] = -height
            for pair, depth in depths.items():
                pairs[pair] += 1
                least[pair] = min(depth, least.get(pair, depth))
        if not pairs:
            return (
                f"{EXPLAINED_CONFIGURATIONS} random poses are free, but none has the tool in front of the arm"
            )
        (pair, count), *_ = pairs.most_common(1)
        depth = 1000 * least[pair]
        gap = f"{depth:.0f} mm in each other" if depth > 0.0 else f"{-depth:.0f} mm apart"
        share = 100 * count / EXPLAINED_CONFIGURATIONS
        return (
            f"{pair[0]} and {pair[1]} touch in {share:.0f} % of the random poses; in the best of "
            f"these they are {gap}"
        )


def _moving_links(model: RobotModel, tree: urdf_parser.UrdfTree) -> tuple[str, ...]:
    """Return the links that the arm's joints move in another way than about the vertical."""
    joints = model.description.joints
    first = tree.joints[joints[0]]
    axis = model.arm.jointPlacements[1].rotation @ np.array(first.axis)
    start = joints[0] if abs(float(axis[2])) < MIN_UPRIGHT_COSINE or len(joints) == 1 else joints[1]
    moved = tree.below(tree.joints[start].child)
    return tuple(link for link in moved if any(tree.joints[n].type in MOVING for n in tree.joints_to(link)))
