"""Do the joints' efforts fit to what the arm does, and to what the wrist says?

Newton and Euler tell which torques the motion of the arm up to the wrist needs; the wrist tells all that acts
on it from beyond: hand, load and contacts. What is left is something that touches the arm itself, a joint
that is not what it was, or a wrist that lies. (De Luca & Mattone 2005 call it the residual; here the
acceleration is known from the encoders, so that no observer is needed.)
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ...robots.model import RobotModel
from ...robots.unloaded_arm import bare_arm
from ...world.values import GRAVITY, Array, JointState, Wrench

EXPLAINED = 0.5
"""Share of a force that the joints must carry for it to be believed to be there."""


class Efforts:
    """For one robot. Torques (n,) in Nm."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._arm = bare_arm(model)
        self._data = self._arm.createData()
        self._flange = self._arm.getFrameId(model.description.flange_joint)
        self._limit = model.torque_limit

    def unexplained(self, state: JointState, acceleration: Array, wrench: Wrench) -> Array:
        """Effort beyond what motion and the wrist's reading explain; `acceleration` (n,) rad/s²."""
        return self._beyond(state, acceleration, np.array((*wrench.force, *wrench.torque)))

    def without_wrist(self, state: JointState, acceleration: Array, carried: Array) -> Array:
        """The same when nothing touches the hand: it carries itself, and exerts `carried` (6,) on the wrist
        besides, world axes about the sensor. The hand's own acceleration is left out."""
        return self._beyond(state, acceleration, self._hand(state.position) + carried)

    def believes(self, state: JointState, claimed: Array, carried: Array) -> bool:
        """Whether the joints, at rest, bear what the wrist claims to feel beyond the hand and what that is
        known to carry: both (6,), world axes about the sensor. A sensor whose bias has jumped claims what no
        joint bears."""
        still = np.zeros_like(state.position)
        rest = JointState(state.position, still, state.effort)
        borne = self._beyond(rest, still, self._hand(state.position) + carried) / self._limit
        expected = -self._jacobian().T @ claimed / self._limit
        size = float(expected @ expected)
        return size <= 0.0 or float(borne @ expected) > EXPLAINED * size

    def _beyond(self, state: JointState, acceleration: Array, on_wrist: Array) -> Array:
        needed = pin.rnea(self._arm, self._data, state.position, state.velocity, acceleration)
        pin.computeJointJacobians(self._arm, self._data, state.position)
        return state.effort - needed + self._jacobian().T @ on_wrist

    def _jacobian(self) -> Array:
        """(6, n) of the sensor's origin; joint placements are those of the last call."""
        return pin.getFrameJacobian(self._arm, self._data, self._flange, pin.LOCAL_WORLD_ALIGNED)

    def _hand(self, q: Array) -> Array:
        """(6,) what the hand at rest exerts on the wrist."""
        x, y, _ = (self._model.flange(q).rotation() @ np.array(self._model.hand_com)).tolist()
        weight = self._model.hand_mass * GRAVITY
        return np.array([0.0, 0.0, -weight, -y * weight, x * weight, 0.0])
