"""The configurations that reach what is asked for, and why others that would reach it are rejected."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from ...errors import PicktreeError
from ...robots.model import RobotModel
from ...world.causes import Failure
from ...world.values import Array, Pose
from ..collision.start_tolerance import Way
from ..failures import planning_failures as failing
from ..failures.goal_rejections import Inspection
from ..kinematics.inverse_kinematics import InverseKinematics
from ..kinematics.posture import discomfort
from ..path_constraints import PathConstraints
from ..requests import Goal, JointGoal, NamedGoal, PoseGoal, RegionGoal
from .goal_regions import poses

HOME = "home"
UNCOMFORTABLE = 0.3
"""See `posture.discomfort`, rad."""
SOLUTIONS = 4
"""IK solutions that are looked for, for each pose."""
NEAR = (1, 8, 16)
"""Poses of a region that are tried together by their near solutions, in this order."""
ENOUGH = 8
"""Free configurations in a region with which a search begins."""


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A configuration (n,) that reaches pose number `index` of the goal."""

    q: Array
    index: int


class Goals:
    """What one request's goal means for the arm."""

    def __init__(
        self,
        model: RobotModel,
        ik: InverseKinematics,
        inspection: Inspection,
        way: Way,
        start: Array,
        constraints: PathConstraints,
        goal: Goal,
    ) -> None:
        self._model = model
        self._inspection = inspection
        self._ik = ik
        self._way = way
        self._start = start
        self._constraints = constraints
        self._goal = goal
        self._home = model.named(HOME)

    def near(self) -> Iterator[list[Target]]:
        """For each pose the solution that the start itself leads to, where it is free; those of a region in
        parts, near ones first. Where that one is uncomfortable, also the one that home leads to: else the
        arm would wander into its limits."""
        match self._goal:
            case PoseGoal():
                yield self._near(self._possible(self._goal.tcp_in_world))
            case RegionGoal():
                rest = iter(self._possible(poses(self._goal)))
                for count in NEAR:
                    yield self._near(list(islice(rest, count)))
            case _:
                return

    def all(self, seed: int) -> list[Target]:
        """Free configurations for all poses of the goal, for a region until there are enough.

        Fails with planning.no_ik, .goal_in_collision or .constraint when there is none.
        """
        match self._goal:
            case PoseGoal(wanted):
                return self._all(wanted, seed, None)
            case RegionGoal():
                return self._all(poses(self._goal), seed, ENOUGH)
            case _:
                return [Target(self._joints(self._goal), 0)]

    def _possible(self, wanted: tuple[Pose, ...]) -> list[tuple[int, Pose]]:
        """Those in the workspace at which the constraints hold, numbered."""
        return [
            (k, pose)
            for k, pose in enumerate(wanted)
            if self._inspection.outside(pose.position) is None and not self._constraints.broken_by(pose)
        ]

    def _near(self, possible: list[tuple[int, Pose]]) -> list[Target]:
        targets: list[Target] = []
        for k, pose in possible:
            q = self._ik.descend(pose, self._start)
            if q is not None and self._way.free(q):
                targets.append(Target(q, k))
            if q is None or discomfort(self._model, q) > UNCOMFORTABLE:
                other = self._ik.descend(pose, self._home)
                if other is not None and self._way.free(other):
                    targets.append(Target(other, k))
        return targets

    def _all(self, wanted: tuple[Pose, ...], seed: int, enough: int | None) -> list[Target]:
        if not wanted:
            raise PicktreeError("the goal names no pose")
        possible = self._possible(wanted)
        if not possible:
            raise self._impossible(wanted)
        rng = np.random.default_rng(seed)
        before = self._ik.solves
        targets: list[Target] = []
        rejected: list[Target] = []
        for k, pose in possible:
            for q in self._ik.solutions(pose, rng, self._start, SOLUTIONS):
                (targets if self._way.free(q) else rejected).append(Target(q, k))
            if enough is not None and len(targets) >= enough:
                break
        if targets:
            return targets
        if not rejected:
            solves = self._ik.solves - before
            nearest = self._ik.nearest(possible[0][1], self._start)
            raise failing.out_of_reach(self._model, wanted, solves, nearest)
        each = [self._inspection.rejection(target.q) for target in rejected]
        raise failing.goal_rejected(each, len(wanted))

    def _impossible(self, wanted: tuple[Pose, ...]) -> Failure:
        """All poses are excluded before the arm is thought of: by the workspace, or by a constraint."""
        off = [outside for pose in wanted if (outside := self._inspection.outside(pose.position)) is not None]
        if len(off) == len(wanted):
            return failing.outside_workspace("at the goal", min(off, key=lambda one: one.by), len(wanted))
        each = [broken for pose in wanted if (broken := self._constraints.broken_by(pose))]
        return failing.breaks("at the goal", min(each, key=lambda broken: broken[0].by))

    def _joints(self, goal: NamedGoal | JointGoal) -> Array:
        q = self._model.named(goal.name) if isinstance(goal, NamedGoal) else np.array(goal.position)
        if bool(np.any(q < self._model.lower) or np.any(q > self._model.upper)):
            raise failing.outside_limits(self._model, q)
        if broken := self._constraints.broken(q):
            raise failing.breaks("at the goal", broken)
        if not self._way.free(q):
            raise failing.goal_rejected([self._inspection.rejection(q)], 1)
        return q
