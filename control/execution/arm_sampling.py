"""Sampling of the arm: encoders and wrist sensor in each control period, and the time at rest."""

from __future__ import annotations

from ...robots.model import RobotModel
from ...world.protocols import Hardware
from ...world.values import Array, JointState
from ..wrist.wrist_wrench import WristWrench

REST_SPEED = 0.02
"""Speed over all joints below which the arm counts as standing, rad/s."""


class ArmSampler:
    """Reader of encoders and wrist sensor, once in each control period."""

    def __init__(self, hardware: Hardware, model: RobotModel) -> None:
        self._hardware = hardware
        self._arm = hardware.arm
        self.wrist = WristWrench(hardware.wrench, model, hardware.clock)
        self.state: JointState = self._arm.read()
        """Last encoder reading."""
        self.standing = 0
        """Number of control periods for which the held arm has stood still."""
        self._velocity: Array = self.state.velocity

    def sample(self, held: bool) -> JointState:
        """Read all sensors, and return the encoder reading. `held`: no motion runs."""
        self._velocity = self.state.velocity
        self.state = state = self._arm.read()
        self.wrist.sample()
        v = state.velocity
        # The slow end of a motion does not count: the wrist still feels the braking.
        self.standing = self.standing + 1 if held and float(v @ v) < REST_SPEED * REST_SPEED else 0
        return state

    def rested(self, time: float) -> bool:
        """Whether the arm has stood still for `time` s."""
        return self.standing * self._hardware.period >= time - 1e-9

    @property
    def acceleration(self) -> Array:
        """Joint accelerations (n,) over the last control period, rad/s²."""
        return (self.state.velocity - self._velocity) / self._hardware.period

    def restore(self, standing: int) -> None:
        """Read the encoders of restored hardware; the arm has stood still for `standing` periods."""
        self.state, self.standing = self._arm.read(), standing
        self._velocity = self.state.velocity
