"""Devices of the robot (arm, gripper, wrist sensor) behind the protocols, over the simulated robot body."""

from __future__ import annotations

import numpy as np

from picktree.simulation import DeviceFaults, RobotSensorNoise, checkpoints
from picktree.world import Array, GripperCommand, GripperState, JointState, Wrench

from .engine import EVERYDAY_STEP_RATE, RESOLUTION
from .robot_body import RobotBody, finite

EVERYDAY_PERIOD = 1 / EVERYDAY_STEP_RATE
"""Everyday physics step and control period, s; in contact both are shorter."""
EVERYDAY_UNITS = RESOLUTION // EVERYDAY_STEP_RATE
"""Everyday step in units of 1/`engine.RESOLUTION` s."""


class IdealSensors:
    """Ideal sensor readings of the last step; `protocols.Clock` as well."""

    def __init__(self, noise: RobotSensorNoise, reading: checkpoints.RobotReading) -> None:
        self.noise = noise
        self.pace(EVERYDAY_STEP_RATE)
        self.start(0, 0, reading)

    def pace(self, rate: int) -> None:
        """Set the step rate, Hz."""
        self.rate = rate
        self.period = 1 / rate
        """Length of a step, s."""
        self._units = RESOLUTION // rate

    def start(self, step: int, time: int, reading: checkpoints.RobotReading) -> None:
        """Continue after that number of steps, at a time in units of 1/`engine.RESOLUTION` s."""
        self.step = step
        """Number of steps so far, of any length."""
        self.time = time
        """Time since time 0, in units of 1/`engine.RESOLUTION` s."""
        self.now = time / RESOLUTION
        """Simulated time since time 0, s."""
        self.reading = reading

    def stepped(self, reading: checkpoints.RobotReading) -> bool:
        """Record a step; return whether an everyday step has ended with it."""
        before = self.time
        self.step += 1
        self.time = time = before + self._units
        self.now = time / RESOLUTION
        self.reading = reading
        return time // EVERYDAY_UNITS > before // EVERYDAY_UNITS

    @property
    def everyday_steps(self) -> int:
        """Number of everyday steps in the time so far."""
        return self.time * EVERYDAY_STEP_RATE // RESOLUTION


class PhysicsArm:
    """`protocols.Arm` of the physics backend."""

    def __init__(self, senses: IdealSensors, body: RobotBody, faults: DeviceFaults) -> None:
        self._senses = senses
        self._body = body
        self._faults = faults
        self._shape = (len(body.description.joints),)

    @property
    def mode(self) -> str:
        """Mode of the last command: `follow`, by the servo, or `torque`."""
        return self._body.command.mode

    def read(self) -> JointState:
        senses, n = self._senses, self._shape[0]
        reading = senses.reading
        moving = np.array(reading.position[:n] + reading.velocity[:n])
        moving += senses.noise.encoders(senses.step)
        return JointState(moving[:n], moving[n:], np.array(reading.effort[:n]))

    def follow(self, position: Array, velocity: Array, ahead: tuple[Array, ...] = ()) -> None:
        if self._faults.stalled:
            return
        self._body.follow(
            finite(position, "arm position", self._shape), finite(velocity, "arm velocity", self._shape)
        )

    def apply_torque(self, torque: Array) -> None:
        if self._faults.stalled:
            return
        self._body.apply_torque(finite(torque, "arm torque", self._shape))


class PhysicsGripper:
    """`protocols.Gripper` of the physics backend."""

    def __init__(self, senses: IdealSensors, body: RobotBody) -> None:
        self._senses = senses
        self._body = body
        self._arm_joints = len(body.description.joints)

    def read(self) -> GripperState:
        reading, fingers, n = self._senses.reading, self._body.fingers, self._arm_joints
        position = reading.position[n:]
        width = fingers.width(position) + self._senses.noise.width(self._senses.step)
        force = fingers.force(position, reading.effort[n:])
        return GripperState(width, fingers.rate(position, reading.velocity[n:]), force)

    def command(self, command: GripperCommand) -> None:
        if command != self._body.grip:
            self._body.drive_fingers(command)


class PhysicsWrench:
    """`protocols.WrenchSensor` of the physics backend."""

    def __init__(self, senses: IdealSensors, faults: DeviceFaults) -> None:
        self._senses = senses
        self._faults = faults

    @property
    def stamp(self) -> float:
        """Time of the last new reading, s."""
        silence = self._faults.silence
        return self._senses.now if silence is None else silence.since

    def read(self) -> Wrench:
        senses, faults = self._senses, self._faults
        if faults.silence is not None:
            return faults.silence.wrench
        a, b, c, d, e, f = senses.noise.wrench(senses.step, senses.now, senses.reading.turn)
        fx, fy, fz, tx, ty, tz = senses.reading.wrench
        if faults.biased:
            more = faults.wrench_bias(senses.reading.turn)
            a, b, c, d, e, f = (one + other for one, other in zip((a, b, c, d, e, f), more, strict=True))
        return Wrench((fx + a, fy + b, fz + c), (tx + d, ty + e, tz + f))
