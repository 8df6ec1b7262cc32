"""The grammar of robot files: one model for each kind of entry."""

from __future__ import annotations

from typing import Annotated

from ..files.checked import Angle, Angles, FileModel, Force, Sizes, Vector, quantity
from ..shapes import Box
from ..values import Pose
from .description import PadContact


class FrameFile(FileModel):
    at: Vector = (0.0, 0.0, 0.0)
    rpy: Angles = (0.0, 0.0, 0.0)

    def pose(self) -> Pose:
        return Pose.from_rpy(self.at, self.rpy)


class TcpFile(FrameFile):
    link: str


class BoxFile(FrameFile):
    box: Sizes

    def placed(self) -> tuple[Box, Pose]:
        return Box(self.box), self.pose()


class JointFile(FileModel):
    lower: Angle
    upper: Angle
    velocity: Annotated[float, quantity("rad/s", above=0)]
    acceleration: Annotated[float, quantity("rad/s2", above=0)]
    torque: Annotated[float, quantity("Nm", above=0)]


class PadContactFile(FileModel):
    stiffness: Annotated[float, quantity("N/m", above=0)] = PadContact().stiffness
    damping: Annotated[float, quantity("", above=0)] = PadContact().damping
    friction: Annotated[float, quantity("", above=0)] = PadContact().friction
    spinning_friction: Annotated[float, quantity("", least=0)] = PadContact().spinning_friction


class GripperFile(FileModel):
    joints: tuple[str, str]
    links: tuple[str, str]
    max_width: Annotated[float, quantity("m", above=0)]
    max_force: Force
    speed: Annotated[float, quantity("m/s", above=0)]
    gear: Annotated[float, quantity("")] = -1.0
    tip: Annotated[float, quantity("m", least=0)]
    palm: Annotated[float, quantity("m", above=0)]
    pads: tuple[BoxFile, BoxFile]
    pad_contact: PadContactFile = PadContactFile()
    hand: tuple[BoxFile, ...]
    finger: BoxFile


class RobotFile(FileModel):
    urdf: str
    base: FrameFile = FrameFile()
    joints: dict[str, JointFile]
    poses: dict[str, tuple[Angle, ...]]
    tcp: TcpFile
    flange_joint: str
    gripper: GripperFile
    disabled_pairs: tuple[tuple[str, str], ...] = ()
