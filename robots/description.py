"""What a robot file says, as values. Nothing about a particular arm stands in code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..world.shapes import Box
from ..world.values import Pose


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
    """A joint that follows the driven one: its position is multiplier · drive + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Linkage:
    """Fingers that one motor moves through hinges. The tables run from closed to opened, at `angles` rad of
    the driven joint: distance between the pads, m, and how far the tips reach beyond the TCP, m."""

    drive: str
    followers: tuple[Follower, ...]
    knuckles: tuple[str, str]
    """The joint of each finger, drive or follower, that is nearest to the hand."""
    angles: tuple[float, ...]
    widths: tuple[float, ...]
    tips: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class GripperDescription:
    """A parallel gripper. In the TCP frame z points out of the hand and the fingers move along y."""

    joints: tuple[str, ...]
    """All that move the fingers: the two sliders, or the driven joint and its followers."""
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
    finger_boxes: tuple[Box, Pose]
    """Box that encloses the +y finger at opening 0, in the TCP frame; mirrored for the other."""
    linkage: Linkage | None = None
    """None for two sliders."""


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
    """Rated: what may hang on the flange, the hand itself included, kg. None: nobody says."""
    source: str = ""
    text: str = ""
    tool: Pose = field(default_factory=Pose)
    """The TCP seen from where URDF and `tcp_in_link` put it: the whole hand is mounted off by it. What is
    believed of that is calibrated, what is true only the simulation knows."""
