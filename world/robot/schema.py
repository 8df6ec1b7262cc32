"""The grammar of robot files: one model for each kind of entry."""

from __future__ import annotations

from typing import Annotated

from ..files.checked import Angle, Angles, FileModel, Force, Sizes, Vector, quantity
from ..shapes import Box
from ..values import Pose
from .description import PadContact


class FrameFile(FileModel):
    """A place and an orientation."""

    at: Vector = (0.0, 0.0, 0.0)
    """Where: x, y, z in the frame in which this one is given."""
    rpy: Angles = (0.0, 0.0, 0.0)
    """How it is turned: about x, then y, then z of that frame."""

    def pose(self) -> Pose:
        return Pose.from_rpy(self.at, self.rpy)


class TcpFile(FrameFile):
    """The tool centre point: between the finger pads, z out of the hand, the fingers moving along y."""

    link: str
    """The link of the URDF in whose frame it is given."""


class BoxFile(FrameFile):
    """A box that stands for a part of the gripper."""

    box: Sizes
    """Edge lengths along x, y, z; `at` is its centre."""

    def placed(self) -> tuple[Box, Pose]:
        return Box(self.box), self.pose()


class JointFile(FileModel):
    """What one joint of the arm may do."""

    lower: Angle
    """Smallest angle."""
    upper: Angle
    """Greatest angle."""
    velocity: Annotated[float, quantity("rad/s", above=0)]
    """Greatest speed."""
    acceleration: Annotated[float, quantity("rad/s2", above=0)]
    """Greatest acceleration."""
    torque: Annotated[float, quantity("Nm", above=0)]
    """Greatest torque."""


class PadContactFile(FileModel):
    """How the finger pads touch in simulation: pybullet's soft contact."""

    stiffness: Annotated[float, quantity("N/m", above=0)] = PadContact().stiffness
    """Of the contact."""
    damping: Annotated[float, quantity("", above=0)] = PadContact().damping
    """Of the contact, in Ns/m."""
    friction: Annotated[float, quantity("", above=0)] = PadContact().friction
    """Coulomb's coefficient; it is multiplied with the item's."""
    spinning_friction: Annotated[float, quantity("", least=0)] = PadContact().spinning_friction
    """Coefficient against turning about the line between the pads."""


class GripperFile(FileModel):
    """A gripper with two parallel fingers."""

    joints: tuple[str, str]
    """The two finger joints of the URDF."""
    links: tuple[str, str]
    """The two finger links of the URDF, in the order of the joints."""
    max_width: Annotated[float, quantity("m", above=0)]
    """Greatest opening between the pads."""
    max_force: Force
    """Greatest grip force of a finger."""
    speed: Annotated[float, quantity("m/s", above=0)]
    """Of each finger."""
    gear: Annotated[float, quantity("")] = -1.0
    """Ratio of the constraint between the finger joints, as pybullet counts it: -1 for a mirror image."""
    tip: Annotated[float, quantity("m", least=0)]
    """From the TCP out to the finger tips."""
    palm: Annotated[float, quantity("m", above=0)]
    """From the TCP back to the palm."""
    pads: tuple[BoxFile, BoxFile]
    """The pads, each in the frame of its finger link."""
    pad_contact: PadContactFile = PadContactFile()
    """How the pads touch in simulation."""
    hand: tuple[BoxFile, ...]
    """Boxes around the hand without the fingers, in the frame of the TCP."""
    finger: BoxFile
    """A box around the finger on the +y side at opening 0, in the frame of the TCP; the other mirrors it."""


class RobotFile(FileModel):
    """A robot: an arm with a gripper, described beside its URDF."""

    urdf: str
    """Its URDF: a path beside this file, or 'package:path' inside an installed Python package."""
    base: FrameFile = FrameFile()
    """Where its base stands in the world."""
    joints: dict[str, JointFile]
    """The arm's joints by their names in the URDF, from the base outwards."""
    poses: dict[str, tuple[Angle, ...]]
    """Named configurations, an angle for each joint; `home` is among them."""
    tcp: TcpFile
    """The tool centre point."""
    flange_joint: str
    """The fixed joint between arm and hand, where the wrist sensor sits."""
    gripper: GripperFile
    """Its gripper."""
    disabled_pairs: tuple[tuple[str, str], ...] = ()
    """Pairs of links that are not checked for collision: neighbours, and those that never meet."""
