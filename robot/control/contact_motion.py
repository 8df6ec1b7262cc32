"""Guarded moves and compliant motions of the arm, each from rest to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from picktree.files import PicktreeError
from picktree.world import Array, Failure, Pose, Vector3, control, safety

from .admittance import REACTION_TIME, CartesianAdmittance
from .commands import Doing
from .compliant_motion import (
    FIRM_STIFFNESS,
    CartesianStiffness,
    CompliantMotion,
    GuardedMove,
    GuardedMoveResult,
)
from .impedance import CartesianImpedance
from .joint_controllers import HoldController
from .motion_lease import Lease
from .soft_limits import distance_to_workspace_edge
from .trajectory_motion import ZERO_TIME, TrajectoryMotion
from .wrist_wrench import TcpWrench

MAX_RIGID_TOUCH_SPEED = 0.015
"""Greatest speed at which an arm that takes positions meets a contact, m/s.

Its servo is rigid until the wrist sensor has felt the contact: 10 kg on 10⁵ N/m give 1 N for each mm/s,
and both fingers may meet a table at once. A latency adds to that.
"""
MAX_STANDSTILL_WAIT = 1.5
"""Longest wait for the arm to come to rest after a compliant motion, s."""


@dataclass(frozen=True, slots=True, eq=False)
class CompliantMotionResult:
    """Result of a compliant motion."""

    finished: bool
    """Whether the motion finished by itself with the tool at rest; else its time was over."""
    pose: Pose
    """TCP pose in the world where the arm came to rest."""
    force: float
    """Greatest contact force, N."""
    seconds: float
    zero: Array
    """Wrench (6,) without contact, N and Nm, world axes, about the sensor. It is the zero of a motion that
    begins in contact where this one ended."""


class ContactMotion(TrajectoryMotion):
    """Motions of the arm under Cartesian impedance, besides those along trajectories."""

    def guarded(
        self,
        direction: Vector3 | Array,
        distance: float,
        force: float,
        speed: float,
        *,
        node: str = "",
        press: float = 0.0,
        stiffness: CartesianStiffness = FIRM_STIFFNESS,
        zero: Array | None = None,
    ) -> Doing[GuardedMoveResult]:
        """Move the arm straight along `direction` (3,) in the world, orientation kept, until more than
        `force` N act against it.

        It travels at most `distance` m at `speed` m/s. Only guarded moves make contact on purpose.

        The force is relative to the wrist reading at rest just before, so it works with an object in the
        hand; a move away from a contact has the `zero` (6,) of the move that made it. At the contact the tool
        at rest presses with `press` N. The motion ends at rest. Raises
        safety.workspace or safety.joint_limit where the line leaves the workspace or a joint reaches its
        limit before a contact.
        """
        self._refuse_if_stopped()
        size = float(np.linalg.norm(direction))
        if not (size > 1e-9 and distance > 0.0 and force > 0.0 and speed > 0.0):
            raise PicktreeError("a guarded move needs a direction, and a distance, force and speed above 0")
        along = np.asarray(direction, dtype=np.float64) / size
        loop = self._loop
        with loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            self._last = None
            yield from loop.settle()
            self._check(lease)
            inside = distance_to_workspace_edge(loop.monitor.limits.workspace, loop.tcp.position, along)
            if inside <= 0.0:
                raise self._at_the_edge(along, 0.0, distance)
            if not loop.takes_torque:
                late = loop.hardware.latency
                speed = min(speed, MAX_RIGID_TOUCH_SPEED) * REACTION_TIME / (REACTION_TIME + late)
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
            spring, zero = yield from self._follow_course(lease, course, limit, stiffness, zero)
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
        return GuardedMoveResult(course.contact, travelled, course.pushed, loop.tcp, zero)

    def comply(
        self,
        course: CompliantMotion,
        limit: float,
        *,
        node: str = "",
        stiffness: CartesianStiffness = FIRM_STIFFNESS,
        zero: Array | None = None,
    ) -> Doing[CompliantMotionResult]:
        """Move the tool along a compliant motion as a damped spring, until that is finished or for `limit` s.

        The arm is then held at rest where it is.

        `zero` (6,): wrist wrench without a contact, from an earlier result. None: it is measured at rest
        before the motion begins, and the tool must not touch anything yet. Failures: safety.*
        (safety.joint_limit where a joint stops the motion), control.timeout.
        """
        self._refuse_if_stopped()
        if not limit > 0.0:
            raise PicktreeError("a compliant course needs a limit above 0 s")
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            self._last = None
            if zero is None:
                yield from self._loop.settle()
                self._check(lease)
            begun = self._clock.now
            spring, zero = yield from self._follow_course(lease, course, limit, stiffness, zero)
        if spring.blocked_by and not course.finished:
            raise Failure(
                safety.JOINT_LIMIT,
                f"{spring.blocked_by} comes to its limit on a compliant course",
                joint=spring.blocked_by,
            )
        return CompliantMotionResult(
            course.finished, self._loop.tcp, course.peak, self._clock.now - begun, zero
        )

    def _follow_course(
        self,
        lease: Lease,
        course: CompliantMotion,
        limit: float,
        stiffness: CartesianStiffness,
        zero: Array | None,
    ) -> Doing[tuple[CartesianImpedance, Array]]:
        """Move the arm until the motion is finished with the tool at rest, its time is over, or a joint is at
        its limit.

        The arm then holds its configuration.
        """
        loop, q = self._loop, self._loop.state.position
        if zero is None:
            zero = loop.wrist.over(ZERO_TIME, q)
        feeling = TcpWrench(loop.wrist, self._model, q, zero, loop.period)
        compliance = CartesianImpedance if loop.takes_torque else CartesianAdmittance
        spring = compliance(
            self._model, loop.period, course, stiffness, self._carrying(zero), feeling=feeling
        )
        if isinstance(spring, CartesianAdmittance):
            spring.latency = loop.hardware.latency
        lease.run(spring)
        until, stop = self._clock.now + limit, math.inf
        while True:
            yield
            self._check(lease)
            if course.finished:
                stop = min(stop, self._clock.now + MAX_STANDSTILL_WAIT)
                if course.standing:
                    break
            if (spring.blocked_by and not course.finished) or self._clock.now > min(until, stop):
                break
        lease.run(HoldController())
        yield
        self._check(lease)
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
