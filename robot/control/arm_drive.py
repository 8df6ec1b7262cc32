"""Drive of the arm: the running controller, its commands to the servo, and how a motion is braked."""

from __future__ import annotations

import numpy as np

from ...world.protocols import Hardware
from ...world.robot_model.model import RobotModel
from ...world.values import Array, JointState, Pose
from .commands import Controller, JointCommand
from .contact_reflex import ContactReflex
from .joint_controllers import BrakeController, HoldController
from .wrist_wrench import WristWrench

REST_SPEED = 0.02
"""Speed over all joints below which the arm counts as standing, rad/s."""


class ArmSampler:
    """Reader of encoders and wrist sensor, once in each control period."""

    def __init__(self, hardware: Hardware, model: RobotModel) -> None:
        self._hardware = hardware
        self._arm = hardware.arm
        self._model = model
        self.wrist = WristWrench(hardware.wrench, model, hardware.clock)
        self.state: JointState = self._arm.read()
        """Last encoder reading."""
        self.standing = 0
        """Number of control periods for which the held arm has stood still."""
        self._velocity: Array = self.state.velocity
        self._placed: tuple[JointState, Pose] | None = None

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

    @property
    def tcp(self) -> Pose:
        """TCP pose in the world by the last encoder reading, computed once for each."""
        if self._placed is None or self._placed[0] is not self.state:
            self._placed = (self.state, self._model.tcp(self.state.position))
        return self._placed[1]

    def restore(self, standing: int) -> None:
        """Read the encoders of restored hardware; the arm has stood still for `standing` periods."""
        self.state, self.standing = self._arm.read(), standing
        self._velocity = self.state.velocity


MAX_HOLD_ERROR = 0.01
"""Joint error at the end of a motion above which the arm holds its actual configuration, rad. The obstruction
may give way at any time."""


class ArmDrive:
    """Executor of one controller at a time. At the end of each motion it holds the arm by itself."""

    def __init__(self, hardware: Hardware, model: RobotModel, state: JointState) -> None:
        """Hold the arm where it stands; `state` is the encoder reading."""
        self._hardware, self._model = hardware, model
        self._arm, self._clock = hardware.arm, hardware.clock
        self.servo = True
        """Whether the last command was a set-point of the servo, not a torque."""
        self.setpoint = JointCommand(state.position.copy(), np.zeros(model.n))
        """Last command of the servo."""
        self.braking = False
        """Whether the motion was stopped or its lease returned, and nothing has begun since."""
        self.carried = np.zeros(6)
        """Wrench (6,) of the payload when the motion began, world axes, N and Nm."""
        self.begin(HoldController(), state)

    def begin(self, controller: Controller, state: JointState) -> None:
        """Let `controller` command the arm from the next control period on."""
        if not self.servo:
            self.setpoint = JointCommand(state.position.copy(), state.velocity.copy())
        self.controller = controller
        self.held = isinstance(controller, HoldController)
        controller.start(self._clock.now, state, self.setpoint)

    @property
    def reference(self) -> Array | None:
        """Configuration (n,) that the servo was commanded, rad; None under torque control."""
        return self.setpoint.position if self.servo else None

    def command(self, state: JointState) -> None:
        """Send the controller's command for one control period; after its last one, hold or brake."""
        controller = self.controller
        command = controller.update(self._clock.now, state)
        if isinstance(command, JointCommand):
            self.setpoint = command
            self.servo = True
            self._arm.follow(command.position, command.velocity)
        else:
            self.servo = False
            self._arm.apply_torque(command.torque)
        if controller.done:
            self.begin(HoldController() if self.servo else self._brake_controller(), state)

    def brake(self, state: JointState) -> None:
        """Bring the motion to rest on its path, or where the arm stands when it stands off the set-point."""
        self.braking = True
        if self._stands_beside(state):
            self.servo = False
            self.begin(self._brake_controller(), state)
            return
        braking = self.controller.brake()
        if braking is not self.controller:
            self.begin(braking, state)

    def stop_at_once(self, state: JointState, *, pushed: bool) -> None:
        """Stop from the present state: comply when something has `pushed` the arm, else brake each joint as
        fast as it can."""
        self.braking = True
        self.servo = False
        if pushed:
            self.begin(ContactReflex(self._model, self._hardware.period, self.carried), state)
        else:
            self.begin(self._brake_controller(), state)

    def restore(self, hold: Array, state: JointState, carried: Array) -> None:
        """Hold the configuration `hold` (n,), rad, after a checkpoint was restored."""
        self.setpoint = JointCommand(hold, np.zeros_like(hold))
        self.servo = True
        self.carried = carried
        self.begin(HoldController(hold), state)

    def _brake_controller(self) -> BrakeController:
        return BrakeController(self._model, self._hardware.period)

    def _stands_beside(self, state: JointState) -> bool:
        """Whether the arm stands off the servo's set-point: it would jump there when the obstruction gives
        way."""
        if not self.servo or float(np.abs(self.setpoint.velocity).max()) > REST_SPEED:
            return False
        standing = float(state.velocity @ state.velocity) < REST_SPEED * REST_SPEED
        return standing and float(np.abs(self.setpoint.position - state.position).max()) > MAX_HOLD_ERROR
