"""Motions as generators: each yield is one tick, the return is the arrival, halting brakes."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Protocol, TypeAlias, TypeVar

import numpy as np

from ...errors import PicktreeError
from ...robots.model import RobotModel
from ...world.causes import Failure, FailureReport, control, safety, world
from ...world.journal import Journal
from ...world.protocols import Clock
from ...world.trajectory import Trajectory
from ...world.values import Array, Vector3
from ..cartesian.compliant_motion import FIRM, CartesianStiffness, CompliantMotion
from ..contact.guarded_move import GuardedMoveResult
from ..joints.joint_controllers import TrajectoryController, reversed_trajectory
from ..joints.soft_contact import ContactThresholds, JointImpedanceResult
from ..joints.soft_controller import JointImpedanceController
from ..safety.motion_lease import ForceGuard, Lease
from .contact_motion import ZERO_TIME, CompliantMotionResult, CompliantMotionRunner
from .control_loop import ControlLoop
from .jog_motion import JogMotion, JogResult, Lookout, Twists
from .soft_motion import JointImpedanceMotion, slowed_trajectory

T = TypeVar("T")
Doing: TypeAlias = Generator[None, None, T]
Watch: TypeAlias = Callable[[], Failure | None]
"""Asked each tick while the arm moves; a failure brakes it and is then raised."""

REST_LIMIT = 3.0
"""Longest wait for the arm to come to rest, s."""
START_TOLERANCE = 0.02
"""Greatest distance of a joint from the start of its trajectory, rad."""
ARRIVED = 2e-3
"""Greatest distance of a joint from the end of its trajectory, rad."""
ARRIVAL_LIMIT = 1.0
"""Longest wait for the arrival after the end of a trajectory, s."""
JOG_GUARD = 25.0
"""Contact force that stops a jog unless the caller says otherwise, N."""


@dataclass(frozen=True, slots=True)
class FollowedPath:
    """A trajectory (see `Trajectory`; a row for each sample), and how much of it was followed, s."""

    times: tuple[float, ...]
    position: tuple[tuple[float, ...], ...]
    velocity: tuple[tuple[float, ...], ...]
    acceleration: tuple[tuple[float, ...], ...]
    progress: float


@dataclass(frozen=True, slots=True, eq=False)
class OngoingMotion:
    """A motion that a skill has handed over while the arm moves: whoever is next may `finish` it."""

    trajectory: Trajectory
    elapsed: float
    """Seconds of the trajectory that were commanded."""
    node: str
    """Who began it."""
    guard: float | None
    """The contact force that stops it, N."""


@dataclass(frozen=True, slots=True, eq=False)
class _HandedOver:
    track: TrajectoryController
    guard: ForceGuard | None
    node: str


class TrajectoryCheck(Protocol):
    """What every trajectory passes before the arm starts it."""

    def passes(self, trajectory: Trajectory) -> Generator[None, None, None]:
        """Return when it may begin; raise a Failure that says why it may not."""
        ...

    def blocked(self, trajectory: Trajectory, done: float) -> Failure | None:
        """Asked each tick on the way, `done` s of it: why it must not go on."""
        ...


class ArmMotion:
    """What skills move the arm with. One motion at a time: starting one takes the arm from the other."""

    def __init__(
        self,
        loop: ControlLoop,
        model: RobotModel,
        clock: Clock,
        journal: Journal,
        gate: TrajectoryCheck | None = None,
        lookout: Lookout | None = None,
        tick: float = 0.05,
    ) -> None:
        """`gate`: what trajectories must pass; without one the arm follows whatever begins where it is.
        `lookout`: what is asked about the way ahead of a jog, each `tick` s."""
        self._gate = gate
        self._jogging = JogMotion(loop, model, lookout, tick)
        self._touching = CompliantMotionRunner(loop, model, clock)
        self._soft = JointImpedanceMotion(loop, model, clock)
        self._loop = loop
        self._model = model
        self._clock = clock
        self._journal = journal
        self._last: TrajectoryController | None = None
        self._handed_over: _HandedOver | None = None

    @property
    def ongoing(self) -> OngoingMotion | None:
        """What was handed over and still waits for somebody who finishes it."""
        over = self._handed_over
        if over is None or over.track.braking or not self._loop.unattended(over.track):
            return None
        limit = None if over.guard is None else over.guard.limit
        return OngoingMotion(over.track.trajectory, over.track.progress, over.node, limit)

    def along(
        self,
        trajectory: Trajectory,
        *,
        node: str = "",
        guard: float | None = None,
        watch: Watch | None = None,
        hand_over: float | None = None,
    ) -> Doing[None]:
        """Follow `trajectory` to its end and arrive.

        `guard`: a contact force in N that stops the motion with world.disturbed. `watch` is asked each tick;
        a failure from it brakes, and is raised at rest. With `hand_over` it returns at the first tick at
        which that many seconds of the trajectory are done, while the arm moves on; `ongoing` says so, and
        `finish` goes on with it. When nobody does within two ticks, the arm brakes on its path.

        Other failures: control.tracking when the arm is not where the trajectory starts, control.timeout,
        safety.*; those of the gate, before the arm moves.
        """
        self._refuse_if_stopped()
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            if self._gate is not None:
                yield from self._gate.passes(trajectory)
                self._check(lease)
            self._check_start(trajectory)
            track = TrajectoryController(trajectory, self._model, self._loop.period)
            touch = None if guard is None else ForceGuard(guard, self._felt())
            self._last = track
            lease.run(track, touch)
            yield from self._follow(lease, track, touch, node, watch, hand_over)

    def finish(
        self,
        *,
        node: str = "",
        guard: float | None = None,
        watch: Watch | None = None,
        hand_over: float | None = None,
    ) -> Doing[None]:
        """Take the motion over that another skill handed over, without braking, and follow it to its end.

        `guard` replaces the limit of the contact force that began with the motion, N, if it had one; None
        keeps it. The rest as in `along`. Where the motion has ended since (see `ongoing`), the failure says
        by what: world.disturbed, safety.*, or control.timeout when nobody took it over in time.
        """
        over = self._handed_over
        if over is None:
            raise PicktreeError(f"{node or 'a skill'} finishes a motion, but none was handed over")
        if self.ongoing is None:
            yield from self._ended(over, node)
        self._handed_over = None
        lease = self._loop.take_over(node, over.track)
        assert lease is not None, "it is unattended"
        with lease:
            over.track.go_on()
            if guard is not None and over.guard is not None:
                over.guard.limit = guard
            yield from self._follow(lease, over.track, over.guard, node, watch, hand_over)

    def _follow(
        self,
        lease: Lease,
        track: TrajectoryController,
        guard: ForceGuard | None,
        node: str,
        watch: Watch | None,
        hand_over: float | None,
    ) -> Doing[None]:
        trajectory = track.trajectory
        limit = self._clock.now + trajectory.duration - track.progress + ARRIVAL_LIMIT
        while True:
            yield
            self._check(lease)
            if guard is not None and guard.contact is not None:
                yield from self._until_rest(lease)
                self._check(lease)
                raise self._touched(guard.contact, track)
            noticed = None if watch is None else watch()
            if noticed is None and self._gate is not None:
                noticed = self._gate.blocked(trajectory, track.progress)
            if noticed is not None:
                track.brake()
                yield from self._until_rest(lease)
                self._check(lease)
                raise noticed
            if track.completed:
                if self._arrived(trajectory.end):
                    return
            elif hand_over is not None and track.progress >= hand_over:
                track.hand_over()
                lease.hand_over()
                self._handed_over = _HandedOver(track, guard, node)
                return
            if self._clock.now > limit:
                off = float(np.abs(self._loop.state.position - trajectory.end).max())
                raise Failure(
                    control.TIMEOUT,
                    f"the arm has not arrived {ARRIVAL_LIMIT:.0f} s after the end of its trajectory "
                    f"({off:.4f} rad off)",
                    error=off,
                )

    def _ended(self, over: _HandedOver, node: str) -> Doing[None]:
        """Bring the arm to rest, and say why what was handed over does not go on."""
        self._handed_over = None
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            self._check(lease)
        if over.guard is not None and over.guard.contact is not None:
            raise self._touched(over.guard.contact, over.track)
        share = over.track.progress / max(over.track.trajectory.duration, 1e-9)
        raise Failure(
            control.TIMEOUT,
            f"nobody went on in time with the motion that {over.node or 'a skill'} handed over: "
            f"it ended after {share * 100:.0f} % of its way",
            fraction=share,
        )

    def guarded(
        self,
        direction: Vector3 | Array,
        distance: float,
        force: float,
        speed: float,
        *,
        node: str = "",
        press: float = 0.0,
        stiffness: CartesianStiffness = FIRM,
    ) -> Doing[GuardedMoveResult]:
        """Straight along `direction` (3,) in the world for `distance` m at `speed` m/s, orientation kept,
        until more than `force` N act against it. The one way to make contact.

        The force is relative to what the hand feels at rest just before, so it works with an object in
        the hand. While standing at the contact the tool presses with `press` N. It ends, at rest, with
        safety.workspace or safety.joint_limit where the line leaves the workspace or a joint comes to its
        limit before there was a contact.
        """
        self._refuse_if_stopped()
        size = float(np.linalg.norm(direction))
        if not (size > 1e-9 and distance > 0.0 and force > 0.0 and speed > 0.0):
            raise PicktreeError("a guarded move needs a direction, and a distance, force and speed above 0")
        along = np.asarray(direction, dtype=np.float64) / size
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            self._last = None
            return (
                yield from self._touching.guarded(
                    lease, along, distance, force, speed, press, stiffness, self._check
                )
            )

    def comply(
        self,
        course: CompliantMotion,
        limit: float,
        *,
        node: str = "",
        stiffness: CartesianStiffness = FIRM,
        zero: Array | None = None,
    ) -> Doing[CompliantMotionResult]:
        """Let the tool follow a course as a damped spring, for contacts: until the course is finished, or
        for `limit` s. The arm is held at rest then, where it is.

        `zero` (6,): what the wrist feels without a contact, from an earlier result; measured at rest before
        the course begins unless given, and then the tool must not touch anything yet. Failures: safety.*
        (safety.joint_limit where a joint stops the course), control.timeout.
        """
        self._refuse_if_stopped()
        if not limit > 0.0:
            raise PicktreeError("a compliant course needs a limit above 0 s")
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            self._last = None
            return (yield from self._touching.comply(lease, course, limit, stiffness, zero, self._check))

    def softly(
        self,
        trajectory: Trajectory,
        least: ContactThresholds,
        *,
        carried: Vector3 = (0.0, 0.0, 0.0),
        node: str = "",
        leaving: bool = False,
    ) -> Doing[JointImpedanceResult]:
        """Follow `trajectory` as a soft spring that feels contacts at any part of the arm, and gives way to
        the first. `carried` (3,): what hangs on the tool, N in the world. The result says how it ended, at
        rest; a contact is no failure.

        `leaving`: the way leads out of what the arm is believed to be in, and whoever calls has looked at it;
        else it passes the gate as in `along`. Failures: those of the gate, control.timeout, safety.*.
        """
        self._refuse_if_stopped()
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            gate = None if leaving else self._gate
            if gate is not None:
                yield from gate.passes(trajectory)
                self._check(lease)
            self._check_start(trajectory)

            def watch(progress: float) -> Failure | None:
                return None if gate is None else gate.blocked(trajectory, progress)

            def began(track: JointImpedanceController) -> None:
                self._last = track

            return (
                yield from self._soft.follow(lease, trajectory, carried, least, self._check, watch, began)
            )

    def pressed(self, carried: Vector3 = (0.0, 0.0, 0.0)) -> float:
        """External torques on the arm at rest, wherever they act, but for what hangs on the tool, (3,) N in
        the world: Euclidean norm over the joints, Nm."""
        return self._soft.pressed(carried)

    def give_way(
        self, carried: Vector3 = (0.0, 0.0, 0.0), limit: float = 1.0, *, node: str = ""
    ) -> Doing[float]:
        """Stop pressing at whatever touches the arm, and drift a little where it pushes, for at most `limit`
        s. Answers the external torque that is left, Nm. Failures: safety.*, control.timeout."""
        self._refuse_if_stopped()
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            return (yield from self._soft.give_way(lease, carried, limit, self._check))

    def jog(
        self,
        twists: Twists,
        *,
        node: str = "",
        guard: float = JOG_GUARD,
        duration: float = math.inf,
        distance: float = math.inf,
    ) -> Doing[JogResult]:
        """Move the tool by twists: one that stays, or who is asked for one each tick until he says None.

        A twist that stays ends after `duration` s or `distance` m of the TCP, or where something stops it: a
        contact of more than `guard` N, a joint limit, a singularity, the edge of the workspace, or what it
        would touch; the result says which. It slows down for all of them, and ends at rest. Failures:
        safety.*, control.timeout when the skill was not ticked for a while.
        """
        self._refuse_if_stopped()
        if not (guard > 0.0 and duration > 0.0 and distance > 0.0):
            raise PicktreeError("a jog needs a guard, a duration and a distance above 0")
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            self._check(lease)
            self._last = None
            touch = ForceGuard(guard, self._felt())
            return (
                yield from self._jogging.run(
                    lease, twists, touch, duration, distance, self._check, self._until_rest
                )
            )

    def rest(self) -> Doing[None]:
        """Brake, and yield until the arm is at rest. Allowed while a safety stop is latched."""
        with self._loop.acquire("rest") as lease:
            yield from self._until_rest(lease)

    def settle(self) -> Doing[None]:
        """Yield until vibrations have decayed; gives up waiting after a second."""
        return self._loop.settle()

    def slowed(self, trajectory: Trajectory, speed: float) -> Trajectory:
        """The same way, slower where need be: no part of the arm goes faster than `speed` m/s."""
        return slowed_trajectory(self._model, trajectory, speed)

    def way_back(self) -> Trajectory | None:
        """The last followed trajectory, as far as it was followed, back to its start; None when the arm
        has been moved otherwise since."""
        if self._last is None:
            return None
        back = reversed_trajectory(self._last.trajectory, self._last.progress)
        if back is None or self._off(back.start) > START_TOLERANCE:
            return None
        return back

    def state(self) -> FollowedPath | None:
        """What `reversed_trajectory` depends on, for a checkpoint."""
        last = self._last
        if last is None:
            return None
        way = last.trajectory
        return FollowedPath(
            tuple(way.times.tolist()),
            tuple(map(tuple, way.position.tolist())),
            tuple(map(tuple, way.velocity.tolist())),
            tuple(map(tuple, way.acceleration.tolist())),
            last.progress,
        )

    def restore(self, way: FollowedPath | None) -> None:
        self._handed_over = None
        if way is None:
            self._last = None
            return
        trajectory = Trajectory(
            np.array(way.times), np.array(way.position), np.array(way.velocity), np.array(way.acceleration)
        )
        self._last = TrajectoryController(trajectory, self._model, self._loop.period)
        self._last.progress = way.progress

    def _felt(self) -> tuple[float, float, float]:
        fx, fy, fz = (float(c) for c in self._loop.wrist.over(ZERO_TIME, self._loop.state.position)[:3])
        return (fx, fy, fz)

    def _until_rest(self, lease: Lease) -> Doing[None]:
        limit = self._clock.now + REST_LIMIT
        while not self._loop.at_rest:
            if self._clock.now > limit:
                speed = float(np.abs(self._loop.state.velocity).max())
                raise Failure(
                    control.TIMEOUT,
                    f"the arm is not at rest after {REST_LIMIT:.0f} s ({speed:.2f} rad/s)",
                    speed=speed,
                )
            yield
            self._check_lease(lease)

    def _check(self, lease: Lease) -> None:
        self._check_lease(lease)
        stop = self._loop.monitor.stopped
        if stop is not None:
            raise Failure(stop.cause, stop.message, **stop.evidence)

    @staticmethod
    def _check_lease(lease: Lease) -> None:
        if not lease.valid:
            raise PicktreeError(f"{lease.owner or 'a motion'} goes on, but another has taken the arm over")

    def _refuse_if_stopped(self) -> None:
        stop: FailureReport | None = self._loop.monitor.stopped
        if stop is not None:
            raise Failure(
                safety.STOP,
                f"a safety stop is not acknowledged: {stop.message}",
                stopped_by=stop.cause.name,
            )

    def _off(self, position: Array) -> float:
        return float(np.abs(self._loop.held_position - position).max())

    def _check_start(self, trajectory: Trajectory) -> None:
        off = self._off(trajectory.start)
        if not off <= START_TOLERANCE:
            raise Failure(
                control.TRACKING,
                f"the trajectory starts {off:.3f} rad from where the arm is",
                error=off,
            )

    def _arrived(self, end: Array) -> bool:
        return self._loop.at_rest and float(np.abs(self._loop.state.position - end).max()) < ARRIVED

    @staticmethod
    def _touched(force: Vector3, track: TrajectoryController) -> Failure:
        size = math.hypot(*force)
        fraction = track.progress / max(track.trajectory.duration, 1e-9)
        return Failure(
            world.DISTURBED,
            f"touched something at {size:.0f} N on a free way, {fraction * 100:.0f} % done",
            force=size,
            direction=[round(c / size, 3) for c in force],
            fraction=fraction,
        )
