"""Guarded moves and compliant motions of the arm, each from rest to rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import numpy as np

from picktree.world import Array, Clock, Failure, Pose, control, safety
from picktree.world.robot_model import RobotModel

from .compliant_motion import CartesianStiffness, CompliantMotion, GuardedMove, GuardedMoveResult
from .control_loop import ControlLoop
from .impedance import CartesianImpedance
from .joint_controllers import HoldController
from .motion_lease import Lease
from .soft_limits import distance_to_workspace_edge
from .wrist_wrench import TcpWrench

T = TypeVar("T")
Doing: TypeAlias = Generator[None, None, T]

ZERO_TIME = 0.05
"""Time over which readings at rest are averaged as the wrench without contact, s."""
MAX_STANDSTILL_WAIT = 1.5
"""Longest wait for the arm to stand after a compliant motion, s."""


@dataclass(frozen=True, slots=True, eq=False)
class CompliantMotionResult:
    """Result of a compliant motion."""

    finished: bool
    """Whether the motion finished by itself and the tool stood; else its time was over."""
    pose: Pose
    """TCP pose in the world where the arm came to rest."""
    force: float
    """Greatest contact force, N."""
    seconds: float
    zero: Array
    """Wrench (6,) without contact, N and Nm, world axes, about the sensor. It is the zero of a motion that
    begins in contact where this one ended."""


class CompliantMotionRunner:
    """Motions of a loop's arm under Cartesian impedance. The caller holds the lease, and the arm is at
    rest."""

    def __init__(self, loop: ControlLoop, model: RobotModel, clock: Clock) -> None:
        self._loop = loop
        self._model = model
        self._clock = clock

    def guarded(
        self,
        lease: Lease,
        along: Array,
        distance: float,
        force: float,
        speed: float,
        press: float,
        stiffness: CartesianStiffness,
        check: Callable[[Lease], None],
    ) -> Doing[GuardedMoveResult]:
        """Move the arm as `ArmMotion.guarded`; `along` is a unit vector (3,)."""
        loop = self._loop
        yield from loop.settle()
        check(lease)
        inside = distance_to_workspace_edge(loop.monitor.limits.workspace, loop.tcp.position, along)
        if inside <= 0.0:
            raise self._at_the_edge(along, 0.0, distance)
        course = GuardedMove(
            along,
            min(distance, inside),
            force=force,
            speed=speed,
            press=press,
            stiffness=stiffness.along(along, loop.tcp.rotation()),
        )
        begin = np.array(loop.tcp.position)
        limit = 4.0 * distance / speed + speed + MAX_STANDSTILL_WAIT  # slower near a singularity
        spring, _ = yield from self._follow(lease, course, limit, stiffness, None, check)
        travelled = float(along @ (np.array(loop.tcp.position) - begin))
        if not course.finished and spring.blocked_by:
            raise Failure(
                safety.JOINT_LIMIT,
                f"{spring.blocked_by} comes to its limit after {travelled * 1000:.0f} mm of a guarded "
                f"move of {distance * 1000:.0f} mm",
                joint=spring.blocked_by,
                travelled=travelled,
            )
        if course.finished and not course.contact and inside < distance:
            raise self._at_the_edge(along, travelled, distance)
        if not course.finished:
            raise Failure(
                control.TIMEOUT,
                f"a guarded move of {distance * 1000:.0f} mm did not end in time",
                force=course.pushed,
            )
        return GuardedMoveResult(course.contact, travelled, course.pushed, loop.tcp)

    def comply(
        self,
        lease: Lease,
        course: CompliantMotion,
        limit: float,
        stiffness: CartesianStiffness,
        zero: Array | None,
        check: Callable[[Lease], None],
    ) -> Doing[CompliantMotionResult]:
        """Move the arm as `ArmMotion.comply`."""
        if zero is None:
            yield from self._loop.settle()
            check(lease)
        begun = self._clock.now
        spring, zero = yield from self._follow(lease, course, limit, stiffness, zero, check)
        if spring.blocked_by and not course.finished:
            raise Failure(
                safety.JOINT_LIMIT,
                f"{spring.blocked_by} comes to its limit on a compliant course",
                joint=spring.blocked_by,
            )
        return CompliantMotionResult(
            course.finished, self._loop.tcp, course.peak, self._clock.now - begun, zero
        )

    def _follow(
        self,
        lease: Lease,
        course: CompliantMotion,
        limit: float,
        stiffness: CartesianStiffness,
        zero: Array | None,
        check: Callable[[Lease], None],
    ) -> Doing[tuple[CartesianImpedance, Array]]:
        """Move the arm until the motion is finished and the tool stands, its time is over, or a joint is at
        its limit.

        The arm is then held where it is.
        """
        loop, q = self._loop, self._loop.state.position
        if zero is None:
            zero = loop.wrist.over(ZERO_TIME, q)
        feeling = TcpWrench(loop.wrist, self._model, q, zero, loop.period)
        spring = CartesianImpedance(
            self._model, loop.period, course, stiffness, self._carrying(zero), feeling=feeling
        )
        lease.run(spring)
        until, stop = self._clock.now + limit, math.inf
        while True:
            yield
            check(lease)
            if course.finished:
                stop = min(stop, self._clock.now + MAX_STANDSTILL_WAIT)
                if course.standing:
                    break
            if (spring.blocked_by and not course.finished) or self._clock.now > min(until, stop):
                break
        lease.run(HoldController())
        yield
        check(lease)
        return spring, zero

    def _carrying(self, felt: Array) -> Array:
        """Return the wrench (6,) about the TCP that balances `felt` (6,) at the wrist sensor's origin."""
        q = self._loop.state.position
        lever = np.array(self._model.flange(q).position) - np.array(self._model.tcp(q).position)
        return -np.concatenate([felt[:3], felt[3:] + np.cross(lever, felt[:3])])

    def _at_the_edge(self, along: Array, travelled: float, distance: float) -> Failure:
        at = self._loop.tcp.position
        return Failure(
            safety.WORKSPACE,
            f"a guarded move of {distance * 1000:.0f} mm comes to the edge of the workspace after "
            f"{travelled * 1000:.0f} mm, without a contact",
            travelled=travelled,
            position=[round(c, 4) for c in at],
            direction=[round(float(c), 3) for c in along],
        )
