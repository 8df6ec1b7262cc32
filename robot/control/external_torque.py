"""External torques on the arm, wherever they act: efforts that its motion, weight and wrist reading do not
explain.

The Newton-Euler equations give the torques for the arm's motion up to the wrist. The wrist sensor reads
everything beyond: hand, load and contacts. A residual is a contact at the arm itself, a faulty joint, or a
faulty wrist sensor. De Luca & Mattone 2005 define this residual; here the encoders give the acceleration, so
`EffortCheck` needs no observer.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from picktree.world import GRAVITY, Array, JointState, Wrench
from picktree.world.robot_model import RobotModel, beyond_flange, joint_frame


def bare_arm(model: RobotModel) -> pin.Model:
    """Return the arm's dynamics without the bodies beyond the flange joint, whose frame is kept.

    The negated wrist reading is then the only force on it, independent of mass and motion of hand and load.
    """
    full, joint = model.full, model.description.flange_joint
    data = full.createData()
    pin.framesForwardKinematics(full, data, pin.neutral(full))
    hand = pin.Inertia.Zero()
    for index, inertia, moves in beyond_flange(full, joint):
        placement = data.oMi[full.frames[index].parentJoint] if moves else data.oMf[index]
        hand = hand + placement.act(inertia)
    arm = model.arm.copy()
    last = arm.frames[joint_frame(arm, joint)].parentJoint
    carried = data.oMi[full.frames[joint_frame(full, joint)].parentJoint].inverse().act(hand)
    arm.inertias[last] = arm.inertias[last] - carried
    return arm


MIN_EXPLAINED_SHARE = 0.5
"""Least share of a claimed force that the joints must carry for it to be believed."""


class EffortCheck:
    """Residual of the joints' efforts of one robot. Torques are (n,) in Nm."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._arm = bare_arm(model)
        self._data = self._arm.createData()
        self._flange = joint_frame(self._arm, model.description.flange_joint)
        self._limit = model.torque_limit

    def unexplained(self, state: JointState, acceleration: Array, wrench: Wrench) -> Array:
        """Return the effort (n,), Nm, beyond that of motion and wrist reading; `acceleration` (n,) rad/s²."""
        return self._beyond(state, acceleration, np.array((*wrench.force, *wrench.torque)))

    def without_wrist(self, state: JointState, acceleration: Array, carried: Array) -> Array:
        """Return the unexplained effort when nothing touches the hand.

        The hand carries itself and exerts `carried` (6,) on the wrist, world axes about the sensor. The
        hand's own acceleration is neglected.
        """
        return self._beyond(state, acceleration, self._hand(state.position) + carried)

    def believes(self, state: JointState, claimed: Array, carried: Array) -> bool:
        """Return whether the joints, at rest, carry the wrench that the wrist claims.

        `claimed`: wrench beyond hand and known load, `carried`: wrench of that load; both (6,), world axes
        about the sensor. A sensor whose bias has jumped claims a wrench that no joint carries.
        """
        still = np.zeros_like(state.position)
        rest = JointState(state.position, still, state.effort)
        borne = self._beyond(rest, still, self._hand(state.position) + carried) / self._limit
        expected = -self._jacobian().T @ claimed / self._limit
        size = float(expected @ expected)
        return size <= 0.0 or float(borne @ expected) > MIN_EXPLAINED_SHARE * size

    def _beyond(self, state: JointState, acceleration: Array, on_wrist: Array) -> Array:
        needed = pin.rnea(self._arm, self._data, state.position, state.velocity, acceleration)
        pin.computeJointJacobians(self._arm, self._data, state.position)
        return state.effort - needed + self._jacobian().T @ on_wrist

    def _jacobian(self) -> Array:
        """Return the Jacobian (6, n) of the sensor's origin, at the joint placements of the last
        computation."""
        return pin.getFrameJacobian(self._arm, self._data, self._flange, pin.LOCAL_WORLD_ALIGNED)

    def _hand(self, q: Array) -> Array:
        """Return the wrench (6,) of the hand on the wrist at rest."""
        x, y, _ = (self._model.flange(q).rotation() @ np.array(self._model.hand_com)).tolist()
        weight = self._model.hand_mass * GRAVITY
        return np.array([0.0, 0.0, -weight, -y * weight, x * weight, 0.0])


OBSERVER_GAIN = 40.0
"""Gain of the observer, 1/s: a contact shows after 25 ms."""


class ExternalTorqueObserver:
    """Observer of the external torques of all joints, from encoders and commanded torques, without
    accelerations.

    Drives and contacts change the generalised momentum p = M v. The part that the drives do not explain is
    external: r = K (p − p₀ − ∫ (τ + Cᵀ v − g + r) dt). De Luca, Albu-Schäffer, Haddadin and Hirzinger,
    "Collision detection and safe reaction with the DLR-III lightweight manipulator arm", IROS 2006.
    """

    def __init__(
        self, model: RobotModel, period: float, torque: Array | None = None, gain: float = OBSERVER_GAIN
    ) -> None:
        """`torque` (n,): external torques at the start, Nm. None: zero."""
        self._model = model
        self._arm = model.arm
        self._data = model.arm.createData()
        self._period = period
        self._gain = gain
        self._sum: Array | None = None
        self.torque: Array = np.zeros(model.n) if torque is None else torque
        """External torques (n,), Nm; zero when only the arm's own weight and drives act."""

    def watch(self, state: JointState, driven: Array) -> Array:
        """Add a control period in which the drives exerted `driven` (n,) Nm, and return the external torques
        (n,), Nm."""
        arm, data, q, v = self._arm, self._data, state.position, state.velocity
        momentum = self._model.mass_matrix(q) @ v
        coriolis = pin.computeCoriolisMatrix(arm, data, q, v)
        known = driven + coriolis.T @ v - pin.computeGeneralizedGravity(arm, data, q)
        if self._sum is None:
            self._sum = momentum - self.torque / self._gain - (known + self.torque) * self._period
        self._sum = self._sum + (known + self.torque) * self._period
        self.torque = self._gain * (momentum - self._sum)
        return self.torque


def static_external_torque(model: RobotModel, state: JointState) -> Array:
    """Return the external torques (n,), Nm, on an arm at rest, from its efforts."""
    return model.gravity(state.position) - state.effort
