"""Trajectory gate: the last check of every trajectory before the arm starts it; and the check of a jog."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from picktree.world import Array, Bounds, Cause, Failure, Trajectory, planning, safety, workspace_excess
from picktree.world.robot_model import RobotModel, format_joint_value

from . import planning_failures
from .lookahead_planning import PlanProvenance, without_held_supposition
from .motion_chain import slice_trajectory
from .motion_plans import ContactPair
from .plan_service import PlanService
from .requests import JointGoal, Request
from .trajectory_check import StartTolerance, first_collision, sampled_configurations

LIMIT_EXCESS_SHARE = 0.02
"""Greatest excess of a speed or an acceleration over its limit, as a share of the limit."""
LIMIT_ROUNDING = 1e-6
"""Greatest excess of a joint over its soft limit, rad."""
SAMPLE_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of the time between two samples at which a motion is checked."""


class TrajectoryGate:
    """Trajectory gate: it rejects a trajectory that must not be followed. The arm then stays, and the failure
    gives the reason.

    These checks always apply: numbers and times are valid. Joints keep their soft limits and their limits of
    speed and acceleration, also between the samples. The tool stays in the workspace. A violation at the
    start may be left, but not increased.

    Collisions are checked at 5 mm of the tool by the fast checker, with the trajectory's suppositions. They
    are the held object, allowed pairs and opening of the fingers of its plan, leg by leg. A plan has passed
    that check when it was made. It is checked again, and charged, when the belief, the hand or the allowed
    pairs have changed since. So is each trajectory without provenance. Time alone changes nothing: the answer
    depends on the belief and the trajectory. With `verify`, python-fcl verifies each trajectory that is
    checked again, and each plan.
    """

    def __init__(self, model: RobotModel, plans: PlanService, workspace: Bounds) -> None:
        self._model = model
        self._plans = plans
        self._workspace = workspace

    def passes(self, trajectory: Trajectory) -> Generator[None, None, None]:
        """Return when the trajectory may begin, after the ticks that its checks cost.

        Fails with safety.trajectory, .joint_limit, .speed_limit, .acceleration_limit or .workspace, or with
        planning.blocked when it is believed to touch something.
        """
        _check_soundness(trajectory, self._model.n)
        self._limits(trajectory)
        self._stays_inside(trajectory)
        made = self._plans.made.of(trajectory)
        while made is None or not _still_holds(made, self._plans):
            with self._plans.checking():
                self._free(trajectory, made)
            self._plans.made.renew(trajectory)
            yield from self._plans.charge()
            made = self._plans.made.of(trajectory)

    def blocked(self, trajectory: Trajectory, done: float) -> Failure | None:
        """Return the failure of a trajectory that changes of the belief have blocked, `done` s after its
        start; None: it is free.

        Only the rest is checked. Pairs that were allowed to touch at its start still are. The thinking
        account owes the checks.
        """
        plans = self._plans
        made = plans.made.of(trajectory)
        if made is None or made.seen.version == plans.made.now().version:
            return None
        try:
            with plans.checking():
                self._free(trajectory, made, done)
        except Failure as failure:
            return failure
        plans.made.renew(trajectory)
        return None

    def _limits(self, trajectory: Trajectory) -> None:
        model = self._model
        times, q, v, a = _between(trajectory)
        lower = np.minimum(model.lower, trajectory.start) - LIMIT_ROUNDING
        upper = np.maximum(model.upper, trajectory.start) + LIMIT_ROUNDING
        self._within(
            trajectory, times, np.maximum(lower - q, q - upper), q, safety.JOINT_LIMIT, "beyond its limit"
        )
        for values, limit, cause, unit in (
            (v, model.velocity_limit, safety.SPEED_LIMIT, "rad/s above its speed limit"),
            (a, model.acceleration_limit, safety.ACCELERATION_LIMIT, "rad/s² above its acceleration limit"),
        ):
            size = np.abs(values)
            beyond = np.where(size > (1.0 + LIMIT_EXCESS_SHARE) * limit, size - limit, 0.0)
            self._within(trajectory, times, beyond, values, cause, unit)

    def _within(
        self, trajectory: Trajectory, times: Array, beyond: Array, values: Array, cause: Cause, what: str
    ) -> None:
        row, joint = np.unravel_index(int(beyond.argmax()), beyond.shape)
        by = float(beyond[row, joint])
        if by <= 0.0:
            return
        at, name = float(times[row]), self._model.description.joints[int(joint)]
        is_position = cause is safety.JOINT_LIMIT
        size = format_joint_value(self._model, int(joint), by) if is_position else f"{by:.3f}"
        raise Failure(
            cause,
            f"the trajectory is refused: {name} would be {size} {what} {_time_words(at, trajectory)}",
            joint=name,
            value=float(values[row, joint]),
            beyond=by,
            time=at,
            fraction=_time_share(at, trajectory),
        )

    def _stays_inside(self, trajectory: Trajectory) -> None:
        low, high = np.array(self._workspace.min), np.array(self._workspace.max)
        path = sampled_configurations(self._model, trajectory)
        tool = self._model.tcp_positions(path)
        outside = np.maximum(low - tool, tool - high).max(axis=1)
        # From outside the tool may come back, but not go further out.
        beyond = outside - max(0.0, float(outside[0])) - LIMIT_ROUNDING
        worst = int(beyond.argmax())
        if beyond[worst] <= 0.0:
            return
        at = _time_of(trajectory, path[worst])
        raise Failure(
            safety.WORKSPACE,
            f"the trajectory is refused: the tool would be {outside[worst] * 1000:.0f} mm outside the "
            f"workspace{_side(self._workspace, tool[worst])} {_time_words(at, trajectory)}",
            position=[round(float(c), 4) for c in tool[worst]],
            beyond=float(outside[worst]),
            time=at,
            fraction=_time_share(at, trajectory),
        )

    def _free(self, trajectory: Trajectory, made: PlanProvenance | None, done: float = 0.0) -> None:
        begin = 0.0
        for request, end in _suppositions(trajectory, made):
            since, begin = max(begin, done), end
            if since > 0.0 and since >= end:
                continue
            part = slice_trajectory(trajectory, since, end)
            solver = self._plans.solver
            supposed = without_held_supposition(solver, request)
            if made is not None and done > 0.0:
                allowed = tuple((a, b) for a, b in map(sorted, made.seen.allowed))
                supposed = replace(supposed, start=part.start, allowed=(*supposed.allowed, *allowed))
            try:
                solver.look(supposed)
            except Failure as failure:
                raise Failure(
                    planning.BLOCKED,
                    f"the trajectory is refused: {failure.message}, and its plan supposed that it is held",
                    **failure.evidence,
                ) from None
            way = StartTolerance(solver.collision, solver.start(supposed))
            hit = first_collision(way, part)
            if hit is not None:
                self._refuse(trajectory, part, way, since, hit)
            self._plans.verify(supposed, part)

    def _refuse(
        self, trajectory: Trajectory, part: Trajectory, way: StartTolerance, begin: float, found: Array
    ) -> None:
        """Raise the failure of the earliest configuration that is hit; `found` (n,) is any one."""
        collision = self._plans.solver.collision
        path = sampled_configurations(self._model, part)
        hit = next((q for q in path if not way.free(q) and not way.nearly_free(q)), found)
        at = begin + _time_of(part, hit)
        contacts = collision.contacts(hit)
        touched = "; ".join(planning_failures.contact_lines(contacts)) or "the edge of the workspace"
        raise Failure(
            planning.BLOCKED,
            f"the way is not free: {touched} {_time_words(at, trajectory)}",
            contacts=planning_failures.contact_lines(contacts),
            time=at,
            fraction=_time_share(at, trajectory),
            configuration=[round(float(c), 4) for c in hit],
        )


def _still_holds(made: PlanProvenance, plans: PlanService) -> bool:
    width_matters = any(request.width is None for request in made.requests)
    return made.seen.covers(plans.made.now(), width_matters=width_matters)


def _suppositions(trajectory: Trajectory, made: PlanProvenance | None) -> list[tuple[Request, float]]:
    """Return the suppositions of each stretch of a trajectory, and the time at which it ends, s."""
    if made is None:
        return [(Request(JointGoal(trajectory.end), trajectory.start), trajectory.duration)]
    return list(zip(made.requests, made.passes, strict=True))


def _check_soundness(trajectory: Trajectory, joints: int) -> None:
    """Check shapes, finite numbers and rising times. Raises Failure(safety.trajectory)."""
    times = trajectory.times
    rows = (trajectory.position, trajectory.velocity, trajectory.acceleration)
    wrong = ""
    if times.ndim != 1 or len(times) < 1 or any(row.shape != (len(times), joints) for row in rows):
        shapes = ", ".join(str(row.shape) for row in rows)
        wrong = f"{times.shape} times do not fit rows of {shapes}; {joints} joints are wanted"
    elif not all(bool(np.isfinite(numbers).all()) for numbers in (times, *rows)):
        wrong = "it holds a number that is not finite"
    elif abs(float(times[0])) > 1e-9 or bool((np.diff(times) <= 0.0).any()):
        wrong = "its times do not rise from 0"
    elif float(np.abs(trajectory.velocity[-1]).max()) > 1e-6:
        wrong = "it does not end at rest"
    if wrong:
        raise Failure(safety.TRAJECTORY, f"the trajectory is refused: {wrong}")


def _between(trajectory: Trajectory) -> tuple[Array, Array, Array, Array]:
    """Return times (k,), and position, velocity, acceleration (k, n) at the samples and between them."""
    c, h = trajectory.polynomials(), np.diff(trajectory.times)
    if not len(h):
        return trajectory.times, trajectory.position, trajectory.velocity, trajectory.acceleration
    times: list[Array] = []
    q: list[Array] = []
    v: list[Array] = []
    a: list[Array] = []
    for share in SAMPLE_SHARES:
        u = (share * h)[:, None]
        times.append(trajectory.times[:-1] + share * h)
        q.append(c[:, 0] + u * (c[:, 1] + u * (c[:, 2] + u * (c[:, 3] + u * (c[:, 4] + u * c[:, 5])))))
        v.append(c[:, 1] + u * (2 * c[:, 2] + u * (3 * c[:, 3] + u * (4 * c[:, 4] + u * 5 * c[:, 5]))))
        a.append(2 * c[:, 2] + u * (6 * c[:, 3] + u * (12 * c[:, 4] + u * 20 * c[:, 5])))
    return np.concatenate(times), np.concatenate(q), np.concatenate(v), np.concatenate(a)


def _side(workspace: Bounds, tool: Array) -> str:
    """Return the side of the workspace that a point (3,) is beyond, in words."""
    x, y, z = tool.tolist()
    excess = workspace_excess(workspace, (x, y, z))
    return "" if excess is None else f" ({excess.side})"


def _time_of(trajectory: Trajectory, q: Array) -> float:
    """Return the time at which a trajectory is nearest to a configuration (n,), s."""
    return float(trajectory.times[int(np.abs(trajectory.position - q).max(axis=1).argmin())])


def _time_share(at: float, trajectory: Trajectory) -> float:
    return at / max(trajectory.duration, 1e-9)


def _time_words(at: float, trajectory: Trajectory) -> str:
    return f"after {at:.2f} s, {_time_share(at, trajectory) * 100:.0f} % of the way"


class JogCollisionCheck:
    """Collision check of the next configurations of a moving arm, in the present belief.

    Contacts that exist already may be left. The checks are not charged, because they run while the arm moves.
    The caller expects their answer a tick late (2,000 checks take a tick of 0.05 s).
    """

    def __init__(self, plans: PlanService) -> None:
        self._plans = plans

    def __call__(self, path: Array) -> tuple[str, ...]:
        """Return the pairs that touch on configurations (k, n) and halfway between them, as `panda_hand at
        table`; (): it is free."""
        solver = self._plans.solver
        solver.look()
        collision = solver.collision
        between = (path[:-1] + path[1:]) / 2
        way = StartTolerance(collision, path[0])
        for q in np.concatenate([path[1:], between]):
            if not way.free(q):
                return _names(collision.contacts(q), way.excused)
        return ()


def _names(contacts: tuple[ContactPair, ...], excused: tuple[ContactPair, ...]) -> tuple[str, ...]:
    """Return the touching pairs as `panda_hand at table`, without those that were near each other
    already."""
    left = {(c.a, c.b): c.distance for c in excused}
    met = [c for c in contacts if c.distance < left.get((c.a, c.b), 1.0)]
    return tuple(dict.fromkeys(f"{c.a} at {c.b}" for c in met)) or ("the edge of the workspace",)
