"""Motions as generators: each yield is one tick, the return is the arrival, halting brakes."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import numpy as np

from ..causes import Failure, FailureReport, control, safety, world
from ..errors import PicktreeError
from ..journal import Journal
from ..protocols import Clock
from ..robot.model import RobotModel
from ..trajectory import Trajectory
from ..values import Array, Vector3
from .guarded import GuardedResult, GuardedTarget
from .impedance import FIRM, CartesianImpedance, Stiffness
from .joint_controllers import Hold, Track, way_back
from .lease import ForceGuard, Lease
from .loop import ControlLoop

T = TypeVar("T")
Doing: TypeAlias = Generator[None, None, T]

REST_LIMIT = 3.0
"""Longest wait for the arm to come to rest, s."""
START_TOLERANCE = 0.02
"""Greatest distance of a joint from the start of its trajectory, rad."""
ARRIVED = 2e-3
"""Greatest distance of a joint from the end of its trajectory, rad."""
ARRIVAL_LIMIT = 1.0
"""Longest wait for the arrival after the end of a trajectory, s."""
SLOWED = 4.0
"""How much longer a guarded move may take near a singularity, where it goes slower."""
CONTACT_TIME = 1.5
"""Longest wait for the arm to stand after a guarded move, s."""


@dataclass(frozen=True, slots=True)
class Way:
    """A trajectory (see `Trajectory`; a row for each sample), and how much of it was followed, s."""

    times: tuple[float, ...]
    position: tuple[tuple[float, ...], ...]
    velocity: tuple[tuple[float, ...], ...]
    acceleration: tuple[tuple[float, ...], ...]
    progress: float


class Motions:
    """What skills move the arm with. One motion at a time: starting one takes the arm from the other."""

    def __init__(self, loop: ControlLoop, model: RobotModel, clock: Clock, journal: Journal) -> None:
        self._loop = loop
        self._model = model
        self._clock = clock
        self._journal = journal
        self._last: Track | None = None

    def along(self, trajectory: Trajectory, *, node: str = "", guard: float | None = None) -> Doing[None]:
        """Follow `trajectory` to its end and arrive.

        `guard`: a contact force in N that stops the motion with world.disturbed. Other failures:
        control.tracking when the arm is not where the trajectory starts, control.timeout, safety.*.
        """
        self._refuse_if_stopped()
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            self._check_start(trajectory)
            track = Track(trajectory, self._model, self._loop.period)
            watch = None if guard is None else ForceGuard(guard, self._felt())
            self._last = track
            lease.run(track, watch)
            limit = self._clock.now + trajectory.duration + ARRIVAL_LIMIT
            while True:
                yield
                self._check(lease)
                if watch is not None and watch.contact is not None:
                    yield from self._until_rest(lease)
                    self._check(lease)
                    raise self._touched(watch.contact, track, node)
                if track.completed and self._arrived(trajectory.end):
                    return
                if self._clock.now > limit:
                    off = float(np.abs(self._loop.state.position - trajectory.end).max())
                    raise Failure(
                        control.TIMEOUT,
                        f"the arm has not arrived {ARRIVAL_LIMIT:.0f} s after the end of its trajectory "
                        f"({off:.4f} rad off)",
                        error=off,
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
        stiffness: Stiffness = FIRM,
    ) -> Doing[GuardedResult]:
        """Straight along `direction` (3,) in the world for `distance` m at `speed` m/s, orientation kept,
        until more than `force` N act against it. The one way to make contact.

        The force is relative to what the hand feels at rest just before, so it works with an object in
        the hand. While standing at the contact the tool presses with `press` N.
        """
        self._refuse_if_stopped()
        size = float(np.linalg.norm(direction))
        if not (size > 1e-9 and distance > 0.0 and force > 0.0 and speed > 0.0):
            raise PicktreeError("a guarded move needs a direction, and a distance, force and speed above 0")
        along = np.asarray(direction, dtype=np.float64) / size
        loop = self._loop
        with loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            yield from loop.settle()
            self._check(lease)
            felt = loop.wrist.mean(12, loop.state.position)
            target = GuardedTarget(
                along,
                distance,
                force=force,
                speed=speed,
                press=press,
                stiffness=stiffness.linear,
                period=loop.period,
                felt=lambda: loop.wrist.force,
                baseline=felt[:3],
            )
            begin = np.array(loop.tcp.position)
            carried = self._carrying(felt)
            self._last = None
            lease.run(CartesianImpedance(self._model, loop.period, target, stiffness, carried))
            limit = self._clock.now + SLOWED * distance / speed + speed + CONTACT_TIME
            stop = math.inf
            while True:
                yield
                self._check(lease)
                if target.finished:
                    stop = min(stop, self._clock.now + CONTACT_TIME)
                    if target.standing:
                        break
                if self._clock.now > min(limit, stop):
                    break
            lease.run(Hold())
            yield
            self._check(lease)
            pose = loop.tcp
            if not target.finished:
                raise Failure(
                    control.TIMEOUT,
                    f"a guarded move of {distance * 1000:.0f} mm did not end in time",
                    force=target.peak,
                )
            return GuardedResult(
                target.contact, float(along @ (np.array(pose.position) - begin)), target.peak, pose
            )

    def rest(self) -> Doing[None]:
        """Brake, and yield until the arm is at rest. Allowed while a safety stop is latched."""
        with self._loop.acquire("rest") as lease:
            yield from self._until_rest(lease)

    def settle(self) -> Doing[None]:
        """Yield until vibrations have decayed; gives up waiting after a second."""
        return self._loop.settle()

    def way_back(self) -> Trajectory | None:
        """The last followed trajectory, as far as it was followed, back to its start; None when the arm
        has been moved otherwise since."""
        if self._last is None:
            return None
        back = way_back(self._last.trajectory, self._last.progress)
        if back is None or self._off(back.start) > START_TOLERANCE:
            return None
        return back

    def state(self) -> Way | None:
        """What `way_back` depends on, for a checkpoint."""
        last = self._last
        if last is None:
            return None
        way = last.trajectory
        return Way(
            tuple(way.times.tolist()),
            tuple(map(tuple, way.position.tolist())),
            tuple(map(tuple, way.velocity.tolist())),
            tuple(map(tuple, way.acceleration.tolist())),
            last.progress,
        )

    def restore(self, way: Way | None) -> None:
        if way is None:
            self._last = None
            return
        trajectory = Trajectory(
            np.array(way.times), np.array(way.position), np.array(way.velocity), np.array(way.acceleration)
        )
        self._last = Track(trajectory, self._model, self._loop.period)
        self._last.progress = way.progress

    def _felt(self) -> tuple[float, float, float]:
        fx, fy, fz = (float(c) for c in self._loop.wrist.mean(12, self._loop.state.position)[:3])
        return (fx, fy, fz)

    def _carrying(self, felt: Array) -> Array:
        """Wrench (6,) about the TCP that balances what is felt at the wrist sensor's origin."""
        q = self._loop.state.position
        lever = np.array(self._model.flange(q).position) - np.array(self._model.tcp(q).position)
        return -np.concatenate([felt[:3], felt[3:] + np.cross(lever, felt[:3])])

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
    def _touched(force: Vector3, track: Track, node: str) -> Failure:
        size = math.hypot(*force)
        fraction = track.progress / max(track.trajectory.duration, 1e-9)
        return Failure(
            world.DISTURBED,
            f"touched something at {size:.0f} N on a free way, {fraction * 100:.0f} % done",
            force=size,
            direction=[round(c / size, 3) for c in force],
            fraction=fraction,
        )
