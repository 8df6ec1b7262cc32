"""Time parameterisation: how long motions take, how hard they jerk, whether they keep all limits, what it
costs.

Beside each stands a bare TOPP-RA of the same path in the same run, with the limits of velocity and
acceleration only: it is the shortest time there is for those, and its acceleration jumps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from _motion_robots import shipped
from _motion_tables import Column, Part, Table, cpu, median, p95, share
from picktree.robot.planning import (
    InverseKinematics,
    MotionPlan,
    OffsetGoal,
    PoseGoal,
    Request,
    RequestSolver,
    Scaling,
)
from picktree.robot.planning.motion_chain import MotionChain
from picktree.robot.planning.path_curves import JointCurve, rounded_polyline, spline_through
from picktree.robot.planning.time_parameterization import (
    TORQUE_LIMIT_SHARE,
    PathLimits,
    ScaledStretch,
    time_curve,
)
from picktree.world import Array, Failure, PlanningScene, Pose, Trajectory
from picktree.world.robot_model import RobotModel

import numpy as np
from toppra.algorithm import TOPPRA
from toppra.constraint import (
    Constraint,
    DiscretizationType,
    JointAccelerationConstraint,
    JointVelocityConstraint,
)
from toppra.interpolator import AbstractGeometricPath

T = TypeVar("T")
PERIOD = 0.01
"""Sampling period of the bare profile, that of ours, s."""
LINE = 0.15
"""Length of a straight line of the TCP, m."""
SLACK = 0.01
"""Share by which torques may exceed their limits between two checked samples."""


class _Path(AbstractGeometricPath):
    """A curve as TOPP-RA wants to see it."""

    def __init__(self, curve: JointCurve) -> None:
        self._curve = curve

    def __call__(self, path_positions: Array | float, order: int = 0) -> Array:
        return self._curve.at(path_positions, order)

    @property
    def dof(self) -> int:
        return int(self._curve.coefficients.shape[2])

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, self._curve.length])

    @property
    def waypoints(self) -> None:
        return None


def bare_profile(model: RobotModel, curve: JointCurve) -> Trajectory | None:
    """TOPP-RA with 100 grid points, sampled."""
    v, a = model.velocity_limit, model.acceleration_limit
    limits: list[Constraint] = [
        JointVelocityConstraint(np.column_stack([-v, v])),
        JointAccelerationConstraint(np.column_stack([-a, a]), DiscretizationType.Interpolation),
    ]
    path = _Path(curve)
    grid = np.linspace(0.0, curve.length, 101)
    found = TOPPRA(limits, path, grid, "seidel", "ParametrizeConstAccel").compute_trajectory(0.0, 0.0)
    if found is None:
        return None
    duration = float(found.path_interval[1])
    times = np.linspace(0.0, duration, max(2, int(np.ceil(duration / PERIOD)) + 1))
    return Trajectory(times, found(times, 0), found(times, 1), found(times, 2))


def _cpu(work: Callable[[], T]) -> tuple[float, T]:
    """CPU seconds of a call, and what it gives."""
    answers = list[T]()
    return cpu(lambda: answers.append(work())), answers[0]


def _keeps(model: RobotModel, t: Trajectory, jerk: Array) -> bool:
    """Whether velocity, acceleration, jerk and torque stay within their limits at and between all samples."""
    dt, more, still = np.diff(t.times)[:, None], 1.0 + 1e-9, np.zeros(model.n)
    for q, v, a in zip(t.position, t.velocity, t.acceleration, strict=True):
        weight = model.inverse_dynamics(q, still, still)
        left = np.maximum(TORQUE_LIMIT_SHARE * model.torque_limit - np.abs(weight), 0.1 * model.torque_limit)
        if (np.abs(model.inverse_dynamics(q, v, a) - weight) > left * (1.0 + SLACK)).any():
            return False
    return bool(
        (np.abs(t.velocity) <= model.velocity_limit * more).all()
        and (np.abs(t.acceleration) <= model.acceleration_limit * more).all()
        and (np.abs(np.diff(t.velocity, axis=0)) <= model.acceleration_limit * dt * more).all()
        and (np.abs(np.diff(t.acceleration, axis=0)) <= jerk * dt * more).all()
    )


def _jerks(model: RobotModel, trajectory: Trajectory, limit: Array) -> tuple[float, float]:
    """Greatest and rms jerk between samples as a share of the limits; rest comes before and after."""
    still = np.zeros((1, model.n))
    a = np.concatenate([still, trajectory.acceleration, still])
    dt = np.diff(trajectory.times)
    jerk = np.diff(a, axis=0) / np.concatenate([dt[:1], dt, dt[-1:]])[:, None] / limit
    return float(np.abs(jerk).max()), float(np.sqrt((jerk**2).mean()))


def _inside(model: RobotModel, rng: np.random.Generator, count: int) -> Array:
    home = model.named("home")
    return home + 0.6 * (rng.uniform(model.planned_lower, model.planned_upper, (count, model.n)) - home)


def _line(model: RobotModel, ik: InverseKinematics, rng: np.random.Generator) -> JointCurve:
    while True:
        q = [model.named("home") + rng.uniform(-0.3, 0.3, model.n)]
        begin, direction = model.tcp(q[0]), rng.normal(size=3)
        direction *= LINE / np.linalg.norm(direction)
        for k in range(1, 31):
            x, y, z = (float(c) for c in direction * k / 30)
            found = ik.descend(begin.shifted((x, y, z)), q[-1])
            if found is None or float(np.abs(found - q[-1]).max()) > 0.2:
                break
            q.append(found)
        else:
            return spline_through(np.array(q))


def _row(name: str, kind: str, model: RobotModel, runs: int, seed: int) -> tuple[str | float | None, ...]:
    rng = np.random.default_rng([seed, 7])
    ik = InverseKinematics(model)
    kept = timed = 0
    seconds, ratios, costs, cost_ratios = list[float](), list[float](), list[float](), list[float]()
    most, rms, bare_most = list[float](), list[float](), list[float]()
    for _ in range(runs):
        if kind == "line":
            curve = _line(model, ik, rng)
        else:
            count = 2 if kind == "direct" else int(rng.integers(3, 6))
            curve = rounded_polyline(_inside(model, rng, count), 0.1)
        stretches = (ScaledStretch(curve.length, Scaling()),)
        cost, timed_curve = _cpu(lambda c=curve, of=stretches: time_curve(model, c, of))
        bare_cost, reference = _cpu(lambda c=curve: bare_profile(model, c))
        if timed_curve is None:
            continue
        t = timed_curve.trajectory
        timed += 1
        limit = PathLimits(model, stretches).jerk
        kept += _keeps(model, t, limit)
        greatest, mean = _jerks(model, t, limit)
        most.append(greatest)
        rms.append(mean)
        seconds.append(t.duration)
        costs.append(cost * 1000)
        if reference is not None:
            ratios.append(t.duration / reference.duration)
            cost_ratios.append(cost / bare_cost)
            bare_most.append(_jerks(model, reference, limit)[0])
    return (
        f"{name}, {kind}",
        share(kept, timed),
        median(seconds),
        median(ratios),
        max(most, default=None),
        median(rms),
        max(bare_most, default=None),
        median(costs),
        p95(costs),
        median(cost_ratios),
    )


def _chains(model: RobotModel, name: str, runs: int, seed: int) -> tuple[str | float | None, ...]:
    """Compare one motion over five legs with five motions: above a point, down, up, above another, down."""
    rng = np.random.default_rng([seed, 8])
    home = model.named("home")
    solver = RequestSolver(model, PlanningScene([], []), configuration=lambda: home, width=lambda: 0.0)
    gained, slowest, costs = list[float](), list[float](), list[float]()
    tried = found = 0
    while tried < runs:
        tool = model.tcp(home)
        over = [
            tool.shifted((float(x), float(y), float(z)))
            for x, y, z in rng.uniform([-0.15, -0.3, -0.1], [0.1, 0.3, 0.05], (2, 3))
        ]
        slow = Scaling(0.4, 0.4)
        legs = [
            Request(_at(over[0])),
            Request(OffsetGoal((0.0, 0.0, -0.1)), scaling=slow),
            Request(OffsetGoal((0.06, 0.0, 0.08)), scaling=slow),
            Request(_at(over[1])),
            Request(OffsetGoal((0.0, 0.0, -0.08)), scaling=slow),
        ]
        tried += 1
        cost, plan = _cpu(lambda legs=legs, tried=tried: _chain(solver, legs, seed + tried))
        if plan is None:
            continue
        found += 1
        speed: Array = np.linalg.norm(plan.trajectory.velocity, axis=1)
        costs.append(cost * 1000)
        alone = [solver.solve(leg.request, 1) for leg in plan.legs if leg.request is not None]
        gained.append(plan.trajectory.duration / sum(leg.trajectory.duration for leg in alone))
        slowest += [float(v) for v in np.interp(plan.passes[:-1], plan.trajectory.times, speed)]
    through = len([each for each in slowest if each > 1e-3])
    return (
        name,
        f"{found} of {tried}",
        share(through, len(slowest)),
        median(gained),
        median(slowest),
        median(costs),
    )


def _chain(solver: RequestSolver, legs: list[Request], seed: int) -> MotionPlan | None:
    try:
        return MotionChain(solver).solve(legs, [seed] * len(legs))
    except Failure:
        return None


def _at(pose: Pose) -> PoseGoal:
    return PoseGoal((pose,))


def measure(runs: int, seed: int) -> list[Table]:
    robots = shipped().items()
    rows = [
        _row(name, kind, model, runs, seed)
        for name, model in robots
        for kind in ("direct", "corners", "line")
    ]
    chains = [_chains(model, name, max(10, runs // 10), seed) for name, model in robots]
    return [
        Table(
            "Time parameterisation beside a bare TOPP-RA of the same path",
            (
                Column("path"),
                Column("keeps all limits"),
                Column("s", ".2f"),
                Column("/ bare", ".2f"),
                Column("jerk max", ".2f"),
                Column("rms", ".3f"),
                Column("bare max", ".2f"),
                Column("CPU ms", ".2f"),
                Column("p95", ".2f"),
                Column("/ bare", ".2f"),
            ),
            rows,
            (
                "direct: one segment; corners: 2 to 4, rounded by up to 0.1 rad; line: 15 cm of the TCP.",
                "Medians. jerk: greatest and rms over all joints, as a share of the joints' jerk limits.",
                "The bare profile keeps velocity and acceleration only; ours also jerk and torque.",
            ),
        ),
        Table(
            "Five motions as one: over a point, down, up, over another, down",
            (
                Column("robot"),
                Column("found"),
                Column("corners passed without a stop"),
                Column("time / stops", ".2f"),
                Column("rad/s there", ".2f"),
                Column("CPU ms", ".1f"),
            ),
            chains,
            ("time / stops: of the chain over that of its five motions with a stop after each. Medians.",),
        ),
    ]


PART = Part(
    "timing",
    "time parameterisation and chains beside a bare TOPP-RA",
    "paths of each kind and arm",
    300,
    0.2,
    measure,
)
