"""Control loop: sensors → supervision → controller → command, in each control period.

Its parts are independent: `ArmSampler` reads, `Supervision` judges, `BiasEstimator` learns the wrist sensor's
bias, `ContactGuard` guards the motion, and `ArmDrive` commands and brakes.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from picktree.files import PicktreeError
from picktree.world import (
    GRAVITY,
    Array,
    Failure,
    Hardware,
    JointState,
    Pose,
    Stopwatch,
    Vector3,
    Wrench,
    control,
    safety,
)
from picktree.world.robot_model import RobotModel

from .admittance import AdmittanceReflex
from .commands import Controller, JointCommand
from .external_torque import MIN_EXPLAINED_SHARE
from .force_guard import ContactGuard, ForceGuard
from .impedance import CartesianImpedance, ContactReflex
from .joint_controllers import BrakeController, HoldController, TrajectoryController
from .motion_lease import Lease
from .safety_monitor import MonitorState, SafetyMonitor
from .wrist_wrench import MAX_QUIET_DEVIATION, MAX_SENSOR_NOISE, WRIST_WINDOW, BiasEstimator, WristWrench

REST_SPEED = 0.02
"""Speed over all joints below which the arm counts as at rest, rad/s."""


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
        """Number of control periods for which the held arm has been at rest."""
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
        """Whether the arm has been at rest for `time` s."""
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
        """Read the encoders of restored hardware; the arm has been at rest for `standing` periods."""
        self.state, self.standing = self._arm.read(), standing
        self._velocity = self.state.velocity


MAX_HOLD_ERROR = 0.01
"""Joint error at the end of a motion above which the arm holds its actual configuration, rad. The obstruction
may give way at any time."""


class ArmDrive:
    """Executor of one controller at a time. At the end of each motion it holds the arm by itself."""

    def __init__(self, hardware: Hardware, model: RobotModel, state: JointState, wrist: WristWrench) -> None:
        """Hold the arm at its present configuration; `state` is the encoder reading."""
        self._hardware, self._model, self._wrist = hardware, model, wrist
        self._arm, self._clock = hardware.arm, hardware.clock
        self._preview = hardware.preview
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
            if self._preview:
                self._arm.follow(command.position, command.velocity, self._ahead(command))
            else:
                self._arm.follow(command.position, command.velocity)
        else:
            self.servo = False
            self._arm.apply_torque(command.torque)
        if controller.done:
            self.begin(HoldController() if self.servo else self._brake_controller(), state)

    def brake(self, state: JointState) -> None:
        """Bring the motion to rest on its path; an arm off the set-point is held at its present
        configuration."""
        self.braking = True
        if self._is_off_set_point(state):
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
        if pushed and self._hardware.takes_torque:
            self.begin(ContactReflex(self._model, self._hardware.period, self.carried), state)
        elif pushed:
            period, late = self._hardware.period, self._hardware.latency
            reflex = AdmittanceReflex(self._model, period, self._wrist, self.carried, latency=late)
            self.begin(reflex, state)
        else:
            self.begin(self._brake_controller(), state)

    def restore(self, hold: Array, state: JointState, carried: Array) -> None:
        """Hold the configuration `hold` (n,), rad, after a checkpoint was restored."""
        self.setpoint = JointCommand(hold, np.zeros_like(hold))
        self.servo = True
        self.carried = carried
        self.begin(HoldController(hold), state)

    def _ahead(self, command: JointCommand) -> tuple[Array, ...]:
        """Return the path ahead of a command at the times that the hardware wants; none: it is not known."""
        controller, after = self.controller, self._hardware.period
        if isinstance(controller, TrajectoryController):
            return controller.ahead(tuple(time - after for time in self._preview))
        return (command.position,) * len(self._preview) if self.held else ()

    def _brake_controller(self) -> BrakeController:
        return BrakeController(self._model, self._hardware.period)

    def _is_off_set_point(self, state: JointState) -> bool:
        """Whether the arm is off the servo's set-point: it would jump there when the obstruction gives
        way."""
        if not self.servo or float(np.abs(self.setpoint.velocity).max()) > REST_SPEED:
            return False
        standing = float(state.velocity @ state.velocity) < REST_SPEED * REST_SPEED
        return standing and float(np.abs(self.setpoint.position - state.position).max()) > MAX_HOLD_ERROR


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
    """Supervisor of the sensor readings: it reports to the safety monitor, whose stop is latched."""

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

    def is_off_path(self) -> bool:
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
        if doubtful and (self._wrist.vibrates(WRIST_WINDOW, MAX_QUIET_DEVIATION) or self._bias.learn(state)):
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
    least_noise: float = MAX_SENSOR_NOISE
    """Least noise of the wrist at rest so far, N; older logs have none."""


def _described(controller: Controller) -> str:
    """Return a motion in words: its controller, and of a trajectory duration and greatest way of a joint."""
    if not isinstance(controller, TrajectoryController):
        return controller.name
    path = controller.trajectory
    way = math.degrees(float(np.abs(path.end - path.start).max()))
    return f"{controller.name}, {path.duration:.1f} s, a joint by up to {way:.0f} deg"


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
        self._drive = ArmDrive(hardware, model, self._sampler.state, self.wrist)
        self._reference = self._drive.reference
        self._rates: list[int] = []
        self._past: deque[tuple[float, Array | None]] = deque()
        """Set-points of the last latency, with their times."""
        self._rest_periods = round(REST_TIME / hardware.period)
        self._holder: Lease | None = None
        self._watchdog = Watchdog()
        self.confirm: Callable[[str, str], None] | None = None
        """Called with owner and motion before each motion that a lease starts; it raises to refuse. Reflexes
        and braking never ask."""

    @property
    def now(self) -> float:
        """Simulated time, s."""
        return self._clock.now

    @property
    def takes_torque(self) -> bool:
        """Whether the arm takes torques; else contact is made by positions."""
        return self.hardware.takes_torque

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
        """Whether the arm is held and at rest, and no motion waits to be braked."""
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
            if rested and not self.wrist.vibrates(WRIST_WINDOW, SETTLED_FORCE_DEVIATION):
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
            self._stopwatch.reassign(self._stepping, "physics")

    def step(self) -> None:
        """Run one control period."""
        sampler, drive, guard, period = self._sampler, self._drive, self._guard, self.hardware.period
        state = sampler.sample(drive.held)
        force = self.wrist.force
        if sampler.standing == self._rest_periods:
            self._bias.come_to_rest(state)
        touched = guard.exceeded(force) and guard.touched(state, sampler.acceleration, force)
        self._reference = reference = drive.setpoint.position if drive.servo else None
        stopped = self._supervision.check(state, self._told(reference), force, period)
        if touched or (stopped and self._supervision.is_off_path()):
            guard.guard = None
            drive.stop_at_once(state, pushed=self._supervision.pushed(self.wrist.force))
        elif stopped:
            self._brake_motion()
        drive.command(state)
        before = perf_counter()
        self.hardware.step()
        self._stepping += perf_counter() - before

    def _told(self, reference: Array | None) -> Array | None:
        """Return the set-point (n,) that the present reading should show: the one of a latency ago."""
        latency, now, past = self.hardware.latency, self._clock.now, self._past
        if latency <= 0.0:
            return reference
        past.append((now, reference))
        while len(past) > 1 and past[1][0] <= now - latency + 1e-9:
            past.popleft()
        return past[0][1]

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
            self.wrist.least_noise,
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
        self.wrist.least_noise = saved.least_noise
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
            if self.confirm is not None:
                self.confirm(self._holder.owner, _described(controller))
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
