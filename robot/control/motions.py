"""Motions of the arm for skills, as generators: each yield is one tick, the return is the arrival, a halt
brakes.

Motions under joint impedance, from rest to rest: along a trajectory, or gravity compensation to release
pressure.
"""

from __future__ import annotations

import math

import numpy as np

from picktree.files import PicktreeError
from picktree.world import Clock, Failure, Journal, Trajectory, Vector3, control
from picktree.world.robot_model import RobotModel

from .admittance import AdmittanceReflex, AdmittanceTrack
from .commands import ContactThresholds, Doing, JointImpedanceResult
from .contact_motion import ContactMotion
from .control_loop import ControlLoop
from .external_torque import static_external_torque
from .force_guard import ForceGuard
from .impedance import YIELD_TIME, GravityCompensationController, JointImpedanceController, slowed_trajectory
from .jog_motion import JogMotion, JogResult, Lookout, Twists
from .joint_controllers import HoldController
from .trajectory_motion import TrajectoryCheck

MAX_SOFT_DELAY = 2.0
"""Longest duration of a soft motion beyond that of its trajectory, s."""


JOG_GUARD = 25.0
"""Contact force that stops a jog by default, N."""


class ArmMotion(ContactMotion):
    """Motions of the arm that skills use. One motion at a time: a motion that starts takes the arm from the
    one before."""

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
        """`gate`: check that trajectories must pass. None: the arm follows any trajectory that begins at its
        configuration.

        `lookout`: collision query for the path ahead of a jog, in each `tick` s.
        """
        super().__init__(loop, model, clock, gate)
        self._jogging = JogMotion(loop, model, lookout, tick)
        self._journal = journal

    def softly(
        self,
        trajectory: Trajectory,
        least: ContactThresholds,
        *,
        carried: Vector3 = (0.0, 0.0, 0.0),
        node: str = "",
        leaving: bool = False,
    ) -> Doing[JointImpedanceResult]:
        """Move the arm along `trajectory` under joint impedance, and give way to the first contact at any
        part of it.

        `carried` (3,): weight on the tool, N in the world. It ends at rest, and the result describes the end;
        a contact is no failure.

        `leaving`: the path leads out of a believed collision, and the caller has checked it. Otherwise it
        passes the gate as in `along`. Failures: those of the gate, control.timeout, safety.*.
        """
        self._refuse_if_stopped()
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            gate = None if leaving else self._gate
            if gate is not None:
                yield from gate.passes(trajectory)
                self._check(lease)
            self._check_start(trajectory)

            track = self._soft_track(trajectory, least, carried)
            self._last = track
            lease.run(track)
            limit = self._clock.now + trajectory.duration + YIELD_TIME + MAX_SOFT_DELAY
            noticed: Failure | None = None
            while not (track.done and self._loop.at_rest):
                if self._clock.now > limit:
                    raise Failure(control.TIMEOUT, "a soft motion did not come to its end")
                yield
                self._check(lease)
                if noticed is None and gate is not None:
                    noticed = gate.blocked(trajectory, track.progress)
                    if noticed is not None:
                        track.brake()
        done = track.completed and not track.touched
        return JointImpedanceResult(
            done, track.progress, track.touched, track.torque, track.force, track.push, noticed
        )

    def _soft_track(
        self, trajectory: Trajectory, least: ContactThresholds, carried: Vector3
    ) -> JointImpedanceController | AdmittanceTrack:
        loop = self._loop
        if not loop.takes_torque:
            return AdmittanceTrack(
                trajectory,
                self._model,
                loop.period,
                wrist=loop.wrist,
                force=least.force,
                latency=loop.hardware.latency,
            )
        return JointImpedanceController(
            trajectory,
            self._model,
            loop.period,
            wrist=loop.wrist,
            carried=np.array(carried),
            torque=least.torque,
            force=least.force,
        )

    def pressed(self, carried: Vector3 = (0.0, 0.0, 0.0)) -> float:
        """Return the external torque on the arm at rest, without the load, Euclidean norm over the joints,
        Nm.

        It shows contacts at any part of the arm; of an arm that takes positions, those at the hand. `carried`
        (3,): weight on the tool, N in the world.
        """
        state = self._loop.state
        if not self._loop.takes_torque:
            push = np.array(self._loop.wrist.force) - np.array(carried)
            return float(np.linalg.norm(self._model.jacobian(state.position)[:3].T @ push))
        hanging = self._model.jacobian(state.position)[:3].T @ np.array(carried)
        return float(np.linalg.norm(static_external_torque(self._model, state) - hanging))

    def give_way(
        self, carried: Vector3 = (0.0, 0.0, 0.0), limit: float = 1.0, *, node: str = ""
    ) -> Doing[float]:
        """Let the arm yield to contact forces for at most `limit` s, and return the remaining torque, Nm.

        `carried` (3,): weight on the tool, N in the world. Failures: safety.*, control.timeout.
        """
        self._refuse_if_stopped()
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            loop, load = self._loop, np.array(carried)
            giving = (
                GravityCompensationController(self._model, loop.period, load)
                if loop.takes_torque
                else AdmittanceReflex(
                    self._model, loop.period, loop.wrist, load, latency=loop.hardware.latency, ends=False
                )
            )
            lease.run(giving)
            until = self._clock.now + limit
            while not giving.calm and self._clock.now < until:
                yield
                self._check(lease)
            lease.run(HoldController())
            while not self._loop.at_rest:
                if self._clock.now > until + MAX_SOFT_DELAY:
                    raise Failure(control.TIMEOUT, "the arm does not come to rest after it gave way")
                yield
                self._check(lease)
        return giving.pressed if math.isfinite(giving.pressed) else 0.0

    def jog(
        self,
        twists: Twists,
        *,
        node: str = "",
        guard: float = JOG_GUARD,
        duration: float = math.inf,
        distance: float = math.inf,
    ) -> Doing[JogResult]:
        """Move the tool by a constant twist, or by a callable that returns the twist of each tick.

        None from the callable ends the jog. A constant twist ends after `duration` s or `distance` m of TCP
        travel, or at the first of these limits, which the result names: a contact of more than `guard` N, a
        joint limit, a singularity, the workspace's edge, or a predicted collision. The jog slows down for all
        of them, and ends at rest. Failures: safety.*, control.timeout when the skill was not ticked for a
        while.
        """
        self._refuse_if_stopped()
        if not (guard > 0.0 and duration > 0.0 and distance > 0.0):
            raise PicktreeError("a jog needs a guard, a duration and a distance above 0")
        with self._loop.acquire(node) as lease:
            yield from self._until_rest(lease)
            self._check(lease)
            self._last = None
            touch = ForceGuard(guard, self._contact_force())
            return (
                yield from self._jogging.run(
                    lease, twists, touch, duration, distance, self._check, self._until_rest
                )
            )

    def settle(self) -> Doing[None]:
        """Yield until vibrations have decayed; at most one second."""
        return self._loop.settle()

    def slowed(self, trajectory: Trajectory, speed: float) -> Trajectory:
        """Return the trajectory on the same path, slowed down where a part of the arm would exceed `speed`
        m/s or hit an obstacle hard."""
        return slowed_trajectory(self._model, trajectory, speed)
