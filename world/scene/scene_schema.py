"""Grammar of scene files where it differs from the values: bodies, holes, catalogue, views of cameras."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, get_args

from pydantic import AfterValidator, WithJsonSchema

from picktree.files import describe, suggest_name
from picktree.files.yaml import file_models
from picktree.world import COLOURS, ITEM_COLOURS, PLAIN_COLOURS, Pose

from .description import (
    CameraSettings,
    Corner,
    Delivery,
    Destination,
    Form,
    PlacementUncertainty,
    SceneSettings,
    Spawn,
)

FORMS: tuple[Form, ...] = get_args(Form)


def _plain_colour(name: str) -> str:
    if name in ITEM_COLOURS:
        plain = ", ".join(PLAIN_COLOURS)
        message = f"{name} is a colour of items: a camera tells items from fixtures by it"
        raise file_models.InvalidValue(message, f"one of {plain}", code="P108")
    if name not in PLAIN_COLOURS:
        raise file_models.InvalidValue(
            f"unknown colour {describe(name)}", suggest_name(name, PLAIN_COLOURS), code="P108"
        )
    return name


def _colour(name: str) -> str:
    if name not in COLOURS:
        raise file_models.InvalidValue(
            f"unknown colour {describe(name)}", suggest_name(name, COLOURS), code="P108"
        )
    return name


AnyColour = Annotated[str, AfterValidator(_colour), WithJsonSchema({"enum": list(COLOURS)})]
PlainColour = Annotated[str, AfterValidator(_plain_colour), WithJsonSchema({"enum": list(PLAIN_COLOURS)})]
ItemSize = Annotated[float, file_models.quantity("m", least=0.001, most=1.0)]
ItemSizes = tuple[ItemSize, ItemSize, ItemSize]
BeltSpeed = Annotated[float, file_models.quantity("m/s", least=0.005, most=0.5)]
HoleSize = Annotated[float, file_models.quantity("m", least=0.002, most=1.0)]
Chamfer = Annotated[float, file_models.quantity("m", least=0, most=0.05)]


class CylinderFile(file_models.FileModel):
    """A cylinder on a round face."""

    radius: ItemSize
    """Radius of the round face."""
    height: ItemSize
    """Height along its axis."""


class SphereFile(file_models.FileModel):
    """A ball."""

    radius: ItemSize
    """Radius of the ball."""


class MeshFile(file_models.FileModel):
    """A body from a mesh file; a body that is not convex is decomposed into at most 16 convex parts."""

    file: Annotated[str, file_models.NamedFile("mesh")]
    """A closed mesh (OBJ, STL, DAE, PLY, OFF or GLB); its path counts from this file."""
    scale: Annotated[float, file_models.quantity("", above=0)] = 1.0
    """Factor on the mesh's own coordinates: 0.001 for a mesh in mm."""


class HoleFile(file_models.FileModel):
    """A hole with straight walls, from the top face of a box downwards."""

    one_of: ClassVar[tuple[str, ...]] = ("round", "square", "slot")
    """Exactly one of these is given."""

    round: HoleSize | None = None
    """Diameter that is free inside."""
    square: HoleSize | None = None
    """Length of each side inside."""
    slot: tuple[HoleSize, HoleSize] | None = None
    """Length and width inside; its ends are straight, its corners sharp."""
    at: Corner
    """The middle of its mouth: x and y from the middle of the box's top face, in the box's own frame."""
    depth: file_models.Size
    """Depth from the mouth to the bottom; the hole goes through the box when this is the box's height."""
    chamfer: Chamfer = 0.0
    """Height and width of the bevel around the mouth."""
    yaw: file_models.Angle | None = None
    """Rotation of a square or a slot in the box, about the vertical."""


class PlacedFile(file_models.FileModel):
    """Pose of a body in the world."""

    at: file_models.Vector
    """Position: x, y, z in the world."""
    rpy: file_models.Angles | None = None
    """Rotation about the world's x, then y, then z."""
    yaw: file_models.Angle | None = None
    """Rotation about the world's z alone. Not beside `rpy`."""

    def pose(self) -> Pose:
        return Pose.from_rpy(self.at, self.rpy or (0.0, 0.0, self.yaw or 0.0))


class FixtureFile(PlacedFile):
    """Body that never moves: a box as a table or shelf, a bin, a tote, a belt with items on it, a target."""

    one_of: ClassVar[tuple[str, ...]] = ("box", "bin", "tote", "belt", "marker")
    """Exactly one of these is given."""

    box: file_models.Sizes | None = None
    """Edge lengths along x, y, z; `at` is its centre. Either this, `bin`, `tote` or `belt`."""
    bin: file_models.Sizes | None = None
    """Outside lengths of an open bin along x, y, z; `at` is the centre of its underside. Needs `wall`."""
    tote: file_models.Sizes | None = None
    """Outside lengths of an open container along x, y, z, like a bin, from which items are taken. Needs
    `wall`."""
    belt: file_models.Sizes | None = None
    """Length, width and height of a belt that runs along its own +x; `at` is the centre of its underside.
    Needs `speed` and `eye`."""
    marker: file_models.Sizes | None = None
    """Edge lengths of a block with six coloured squares on its top, a target for the calibration of cameras
    and tool. `at` is its centre, to within a few millimetres."""
    wall: file_models.Size | None = None
    """Thickness of the walls and floor of a bin or tote."""
    speed: BeltSpeed | None = None
    """Speed of a belt while it runs."""
    eye: file_models.Length | None = None
    """Position of the light barrier of a belt, from its middle along +x. A belt stops for the robot when an
    item reaches it."""
    holes: dict[file_models.Name, HoleFile] | None = None
    """Holes in the top face of a box by name, into which items are put; each is a destination."""
    uncertainty: PlacementUncertainty | None = None
    """Greatest displacement of a box from this pose."""
    colour: PlainColour = "grey"
    """Colour that cameras see: an unsaturated one, so that it differs from those of items."""


class UnknownFile(PlacedFile):
    """A fixed body that is unknown to the robot, which has to see it."""

    one_of: ClassVar[tuple[str, ...]] = ("box", "cylinder", "sphere")
    """Exactly one of these is given."""

    box: file_models.Sizes | None = None
    """Edge lengths along x, y, z."""
    cylinder: CylinderFile | None = None
    """A round post, along its own z."""
    sphere: SphereFile | None = None
    """A fixed ball."""
    colour: AnyColour = "grey"
    """Colour that cameras see; it may be one of the items' colours."""


class CatalogueFile(file_models.FileModel):
    """A kind of item, which the scene may spawn and perception may recognise."""

    one_of: ClassVar[tuple[Form, ...]] = FORMS
    """Exactly one of these is given."""

    box: ItemSizes | None = None
    """Edge lengths along x, y, z in its upright pose on the table."""
    cylinder: CylinderFile | None = None
    """A can, upright or on its side."""
    sphere: SphereFile | None = None
    """A ball."""
    plate: ItemSizes | None = None
    """A flat box; its height, the last number, is at most a third of the shorter side."""
    mesh: Annotated[MeshFile | None, file_models.as_mapping("file", MeshFile | str | None)] = None
    """A body of another shape; a bare text is its mesh file."""
    mass: file_models.ItemMass
    """Mass of one item."""
    friction: Annotated[float, file_models.quantity("", least=0, most=2)]
    """Coulomb's coefficient against the table and the fingers."""
    force_limit: file_models.Force | None = None
    """Greatest grip force of a finger without damage. Default: unlimited."""


SECTIONS = ("fixtures", "unknown", "cameras", "catalogue", "spawn", "feed", "destinations")
"""The parts of a scene file that are read entry by entry; the rest is `SceneSettings`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFile(CameraSettings):
    """A camera for colour and depth, fixed in the world or mounted on the hand."""

    at: file_models.Vector
    """Position of the camera: x, y, z in the world, or in the frame of the TCP."""
    look_at: file_models.Vector
    """The point in the middle of its picture, in the same frame."""
    up: file_models.Vector | None = None
    """Direction that is up in the picture, in the same frame. Default: z, or x when the camera looks
    along z."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneFile(SceneSettings):
    """A scene: fixtures, cameras, kinds of items, and their destinations."""

    fixtures: dict[file_models.Name, FixtureFile] | None = None
    """Bodies that never move, by name: the table, bins, obstacles."""
    unknown: dict[file_models.Name, UnknownFile] | None = None
    """Initial bodies by name that are unknown to the robot."""
    cameras: dict[file_models.Name, CameraFile] | None = None
    """Cameras by name."""
    catalogue: dict[file_models.Name, CatalogueFile] | None = None
    """The kinds of items by name."""
    spawn: list[Spawn] | None = None
    """Items that are set down at random."""
    feed: list[Delivery] | None = None
    """Items that are brought during a run."""
    destinations: list[Destination] | None = None
    """Rules for the destinations of items; an item without a rule stays in its place."""
