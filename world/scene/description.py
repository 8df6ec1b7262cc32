"""Contents of a scene file as values: bodies, cameras, calibration, catalogue, spawn areas,
destinations, limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from picktree.files.yaml import file_models
from picktree.world import Array, Bounds, Box, Intrinsics, ObjectId, Pose, Shape, Vector3

TILE_COLOURS = ("red", "yellow", "blue", "purple", "green", "cyan")
"""Colours of the squares, row by row. All differ, so that each square is identified by itself and the
target's orientation is unambiguous."""
TILE_COLUMNS, TILE_ROWS = 3, 2
TILE_EDGE_SHARE = 0.75
"""Edge of a square over that of its cell. The grey between squares, and to the block's edges, lets a
camera separate them."""
TILE_HEIGHT = 0.00005
"""Height of the squares, which are printed on, over the block's top, m: a camera that looks from the side
sees no edge of theirs."""
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
    """m"""

    def corners(self) -> Array:
        """(4, 3), in order around it, in the target's frame, m."""
        half = self.edge / 2
        around = np.array([(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)], dtype=np.float64)
        return around * half + np.array(self.centre)


def tiles_on(size: Vector3) -> tuple[TargetTile, ...]:
    """The squares of a target of `size` (x, y, z) m: in three columns along x and two rows along y."""
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
    """The square as a body for whoever draws it, in the target's frame: half of it stands out, m."""
    x, y, z = tile.centre
    return Box((tile.edge, tile.edge, thickness)), Pose((x, y, z - TILE_HEIGHT))


@dataclass(frozen=True, slots=True)
class SceneCalibration:
    """Corrections of a scene's belief. They move what is believed, never what is true."""

    cameras: tuple[tuple[str, Pose], ...] = ()
    """Name, and the optical frame in the world, or in the corrected TCP's frame for a camera on the hand."""
    tcp: Pose = field(default_factory=Pose)
    """The corrected TCP in the frame of the one that the robot file states: the whole hand sits off by it."""
    date: str = ""
    by: str = ""
    """Short description of the calibration's source."""


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
class PlacementUncertainty:
    """How far a fixture may really stand from where the scene says: drawn from the seed, evenly."""

    position: float = 0.0
    """Along each of the fixture's x and y at most, m."""
    angle: float = 0.0
    """About its own z, and of its tilt about a horizontal axis, at most, rad."""


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
    """How far from there it may really stand: only the simulation draws where."""
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


@dataclass(frozen=True, slots=True)
class CameraDescription:
    """An RGB-D camera. `pose` is the optical frame in the world as everybody believes it: z looks forward,
    y down. `error` is the true optical frame given in the believed one: only the simulation reads it."""

    name: str
    pose: Pose
    size: tuple[int, int]
    """Width, height in pixels."""
    fov: float
    """Vertical field of view, rad."""
    depth_noise: float = 0.002
    """Standard deviation at 0.7 m, m; grows with the square of the depth."""
    edge_dropout: float = 0.5
    """Probability that a pixel on a depth edge returns nothing."""
    near: float = 0.05
    far: float = 3.0
    error: Pose = field(default_factory=Pose)
    on: Literal["world", "hand"] = "world"
    """`hand`: it moves with the tool, and `pose` is the optical frame in the TCP's."""

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
        found = dict(calibration.cameras).get(self.name) if calibration is not None else None
        if found is None:
            return self
        return replace(self, pose=found, error=found.inverse() @ self.pose @ self.error)


MAX_HIDDEN_SHARE = 0.25
"""Greatest share of the items' areas that the arm at `home` may hide from a camera."""
MIN_FELT_MASS = 0.03
"""Least mass whose weight a wrist surely feels in the hand, kg. A load of 12 g tells it from an empty hand,
and a weighing is off by 15 g at most."""


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """A kind of item: what perception may recognise and the simulation may spawn."""

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
class Spawn:
    """Items set down at random. Drawn from the stream `spawn`, from scene and seed alone."""

    counts: tuple[tuple[str, int], ...]
    """(kind, number)"""
    colours: tuple[str, ...]
    """Given out in turn, shuffled."""
    area: tuple[tuple[float, float], tuple[float, float]]
    """((x min, y min), (x max, y max)) for the items' centres, m."""
    gap: float = 0.025
    """Free distance between the items' footprints, m."""
    lying: float = 0.0
    """Share of the cylinders that lie on their side."""
    tumbled: bool = False
    """Dropped from 10 cm in any orientation instead of set down."""
    touching: bool = False
    """Set down side by side, each touching another."""
    into: ObjectId | None = None
    """Tote into which the items are poured; None: they come onto the table."""
    drop: Drop | None = None
    """How items that are handled as a heap come there before the run begins; None: they are no heap."""


MESH_SETS = ("random_urdfs",)
"""Sets of meshes that come with a package."""
ASSORTMENT = "assortment"
"""Name that stands for things of the assortment where a spawn entry asks for kinds."""


@dataclass(frozen=True, slots=True)
class Assortment:
    """Things without a catalogue. Only the simulation and the scorer may look at it."""

    meshes: str
    """Name of a set that comes with a package, or path of a folder with OBJ files."""
    scale: float
    """Factor from the files' lengths to metres."""
    density: float
    """Density, kg/m³."""
    friction: float
    least_mass: float = 0.0
    """Mass below which things are left out, kg."""
    tags: tuple[int, ...] = ()
    """Numbers of the ArUco tags that are on things; empty: none have one."""
    tag_size: float = 0.02
    """Side of a tag's black square, m."""


@dataclass(frozen=True, slots=True)
class Belt:
    """A fixture that carries what lies on it along its own +x while it runs."""

    id: ObjectId
    """Its box is the fixture of this name."""
    speed: float
    """m/s"""
    eye: float
    """Where a light barrier crosses it: from its middle along +x, m."""


@dataclass(frozen=True, slots=True)
class WhenClear:
    """A load comes when the robot says that it is done with what lies there."""


@dataclass(frozen=True, slots=True)
class AtIntervals:
    """A load comes whenever so much time has passed since the beginning, s."""

    period: float


@dataclass(frozen=True, slots=True)
class AtTimes:
    """A load comes at each of these simulated times, s, ascending."""

    times: tuple[float, ...]


When: TypeAlias = WhenClear | AtIntervals | AtTimes


@dataclass(frozen=True, slots=True)
class Delivery:
    """Entry of the feed. `load` is the load of one delivery, as an entry of `spawn`. For a belt it is the
    mixture of single items, over the whole of the belt's top."""

    load: Spawn
    when: When = WhenClear()
    """Time of the loads; for a belt always `WhenClear`: it runs when the robot is ready."""
    total: int | None = None
    """Items in all; None: for ever."""
    belt: ObjectId | None = None
    """The belt at whose upstream end the items are set down; None: on the table, or into the load's tote."""
    spacing: float = 0.15
    """Mean distance on the belt from one item to the next, m."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """Somebody puts an empty bin in a full one's place when the robot asks."""

    seconds: float
    """How long that takes."""


@dataclass(frozen=True, slots=True)
class Destination:
    """Items for which `where` is true belong into the bin `to`. The first rule that holds counts."""

    where: str
    to: ObjectId


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Limits that the safety monitor enforces."""

    force: float = 60.0
    """Contact force at the wrist, N."""
    workspace: Bounds = field(default_factory=lambda: Bounds((-0.5, -1.0, -0.02), (1.0, 1.0, 1.5)))
    """Where the TCP may be, in the world."""
    payload: float | None = None
    """Greatest mass in the hand, kg; None: what the robot's rated payload leaves."""


@dataclass(frozen=True, slots=True)
class Thinking:
    """Simulated time that computing costs, s."""

    collision_check: float = 25e-6
    image: float = 0.06


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviations of the errors of the sensors other than the cameras."""

    encoder: float = 2e-5
    """rad"""
    width: float = 1e-4
    """m"""
    force: float = 0.15
    """N, each axis"""
    torque: float = 0.01
    """Nm, each axis"""
    force_bias: float = 1.0
    """Standard deviation of the wrist sensor's force bias for the whole run, in the hand's axes, N, each
    axis."""
    torque_bias: float = 0.05
    """Nm, each axis"""
    drift: float = 0.1
    """Share of itself by which the bias wanders within minutes."""


@dataclass(frozen=True, slots=True)
class SceneDescription:
    """A scene file, read and resolved."""

    name: str
    robot: str
    """Name of a shipped robot, or the path of a robot file."""
    fixtures: tuple[Fixture, ...]
    bins: tuple[Bin, ...]
    cameras: tuple[CameraDescription, ...]
    catalogue: tuple[CatalogueEntry, ...]
    spawn: tuple[Spawn, ...]
    destinations: tuple[Destination, ...]
    limits: SafetyLimits = field(default_factory=SafetyLimits)
    thinking: Thinking = field(default_factory=Thinking)
    noise: SensorNoise = field(default_factory=SensorNoise)
    checkpoint_every: int = 4
    """Items between two checkpoints."""
    goal: str | None = None
    """An expression over `total`, `sorted`, `misplaced`, `left`, `outstanding`; default: all are sorted, and
    nothing is outstanding."""
    source: str = ""
    """Path of the file."""
    text: str = ""
    """The file as it was read, for the log."""
    belts: tuple[Belt, ...] = ()
    """Which of the fixtures are belts."""
    deliveries: tuple[Delivery, ...] = ()
    """Deliveries of the feed during a run."""
    exchange: Exchange | None = None
    """None: nobody exchanges bins."""
    unknown: tuple[Fixture, ...] = ()
    """Bodies that stand there from the beginning, and that nobody has told the robot of: only the simulation
    may look at them."""
    tool_error: Pose = field(default_factory=Pose)
    """Where the TCP really is, seen from where the robot file says: the hand is mounted off by it. Only the
    simulation reads it."""
    planner: str = ""
    """Planner of free motions; empty: that of the robot."""
    calibration: SceneCalibration | None = None
    """Calibration of cameras and tool; the poses in `cameras` contain its corrections already."""
    assortment: Assortment | None = None
    """Things without a catalogue; None: there are none."""
    files: tuple[file_models.FileName, ...] = field(default=(), compare=False, repr=False)
    """Files that the scene names, each with its path as text."""

    @property
    def heaped(self) -> bool:
        """Whether items lie in heaps."""
        return any(load.drop for load in self.loads)

    @property
    def tool(self) -> Pose:
        """Where the TCP is believed to be, seen from where the robot file says."""
        return Pose() if self.calibration is None else self.calibration.tcp

    @property
    def loads(self) -> tuple[Spawn, ...]:
        """Items at the beginning, and the loads of the feed."""
        return (*self.spawn, *(delivery.load for delivery in self.deliveries))

    @property
    def items_in_all(self) -> int | None:
        """How many will have come in the end; None when they come for ever."""
        here = sum(number for spawn in self.spawn for _, number in spawn.counts)
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
