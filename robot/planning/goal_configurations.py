"""Goal configurations: free configurations that reach a goal, samples of goal regions, and rejections of the
others."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from picktree.files import PicktreeError
from picktree.world import Array, Failure, Pose
from picktree.world.robot_model import RobotModel

from . import planning_failures
from .inverse_kinematics import InverseKinematics
from .limits import configuration_cost
from .path_constraints import PathConstraints
from .planning_failures import GoalInspection
from .requests import Goal, JointGoal, NamedGoal, PoseGoal, RegionGoal
from .trajectory_check import StartTolerance

REGION_SAMPLES = 64
"""Number of poses of a region that are tried, besides its middle."""


def region_poses(region: RegionGoal, count: int = REGION_SAMPLES) -> tuple[Pose, ...]:
    """Return the pose itself, then `count` others, spread evenly over the region and sorted by their distance
    from it.

    A turn, a tilt or a shift counts by its share of the allowed one. Additive recurrence on powers of the
    generalised golden ratio: Roberts, "The unreasonable effectiveness of quasirandom sequences" (2018).
    """
    is_free = _free_dimensions(region)
    if not any(is_free):
        return (region.tcp_in_world,)
    points = _quasirandom_points(count, sum(is_free))
    units = np.full((count, 6), 0.5)
    units[:, np.flatnonzero(is_free)] = points
    off = [_distance_share(region, is_free, unit) for unit in units]
    nearest = sorted(range(count), key=lambda k: off[k])
    return (region.tcp_in_world, *(_region_pose(region, units[k]) for k in nearest))


def _free_dimensions(region: RegionGoal) -> tuple[bool, ...]:
    """Return which of turn, tilt, direction of the tilt, x, y and z are free."""
    tilts = region.tilt > 0
    return (region.yaw > 0, tilts, tilts, *(r > 0 for r in region.reach))


def _quasirandom_points(count: int, dimensions: int) -> Array:
    """Return points (count, dimensions) in [0, 1), evenly spread for any count."""
    ratio = 2.0
    for _ in range(40):  # the positive root of x^(d+1) = x + 1
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    return np.mod(0.5 + np.arange(1, count + 1)[:, None] * steps, 1.0)


def _distance_share(region: RegionGoal, is_free: tuple[bool, ...], unit: Array) -> float:
    shares = [abs(2 * float(u) - 1) for u in unit]
    shares[1], shares[2] = math.sqrt(float(unit[1])), 0.0
    return math.hypot(*(share for share, free in zip(shares, is_free, strict=True) if free))


def _region_pose(region: RegionGoal, unit: Array) -> Pose:
    turn, spread, direction, *shift = (float(u) for u in unit)
    yaw = (2 * turn - 1) * region.yaw
    # The square root spreads tilts evenly over the cone's disc.
    tilt, towards = math.sqrt(spread) * region.tilt, 2 * math.pi * direction
    x, y, z = ((2 * s - 1) * r for s, r in zip(shift, region.reach, strict=True))
    half = math.sin(tilt / 2)
    leant = Pose((x, y, z), (half * math.cos(towards), half * math.sin(towards), 0.0, math.cos(tilt / 2)))
    turned = Pose((0.0, 0.0, 0.0), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    return region.tcp_in_world @ leant @ turned


HOME_CONFIGURATION = "home"
"""Configuration of the robot file from which a comfortable solution is likely."""
UNCOMFORTABLE_COST = 0.3
"""Cost above which the solution from home is tried, too, see `configuration_cost`, rad."""
SOLUTIONS_PER_POSE = 4
"""Number of IK solutions that are searched for each pose."""
NEAR_BATCHES = (1, 8, 16)
"""Numbers of a region's poses that are tried together by their near solutions, in this order."""
ENOUGH_CONFIGURATIONS = 8
"""Number of free configurations in a region with which a search begins."""


@dataclass(frozen=True, slots=True, eq=False)
class GoalConfiguration:
    """Configuration (n,), rad, that reaches pose number `index` of the goal."""

    q: Array
    index: int


class GoalSet:
    """Goal configurations of one request."""

    def __init__(
        self,
        model: RobotModel,
        ik: InverseKinematics,
        inspection: GoalInspection,
        start_tolerance: StartTolerance,
        start: Array,
        constraints: PathConstraints,
        goal: Goal,
    ) -> None:
        self._model = model
        self._inspection = inspection
        self._ik = ik
        self._start_tolerance = start_tolerance
        self._start = start
        self._constraints = constraints
        self._goal = goal
        self._home = model.named(HOME_CONFIGURATION)

    def near(self) -> Iterator[list[GoalConfiguration]]:
        """Yield for each pose the free solution that the start itself leads to; those of a region in parts,
        near ones first.

        Where that solution is uncomfortable, the one from home is added. Otherwise the arm would wander into
        its limits.
        """
        match self._goal:
            case PoseGoal():
                yield self._near(self._possible(self._goal.tcp_in_world))
            case RegionGoal():
                rest = iter(self._possible(region_poses(self._goal)))
                for count in NEAR_BATCHES:
                    yield self._near(list(islice(rest, count)))
            case _:
                return

    def sample(self, seed: int) -> list[GoalConfiguration]:
        """Return free configurations for all poses of the goal; for a region, until their number is enough.

        Fails with planning.no_ik, .goal_in_collision or .constraint when it finds none.
        """
        match self._goal:
            case PoseGoal(poses):
                return self._sample(poses, seed, None)
            case RegionGoal():
                return self._sample(region_poses(self._goal), seed, ENOUGH_CONFIGURATIONS)
            case _:
                return [GoalConfiguration(self._joints(self._goal), 0)]

    def _possible(self, poses: tuple[Pose, ...]) -> list[tuple[int, Pose]]:
        """Return the numbered poses in the workspace at which the constraints hold."""
        return [
            (k, pose)
            for k, pose in enumerate(poses)
            if self._inspection.outside(pose.position) is None and not self._constraints.broken_by(pose)
        ]

    def _near(self, possible: list[tuple[int, Pose]]) -> list[GoalConfiguration]:
        targets: list[GoalConfiguration] = []
        for k, pose in possible:
            q = self._ik.descend(pose, self._start)
            if q is not None and self._start_tolerance.free(q):
                targets.append(GoalConfiguration(q, k))
            if q is None or configuration_cost(self._model, q) > UNCOMFORTABLE_COST:
                other = self._ik.descend(pose, self._home)
                if other is not None and self._start_tolerance.free(other):
                    targets.append(GoalConfiguration(other, k))
        return targets

    def _sample(self, poses: tuple[Pose, ...], seed: int, enough: int | None) -> list[GoalConfiguration]:
        if not poses:
            raise PicktreeError("the goal names no pose")
        possible = self._possible(poses)
        if not possible:
            raise self._impossible(poses)
        rng = np.random.default_rng(seed)
        before = self._ik.solves
        targets: list[GoalConfiguration] = []
        rejected: list[GoalConfiguration] = []
        for k, pose in possible:
            for q in self._ik.solutions(pose, rng, self._start, SOLUTIONS_PER_POSE):
                (targets if self._start_tolerance.free(q) else rejected).append(GoalConfiguration(q, k))
            if enough is not None and len(targets) >= enough:
                break
        if targets:
            return targets
        if not rejected:
            solves = self._ik.solves - before
            nearest = self._ik.nearest(possible[0][1], self._start)
            raise planning_failures.out_of_reach(self._model, poses, solves, nearest)
        each = [self._inspection.rejection(target.q) for target in rejected]
        raise planning_failures.goal_rejected(each, len(poses))

    def _impossible(self, poses: tuple[Pose, ...]) -> Failure:
        """Build the failure of poses that workspace or constraints exclude, whatever the arm's
        configuration."""
        off = [outside for pose in poses if (outside := self._inspection.outside(pose.position)) is not None]
        if len(off) == len(poses):
            return planning_failures.outside_workspace(
                "at the goal", min(off, key=lambda one: one.by), len(poses)
            )
        each = [broken for pose in poses if (broken := self._constraints.broken_by(pose))]
        return planning_failures.constraint_violated(
            "at the goal", min(each, key=lambda broken: broken[0].by)
        )

    def _joints(self, goal: NamedGoal | JointGoal) -> Array:
        q = self._model.named(goal.name) if isinstance(goal, NamedGoal) else np.array(goal.position)
        if bool(np.any(q < self._model.lower) or np.any(q > self._model.upper)):
            raise planning_failures.outside_limits(self._model, q)
        if broken := self._constraints.broken(q):
            raise planning_failures.constraint_violated("at the goal", broken)
        if not self._start_tolerance.free(q):
            raise planning_failures.goal_rejected([self._inspection.rejection(q)], 1)
        return q
