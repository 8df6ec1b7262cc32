"""Grammar of robot files: a model for each kind of entry."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from picktree.files.yaml import file_models
from picktree.world import Box, Pose, planner_names

from .description import PadContact

Moment = Annotated[float, file_models.quantity("")]


class FrameFile(file_models.FileModel):
    """A place and an orientation."""

    at: file_models.Vector = (0.0, 0.0, 0.0)
    """Where: x, y, z in the frame in which this one is given."""
    rpy: file_models.Angles = (0.0, 0.0, 0.0)
    """How it is turned: about x, then y, then z of that frame."""

    def pose(self) -> Pose:
        return Pose.from_rpy(self.at, self.rpy)


class TcpFile(FrameFile):
    """The tool centre point: between the finger pads, z out of the hand, the fingers moving along y."""

    link: str
    """The link of the URDF in whose frame it is given."""


class BoxFile(FrameFile):
    """A box that stands for a part of the gripper."""

    box: file_models.Sizes
    """Edge lengths along x, y, z; `at` is its centre."""

    def placed(self) -> tuple[Box, Pose]:
        return Box(self.box), self.pose()


class JointFile(file_models.FileModel):
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


class PadContactFile(file_models.FileModel):
    """How the finger pads touch in simulation: pybullet's soft contact."""

    stiffness: Annotated[float, file_models.quantity("N/m", above=0)] = PadContact().stiffness
    """Stiffness of the contact."""
    damping: Annotated[float, file_models.quantity("", above=0)] = PadContact().damping
    """Damping of the contact, in Ns/m."""
    friction: Annotated[float, file_models.quantity("", above=0)] = PadContact().friction
    """Coulomb's coefficient; it is multiplied with the item's."""
    spinning_friction: Annotated[float, file_models.quantity("", least=0)] = PadContact().spinning_friction
    """Coefficient against turning about the line between the pads."""


class LinkageFile(file_models.FileModel):
    """Fingers that one motor moves through hinges, as the knuckles of a four-bar linkage."""

    drive: str
    """The joint of the URDF that the motor turns."""
    opened: file_models.Angle
    """Its angle at the greatest opening."""
    closed: file_models.Angle
    """Its angle when the gripper is closed."""
    followers: dict[str, Annotated[float, file_models.quantity("")]]
    """The other joints that move with it, and how far each turns for a radian of the driven one."""
    offsets: dict[str, file_models.Angle] = Field(default_factory=dict[str, float])
    """Where followers stand when the driven joint is at 0; those that are not named stand at 0."""


class GripperFile(file_models.FileModel):
    """A gripper with two parallel fingers, on two sliders (`joints`) or moved by a `linkage`."""

    joints: tuple[str, str] | None = None
    """The two sliding finger joints of the URDF, each of which goes half of the way."""
    linkage: LinkageFile | None = None
    """Instead of `joints`, where one motor moves both fingers through hinges."""
    links: tuple[str, str]
    """The two finger links of the URDF, in the order of the joints; of a linkage, the +y finger first."""
    max_width: Annotated[float, file_models.quantity("m", above=0)] | None = None
    """Greatest opening between the pads. Needed with `joints`; of a linkage it is computed from the pads."""
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
    pads: tuple[BoxFile, BoxFile]
    """The pads, each in the frame of its finger link, with edges along the x, y and z of the TCP."""
    finger_bodies: tuple[BoxFile, ...] = ()
    """The rest of the fingers between pad and palm, each in the frame of its link: of the first and the
    second finger in turn. They collide without gripping: they stand back behind the pad's face."""
    pad_contact: PadContactFile = PadContactFile()
    """How the pads touch in simulation."""
    hand: tuple[BoxFile, ...]
    """Boxes around the hand without the fingers, in the frame of the TCP."""
    finger: BoxFile | None = None
    """A box around the finger on the +y side at opening 0, in the frame of the TCP; the other mirrors it.
    Without it, its pad and the bodies behind it are taken."""


class InertiaFile(file_models.FileModel):
    """Mass and inertia of a link, about its centre of mass in the axes of the link."""

    mass: file_models.Mass
    """Mass of the link."""
    at: file_models.Vector
    """Its centre of mass in the link's frame."""
    moments: tuple[Moment, Moment, Moment]
    """ixx, iyy, izz in kg·m²."""
    products: tuple[Moment, Moment, Moment] = (0.0, 0.0, 0.0)
    """ixy, ixz, iyz in kg·m²."""


class MountFile(FrameFile):
    """A gripper of another URDF, hung on the arm; `at` and `rpy` place its first link in the arm's link."""

    urdf: Annotated[str, file_models.NamedFile("urdf")]
    """The gripper's URDF, named as the arm's. It may hold more than the gripper."""
    link: str = ""
    """Its links from this one on are taken; without it, all."""
    to: str
    """The link of the arm that carries it."""
    joint: str = "mount"
    """Name of the fixed joint that holds it, which can be named as the `flange_joint`."""
    prefix: str = ""
    """Put before the names of the gripper's links and joints, where the arm has the same ones."""


class RobotFile(file_models.FileModel):
    """A robot: an arm with a gripper, described beside its URDF."""

    urdf: Annotated[str, file_models.NamedFile("urdf")]
    """Its URDF: a path beside this file, or 'package:path' inside an installed Python package."""
    mount: MountFile | None = None
    """A gripper of another URDF, for an arm that comes without one."""
    inertias: dict[str, InertiaFile] = Field(default_factory=lambda: dict[str, InertiaFile]())
    """Inertias by the name of the link, instead of those of the URDF where no real body can have them."""
    attachments: dict[str, tuple[BoxFile, ...]] = Field(
        default_factory=lambda: dict[str, tuple[BoxFile, ...]]()
    )
    """Boxes that are fixed to links, by the name of the link and in its frame: longer fingers, a bracket.
    They collide, and pictures show them; what they weigh is said under `inertias`."""
    base: FrameFile = FrameFile()
    """Where its base stands in the world."""
    joints: dict[str, JointFile]
    """The arm's joints by their names in the URDF, from the base outwards."""
    poses: dict[str, tuple[file_models.Angle, ...]]
    """Named configurations, an angle for each joint; `home` is among them."""
    tcp: TcpFile
    """The tool centre point."""
    flange_joint: str
    """The fixed joint between arm and hand, where the wrist sensor sits."""
    flange_behind: str | None = None
    """The arm's last joint, of a URDF without a fixed joint between arm and hand. `flange_joint` is put in
    behind it, and what that joint moves becomes the hand."""
    payload: file_models.Mass | None = None
    """Rated payload: what may hang on the flange, the hand itself included. Not watched unless given."""
    gripper: GripperFile
    """Its gripper."""
    planner: planner_names.PlannerName | None = None
    """Planner of its free motions, unless the scene says another; `auto` unless one of the two files says."""
    disabled_pairs: tuple[tuple[str, str], ...] = ()
    """Pairs of links that are not checked for collision: neighbours, and those that never meet."""
