"""What pushes at the arm, wherever it does: the torques that its own drives and weight do not explain.

Do the joints' efforts fit to what the arm does, and to what the wrist says?

Newton and Euler tell which torques the motion of the arm up to the wrist needs; the wrist tells all that acts
on it from beyond: hand, load and contacts. What is left is something that touches the arm itself, a joint
that is not what it was, or a wrist that lies. (De Luca & Mattone 2005 call it the residual; here the
acceleration is known from the encoders, so that no observer is needed.)
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ...robots.model import RobotModel
from ...world.values import GRAVITY, Array, JointState, Wrench


def bare_arm(model: RobotModel) -> pin.Model:
    """The arm's dynamics with nothing beyond the flange joint, whose frame is kept.

    What the wrist sensor reads, turned around, is then all that acts on it: hand, load and contacts alike,
    whatever they weigh and however they are accelerated.
    """
    full, joint = model.full, model.description.flange_joint
    data = full.createData()
    pin.framesForwardKinematics(full, data, pin.neutral(full))
    flange = full.frames[full.getFrameId(joint)]
    beyond = {full.getFrameId(joint)}
    hand = pin.Inertia.Zero()
    for index, frame in enumerate(full.frames):
        if index not in beyond:
            if frame.parentFrame not in beyond:
                continue
            beyond.add(index)
        moves = frame.parentJoint != flange.parentJoint
        if moves and frame.type == pin.JOINT:
            # A moving joint's inertia already holds what is fixed to it.
            hand = hand + data.oMi[frame.parentJoint].act(full.inertias[frame.parentJoint])
        elif not moves:
            hand = hand + data.oMf[index].act(frame.inertia)
    arm = model.arm.copy()
    last = arm.frames[arm.getFrameId(joint)].parentJoint
    carried = data.oMi[flange.parentJoint].inverse().act(hand)
    arm.inertias[last] = arm.inertias[last] - carried
    return arm


EXPLAINED = 0.5
"""Share of a force that the joints must carry for it to be believed to be there."""


class EffortCheck:
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


GAIN = 40.0
"""Of the observer, 1/s: a contact shows after 25 ms."""


class ExternalTorqueObserver:
    """External torques of all joints from encoders and commanded torques, without accelerations.

    The generalised momentum p = M v changes by what drives the joints; what it changes beyond that came from
    outside: r = K (p − p₀ − ∫ (τ + Cᵀ v − g + r) dt). De Luca, Albu-Schäffer, Haddadin and Hirzinger,
    "Collision detection and safe reaction with the DLR-III lightweight manipulator arm", IROS 2006.
    """

    def __init__(self, model: RobotModel, period: float, gain: float = GAIN) -> None:
        self._model = model
        self._arm = model.arm
        self._data = model.arm.createData()
        self._period = period
        self._gain = gain
        self._sum: Array | None = None
        self.torque: Array = np.zeros(model.n)
        """(n,) external torques, Nm; zero where nothing but the arm's own weight and drives act."""

    def watch(self, state: JointState, driven: Array) -> Array:
        """One control period has passed, in which the drives gave `driven` (n,) Nm: the torques now."""
        arm, data, q, v = self._arm, self._data, state.position, state.velocity
        momentum = self._model.mass_matrix(q) @ v
        coriolis = pin.computeCoriolisMatrix(arm, data, q, v)
        known = driven + coriolis.T @ v - pin.computeGeneralizedGravity(arm, data, q)
        if self._sum is None:
            self._sum = momentum - known * self._period
        self._sum = self._sum + (known + self.torque) * self._period
        self.torque = self._gain * (momentum - self._sum)
        return self.torque


def static_external_torque(model: RobotModel, state: JointState) -> Array:
    """External torques (n,), Nm, on an arm that stands, from what its drives give."""
    return model.gravity(state.position) - state.effort
