"""Safety monitor: the one check of every control period; its stop is latched until it is acknowledged.

Persisting violations are then tolerated for the retreat alone. A sensor that gives no new reading is a
violation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from picktree.world import (
    Array,
    Cause,
    FailureReport,
    JointState,
    Journal,
    JournalEvent,
    SensorStamps,
    Vector3,
    control,
    event_types,
    safety,
    workspace_excess,
)
from picktree.world.robot_model import RobotModel, joint_excesses
from picktree.world.scene import SafetyLimits


@dataclass(frozen=True, slots=True)
class LatchState:
    """State of the latch between two control periods."""

    stopped: FailureReport | None
    stops: int
    tolerated: tuple[tuple[str, float], ...]
    """Violations that were acknowledged and persist: name and level."""
    levels: tuple[tuple[str, float], ...]
    """Violations that persist: name and level."""
    retreats: str = ""
    """Node path of the retreat that acknowledged. Violations are tolerated for its motions alone."""
    standing: tuple[tuple[str, FailureReport], ...] = ()
    """Failure report of each persisting violation."""
    latched: str = ""
    """Name of the violation that latched the stop."""


class Latch:
    """Latch of safety stops. Each violation has a name and a level: the excess over its limit.

    `violated` reports a violation, `within` its end. The first one latches the stop. After acknowledgement a
    persisting violation is tolerated as long as it does not grow; otherwise the way out would trip the same
    stop. It is tolerated only while the acknowledging retreat moves the arm (`moves`).
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self.stopped: FailureReport | None = None
        self.stops = 0
        """Number of stops since the run began."""
        self._tolerated: dict[str, float] = {}
        self._levels: dict[str, float] = {}
        self._standing: dict[str, FailureReport] = {}
        self._retreats = ""
        self._latched = ""
        self._fresh = False

    @property
    def busy(self) -> bool:
        """Whether a violation persists or is tolerated."""
        return bool(self._levels or self._tolerated)

    def is_violated(self, name: str) -> bool:
        """Return whether `name` is violated now, tolerated or not."""
        return name in self._levels

    def tolerates(self, name: str) -> bool:
        return name in self._tolerated

    def acknowledge(self, by: str) -> None:
        """Allow motion again: for the node path `by` in spite of persisting violations."""
        if self.stopped is not None:
            # The violation may be just within its limit by now, and must not stop the retreat by flickering.
            self._tolerated = {self._latched or self.stopped.cause.name: 0.0, **self._levels}
            self._retreats = by
            self.stopped = None

    def moves(self, owner: str) -> None:
        """Register that `owner` begins to move the arm. Violations tolerated for another owner stop it."""
        if not self._tolerated or owner == self._retreats:
            return
        self._tolerated.clear()
        for name, report in self._standing.items():
            self._latch(name, report)

    def take_fresh(self) -> bool:
        """Return whether a stop was latched since the last call."""
        fresh, self._fresh = self._fresh, False
        return fresh

    def within(self, name: str, room: float, slack: float) -> None:
        """Report no violation, with a margin of `room`. Tolerance ends when the margin exceeds `slack`."""
        if self._levels.pop(name, None) is not None:
            self._standing.pop(name, None)
        if room > slack:
            self._tolerated.pop(name, None)

    def violated(
        self,
        name: str,
        cause: Cause,
        level: float,
        slack: float,
        message: str,
        **evidence: str | float | list[float],
    ) -> None:
        self._levels[name] = level
        report = self._standing[name] = FailureReport(cause, message, evidence)
        tolerated = self._tolerated.get(name)
        if tolerated is not None and level <= tolerated + slack:
            self._tolerated[name] = min(tolerated, level)
            return
        self._latch(name, report)

    def _latch(self, name: str, report: FailureReport) -> None:
        if self.stopped is not None:
            return
        self.stopped, self._latched = report, name
        self._tolerated.clear()
        self.stops += 1
        self._fresh = True
        cause, evidence = report.cause.name, dict(report.evidence)
        self._journal.note(event_types.SafetyStopEvent(report.message, cause=cause, extra=evidence))

    def state(self) -> LatchState:
        return LatchState(
            self.stopped,
            self.stops,
            tuple(self._tolerated.items()),
            tuple(self._levels.items()),
            self._retreats,
            tuple(self._standing.items()),
            self._latched,
        )

    def restore(self, saved: LatchState) -> None:
        self.stopped, self.stops = saved.stopped, saved.stops
        self._tolerated, self._levels = dict(saved.tolerated), dict(saved.levels)
        self._standing, self._retreats = dict(saved.standing), saved.retreats
        self._latched = saved.latched
        self._fresh = False


MAX_JOINTS_SILENCE = 0.05
"""Longest silence of the encoders, s. At full speed the arm moves 0.1 rad in that time."""
MAX_WRENCH_SILENCE = 0.1
"""Longest silence of the wrist sensor, s. A guarded move travels 3 to 10 mm in that time."""
MAX_GRIPPER_SILENCE = 0.5
"""Longest silence of the gripper, s. Grippers send their opening some ten times a second; fingers are
slow."""
STALE_SENSOR_NAME = safety.STALE_SENSOR.name
_SENSORS = (
    ("joints", "the encoders of the joints have", MAX_JOINTS_SILENCE),
    ("gripper", "the gripper has", MAX_GRIPPER_SILENCE),
    ("wrench", "the wrist sensor has", MAX_WRENCH_SILENCE),
)


def check_silence(latch: Latch, now: float, stamps: SensorStamps, repeats_since: float | None) -> bool:
    """Report silent sensors at `now`, s, to the latch. Returns False when none is silent and the latch is not
    busy.

    `repeats_since`: time since which the noisy wrist sensor repeats its reading exactly, s. None: it does
    not.
    """
    repeating = repeats_since is not None and now - repeats_since > MAX_WRENCH_SILENCE
    if (
        now - stamps.joints <= MAX_JOINTS_SILENCE
        and now - stamps.wrench <= MAX_WRENCH_SILENCE
        and now - stamps.gripper <= MAX_GRIPPER_SILENCE
        and not repeating
        and not latch.busy
    ):
        return False
    for (sensor, words, longest), stamp in zip(
        _SENSORS, (stamps.joints, stamps.gripper, stamps.wrench), strict=True
    ):
        name, what, since = f"{STALE_SENSOR_NAME}/{sensor}", "given no new reading", stamp
        if sensor == "wrench" and repeating and repeats_since is not None and repeats_since < stamp:
            what, since = "repeated itself bit by bit", repeats_since
        if now - since > longest:
            message = f"{words} {what} since {since:.2f} s"
            latch.violated(
                name, safety.STALE_SENSOR, 1.0, 0.0, message, sensor=sensor, since=since, longest=longest
            )
        elif latch.busy:
            latch.within(name, 1.0, 0.0)
    return True


MAX_TRACKING_ERROR = 0.05
"""Greatest deviation of a joint from its command, rad."""
JOINT_TOLERANCE = 0.01
"""Distance beyond a soft limit at which a joint violates it, rad."""
MAX_SPEED_SHARE = 1.15
"""Greatest speed of a joint, as a share of its speed limit."""
FORCE_TIME_CONSTANT = 0.0375
"""Time constant of the force's mean, s. A rigid contact at 0.1 m/s hits with 500 N for one control period,
even when the arm gives way at once. Only a lasting force counts."""
OVERLOAD_TORQUE_SHARE = 0.95
"""Effort from which a joint is overloaded, as a share of its torque limit. Plans take at most 0.7 of it;
measured over sorts, insertions and pushes: 0.83 for some milliseconds."""
MAX_OVERLOAD_TIME = 0.5
"""Longest overload of a joint, s. Peaks heat no motor, and a joint that brakes from full speed exerts its
full torque for up to 0.48 s."""
MAX_UNEXPLAINED_EFFORT = 0.15
"""Greatest unexplained effort of a joint, as a share of its torque limit. Measured over sorts, insertions and
pushes: up to 0.06."""
UNEXPLAINED_TIME_CONSTANT = 0.1
"""Time constant of the mean of the unexplained effort, s."""
LOAD_TOLERANCE = 0.1
"""Tolerance of the payload limit, kg. The wrist's measurement at rest is off by up to half of that."""
BLIND_SPEED_SHARE = 0.5
"""Joint speeds of a retreat while the wrist sensor is silent, as a share of their limits."""
FORCE_SLACK, TOOL_SLACK, JOINT_SLACK = 5.0, 0.005, 0.01
"""Growth that an acknowledged violation may have, and margin at which it is over: N, m, rad and rad/s."""
TORQUE_SLACK, MASS_SLACK = 0.1, 0.1
"""The same for efforts, as a share of the joint's limit, and for the payload, kg."""
TORQUE_LIMIT_NAME = safety.TORQUE_LIMIT.name
UNEXPLAINED_NAME = f"{TORQUE_LIMIT_NAME}/unexplained"


@dataclass(frozen=True, slots=True, kw_only=True)
class MonitorState(LatchState):
    """State of the monitor between two control periods."""

    felt: Vector3
    """Mean of the force at the wrist, N in the world."""
    overloaded: tuple[float, ...] = ()
    """Duration of each joint's overload, s."""
    unexplained: tuple[float, ...] = ()
    """Mean unexplained effort of each joint, as a share of its torque limit."""


class SafetyMonitor:
    """Monitor of force, joints, speed, torques, workspace, tracking, load, sensors, and attention to motions.

    `stopped` is the reason why motion is refused.

    After `acknowledge` a persisting violation is tolerated as long as it does not grow, for the retreat that
    acknowledged it. Otherwise the way out would trip the same stop. It stops the next owner of a motion
    again. Silent encoders cannot be acknowledged: the arm's configuration is unknown.
    """

    def __init__(self, model: RobotModel, limits: SafetyLimits, journal: Journal) -> None:
        self._model = model
        self._names = model.description.joints
        self._limits = limits
        self._latch = Latch(journal)
        self._journal = journal
        self._middle: Array = (model.lower + model.upper) / 2
        self._torque_limit = model.torque_limit
        self._speed: Array = model.velocity_limit * MAX_SPEED_SHARE
        self._allowed: Array = np.stack(
            [
                (model.upper - model.lower) / 2 + JOINT_TOLERANCE,
                self._speed,
                np.full(model.n, MAX_TRACKING_ERROR),
                model.torque_limit * OVERLOAD_TORQUE_SHARE,
            ]
        )
        self.most_load = payload_limit(model, limits)
        """Greatest payload of the hand, kg; inf: no limit is known."""
        self._level = np.zeros((4, model.n))
        self._rows = tuple(self._level)
        self._beyond = np.zeros((4, model.n), dtype=np.bool_)
        self._overloaded = np.zeros(model.n)
        self._unexplained = np.zeros(model.n)
        self._forceful = False
        self._felt = [0.0, 0.0, 0.0]
        self._joints_age: Callable[[], float] = lambda: 0.0

    @property
    def stopped(self) -> FailureReport | None:
        return self._latch.stopped

    @property
    def stops(self) -> int:
        """Number of stops since the run began."""
        return self._latch.stops

    @property
    def limits(self) -> SafetyLimits:
        """Limits of the scene that the monitor enforces."""
        return self._limits

    @property
    def blind(self) -> bool:
        """Whether the wrist sensor is silent. No motion that needs it may begin."""
        return self._latch.is_violated(f"{STALE_SENSOR_NAME}/wrench")

    @property
    def pressed(self) -> bool:
        """Whether the wrist force is above its limit now, acknowledged or not."""
        return self._forceful

    @property
    def pushed(self) -> bool:
        """Whether the effort of a joint is unexplained now, acknowledged or not."""
        return self._latch.is_violated(UNEXPLAINED_NAME)

    def acknowledge(self, by: str = "") -> bool:
        """Allow motion again, and return False when that is impossible.

        Only a safe retreat may call this, with its node path `by`: persisting violations are tolerated for
        its own motions alone.
        """
        if self._latch.is_violated(f"{STALE_SENSOR_NAME}/joints"):
            return False
        self._latch.acknowledge(by)
        self._allowed[1] = self._speed * (BLIND_SPEED_SHARE if self.blind else 1.0)
        return True

    def moves(self, owner: str) -> None:
        """Register that `owner` begins to move the arm. A violation tolerated for another owner stops it at
        once."""
        self._latch.within(safety.WATCHDOG.name, 1.0, 0.0)
        self._latch.moves(owner)

    def age_of_joints(self, age: Callable[[], float]) -> None:
        """Set the function that returns the age of the encoder reading, s."""
        self._joints_age = age

    def note(self, event: JournalEvent) -> None:
        """Write an event of the control loop to the journal."""
        self._journal.note(event)

    def check(self, state: JointState, commanded: Array | None, force: Vector3, period: float) -> bool:
        """Check one control period, and return whether it latched a stop.

        `commanded` (n,): commanded configuration of the servo, rad; None under torque control. `force`:
        external force, N in the world. `period`: time since the last check, s.
        """
        felt, share = self._felt, period / (FORCE_TIME_CONSTANT + period)
        felt[0] += share * (force[0] - felt[0])
        felt[1] += share * (force[1] - felt[1])
        felt[2] += share * (force[2] - felt[2])
        size = math.hypot(*felt)
        if size > self._limits.force:
            self._forceful = True
            self._latch.violated(
                safety.FORCE_LIMIT.name,
                safety.FORCE_LIMIT,
                size - self._limits.force,
                FORCE_SLACK,
                f"{size:.0f} N at the wrist, above the limit of {self._limits.force:.0f} N",
                force=[round(c, 3) for c in felt],
                limit=self._limits.force,
            )
        elif self._forceful or self._latch.busy:
            self._forceful = False
            self._latch.within(safety.FORCE_LIMIT.name, self._limits.force - size, FORCE_SLACK)
        level, (position, velocity, deviation, effort) = self._level, self._rows
        np.subtract(state.position, self._middle, position)
        velocity[:] = state.velocity
        np.subtract(state.position, state.position if commanded is None else commanded, deviation)
        effort[:] = state.effort
        np.abs(level, level)
        if np.count_nonzero(np.greater(level, self._allowed, self._beyond)) or self._latch.busy:
            self._check_joints(level - self._allowed, state, period)
        return self._latch.take_fresh()

    def check_tool(self, position: Vector3) -> bool:
        """Check the TCP against the workspace, and return whether a stop was latched."""
        outside = max(
            max(lo - p, p - hi)
            for lo, p, hi in zip(
                self._limits.workspace.min, position, self._limits.workspace.max, strict=True
            )
        )
        excess = workspace_excess(self._limits.workspace, position) if outside > 0.0 else None
        if excess is not None:
            self._latch.violated(
                safety.WORKSPACE.name,
                safety.WORKSPACE,
                outside,
                TOOL_SLACK,
                f"the tool is {outside * 1000:.0f} mm outside the workspace: {excess.side}",
                position=list(position),
                axis=excess.axis,
                by=round(excess.by, 6),
            )
        elif self._latch.busy:
            self._latch.within(safety.WORKSPACE.name, -outside, TOOL_SLACK)
        return self._latch.take_fresh()

    def check_sensors(self, now: float, stamps: SensorStamps, repeats_since: float | None = None) -> bool:
        """Check the age of each sensor's reading, and return whether a stop was latched.

        `repeats_since`: time since which the noisy wrist sensor repeats its reading exactly, s. None: it does
        not.
        """
        if not check_silence(self._latch, now, stamps, repeats_since):
            return False
        if not self.blind:
            self._allowed[1] = self._speed
        return self._latch.take_fresh()

    def overburdened(self, mass: float) -> bool:
        """Return whether a payload of `mass` kg is above the limit."""
        return mass > self.most_load + LOAD_TOLERANCE

    def check_load(self, mass: float) -> bool:
        """Check the measured payload, kg, and return whether a stop was latched."""
        name = safety.PAYLOAD.name
        if self.overburdened(mass):
            self._latch.violated(
                name,
                safety.PAYLOAD,
                mass - self.most_load - LOAD_TOLERANCE,
                MASS_SLACK,
                f"the hand carries {mass:.2f} kg, more than the {self.most_load:.2f} kg that it may",
                mass=round(mass, 3),
                limit=round(self.most_load, 3),
            )
        elif self._latch.busy:
            self._latch.within(name, self.most_load + LOAD_TOLERANCE - mass, 0.0)
        return self._latch.take_fresh()

    def explained(self, unexplained: Array, elapsed: float) -> bool:
        """Add unexplained efforts (n,), Nm, to their mean, and return whether the mean is within its limit.

        `elapsed`: time since the last call, s.
        """
        share = elapsed / (UNEXPLAINED_TIME_CONSTANT + elapsed)
        self._unexplained += share * (unexplained / self._torque_limit - self._unexplained)
        left = self._unexplained
        # The norm bounds every element and is computed quickly.
        return (
            float(left @ left) <= MAX_UNEXPLAINED_EFFORT**2
            or float(np.abs(left).max()) <= MAX_UNEXPLAINED_EFFORT
        )

    def check_efforts(self, explained: bool) -> bool:
        """Report the unexplained effort to the latch, and return whether a stop was latched."""
        if explained and not self._latch.busy:
            return False
        name = UNEXPLAINED_NAME
        k = int(np.abs(self._unexplained).argmax())
        level = abs(float(self._unexplained[k]))
        if not explained:
            torque, limit = float(self._unexplained[k] * self._torque_limit[k]), float(self._torque_limit[k])
            self._latch.violated(
                name,
                safety.TORQUE_LIMIT,
                level - MAX_UNEXPLAINED_EFFORT,
                TORQUE_SLACK,
                f"{self._names[k]} exerts {abs(torque):.1f} Nm that neither its motion nor what the wrist "
                f"feels explains, more than {MAX_UNEXPLAINED_EFFORT * limit:.1f} Nm",
                joint=self._names[k],
                unexplained=round(torque, 3),
                limit=round(MAX_UNEXPLAINED_EFFORT * limit, 3),
            )
        elif self._latch.busy:
            self._latch.within(name, MAX_UNEXPLAINED_EFFORT - level, 0.0)
        return self._latch.take_fresh()

    def forget_efforts(self) -> None:
        """Reset the mean of the unexplained efforts, after their cause was removed."""
        self._unexplained[:] = 0.0

    def unattended(self, owner: str, controller: str, seconds: float) -> None:
        """Report that the arm moves while its motion has not been attended for `seconds` s."""
        self._latch.violated(
            safety.WATCHDOG.name,
            safety.WATCHDOG,
            seconds,
            0.0,
            f"{owner or 'somebody'} moves the arm ({controller}), but has not looked after it for "
            f"{seconds:.2f} s",
            owner=owner,
            controller=controller,
            seconds=round(seconds, 3),
        )

    def _check_joints(self, beyond: Array, state: JointState, period: float) -> None:
        """Check rows of `beyond` (4, n): position, speed, tracking error and effort above their limits."""
        # A stale encoder reading says nothing about the present configuration.
        known = self._joints_age() <= 1.5 * period
        for cause, row in zip(
            (safety.JOINT_LIMIT, safety.SPEED_LIMIT, control.TRACKING), beyond[:3], strict=True
        ):
            k = int(row.argmax())
            worst = float(row[k])
            if worst <= 0.0 or not known:
                self._latch.within(cause.name, -worst, JOINT_SLACK)
                continue
            joint = self._names[k]
            if cause is safety.JOINT_LIMIT:
                beyond_limit = joint_excesses(self._model, state.position)
                message = str(next(one for one in beyond_limit if one.joint == joint))
            elif cause is safety.SPEED_LIMIT:
                message = f"{joint} moves at {float(state.velocity[k]):.2f} rad/s"
            else:
                message = f"{joint} is {worst + MAX_TRACKING_ERROR:.3f} rad from where it was told to be"
            self._latch.violated(
                cause.name,
                cause,
                worst,
                JOINT_SLACK,
                message,
                joint=joint,
                position=float(state.position[k]),
                speed=float(state.velocity[k]),
            )
        self._check_overload(beyond[3], state, period)

    def _check_overload(self, beyond: Array, state: JointState, period: float) -> None:
        self._overloaded = np.where(beyond > 0.0, self._overloaded + period, 0.0)
        k = int(self._overloaded.argmax())
        name, limit = f"{TORQUE_LIMIT_NAME}/overload", float(self._torque_limit[k])
        if self._overloaded[k] <= MAX_OVERLOAD_TIME:
            self._latch.within(name, -float(beyond.max()) / limit, TORQUE_SLACK)
            return
        effort = float(state.effort[k])
        self._latch.violated(
            name,
            safety.TORQUE_LIMIT,
            float(beyond[k]) / limit,
            TORQUE_SLACK,
            f"{self._names[k]} has exerted {abs(effort):.1f} Nm for {MAX_OVERLOAD_TIME:g} s, of "
            f"{limit:.0f} Nm "
            "that it bears",
            joint=self._names[k],
            effort=round(effort, 3),
            limit=limit,
        )

    def state(self) -> MonitorState:
        latch = self._latch.state()
        return MonitorState(
            **{field.name: getattr(latch, field.name) for field in fields(latch)},
            felt=(self._felt[0], self._felt[1], self._felt[2]),
            overloaded=tuple(self._overloaded.tolist()),
            unexplained=tuple(self._unexplained.tolist()),
        )

    def restore(self, saved: MonitorState) -> None:
        self._latch.restore(saved)
        self._felt = list(saved.felt)
        self._forceful = self._latch.is_violated(safety.FORCE_LIMIT.name)
        n = len(self._names)
        self._overloaded = np.array(saved.overloaded or [0.0] * n)
        self._unexplained = np.array(saved.unexplained or [0.0] * n)
        slow = self.blind and self._latch.tolerates(f"{STALE_SENSOR_NAME}/wrench")
        self._allowed[1] = self._speed * (BLIND_SPEED_SHARE if slow else 1.0)


def payload_limit(model: RobotModel, limits: SafetyLimits) -> float:
    """Return the greatest payload of the hand, kg: rated payload less the hand's mass, or the scene's lower
    limit."""
    rated = model.description.payload
    left = math.inf if rated is None else max(0.0, rated - model.hand_mass)
    return left if limits.payload is None else min(left, limits.payload)
