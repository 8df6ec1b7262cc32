"""Control loop: sensors → supervision → controller → command, in each control period.

Its parts stand by themselves: `ArmSampler` reads, `Supervision` judges, `BiasEstimator` learns the wrist
sensor's bias, `ContactGuard` guards the motion, and `ArmDrive` commands and brakes.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ...files.errors import PicktreeError
from ...world.causes import Failure, safety
from ...world.computing_time import Stopwatch
from ...world.protocols import Hardware
from ...world.robot_model.model import RobotModel
from ...world.values import Array, JointState, Pose, Wrench
from .arm_drive import ArmDrive, ArmSampler
from .bias_estimation import WRIST_WINDOW, BiasEstimator
from .commands import Controller
from .impedance import CartesianImpedance
from .joint_controllers import HoldController
from .motion_lease import ContactGuard, ForceGuard, Lease
from .safety_monitor import MonitorState, SafetyMonitor
from .supervision import REST_TIME, TOUCH_FORCE, Supervision, Watchdog

CONTACT_RATE = 500
"""Rate of physics and control in contact, Hz."""
LOAD_REST_TIME = 0.05
"""Time at rest over which the load of the hand is averaged, s."""
SETTLED_FORCE_DEVIATION = 0.5
"""Standard deviation of the wrist force below which nothing vibrates, N."""
SETTLE_LIMIT = 1.0
"""Longest wait for vibrations, s."""


@dataclass(frozen=True, slots=True)
class ControlLoopState:
    """State of the control loop at rest, for checkpoints."""

    hold: tuple[float, ...]
    """Commanded configuration (n,), rad."""
    readings: tuple[Wrench, ...]
    tare: tuple[float, ...]
    standing: int
    periods: int
    carried: tuple[float, ...]
    monitor: MonitorState
    stamps: tuple[float, ...] = ()
    """Times of the readings, s; empty in older logs."""
    bias: tuple[float, ...] = ()
    """Learnt bias (6,) of the wrist sensor, N and Nm, TCP axes, then its variance, N², and its time, s.

    Empty: none was learnt. Older logs have no variance and time.
    """
    noisy: bool = False
    """Whether the wrist sensor is known to be noisy: it never repeats a reading."""
    doubts_wrist: bool = False
    """Whether the joints' efforts contradict the wrist reading."""


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
        self._clock = hardware.clock
        self._stopwatch = stopwatch or Stopwatch()
        self._stepping = 0.0
        self._sampler = ArmSampler(hardware, model)
        self.wrist = self._sampler.wrist
        self._bias = BiasEstimator(model, monitor, self.wrist)
        self._supervision = Supervision(hardware, model, monitor, self._sampler, self._bias)
        self._guard = ContactGuard(model, self.wrist, feels_effort=hardware.feels_effort)
        self._drive = ArmDrive(hardware, model, self._sampler.state)
        self._reference = self._drive.reference
        self._rates: list[int] = []
        self._rest_periods = round(REST_TIME / hardware.period)
        self._holder: Lease | None = None
        self._watchdog = Watchdog()

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
        if self._drive.held:
            self.hardware.pace(max(self._rates, default=None))
            self._rest_periods = round(REST_TIME / self.period)

    @property
    def state(self) -> JointState:
        """Last encoder reading."""
        return self._sampler.state

    @property
    def reference(self) -> Array | None:
        """Commanded configuration (n,) of the servo when `state` was read, rad. None: torque control."""
        return self._reference

    @property
    def controller(self) -> str:
        """Name of the active controller: `Hold`, `Track`, `Brake`, …"""
        return self._drive.controller.name

    @property
    def tcp(self) -> Pose:
        """TCP pose in the world, by the encoders."""
        return self._sampler.tcp

    @property
    def at_rest(self) -> bool:
        """Whether the arm is held, stands still, and no motion waits to be braked."""
        return self._drive.held and self._sampler.standing >= 2

    @property
    def held_position(self) -> Array:
        """Last commanded configuration (n,) of the servo, rad. At rest the next motion begins there."""
        return self._drive.setpoint.position.copy()

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
        return self._holder is None and self._drive.controller is controller

    def tare(self, window: float = WRIST_WINDOW) -> None:
        """Take the present wrist reading as zero for `load` and `wrench_external`."""
        self.wrist.tare(window, self.state.position)

    def zero(self) -> bool:
        """Learn the wrist sensor's bias, and tare: the hand carries nothing.

        The arm is at rest, and nothing touches the empty hand. False: the reading cannot be a bias (see
        `WristWrench.zero`), and the known one stays.
        """
        return self._bias.zero_empty(self.state, rested=self._sampler.rested(REST_TIME))

    def load(self, window: float = WRIST_WINDOW) -> float:
        """Return the weight on the hand relative to the tare, N, mean over the last `window` s."""
        return self.wrist.load(window)

    def wrench_external(self, window: float = 0.05) -> Wrench:
        """Return the external wrench on the hand relative to the tare, mean over the last `window` s.

        World axes, about the wrist sensor. It lacks the tool's weight, and contains a held object's unless
        that was tared.
        """
        return self.wrist.external(window, self.state.position)

    def settle(self) -> Generator[None, None, None]:
        """Yield until the arm rests without vibration and readings at rest fill a tare or a load; at most
        `SETTLE_LIMIT` s."""
        until = self._clock.now + SETTLE_LIMIT
        while self._clock.now < until:
            rested = self._drive.held and self._sampler.rested(REST_TIME)
            if rested and self.wrist.unrest(WRIST_WINDOW) < SETTLED_FORCE_DEVIATION:
                return
            yield

    def step_tick(self, tick: float) -> None:
        """Simulate one tick of `tick` s, in whole control periods."""
        self._keep_pace()
        drive = self._drive
        moving = self._holder is not None and not drive.braking and not drive.held
        if self._watchdog.expired(tick, moving) and not getattr(drive.controller, "late", False):
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
        sampler, drive, guard, period = self._sampler, self._drive, self._guard, self.hardware.period
        state = sampler.sample(drive.held)
        force = self.wrist.force
        if sampler.standing == self._rest_periods:
            self._bias.come_to_rest(state)
        touched = guard.exceeded(force) and guard.touched(state, sampler.acceleration, force)
        self._reference = reference = drive.setpoint.position if drive.servo else None
        stopped = self._supervision.check(state, reference, force, period)
        if touched or (stopped and self._supervision.off_its_way()):
            guard.guard = None
            drive.stop_at_once(state, pushed=self._supervision.pushed(self.wrist.force))
        elif stopped:
            self._brake_motion()
        drive.command(state)
        before = perf_counter()
        self.hardware.step()
        self._stepping += perf_counter() - before

    def save(self) -> ControlLoopState:
        """Return the state for a checkpoint. Raises PicktreeError unless the arm is held at rest."""
        controller = self._drive.controller
        if not isinstance(controller, HoldController):
            raise PicktreeError("the control loop can only be saved while the arm is held at rest")
        readings, tare = self.wrist.state()
        return ControlLoopState(
            tuple(controller.command.position.tolist()),
            readings,
            tare,
            self._sampler.standing,
            self._supervision.periods,
            tuple(self._drive.carried.tolist()),
            self.monitor.state(),
            self.wrist.stamps,
            self.wrist.learnt,
            self.wrist.noisy,
            self._bias.doubtful,
        )

    def restore(self, saved: ControlLoopState) -> None:
        """Continue from `saved` on hardware that was restored before. Every earlier lease is stale."""
        self._holder = self._guard.guard = None
        self._rates.clear()
        self._sampler.restore(saved.standing)
        self._drive.restore(np.array(saved.hold), self.state, np.array(saved.carried))
        self._reference = self._drive.reference
        self.wrist.restore(saved.readings, saved.tare, saved.stamps, saved.bias, self.tcp)
        self.wrist.noisy, self._bias.doubtful = saved.noisy, saved.doubts_wrist
        self._supervision.restore(saved.periods)
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
        self._drive.braking, self._watchdog.attended = False, True
        self._guard.guard = guard
        if self._sampler.rested(LOAD_REST_TIME) and self._drive.servo:
            weight = self.wrist.over(LOAD_REST_TIME, self.state.position)[:3]
            self._drive.carried[:3] = weight if float(np.linalg.norm(weight)) < TOUCH_FORCE else 0.0
        self._drive.begin(controller, self.state)

    def brake(self) -> None:
        """Take the lease back and brake; only a lease calls this."""
        self._holder = None
        self._brake_motion()

    def leave(self) -> None:
        """Take the lease back while the arm moves on; only a lease calls this."""
        self._holder = None

    def _brake_motion(self) -> None:
        self._guard.guard = None
        self._drive.brake(self.state)
