"""Trajectories as motions of the arm: follow, hand over while the arm moves, finish, come to rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from picktree.files import PicktreeError
from picktree.world import Array, Clock, Failure, FailureReport, Trajectory, Vector3, control, safety, world
from picktree.world.robot_model import RobotModel

from .commands import Doing
from .control_loop import ControlLoop
from .force_guard import ForceGuard, above_limit
from .joint_controllers import TrajectoryController, reversed_trajectory
from .motion_lease import Lease

Watch: TypeAlias = Callable[[], Failure | None]
"""Callable for each tick of a motion. A failure that it returns brakes the arm and is then raised."""

ZERO_TIME = 0.05
"""Time over which readings at rest are averaged as the wrench without contact, s."""
MAX_REST_WAIT = 3.0
"""Longest wait for the arm to come to rest, s."""
START_TOLERANCE = 0.02
"""Greatest distance of a joint from the start of its trajectory, rad."""
ARRIVAL_TOLERANCE = 2e-3
"""Greatest distance of a joint from the end of its trajectory, rad."""
MAX_ARRIVAL_WAIT = 1.0
"""Longest wait for the arrival after the end of a trajectory, s."""


@dataclass(frozen=True, slots=True)
class FollowedPath:
    """Trajectory (see `Trajectory`; one row for each sample) and the followed part of it, s."""

    times: tuple[float, ...]
    position: tuple[tuple[float, ...], ...]
    velocity: tuple[tuple[float, ...], ...]
    acceleration: tuple[tuple[float, ...], ...]
    progress: float


@dataclass(frozen=True, slots=True, eq=False)
class OngoingMotion:
    """Motion that a skill has handed over while the arm moves. The next skill may `finish` it."""

    trajectory: Trajectory
    elapsed: float
    """Commanded part of the trajectory, s."""
    node: str
    """Node that began the motion."""
    guard: float | None
    """Contact force that stops the motion, N. None: no guard."""


@dataclass(frozen=True, slots=True, eq=False)
class _HandedOver:
    track: TrajectoryController
    guard: ForceGuard | None
    node: str


class TrajectoryCheck(Protocol):
    """Check that every trajectory passes before the arm starts it, and during the motion."""

    def passes(self, trajectory: Trajectory) -> Generator[None, None, None]:
        """Return when the trajectory may begin. Raises a Failure with the reason when it may not."""
        ...

    def blocked(self, trajectory: Trajectory, done: float) -> Failure | None:
        """Return the reason to stop the motion, `done` s into the trajectory; None without one. Called in
        each tick."""
        ...


class TrajectoryMotion:
    """Motions of the arm along trajectories. A motion that starts takes the arm from the one before."""

    def __init__(
        self, loop: ControlLoop, model: RobotModel, clock: Clock, gate: TrajectoryCheck | None
    ) -> None:
        """`gate`: the check that trajectories must pass. None: any that begins at the arm passes."""
        self._gate = gate
        self._loop = loop
        self._model = model
        self._clock = clock
        self._last: TrajectoryController | None = None
        self._handed_over: _HandedOver | None = None

    @property
    def ongoing(self) -> OngoingMotion | None:
        """Motion that was handed over and can still be finished; None without one."""
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
        """Move the arm along `trajectory` to its end.

        `guard`: contact force in N that stops the motion with world.disturbed. `watch` is called in each
        tick; a failure from it brakes the arm, and is raised at rest. With `hand_over` the generator returns
        at the first tick at which that many seconds of the trajectory are done, while the arm moves on.
        `ongoing` is then set, and `finish` continues the motion. Unless that happens within two ticks, the
        arm brakes on its path.

        Other failures: control.tracking when the arm is not at the start of the trajectory, control.timeout,
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
            touch = None if guard is None else ForceGuard(guard, self._contact_force())
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
        """Take over the motion that another skill handed over, without braking, and follow it to its end.

        `guard` replaces the force limit that the motion began with, N, if it had one; None keeps it. The
        other arguments are as in `along`. When the motion has ended before (see `ongoing`), the failure has
        the cause: world.disturbed, safety.*, or control.timeout when no skill took it over in time.
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
        limit = self._clock.now + trajectory.duration - track.progress + MAX_ARRIVAL_WAIT
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
                    f"the arm has not arrived {MAX_ARRIVAL_WAIT:.0f} s after the end of its trajectory "
                    f"({off:.4f} rad off)",
                    error=off,
                )

    def _ended(self, over: _HandedOver, node: str) -> Doing[None]:
        """Bring the arm to rest, and raise why the motion that was handed over has ended."""
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

    def rest(self) -> Doing[None]:
        """Brake, and yield until the arm is at rest. Allowed while a safety stop is latched."""
        with self._loop.acquire("rest") as lease:
            yield from self._until_rest(lease)

    def way_back(self) -> Trajectory | None:
        """Return the executed part of the last trajectory, back to its start; None after any other motion of
        the arm."""
        if self._last is None:
            return None
        back = reversed_trajectory(self._last.trajectory, self._last.progress)
        if back is None or self._held_deviation(back.start) > START_TOLERANCE:
            return None
        return back

    def state(self) -> FollowedPath | None:
        """Return the followed path for a checkpoint: the input of `reversed_trajectory`."""
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

    def _contact_force(self) -> tuple[float, float, float]:
        fx, fy, fz = (float(c) for c in self._loop.wrist.over(ZERO_TIME, self._loop.state.position)[:3])
        return (fx, fy, fz)

    def _until_rest(self, lease: Lease) -> Doing[None]:
        limit = self._clock.now + MAX_REST_WAIT
        while not self._loop.at_rest:
            if self._clock.now > limit:
                speed = float(np.abs(self._loop.state.velocity).max())
                raise Failure(
                    control.TIMEOUT,
                    f"the arm is not at rest after {MAX_REST_WAIT:.0f} s ({speed:.2f} rad/s)",
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
            raise PicktreeError(
                f"{lease.owner or 'a motion'} continues, but another motion has taken the arm over"
            )

    def _refuse_if_stopped(self) -> None:
        stop: FailureReport | None = self._loop.monitor.stopped
        if stop is not None:
            raise Failure(
                safety.STOP,
                f"a safety stop is not acknowledged: {stop.message}",
                stopped_by=stop.cause.name,
            )

    def _held_deviation(self, position: Array) -> float:
        return float(np.abs(self._loop.held_position - position).max())

    def _check_start(self, trajectory: Trajectory) -> None:
        off = self._held_deviation(trajectory.start)
        if not off <= START_TOLERANCE:
            raise Failure(
                control.TRACKING,
                f"the trajectory starts {off:.3f} rad from where the arm is",
                error=off,
            )

    def _arrived(self, end: Array) -> bool:
        return self._loop.at_rest and float(np.abs(self._loop.state.position - end).max()) < ARRIVAL_TOLERANCE

    def _touched(self, force: Vector3, track: TrajectoryController) -> Failure:
        size, limit = math.hypot(*force), self._loop.monitor.limits.force
        fraction = track.progress / max(track.trajectory.duration, 1e-9)
        return Failure(
            world.DISTURBED,
            f"touched something at {size:.0f} N on a free way{above_limit(size, limit)}, "
            f"{fraction * 100:.0f} % done",
            force=size,
            limit=limit,
            direction=[round(c / size, 3) for c in force],
            fraction=fraction,
        )
