"""Contents of a robot file as values. No arm has code of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from picktree.files.yaml import file_models
from picktree.world import Box, Pose, planar_geometry


class FrameFile(file_models.FileModel):
    """A position and an orientation."""

    at: file_models.Vector = (0.0, 0.0, 0.0)
    """Position: x, y, z in the frame of reference."""
    rpy: file_models.Angles = (0.0, 0.0, 0.0)
    """Rotation about x, then y, then z of the frame of reference."""

    def pose(self) -> Pose:
        return Pose.from_rpy(self.at, self.rpy)


class BoxFile(FrameFile):
    """A box that approximates a part of the gripper."""

    box: file_models.Sizes
    """Edge lengths along x, y, z; `at` is its centre."""

    def placed(self) -> tuple[Box, Pose]:
        return Box(self.box), self.pose()


PlacedBox = Annotated[tuple[Box, Pose], file_models.ReadAs(BoxFile, BoxFile.placed)]
"""Box with the pose of its centre."""


@dataclass(frozen=True, slots=True)
class JointLimits(file_models.FileValue):
    """Limits of one joint of the arm."""

    lower: file_models.Angle
    """Smallest angle."""
    upper: file_models.Angle
    """Greatest angle."""
    velocity: Annotated[float, file_models.quantity("rad/s", above=0)]
    """Greatest speed."""
    acceleration: Annotated[float, file_models.quantity("rad/s2", above=0)]
    """Greatest acceleration."""
    torque: Annotated[float, file_models.quantity("Nm", above=0)]
    """Greatest torque."""


@dataclass(frozen=True, slots=True)
class PadContact(file_models.FileValue):
    """Contact of the finger pads in simulation: pybullet's soft contact."""

    stiffness: Annotated[float, file_models.quantity("N/m", above=0)] = 30000.0
    """Stiffness of the contact."""
    damping: Annotated[float, file_models.quantity("", above=0)] = 1000.0
    """Damping of the contact, in Ns/m."""
    friction: Annotated[float, file_models.quantity("", above=0)] = 1.0
    """Coulomb's coefficient; it is multiplied with the item's."""
    spinning_friction: Annotated[float, file_models.quantity("", least=0)] = 0.1
    """Coefficient of friction against rotation about the line between the pads."""


@dataclass(frozen=True, slots=True)
class Follower:
    """Joint that follows the driven one: its position is multiplier · drive + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Linkage:
    """Finger linkage: hinges that one motor moves. The tables run from closed to opened, at `angles` rad
    of the driven joint. `widths` are distances between the pads, m; `tips` the reach of the tips beyond
    the TCP, m."""

    drive: str
    followers: tuple[Follower, ...]
    knuckles: tuple[str, str]
    """Joint of each finger, drive or follower, that is nearest to the hand."""
    angles: tuple[float, ...]
    widths: tuple[float, ...]
    tips: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperSettings(file_models.FileValue):
    """Force, speed and shape of a parallel gripper.

    In the TCP frame z points out of the hand and the fingers move along y.
    """

    max_force: file_models.Force
    """Greatest grip force of a finger."""
    speed: Annotated[float, file_models.quantity("m/s", above=0)]
    """Speed of each finger."""
    gear: Annotated[float, file_models.quantity("")] = -1.0
    """Ratio of the constraint between the finger joints, as pybullet counts it: -1 for a mirror image."""
    tip: Annotated[float, file_models.quantity("m", least=0)]
    """Distance from the TCP out to the finger tips, where they reach furthest."""
    palm: Annotated[float, file_models.quantity("m", above=0)]
    """Distance from the TCP back to the palm."""
    pads: tuple[PlacedBox, PlacedBox]
    """The pads, each in the frame of its finger link, with edges along the x, y and z of the TCP."""
    finger_bodies: tuple[PlacedBox, ...] = ()
    """Remaining parts of the fingers between pad and palm, each in the frame of its link.

    Boxes of the first and the second finger alternate. They collide without gripping, because they are behind
    the face of the pad."""
    pad_contact: PadContact = PadContact()
    """Contact of the pads in simulation."""
    hand: tuple[PlacedBox, ...]
    """Boxes around the hand without the fingers, in the frame of the TCP."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperDescription(GripperSettings):
    """A parallel gripper of a robot."""

    joints: tuple[str, ...]
    """Joints that move the fingers: the two sliders, or the driven joint and its followers."""
    fingers: tuple[str, str]
    """Links that carry the pads."""
    max_width: float
    """Opening between the pads when open, m."""
    finger_boxes: tuple[tuple[Box, Pose], ...]
    """Boxes that enclose the +y finger at opening 0, in the TCP frame; mirrored for the other."""
    linkage: Linkage | None = None
    """Finger linkage; None: two sliders."""

    @property
    def min_width(self) -> float:
        """Opening between the pads when shut, m: the fingers of some linkages do not meet."""
        return 0.0 if self.linkage is None else max(self.linkage.widths[0], 0.0)

    def bodies_of(self, finger: int) -> tuple[tuple[Box, Pose], ...]:
        """Return the boxes behind the pad of the first (0) or second (1) finger."""
        return self.finger_bodies[finger::2]

    def finger_depth(self, *, whole: bool) -> float:
        """Return half of a finger's size along the TCP's x axis, m. `whole`: with the body behind the pad."""
        bodies = self.bodies_of(0) if whole else ()
        return max(box.size[0] for box, _ in (self.pads[0], *bodies)) / 2


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """A robot file, read and resolved."""

    name: str
    urdf: str
    """Path of the URDF on this machine."""
    base_in_world: Pose
    joints: tuple[str, ...]
    """Joints of the arm, from the base on."""
    limits: tuple[JointLimits, ...]
    named: Mapping[str, tuple[float, ...]]
    """Named configurations; `home` must be among them."""
    tcp_link: str
    tcp_in_link: Pose
    flange_joint: str
    """Fixed joint whose reaction is the wrist's force/torque reading."""
    gripper: GripperDescription
    disabled_pairs: tuple[tuple[str, str], ...]
    """Pairs of links that are not checked against each other."""
    payload: float | None = None
    """Rated payload at the flange, the hand itself included, kg. None: unknown."""
    planner: str = ""
    """Planner of its free motions; empty: `auto`."""
    source: str = ""
    text: str = ""
    tool: Pose = field(default_factory=Pose)
    """True TCP in the frame of the TCP that URDF and `tcp_in_link` give: mounting error of the whole hand.
    The belief has the calibrated value, the simulation alone the true one."""


def tool_outline(
    gripper: GripperDescription, opening: float
) -> tuple[planar_geometry.PlanarOutline, planar_geometry.PlanarOutline]:
    """Return the outlines of the two fingers from above, the +y finger first. `opening` in m; frame: the
    TCP's planar frame, with y across the fingers."""
    depth, thick = gripper.finger_depth(whole=True), gripper.pads[0][0].size[1]
    near, far = opening / 2, opening / 2 + thick
    one = np.array([[-depth, near], [depth, near], [depth, far], [-depth, far]])
    other = np.array([[-depth, -far], [depth, -far], [depth, -near], [-depth, -near]])
    return planar_geometry.PlanarOutline(one), planar_geometry.PlanarOutline(other)
