"""Motions as generators: each yield is one tick, the return is the arrival, halting brakes."""

from __future__ import annotations

import math

import numpy as np

from ...errors import PicktreeError
from ...robots.model import RobotModel
from ...world.causes import Failure
from ...world.journal import Journal
from ...world.protocols import Clock
from ...world.trajectory import Trajectory
from ...world.values import Array, Vector3
from ..cartesian.compliant_motion import FIRM, CartesianStiffness, CompliantMotion
from ..contact.guarded_move import GuardedMoveResult
from ..joints.soft_contact import ContactThresholds, JointImpedanceResult
from ..joints.soft_controller import JointImpedanceController
from ..safety.motion_lease import ForceGuard
from .contact_motion import CompliantMotionResult, CompliantMotionRunner
from .control_loop import ControlLoop
from .jog_motion import JogMotion, JogResult, Lookout, Twists
from .soft_motion import JointImpedanceMotion, slowed_trajectory
from .trajectory_motion import Doing, TrajectoryCheck, TrajectoryMotion

JOG_GUARD = 25.0
"""Contact force that stops a jog unless the caller says otherwise, N."""


class ArmMotion(TrajectoryMotion):
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
        super().__init__(loop, model, clock, gate)
        self._jogging = JogMotion(loop, model, lookout, tick)
        self._touching = CompliantMotionRunner(loop, model, clock)
        self._soft = JointImpedanceMotion(loop, model, clock)
        self._journal = journal

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

    def settle(self) -> Doing[None]:
        """Yield until vibrations have decayed; gives up waiting after a second."""
        return self._loop.settle()

    def slowed(self, trajectory: Trajectory, speed: float) -> Trajectory:
        """The same way, slower where need be: no part of the arm goes faster than `speed` m/s."""
        return slowed_trajectory(self._model, trajectory, speed)
