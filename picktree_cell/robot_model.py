"""Robot of a cell as a MuJoCo specification: by MuJoCo's URDF reader, or by its maker's MJCF file.

The frames of wrist and TCP are those of the cell file's robot, whatever the bodies of the model are.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from .cell_description import CellError, RobotEntry

WRIST, TCP = "picktree/wrist", "picktree/tcp"
"""Sites of the wrist sensor and of the TCP."""
MAX_DISTANCE, MAX_ANGLE = 1e-3, 5e-3
"""Greatest difference of a model's flange from that of the cell file's robot, m and rad."""
TESTED_CONFIGURATIONS = 8
"""Configurations in which both robots are compared."""
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MakersModel:
    """MJCF file of a robot's maker, and how its names are made of those of the cell file."""

    path: Path
    renames: tuple[tuple[str, str], ...] = ()
    """Beginnings of names in the cell file, and what stands in the model instead; the first that fits."""

    def name(self, name: str) -> str:
        """Return the model's name of a joint or link of the cell file."""
        for old, new in self.renames:
            if name.startswith(old):
                return new + name[len(old) :]
        return name


@dataclass(frozen=True, slots=True, eq=False)
class RobotSpec:
    """Specification of the robot with its parts by their names there."""

    spec: mujoco.MjSpec
    joints: tuple[str, ...]
    finger_joints: tuple[str, ...]
    finger_links: tuple[str, ...]
    base: str
    """First body of the robot."""
    hand: str
    """Body beyond the wrist sensor."""
    of_maker: bool
    """Whether friction, rotors, couplings and looks are the model's own."""


def robot_spec(robot: RobotEntry, model: MakersModel | None) -> RobotSpec:
    """Read the robot, and put it at its base. Raises CellError for a robot that MuJoCo cannot read, and for a
    model that is not the cell file's robot."""
    ours = _by_urdf(robot)
    return ours if model is None else _by_model(robot, model, ours)


def _by_urdf(robot: RobotEntry) -> RobotSpec:
    """Read the URDF. All links stay bodies of their own, because the wrist sensor is between two of them."""
    try:
        root = ElementTree.fromstring(robot.urdf)
    except ElementTree.ParseError as error:
        raise CellError(f"the robot's URDF is no XML: {error}") from None
    for link in root.findall("link"):
        for contact in link.findall("contact"):
            link.remove(contact)
    extension = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(
        extension,
        "compiler",
        fusestatic="false",
        discardvisual="true",
        balanceinertia="true",
        boundmass="1e-4",
        boundinertia="1e-7",
    )
    try:
        spec = mujoco.MjSpec.from_string(
            ElementTree.tostring(root, encoding="unicode"), assets=dict(robot.meshes)
        )
    except ValueError as error:
        raise CellError(f"MuJoCo cannot read the robot's URDF: {error}") from None
    first = spec.worldbody.first_body()
    if first is None:
        raise CellError("the robot's URDF has no links")
    first.pos, first.quat = robot.base.at, robot.base.wxyz
    gripper = robot.gripper
    joints = tuple(joint.name for joint in robot.joints)
    _require(spec, (*joints, *gripper.joints), "the robot's URDF")
    hand = _child_of(root, robot.flange_joint)
    spec.body(hand).add_site(name=WRIST)
    spec.body(robot.tcp_link).add_site(name=TCP, pos=robot.tcp.at, quat=robot.tcp.wxyz)
    return RobotSpec(spec, joints, gripper.joints, gripper.links, str(first.name), hand, of_maker=False)


def _by_model(robot: RobotEntry, model: MakersModel, ours: RobotSpec) -> RobotSpec:
    """Read the maker's model, without its motors and keyframes."""
    path, gripper = model.path, robot.gripper
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise CellError(f"MuJoCo cannot read {path}: {' '.join(str(error).split())}") from None
    joints = tuple(map(model.name, ours.joints))
    finger_joints = tuple(map(model.name, ours.finger_joints))
    _require(spec, (*joints, *finger_joints), str(path))
    for each in (*spec.keys, *spec.actuators, *spec.sensors):
        spec.delete(each)
    base = _outermost(spec, joints[0])
    turn = np.empty(4)
    mujoco.mju_mulQuat(turn, np.array(robot.base.wxyz), base.quat)
    base.pos, base.quat = _moved(np.array(robot.base.at), np.array(robot.base.wxyz), base.pos), turn
    last, finger = spec.joint(joints[-1]).parent, spec.joint(finger_joints[0]).parent
    hand = next((body for body in last.bodies if finger.name in _names_below(body)), None)
    if hand is None:
        raise CellError(f"{path}: no body between {last.name} and the fingers is the hand")
    links = tuple(str(spec.joint(name).parent.name) for name in finger_joints[: len(gripper.links)])
    named = tuple(map(model.name, gripper.links))
    known = {body.name for body in spec.bodies}
    found = RobotSpec(
        spec,
        joints,
        finger_joints,
        named if known.issuperset(named) else links,
        str(base.name),
        str(hand.name),
        of_maker=True,
    )
    _place_sites(robot, found, ours, str(path))
    return found


def _place_sites(robot: RobotEntry, model: RobotSpec, ours: RobotSpec, path: str) -> None:
    """Put wrist and TCP where the cell file's robot has them. Raises CellError where the arms or the fingers
    differ."""
    rng = np.random.default_rng(0)
    lower, upper = (np.array([getattr(j, key) for j in robot.joints]) for key in ("lower", "upper"))
    configurations = [
        np.array(robot.home),
        *rng.uniform(lower, upper, (TESTED_CONFIGURATIONS - 1, len(lower))),
    ]
    one, other = _Pose(ours), _Pose(model)
    hand_in_flange: tuple[Array, Array] | None = None
    for q in configurations:
        flange, hand = one.hand(q), other.hand(q)
        here = flange[1].T @ (hand[0] - flange[0]), flange[1].T @ hand[1]
        hand_in_flange = hand_in_flange or here
        distance = float(np.linalg.norm(here[0] - hand_in_flange[0]))
        cosine = (np.trace(here[1].T @ hand_in_flange[1]) - 1.0) / 2.0
        angle = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        if distance > MAX_DISTANCE or angle > MAX_ANGLE:
            raise CellError(
                f"{path}: its flange is {1000 * distance:.1f} mm and {np.degrees(angle):.2f} deg from that "
                f"of {robot.name}: this is the model of another arm, or of another base"
            )
    assert hand_in_flange is not None
    ends = robot.gripper.positions[0], robot.gripper.positions[-1]
    moved = [pose.fingers(np.array(robot.home), ends) for pose in (one, other)]
    apart = float(np.linalg.norm(moved[0] - hand_in_flange[1] @ moved[1], axis=0).max())
    if apart > MAX_DISTANCE:
        raise CellError(
            f"{path}: a finger opens {1000 * apart:.1f} mm differently from that of {robot.name}: name the "
            "finger joints by --rename"
        )
    position, rotation = hand_in_flange
    hand = model.spec.body(model.hand)
    hand.add_site(name=WRIST, pos=-rotation.T @ position, quat=_quaternion(rotation.T))
    tcp_at, tcp_turn = one.tcp_in_hand(np.array(robot.home))
    hand.add_site(name=TCP, pos=rotation.T @ (tcp_at - position), quat=_quaternion(rotation.T @ tcp_turn))


class _Pose:
    """Forward kinematics of a robot alone."""

    def __init__(self, robot: RobotSpec) -> None:
        try:
            self._model = robot.spec.copy().compile()
        except ValueError as error:
            raise CellError(f"the robot is no MuJoCo model: {error}") from None
        self._data = mujoco.MjData(self._model)
        self._robot = robot
        self._arm = [self._model.joint(name).qposadr[0] for name in robot.joints]
        self._fingers = [self._model.joint(name).qposadr[0] for name in robot.finger_joints]

    def hand(self, q: Array) -> tuple[Array, Array]:
        """Return position (3,) and rotation (3, 3) of the hand's body in the world."""
        self._data.qpos[self._arm] = q
        mujoco.mj_kinematics(self._model, self._data)
        body = self._data.body(self._robot.hand)
        return body.xpos.copy(), body.xmat.reshape(3, 3).copy()

    def tcp_in_hand(self, q: Array) -> tuple[Array, Array]:
        """Return the TCP in the hand's frame; of a robot with that site."""
        position, rotation = self.hand(q)
        site = self._data.site(TCP)
        return rotation.T @ (site.xpos - position), rotation.T @ site.xmat.reshape(3, 3)

    def fingers(self, q: Array, ends: Sequence[Sequence[float]]) -> Array:
        """Return how the body of each finger joint moves between two positions of the fingers, (3, fingers),
        in the hand's frame, m."""
        places: list[Array] = []
        for end in ends:
            self._data.qpos[self._fingers] = end
            _, rotation = self.hand(q)
            joints = [self._model.joint(name) for name in self._robot.finger_joints]
            bodies = [int(self._model.jnt_bodyid[joint.id]) for joint in joints]
            places.append(rotation.T @ self._data.xpos[bodies].T)
        return places[1] - places[0]


def _require(spec: mujoco.MjSpec, joints: Sequence[str], where: str) -> None:
    known = [joint.name for joint in spec.joints]
    for name in joints:
        if name not in known:
            raise CellError(f"{where} has no joint {name!r}; it has {', '.join(known) or 'none'}")


def _outermost(spec: mujoco.MjSpec, joint: str) -> mujoco.MjsBody:
    """Return the body of the world that has a joint."""
    body = spec.joint(joint).parent
    while body.parent.name != "world":
        body = body.parent
    return body


def _names_below(body: mujoco.MjsBody) -> set[str]:
    """Return the names of a body and of all that hang on it."""
    return {body.name, *(each.name for each in body.find_all("body"))}


def _child_of(urdf: ElementTree.Element, joint: str) -> str:
    for element in urdf.findall("joint"):
        child = element.find("child")
        if element.get("name") == joint and child is not None:
            return child.get("link", "")
    raise CellError(f"the robot's URDF has no flange joint {joint!r}")


def _moved(at: Array, wxyz: Array, point: Array | Sequence[float]) -> Array:
    """Return a point of a frame in the frame's parent."""
    turned = np.empty(3)
    mujoco.mju_rotVecQuat(turned, point, wxyz)
    return at + turned


def _quaternion(rotation: Array) -> Array:
    """Return the quaternion w, x, y, z of a rotation (3, 3)."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return quaternion
