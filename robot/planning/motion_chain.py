"""Motion chain: several motions, each from the end of the one before, as one trajectory without a stop in
between."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from picktree.world import Array, Failure, Trajectory, planning

from . import planning_failures
from .joint_planner import CORNER_RADII
from .motion_plans import LegFailure, MotionPlan, PlannedPath
from .path_constraints import PathConstraints
from .path_curves import (
    JointCurve,
    blend_curves,
    concatenate,
    distinct,
    polyline_length,
    rounded_polyline,
    spline_through,
)
from .requests import LineGoal, OffsetGoal, Request
from .solver import RequestSolver
from .time_parameterization import ScaledStretch, TimedTrajectory, stationary_trajectory, time_curve
from .trajectory_check import ConfigurationCheck, StartTolerance, is_trajectory_free

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
    """Planned leg with its curve, if it moves at all."""

    index: int
    request: Request
    path: Array
    curve: JointCurve

    @property
    def line(self) -> bool:
        return isinstance(self.request.target, LineGoal | OffsetGoal)


class _RoundedEnds:
    """Collision check of a leg that keeps the full margins where an end is rounded."""

    def __init__(self, way: StartTolerance, ends: Sequence[tuple[Array, float | None]]) -> None:
        """`ends`: configuration (n,) of each end, and how far from it the corner is cut, rad."""
        self.model = way.model
        self.count_free = way.count_free
        self._way = way
        self._ends = [(q, cut) for q, cut in ends if cut is not None]

    def nearly_free(self, q: Array) -> bool:
        """Whether q is not in a corner, and keeps halved margins."""
        return self._way.nearly_free(q) and all(
            float(np.linalg.norm(q - end)) > cut for end, cut in self._ends
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Refusal:
    """Failure of the leg that begins at `start` (n,), rad; None: the start of the chain."""

    start: Array | None
    failure: LegFailure


class MotionChain:
    """Solution of the legs of one request to `PlanService.through`.

    At first no leg is timed or checked by itself, and corners are cut as far as they may be. Nearly always
    the chain's one trajectory is then free, corners with full margins. Otherwise each leg and each corner is
    checked.
    """

    def __init__(self, solver: RequestSolver, rounded: float = DEFAULT_LINE_ROUNDING) -> None:
        """Set the length of a straight line that may be rounded at each of its ends, m."""
        self._solver = solver
        self._rounded = rounded
        self._checked = False
        """Whether legs and corners are checked before they are timed as one."""

    def solve(self, legs: Sequence[Request], seeds: Sequence[int]) -> MotionPlan:
        """Plan the chain. Fails as the leg that fails does, and names that leg."""
        begun = self._solver.collision.checks
        planned = self._planned(legs, seeds, self._solver.path)
        timed = None if isinstance(planned, _Refusal) else self._joined_trajectory(planned)
        if timed is None:
            self._checked = True
            refused = planned if isinstance(planned, _Refusal) else None
            planned = self._planned(legs, seeds, self._solver.solve, refused)
            if isinstance(planned, _Refusal):
                raise planned.failure
            timed = self._joined_trajectory(planned)
        assert not isinstance(planned, _Refusal)
        if timed is None:
            raise Failure(
                planning.NO_PATH,
                "each of the motions is free, but not all of them as one, stops between them included",
                motions=len(planned),
            )
        trajectory, ends = timed
        return MotionPlan(
            np.concatenate([planned[0].path[:1], *(leg.path[1:] for leg in planned)]),
            "chain",
            self._solver.collision.checks - begun,
            planned[-1].goal_index,
            planned[-1].fraction,
            trajectory=trajectory,
            passes=tuple(ends),
            legs=tuple(planned),
        )

    def _planned(
        self,
        legs: Sequence[Request],
        seeds: Sequence[int],
        plan: Callable[[Request, int], PlannedPath],
        refused: _Refusal | None = None,
    ) -> list[PlannedPath] | _Refusal:
        """Plan each leg from the end of the one before, unless the leg that was `refused` begins there
        again."""
        planned: list[PlannedPath] = []
        for k, (leg, seed) in enumerate(zip(legs, seeds, strict=True)):
            start = planned[-1].path[-1] if planned else None
            if refused is not None and refused.failure.leg == k and _same(start, refused.start):
                return refused
            try:
                planned.append(plan(leg if start is None else replace(leg, start=start), seed))
            except Failure as failure:
                where = f"motion {k + 1} of {len(legs)} ({planning_failures.describe_goal(leg.target)})"
                message = f"{where}: {failure.message}"
                return _Refusal(start, LegFailure(failure.cause, message, k, failure.evidence))
        return planned

    def _joined_trajectory(self, planned: Sequence[PlannedPath]) -> tuple[Trajectory, list[float]] | None:
        """Return one trajectory through these paths, and the end time of each leg; None: none is free."""
        moving: list[_Leg] = []
        for k, leg in enumerate(planned):
            assert leg.request is not None
            curve = self._curve(leg.request, leg)
            if curve is not None:
                moving.append(_Leg(k, leg.request, leg.path, curve))
        if not moving:
            return stationary_trajectory(planned[-1].path[-1]), [0.0] * len(planned)
        corners = self._corners(moving)
        timed = self._timed(moving, corners)
        if timed is None and self._checked and any(corners):
            timed = self._timed(moving, [None] * len(corners))
        if timed is None:
            return None
        trajectory, passed = timed
        return trajectory, _leg_end_times([leg.index for leg in moving], passed, len(planned))

    def _way(self, request: Request) -> StartTolerance:
        """Return the leg's start tolerance. The checker follows the leg's suppositions from this call on."""
        self._solver.look(request)
        assert request.start is not None
        return StartTolerance(self._solver.collision, request.start)

    def _curve(self, request: Request, planned: PlannedPath) -> JointCurve | None:
        points = distinct(planned.path)
        if len(points) < 2:
            return None
        if len(points) == 2:
            return rounded_polyline(points, 0.0)
        if isinstance(request.target, LineGoal | OffsetGoal):
            return spline_through(points)
        if not isinstance(planned, MotionPlan):
            return rounded_polyline(points, CORNER_RADII[0])
        if not request.constraints:
            way = self._way(request)
            for radius in CORNER_RADII:
                curve = rounded_polyline(points, radius)
                if all(way.nearly_free(q) for q in curve.at(_check_parameters(0.0, curve.length))):
                    return curve
        timed = planned.trajectory
        return spline_through(distinct(timed.position[:: max(1, len(timed.times) // 60)]))

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
        end = before.curve.at(before.curve.length, 1)
        if float(end @ after.curve.at(0.0, 1)) < MIN_CORNER_COSINE:
            return None
        tried = sorted(
            {min(radius, room) for radius in CORNER_CUTS if min(radius, room) > 1e-3}, reverse=True
        )
        if not self._checked:
            return next(iter(tried), None)
        for radius in tried:
            blend = blend_curves(before.curve, after.curve, radius)
            first, second = _check_parameters(0.0, radius), _check_parameters(radius, 2.0 * radius)
            if self._allows(before, blend.at(first)) and self._allows(after, blend.at(second)):
                return radius
        return None

    def _allows(self, leg: _Leg, configurations: Array) -> bool:
        constraints = PathConstraints(self._solver.model, leg.request.constraints)
        way = self._way(leg.request)
        return way.count_free(configurations) == len(configurations) and all(
            constraints.hold(q) for q in configurations
        )

    def _room(self, leg: _Leg, most: float, *, at_end: bool) -> float:
        """Return how far a corner may reach into a leg, rad: at most that share of it."""
        whole = leg.curve.length
        if not leg.line:
            return most * whole
        begin = np.array(self._solver.model.tcp(leg.path[0]).position)
        end = np.array(self._solver.model.tcp(leg.path[-1]).position)
        length = float(np.linalg.norm(end - begin))
        # The joints' travel along a line is uneven: the part near the corner is measured by itself.
        share = most if length < 1e-6 else min(most, self._rounded / length)
        index = round(share * (len(leg.path) - 1))
        if index == len(leg.path) - 1:  # A line of millimetres has one step.
            return share * whole
        part = leg.path[-1 - index :] if at_end else leg.path[: index + 1]
        return polyline_length(part)

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
        return (trajectory, passed) if self._stay_free(legs, corners, trajectory, passed) else None

    def _stay_free(
        self,
        legs: Sequence[_Leg],
        corners: Sequence[float | None],
        trajectory: Trajectory,
        passed: Sequence[float],
    ) -> bool:
        begin = 0.0
        for leg, cuts, end in zip(legs, itertools.pairwise([None, *corners, None]), passed, strict=True):
            part = slice_trajectory(trajectory, begin, end)
            constraints = PathConstraints(self._solver.model, leg.request.constraints)
            way: ConfigurationCheck = self._way(leg.request)
            if not self._checked:
                way = _RoundedEnds(way, tuple(zip((leg.path[0], leg.path[-1]), cuts, strict=True)))
            if not is_trajectory_free(way, part):
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


def _same(a: Array | None, b: Array | None) -> bool:
    return a is b if a is None or b is None else np.array_equal(a, b)


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


def _check_parameters(low: float, high: float) -> Array:
    return np.linspace(low, high, max(2, int(np.ceil((high - low) / CORNER_CHECK_STEP)) + 1))
