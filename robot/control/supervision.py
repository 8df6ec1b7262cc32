"""Supervision of the arm: the checks of each control period, the rarer ones, and the watchdog of motions."""

from __future__ import annotations

import math

import numpy as np

from ...world.causes import control, safety
from ...world.protocols import Hardware
from ...world.robot_model.model import RobotModel
from ...world.values import GRAVITY, Array, JointState, Vector3
from .arm_drive import ArmSampler
from .bias_estimation import WRIST_WINDOW, BiasEstimator
from .external_torque import MIN_EXPLAINED_SHARE
from .safety_monitor import SafetyMonitor
from .wrist_wrench import MAX_QUIET_DEVIATION

TOOL_CHECK_PERIODS = 4
"""Control periods between two checks of the TCP against the workspace."""
TOUCH_FORCE = 20.0
"""Force above which the wrist counts as touched, not only loaded, N."""
REST_TIME = 0.1
"""Time at rest before a tare or a load is read, s."""
EFFORT_CHECK_TIME = 0.05
"""Time between two checks of the joints' efforts, s. One check costs as much as a control step by itself."""
MAX_UNATTENDED_MOTION = 0.2
"""Longest motion without attention of its holder, s: four ticks. A jog and a motion that was handed over
brake by themselves before."""


class Watchdog:
    """Timer of the motion without attention. The holder of the lease restarts it in each tick."""

    def __init__(self) -> None:
        self.attended = False
        """Whether the holder has attended to its motion since the last tick."""
        self._alone = 0.0

    def expired(self, tick: float, moving: bool) -> bool:
        """Count a tick of `tick` s, and return whether the arm has moved unattended for too long."""
        self._alone = 0.0 if self.attended or not moving else self._alone + tick
        self.attended = False
        return self._alone > MAX_UNATTENDED_MOTION

    def restart(self) -> float:
        """Set the timer to zero, and return the time that it had counted, s."""
        alone, self._alone = self._alone, 0.0
        return alone


class Supervision:
    """Supervisor of what the sensors read: it reports to the safety monitor, whose stop is latched."""

    def __init__(
        self,
        hardware: Hardware,
        model: RobotModel,
        monitor: SafetyMonitor,
        sampler: ArmSampler,
        bias: BiasEstimator,
    ) -> None:
        self._hardware, self._clock = hardware, hardware.clock
        self._model, self._monitor = model, monitor
        self._sampler, self._wrist = sampler, sampler.wrist
        self._bias = bias
        self.periods = 0
        """Number of control periods since the run began."""
        self._looked = self._clock.now
        """Time of the last check of the efforts, simulated s."""
        monitor.age_of_joints(lambda: self._clock.now - hardware.stamps.joints)

    def check(self, state: JointState, commanded: Array | None, force: Vector3, period: float) -> bool:
        """Check one control period, and return whether a stop was latched; see `SafetyMonitor.check`."""
        stopped = self._monitor.check(state, commanded, force, period)
        self.periods += 1
        if self.periods % TOOL_CHECK_PERIODS == 0:
            stopped = self._check_rarely(state) or stopped
        return stopped

    def off_its_way(self) -> bool:
        """Whether the stop just latched is a tracking error, a force or a torque: braking on the path would
        prolong it."""
        stop = self._monitor.stopped
        return stop is not None and stop.cause in (control.TRACKING, safety.FORCE_LIMIT, safety.TORQUE_LIMIT)

    def pushed(self, force: Vector3) -> bool:
        """Return whether something pushes the arm: `force`, N, at the wrist, or efforts that nothing
        explains."""
        return math.hypot(*force) > TOUCH_FORCE or self._monitor.pushed

    def restore(self, periods: int) -> None:
        """Continue from a checkpoint that was taken after `periods` control periods."""
        self.periods, self._looked = periods, self._clock.now

    def _check_rarely(self, state: JointState) -> bool:
        """Run the checks that are not needed in each period, and return whether a stop was latched."""
        monitor, wrist, now = self._monitor, self._wrist, self._clock.now
        tool = self._sampler.tcp
        wrist.turned(tool)
        stopped = monitor.check_tool(tool.position)
        stopped = monitor.check_sensors(now, self._hardware.stamps, wrist.repeats_since) or stopped
        if self._sampler.standing * self._hardware.period >= REST_TIME:
            stopped = self._check_load(state) or stopped
        elapsed = now - self._looked
        if elapsed >= EFFORT_CHECK_TIME - 1e-9:
            self._looked = now
            if self._hardware.feels_effort:
                stopped = self._check_efforts(state, self._sampler.acceleration, elapsed) or stopped
        return stopped

    def _check_load(self, state: JointState) -> bool:
        """Check the payload at rest, and return whether a stop was latched. A bias that has jumped is learnt
        first."""
        mass = -self._wrist.force[2] / GRAVITY
        doubtful = self._monitor.overburdened(mass) and self._hardware.feels_effort
        if doubtful and (self._wrist.unrest(WRIST_WINDOW) > MAX_QUIET_DEVIATION or self._bias.learn(state)):
            return False
        return self._monitor.check_load(mass)

    def _check_efforts(self, state: JointState, acceleration: Array, elapsed: float) -> bool:
        monitor, bias = self._monitor, self._bias
        if monitor.blind:
            # A retreat is slow: the hand's inertial force is small against the limit.
            left = self._without_wrist(state, acceleration)
            return monitor.check_efforts(monitor.explained(left, elapsed))
        turn = self._sampler.tcp.rotation()
        left = bias.efforts.unexplained(state, acceleration, self._wrist.unbiased(turn))
        explained = monitor.explained(left, elapsed)
        if not explained and self._fits_without_wrist(state, acceleration, left):
            bias.doubtful = explained = True
        return monitor.check_efforts(explained)

    def _without_wrist(self, state: JointState, acceleration: Array) -> Array:
        """Return the unexplained efforts (n,), Nm, if nothing but the payload acts on the hand."""
        return self._bias.efforts.without_wrist(state, acceleration, self._bias.known_load(state))

    def _fits_without_wrist(self, state: JointState, acceleration: Array, left: Array) -> bool:
        """Return whether the efforts fit better without the wrist reading: then the wrist sensor is wrong."""
        otherwise = self._without_wrist(state, acceleration)
        limit = self._model.torque_limit
        return float(np.linalg.norm(otherwise / limit)) < MIN_EXPLAINED_SHARE * float(
            np.linalg.norm(left / limit)
        )
