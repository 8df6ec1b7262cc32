"""Motors of a gripper's linkage, and the torques of gears that the engine leaves out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from picktree.files import PicktreeError
from picktree.world import (
    Array,
    GripperCommand,
    Pose,
    Quaternion,
    Vector3,
    rotated,
)
from picktree.world.robot_model import (
    GripperDescription,
    LinkageFingers,
    RobotDescription,
    RobotModel,
    beyond_flange,
)

from .engine import pb

MISSING_GEAR_SHARE = 0.86
"""Share of the gear's reaction on the hand that the engine leaves out of the joint feedback.

With a contact at one finger the feedback contains 12 to 17 % of the force that the arm's joints hold. Of the
fingers' own weight it contains as little. The torque is right without a correction.
"""


class GearReaction:
    """Gear reaction between two sliding fingers, which the wrist reading lacks.

    A force on one finger along its slide reaches the hand by the gear alone, and has to be added at the
    wrist.
    """

    def __init__(self, gear: int, body: int, slider: int, flange: int, client: int) -> None:
        """`gear`: the constraint; `slider`: joint of the gear's first finger; `flange`: joint of the wrist
        sensor."""
        self._gear = gear
        self._client = client
        hand = pb.getLinkState(body, flange, 0, 1, client)
        finger = pb.getLinkState(body, slider, 0, 1, client)
        finger_in_hand = Pose(hand[4], hand[5]).inverse() @ Pose(finger[4], finger[5])
        self._axis: Vector3 = rotated(finger_in_hand.orientation, pb.getJointInfo(body, slider, client)[13])

    def read(self, turn: Quaternion, position: Sequence[float]) -> Vector3:
        """Return the missing force on the wrist in the world's axes, N.

        `turn`: the hand's orientation in the world; `position`: that of the arm's joints, then of the
        fingers', rad or m.
        """
        force = -2.0 * MISSING_GEAR_SHARE * pb.getConstraintState(self._gear, self._client)[0]
        x, y, z = rotated(turn, self._axis)
        return (force * x, force * y, force * z)


MAX_STALE_MOTION = 0.1
"""Greatest motion of a joint after which the response to the knuckles' gear is computed again, rad."""


class KnuckleGearReaction:
    """Gear reaction between two knuckles, which the wrist reading lacks.

    The engine leaves the gear's torques out of its joint feedback, as if they accelerated the robot. The
    reading misses the momentum that they would give the hand in a second: M⁻¹ of the whole robot times these
    torques, summed over the masses of the hand.
    """

    def __init__(self, gear: int, robot: RobotDescription, ratio: float, client: int) -> None:
        """`gear`: the constraint; `ratio`: its ratio."""
        linkage = robot.gripper.linkage
        if linkage is None:
            raise PicktreeError("the gripper has no linkage")
        self._gear, self._client = gear, client
        self._model = model = RobotModel(robot)
        self._data = model.full.createData()
        self._torques: Array = np.zeros(model.full.nv)
        for name, share in zip(linkage.knuckles, (1.0, ratio), strict=True):
            self._torques[model.full.joints[model.full.getJointId(name)].idx_v] = share
        self._bodies: list[tuple[int, float, Array]] = []
        """Parent joint, mass, kg, and centre of mass in the joint's frame, m, of each part of the hand."""
        for index, inertia, moves in beyond_flange(model.full, robot.flange_joint):
            frame = model.full.frames[index]
            centre = inertia.lever.copy() if moves else frame.placement.act(inertia.lever)
            self._bodies.append((frame.parentJoint, inertia.mass, centre))
        self._response_position: Array | None = None
        self._response: Array = np.zeros(3)

    def read(self, turn: Quaternion, position: Sequence[float]) -> Vector3:
        """Return the missing force on the wrist as `GearReaction` does."""
        now = np.array(position)
        if (
            self._response_position is None
            or float(np.abs(now - self._response_position).max()) > MAX_STALE_MOTION
        ):
            self._response_position, self._response = now, self._respond(now)
        x, y, z = (-pb.getConstraintState(self._gear, self._client)[0] * self._response).tolist()
        return (x, y, z)

    def _respond(self, position: Array) -> Array:
        """Return the rate of the hand's momentum (3,) in the world's axes, N, for a gear torque of 1 Nm."""
        model, full, data = self._model, self._model.full, self._data
        q = model.full_q(position[: model.n], model.fingers.width(position[model.n :].tolist()))
        acceleration = np.linalg.solve(pin.crba(full, data, q), self._torques)
        pin.computeJointJacobians(full, data, q)
        rate = np.zeros(3)
        for joint, mass, lever in self._bodies:
            jacobian = pin.getJointJacobian(full, data, joint, pin.LOCAL_WORLD_ALIGNED)
            linear, angular = jacobian[:3] @ acceleration, jacobian[3:] @ acceleration
            rate += mass * (linear + np.cross(angular, data.oMi[joint].rotation @ lever))
        return rate


KNUCKLE_GAIN = 0.2
"""Share of a knuckle's error that one step removes."""


BAR_GAIN = 1.0
"""Share of the error of a joint beyond a knuckle that one step removes."""


MAX_BAR_TORQUE_FACTOR = 3.0
"""Greatest torque of the bars that is passed on, as a multiple of the knuckle's own torque."""


MAX_BAR_TORQUE = 200.0
"""Greatest torque of the bars that keep a finger upright, Nm."""


@dataclass(frozen=True, slots=True)
class _Held:
    """Joint that is held at by · (position of joint `of`) + offset."""

    joint: int
    of: int
    by: float
    offset: float


class LinkageMotors:
    """Motors of one gripper. The only state is the command; the motors' targets follow from the joints."""

    def __init__(
        self, body: int, joints: Mapping[str, int], gripper: GripperDescription, client: int
    ) -> None:
        linkage = gripper.linkage
        if linkage is None:
            raise PicktreeError("the gripper has no linkage")
        self._body, self._client = body, client
        self._fingers = LinkageFingers(linkage)
        self._speed = gripper.speed
        ratios = {linkage.drive: (1.0, 0.0)}
        ratios |= {f.joint: (f.multiplier, f.offset) for f in linkage.followers}
        one, other = linkage.knuckles
        self.knuckles = joints[one], joints[other]
        self._ratios = ratios[one], ratios[other]
        self.gear = -ratios[one][0] / ratios[other][0]
        """Ratio of the constraint between the knuckles."""
        self._held: list[_Held] = []
        for name, (by, offset) in ratios.items():
            if name in linkage.knuckles:
                continue
            of = other if _is_beyond(body, joints[name], joints[other], client) else one
            share = by / ratios[of][0]
            self._held.append(_Held(joints[name], joints[of], share, offset - share * ratios[of][1]))
        self._grip = GripperCommand(0.0, 0.0)

    def drive(self, grip: GripperCommand) -> None:
        """Command an opening; takes effect with the next step."""
        self._grip = grip

    def before_step(self) -> None:
        joints = [*self.knuckles, *(held.joint for held in self._held)]
        states = pb.getJointStates(self._body, joints, physicsClientId=self._client)
        position = {joint: state[0] for joint, state in zip(joints, states, strict=True)}
        by, offset = self._ratios[0]
        angle = (position[self.knuckles[0]] - offset) / by
        target = self._fingers.angle(self._grip.width)
        # Each finger contributes half of the opening.
        per_rad = abs(self._fingers.opening_per_rad(angle)) / 2
        # The bars pass their load on to the knuckle that moves them (virtual work).
        passed_on = dict.fromkeys(self.knuckles, 0.0)
        for held, state in zip(self._held, states[2:], strict=True):
            passed_on[held.of] -= held.by * state[3]
        for joint, (by, offset) in zip(self.knuckles, self._ratios, strict=True):
            aim = by * target + offset
            ahead = 1.0 if aim >= position[joint] else -1.0
            torque = self._grip.force * per_rad / abs(by)
            # A gripped item presses against the bars; vibration of the bars is not passed on.
            bars = min(max(ahead * passed_on[joint], 0.0), MAX_BAR_TORQUE_FACTOR * torque)
            pb.setJointMotorControl2(
                self._body,
                joint,
                pb.POSITION_CONTROL,
                targetPosition=aim,
                force=torque + bars,
                positionGain=KNUCKLE_GAIN,
                velocityGain=1.0,
                maxVelocity=(self._grip.speed or self._speed) / per_rad * abs(by),
                physicsClientId=self._client,
            )
        velocity = {joint: state[1] for joint, state in zip(joints, states, strict=True)}
        for held in self._held:
            pb.setJointMotorControl2(
                self._body,
                held.joint,
                pb.POSITION_CONTROL,
                targetPosition=held.by * position[held.of] + held.offset,
                targetVelocity=held.by * velocity[held.of],
                force=MAX_BAR_TORQUE,
                positionGain=BAR_GAIN,
                velocityGain=1.0,
                physicsClientId=self._client,
            )


def _is_beyond(body: int, joint: int, knuckle: int, client: int) -> bool:
    """Return whether a joint is below another one in the tree."""
    while joint >= 0:
        joint = int(pb.getJointInfo(body, joint, client)[16])
        if joint == knuckle:
            return True
    return False
