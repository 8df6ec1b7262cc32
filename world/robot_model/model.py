"""Kinematics and dynamics of the robot, from its URDF, with pinocchio."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path

import numpy as np
import pinocchio as pin

from picktree.files import PicktreeError
from picktree.world import Array, Box, Pose, Vector3

from .description import RobotDescription
from .finger_linkage import fingers_of
from .gripper_mounting import mount_tool
from .link_solids import LinkShape, link_shapes
from .urdf_faults import MOVING, UrdfError
from .urdf_parser import parsed_urdf

TCP_FRAME = "picktree_tcp"
MIN_UPRIGHT_COSINE = 0.99
"""Least cosine between the vertical and the axis of a first joint whose link turns on its ground."""
LIMIT_RESERVE = 0.03
"""Distance to the soft limits that planning keeps, rad: the arm overshoots a plan slightly."""


def se3(pose: Pose) -> pin.SE3:
    """Convert a pose to pinocchio's rigid transform."""
    return pin.SE3(pose.rotation(), np.array(pose.position))


def pose_of(placement: pin.SE3) -> Pose:
    """Convert pinocchio's rigid transform to a pose (a copy)."""
    x, y, z, qx, qy, qz, qw = pin.SE3ToXYZQUATtuple(placement)
    return Pose((x, y, z), (qx, qy, qz, qw) if qw >= 0.0 else (-qx, -qy, -qz, -qw))


def link_frame(model: pin.Model, link: str) -> int:
    """Return the index of a link's frame; a joint may have the same name."""
    return model.getFrameId(link, pin.BODY)


def joint_frame(model: pin.Model, joint: str) -> int:
    """Return the index of a fixed joint's frame; a link may have the same name."""
    return model.getFrameId(joint, pin.FIXED_JOINT)


class RobotModel:
    """The arm's n joints as a model of its own (fingers locked), and the whole robot for link poses.

    All poses are in the world, all joint arrays have shape (n,), linear parts come before angular ones.
    Answers are copies. An instance holds scratch memory: one per thread.
    """

    def __init__(self, description: RobotDescription) -> None:
        self.description = description
        self.n = len(description.joints)
        self.fingers = fingers_of(description.gripper)
        limits = description.limits
        self.lower: Array = np.array([limit.lower for limit in limits])
        self.upper: Array = np.array([limit.upper for limit in limits])
        self.planned_lower: Array = self.lower + LIMIT_RESERVE
        self.planned_upper: Array = self.upper - LIMIT_RESERVE
        self.velocity_limit: Array = np.array([limit.velocity for limit in limits])
        self.acceleration_limit: Array = np.array([limit.acceleration for limit in limits])
        self.torque_limit: Array = np.array([limit.torque for limit in limits])
        self.full: pin.Model = _whole_robot(description)
        """Every joint of the URDF, with the frame TCP_FRAME."""
        self.arm: pin.Model = _arm_only(self.full, description)
        """The arm's joints only, fingers locked at opening 0."""
        self.tcp_frame = self.arm.getFrameId(TCP_FRAME, pin.OP_FRAME)
        self._data = self.arm.createData()
        self._full_data = self.full.createData()
        self._neutral: Array = pin.neutral(self.full)
        self._arm_q = [_q_index(self.full, name) for name in description.joints]
        self._tool_at_zero: Array = np.array(self.tcp(np.zeros(self.n)).position)
        self._screws = _screws(self.arm)
        self._finger_q = [_q_index(self.full, name) for name in description.gripper.joints]
        self._links = tuple(
            (frame.name, index) for index, frame in enumerate(self.full.frames) if frame.type == pin.BODY
        )
        self._flange = joint_frame(self.arm, description.flange_joint)
        self.hand_mass, self.hand_com = _beyond_flange(self.full, description.flange_joint)
        self.hand_inertia = self._hand_inertia()
        """Greatest moment of inertia beyond the flange about the TCP, kg·m², with closed fingers."""

    def _hand_inertia(self) -> float:
        data, moments = self.full.createData(), np.zeros((3, 3))
        pin.framesForwardKinematics(self.full, data, self._neutral)
        tcp = data.oMf[self.full.getFrameId(TCP_FRAME, pin.OP_FRAME)].translation
        for index, inertia, moves in beyond_flange(self.full, self.description.flange_joint):
            at = data.oMi[self.full.frames[index].parentJoint] if moves else data.oMf[index]
            lever = at.rotation @ inertia.lever + at.translation - tcp
            own: Array = at.rotation @ inertia.inertia @ at.rotation.T
            moments = (
                moments + own + inertia.mass * (float(lever @ lever) * np.eye(3) - np.outer(lever, lever))
            )
        return float(np.linalg.eigvalsh(moments)[-1])

    @property
    def finger_links(self) -> tuple[str, ...]:
        """Names of the links that carry the pads."""
        return self.description.gripper.fingers

    @property
    def standing_links(self) -> tuple[str, ...]:
        """Names of the links that the first joint alone moves, about the vertical; empty for another axis.

        They may turn on the fixture that carries the arm.
        """
        if abs(float(self.jacobian(np.zeros(self.n))[5, 0])) < MIN_UPRIGHT_COSINE:
            return ()
        first = self.full.getJointId(self.description.joints[0])
        return tuple(name for name, index in self._links if self.full.frames[index].parentJoint == first)

    def full_q(self, q: Array, width: float) -> Array:
        """Return the configuration of `full` for the arm at q and an opening of `width` m."""
        whole = self._neutral.copy()
        whole[self._arm_q] = q
        whole[self._finger_q] = self.fingers.positions(width)
        return whole

    def tcp(self, q: Array) -> Pose:
        """Return the pose of the tool centre point in the world."""
        pin.forwardKinematics(self.arm, self._data, q)
        return pose_of(pin.updateFramePlacement(self.arm, self._data, self.tcp_frame))

    def tcp_positions(self, path: Array) -> Array:
        """Return the positions (m, 3) of the tool centre point in the world at configurations (m, n), m.

        Product of exponentials: each joint, the last first, turns or moves the points by its axis at q = 0.
        """
        points = np.tile(self._tool_at_zero, (len(path), 1))
        sines, cosines = np.sin(path), np.cos(path)
        for k, (turn, point, slide) in reversed(list(enumerate(self._screws))):
            if turn is None:
                points = points + path[:, k : k + 1] * slide
                continue
            parts = (points - point) @ turn
            points = parts[:, :3] + cosines[:, k : k + 1] * parts[:, 3:6] + sines[:, k : k + 1] * parts[:, 6:]
            points += point
        return points

    def flange(self, q: Array) -> Pose:
        """Return the frame of the flange joint in the world: the origin of the wrist's force/torque
        sensor."""
        pin.forwardKinematics(self.arm, self._data, q)
        return pose_of(pin.updateFramePlacement(self.arm, self._data, self._flange))

    def link_poses(self, q: Array, width: float) -> dict[str, Pose]:
        """Return the frame of every link in the world, by link name in the order of the kinematic tree."""
        pin.framesForwardKinematics(self.full, self._full_data, self.full_q(q, width))
        return {name: pose_of(self._full_data.oMf[index]) for name, index in self._links}

    def jacobian(self, q: Array) -> Array:
        """Return the Jacobian (6, n) of the TCP in the world's axes: linear (m/s), then angular velocity
        (rad/s)."""
        pin.computeJointJacobians(self.arm, self._data, q)
        return pin.getFrameJacobian(self.arm, self._data, self.tcp_frame, pin.LOCAL_WORLD_ALIGNED).copy()

    def gravity(self, q: Array) -> Array:
        """Return the torques (n,) that hold the arm at rest, Nm."""
        return pin.computeGeneralizedGravity(self.arm, self._data, q).copy()

    def bias(self, q: Array, v: Array) -> Array:
        """Return the nonlinear terms (n,): gravity, Coriolis and centrifugal torques, Nm."""
        return pin.nonLinearEffects(self.arm, self._data, q, v).copy()

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """Return the torques (n,) that accelerate the arm by a rad/s² at q, v, Nm. Recursive Newton-Euler."""
        return pin.rnea(self.arm, self._data, q, v, a).copy()

    def mass_matrix(self, q: Array) -> Array:
        """Return the joint-space inertia (n, n), kg·m²."""
        return pin.crba(self.arm, self._data, q).copy()

    def forward_dynamics(self, q: Array, v: Array, tau: Array, wrench_at_tcp: Array | None = None) -> Array:
        """Return the acceleration (n,) under torques and a wrench (6,) *on* the TCP: force, torque in
        world axes."""
        effort = tau - self.bias(q, v)
        if wrench_at_tcp is not None:
            effort = effort + self.jacobian(q).T @ wrench_at_tcp
        acceleration: Array = np.asarray(np.linalg.solve(self.mass_matrix(q), effort), np.float64)
        return acceleration

    def named(self, name: str) -> Array:
        """Return a named configuration of the robot file. Raises PicktreeError with the known names."""
        try:
            return np.array(self.description.named[name])
        except KeyError:
            known = ", ".join(self.description.named)
            raise PicktreeError(f"no pose {name!r} in the robot file; known: {known}") from None

    def collision_shapes(self) -> tuple[LinkShape, ...]:
        """Return the convex bodies of the links."""
        return link_shapes(self.description.urdf)

    def finger_boxes(self, width: float) -> tuple[tuple[Box, Pose], ...]:
        """Return boxes that enclose the fingers at an opening of `width` m, in the TCP frame.

        They are those of the +y and the -y finger in turn.
        """
        found: list[tuple[Box, Pose]] = []
        for box, closed in self.description.gripper.finger_boxes:
            x, y, z = closed.position
            near = Pose((x, y + width / 2, z), closed.orientation)
            found += [(box, near), (box, Pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)) @ near)]
        return tuple(found)


def _whole_robot(description: RobotDescription) -> pin.Model:
    model = _built(description)
    names = (*description.joints, *description.gripper.joints)
    missing = [name for name in names if not model.existJointName(name)]
    missing += [
        name
        for name, kind in ((description.tcp_link, pin.BODY), (description.flange_joint, pin.FIXED_JOINT))
        if not model.existFrame(name, kind)
    ]
    if missing:
        raise PicktreeError(f"{description.urdf}: the URDF has no {', '.join(missing)}")
    if unfit := [name for name in names if model.joints[model.getJointId(name)].nq != 1]:
        raise PicktreeError(f"{description.urdf}: {', '.join(unfit)}: only hinges and sliders with limits")
    if len(description.limits) != len(description.joints):
        raise PicktreeError(f"{description.name}: {len(description.joints)} joints need as many limits")
    base = se3(description.base_in_world)
    for index in range(1, len(model.names)):
        if model.parents[index] == 0:
            model.jointPlacements[index] = base * model.jointPlacements[index]
    for index, frame in enumerate(model.frames):
        if frame.parentJoint == 0 and index > 0:
            frame.placement = base * frame.placement
    link_id = link_frame(model, description.tcp_link)
    link = model.frames[link_id]
    placement = link.placement * se3(description.tcp_in_link)
    model.addFrame(pin.Frame(TCP_FRAME, link.parentJoint, link_id, placement, pin.OP_FRAME))
    return model


def _built(description: RobotDescription) -> pin.Model:
    """Build the URDF's model. Continuous joints of the arm become hinges with the robot file's limits."""
    try:
        root = parsed_urdf(Path(description.urdf))
    except UrdfError as error:
        raise PicktreeError(f"{description.urdf}: {error}") from None
    mount_tool(root, description)
    limits = dict(zip(description.joints, description.limits, strict=False))
    for joint in root.findall("joint"):
        limit = limits.get(joint.get("name", ""))
        if limit is not None and joint.get("type") == "continuous":
            joint.set("type", "revolute")
            for old in joint.findall("limit"):
                joint.remove(old)
            ElementTree.SubElement(
                joint,
                "limit",
                lower=repr(limit.lower),
                upper=repr(limit.upper),
                velocity=repr(limit.velocity),
                effort=repr(limit.torque),
            )
    return pin.buildModelFromXML(ElementTree.tostring(_bare(root), encoding="unicode"))


def _bare(root: ElementTree.Element) -> ElementTree.Element:
    """Return a URDF's links with their inertials, and its joints: enough for kinematics and dynamics.

    The library rejects input that other readers accept: a robot without a name, a lone <limit lower=…>,
    spaces around a number, a material without a name.
    """
    bare = ElementTree.Element("robot", name=root.get("name", ""))
    for link in root.findall("link"):
        kept = ElementTree.SubElement(bare, "link", name=link.get("name", ""))
        if (inertial := link.find("inertial")) is not None:
            kept.append(_with_numbers(inertial))
    for joint in root.findall("joint"):
        kept = ElementTree.SubElement(bare, "joint", dict(joint.attrib))
        for tag in ("origin", "parent", "child", "axis", "limit", "dynamics"):
            element = joint.find(tag)
            if element is not None and (tag != "limit" or joint.get("type") in MOVING):
                kept.append(_with_numbers(element))
    return bare


def _with_numbers(element: ElementTree.Element) -> ElementTree.Element:
    """Return a copy without spaces around its values, and with an effort and a velocity for a <limit>."""
    given = {key: value.strip() for key, value in element.attrib.items()}
    if element.tag == "limit":
        # Some files write -1 for a limit that they do not know.
        unknown = (key for key in ("effort", "velocity") if given.get(key, "-").startswith("-"))
        given |= dict.fromkeys(unknown, "0")
    copied = ElementTree.Element(element.tag, given)
    copied.extend(map(_with_numbers, element))
    return copied


def _arm_only(full: pin.Model, description: RobotDescription) -> pin.Model:
    keep = list(description.joints)
    locked = [index for index, name in enumerate(full.names) if index > 0 and name not in keep]
    # The library finds frames by name alone, and a joint may have the name of a link.
    known = Counter(frame.name for frame in full.frames)
    whole, shared = full.copy(), dict[str, str]()
    for index, frame in enumerate(whole.frames):
        if known[frame.name] > 1 and frame.type not in (pin.JOINT, pin.FIXED_JOINT):
            shared[f"{frame.name} {index}"] = frame.name
            frame.name = f"{frame.name} {index}"
    arm = pin.buildReducedModel(whole, locked, pin.neutral(full))
    for frame in arm.frames:
        frame.name = shared.get(frame.name, frame.name)
    order = list(arm.names)[1:]
    if order != keep:
        raise PicktreeError(f"{description.name}: the joints must be given in the order {', '.join(order)}")
    return arm


def _q_index(model: pin.Model, joint: str) -> int:
    return model.joints[model.getJointId(joint)].idx_q


def _screws(arm: pin.Model) -> list[tuple[Array | None, Array, Array]]:
    """Return turn (3, 9), a point on the axis (3,), and direction (3,) of each joint in the world at q = 0.

    The turn's columns give the parts of a vector along and across the axis, and the axis × the vector. A
    joint that slides has none.
    """
    screws: list[tuple[Array | None, Array, Array]] = []
    # Of an arm with one joint pinocchio returns a vector.
    columns = pin.computeJointJacobians(arm, arm.createData(), np.zeros(arm.nq)).reshape(6, -1)
    for twist in columns.T.copy():
        slide: Array = twist[:3]
        axis: Array = twist[3:]
        along = np.outer(axis, axis)
        turn: Array = np.hstack([along, np.eye(3) - along, np.cross(axis, np.eye(3))])
        point: Array = np.cross(axis, slide)
        screws.append((turn if axis.any() else None, point, slide))
    return screws


def beyond_flange(model: pin.Model, flange_joint: str) -> list[tuple[int, pin.Inertia, bool]]:
    """Return each body beyond a fixed joint: index of a frame, inertia, and whether it moves against the
    joint.

    The inertia of one that moves is in its joint's frame, else in the frame itself.
    """
    flange = joint_frame(model, flange_joint)
    beyond = [flange]
    for index, frame in enumerate(model.frames):
        if index not in beyond and frame.parentFrame in beyond:
            beyond.append(index)
    found: list[tuple[int, pin.Inertia, bool]] = []
    for index in beyond:
        frame = model.frames[index]
        # A moving joint's inertia already holds what is fixed to it.
        moves = frame.parentJoint != model.frames[flange].parentJoint
        if moves and frame.type != pin.JOINT:
            continue
        found.append((index, model.inertias[frame.parentJoint] if moves else frame.inertia, moves))
    return found


def _beyond_flange(model: pin.Model, flange_joint: str) -> tuple[float, Vector3]:
    """Return the mass beyond a fixed joint, kg, and its centre in that joint's frame, with closed fingers."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    flange = joint_frame(model, flange_joint)
    mass, moment = 0.0, np.zeros(3)
    for index, inertia, moves in beyond_flange(model, flange_joint):
        at = data.oMi[model.frames[index].parentJoint] if moves else data.oMf[index]
        mass += inertia.mass
        moment += inertia.mass * (at.rotation @ inertia.lever + at.translation)
    if mass == 0.0:
        return 0.0, (0.0, 0.0, 0.0)
    x, y, z = pose_of(data.oMf[flange]).inverse().apply(moment / mass)
    return mass, (float(x), float(y), float(z))
