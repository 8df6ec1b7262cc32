"""The one safety monitor: it looks at every control period, and its stop is latched."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..causes import Cause, FailureReport, control, safety
from ..journal import Happened, Journal, Plain
from ..robot.model import RobotModel
from ..scene.description import Limits
from ..values import Array, JointState, Vector3

TRACKING = 0.05
"""Greatest deviation of a joint from its command, rad."""
JOINT_TOLERANCE = 0.01
"""Beyond a soft limit, rad."""
SPEED_TOLERANCE = 1.15
"""Share of a joint's speed limit."""
SMOOTHING = 0.0375
"""Time constant of the force's mean, s. A rigid contact at 0.1 m/s hits with 500 N for one control period
even when the arm gives way at once; what counts is what stays."""


@dataclass(frozen=True, slots=True)
class MonitorState:
    """The monitor between two control periods."""

    stopped: FailureReport | None
    stops: int
    tolerated: tuple[tuple[str, float], ...]
    """Violations that were acknowledged and still stand: cause and level."""
    levels: tuple[tuple[str, float], ...]
    """Violations that stand now."""
    felt: Vector3


FORCE_SLACK, TOOL_SLACK, JOINT_SLACK = 5.0, 0.005, 0.01
"""By how much an acknowledged violation may grow, and must be undercut to be over: N, m, rad and rad/s."""


class SafetyMonitor:
    """Watches force, joints, speed, workspace and tracking. `stopped` says why motion is refused.

    After `acknowledge` a violation that still stands is tolerated as long as it does not grow: the way out
    of it must not trip the same stop.
    """

    def __init__(self, model: RobotModel, limits: Limits, journal: Journal) -> None:
        self._names = model.description.joints
        self._limits = limits
        self._journal = journal
        self._middle: Array = (model.lower + model.upper) / 2
        self._allowed: Array = np.stack(
            [
                (model.upper - model.lower) / 2 + JOINT_TOLERANCE,
                model.velocity_limit * SPEED_TOLERANCE,
                np.full(model.n, TRACKING),
            ]
        )
        self._level = np.zeros((3, model.n))
        self._rows = tuple(self._level)
        self._beyond = np.zeros((3, model.n), dtype=np.bool_)
        self._stopped: FailureReport | None = None
        self._tolerated: dict[str, float] = {}
        self._levels: dict[str, float] = {}
        self._forceful = False
        self._felt = [0.0, 0.0, 0.0]
        self._fresh = False
        self.stops = 0
        """Stops since the run began."""

    @property
    def stopped(self) -> FailureReport | None:
        return self._stopped

    @property
    def limits(self) -> Limits:
        """What it enforces of the scene's limits."""
        return self._limits

    def acknowledge(self) -> None:
        """Allow motion again. Only a safe retreat may say this."""
        if self._stopped is not None:
            # What was violated may by now be a hair within: it must not stop the way out by flickering.
            self._tolerated = {self._stopped.cause.name: 0.0, **self._levels}
            self._stopped = None

    def check(self, state: JointState, commanded: Array | None, force: Vector3, period: float) -> bool:
        """One control period; True when a stop was latched by it. `commanded` (n,): where the servo was
        told to be by now, None under torque control. `force`: external, N in the world.
        `period`: since the last, s."""
        felt, share = self._felt, period / (SMOOTHING + period)
        felt[0] += share * (force[0] - felt[0])
        felt[1] += share * (force[1] - felt[1])
        felt[2] += share * (force[2] - felt[2])
        size = math.hypot(*felt)
        if size > self._limits.force:
            self._forceful = True
            self._violated(
                safety.FORCE_LIMIT,
                size,
                FORCE_SLACK,
                f"{size:.0f} N at the wrist, above the limit of {self._limits.force:.0f} N",
                force=[round(c, 3) for c in felt],
                limit=self._limits.force,
            )
        elif self._forceful or self._tolerated:
            self._forceful = False
            self._within(safety.FORCE_LIMIT, self._limits.force - size, FORCE_SLACK)
        level, (position, velocity, deviation) = self._level, self._rows
        np.subtract(state.position, self._middle, position)
        np.copyto(velocity, state.velocity)
        np.subtract(state.position, state.position if commanded is None else commanded, deviation)
        np.abs(level, level)
        if (
            np.count_nonzero(np.greater(level, self._allowed, self._beyond))
            or self._levels
            or self._tolerated
        ):
            self._check_joints(level - self._allowed, state)
        return self._new_stop()

    def check_tool(self, position: Vector3) -> bool:
        """The TCP against the workspace; True when a stop was latched."""
        outside = max(
            max(lo - p, p - hi)
            for lo, p, hi in zip(
                self._limits.workspace.min, position, self._limits.workspace.max, strict=True
            )
        )
        if outside > 0.0:
            at = ", ".join(f"{p:.3f}" for p in position)
            self._violated(
                safety.WORKSPACE,
                outside,
                TOOL_SLACK,
                f"the tool is {outside * 1000:.0f} mm outside the workspace, at ({at})",
                position=list(position),
            )
        elif self._levels or self._tolerated:
            self._within(safety.WORKSPACE, -outside, TOOL_SLACK)
        return self._new_stop()

    def _check_joints(self, beyond: Array, state: JointState) -> None:
        """`beyond` (3, n): position, speed and tracking error above what is allowed."""
        for cause, row in zip(
            (safety.JOINT_LIMIT, safety.SPEED_LIMIT, control.TRACKING), beyond, strict=True
        ):
            k = int(row.argmax())
            worst = float(row[k])
            if worst <= 0.0:
                self._within(cause, -worst, JOINT_SLACK)
                continue
            joint = self._names[k]
            if cause is safety.JOINT_LIMIT:
                message = f"{joint} is {worst + JOINT_TOLERANCE:.3f} rad beyond its limit"
            elif cause is safety.SPEED_LIMIT:
                message = f"{joint} moves at {float(state.velocity[k]):.2f} rad/s"
            else:
                message = f"{joint} is {worst + TRACKING:.3f} rad from where it was told to be"
            self._violated(
                cause,
                worst,
                JOINT_SLACK,
                message,
                joint=joint,
                position=float(state.position[k]),
                speed=float(state.velocity[k]),
            )

    def state(self) -> MonitorState:
        return MonitorState(
            self._stopped,
            self.stops,
            tuple(self._tolerated.items()),
            tuple(self._levels.items()),
            (self._felt[0], self._felt[1], self._felt[2]),
        )

    def restore(self, saved: MonitorState) -> None:
        self._stopped, self.stops = saved.stopped, saved.stops
        self._tolerated, self._levels = dict(saved.tolerated), dict(saved.levels)
        self._felt = list(saved.felt)
        self._forceful = safety.FORCE_LIMIT.name in self._levels
        self._fresh = False

    def _new_stop(self) -> bool:
        fresh, self._fresh = self._fresh, False
        return fresh

    def _within(self, cause: Cause, room: float, slack: float) -> None:
        """No violation, by `room`; what was tolerated is so no longer once that is more than `slack`."""
        self._levels.pop(cause.name, None)
        if room > slack:
            self._tolerated.pop(cause.name, None)

    def _violated(
        self, cause: Cause, level: float, slack: float, message: str, **evidence: str | float | list[float]
    ) -> None:
        self._levels[cause.name] = level
        if self._stopped is not None:
            return
        tolerated = self._tolerated.get(cause.name)
        if tolerated is not None and level <= tolerated + slack:
            self._tolerated[cause.name] = min(tolerated, level)
            return
        self._stopped = FailureReport(cause, message, evidence)
        self._tolerated.clear()
        self.stops += 1
        self._fresh = True
        data: dict[str, Plain] = {"cause": cause.name}
        for key, value in evidence.items():
            data[key] = [*value] if isinstance(value, list) else value
        self._journal.note(Happened("safety_stop", message, data=data))
