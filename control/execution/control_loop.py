"""Control loop: sensors → monitor → controller → command, in each control period."""

from __future__ import annotations

import math
from collections.abc import Generator
from contextlib import contextmanager
from time import perf_counter

import numpy as np

from ...errors import PicktreeError
from ...robots.model import RobotModel
from ...world.causes import Failure, control, safety
from ...world.computing_time import Stopwatch
from ...world.protocols import Hardware
from ...world.values import Array, JointState, Pose, Wrench
from ..cartesian.impedance import CartesianImpedance, ContactReflex
from ..commands import Controller, JointCommand
from ..joints.joint_controllers import BrakeController, HoldController
from ..safety.motion_lease import ForceGuard, Lease
from ..safety.safety_monitor import SafetyMonitor
from ..safety.watchdog import Watchdog
from ..safety.wrist_plausibility import WRIST_WINDOW, WristPlausibility
from ..wrist.wrist_wrench import WristWrench
from .control_loop_state import ControlLoopState

REST_SPEED = 0.02
"""Speed over all joints below which the arm counts as standing, rad/s."""
TOOL_CHECK_PERIODS = 4
"""Control periods between two checks of the TCP against the workspace."""
REST_TIME = 0.1
"""Time at rest before a tare or a load is read, s."""
CONTACT_RATE = 500
"""Rate of physics and control in contact, Hz."""
TOUCH_FORCE = 20.0
"""Force above which the wrist counts as touched, not only loaded, N."""
LOAD_REST_TIME = 0.05
"""Time at rest over which the load of the hand is averaged, s."""
EFFORT_CHECK_TIME = 0.05
"""Time between two checks of the joints' efforts, s. One check costs as much as a control step by itself."""
MAX_HOLD_ERROR = 0.01
"""Joint error at the end of a motion above which the arm holds its actual configuration, rad. The obstruction
may give way at any time."""
SETTLED_FORCE_DEVIATION = 0.5
"""Standard deviation of the wrist force below which nothing vibrates, N."""
SETTLE_LIMIT = 1.0
"""Longest wait for vibrations, s."""


class ControlLoop:
    """Loop that runs one controller at a time and issues the lease on the arm.

    After a lease is acquired or released, and after a safety stop, it brakes by itself, then holds.
    """

    def __init__(
        self,
        hardware: Hardware,
        model: RobotModel,
        monitor: SafetyMonitor,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        self.hardware = hardware
        self.model = model
        self.monitor = monitor
        self.wrist = WristWrench(hardware.wrench, model, hardware.clock)
        self._stopwatch = stopwatch or Stopwatch()
        self._stepping = 0.0
        self._arm = hardware.arm
        self._clock = hardware.clock
        self._state = self._arm.read()
        self._setpoint = JointCommand(self._state.position.copy(), np.zeros(model.n))
        self._servo = True
        self._reference: Array | None = self._setpoint.position
        self._rates: list[int] = []
        self._holder: Lease | None = None
        self._guard: ForceGuard | None = None
        self._carried = np.zeros(6)
        self._standing = 0
        self._periods = 0
        self._plausibility = WristPlausibility(model, monitor, self.wrist, feels_effort=hardware.feels_effort)
        self._looked = self._clock.now
        self._velocity = self._state.velocity
        self._watchdog = Watchdog()
        self._braking = False
        self._controller: Controller = HoldController()
        self._begin(self._controller)
        monitor.age_of_joints(lambda: self._clock.now - hardware.stamps.joints)

    @property
    def now(self) -> float:
        """Simulated time, s."""
        return self._clock.now

    @property
    def period(self) -> float:
        """Length of a control period, s; shorter within `contact`."""
        return self.hardware.period

    @contextmanager
    def contact(self, rate: int = CONTACT_RATE) -> Generator[None]:
        """Run sensors, control and physics `rate` times a second inside the context: 240, 500, 1000, …

        The rate changes between two ticks, while the arm is held; after a halt once it has braked. Raises
        PicktreeError for a rate that the hardware does not have.
        """
        self._rates.append(rate)
        try:
            self._keep_pace()
            yield
        finally:
            self._rates.remove(rate)

    def _keep_pace(self) -> None:
        if isinstance(self._controller, HoldController):
            self.hardware.pace(max(self._rates, default=None))

    @property
    def state(self) -> JointState:
        """Last encoder reading."""
        return self._state

    @property
    def reference(self) -> Array | None:
        """Commanded configuration (n,) of the servo when `state` was read, rad. None: torque control."""
        return self._reference

    @property
    def controller(self) -> str:
        """Name of the active controller: `Hold`, `Track`, `Brake`, …"""
        return self._controller.name

    @property
    def tcp(self) -> Pose:
        """TCP pose in the world, by the encoders."""
        return self.model.tcp(self._state.position)

    @property
    def at_rest(self) -> bool:
        """Whether the arm is held, stands still, and no motion waits to be braked."""
        return isinstance(self._controller, HoldController) and self._standing >= 2

    @property
    def held_position(self) -> Array:
        """Last commanded configuration (n,) of the servo, rad. At rest the next motion begins there."""
        return self._setpoint.position.copy()

    def acquire(self, owner: str) -> Lease:
        """Take the arm from the present holder at once, brake its motion, and return the new lease."""
        self._holder = Lease(self, owner)
        self._brake_motion()
        return self._holder

    def take_over(self, owner: str, controller: Controller) -> Lease | None:
        """Return the lease on a handed-over motion, without braking it. None: the motion has ended."""
        if not self.unattended(controller):
            return None
        self._holder = Lease(self, owner)
        return self._holder

    def unattended(self, controller: Controller) -> bool:
        """Return whether `controller` moves the arm while there is no holder of the lease."""
        return self._holder is None and self._controller is controller

    def tare(self, window: float = WRIST_WINDOW) -> None:
        """Take the present wrist reading as zero for `load` and `wrench_external`."""
        self.wrist.tare(window, self._state.position)

    def zero(self) -> bool:
        """Learn the wrist sensor's bias, and tare: the hand carries nothing.

        The arm is at rest, and nothing touches the empty hand. False: the reading cannot be a bias (see
        `WristWrench.zero`), and the known one stays.
        """
        state = self._state
        self.wrist.carry(None)
        learnt = self._standing * self.period >= REST_TIME - 1e-9 and self._plausibility.learn_bias(state)
        if self.wrist.zeroed:
            self.wrist.untare()
        else:
            self.tare()
        return learnt

    def load(self, window: float = WRIST_WINDOW) -> float:
        """Return the weight on the hand relative to the tare, N, mean over the last `window` s."""
        return self.wrist.load(window)

    def wrench_external(self, window: float = 0.05) -> Wrench:
        """Return the external wrench on the hand relative to the tare, mean over the last `window` s.

        World axes, about the wrist sensor. It lacks the tool's weight, and contains a held object's unless
        that was tared.
        """
        return self.wrist.external(window, self._state.position)

    def settle(self) -> Generator[None, None, None]:
        """Yield until the arm rests without vibration and readings at rest fill a tare or a load; at most
        `SETTLE_LIMIT` s."""
        until = self._clock.now + SETTLE_LIMIT
        while self._clock.now < until:
            quiet = (
                self._standing * self.period >= REST_TIME - 1e-9
                and self.wrist.unrest(WRIST_WINDOW) < SETTLED_FORCE_DEVIATION
            )
            if quiet and isinstance(self._controller, HoldController):
                return
            yield

    def step_tick(self, tick: float) -> None:
        """Simulate one tick of `tick` s, in whole control periods."""
        self._keep_pace()
        moving = (
            self._holder is not None
            and not self._braking
            and not isinstance(self._controller, HoldController)
        )
        if self._watchdog.expired(tick, moving) and not getattr(self._controller, "late", False):
            owner = "" if self._holder is None else self._holder.owner
            self.monitor.unattended(owner, self.controller, self._watchdog.restart())
        periods = round(tick / self.period)
        if abs(periods * self.period - tick) > 1e-6:
            raise PicktreeError(
                f"a tick of {tick} s is no whole number of control periods of {self.period} s"
            )
        self._stepping = 0.0
        with self._stopwatch.measure("control"):
            step = self.step
            for _ in range(periods):
                step()
            self._stopwatch.move(self._stepping, "physics")

    def step(self) -> None:
        """Run one control period."""
        self._state = state = self._arm.read()
        self.wrist.sample()
        force = self.wrist.force
        v = state.velocity
        # The slow end of a motion does not count: the wrist still feels the braking.
        still = isinstance(self._controller, HoldController) and float(v @ v) < REST_SPEED * REST_SPEED
        self._standing = self._standing + 1 if still else 0
        if self._standing == round(REST_TIME / self.period):
            self._plausibility.come_to_rest(state)
        guard, plausible = self._guard, self._plausibility
        touched = guard is not None and guard.touched(
            plausible.contact(state, self._velocity, self.period, force, guard)
        )
        self._reference = self._setpoint.position if self._servo else None
        stopped = self.monitor.check(state, self._reference, force, self.period)
        self._periods += 1
        if self._periods % TOOL_CHECK_PERIODS == 0:
            stopped = self._look_around(state) or stopped
        self._velocity = v
        if touched or (stopped and self._off_its_way):
            self._stop_at_once()
        elif stopped:
            self._brake_motion()
        command = self._controller.update(self._clock.now, state)
        if isinstance(command, JointCommand):
            self._setpoint = command
            self._servo = True
            self._arm.follow(command.position, command.velocity)
        else:
            self._servo = False
            self._arm.apply_torque(command.torque)
        if self._controller.done:
            self._begin(HoldController() if self._servo else BrakeController(self.model, self.period))
        before = perf_counter()
        self.hardware.step()
        self._stepping += perf_counter() - before

    def _look_around(self, state: JointState) -> bool:
        """Run the checks that are not needed in each period, and return whether a stop was latched."""
        monitor, wrist, now = self.monitor, self.wrist, self._clock.now
        tool = self.model.tcp(state.position)
        wrist.turned(tool)
        stopped = monitor.check_tool(tool.position)
        stopped = monitor.check_sensors(now, self.hardware.stamps, wrist.repeats_since) or stopped
        if self._standing * self.period >= REST_TIME:
            stopped = self._plausibility.check_load(state) or stopped
        elapsed = now - self._looked
        if elapsed >= EFFORT_CHECK_TIME - 1e-9:
            self._looked = now
            if self.hardware.feels_effort:
                acceleration = (state.velocity - self._velocity) / self.period
                stopped = self._plausibility.check_efforts(state, acceleration, elapsed) or stopped
        return stopped

    def save(self) -> ControlLoopState:
        """Return the state for a checkpoint. Raises PicktreeError unless the arm is held at rest."""
        if not isinstance(self._controller, HoldController):
            raise PicktreeError("the control loop can only be saved while the arm is held at rest")
        readings, tare = self.wrist.state()
        return ControlLoopState(
            tuple(self._controller.command.position.tolist()),
            readings,
            tare,
            self._standing,
            self._periods,
            tuple(self._carried.tolist()),
            self.monitor.state(),
            self.wrist.stamps,
            self.wrist.learnt,
            self.wrist.noisy,
            self._plausibility.doubts_wrist,
        )

    def restore(self, saved: ControlLoopState) -> None:
        """Continue from `saved` on hardware that was restored before. Every earlier lease is stale."""
        self._holder = self._guard = None
        self._rates.clear()
        self._standing, self._periods = saved.standing, saved.periods
        self._state = self._arm.read()
        hold = np.array(saved.hold)
        self._setpoint = JointCommand(hold, np.zeros_like(hold))
        self._servo = True
        self._reference = hold
        self._begin(HoldController(hold))
        self.wrist.restore(saved.readings, saved.tare, saved.stamps, saved.bias, self.tcp)
        self.wrist.noisy, self._plausibility.doubts_wrist = saved.noisy, saved.doubts_wrist
        self._carried = np.array(saved.carried)
        self._velocity, self._looked = self._state.velocity, self._clock.now
        self._watchdog = Watchdog()
        self.monitor.restore(saved.monitor)

    def holds(self, lease: Lease) -> bool:
        """Return whether `lease` is valid. The call is the sign of attention that the watchdog waits for."""
        holds = self._holder is lease
        self._watchdog.attended = self._watchdog.attended or holds
        return holds

    def run(self, controller: Controller, guard: ForceGuard | None) -> None:
        """Start `controller`; only a lease calls this.

        Raises Failure(safety.stale_sensor) for Cartesian impedance while the wrist sensor is silent.
        """
        if self.monitor.blind and isinstance(controller, CartesianImpedance):
            raise Failure(
                safety.STALE_SENSOR,
                "a motion by feel is refused: the wrist sensor is silent",
                sensor="wrench",
            )
        if self._holder is not None and not isinstance(controller, HoldController):
            self.monitor.moves(self._holder.owner)
        self._braking, self._watchdog.attended = False, True
        self._guard = guard
        if self._standing * self.period >= LOAD_REST_TIME - 1e-9 and self._servo:
            weight = -self.wrist.over(LOAD_REST_TIME, self._state.position)[:3]
            self._carried[:3] = weight if float(np.linalg.norm(weight)) < TOUCH_FORCE else 0.0
        self._begin(controller)

    def brake(self) -> None:
        """Take the lease back and brake; only a lease calls this."""
        self._holder = None
        self._brake_motion()

    def leave(self) -> None:
        """Take the lease back while the arm moves on; only a lease calls this."""
        self._holder = None

    def _begin(self, controller: Controller) -> None:
        if not self._servo:
            self._setpoint = JointCommand(self._state.position.copy(), self._state.velocity.copy())
        self._controller = controller
        controller.start(self._clock.now, self._state, self._setpoint)

    def _brake_motion(self) -> None:
        self._guard = None
        self._braking = True
        if self._stands_beside():
            self._servo = False
            self._begin(BrakeController(self.model, self.period))
            return
        braking = self._controller.brake()
        if braking is not self._controller:
            self._begin(braking)

    def _stands_beside(self) -> bool:
        """Whether the arm stands off the servo's set-point: it would jump there when the obstruction gives
        way."""
        if not self._servo or float(np.abs(self._setpoint.velocity).max()) > REST_SPEED:
            return False
        state = self._state
        standing = float(state.velocity @ state.velocity) < REST_SPEED * REST_SPEED
        return standing and float(np.abs(self._setpoint.position - state.position).max()) > MAX_HOLD_ERROR

    @property
    def _off_its_way(self) -> bool:
        """Whether the stop just latched is a tracking error, a force or a torque: braking on the path would
        prolong it."""
        stop = self.monitor.stopped
        return stop is not None and stop.cause in (control.TRACKING, safety.FORCE_LIMIT, safety.TORQUE_LIMIT)

    def _stop_at_once(self) -> None:
        """Comply after a contact; otherwise brake as fast as the joints allow, from the present state."""
        self._guard = None
        self._braking = True
        self._servo = False
        if math.hypot(*self.wrist.force) > TOUCH_FORCE:
            self._begin(ContactReflex(self.model, self.period, self._carried))
        else:
            self._begin(BrakeController(self.model, self.period))
