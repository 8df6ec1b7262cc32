"""Grammar of scene files: bodies with their shapes and holes, catalogue, cameras, destinations, limits,
sensors, calibration, and the file as a whole.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import AfterValidator, BeforeValidator, Field, Strict, WithJsonSchema

from picktree.files import describe, suggest_name
from picktree.files.yaml import file_models
from picktree.world import COLOURS, ITEM_COLOURS, PLAIN_COLOURS, planner_names

from .description import Drop, Form, SafetyLimits, SensorNoise, Thinking

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
Corner = tuple[file_models.Length, file_models.Length]
BeltSpeed = Annotated[float, file_models.quantity("m/s", least=0.005, most=0.5)]
HoleSize = Annotated[float, file_models.quantity("m", least=0.002, most=1.0)]
Chamfer = Annotated[float, file_models.quantity("m", least=0, most=0.05)]
Displacement = Annotated[float, file_models.quantity("m", least=0, most=0.05)]
Misturn = Annotated[float, file_models.quantity("rad", least=0, most=math.radians(15))]


class CylinderFile(file_models.FileModel):
    """A cylinder that stands on a round face."""

    radius: ItemSize
    """Radius of the round face."""
    height: ItemSize
    """Along its axis."""


class SphereFile(file_models.FileModel):
    """A ball."""

    radius: ItemSize
    """Half its width."""


class MeshFile(file_models.FileModel):
    """A body from a mesh file; one that is not convex is taken apart into at most 16 convex parts."""

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
    """How a square or a slot is turned in the box, about the vertical."""


class UncertaintyFile(file_models.FileModel):
    """How far a fixture may really stand from where the file says; where, is drawn from the seed, and nobody
    tells the robot."""

    position: Displacement = 0.0
    """Along its own x and y, each way."""
    angle: Misturn = 0.0
    """About the vertical, each way, and of its tilt."""


class FixtureFile(file_models.FileModel):
    """Body that stays where it is: a box as a table or shelf, a bin, a tote, a belt with items on it, a
    target."""

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
    """Edge lengths of a block with six coloured squares on its top, from which cameras and tool are
    calibrated. `at` is its centre, and need be known to a few millimetres only."""
    at: file_models.Vector
    """Where it stands: x, y, z in the world."""
    rpy: file_models.Angles | None = None
    """How it is turned: about the world's x, then y, then z. Only a box."""
    yaw: file_models.Angle | None = None
    """How it is turned about the world's z, where that is all. Not beside `rpy`."""
    wall: file_models.Size | None = None
    """Thickness of the walls and floor of a bin or tote."""
    speed: BeltSpeed | None = None
    """Speed of a belt while it runs."""
    eye: file_models.Length | None = None
    """Where the light barrier crosses a belt, from its middle along +x: there it stops for the robot."""
    holes: dict[file_models.Name, HoleFile] | None = None
    """Holes in the top face of a box by name, into which items are put; each is a destination."""
    uncertainty: UncertaintyFile | None = None
    """How far a box may really stand from here."""
    colour: PlainColour = "grey"
    """Colour that cameras see: an unsaturated one, so that it differs from those of items."""


class UnknownFile(file_models.FileModel):
    """A body that stands still, of which the robot is not told: it has to see it."""

    one_of: ClassVar[tuple[str, ...]] = ("box", "cylinder", "sphere")
    """Exactly one of these is given."""

    box: file_models.Sizes | None = None
    """Edge lengths along x, y, z."""
    cylinder: CylinderFile | None = None
    """A round post, along its own z."""
    sphere: SphereFile | None = None
    """A ball that stays where it is."""
    at: file_models.Vector
    """Its centre: x, y, z in the world."""
    rpy: file_models.Angles | None = None
    """How it is turned: about the world's x, then y, then z."""
    yaw: file_models.Angle | None = None
    """How it is turned about the world's z, where that is all. Not beside `rpy`."""
    colour: AnyColour = "grey"
    """Colour that cameras see; it may be one of the items' colours."""


class CatalogueFile(file_models.FileModel):
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
    mesh: Annotated[MeshFile | None, file_models.as_mapping("file", MeshFile | str | None)] = None
    """A body of another shape; a bare text is its mesh file."""
    mass: file_models.ItemMass
    """Mass of one item."""
    friction: Annotated[float, file_models.quantity("", least=0, most=2)]
    """Coulomb's coefficient against the table and the fingers."""
    force_limit: file_models.Force | None = None
    """Greatest grip force of a finger that it survives; without it any."""


def _item_colour(name: str) -> str:
    if name not in ITEM_COLOURS:
        raise file_models.InvalidValue(
            f"{describe(name)} is no colour that an item may have",
            suggest_name(name, ITEM_COLOURS),
            code="P108",
        )
    return name


def _clear(value: object) -> object:
    """Validate a time of a load; `clear` becomes None."""
    if isinstance(value, str) and value != "clear":
        hint = "it is clear, {every: 45 s} or {at: [10 s, 60 s]}"
        raise file_models.InvalidValue(f"{describe(value)} is no time for a load", hint, code="P108")
    return None if value == "clear" else value


ItemColour = Annotated[str, AfterValidator(_item_colour), WithJsonSchema({"enum": list(ITEM_COLOURS)})]
Count = Annotated[int, Strict(), Field(ge=1, le=200)]
TagNumber = Annotated[int, Strict(), Field(ge=0, le=49)]
Spacing = Annotated[float, file_models.quantity("m", least=0.01, most=10)]
Period = Annotated[float, file_models.quantity("s", least=1, most=86400)]
Total = Annotated[int, Strict(), Field(ge=1, le=1_000_000)]


class AreaFile(file_models.FileModel):
    """A rectangle on the table, along the world's axes, for the items' centres."""

    min: Corner
    """Smallest x and y in the world."""
    max: Corner
    """Greatest x and y in the world."""


class SpawnFile(file_models.FileModel):
    """Items that are set down at random where a run begins; where, follows from scene and seed alone."""

    of: Annotated[dict[str, Count], Field(min_length=1)]
    """How many of each kind of the catalogue. `assortment` stands for items of the scene's `assortment`."""
    colours: Annotated[tuple[ItemColour, ...], Field(min_length=1)]
    """Given out in turn, shuffled: with three colours a third of the items has each."""
    area: AreaFile | None = None
    """Where on the table. Either this or `into`."""
    into: str | None = None
    """Tote, by its name under `fixtures`, into which the items are poured. Needs `drop: heap`."""
    drop: Drop | None = None
    """Items that are picked as one heap, at rest before the run begins; only physics can do that. `heap`:
    poured into a tote in any orientation. `pile`: poured onto the `area` between walls, which are then taken
    away. `packed`: set down on the `area` upright, `gap` apart."""
    gap: Annotated[float, file_models.quantity("m", least=0, most=1)] = 0.025
    """Free distance between any two items as seen from above."""
    lying: file_models.Share = 0.0
    """Share of the cylinders that lie on their side."""
    tumbled: file_models.Flag = False
    """Dropped from 10 cm in any orientation instead of set down: items roll, and lean on one another."""
    touching: file_models.Flag = False
    """Set down side by side, so that each touches another; most of them face to face. Then `gap` is only kept
    from other entries' items. Not beside `tumbled`."""


class WhenFile(file_models.FileModel):
    """The times at which a load comes."""

    one_of: ClassVar[tuple[str, ...]] = ("every", "at")
    """Exactly one of these is given."""

    every: Period | None = None
    """Time from one load to the next; the first comes after the same time."""
    at: Annotated[tuple[file_models.Duration, ...], Field(min_length=1)] | None = None
    """Simulated times since the run began, ascending."""


class FeedFile(file_models.FileModel):
    """Items that are brought while a run goes on: loads on the table, single items on a belt, full totes."""

    one_of: ClassVar[tuple[str, ...]] = ("area", "belt", "into")
    """Exactly one of these is given."""

    of: Annotated[dict[str, Count], Field(min_length=1)]
    """How many of each kind of the catalogue are in one load; for a belt the shares of a mixture. With `into`
    `assortment` stands for items of the scene's `assortment`."""
    colours: Annotated[tuple[ItemColour, ...], Field(min_length=1)]
    """Given out in turn, shuffled."""
    area: AreaFile | None = None
    """Where on the table a load is set down, wherever it is free. Either this, `belt` or `into`."""
    belt: str | None = None
    """The belt, by its name under `fixtures`, at whose upstream end items are set down one by one."""
    into: str | None = None
    """The tote, by its name under `fixtures`, that comes back with a load when it is exchanged. Needs
    `exchange`."""
    gap: Annotated[float, file_models.quantity("m", least=0, most=1)] | None = None
    """Free distance on the table to any other item as seen from above; 25 mm unless given."""
    lying: file_models.Share = 0.0
    """Share of the cylinders that lie on their side."""
    tumbled: file_models.Flag | None = None
    """Dropped on the table from 10 cm in any orientation instead of set down."""
    when: Annotated[
        WhenFile | None, BeforeValidator(_clear, json_schema_input_type=Literal["clear"] | WhenFile | None)
    ] = None
    """Time of the loads: `clear` (unless given), `{every: 45 s}` or `{at: [10 s, 60 s]}`. With `clear` a load
    comes when the robot reports that it is done with what lies there. A belt runs whenever the robot is
    ready; a tote comes when it is exchanged."""
    spacing: Spacing | None = None
    """Mean distance on a belt from one item to the next; 150 mm unless given."""
    total: Total | None = None
    """How many items come in all; without it they come for ever."""


SECTIONS = ("fixtures", "unknown", "cameras", "catalogue", "spawn", "feed", "destinations")
"""The parts of a scene file that are read entry by entry; the rest is `RestFile`."""
Noise = Annotated[float, file_models.quantity("m", least=0, most=0.1)]
FieldOfView = Annotated[float, file_models.quantity("rad", above=0, most=math.radians(150))]
Distance = Annotated[float, file_models.quantity("m", above=0)]
Pixels = Annotated[int, Strict(), Field(ge=16, le=2048)]
Cost = Annotated[float, file_models.quantity("s", least=0, most=10)]


class OffsetFile(file_models.FileModel):
    """How far a camera really hangs from where it is believed to hang, in its believed frame."""

    offset: file_models.Vector = (0.0, 0.0, 0.0)
    """Along the picture's x (right), y (down) and z (forward)."""
    rpy: file_models.Angles = (0.0, 0.0, 0.0)
    """About the picture's x, y and z."""


class CameraFile(file_models.FileModel):
    """A camera for colour and depth, which hangs still or is mounted on the hand."""

    on: Literal["world", "hand"] = "world"
    """Mount of the camera. With `hand` it moves with the tool, and `at`, `look_at` and `up` are in the
    frame of the TCP. Its z points out of the hand, and along its y the fingers close."""
    at: file_models.Vector
    """Where it hangs: x, y, z in the world, or in the frame of the TCP."""
    look_at: file_models.Vector
    """The point in the middle of its picture, in the same frame."""
    up: file_models.Vector | None = None
    """Direction that is up in the picture, in the same frame; z unless given, x when the camera looks
    along z."""
    size: tuple[Pixels, Pixels] = (320, 240)
    """Width and height of the picture in pixels."""
    fov: FieldOfView = math.radians(60)
    """Vertical field of view."""
    depth_noise: Noise = 0.002
    """Standard deviation of the depth at 0.7 m. It grows with the square of the depth, and is never less
    than 0.2 mm unless it is zero."""
    edge_dropout: file_models.Share = 0.5
    """Probability that a pixel on an edge of the depth picture returns nothing."""
    near: Distance = 0.05
    """Nearest depth that it sees."""
    far: Distance = 3.0
    """Farthest depth that it sees."""
    error: Annotated[OffsetFile, file_models.as_mapping("offset", OffsetFile | file_models.Vector)] = (
        OffsetFile()
    )
    """Where it really hangs, seen from where it is believed to hang; three lengths stand for `offset`."""


class ExchangeFile(file_models.FileModel):
    """Somebody who puts an empty bin in a full one's place when the robot asks."""

    takes: Annotated[float, file_models.quantity("s", above=0, most=3600)]
    """How long that takes while the arm is out of the way."""


class DestinationFile(file_models.FileModel):
    """A rule that says where items belong. The first that holds for an item counts."""

    where: str
    """Items of the rule: an expression of colour, form, kind, mass and size, as "colour == 'red' and mass >
    0.06". The mass is in kg, as weighed in the hand; the size is the greatest distance of two points, m.
    `tag` is the number of the ArUco tag that was read."""
    to: str
    """The bin, or the fixture with holes, by its name under `fixtures`: then any free hole that fits the item
    is right. Or one hole, as board/left."""


class ToolErrorFile(file_models.FileModel):
    """How far the hand is really mounted from where the robot file has it, in the frame of its TCP."""

    offset: file_models.Vector = (0.0, 0.0, 0.0)
    """Along the TCP's x, y and z (out of the hand)."""
    rpy: file_models.Angles = (0.0, 0.0, 0.0)
    """About the TCP's x, y and z."""


class CalibratedCameraFile(file_models.FileModel):
    """Where a camera is, as a calibration has found."""

    at: file_models.Vector
    """Its optical centre: in the world, or in the frame of the calibrated TCP for a camera on the hand."""
    rpy: file_models.Angles
    """How its optical frame (x right, y down, z forward) is turned: about that frame's x, then y, then z."""


class CalibrationFile(file_models.FileModel):
    """Result of `picktree calibrate`: it takes the place of what is stated elsewhere."""

    cameras: Annotated[dict[file_models.Name, CalibratedCameraFile], Field(default_factory=dict)]
    """Calibrated cameras of the scene, by name."""
    tcp: ToolErrorFile = ToolErrorFile()
    """Where the TCP is, seen from where the robot file says."""
    date: str = ""
    """When it was calibrated."""
    by: str = ""
    """Source of the calibration."""


class WorkspaceFile(file_models.FileModel):
    """A box along the world's axes."""

    min: file_models.Vector = SafetyLimits().workspace.min
    """Smallest x, y, z in the world."""
    max: file_models.Vector = SafetyLimits().workspace.max
    """Greatest x, y, z in the world."""


class LimitsFile(file_models.FileModel):
    """Limits of the safety monitor: beyond them the robot stops, and only a SafeRetreat goes on."""

    force: file_models.Force = SafetyLimits().force
    """Greatest contact force at the wrist."""
    workspace: WorkspaceFile = WorkspaceFile()
    """Where the TCP may be."""
    payload: file_models.Mass | None = None
    """Greatest mass that the hand may carry here, where that is less than what the robot may."""


class ThinkingFile(file_models.FileModel):
    """Simulated time that computing costs; zero is allowed, and reports then say so."""

    collision_check: Cost = Thinking().collision_check
    """Time for each configuration that a planner checks."""
    image: Cost = Thinking().image
    """Time for taking a picture and recognising what is in it."""


class SensorsFile(file_models.FileModel):
    """Standard deviations of the sensors other than the cameras."""

    encoder: Annotated[float, file_models.quantity("rad", least=0, most=0.1)] = SensorNoise().encoder
    """Standard deviation of each joint's angle."""
    width: Annotated[float, file_models.quantity("m", least=0, most=0.1)] = SensorNoise().width
    """Standard deviation of the opening between the fingers."""
    force: Annotated[float, file_models.quantity("N", least=0, most=100)] = SensorNoise().force
    """Standard deviation of the force at the wrist, each axis."""
    torque: Annotated[float, file_models.quantity("Nm", least=0, most=100)] = SensorNoise().torque
    """Standard deviation of the torque at the wrist, each axis."""
    force_bias: Annotated[float, file_models.quantity("N", least=0, most=10)] = SensorNoise().force_bias
    """Standard deviation of the wrist sensor's force bias, each axis. The bias is drawn from the seed,
    holds for a whole run and turns with the hand."""
    torque_bias: Annotated[float, file_models.quantity("Nm", least=0, most=10)] = SensorNoise().torque_bias
    """Likewise of the torque."""
    drift: file_models.Share = SensorNoise().drift
    """Share by which the bias wanders within minutes."""


class AssortmentFile(file_models.FileModel):
    """Things without a catalogue: only the simulation and the scorer know their shapes."""

    meshes: Annotated[str, file_models.NamedFile("mesh folder")]
    """Folder with OBJ files beside this file, or `random_urdfs`, the set of 999 things that comes with
    pybullet. Each `o` group of a file is a convex part."""
    scale: Annotated[float, Field(gt=0, le=1000)] = 1.0
    """Factor from the files' lengths to metres."""
    density: Annotated[float, Field(gt=0, le=25000)] = 500.0
    """Density, kg/m³; with the parts' volume it gives the mass."""
    friction: Annotated[float, Field(gt=0, le=2)] = 0.5
    """Coulomb friction of each thing."""
    least_mass: file_models.Mass = 0.001
    """Things that are lighter are left out: a wrist does not feel them in the hand."""
    tags: tuple[TagNumber, ...] = ()
    """Numbers of ArUco tags (4 × 4, the first 50), given out in turn, shuffled. Each thing has its tag on all
    flat faces that carry one. Rules of `destinations` may ask for `tag`."""
    tag_size: Annotated[float, file_models.quantity("m", least=0.005, most=0.2)] = 0.02
    """Side of a tag's black square."""


class RestFile(file_models.FileModel):
    """Keys of a scene file beside its sections."""

    base: Annotated[str, file_models.NamedFile("scene")] | None = None
    """A scene, shipped or a file beside this one, on which this one is laid: mappings merge, other values
    replace, null removes."""
    robot: Annotated[str, file_models.NamedFile("robot")]
    """A shipped robot, or a robot file beside this one."""
    limits: LimitsFile = LimitsFile()
    """Limits that the safety monitor enforces."""
    thinking: ThinkingFile = ThinkingFile()
    """Simulated time that computing costs."""
    planner: planner_names.PlannerName | None = None
    """Planner of free motions, instead of the robot file's; `auto` unless one of the two files says."""
    sensors: SensorsFile = SensorsFile()
    """Noise of the sensors other than the cameras."""
    checkpoint_every: Count = 4
    """How many items are handled from one checkpoint of a run to the next."""
    goal: str | None = None
    """Goal of a run: an expression of the numbers of items total, sorted, misplaced, left and outstanding
    (those that the feed still owes). Every item at its destination and none outstanding unless given."""
    exchange: ExchangeFile | None = None
    """Exchange of full bins and empty totes; without it nobody exchanges them."""
    tool_error: Annotated[
        ToolErrorFile, file_models.as_mapping("offset", ToolErrorFile | file_models.Vector)
    ] = ToolErrorFile()
    """Where the hand is really mounted, seen from where the robot file has it; three lengths stand for
    `offset`. Only the simulation knows."""
    assortment: AssortmentFile | None = None
    """Things without a catalogue, for entries of `spawn` that ask for `assortment`."""
    calibration: CalibrationFile | None = None
    """Corrections of cameras and tool after calibrating; `picktree calibrate` writes them."""


class SceneFile(RestFile):
    """A scene: what stands where, what cameras see, which items there are, and where they belong."""

    fixtures: dict[file_models.Name, FixtureFile] | None = None
    """Bodies that never move, by name: the table, bins, obstacles."""
    unknown: dict[file_models.Name, UnknownFile] | None = None
    """Bodies by name that stand there from the beginning, and that the robot is not told of."""
    cameras: dict[file_models.Name, CameraFile] | None = None
    """Cameras by name."""
    catalogue: dict[file_models.Name, CatalogueFile] | None = None
    """The kinds of items by name."""
    spawn: list[SpawnFile] | None = None
    """Items that are set down at random."""
    feed: list[FeedFile] | None = None
    """Items that are brought while a run goes on."""
    destinations: list[DestinationFile] | None = None
    """Rules that say where items belong; an item for which none holds stays where it is."""
