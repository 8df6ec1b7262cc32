"""Proposals for the named poses of an arm: home, observe and rest."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from picktree.robot.perception import hidden_shares
from picktree.robot.planning import InverseKinematics
from picktree.world import Array, Pose, workspace_excess
from picktree.world.robot_model import RobotModel, urdf_parser
from picktree.world.scene import MAX_HIDDEN_SHARE

from .base_pose import YAWS, places, scene
from .free_space import SpaceOverTable

WORKSPACE_SPARE = 0.02
"""Least distance of the tool from the edge of the workspace, m."""


FINGER_DIRECTIONS = 8
"""Number of finger directions that are tried."""


HOME_DISTANCES = (0.36, 0.42, 0.48, 0.3, 0.24)
"""Horizontal distances of the tool from the first joint that are tried for `home`, as shares of the reach."""


HOME_HEIGHTS = (0.5, 0.42, 0.58, 0.35, 0.65)
"""Heights of the tool over the arm's foot that are tried for `home`, as shares of the reach."""


MAX_SHOULDER_HEIGHT = 0.5
"""Greatest height of the first joint over the foot from which heights count, as a share of the reach."""


RANDOM_CONFIGURATION_COUNT = 500
"""Number of random configurations that are tried for a `home` when none has the tool down."""


REST_DISTANCES = (0.3, 0.36, 0.42)


REST_HEIGHTS = (0.55, 0.65, 0.45, 0.75)


WORK_AREA = ((0.35, -0.25), (0.65, 0.25))
"""Corners of the part of the table where scenes have their items, m in the world."""


CAMERA_HEIGHT = 0.8
"""Height of a camera above the middle of that part, m."""


HALF_LINK_WIDTH = 0.08
"""Half of a link's width, as far as it hides the table from the camera, m."""


HIDING_COST = 2.0
"""Cost of a `home` that hides the whole of that part, in units of a posture's value."""


DETOUR_COST = 2.0
"""Cost of a `home` whose posture has to change on the way to all items and bins, in units of its value."""


MAX_POSTURE_CHANGE = 2.0
"""Greatest change of a joint in one posture, rad: an elbow or a wrist that turns over changes by more."""


MAX_DETOUR_CHECKS = 40
"""Greatest number of postures whose detours are counted."""


IK_SEED_COUNT = 4
"""Number of random configurations from which inverse kinematics starts."""


OBSERVE_ROTATION = np.pi / 2
"""Rotation of the first joint that turns the arm out of a camera's view of the table, rad."""


@dataclass(frozen=True, slots=True)
class NamedPose:
    """Proposed configuration (n,), rad, with a comment."""

    name: str
    joints: tuple[float, ...]
    comment: str


@dataclass(frozen=True, slots=True)
class _Posture:
    q: Array
    value: float


def first_joint(model: RobotModel) -> Array:
    """Return the position (3,) of the first joint in the world, m."""
    return np.array(model.arm.jointPlacements[1].translation)


def reach(model: RobotModel, samples: int = 2000, seed: int = 0) -> float:
    """Return the tool's horizontal reach from the first joint, m: the 99th percentile of random poses."""
    generator = np.random.default_rng([seed, 1])
    base = model.description.base_in_world.inverse()
    x0, y0, _ = base.apply(first_joint(model))
    found: list[float] = []
    for _ in range(samples):
        x, y, _ = base.apply(np.array(model.tcp(generator.uniform(model.lower, model.upper)).position))
        found.append(float(np.hypot(x - x0, y - y0)))
    return float(np.percentile(found, 99))


def propose_poses(model: RobotModel, space: SpaceOverTable, seed: int = 0) -> tuple[NamedPose, ...] | None:
    """Propose `home`, `observe` and `rest`; the comment says when a pose is a substitute. None: no pose in
    front of the first joint is free."""
    most = reach(model, seed=seed)
    search = _Search(model, space, most, seed)
    home = search.best(HOME_DISTANCES, HOME_HEIGHTS)
    comment = "Tool pointing down, in front of the first joint."
    if home is None:
        home = search.anywhere()
        comment = "No free pose with the tool down was found. This pose is free and away from limits."
    if home is None:
        return None
    observe = aside = _turned(model, space, home)
    if aside is not None and _hides(model, home) and not _hides(model, aside):
        home, comment = aside, "Turned to the side. In front, the arm would hide the table from a camera."
    about_observe = "Home turned to the side, where a camera above the table does not see the arm."
    if observe is None:
        observe, about_observe = (
            home,
            "Same as home. If the arm turned to the side, it would hit itself or a limit.",
        )
    rest = search.best(REST_DISTANCES, REST_HEIGHTS, folded=True)
    about_rest = "Folded over the base, to wait between runs."
    if rest is None:
        rest, about_rest = home, "Same as home, because no folded pose is free."
    found = (("home", home, comment), ("observe", observe, about_observe), ("rest", rest, about_rest))
    return tuple(NamedPose(name, tuple(round(float(v), 3) for v in q), about) for name, q, about in found)


def _hides(model: RobotModel, q: Array) -> bool:
    """Whether the arm at q hides too much of the scene's items from a camera."""
    return max(hidden_shares(model, scene(), q).values(), default=0.0) > MAX_HIDDEN_SHARE


def _in_workspace(model: RobotModel, q: Array) -> bool:
    """Whether the tool at q is inside of the scene's workspace."""
    return workspace_excess(scene().limits.workspace, model.tcp(q).position, WORKSPACE_SPARE) is None


def _turned(model: RobotModel, space: SpaceOverTable, home: Array) -> Array | None:
    """Return `home` turned aside by the first joint; of two sides the one nearer to the table's middle."""
    turned: list[Array] = []
    for turn in (OBSERVE_ROTATION, -OBSERVE_ROTATION):
        aside = home.copy()
        aside[0] += turn
        within = model.planned_lower[0] <= aside[0] <= model.planned_upper[0]
        if within and _in_workspace(model, aside) and space.free(aside):
            turned.append(aside)
    return min(turned, key=lambda q: round(abs(model.tcp(q).position[1]), 3), default=None)


def hidden_share(model: RobotModel, tree: urdf_parser.UrdfTree, q: Array) -> float:
    """Return the share of the items' part of the table, 0 … 1, that the arm hides from a camera above it.

    `tree`: that of the model's URDF.
    """
    poses = model.link_poses(q, 0.0)
    ends = [[poses[j.parent].position, poses[j.child].position] for j in tree.joints.values()]
    shares = np.linspace(0.0, 1.0, 9)[:, None, None]
    low, high = np.array(WORK_AREA[0]), np.array(WORK_AREA[1])
    segments: Array = np.array(ends)
    points = ((1.0 - shares) * segments[:, 0] + shares * segments[:, 1]).reshape(-1, 3)
    points = points[(points[:, 2] > 0.0) & (points[:, 2] < CAMERA_HEIGHT - HALF_LINK_WIDTH)]
    larger = (CAMERA_HEIGHT / (CAMERA_HEIGHT - points[:, 2]))[:, None]
    middle = (low + high) / 2
    shadow = middle + (points[:, :2] - middle) * larger
    share: Array = np.linspace(0.0, 1.0, 12)
    both = np.column_stack([np.repeat(share, len(share)), np.tile(share, len(share))])
    cells: Array = (low + both * (high - low))[:, None]
    hidden = np.linalg.norm(cells - shadow, axis=2) < HALF_LINK_WIDTH * larger[:, 0]
    return float(hidden.any(axis=1).mean())


class _Search:
    def __init__(self, model: RobotModel, space: SpaceOverTable, most: float, seed: int) -> None:
        self._model = model
        self._tree = urdf_parser.read_skeleton(Path(model.description.urdf))
        self._space, self._most = space, most
        self._ik = InverseKinematics(model)
        self._generator = np.random.default_rng([seed, 2])
        base = model.description.base_in_world
        shoulder = base.inverse().apply(first_joint(model))
        carrier = self._tree.joints[model.description.joints[0]].parent
        foot = self._tree.pose(carrier, {}).position[2]
        x, y, height = (float(c) for c in shoulder)
        self._foot = base @ Pose((x, y, max(foot, height - MAX_SHOULDER_HEIGHT * most)))
        """Point on the axis of the first joint, from which poses are searched, in the world."""

    def best(self, near: tuple[float, ...], high: tuple[float, ...], *, folded: bool = False) -> Array | None:
        """Return the best free configuration with the tool down ahead of the first joint, or None."""
        most = self._most
        found: list[_Posture] = []
        for share in near:
            for height in high:
                for k in range(FINGER_DIRECTIONS):
                    tool = Pose.from_rpy(
                        (share * most, 0.0, height * most), (np.pi, 0.0, 2 * np.pi * k / FINGER_DIRECTIONS)
                    )
                    for q in self._solutions(self._foot @ tool):
                        hidden = 0.0 if folded else hidden_share(self._model, self._tree, q)
                        cost = 2.0 * self._extent(q) if folded else HIDING_COST * hidden
                        found.append(_Posture(q, self._value(q) - cost))
        ranked = sorted(found, key=lambda p: (-p.value, tuple(p.q)))
        free = (p for p in ranked if _in_workspace(self._model, p.q) and self._space.free(p.q))
        if folded:
            return next((posture.q for posture in free), None)
        best = None
        for posture in islice(free, MAX_DETOUR_CHECKS):
            if best is not None and posture.value <= best.value:
                break
            value = posture.value - DETOUR_COST * self._detours(posture.q)
            if best is None or value > best.value:
                best = _Posture(posture.q, value)
        return None if best is None else best.q

    def _detours(self, q: Array) -> float:
        """Return the share of items and bins of the scene that the arm reaches in another posture than at q.

        Places out of reach count, too. The first and the last joint turn hand and arm, and may turn freely.
        """
        axis = self._foot.position
        here = np.array(self._model.tcp(q).position)
        ahead = np.arctan2(here[1] - axis[1], here[0] - axis[0])
        missed = 0
        for place in places():
            turned = q.copy()
            turned[0] += np.arctan2(place.position[1] - axis[1], place.position[0] - axis[0]) - ahead
            turned = np.clip(turned, self._model.planned_lower, self._model.planned_upper)
            x, y, z = place.position.tolist()
            ends = (self._ik.descend(Pose.from_rpy((x, y, z), (np.pi, 0.0, yaw)), turned) for yaw in YAWS)
            missed += not any(
                end is not None and float(np.abs(end - q)[1:-1].max(initial=0.0)) <= MAX_POSTURE_CHANGE
                for end in ends
            )
        return missed / len(places())

    def anywhere(self) -> Array | None:
        """Return the best of random free configurations with the tool ahead of the first joint, or None."""
        model = self._model
        count = range(RANDOM_CONFIGURATION_COUNT)
        drawn = [self._generator.uniform(model.planned_lower, model.planned_upper) for _ in count]
        drawn.sort(key=lambda q: (not _in_workspace(model, q), -self._value(q), tuple(q)))
        foot = self._foot.inverse()
        ahead = (q for q in drawn if foot.apply(np.array(model.tcp(q).position))[0] > 0.0)
        return next((q for q in ahead if self._space.free(q)), None)

    def _solutions(self, tool: Pose) -> list[Array]:
        middle = np.clip(np.zeros(self._model.n), self._model.planned_lower, self._model.planned_upper)
        seeds = [middle]
        for k in range(IK_SEED_COUNT):
            seed = self._generator.uniform(self._model.planned_lower, self._model.planned_upper)
            if k % 2 == 0:
                # From a seed whose twisting joints are straight, the arm stays in its plane.
                seed[::2] = middle[::2]
            seeds.append(seed)
        return [q for seed in seeds if (q := self._ik.descend(tool, seed)) is not None]

    def _value(self, q: Array) -> float:
        """Return the value of a configuration: greater far from singularities and limits, and ahead."""
        model = self._model
        singular = np.linalg.svd(model.jacobian(q), compute_uv=False)
        spread = model.upper - model.lower
        to_limit = float((np.minimum(q - model.lower, model.upper - q) / np.minimum(spread, 2 * np.pi)).min())
        ease = min(float(singular[-1]) / 0.15, 1.0)
        straight = float(np.abs(q).sum()) / (np.pi * model.n)
        return ease + 2.0 * min(to_limit, 0.2) - straight - 0.5 * abs(float(q[0])) / np.pi

    def _extent(self, q: Array) -> float:
        foot = self._foot.inverse()
        poses = self._model.link_poses(q, 0.0).values()
        away = [np.hypot(*foot.apply(np.array(pose.position))[:2]) for pose in poses]
        return float(max(away)) / self._most
