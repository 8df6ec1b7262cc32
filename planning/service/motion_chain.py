"""Motion chain: several motions, each from the end of the one before, as one trajectory without a stop in
between."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...world.causes import Failure, planning
from ...world.trajectory import Trajectory
from ...world.values import Array
from ..collision.trajectory_check import StartTolerance, is_trajectory_free
from ..failures import planning_failures
from ..path_constraints import PathConstraints
from ..requests import LegFailure, LineGoal, MotionPlan, OffsetGoal, Request
from ..search.joint_planner import CORNER_RADII
from ..timing.path_curves import (
    JointCurve,
    blend_curves,
    concatenate,
    distinct,
    rounded_polyline,
    spline_through,
)
from ..timing.time_parameterization import TimedTrajectory, stationary_trajectory, time_curve
from ..timing.toppra_profile import ScaledStretch
from .solver import RequestSolver

DEFAULT_LINE_ROUNDING = 0.02
"""Length of a straight line that may be rounded at each of its ends by default, m."""
CORNER_CUTS = (0.4, 0.2, 0.1, 0.05, 0.02)
"""Distances at which the corner between two legs is cut on either side, tried in this order, rad."""
MAX_CORNER_SHARE = 0.45
"""Share of a leg that may be rounded at each of its ends."""
MAX_LONE_CORNER_SHARE = 0.7
"""Share of the first or the last leg that may be rounded: it has one corner."""
MIN_CORNER_COSINE = -0.9
"""Cosine of the turn between two legs below which the arm stops: the path goes back on itself."""
CORNER_CHECK_STEP = 0.02
"""Distance of the configurations at which a rounded corner is checked, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class _Leg:
    """Planned leg with its path, if it moves at all."""

    index: int
    request: Request
    plan: MotionPlan
    curve: JointCurve

    @property
    def line(self) -> bool:
        return isinstance(self.request.target, LineGoal | OffsetGoal)


class MotionChain:
    """Solution of the legs of one request to `PlanService.through`."""

    def __init__(self, solver: RequestSolver, rounded: float = DEFAULT_LINE_ROUNDING) -> None:
        """Set the length of a straight line that may be rounded at each of its ends, m."""
        self._solver = solver
        self._rounded = rounded

    def solve(self, legs: Sequence[Request], seeds: Sequence[int]) -> MotionPlan:
        """Plan the chain. Fails as the leg that fails does, and names that leg."""
        plans: list[MotionPlan] = []
        requests: list[Request] = []
        for k, (leg, seed) in enumerate(zip(legs, seeds, strict=True)):
            request = replace(leg, start=plans[-1].path[-1]) if plans else leg
            try:
                plans.append(self._solver.solve(request, seed))
            except Failure as failure:
                where = f"motion {k + 1} of {len(legs)} ({planning_failures.describe_goal(leg.target)})"
                message = f"{where}: {failure.message}"
                raise LegFailure(failure.cause, message, k, failure.evidence) from None
            requests.append(replace(request, start=plans[-1].path[0]))
        return self._as_one(requests, plans)

    def _as_one(self, requests: Sequence[Request], plans: Sequence[MotionPlan]) -> MotionPlan:
        begun = self._solver.collision.checks
        moving = [
            _Leg(k, request, plan, curve)
            for k, (request, plan) in enumerate(zip(requests, plans, strict=True))
            if (curve := self._curve(request, plan)) is not None
        ]
        if not moving:
            trajectory, ends = stationary_trajectory(plans[-1].path[-1]), [0.0] * len(plans)
        else:
            corners = self._corners(moving)
            timed = self._timed(moving, corners)
            if timed is None and any(corners):
                timed = self._timed(moving, [None] * len(corners))
            if timed is None:
                raise Failure(
                    planning.NO_PATH,
                    "each of the motions is free, but not all of them as one, stops between them included",
                    motions=len(plans),
                )
            trajectory, passed = timed
            ends = _leg_end_times([leg.index for leg in moving], passed, len(plans))
        checks = sum(plan.checks for plan in plans) + self._solver.collision.checks - begun
        path = np.concatenate([plans[0].path[:1], *(plan.path[1:] for plan in plans)])
        return MotionPlan(
            trajectory,
            path,
            "chain",
            checks,
            plans[-1].goal_index,
            plans[-1].fraction,
            passes=tuple(ends),
            legs=tuple(plans),
        )

    def _way(self, request: Request) -> StartTolerance:
        """Return the leg's start tolerance. The checker follows the leg's suppositions from this call on."""
        self._solver.look(request)
        assert request.start is not None
        return StartTolerance(self._solver.collision, request.start)

    def _curve(self, request: Request, plan: MotionPlan) -> JointCurve | None:
        points = distinct(plan.path)
        if len(points) < 2:
            return None
        if len(points) == 2:
            return rounded_polyline(points, 0.0)
        if isinstance(request.target, LineGoal | OffsetGoal):
            return spline_through(points)
        if not request.constraints:
            way = self._way(request)
            for radius in CORNER_RADII:
                curve = rounded_polyline(points, radius)
                if all(way.nearly_free(q) for q in curve.at(_check_parameters(0.0, curve.length))):
                    return curve
        return spline_through(distinct(plan.trajectory.position[:: max(1, len(plan.trajectory.times) // 60)]))

    def _corners(self, legs: Sequence[_Leg]) -> list[float | None]:
        """Return the distance at which the corner after each leg but the last is cut, rad; None: the arm
        stops there."""
        shares = [MAX_LONE_CORNER_SHARE, *[MAX_CORNER_SHARE] * (len(legs) - 2), MAX_LONE_CORNER_SHARE]
        room = [
            min(self._room(before, share, at_end=True), self._room(after, other, at_end=False))
            for (before, share), (after, other) in itertools.pairwise(zip(legs, shares, strict=False))
        ]
        return [self._corner(*pair, each) for pair, each in zip(itertools.pairwise(legs), room, strict=True)]

    def _corner(self, before: _Leg, after: _Leg, room: float) -> float | None:
        """Return the distance at which the corner between two legs is cut, at most `room` rad; None: the arm
        stops there."""
        if float(_end_direction(before.curve) @ after.curve.at(0.0, 1)) < MIN_CORNER_COSINE:
            return None
        tried = sorted(
            {min(radius, room) for radius in CORNER_CUTS if min(radius, room) > 1e-3}, reverse=True
        )
        for radius in tried:
            blend = blend_curves(before.curve, after.curve, radius)
            first, second = _check_parameters(0.0, radius), _check_parameters(radius, 2.0 * radius)
            if self._allows(before, blend.at(first)) and self._allows(after, blend.at(second)):
                return radius
        return None

    def _allows(self, leg: _Leg, configurations: Array) -> bool:
        constraints = PathConstraints(self._solver.model, leg.request.constraints)
        way = self._way(leg.request)
        return all(way.free(q) for q in configurations) and all(constraints.hold(q) for q in configurations)

    def _room(self, leg: _Leg, most: float, *, at_end: bool) -> float:
        """Return how far a corner may reach into a leg, rad: at most that share of it."""
        whole = leg.curve.length
        if not leg.line:
            return most * whole
        begin = np.array(self._solver.model.tcp(leg.plan.path[0]).position)
        end = np.array(self._solver.model.tcp(leg.plan.path[-1]).position)
        length = float(np.linalg.norm(end - begin))
        # The joints' travel along a line is uneven: the part near the corner is measured by itself.
        share = most if length < 1e-6 else min(most, self._rounded / length)
        index = round(share * (len(leg.plan.path) - 1))
        part = leg.plan.path[-1 - index :] if at_end else leg.plan.path[: index + 1]
        return float(np.linalg.norm(np.diff(part, axis=0), axis=1).sum())

    def _timed(
        self, legs: Sequence[_Leg], corners: Sequence[float | None]
    ) -> tuple[Trajectory, list[float]] | None:
        """Return the trajectory with these corners, and the time at which it passes the end of each leg;
        None: not free."""
        model = self._solver.model
        parts: list[TimedTrajectory] = []
        passed: list[float] = []
        elapsed = 0.0
        for run in _split_into_runs(legs, corners):
            curve, ends = _run_curve(run)
            stretches = [
                ScaledStretch(end, leg.request.scaling) for (leg, _), end in zip(run, ends, strict=True)
            ]
            timed = time_curve(model, curve, stretches)
            if timed is None:
                return None
            parts.append(timed)
            passed += [elapsed + timed.when(end) for end in ends[:-1]]
            elapsed += timed.trajectory.duration
            passed.append(elapsed)
        trajectory = _concatenate_trajectories([part.trajectory for part in parts])
        return (trajectory, passed) if self._stay_free(legs, trajectory, passed) else None

    def _stay_free(self, legs: Sequence[_Leg], trajectory: Trajectory, passed: Sequence[float]) -> bool:
        begin = 0.0
        for leg, end in zip(legs, passed, strict=True):
            part = slice_trajectory(trajectory, begin, end)
            constraints = PathConstraints(self._solver.model, leg.request.constraints)
            if not is_trajectory_free(self._way(leg.request), part):
                return False
            if not all(constraints.hold(q) for q in part.position):
                return False
            begin = end
        return True


def split_into_legs(plan: MotionPlan) -> list[Trajectory]:
    """Cut a chain's trajectory at the ends of its legs; the trajectory of a single motion stays whole."""
    if not plan.legs:
        return [plan.trajectory]
    begins = (0.0, *plan.passes[:-1])
    return [slice_trajectory(plan.trajectory, a, b) for a, b in zip(begins, plan.passes, strict=True)]


def slice_trajectory(trajectory: Trajectory, begin: float, end: float) -> Trajectory:
    """Return the samples from the last one not after `begin` to the first one not before `end`, s. The ends
    may move."""
    low = max(0, int(np.searchsorted(trajectory.times, begin, side="right")) - 1)
    high = min(len(trajectory.times), int(np.searchsorted(trajectory.times, end, side="left")) + 1)
    part = slice(low, max(high, low + 1))
    return Trajectory(
        trajectory.times[part] - trajectory.times[low],
        trajectory.position[part],
        trajectory.velocity[part],
        trajectory.acceleration[part],
    )


def _leg_end_times(indices: Sequence[int], passed: Sequence[float], count: int) -> list[float]:
    """Return the end time of every leg, those that do not move included."""
    ends: list[float] = []
    latest = 0.0
    found = dict(zip(indices, passed, strict=True))
    for k in range(count):
        latest = found.get(k, latest)
        ends.append(latest)
    return ends


def _split_into_runs(
    legs: Sequence[_Leg], corners: Sequence[float | None]
) -> list[list[tuple[_Leg, float | None]]]:
    """Group the legs between two stops, each with the cut of the corner after it."""
    runs: list[list[tuple[_Leg, float | None]]] = [[]]
    for leg, corner in zip(legs, [*corners, None], strict=True):
        runs[-1].append((leg, corner))
        if corner is None:
            runs.append([])
    return runs[:-1]


def _run_curve(run: Sequence[tuple[_Leg, float | None]]) -> tuple[JointCurve, list[float]]:
    """Return the path of one run, and its parameter at the end of each leg: the middle of the corner
    there."""
    pieces: list[JointCurve] = []
    ends: list[float] = []
    done, begin = 0.0, 0.0
    for k, (leg, corner) in enumerate(run):
        cut = 0.0 if corner is None else corner
        pieces.append(leg.curve.piece(begin, leg.curve.length - cut))
        done += pieces[-1].length
        if corner is not None:
            pieces.append(blend_curves(leg.curve, run[k + 1][0].curve, corner))
            ends.append(done + corner)
            done += pieces[-1].length
        begin = cut
    ends.append(done)
    return concatenate(pieces), ends


def _concatenate_trajectories(parts: Sequence[Trajectory]) -> Trajectory:
    if len(parts) == 1:
        return parts[0]
    times, begin = [parts[0].times], parts[0].duration
    for part in parts[1:]:
        times.append(part.times[1:] + begin)
        begin += part.duration

    def rows(name: Literal["position", "velocity", "acceleration"]) -> Array:
        return np.concatenate([getattr(part, name)[k > 0 :] for k, part in enumerate(parts)])

    return Trajectory(np.concatenate(times), rows("position"), rows("velocity"), rows("acceleration"))


def _end_direction(curve: JointCurve) -> Array:
    return curve.at(curve.length, 1)


def _check_parameters(low: float, high: float) -> Array:
    return np.linspace(low, high, max(2, int(np.ceil((high - low) / CORNER_CHECK_STEP)) + 1))
