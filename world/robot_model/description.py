"""Contents of a robot file as values. No arm has code of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from picktree.world import Box, Pose, planar_geometry


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Soft limits of one joint: rad, rad/s, rad/s², Nm."""

    lower: float
    upper: float
    velocity: float
    acceleration: float
    torque: float


@dataclass(frozen=True, slots=True)
class PadContact:
    """Contact parameters of a finger pad (pybullet's soft contact)."""

    stiffness: float = 30000.0
    damping: float = 1000.0
    friction: float = 1.0
    spinning_friction: float = 0.1


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


@dataclass(frozen=True, slots=True)
class GripperDescription:
    """A parallel gripper. In the TCP frame z points out of the hand and the fingers move along y."""

    joints: tuple[str, ...]
    """Joints that move the fingers: the two sliders, or the driven joint and its followers."""
    fingers: tuple[str, str]
    """Links that carry the pads."""
    max_width: float
    """Opening between the pads when open, m."""
    max_force: float
    """N a finger"""
    speed: float
    """m/s a finger"""
    pads: tuple[tuple[Box, Pose], tuple[Box, Pose]]
    """Box primitive of each pad, with its pose in its finger link."""
    pad_contact: PadContact
    gear: float
    """Ratio of the constraint between the finger joints (pybullet's convention), -1 for a mirror image."""
    tip: float
    """Distance from the TCP forward (+z) to the finger tips where they reach furthest, m."""
    palm: float
    """Distance from the TCP back (-z) to the palm, m."""
    hand: tuple[tuple[Box, Pose], ...]
    """Boxes that enclose hand (without fingers), each with its pose in the TCP frame."""
    finger_boxes: tuple[tuple[Box, Pose], ...]
    """Boxes that enclose the +y finger at opening 0, in the TCP frame; mirrored for the other."""
    linkage: Linkage | None = None
    """Finger linkage; None: two sliders."""
    finger_bodies: tuple[tuple[Box, Pose], ...] = ()
    """Boxes of the first and the second finger in turn, behind their pads, each with its pose in its finger
    link; empty: unknown."""

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
