"""Robot in pybullet: joints, motors, gear and wrist sensor, all as the robot file says. Its URDF is
adapted to the engine, and motors replace the closed chains of fingers on linkages.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin

from picktree.files import PicktreeError
from picktree.simulation import checkpoints
from picktree.world import (
    COLOURS,
    Array,
    Box,
    ConvexMesh,
    Cylinder,
    Pose,
    Quaternion,
    Sphere,
    Vector3,
    mesh_reader,
    rotated,
)
from picktree.world.robot_model import (
    GripperDescription,
    LinkageFingers,
    LinkShape,
    RobotDescription,
    RobotModel,
    beyond_flange,
    fingers_of,
    gripper_mounting,
    link_shapes,
    urdf_parser,
)

from .engine import Client, pb


def patched_urdf(robot: RobotDescription, folder: Path) -> str:
    """Return the text of the robot's URDF for the engine. Raises PicktreeError for unusable geometry or
    missing links.

    Links have the convex bodies that the planner takes, hulls as files in `folder`: the engine reads no mesh
    of others. Every link shows its *collision* geometry: the camera sees what can be touched, which also
    renders ten times faster than the visual meshes. A link without <inertial> gets one of no mass, as the
    planner's dynamics take it: the engine would give it 1 kg. No joint keeps its <dynamics>: damping and
    friction are in neither simulation nor controller. A joint that follows the gripper's motor is limited by
    the motor alone.
    """
    shapes = link_shapes(robot.urdf)
    root = urdf_parser.parsed_urdf(Path(robot.urdf))
    _widen_followers(root, robot.gripper)
    for joint in root.findall("joint"):
        # The engine adds damping explicitly, which spins light links up, and has no joint friction.
        for dynamics in joint.findall("dynamics"):
            joint.remove(dynamics)
    gripper_mounting.mount_tool(root, robot)
    links = {link.get("name", ""): link for link in root.findall("link")}
    for link in links.values():
        for old in (*link.findall("visual"), *link.findall("collision")):
            link.remove(old)
    for n, part in enumerate(shapes):
        _put_shape(links[part.link], part, folder / f"hull_{n}.obj")
    for link in links.values():
        _show_what_collides(link)
        if link.find("inertial") is None:
            _add_no_mass(link)
    for n, name in enumerate(robot.gripper.fingers):
        if name not in links:
            raise PicktreeError(f"{robot.source or robot.name}: finger link {name!r} is not in {robot.urdf}")
        _put_finger(links[name], n, robot.gripper)
    return ElementTree.tostring(root, encoding="unicode")


def _widen_followers(root: ElementTree.Element, gripper: GripperDescription) -> None:
    """Widen the limits of joints that follow the gripper's motor, as far as the motor moves them.

    Many URDFs repeat the motor's limits for a joint that turns the other way. The engine would stop there.
    """
    linkage = gripper.linkage
    if linkage is None:
        return
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    for follower in linkage.followers:
        ends = [follower.multiplier * linkage.angles[k] + follower.offset for k in (0, -1)]
        limit = None if follower.joint not in joints else joints[follower.joint].find("limit")
        if limit is not None:
            limit.set("lower", repr(min(float(limit.get("lower", "0")), *ends)))
            limit.set("upper", repr(max(float(limit.get("upper", "0")), *ends)))


def _put_shape(link: ElementTree.Element, part: LinkShape, file: Path) -> None:
    """Add a body to a link; the hull of a mesh is written to `file`."""
    geometry = _collision(link, part.pose_in_link)
    match part.shape:
        case Box(size):
            ElementTree.SubElement(geometry, "box", size=urdf_parser.numbers_text(size))
        case Cylinder(radius, height):
            ElementTree.SubElement(geometry, "cylinder", radius=repr(radius), length=repr(height))
        case Sphere(radius):
            ElementTree.SubElement(geometry, "sphere", radius=repr(radius))
        case ConvexMesh():
            file.write_text(mesh_reader.hulls_text([np.array(part.shape.vertices)]), encoding="ascii")
            ElementTree.SubElement(geometry, "mesh", filename=str(file))


def _collision(link: ElementTree.Element, pose: Pose) -> ElementTree.Element:
    """Add a collision element to a link and return its <geometry>."""
    collision = ElementTree.SubElement(link, "collision")
    origin = {"xyz": urdf_parser.numbers_text(pose.position), "rpy": urdf_parser.numbers_text(pose.rpy())}
    ElementTree.SubElement(collision, "origin", origin)
    return ElementTree.SubElement(collision, "geometry")


def _show_what_collides(link: ElementTree.Element) -> None:
    for collision in link.findall("collision"):
        visual = copy.deepcopy(collision)
        visual.tag = "visual"
        for material in visual.findall("material"):
            visual.remove(material)
        red, green, blue = COLOURS["light_grey"]
        material = ElementTree.SubElement(visual, "material", name="robot_grey")
        ElementTree.SubElement(material, "color", rgba=f"{red} {green} {blue} 1")
        link.append(visual)


def _add_no_mass(link: ElementTree.Element) -> None:
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "mass", value="0")
    ElementTree.SubElement(
        inertial, "inertia", dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0")
    )


def _put_finger(link: ElementTree.Element, n: int, gripper: GripperDescription) -> None:
    """Replace the collision geometry of a finger link by the pad of finger `n` and what is behind it."""
    for old in [*link.findall("collision"), *link.findall("contact")]:
        link.remove(old)
    for box, pose in (gripper.pads[n], *gripper.bodies_of(n)):
        ElementTree.SubElement(_collision(link, pose), "box", size=urdf_parser.numbers_text(box.size))
    contact = ElementTree.SubElement(link, "contact")
    ElementTree.SubElement(contact, "friction_anchor")
    for tag, value in (
        ("stiffness", gripper.pad_contact.stiffness),
        ("damping", gripper.pad_contact.damping),
        ("lateral_friction", gripper.pad_contact.friction),
        ("spinning_friction", gripper.pad_contact.spinning_friction),
    ):
        ElementTree.SubElement(contact, tag, value=repr(value))


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
        self._seen: Array | None = None
        self._response: Array = np.zeros(3)

    def read(self, turn: Quaternion, position: Sequence[float]) -> Vector3:
        """Return the missing force on the wrist as `GearReaction` does."""
        now = np.array(position)
        if self._seen is None or float(np.abs(now - self._seen).max()) > MAX_STALE_MOTION:
            self._seen, self._response = now, self._respond(now)
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
        self._grip = checkpoints.GripperCommand(0.0, 0.0)

    def drive(self, grip: checkpoints.GripperCommand) -> None:
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


POSITION_GAIN = 0.3
"""Share of the position error that one step removes: tracks to 0.1 mrad at 1 rad/s."""
FINGER_GAIN = 0.2
GEAR_FORCE = 1000.0
"""Greatest force of the gear between the fingers, N, or Nm."""


class RobotBody:
    """One robot in one pybullet client. `load` rebuilds it after a reset of the simulation."""

    def __init__(self, robot: RobotDescription, client: Client, period: float) -> None:
        self.description = robot
        self._owner = client
        self._client = client.id
        self.period = period
        """Length of a physics step, s."""
        self._limits = [joint.torque for joint in robot.limits]
        self._gains = [POSITION_GAIN] * len(robot.joints)
        self._ones = [1.0] * len(robot.joints)
        self._folder = TemporaryDirectory(prefix="picktree-")
        folder = Path(self._folder.name)
        text = patched_urdf(robot, folder)
        (folder / "robot.urdf").write_text(text, encoding="utf-8")
        links = urdf_parser.parse_urdf(text.encode(), robot.name).findall("link")
        self.shape_counts = {link.get("name", ""): len(link.findall("collision")) for link in links}
        self.fingers = fingers_of(robot.gripper)
        self._linkage: LinkageMotors | None = None
        self._gear: GearReaction | KnuckleGearReaction | None = None
        self.body = -1
        self.links: dict[int, str] = {}
        self._command = checkpoints.ArmCommand("follow", (), (), ())
        self._grip = checkpoints.GripperCommand(0.0, 0.0)
        self._torque_mode = False
        self._shares: list[float] | None = None
        """Remaining share of each arm joint's torque; None: all of it."""
        self._jam: checkpoints.GripperCommand | None = None
        self._grip_share = 1.0

    @property
    def command(self) -> checkpoints.ArmCommand:
        return self._command

    @property
    def grip(self) -> checkpoints.GripperCommand:
        return self._grip

    def load(self) -> None:
        """Add the robot to an empty simulation, at `home` with the gripper open. Raises PicktreeError when a
        joint is missing."""
        robot, base = self.description, self.description.base_in_world
        self.body = pb.loadURDF(
            str(Path(self._folder.name) / "robot.urdf"),
            base.position,
            base.orientation,
            useFixedBase=1,
            flags=pb.URDF_USE_INERTIA_FROM_FILE,
            physicsClientId=self._client,
        )
        joints: dict[str, int] = {}
        self.links = {-1: pb.getBodyInfo(self.body, self._client)[0].decode()}
        for k in range(pb.getNumJoints(self.body, self._client)):
            info = pb.getJointInfo(self.body, k, self._client)
            joints[info[1].decode()] = k
            self.links[k] = info[12].decode()
        self._check_shapes()
        wanted = (*robot.joints, *robot.gripper.joints, robot.flange_joint)
        if missing := [name for name in wanted if name not in joints]:
            raise PicktreeError(f"{robot.source or robot.name}: no joint {missing[0]!r} in {robot.urdf}")
        self._arm = [joints[name] for name in robot.joints]
        self._fingers = [joints[name] for name in robot.gripper.joints]
        self._flange = joints[robot.flange_joint]
        self._read_joints = [*self._arm, *self._fingers, self._flange]
        # pybullet's default of 0.04 would damp the arm as if it moved in oil. All three concern the whole
        # body or its base, whatever link the call names.
        pb.changeDynamics(
            self.body,
            -1,
            linearDamping=0.0,
            angularDamping=0.0,
            collisionMargin=0.0,
            physicsClientId=self._client,
        )
        pb.enableJointForceTorqueSensor(self.body, self._flange, 1, self._client)
        if robot.gripper.linkage is not None:
            self._linkage = LinkageMotors(self.body, joints, robot.gripper, self._client)
        self._add_gear()
        self._torque_mode = False
        self._command = checkpoints.ArmCommand("follow", (), (), ())
        home = robot.named["home"]
        opened = self.fingers.positions(robot.gripper.max_width)
        self.place((*home, *opened), (0.0,) * (len(home) + len(opened)))
        self.follow(home, (0.0,) * len(home))
        self.drive_fingers(checkpoints.GripperCommand(robot.gripper.max_width, robot.gripper.max_force))

    def _check_shapes(self) -> None:
        """Raise PicktreeError when the engine has taken fewer shapes of a link than it was given."""
        for link, name in self.links.items():
            taken = len(pb.getCollisionShapeData(self.body, link, physicsClientId=self._client))
            if taken != self.shape_counts[name]:
                raise PicktreeError(
                    f"{self.description.urdf}: link {name!r} has {self.shape_counts[name]} shapes, "
                    f"of which {taken} collide in the simulation"
                )

    def _add_gear(self) -> None:
        """Add the gear between the fingers, which a URDF for pybullet cannot contain."""
        gripper = self.description.gripper
        one, other = self._fingers if self._linkage is None else self._linkage.knuckles
        gear = pb.createConstraint(
            self.body,
            one,
            self.body,
            other,
            pb.JOINT_GEAR,
            (1, 0, 0),
            (0, 0, 0),
            (0, 0, 0),
            physicsClientId=self._client,
        )
        pb.changeConstraint(
            gear,
            gearRatio=gripper.gear if self._linkage is None else self._linkage.gear,
            erp=1.0,
            maxForce=GEAR_FORCE,
            physicsClientId=self._client,
        )
        if self._linkage is None:
            self._gear = GearReaction(gear, self.body, one, self._flange, self._client)
        else:
            self._gear = KnuckleGearReaction(gear, self.description, self._linkage.gear, self._client)

    def place(self, position: tuple[float, ...], velocity: tuple[float, ...]) -> None:
        """Set all joints, arm then fingers: at the start and on restore only."""
        for joint, p, v in zip([*self._arm, *self._fingers], position, velocity, strict=True):
            pb.resetJointState(self.body, joint, p, v, physicsClientId=self._client)

    def follow(self, position: tuple[float, ...], velocity: tuple[float, ...]) -> None:
        """Servo the arm so that it is at `position` with `velocity` when the next step ends."""
        command = checkpoints.ArmCommand("follow", position, velocity, ())
        if command == self._command and not self._torque_mode:
            return
        self._command = command
        self._torque_mode = False
        # pybullet adds the velocity on top of the position error; the target is where the period starts.
        starts = [p - v * self.period for p, v in zip(position, velocity, strict=True)]
        pb.setJointMotorControlArray(
            self.body,
            self._arm,
            pb.POSITION_CONTROL,
            targetPositions=starts,
            targetVelocities=velocity,
            forces=self._limits if self._shares is None else self._least(),
            positionGains=self._gains,
            velocityGains=self._ones,
            physicsClientId=self._client,
        )

    def apply_torque(self, torque: tuple[float, ...]) -> None:
        """Apply joint torques for the next steps; nothing else drives the arm then."""
        self._command = checkpoints.ArmCommand("torque", (), (), torque)

    def weaken(
        self, shares: Mapping[str, float], jam: checkpoints.GripperCommand | None, grip_share: float
    ) -> None:
        """Set faults of the drives.

        `shares`: remaining share of the torque of joints, by name. `jam`: command that the fingers carry out
        in place of the received one. `grip_share`: remaining share of their force.
        """
        self._shares = [shares.get(name, 1.0) for name in self.description.joints] if shares else None
        self._jam, self._grip_share = jam, grip_share
        self._command_again()

    def _least(self) -> list[float]:
        """Return the greatest torques of the weak joints, Nm."""
        return [most * share for most, share in zip(self._limits, self._shares or self._ones, strict=True)]

    def drive_fingers(self, command: checkpoints.GripperCommand) -> None:
        self._grip = command
        grip = command if self._jam is None else self._jam
        if self._grip_share != 1.0:
            grip = replace(grip, force=grip.force * self._grip_share)
        if self._linkage is not None:
            self._linkage.drive(grip)
            return
        for joint in self._fingers:
            pb.setJointMotorControl2(
                self.body,
                joint,
                pb.POSITION_CONTROL,
                targetPosition=grip.width / 2,
                force=grip.force,
                positionGain=FINGER_GAIN,
                velocityGain=1.0,
                maxVelocity=grip.speed or self.description.gripper.speed,
                physicsClientId=self._client,
            )

    def pace(self, period: float) -> None:
        """Set the length of a step, s, and repeat all motor commands.

        pybullet stores a motor's greatest force as the impulse of a step, with the step length at the time of
        the command.
        """
        self.period = period
        self._command_again()

    def _command_again(self) -> None:
        command = self._command
        if command.mode == "follow" and not self._torque_mode and command.position:
            self._command = checkpoints.ArmCommand("follow", (), (), ())
            self.follow(command.position, command.velocity)
        self.drive_fingers(self._grip)

    def before_step(self) -> None:
        """Repeat the torque command, which pybullet drops after each step; the servo's targets stay."""
        if self._linkage is not None:
            self._linkage.before_step()
        if self._command.mode != "torque":
            return
        if not self._torque_mode:
            self._torque_mode = True
            pb.setJointMotorControlArray(
                self.body,
                self._arm,
                pb.VELOCITY_CONTROL,
                forces=[0.0] * len(self._arm),
                physicsClientId=self._client,
            )
        pb.setJointMotorControlArray(
            self.body,
            self._arm,
            pb.TORQUE_CONTROL,
            forces=self._given(self._command.torque),
            physicsClientId=self._client,
        )

    def _given(self, torque: tuple[float, ...]) -> tuple[float, ...]:
        """Return the torque, Nm, limited to the joints' remaining shares."""
        if self._shares is None:
            return torque
        return tuple(min(max(t, -most), most) for t, most in zip(torque, self._least(), strict=True))

    def restore(
        self,
        reading: checkpoints.RobotReading,
        command: checkpoints.ArmCommand,
        grip: checkpoints.GripperCommand,
    ) -> None:
        self.place(reading.position, reading.velocity)
        if command.mode == "torque":
            self.apply_torque(command.torque)
        else:
            self.follow(command.position, command.velocity)
        self.drive_fingers(grip)

    def read(self) -> checkpoints.RobotReading:
        """Return the readings of ideal sensors now."""
        states = pb.getJointStates(self.body, self._read_joints, physicsClientId=self._client)
        position, velocity, _, effort = zip(*states[:-1], strict=True)
        fx, fy, fz, tx, ty, tz = states[-1][2]
        com, _, _, _, origin, turn = pb.getLinkState(self.body, self._flange, 0, 0, self._client)
        lx, ly, lz = com[0] - origin[0], com[1] - origin[1], com[2] - origin[2]
        # pybullet returns the wrench of the wrist on the hand, about the hand's centre of mass.
        wrench = (
            -fx,
            -fy,
            -fz,
            -tx - (ly * fz - lz * fy),
            -ty - (lz * fx - lx * fz),
            -tz - (lx * fy - ly * fx),
        )
        if self._gear is not None:
            x, y, z = self._gear.read(turn, position)
            wrench = (wrench[0] + x, wrench[1] + y, wrench[2] + z, *wrench[3:])
        if self._command.mode == "torque":
            effort = (*self._given(self._command.torque), *effort[len(self._arm) :])
        return checkpoints.RobotReading(position, velocity, effort, wrench, turn)

    def tcp(self) -> Pose:
        """Return the true TCP pose in the world."""
        link = next(k for k, name in self.links.items() if name == self.description.tcp_link)
        state = pb.getLinkState(self.body, link, 0, 1, self._client)
        return Pose(state[4], state[5]) @ self.description.tcp_in_link


def finite(numbers: Array, what: str, shape: tuple[int, ...]) -> tuple[float, ...]:
    """Return a copy of an array as plain floats. Raises PicktreeError for another shape, NaN or infinity."""
    if numbers.shape != shape:
        raise PicktreeError(f"{what}: shape {numbers.shape}, but {shape} is needed")
    values: tuple[float, ...] = tuple(numbers.tolist())
    if not isfinite(sum(values)):
        raise PicktreeError(f"{what}: not finite: {values}")
    return values
