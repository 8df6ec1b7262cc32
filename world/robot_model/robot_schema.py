"""Grammar of robot files where it differs from the values: TCP, linkage, gripper, mount, whole file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from picktree.files.yaml import file_models
from picktree.world import Pose, planner_names

from .description import FrameFile, GripperSettings, JointLimits, PlacedBox
from .gripper_mounting import LinkInertia


class TcpFile(FrameFile):
    """The tool centre point: between the finger pads, z out of the hand, the fingers moving along y."""

    link: str
    """The link of the URDF in whose frame it is given."""


class LinkageFile(file_models.FileModel):
    """Fingers that one motor drives through hinges, for example the knuckles of a four-bar linkage."""

    drive: str
    """The joint of the URDF that the motor turns."""
    opened: file_models.Angle
    """Angle of the driven joint at the greatest opening."""
    closed: file_models.Angle
    """Angle of the driven joint when the gripper is closed."""
    followers: dict[str, Annotated[float, file_models.quantity("")]]
    """Multipliers of the following joints: rotation of each for a radian of the driven joint."""
    offsets: dict[str, file_models.Angle] = Field(default_factory=dict[str, float])
    """Angles of followers when the driven joint is at 0. Default: 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperFile(GripperSettings):
    """A gripper with two parallel fingers, on two sliders (`joints`) or moved by a `linkage`."""

    joints: tuple[str, str] | None = None
    """The two sliding finger joints of the URDF; each moves by half of the opening."""
    linkage: LinkageFile | None = None
    """Linkage instead of `joints`, for one motor that moves both fingers through hinges."""
    links: tuple[str, str]
    """The two finger links of the URDF, in the order of the joints; of a linkage, the +y finger first."""
    max_width: Annotated[float, file_models.quantity("m", above=0)] | None = None
    """Greatest opening between the pads. Needed with `joints`; of a linkage it is computed from the pads."""
    finger: PlacedBox | None = None
    """A box around the finger on the +y side at opening 0, in the frame of the TCP; the other finger mirrors
    the box. Without this key, the pad and the bodies behind the pad are used."""


class MountFile(FrameFile):
    """A gripper from a URDF of its own, mounted on the arm. `at` and `rpy` are the pose of its first link in
    the frame of the arm's link."""

    urdf: Annotated[str, file_models.NamedFile("urdf")]
    """The gripper's URDF, in the same form as the arm's `urdf`. It may hold more than the gripper."""
    link: str = ""
    """First link of the gripper; the links from it on are used. Without it, all links."""
    to: str
    """The link of the arm that carries it."""
    joint: str = "mount"
    """Name of the fixed joint that holds the gripper; `flange_joint` may name it."""
    prefix: str = ""
    """Prefix of the names of the gripper's links and joints, for names that the arm also has."""


class RobotFile(file_models.FileModel):
    """A robot: an arm with a gripper, described beside its URDF."""

    urdf: Annotated[str, file_models.NamedFile("urdf")]
    """URDF of the robot: a path beside this file, or 'package:path' inside an installed Python package."""
    mount: MountFile | None = None
    """A gripper from a URDF of its own, for an arm that comes without one."""
    inertias: dict[str, LinkInertia] = Field(default_factory=lambda: dict[str, LinkInertia]())
    """Inertias by name of the link. They replace values of the URDF that no real body can have."""
    attachments: dict[str, tuple[PlacedBox, ...]] = Field(
        default_factory=lambda: dict[str, tuple[PlacedBox, ...]]()
    )
    """Boxes that are fixed to links, by name of the link and in its frame: longer fingers, a bracket. They
    collide, and cameras see them; `inertias` gives their mass."""
    base: Annotated[Pose, file_models.ReadAs(FrameFile, FrameFile.pose)] = Pose()
    """Pose of the base in the world."""
    joints: dict[str, JointLimits]
    """The arm's joints by their names in the URDF, from the base outwards."""
    poses: dict[str, tuple[file_models.Angle, ...]]
    """Named configurations, an angle for each joint; `home` is among them."""
    tcp: TcpFile
    """The tool centre point."""
    flange_joint: str
    """The fixed joint between arm and hand, where the wrist sensor sits."""
    flange_behind: str | None = None
    """Last joint of the arm, for a URDF without a fixed joint between arm and hand. `flange_joint` is
    inserted after it, and the links beyond become the hand."""
    payload: file_models.Mass | None = None
    """Rated payload: greatest mass at the flange, including the hand.
    Without it the payload is not monitored."""
    gripper: GripperFile
    """Gripper of the robot."""
    planner: planner_names.PlannerName | None = None
    """Planner of free motions, unless the scene names another; `auto` without either."""
    disabled_pairs: tuple[tuple[str, str], ...] = ()
    """Pairs of links that are not checked for collision: neighbours, and pairs that never meet."""
