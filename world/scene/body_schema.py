"""Grammar of the bodies in scene files: shapes, holes, fixtures, unknown obstacles, catalogue entries."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, get_args

from pydantic import AfterValidator, WithJsonSchema

from ...files.value_wording import describe, suggest_name
from ...files.yaml.file_models import (
    Angle,
    Angles,
    FileModel,
    Force,
    InvalidValue,
    ItemMass,
    Length,
    Name,
    Size,
    Sizes,
    Vector,
    as_mapping,
    quantity,
)
from ...files.yaml.named_files import NamedFile
from ..colours import COLOURS, ITEM_COLOURS, PLAIN_COLOURS
from .description import Form

FORMS: tuple[Form, ...] = get_args(Form)


def _plain_colour(name: str) -> str:
    if name in ITEM_COLOURS:
        plain = ", ".join(PLAIN_COLOURS)
        message = f"{name} is a colour of items: a camera tells items from fixtures by it"
        raise InvalidValue(message, f"one of {plain}", code="P108")
    if name not in PLAIN_COLOURS:
        raise InvalidValue(f"unknown colour {describe(name)}", suggest_name(name, PLAIN_COLOURS), code="P108")
    return name


def _colour(name: str) -> str:
    if name not in COLOURS:
        raise InvalidValue(f"unknown colour {describe(name)}", suggest_name(name, COLOURS), code="P108")
    return name


AnyColour = Annotated[str, AfterValidator(_colour), WithJsonSchema({"enum": list(COLOURS)})]
PlainColour = Annotated[str, AfterValidator(_plain_colour), WithJsonSchema({"enum": list(PLAIN_COLOURS)})]
ItemSize = Annotated[float, quantity("m", least=0.001, most=1.0)]
ItemSizes = tuple[ItemSize, ItemSize, ItemSize]
Corner = tuple[Length, Length]
BeltSpeed = Annotated[float, quantity("m/s", least=0.005, most=0.5)]
HoleSize = Annotated[float, quantity("m", least=0.002, most=1.0)]
Chamfer = Annotated[float, quantity("m", least=0, most=0.05)]
Displacement = Annotated[float, quantity("m", least=0, most=0.05)]
Misturn = Annotated[float, quantity("rad", least=0, most=math.radians(15))]


class CylinderFile(FileModel):
    """A cylinder that stands on a round face."""

    radius: ItemSize
    """Radius of the round face."""
    height: ItemSize
    """Along its axis."""


class SphereFile(FileModel):
    """A ball."""

    radius: ItemSize
    """Half its width."""


class MeshFile(FileModel):
    """A body from a mesh file: convex, or decomposed into at most 16 convex parts."""

    file: Annotated[str, NamedFile("mesh")]
    """A mesh file (OBJ, STL, PLY, OFF, DAE, GLB) of one closed surface; its path counts from this file."""
    scale: Annotated[float, quantity("", above=0)] = 1.0
    """Factor on the mesh's own coordinates: 0.001 for a mesh in mm."""


class HoleFile(FileModel):
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
    depth: Size
    """Depth from the mouth to the bottom; the hole goes through the box when this is the box's height."""
    chamfer: Chamfer = 0.0
    """Height and width of the bevel around the mouth."""
    yaw: Angle | None = None
    """How a square or a slot is turned in the box, about the vertical."""


class UncertaintyFile(FileModel):
    """How far a fixture may really stand from where the file says; where, is drawn from the seed, and nobody
    tells the robot."""

    position: Displacement = 0.0
    """Along its own x and y, each way."""
    angle: Misturn = 0.0
    """About the vertical, each way, and of its tilt."""


class FixtureFile(FileModel):
    """Body that stays where it is: a box as a table or shelf, a bin, a tote, a belt with items on it, a
    target."""

    one_of: ClassVar[tuple[str, ...]] = ("box", "bin", "tote", "belt", "marker")
    """Exactly one of these is given."""

    box: Sizes | None = None
    """Edge lengths along x, y, z; `at` is its centre. Either this, `bin`, `tote` or `belt`."""
    bin: Sizes | None = None
    """Outside lengths of an open bin along x, y, z; `at` is the centre of its underside. Needs `wall`."""
    tote: Sizes | None = None
    """Outside lengths of an open container along x, y, z, like a bin, from which items are taken. Needs
    `wall`."""
    belt: Sizes | None = None
    """Length, width and height of a belt that runs along its own +x; `at` is the centre of its underside.
    Needs `speed` and `eye`."""
    marker: Sizes | None = None
    """Edge lengths of a block with six coloured squares on its top, from which cameras and tool are
    calibrated. `at` is its centre, and need be known to a few millimetres only."""
    at: Vector
    """Where it stands: x, y, z in the world."""
    rpy: Angles | None = None
    """How it is turned: about the world's x, then y, then z. Only a box."""
    yaw: Angle | None = None
    """How it is turned about the world's z, where that is all. Not beside `rpy`."""
    wall: Size | None = None
    """Thickness of the walls and floor of a bin or tote."""
    speed: BeltSpeed | None = None
    """Speed of a belt while it runs."""
    eye: Length | None = None
    """Where the light barrier crosses a belt, from its middle along +x: there it stops for the robot."""
    holes: dict[Name, HoleFile] | None = None
    """Holes in the top face of a box by name, into which items are put; each is a destination."""
    uncertainty: UncertaintyFile | None = None
    """How far a box may really stand from here."""
    colour: PlainColour = "grey"
    """Colour that cameras see: an unsaturated one, so that it differs from those of items."""


class UnknownFile(FileModel):
    """A body that stands still, of which the robot is not told: it has to see it."""

    one_of: ClassVar[tuple[str, ...]] = ("box", "cylinder", "sphere")
    """Exactly one of these is given."""

    box: Sizes | None = None
    """Edge lengths along x, y, z."""
    cylinder: CylinderFile | None = None
    """A round post, along its own z."""
    sphere: SphereFile | None = None
    """A ball that stays where it is."""
    at: Vector
    """Its centre: x, y, z in the world."""
    rpy: Angles | None = None
    """How it is turned: about the world's x, then y, then z."""
    yaw: Angle | None = None
    """How it is turned about the world's z, where that is all. Not beside `rpy`."""
    colour: AnyColour = "grey"
    """Colour that cameras see; it may be one of the items' colours."""


class CatalogueFile(FileModel):
    """A kind of item: what the scene may spawn and perception may recognise."""

    one_of: ClassVar[tuple[Form, ...]] = FORMS
    """Exactly one of these is given."""

    box: ItemSizes | None = None
    """Edge lengths along x, y, z as it stands on the table."""
    cylinder: CylinderFile | None = None
    """A can: it stands upright or lies."""
    sphere: SphereFile | None = None
    """A ball."""
    plate: ItemSizes | None = None
    """A flat box; its height, the last number, is at most a third of the shorter side."""
    mesh: Annotated[MeshFile | None, as_mapping("file", MeshFile | str | None)] = None
    """A body of another shape, convex or not; a bare text is its mesh file."""
    mass: ItemMass
    """Mass of one item."""
    friction: Annotated[float, quantity("", least=0, most=2)]
    """Coulomb's coefficient against the table and the fingers."""
    force_limit: Force | None = None
    """Greatest grip force of a finger that it survives; without it any."""
