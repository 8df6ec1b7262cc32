"""Motions under joint impedance, from rest to rest: along a trajectory, or gravity compensation to release
pressure."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np
import pinocchio as pin

from ...robots.model import RobotModel
from ...world.causes import Failure, control
from ...world.protocols import Clock
from ...world.trajectory import Trajectory
from ...world.values import Array, Vector3
from ..commands import ContactThresholds, JointImpedanceResult
from ..joints.external_torque import static_external_torque
from ..joints.joint_controllers import HoldController
from ..joints.soft_controller import (
    YIELD_TIME,
    GravityCompensationController,
    JointImpedanceController,
)

if TYPE_CHECKING:
    from ..safety.motion_lease import Lease
    from .control_loop import ControlLoop


T = TypeVar("T")
Doing: TypeAlias = Generator[None, None, T]

MAX_SOFT_DELAY = 2.0
"""Longest duration of a soft motion beyond that of its trajectory, s."""


class JointImpedanceMotion:
    """Motions of a loop's arm under joint impedance. The caller holds the lease, and the arm is at rest."""

    def __init__(self, loop: ControlLoop, model: RobotModel, clock: Clock) -> None:
        self._loop = loop
        self._model = model
        self._clock = clock

    def pressed(self, carried: Vector3) -> float:
        """Return the external torque on the resting arm, Euclidean norm over the joints, Nm.

        It shows contacts at any part of the arm. The weight `carried` (3,), N in the world, on the tool is
        taken off.
        """
        state = self._loop.state
        hanging = self._model.jacobian(state.position)[:3].T @ np.array(carried)
        return float(np.linalg.norm(static_external_torque(self._model, state) - hanging))

    def follow(
        self,
        lease: Lease,
        trajectory: Trajectory,
        carried: Vector3,
        least: ContactThresholds,
        check: Callable[[Lease], None],
        watch: Callable[[float], Failure | None],
        began: Callable[[JointImpedanceController], None],
    ) -> Doing[JointImpedanceResult]:
        """Move the arm along the trajectory until its end, a contact, or a failure from `watch`.

        `watch` receives the progress, s, in each tick.
        """
        track = JointImpedanceController(
            trajectory,
            self._model,
            self._loop.period,
            wrist=self._loop.wrist,
            carried=np.array(carried),
            torque=least.torque,
            force=least.force,
        )
        began(track)
        lease.run(track)
        limit = self._clock.now + trajectory.duration + YIELD_TIME + MAX_SOFT_DELAY
        noticed: Failure | None = None
        while True:
            yield
            check(lease)
            if noticed is None:
                noticed = watch(track.progress)
                if noticed is not None:
                    track.brake()
            if track.done and self._loop.at_rest:
                break
            if self._clock.now > limit:
                raise Failure(control.TIMEOUT, "a soft motion did not come to its end")
        done = track.completed and not track.touched
        return JointImpedanceResult(
            done, track.progress, track.touched, track.torque, track.force, track.push, noticed
        )

    def give_way(
        self, lease: Lease, carried: Vector3, limit: float, check: Callable[[Lease], None]
    ) -> Doing[float]:
        """Let the arm drift where something pushes, for at most `limit` s, then hold it.

        Returns the remaining external torque, Nm.
        """
        giving = GravityCompensationController(self._model, self._loop.period, np.array(carried))
        lease.run(giving)
        until = self._clock.now + limit
        while not giving.calm and self._clock.now < until:
            yield
            check(lease)
        lease.run(HoldController())
        while not self._loop.at_rest:
            if self._clock.now > until + MAX_SOFT_DELAY:
                raise Failure(control.TIMEOUT, "the arm does not come to rest after it gave way")
            yield
            check(lease)
        return giving.pressed if math.isfinite(giving.pressed) else 0.0


def slowed_trajectory(model: RobotModel, trajectory: Trajectory, speed: float) -> Trajectory:
    """Return the trajectory on the same path, slowed down so that neither tool nor joints exceed `speed`
    m/s."""
    data = model.arm.createData()
    at: list[Array] = []
    for q in trajectory.position:
        pin.forwardKinematics(model.arm, data, q)
        tool = pin.updateFramePlacement(model.arm, data, model.tcp_frame)
        at.append(np.array([*(place.translation for place in data.oMi), tool.translation]))
    ways = np.linalg.norm(np.diff(np.array(at), axis=0), axis=2).max(axis=1)
    fastest = float((ways / np.diff(trajectory.times)).max(initial=0.0))
    share = max(1.0, fastest / speed)
    return Trajectory(
        trajectory.times * share,
        trajectory.position,
        trajectory.velocity / share,
        trajectory.acceleration / share**2,
    )
