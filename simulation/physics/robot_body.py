"""Robot in pybullet: joints, motors, gear and wrist sensor of the robot file. Its URDF is adapted to the
engine, and motors replace the closed chains of fingers on linkages.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory

from picktree.files import PicktreeError
from picktree.simulation import checkpoints
from picktree.world import (
    Array,
    GripperCommand,
    Pose,
)
from picktree.world.robot_model import (
    RobotDescription,
    fingers_of,
    urdf_parser,
)

from .engine import Client, pb
from .engine_urdf import patched_urdf
from .linkage_motors import GearReaction, KnuckleGearReaction, LinkageMotors

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
        self._grip = GripperCommand(0.0, 0.0)
        self._torque_mode = False
        self._shares: list[float] | None = None
        """Remaining share of each arm joint's torque; None: all of it."""
        self._jam: GripperCommand | None = None
        self._grip_share = 1.0

    @property
    def command(self) -> checkpoints.ArmCommand:
        return self._command

    @property
    def grip(self) -> GripperCommand:
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
        # body or its base, for any link in the call.
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
        self.drive_fingers(GripperCommand(robot.gripper.max_width, robot.gripper.max_force))

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
            forces=self._limits if self._shares is None else self._weak_limits(),
            positionGains=self._gains,
            velocityGains=self._ones,
            physicsClientId=self._client,
        )

    def apply_torque(self, torque: tuple[float, ...]) -> None:
        """Apply joint torques for the next steps; nothing else drives the arm then."""
        self._command = checkpoints.ArmCommand("torque", (), (), torque)

    def weaken(self, shares: Mapping[str, float], jam: GripperCommand | None, grip_share: float) -> None:
        """Set faults of the drives.

        `shares`: remaining share of the torque of joints, by name. `jam`: command that the fingers carry out
        in place of the received one. `grip_share`: remaining share of their force.
        """
        self._shares = [shares.get(name, 1.0) for name in self.description.joints] if shares else None
        self._jam, self._grip_share = jam, grip_share
        self._command_again()

    def _weak_limits(self) -> list[float]:
        """Return the greatest torques of the weak joints, Nm."""
        return [most * share for most, share in zip(self._limits, self._shares or self._ones, strict=True)]

    def drive_fingers(self, command: GripperCommand) -> None:
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
            forces=self._limited(self._command.torque),
            physicsClientId=self._client,
        )

    def _limited(self, torque: tuple[float, ...]) -> tuple[float, ...]:
        """Return the torque, Nm, limited to the joints' remaining shares."""
        if self._shares is None:
            return torque
        return tuple(min(max(t, -most), most) for t, most in zip(torque, self._weak_limits(), strict=True))

    def restore(
        self,
        reading: checkpoints.RobotReading,
        command: checkpoints.ArmCommand,
        grip: GripperCommand,
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
            effort = (*self._limited(self._command.torque), *effort[len(self._arm) :])
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
