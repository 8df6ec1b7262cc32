"""The grammar of scene files: one model for each kind of entry."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, ClassVar, Literal, cast, get_args

from pydantic import AfterValidator, BeforeValidator, Field, Strict, WithJsonSchema

from ...files.models.validation import (
    Angle,
    Angles,
    Duration,
    FileModel,
    Flag,
    Force,
    InvalidValue,
    Length,
    Mass,
    Name,
    Share,
    Size,
    Sizes,
    Vector,
    quantity,
)
from ...files.value_wording import describe, suggest_name
from ..colours import COLOURS, ITEM_COLOURS, PLAIN_COLOURS
from .description import Form, SafetyLimits, SensorNoise, Thinking

SECTIONS = ("fixtures", "unknown", "cameras", "catalogue", "spawn", "feed", "destinations")
"""The parts of a scene file that are read entry by entry; the rest is `RestFile`."""
FORMS: tuple[Form, ...] = get_args(Form)


def _item_colour(name: str) -> str:
    if name not in ITEM_COLOURS:
        raise InvalidValue(
            f"{describe(name)} is no colour that an item may have",
            suggest_name(name, ITEM_COLOURS),
            code="P108",
        )
    return name


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


def _as_mapping(key: str, given: object) -> BeforeValidator:
    """A bare value stands for a mapping with one key; `given` is what may be written."""

    def wrap(value: object) -> object:
        if value is None or isinstance(value, dict | FileModel):
            return cast("object", value)
        return {key: value}

    return BeforeValidator(wrap, json_schema_input_type=given)


def _clear(value: object) -> object:
    """What stands for no time: the robot says when."""
    if isinstance(value, str) and value != "clear":
        hint = "it is clear, {every: 45 s} or {at: [10 s, 60 s]}"
        raise InvalidValue(f"{describe(value)} is no time for a load", hint, code="P108")
    return None if value == "clear" else value


def _names(known: Iterable[str]) -> WithJsonSchema:
    return WithJsonSchema({"enum": list(known)})


ItemColour = Annotated[str, AfterValidator(_item_colour), _names(ITEM_COLOURS)]
AnyColour = Annotated[str, AfterValidator(_colour), _names(COLOURS)]
PlainColour = Annotated[str, AfterValidator(_plain_colour), _names(PLAIN_COLOURS)]
ItemSize = Annotated[float, quantity("m", least=0.001, most=1.0)]
ItemSizes = tuple[ItemSize, ItemSize, ItemSize]
Noise = Annotated[float, quantity("m", least=0, most=0.1)]
FieldOfView = Annotated[float, quantity("rad", above=0, most=math.radians(150))]
Distance = Annotated[float, quantity("m", above=0)]
Pixels = Annotated[int, Strict(), Field(ge=16, le=2048)]
Count = Annotated[int, Strict(), Field(ge=1, le=200)]
Corner = tuple[Length, Length]
Cost = Annotated[float, quantity("s", least=0, most=10)]
BeltSpeed = Annotated[float, quantity("m/s", least=0.005, most=0.5)]
Spacing = Annotated[float, quantity("m", least=0.01, most=10)]
Period = Annotated[float, quantity("s", least=1, most=86400)]
Total = Annotated[int, Strict(), Field(ge=1, le=1_000_000)]
HoleSize = Annotated[float, quantity("m", least=0.002, most=1.0)]
Chamfer = Annotated[float, quantity("m", least=0, most=0.05)]
Displacement = Annotated[float, quantity("m", least=0, most=0.05)]
Misturn = Annotated[float, quantity("rad", least=0, most=math.radians(15))]


class CylinderFile(FileModel):
    """A cylinder that stands on a round face."""

    radius: ItemSize
    """Of the round face."""
    height: ItemSize
    """Along its axis."""


class SphereFile(FileModel):
    """A ball."""

    radius: ItemSize
    """Half its width."""


class MeshFile(FileModel):
    """A convex body from a mesh file."""

    file: str
    """An OBJ or STL file; its path counts from this file. Its hull is what the robot handles."""
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
    """From the mouth to the bottom; through the box when it is the box's height."""
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
    """A body that stays where it is: a box as a table or shelf, a bin to put items into, a belt with items
    on it, or a target for calibrating."""

    one_of: ClassVar[tuple[str, ...]] = ("box", "bin", "belt", "marker")
    """Exactly one of these is given."""

    box: Sizes | None = None
    """Edge lengths along x, y, z; `at` is its centre. Either this, `bin` or `belt`."""
    bin: Sizes | None = None
    """Outside lengths of an open bin along x, y, z; `at` is the centre of its underside. Needs `wall`."""
    belt: Sizes | None = None
    """Length, width and height of a belt that runs along its own +x; `at` is the centre of its underside.
    Needs `speed` and `eye`."""
    marker: Sizes | None = None
    """Edge lengths of a block with six coloured squares on its top, from which cameras and tool are
    calibrated; `at` is its centre, and need be known to a few millimetres only."""
    at: Vector
    """Where it stands: x, y, z in the world."""
    rpy: Angles | None = None
    """How it is turned: about the world's x, then y, then z. Only a box."""
    yaw: Angle | None = None
    """How it is turned about the world's z, where that is all. Not beside `rpy`."""
    wall: Size | None = None
    """Thickness of a bin's walls and floor."""
    speed: BeltSpeed | None = None
    """Of a belt while it runs."""
    eye: Length | None = None
    """Where the light barrier crosses a belt, from its middle along +x: there it stops for the robot."""
    holes: dict[Name, HoleFile] | None = None
    """Holes in the top face of a box by name, into which items are put; each is a destination."""
    uncertainty: UncertaintyFile | None = None
    """How far a box may really stand from here."""
    colour: PlainColour = "grey"
    """What cameras see: an unsaturated colour, so that it is told from items."""


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
    """What cameras see; that of items too."""


class OffsetFile(FileModel):
    """How far a camera really hangs from where it is believed to hang, in its believed frame."""

    offset: Vector = (0.0, 0.0, 0.0)
    """Along the picture's x (right), y (down) and z (forward)."""
    rpy: Angles = (0.0, 0.0, 0.0)
    """About the picture's x, y and z."""


class CameraFile(FileModel):
    """A camera for colour and depth, which hangs still or is mounted on the hand."""

    on: Literal["world", "hand"] = "world"
    """`hand`: it moves with the tool, and `at`, `look_at` and `up` are in the frame of the TCP: its z points
    out of the hand, and along its y the fingers close."""
    at: Vector
    """Where it hangs: x, y, z in the world, or in the frame of the TCP."""
    look_at: Vector
    """The point in the middle of its picture, in the same frame."""
    up: Vector | None = None
    """What is up in the picture, a direction in the same frame; z unless given, x when it looks along z."""
    size: tuple[Pixels, Pixels] = (320, 240)
    """Width and height of the picture in pixels."""
    fov: FieldOfView = math.radians(60)
    """Vertical field of view."""
    depth_noise: Noise = 0.002
    """Standard deviation of the depth at 0.7 m; it grows with the square of the depth, and is never less than
    0.2 mm unless it is zero."""
    edge_dropout: Share = 0.5
    """Probability that a pixel on an edge of the depth picture returns nothing."""
    near: Distance = 0.05
    """Nearest depth that it sees."""
    far: Distance = 3.0
    """Farthest depth that it sees."""
    error: Annotated[OffsetFile, _as_mapping("offset", OffsetFile | Vector)] = OffsetFile()
    """Where it really hangs, seen from where it is believed to hang; three lengths stand for `offset`."""


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
    mesh: Annotated[MeshFile | None, _as_mapping("file", MeshFile | str | None)] = None
    """A convex body of another shape; a bare text is its mesh file."""
    mass: Mass
    """Of one item."""
    friction: Annotated[float, quantity("", least=0, most=2)]
    """Coulomb's coefficient against the table and the fingers."""
    force_limit: Force | None = None
    """Greatest grip force of a finger that it survives; without it any."""


class AreaFile(FileModel):
    """A rectangle on the table, along the world's axes, for the items' centres."""

    min: Corner
    """Smallest x and y in the world."""
    max: Corner
    """Greatest x and y in the world."""


class SpawnFile(FileModel):
    """Items that are set down at random where a run begins; where, follows from scene and seed alone."""

    of: Annotated[dict[str, Count], Field(min_length=1)]
    """How many of each kind of the catalogue."""
    colours: Annotated[tuple[ItemColour, ...], Field(min_length=1)]
    """Given out in turn, shuffled: with three colours a third of the items has each."""
    area: AreaFile
    """Where on the table."""
    gap: Annotated[float, quantity("m", least=0, most=1)] = 0.025
    """Free distance between any two items as seen from above."""
    lying: Share = 0.0
    """Share of the cylinders that lie on their side."""
    tumbled: Flag = False
    """Dropped from 10 cm in any orientation instead of set down: items roll, and lean on one another."""
    touching: Flag = False
    """Set down side by side, so that each touches another; most of them face to face. Then `gap` is only kept
    from other entries' items. Not beside `tumbled`."""


class WhenFile(FileModel):
    """The times at which a load comes."""

    one_of: ClassVar[tuple[str, ...]] = ("every", "at")
    """Exactly one of these is given."""

    every: Period | None = None
    """From one load to the next; the first comes after so much time."""
    at: Annotated[tuple[Duration, ...], Field(min_length=1)] | None = None
    """Simulated times since the run began, ascending."""


class FeedFile(FileModel):
    """Items that are brought while a run goes on: loads on the table, or single items on a belt."""

    one_of: ClassVar[tuple[str, ...]] = ("area", "belt")
    """Exactly one of these is given."""

    of: Annotated[dict[str, Count], Field(min_length=1)]
    """How many of each kind of the catalogue are in one load; for a belt the shares of a mixture."""
    colours: Annotated[tuple[ItemColour, ...], Field(min_length=1)]
    """Given out in turn, shuffled."""
    area: AreaFile | None = None
    """Where on the table a load is set down, wherever it is free. Either this or `belt`."""
    belt: str | None = None
    """The belt, by its name under `fixtures`, at whose upstream end items are set down one by one."""
    gap: Annotated[float, quantity("m", least=0, most=1)] | None = None
    """Free distance on the table to any other item as seen from above; 25 mm unless given."""
    lying: Share = 0.0
    """Share of the cylinders that lie on their side."""
    tumbled: Flag | None = None
    """Dropped on the table from 10 cm in any orientation instead of set down."""
    when: Annotated[
        WhenFile | None, BeforeValidator(_clear, json_schema_input_type=Literal["clear"] | WhenFile | None)
    ] = None
    """When a load comes: `clear`, that is when the robot says that it is done with what lies there (unless
    given), `{every: 45 s}` or `{at: [10 s, 60 s]}`. A belt runs whenever the robot is ready."""
    spacing: Spacing | None = None
    """Of a belt's way from one item to the next, on average; 150 mm unless given."""
    total: Total | None = None
    """How many items come in all; without it they come for ever."""


class ExchangeFile(FileModel):
    """Somebody who puts an empty bin in a full one's place when the robot asks."""

    takes: Annotated[float, quantity("s", above=0, most=3600)]
    """How long that takes while the arm is out of the way."""


class DestinationFile(FileModel):
    """A rule that says where items belong. The first that holds for an item counts."""

    where: str
    """For which items: an expression of colour, form and kind, as "colour == 'red' and kind != 'can'"."""
    to: str
    """The bin, or the fixture with holes, by its name under `fixtures`: then any free hole that fits the item
    is right. Or one hole, as board/left."""


class ToolErrorFile(FileModel):
    """How far the hand is really mounted from where the robot file has it, in the frame of its TCP."""

    offset: Vector = (0.0, 0.0, 0.0)
    """Along the TCP's x, y and z (out of the hand)."""
    rpy: Angles = (0.0, 0.0, 0.0)
    """About the TCP's x, y and z."""


class CalibratedCameraFile(FileModel):
    """Where a camera is, as a calibration has found."""

    at: Vector
    """Its optical centre: in the world, or in the frame of the calibrated TCP for a camera on the hand."""
    rpy: Angles
    """How its optical frame (x right, y down, z forward) is turned: about that frame's x, then y, then z."""


class CalibrationFile(FileModel):
    """What `picktree calibrate` has found: it takes the place of what is stated elsewhere."""

    cameras: Annotated[dict[Name, CalibratedCameraFile], Field(default_factory=dict)]
    """Of the scene's cameras those that were calibrated, by name."""
    tcp: ToolErrorFile = ToolErrorFile()
    """Where the TCP is, seen from where the robot file says."""
    date: str = ""
    """When it was calibrated."""
    by: str = ""
    """What has calibrated."""


class WorkspaceFile(FileModel):
    """A box along the world's axes."""

    min: Vector = SafetyLimits().workspace.min
    """Smallest x, y, z in the world."""
    max: Vector = SafetyLimits().workspace.max
    """Greatest x, y, z in the world."""


class LimitsFile(FileModel):
    """What the safety monitor enforces: beyond it the robot stops, and only a SafeRetreat goes on."""

    force: Force = SafetyLimits().force
    """Greatest contact force at the wrist."""
    workspace: WorkspaceFile = WorkspaceFile()
    """Where the TCP may be."""
    payload: Mass | None = None
    """Greatest mass that the hand may carry here, where that is less than what the robot may."""


class ThinkingFile(FileModel):
    """Simulated time that computing costs; zero is allowed, and reports then say so."""

    collision_check: Cost = Thinking().collision_check
    """For each configuration that a planner checks."""
    image: Cost = Thinking().image
    """For taking a picture and recognising what is in it."""


class SensorsFile(FileModel):
    """Standard deviations of the sensors other than the cameras."""

    encoder: Annotated[float, quantity("rad", least=0, most=0.1)] = SensorNoise().encoder
    """Of each joint's angle."""
    width: Annotated[float, quantity("m", least=0, most=0.1)] = SensorNoise().width
    """Of the opening between the fingers."""
    force: Annotated[float, quantity("N", least=0, most=100)] = SensorNoise().force
    """Of the force at the wrist, each axis."""
    torque: Annotated[float, quantity("Nm", least=0, most=100)] = SensorNoise().torque
    """Of the torque at the wrist, each axis."""
    force_bias: Annotated[float, quantity("N", least=0, most=10)] = SensorNoise().force_bias
    """Of what the wrist's sensor adds to each axis of the force for a whole run; drawn from the seed, and it
    turns with the hand."""
    torque_bias: Annotated[float, quantity("Nm", least=0, most=10)] = SensorNoise().torque_bias
    """Likewise of the torque."""
    drift: Share = SensorNoise().drift
    """By which share the bias wanders within minutes."""


class RestFile(FileModel):
    """What stands in a scene file beside its sections."""

    base: str | None = None
    """A scene, shipped or a file beside this one, on which this one is laid: mappings merge, other values
    replace, null removes."""
    robot: str
    """A shipped robot, or a robot file beside this one."""
    limits: LimitsFile = LimitsFile()
    """What the safety monitor enforces."""
    thinking: ThinkingFile = ThinkingFile()
    """Simulated time that computing costs."""
    sensors: SensorsFile = SensorsFile()
    """Noise of the sensors other than the cameras."""
    checkpoint_every: Count = 4
    """How many items are handled from one checkpoint of a run to the next."""
    goal: str | None = None
    """When a run has reached its goal: an expression of the numbers of items total, sorted, misplaced,
    left and outstanding (those that the feed still owes); every item at its destination and none outstanding
    unless given."""
    exchange: ExchangeFile | None = None
    """Who exchanges full bins; without it nobody does."""
    tool_error: Annotated[ToolErrorFile, _as_mapping("offset", ToolErrorFile | Vector)] = ToolErrorFile()
    """Where the hand is really mounted, seen from where the robot file has it; three lengths stand for
    `offset`. Only the simulation knows."""
    calibration: CalibrationFile | None = None
    """What is believed of cameras and tool after calibrating; `picktree calibrate` writes it."""


class SceneFile(RestFile):
    """A scene: what stands where, what cameras see, which items there are, and where they belong."""

    fixtures: dict[Name, FixtureFile] | None = None
    """Bodies that never move, by name: the table, bins, obstacles."""
    unknown: dict[Name, UnknownFile] | None = None
    """Bodies by name that stand there from the beginning, and that the robot is not told of."""
    cameras: dict[Name, CameraFile] | None = None
    """Cameras by name."""
    catalogue: dict[Name, CatalogueFile] | None = None
    """The kinds of items by name."""
    spawn: list[SpawnFile] | None = None
    """Items that are set down at random."""
    feed: list[FeedFile] | None = None
    """Items that are brought while a run goes on."""
    destinations: list[DestinationFile] | None = None
    """Rules that say where items belong; an item for which none holds stays where it is."""
