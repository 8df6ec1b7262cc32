"""The one safety monitor: it looks at every control period, and its stop is latched."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...robots.model import RobotModel
from ...world.causes import FailureReport, control, safety
from ...world.journal import Journal, JournalEvent
from ...world.protocols import SensorStamps
from ...world.scene.description import SafetyLimits
from ...world.values import Array, JointState, Vector3
from .sensor_silence import STALE, check_silence
from .stop_latch import Latch, LatchState

TRACKING = 0.05
"""Greatest deviation of a joint from its command, rad."""
JOINT_TOLERANCE = 0.01
"""Beyond a soft limit, rad."""
SPEED_TOLERANCE = 1.15
"""Share of a joint's speed limit."""
SMOOTHING = 0.0375
"""Time constant of the force's mean, s. A rigid contact at 0.1 m/s hits with 500 N for one control period
even when the arm gives way at once; what counts is what stays."""
OVERLOAD = 0.95
"""Share of its torque limit from which a joint is overloaded. Plans take at most 0.7 of it; measured over
sorts, insertions and pushes: 0.83 for some milliseconds."""
OVERLOAD_TIME = 0.5
"""So long a joint may be overloaded, s. Peaks heat no motor, and a joint that brakes from full speed gives
all that it has for up to 0.48 s."""
UNEXPLAINED = 0.15
"""Share of its torque limit by which a joint's effort may differ from what is explained. Measured over sorts,
insertions and pushes: up to 0.06."""
UNEXPLAINED_TIME = 0.1
"""Time constant of the mean of what is not explained, s."""
LOAD_TOLERANCE = 0.1
"""By which the hand may seem to carry more than it may, kg: what the wrist weighs at rest is off by up to
half of that."""
BLIND = 0.5
"""Share of the joints' speed limits that a retreat keeps to while the wrist sensor is silent."""

FORCE_SLACK, TOOL_SLACK, JOINT_SLACK = 5.0, 0.005, 0.01
"""By how much an acknowledged violation may grow, and must be undercut to be over: N, m, rad and rad/s."""
TORQUE_SLACK, MASS_SLACK = 0.1, 0.1
"""The same of efforts, as a share of the joint's limit, and of what is carried, kg."""

OVERLOADED = safety.TORQUE_LIMIT.name


@dataclass(frozen=True, slots=True)
class MonitorState:
    """The monitor between two control periods."""

    stopped: FailureReport | None
    stops: int
    tolerated: tuple[tuple[str, float], ...]
    """Violations that were acknowledged and still stand: what, and its level."""
    levels: tuple[tuple[str, float], ...]
    """Violations that stand now."""
    felt: Vector3
    retreats: str = ""
    """Who acknowledged."""
    standing: tuple[tuple[str, FailureReport], ...] = ()
    """What the violations that stand would be reported as."""
    latched: str = ""
    """The violation that latched the stop."""
    overloaded: tuple[float, ...] = ()
    """How long each joint is overloaded by now, s."""
    unexplained: tuple[float, ...] = ()
    """Mean effort of each joint that nothing explains, as a share of its limit."""


class SafetyMonitor:
    """Watches force, joints, speed, torques, workspace, tracking, load and sensors, and that whoever moves
    the arm looks after it. `stopped` says why motion is refused.

    After `acknowledge` a violation that still stands is tolerated as long as it does not grow, for whoever
    acknowledged it: the way out of it must not trip the same stop. For the next who moves the arm it stops
    again. Encoders that are silent cannot be acknowledged: nobody knows where the arm is.
    """

    def __init__(self, model: RobotModel, limits: SafetyLimits, journal: Journal) -> None:
        self._names = model.description.joints
        self._limits = limits
        self._latch = Latch(journal)
        self._journal = journal
        self._middle: Array = (model.lower + model.upper) / 2
        self._torque_limit = model.torque_limit
        self._speed: Array = model.velocity_limit * SPEED_TOLERANCE
        self._allowed: Array = np.stack(
            [
                (model.upper - model.lower) / 2 + JOINT_TOLERANCE,
                self._speed,
                np.full(model.n, TRACKING),
                model.torque_limit * OVERLOAD,
            ]
        )
        self.most_load = payload_limit(model, limits)
        """What the hand may carry, kg; infinite where nobody says."""
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
        """Stops since the run began."""
        return self._latch.stops

    @property
    def limits(self) -> SafetyLimits:
        """What it enforces of the scene's limits."""
        return self._limits

    @property
    def blind(self) -> bool:
        """Whether the wrist sensor is silent: nothing that needs it may begin."""
        return self._latch.stands(f"{STALE}/wrench")

    @property
    def pressed(self) -> bool:
        """Whether the wrist feels more than it may now, acknowledged or not."""
        return self._forceful

    def acknowledge(self, by: str = "") -> bool:
        """Allow motion again; False when it cannot be. Only a safe retreat may say this, with its path `by`:
        what still stands is tolerated for its own motions alone."""
        if self._latch.stands(f"{STALE}/joints"):
            return False
        self._latch.acknowledge(by)
        self._allowed[1] = self._speed * (BLIND if self.blind else 1.0)
        return True

    def moves(self, owner: str) -> None:
        """That one begins to move the arm: what is tolerated for another stops it at once."""
        self._latch.within(safety.WATCHDOG.name, 1.0, 0.0)
        self._latch.moves(owner)

    def age_of_joints(self, age: Callable[[], float]) -> None:
        """Who says how old the encoders' reading is, s."""
        self._joints_age = age

    def note(self, event: JournalEvent) -> None:
        """For the control loop: tell the journal."""
        self._journal.note(event)

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
        np.copyto(velocity, state.velocity)
        np.subtract(state.position, state.position if commanded is None else commanded, deviation)
        np.copyto(effort, state.effort)
        np.abs(level, level)
        if np.count_nonzero(np.greater(level, self._allowed, self._beyond)) or self._latch.busy:
            self._check_joints(level - self._allowed, state, period)
        return self._latch.take_fresh()

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
            self._latch.violated(
                safety.WORKSPACE.name,
                safety.WORKSPACE,
                outside,
                TOOL_SLACK,
                f"the tool is {outside * 1000:.0f} mm outside the workspace, at ({at})",
                position=list(position),
            )
        elif self._latch.busy:
            self._latch.within(safety.WORKSPACE.name, -outside, TOOL_SLACK)
        return self._latch.take_fresh()

    def check_sensors(self, now: float, stamps: SensorStamps, repeats_since: float | None = None) -> bool:
        """Whether each sensor has spoken lately; True when a stop was latched. `repeats_since`: from when on
        the wrist sensor, which is known to be noisy, says the same numbers bit by bit."""
        if not check_silence(self._latch, now, stamps, repeats_since):
            return False
        if not self.blind:
            self._allowed[1] = self._speed
        return self._latch.take_fresh()

    def overburdened(self, mass: float) -> bool:
        """Whether the hand would carry more than it may with so many kg."""
        return mass > self.most_load + LOAD_TOLERANCE

    def check_load(self, mass: float) -> bool:
        """What the hand carries, kg, as it was weighed; True when a stop was latched."""
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
        """Whether the efforts are, in the mean: `unexplained` (n,) Nm is what is left of them now, `elapsed`
        s after the last time."""
        share = elapsed / (UNEXPLAINED_TIME + elapsed)
        self._unexplained += share * (unexplained / self._torque_limit - self._unexplained)
        left = self._unexplained
        # No single one is greater than all of them together, which is quickly told.
        return float(left @ left) <= UNEXPLAINED**2 or float(np.abs(left).max()) <= UNEXPLAINED

    def check_efforts(self, explained: bool) -> bool:
        """What to make of it when they are not; True when a stop was latched."""
        if explained and not self._latch.busy:
            return False
        name = f"{OVERLOADED}/unexplained"
        k = int(np.abs(self._unexplained).argmax())
        level = abs(float(self._unexplained[k]))
        if not explained:
            torque, limit = float(self._unexplained[k] * self._torque_limit[k]), float(self._torque_limit[k])
            self._latch.violated(
                name,
                safety.TORQUE_LIMIT,
                level - UNEXPLAINED,
                TORQUE_SLACK,
                f"{self._names[k]} exerts {abs(torque):.1f} Nm that neither its motion nor what the wrist "
                f"feels explains, more than {UNEXPLAINED * limit:.1f} Nm",
                joint=self._names[k],
                unexplained=round(torque, 3),
                limit=round(UNEXPLAINED * limit, 3),
            )
        elif self._latch.busy:
            self._latch.within(name, UNEXPLAINED - level, 0.0)
        return self._latch.take_fresh()

    def forget_efforts(self) -> None:
        """The mean begins anew: what disturbed it has been put right."""
        self._unexplained[:] = 0.0

    def unattended(self, owner: str, controller: str, seconds: float) -> None:
        """The arm moves, and whoever commands it gives no sign any more."""
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
        """`beyond` (4, n): position, speed, tracking error and effort above what is allowed."""
        # What the encoders do not say any more tells nothing of where the arm is.
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
                message = f"{joint} is {worst + JOINT_TOLERANCE:.3f} rad beyond its limit"
            elif cause is safety.SPEED_LIMIT:
                message = f"{joint} moves at {float(state.velocity[k]):.2f} rad/s"
            else:
                message = f"{joint} is {worst + TRACKING:.3f} rad from where it was told to be"
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
        name, limit = f"{OVERLOADED}/overload", float(self._torque_limit[k])
        if self._overloaded[k] <= OVERLOAD_TIME:
            self._latch.within(name, -float(beyond.max()) / limit, TORQUE_SLACK)
            return
        effort = float(state.effort[k])
        self._latch.violated(
            name,
            safety.TORQUE_LIMIT,
            float(beyond[k]) / limit,
            TORQUE_SLACK,
            f"{self._names[k]} has exerted {abs(effort):.1f} Nm for {OVERLOAD_TIME:g} s, of {limit:.0f} Nm "
            "that it bears",
            joint=self._names[k],
            effort=round(effort, 3),
            limit=limit,
        )

    def state(self) -> MonitorState:
        latch = self._latch.state()
        return MonitorState(
            latch.stopped,
            latch.stops,
            latch.tolerated,
            latch.levels,
            (self._felt[0], self._felt[1], self._felt[2]),
            latch.retreats,
            latch.standing,
            latch.latched,
            tuple(self._overloaded.tolist()),
            tuple(self._unexplained.tolist()),
        )

    def restore(self, saved: MonitorState) -> None:
        self._latch.restore(
            LatchState(
                saved.stopped,
                saved.stops,
                saved.tolerated,
                saved.levels,
                saved.retreats,
                saved.standing,
                saved.latched,
            )
        )
        self._felt = list(saved.felt)
        self._forceful = self._latch.stands(safety.FORCE_LIMIT.name)
        n = len(self._names)
        self._overloaded = np.array(saved.overloaded or [0.0] * n)
        self._unexplained = np.array(saved.unexplained or [0.0] * n)
        slow = self.blind and self._latch.tolerates(f"{STALE}/wrench")
        self._allowed[1] = self._speed * (BLIND if slow else 1.0)


def payload_limit(model: RobotModel, limits: SafetyLimits) -> float:
    """What the hand may carry, kg: what the rated payload leaves beside the hand, or less in this scene."""
    rated = model.description.payload
    left = math.inf if rated is None else max(0.0, rated - model.hand_mass)
    return left if limits.payload is None else min(left, limits.payload)
