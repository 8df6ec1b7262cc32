"""Contents of a scene file as values: bodies, cameras, calibration, catalogue, spawn areas,
destinations, limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, Strict, WithJsonSchema

from picktree.files import describe, suggest_name
from picktree.files.yaml import file_models
from picktree.world import (
    ITEM_COLOURS,
    Array,
    Bounds,
    Box,
    Intrinsics,
    ObjectId,
    Pose,
    Shape,
    Vector3,
    planner_names,
)

Corner: TypeAlias = tuple[file_models.Length, file_models.Length]
Count = Annotated[int, Strict(), Field(ge=1, le=200)]
Displacement = Annotated[float, file_models.quantity("m", least=0, most=0.05)]
Misturn = Annotated[float, file_models.quantity("rad", least=0, most=math.radians(15))]
Noise = Annotated[float, file_models.quantity("m", least=0, most=0.1)]
FieldOfView = Annotated[float, file_models.quantity("rad", above=0, most=math.radians(150))]
Distance = Annotated[float, file_models.quantity("m", above=0)]
Pixels = Annotated[int, Strict(), Field(ge=16, le=2048)]
Cost = Annotated[float, file_models.quantity("s", least=0, most=10)]
TagNumber = Annotated[int, Strict(), Field(ge=0, le=49)]


def _item_colour(name: str) -> str:
    if name not in ITEM_COLOURS:
        message = f"{describe(name)} is no colour that an item may have"
        raise file_models.InvalidValue(message, suggest_name(name, ITEM_COLOURS), code="P108")
    return name


ItemColour = Annotated[str, AfterValidator(_item_colour), WithJsonSchema({"enum": list(ITEM_COLOURS)})]


class OffsetFile(file_models.FileModel):
    """Displacement of a camera or the hand from its believed mount, in its believed frame."""

    offset: file_models.Vector = (0.0, 0.0, 0.0)
    """Translation along x, y and z of the frame. Of a camera: right, down and forward; of the TCP: z out of
    the hand."""
    rpy: file_models.Angles = (0.0, 0.0, 0.0)
    """Rotation about the frame's x, y and z."""

    def pose(self) -> Pose:
        return Pose.from_rpy(self.offset, self.rpy)


Offset = Annotated[
    Pose,
    file_models.ReadAs(OffsetFile, OffsetFile.pose),
    file_models.as_mapping("offset", OffsetFile | file_models.Vector),
]
"""Pose of a true frame in the believed one; three lengths in a file mean its `offset`."""


class CalibratedCameraFile(file_models.FileModel):
    """Calibrated pose of a camera."""

    at: file_models.Vector
    """Optical centre: in the world, or in the frame of the calibrated TCP for a camera on the hand."""
    rpy: file_models.Angles
    """Rotation of the optical frame (x right, y down, z forward) about that frame's x, then y, then z."""

    def pose(self) -> Pose:
        return Pose.from_rpy(self.at, self.rpy)


class WorkspaceFile(file_models.FileModel):
    """A box along the world's axes."""

    min: file_models.Vector = (-0.5, -1.0, -0.02)
    """Smallest x, y, z in the world."""
    max: file_models.Vector = (1.0, 1.0, 1.5)
    """Greatest x, y, z in the world."""

    def bounds(self) -> Bounds:
        return Bounds(self.min, self.max)


class AreaFile(file_models.FileModel):
    """A rectangle on the table, along the world's axes, for the items' centres."""

    min: Corner
    """Smallest x and y in the world."""
    max: Corner
    """Greatest x and y in the world."""

    def corners(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return self.min, self.max


Area = Annotated[
    tuple[tuple[float, float], tuple[float, float]], file_models.ReadAs(AreaFile, AreaFile.corners)
]
"""((x min, y min), (x max, y max)) in the world, m."""

TILE_COLOURS = ("red", "yellow", "blue", "purple", "green", "cyan")
"""Colours of the squares, row by row. All differ, so that each square is identified by itself and the
target's orientation is unambiguous."""
TILE_COLUMNS, TILE_ROWS = 3, 2
TILE_EDGE_SHARE = 0.75
"""Edge of a square over that of its cell. The grey between squares, and to the block's edges, lets a
camera separate them."""
TILE_HEIGHT = 0.00005
"""Height of the squares, which are printed on, over the block's top, m: from the side a camera sees no edge
of them."""
MIN_TARGET_SIZE = (0.06, 0.04, 0.02)
"""Minimum size of a target along x, y, z, m: fingers must reach five sides, and a camera must separate the
squares."""


@dataclass(frozen=True, slots=True)
class TargetTile:
    """A coloured square on the top of a target, with its edges along the target's x and y."""

    colour: str
    centre: Vector3
    """Centre in the target's frame, on the face that is seen, m. That frame is the frame of the target's
    box."""
    edge: float
    """Edge length, m."""

    def corners(self) -> Array:
        """Corners (4, 3), in order around the square, in the target's frame, m."""
        half = self.edge / 2
        around = np.array([(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)], dtype=np.float64)
        return around * half + np.array(self.centre)


def tiles_on(size: Vector3) -> tuple[TargetTile, ...]:
    """Return the squares of a target of `size` (x, y, z) m: three columns along x and two rows along y."""
    x, y, z = size
    cell = (x / TILE_COLUMNS, y / TILE_ROWS)
    edge = TILE_EDGE_SHARE * min(cell)
    found: list[TargetTile] = []
    for n, colour in enumerate(TILE_COLOURS):
        row, column = divmod(n, TILE_COLUMNS)
        across, along = column - (TILE_COLUMNS - 1) / 2, (TILE_ROWS - 1) / 2 - row
        found.append(TargetTile(colour, (across * cell[0], along * cell[1], z / 2 + TILE_HEIGHT), edge))
    return tuple(found)


def tile_body(tile: TargetTile, thickness: float) -> tuple[Box, Pose]:
    """Return the square as a body for rendering, in the target's frame, m; half of it is above the top."""
    x, y, z = tile.centre
    return Box((tile.edge, tile.edge, thickness)), Pose((x, y, z - TILE_HEIGHT))


@dataclass(frozen=True, slots=True)
class SceneCalibration(file_models.FileValue):
    """Result of `picktree calibrate`; it replaces poses stated elsewhere.

    It corrects the belief, never the ground truth.
    """

    cameras: dict[
        file_models.Name,
        Annotated[Pose, file_models.ReadAs(CalibratedCameraFile, CalibratedCameraFile.pose)],
    ] = field(default_factory=dict[str, Pose])
    """Calibrated cameras of the scene, by name."""
    tcp: Annotated[Pose, file_models.ReadAs(OffsetFile, OffsetFile.pose)] = field(default_factory=Pose)
    """Believed TCP, in the TCP frame of the robot file."""
    date: str = ""
    """Date of the calibration."""
    by: str = ""
    """Source of the calibration."""


HoleForm: TypeAlias = Literal["round", "square", "slot"]


@dataclass(frozen=True, slots=True)
class Hole:
    """A hole with straight walls, from the top face of its fixture downwards."""

    id: ObjectId
    """Fixture and name: `board/left`."""
    form: HoleForm
    size: tuple[float, float]
    """Free width inside along the hole's own x and y, m. A round hole has at least 32 segments; both
    numbers are the diameter of their inscribed circle, which is really free."""
    depth: float
    """Depth from the mouth to the bottom, m."""
    chamfer: float
    """Height and width of the bevel around the mouth, m; 0 for a sharp edge."""
    pose: Pose
    """Pose of the middle of the mouth in the fixture's frame: z points out of the hole, x along a slot."""


@dataclass(frozen=True, slots=True)
class PlacementUncertainty(file_models.FileValue):
    """Greatest displacement of a fixture from its pose in the file. The true pose is drawn from the seed and
    is unknown to the robot."""

    position: Displacement = 0.0
    """Displacement along its own x and y, in either direction."""
    angle: Misturn = 0.0
    """Rotation about the vertical, in either direction, and tilt."""


NO_UNCERTAINTY = PlacementUncertainty()
Form: TypeAlias = Literal["box", "cylinder", "sphere", "plate", "mesh"]


@dataclass(frozen=True, slots=True)
class Fixture:
    """A body that never moves."""

    id: ObjectId
    shape: Shape
    pose: Pose
    """Believed pose in the world."""
    colour: str = "grey"
    holes: tuple[Hole, ...] = ()
    uncertainty: PlacementUncertainty = NO_UNCERTAINTY
    """Greatest displacement from that pose; only the simulation draws the true one."""
    tiles: tuple[TargetTile, ...] = ()
    """Coloured squares on its top: it is a target for calibrating."""


@dataclass(frozen=True, slots=True)
class Bin:
    """An open-topped box, bin or tote. `size` is the outside (x, y, z); the frame is the centre of its
    underside."""

    id: ObjectId
    size: Vector3
    wall: float
    pose: Pose
    colour: str = "grey"
    is_tote: bool = False
    """Whether items are taken from it; into other bins they are put."""

    def parts(self) -> tuple[tuple[Box, Pose], ...]:
        """Floor and four walls, with their poses in the world."""
        (x, y, z), w = self.size, self.wall
        local = (
            (Box((x, y, w)), Pose((0.0, 0.0, w / 2))),
            (Box((w, y, z - w)), Pose((-(x - w) / 2, 0.0, (z + w) / 2))),
            (Box((w, y, z - w)), Pose(((x - w) / 2, 0.0, (z + w) / 2))),
            (Box((x - 2 * w, w, z - w)), Pose((0.0, -(y - w) / 2, (z + w) / 2))),
            (Box((x - 2 * w, w, z - w)), Pose((0.0, (y - w) / 2, (z + w) / 2))),
        )
        return tuple((box, self.pose @ part) for box, part in local)

    def inside(self) -> tuple[Vector3, Vector3]:
        """Lowest and highest corner of the free inside, in the bin's frame, m."""
        (x, y, z), w = self.size, self.wall
        return (-x / 2 + w, -y / 2 + w, w), (x / 2 - w, y / 2 - w, z)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings(file_models.FileValue):
    """Mount, lens and errors of an RGB-D camera."""

    on: Literal["world", "hand"] = "world"
    """Mount of the camera. With `hand` it moves with the tool, and `at`, `look_at` and `up` are in the
    frame of the TCP. Its z points out of the hand, and along its y the fingers close."""
    size: tuple[Pixels, Pixels] = (320, 240)
    """Width and height of the picture in pixels."""
    fov: FieldOfView = math.pi / 3
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
    error: Offset = field(default_factory=Pose)
    """True pose of the camera in its believed frame; three lengths mean `offset`. Only the simulation reads
    it."""


@dataclass(frozen=True, slots=True)
class CameraDescription(CameraSettings):
    """An RGB-D camera of a scene."""

    name: str
    pose: Pose
    """Believed optical frame in the world, of a camera on the hand in the TCP's: z looks forward, y down."""

    @property
    def intrinsics(self) -> Intrinsics:
        """Intrinsics of the camera, with square pixels.

        TINY renderer's pixel (u, v) lies at (u, v + 1) of the image plane. So the centre is half a pixel off
        the usual place.
        """
        width, height = self.size
        focal = height / 2 / math.tan(self.fov / 2)
        return Intrinsics(width, height, focal, focal, width / 2, height / 2 - 1)

    def calibrated(self, calibration: SceneCalibration | None) -> CameraDescription:
        """Return the camera with its calibrated pose, where there is one. The true pose, `pose @ error`,
        stays."""
        found = calibration.cameras.get(self.name) if calibration is not None else None
        if found is None:
            return self
        return replace(self, pose=found, error=found.inverse() @ self.pose @ self.error)


MAX_HIDDEN_SHARE = 0.25
"""Greatest share of the items' areas that the arm at `home` may hide from a camera."""
MIN_DETECTABLE_MASS = 0.03
"""Least mass in the hand that the wrist sensor reliably detects, kg. A load of 12 g differs from an empty
hand, and the error of a weighing is at most 15 g."""


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """A kind of item, which perception may recognise and the simulation may spawn."""

    kind: str
    form: Form
    shape: Shape
    """A plate is a flat Box."""
    mass: float
    """kg"""
    friction: float
    force_limit: float | None = None
    """Greatest grip force a finger that it survives, N."""


Drop: TypeAlias = Literal["heap", "pile", "packed"]
"""Poured into a tote; poured onto the table between walls that are then taken away; set down side by side."""


@dataclass(frozen=True, slots=True)
class ItemLoad(file_models.FileValue):
    """Items that are set down together."""

    counts: Annotated[dict[str, Count], Field(alias="of", min_length=1)]
    """Number of items of each kind in the scene's catalogue; for a belt the shares of a mixture. `assortment`
    means items of the scene's `assortment`."""
    colours: Annotated[tuple[ItemColour, ...], Field(min_length=1)]
    """Colours of the items, assigned in turn and shuffled: with three colours a third of the items has
    each."""
    area: Area | None = None
    """Area on the table for the items' centres; a load is set down on any free place in it."""
    into: ObjectId | None = None
    """Tote, by its name under `fixtures`, into which the items are poured."""
    gap: Annotated[float, file_models.quantity("m", least=0, most=1)] = 0.025
    """Free distance between any two items on the table as seen from above."""
    lying: file_models.Share = 0.0
    """Share of the cylinders that lie on their side."""
    tumbled: file_models.Flag = False
    """Whether items are dropped from 10 cm in any orientation instead of set down: they roll, and lean on one
    another."""

    @property
    def number(self) -> int:
        return sum(self.counts.values())

    @property
    def rectangle(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """((x min, y min), (x max, y max)) for the items' centres in the world, m."""
        assert self.area is not None
        return self.area


@dataclass(frozen=True, slots=True)
class Spawn(ItemLoad):
    """Items that are set down at random at the beginning of a run; their places follow from scene and seed
    alone.

    Drawn from the stream `spawn`. If `into` names a tote, `area` is the tote's area.
    """

    drop: Drop | None = None
    """Items that are picked as one heap, at rest before the run begins; only physics can do that. `heap`:
    poured into a tote in any orientation. `pile`: poured onto the `area` between walls, which are then taken
    away. `packed`: set down on the `area` upright, `gap` apart."""
    touching: file_models.Flag = False
    """Whether items are set down side by side, so that each touches another, most of them face to face. Then
    `gap` applies only to items of other entries. Not beside `tumbled`."""


MESH_SETS = ("random_urdfs",)
"""Sets of meshes that come with a package."""
ASSORTMENT = "assortment"
"""Name for things of the assortment among the kinds of a spawn entry."""


@dataclass(frozen=True, slots=True)
class Assortment(file_models.FileValue):
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
    """Least mass of a thing; lighter ones are left out, because the wrist sensor cannot detect them."""
    tags: tuple[TagNumber, ...] = ()
    """Numbers of ArUco tags (4 × 4, the first 50), given out in turn, shuffled. Each thing has its tag on all
    flat faces that carry one. Rules of `destinations` may use `tag`."""
    tag_size: Annotated[float, file_models.quantity("m", least=0.005, most=0.2)] = 0.02
    """Side of a tag's black square."""


@dataclass(frozen=True, slots=True)
class Belt:
    """A fixture that carries items along its own +x while it runs."""

    id: ObjectId
    """Name of the fixture that is its box."""
    speed: float
    """Speed of the belt, m/s."""
    eye: float
    """Position of the light barrier along +x, from the middle of the belt, m."""


@dataclass(frozen=True, slots=True)
class WhenClear:
    """A load comes when the robot reports that it is done with the present items."""


@dataclass(frozen=True, slots=True)
class AtIntervals:
    """A load comes at this interval from the beginning, s."""

    period: float


@dataclass(frozen=True, slots=True)
class AtTimes:
    """A load comes at each of these simulated times, s, ascending."""

    times: tuple[float, ...]


When: TypeAlias = WhenClear | AtIntervals | AtTimes


class WhenFile(file_models.FileModel):
    """The times at which a load comes."""

    one_of: ClassVar[tuple[str, ...]] = ("every", "at")
    """Exactly one of these is given."""

    every: Annotated[float, file_models.quantity("s", least=1, most=86400)] | None = None
    """Time from one load to the next; the first comes after the same time."""
    at: Annotated[tuple[file_models.Duration, ...], Field(min_length=1)] | None = None
    """Simulated times since the run began, ascending."""

    @staticmethod
    def value(given: WhenFile | None) -> When:
        if given is None:
            return WhenClear()
        return AtTimes(given.at or ()) if given.every is None else AtIntervals(given.every)


def _clear(value: object) -> object:
    """Validate a time of a load; `clear` becomes None."""
    if isinstance(value, str) and value != "clear":
        hint = "it is clear, {every: 45 s} or {at: [10 s, 60 s]}"
        raise file_models.InvalidValue(f"{describe(value)} is no time for a load", hint, code="P108")
    return None if value == "clear" else value


@dataclass(frozen=True, slots=True)
class Delivery(ItemLoad):
    """Items that are brought during a run: loads on the table, single items on a belt, full totes.

    On a belt the load consists of single items of the mixture, over the whole width and length of the belt.
    """

    one_of: ClassVar[tuple[str, ...]] = ("area", "belt", "into")
    """Exactly one of these is given."""

    belt: ObjectId | None = None
    """The belt, by its name under `fixtures`, at whose upstream end items are set down one by one."""
    when: Annotated[
        When,
        file_models.ReadAs(WhenFile | None, WhenFile.value),
        BeforeValidator(_clear, json_schema_input_type=Literal["clear"] | WhenFile | None),
    ] = WhenClear()
    """Time of the loads: `clear` (default), `{every: 45 s}` or `{at: [10 s, 60 s]}`. With `clear` a load
    comes when the robot reports that it is done with the present items. A belt runs whenever the robot is
    ready; a tote comes when it is exchanged."""
    spacing: Annotated[float, file_models.quantity("m", least=0.01, most=10)] = 0.15
    """Mean distance on a belt from one item to the next."""
    total: Annotated[int, Strict(), Field(ge=1, le=1_000_000)] | None = None
    """Total number of items; without it their number is unlimited."""

    @property
    def load(self) -> Spawn:
        """Items of one delivery, as an entry of `spawn`."""
        each = {part.name: getattr(self, part.name) for part in fields(ItemLoad)}
        return Spawn(**each, drop=None if self.into is None else "heap")


@dataclass(frozen=True, slots=True)
class Exchange(file_models.FileValue):
    """Exchange of a full bin for an empty one, on request of the robot."""

    takes: Annotated[float, file_models.quantity("s", above=0, most=3600)]
    """Duration of an exchange while the arm is out of the way."""
    by: Literal["machine", "person"] = "machine"
    """Worker of the exchange. Each exchange by a person counts as an assist."""


@dataclass(frozen=True, slots=True)
class Destination(file_models.FileValue):
    """A rule for the destination of items. The first rule that holds for an item applies."""

    where: str
    """Items of the rule: an expression of colour, form, kind, mass and size, such as "colour == 'red' and
    mass > 0.06". The mass is in kg, weighed in the hand; the size is the greatest distance of two points, m.
    `tag` is the number of the ArUco tag that was read."""
    to: ObjectId
    """The bin, or the fixture with holes, by its name under `fixtures`: then any free hole that fits the item
    is right. Or one hole, such as board/left."""


@dataclass(frozen=True, slots=True)
class SafetyLimits(file_models.FileValue):
    """Limits of the safety monitor: beyond them the robot stops, and only a SafeRetreat may move it."""

    force: file_models.Force = 60.0
    """Greatest contact force at the wrist."""
    workspace: Annotated[Bounds, file_models.ReadAs(WorkspaceFile, WorkspaceFile.bounds)] = field(
        default_factory=lambda: WorkspaceFile().bounds()
    )
    """Permitted positions of the TCP."""
    payload: file_models.Mass | None = None
    """Greatest payload in this scene, if it is less than that of the robot."""


@dataclass(frozen=True, slots=True)
class Thinking(file_models.FileValue):
    """Simulated time charged for computing; zero is allowed, and reports then state it."""

    collision_check: Cost = 25e-6
    """Time for each configuration that a planner checks."""
    image: Cost = 0.06
    """Time for taking and evaluating an image."""


@dataclass(frozen=True, slots=True)
class SensorNoise(file_models.FileValue):
    """Standard deviations of the sensors other than the cameras."""

    encoder: Annotated[float, file_models.quantity("rad", least=0, most=0.1)] = 2e-5
    """Standard deviation of each joint's angle."""
    width: Annotated[float, file_models.quantity("m", least=0, most=0.1)] = 1e-4
    """Standard deviation of the opening between the fingers."""
    force: Annotated[float, file_models.quantity("N", least=0, most=100)] = 0.15
    """Standard deviation of the force at the wrist, each axis."""
    torque: Annotated[float, file_models.quantity("Nm", least=0, most=100)] = 0.01
    """Standard deviation of the torque at the wrist, each axis."""
    force_bias: Annotated[float, file_models.quantity("N", least=0, most=10)] = 1.0
    """Standard deviation of the wrist sensor's force bias, each axis. The bias is drawn from the seed,
    holds for a whole run and turns with the hand."""
    torque_bias: Annotated[float, file_models.quantity("Nm", least=0, most=10)] = 0.05
    """Standard deviation of the torque bias, likewise."""
    drift: file_models.Share = 0.1
    """Share by which the bias drifts within minutes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneSettings(file_models.FileValue):
    """Keys of a scene file beside its sections."""

    base: Annotated[str, file_models.NamedFile("scene")] | None = None
    """A scene, shipped or a file beside this one, on which this one is laid: mappings merge, other values
    replace, null removes."""
    robot: Annotated[str, file_models.NamedFile("robot")]
    """A shipped robot, or a robot file beside this one."""
    limits: SafetyLimits = field(default_factory=SafetyLimits)
    """Limits that the safety monitor enforces."""
    thinking: Thinking = field(default_factory=Thinking)
    """Simulated time charged for computing."""
    planner: planner_names.PlannerName | None = None
    """Planner of free motions, instead of that of the robot file; `auto` without either."""
    noise: Annotated[SensorNoise, Field(alias="sensors")] = field(default_factory=SensorNoise)
    """Noise of the sensors other than the cameras."""
    checkpoint_every: Count = 4
    """Number of handled items between two checkpoints of a run."""
    goal: str | None = None
    """Goal of a run: an expression of the numbers of items total, sorted, misplaced, left and outstanding
    (those that the feed still owes). Default: every item at its destination and none outstanding."""
    exchange: Exchange | None = None
    """Exchange of full bins and empty totes; without it they are never exchanged."""
    tool_error: Offset = field(default_factory=Pose)
    """True pose of the hand in its frame of the robot file; three lengths mean `offset`. Only the simulation
    reads it."""
    assortment: Assortment | None = None
    """Things without a catalogue, for entries of `spawn` with `assortment`."""
    calibration: SceneCalibration | None = None
    """Corrections of cameras and tool, written by `picktree calibrate`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneDescription(SceneSettings):
    """A scene file, read and resolved.

    `robot` is the name of a shipped robot or the path of a robot file. The poses in `cameras` contain the
    corrections of `calibration`.
    """

    name: str
    fixtures: tuple[Fixture, ...]
    bins: tuple[Bin, ...]
    cameras: tuple[CameraDescription, ...]
    catalogue: tuple[CatalogueEntry, ...]
    spawn: tuple[Spawn, ...]
    destinations: tuple[Destination, ...]
    source: str = ""
    """Path of the file."""
    text: str = ""
    """Unchanged text of the file, for the log."""
    belts: tuple[Belt, ...] = ()
    """Fixtures that are belts."""
    deliveries: tuple[Delivery, ...] = ()
    """Deliveries of the feed during a run."""
    unknown: tuple[Fixture, ...] = ()
    """Initial bodies that are unknown to the robot; only the simulation may read them."""
    files: tuple[file_models.FileName, ...] = field(default=(), compare=False, repr=False)
    """Files that the scene names, each with its path as text."""

    @property
    def heaped(self) -> bool:
        """Whether items lie in heaps."""
        return any(load.drop for load in self.loads)

    @property
    def tool(self) -> Pose:
        """Believed TCP, in the TCP frame of the robot file."""
        return Pose() if self.calibration is None else self.calibration.tcp

    @property
    def loads(self) -> tuple[Spawn, ...]:
        """Items at the beginning, and the loads of the feed."""
        return (*self.spawn, *(delivery.load for delivery in self.deliveries))

    @property
    def items_in_all(self) -> int | None:
        """Total number of items of a run; None when it is unlimited."""
        here = sum(spawn.number for spawn in self.spawn)
        totals = [delivery.total for delivery in self.deliveries]
        known = [total for total in totals if total is not None]
        return here + sum(known) if len(known) == len(totals) else None

    def find_entry(self, kind: str) -> CatalogueEntry | None:
        """Return the catalogue's entry of a believed kind; None: it is unknown."""
        return next((e for e in self.catalogue if e.kind == kind), None)

    def entry(self, kind: str) -> CatalogueEntry:
        return next(e for e in self.catalogue if e.kind == kind)

    def fixture(self, name: str) -> Fixture:
        return next(f for f in self.fixtures if f.id == name)
