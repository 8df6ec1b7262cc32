"""Records of a log: values that the recorder writes and the reader returns, their JSON, and its schemas.

Times are simulated seconds, wall times (only in `Timing`) are seconds of the wall clock. The classes have no
slots, because orjson writes those eight times as slowly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    TypeVar,
)

import orjson

from picktree.simulation import HoleSeating
from picktree.world import (
    BlackboardWrite,
    Body,
    NodeState,
    Pose,
    Shape,
    StreamVariant,
    Tick,
    Transition,
    Values,
    Vector3,
)
from picktree.world.scene import Hole

from .arithmetic_record import Arithmetic

if TYPE_CHECKING:
    from pydantic import TypeAdapter


R = TypeVar("R")


def encode(record: object) -> bytes:
    """Encode a record as one line of JSON. Raises TypeError for values that JSON cannot express."""
    return orjson.dumps(record, option=orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS)


def decode(kind: type[R], data: bytes) -> R:
    """Decode a record of that kind. Unknown fields of a younger log are ignored.

    Raises ValueError when a field is missing or has another type.
    """
    record: R = record_adapter(kind).validate_json(data)
    return record


@cache
def record_adapter(kind: type) -> TypeAdapter[Any]:
    """Build the reader of a kind of record, once in a process: it takes milliseconds."""
    from pydantic import TypeAdapter  # needed for reading only, and slow to import

    return TypeAdapter(kind)


FORMAT = 3
"""Version of the log's format. It is raised when an older reader could no longer interpret a log."""


@dataclass(frozen=True)
class ResumedFrom:
    """Origin of a run that resumes from a checkpoint of another run."""

    log: str
    """Path of the other run's log when this run began."""
    checkpoint: str
    """Name of the checkpoint in the other log."""
    time: float
    """Time of the checkpoint, simulated s. Messages of this log at that time only describe the state
    there."""
    items_done: int
    digest: str
    """Digest of the other run up to the checkpoint. The digest of this run continues it."""
    as_it_stands: bool = False
    """Whether the run resumes from the simulation's last recorded state, at rest, instead of the
    checkpoint's.

    The robot's knowledge is still that of the checkpoint; it looks first.
    """

    def words(self) -> Mapping[str, str]:
        return {
            "log": self.log,
            "checkpoint": self.checkpoint,
            "time": repr(self.time),
            "items_done": str(self.items_done),
            "digest": self.digest,
            **({"as_it_stands": "true"} if self.as_it_stands else {}),
        }

    @classmethod
    def from_words(cls, words: Mapping[str, str]) -> ResumedFrom:
        """Parse the text made by `words`. Raises KeyError or ValueError."""
        return cls(
            words["log"],
            words["checkpoint"],
            float(words["time"]),
            int(words["items_done"]),
            words["digest"],
            words.get("as_it_stands") == "true",
        )


@dataclass(frozen=True)
class RunInfo:
    """Settings with which a run was started, in the log's metadata and in the recipe of a batch."""

    mission: str
    scene: str
    robot: str
    seed: int | None
    """Seed of everything random; None in a log without its metadata, and in the recipe of several runs."""
    backend: str
    tick: float = 0.05
    """Length of a tick, simulated s."""
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    """Parameters of the mission, as given by `--set`."""
    physics: Mapping[str, str] = field(default_factory=dict[str, str])
    """Settings of the simulation, with the costs of thinking."""
    versions: Mapping[str, str] = field(default_factory=dict[str, str])
    revision: str = ""
    """Git revision of picktree; empty outside a checkout."""
    verify: bool = False
    limit: float | None = None
    """Simulated seconds after which the run is ended; None: not stated."""
    own_scene: bool = True
    """Whether the scene is the one that the mission names."""
    machine: Mapping[str, str] = field(default_factory=dict[str, str])
    """Computer of the run; empty in older logs."""
    arithmetic: Arithmetic = field(default_factory=Arithmetic)
    """Libraries and kernels that computed the run; empty in older logs."""
    files: Mapping[str, str] = field(default_factory=dict[str, str])
    """SHA-256 in hex and path of the original file, by name of the attachment."""
    continues: ResumedFrom | None = None
    variant: StreamVariant | None = None
    """Other noise and planner seeds than those of the seed; None: those of the seed."""
    nominal: tuple[str, ...] = ()
    """Parts of the simulation that no fault affects, as `simulation.NominalPart.words`."""

    @property
    def seed_text(self) -> str:
        """Seed in words, as `seed 7` or `seed unknown`."""
        return f"seed {'unknown' if self.seed is None else self.seed}"


@dataclass(frozen=True)
class TickMessage:
    """Message of one tick with its changes. Nodes without a transition are as before."""

    root_status: str
    tip: str
    """Path of the deepest running node."""
    transitions: tuple[Transition, ...] = ()
    writes: tuple[BlackboardWrite, ...] = ()


@dataclass(frozen=True)
class NodesMessage:
    """State of all nodes after the tick of the same time, parents first."""

    nodes: tuple[NodeState, ...]


def tick_json(tick: Tick) -> bytes:
    """Encode the message of a tick."""
    return encode(TickMessage(tick.root_status, tick.tip, tick.transitions, tick.writes))


def nodes_json(tick: Tick) -> bytes:
    """Encode the message with the state of all nodes after a tick."""
    return encode(NodesMessage(tick.nodes))


@dataclass(frozen=True)
class NodeTime:
    path: str
    seconds: float


@dataclass(frozen=True)
class Timing:
    """Wall times of one tick, in all and by part."""

    total: Annotated[float, "wall time of the tick", "s"]
    physics: Annotated[float, "wall time of the physics", "s"] = 0.0
    control: Annotated[float, "wall time of the control", "s"] = 0.0
    planning: Annotated[float, "wall time of the planner", "s"] = 0.0
    perception: Annotated[float, "wall time of perception", "s"] = 0.0
    rendering: Annotated[float, "wall time of the simulated cameras", "s"] = 0.0
    recording: Annotated[float, "wall time of the recording", "s"] = 0.0
    nodes: tuple[NodeTime, ...] = ()


@dataclass(frozen=True)
class Vector:
    """Vector with components as a viewer's plot names them: `/wrench.force.z`."""

    x: float
    y: float
    z: float


@dataclass(frozen=True)
class WrenchReading:
    """External force (N) and torque (Nm) at the wrist, in world axes."""

    force: Vector
    torque: Vector
    magnitude: float


@dataclass(frozen=True)
class Event:
    """Event: item done, injected fault, recovery, checkpoint, operator answer, change of the belief, …"""

    kind: str
    message: str
    node: str = ""
    data: Values = field(default_factory=dict[str, object])


@dataclass(frozen=True)
class LogLine:
    """Log line for people. `level` is DEBUG, INFO, WARNING, ERROR or FATAL; `name` is the node's path."""

    level: str
    message: str
    name: str = ""


@dataclass(frozen=True)
class Joints:
    """Joint readings by joint: rad or m, rad/s or m/s, Nm or N."""

    names: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]


@dataclass(frozen=True)
class TrueState:
    """State of the simulation at a tick: all of it, or the changes since the message before."""

    whole: bool
    state: Mapping[str, Any]


@dataclass(frozen=True)
class Control:
    """Set point of the arm's servo at the moment at which the tick's joints were read."""

    controller: str
    """Name of the controller: `Hold`, `Track`, `Brake`, …"""
    reference: tuple[float, ...] = ()
    """Reference position by joint of the arm, rad; empty while torques are commanded."""
    error: tuple[float, ...] = ()
    """Reference minus position by joint, rad."""


@dataclass(frozen=True)
class Transform:
    """Pose of the frame `child` in the frame `parent`."""

    parent: str
    child: str
    pose: Pose


@dataclass(frozen=True)
class LinkMesh:
    """Visual mesh of a link: a binary glTF file (Y up), in the link's own frame."""

    link: str
    glb: bytes


@dataclass(frozen=True)
class BlockRecord:
    """Box along the axes of its body's frame: edge lengths and centre, m."""

    size: Vector3
    at: Vector3


@dataclass(frozen=True)
class BodyRecord(Body):
    """Movable body of the belief, or of the ground truth."""

    role: str = "item"
    place: str = ""
    attached: bool = False
    confidence: float = 1.0
    sigma_position: float = 0.0
    sigma_angle: float = 0.0
    last_seen: float = 0.0
    blocks: tuple[BlockRecord, ...] = ()
    """Boxes of an obstacle in its frame; `shape` is then the box around all of them."""
    seat: HoleSeating | None = None
    """Seating of a true item at a hole; None: not at a hole, or a believed body."""


@dataclass(frozen=True)
class ThingRecord(BodyRecord):
    """Thing of a heap, or an item whose measures rules ask for. None: not known."""

    mass: float | None = None
    """Mass, kg; the weighed one for a believed thing."""
    size: float | None = None
    """Greatest distance of two of its points, m; from depth images for a believed thing."""
    tag: int | None = None
    """Number of the ArUco tag on it; the read one for a believed thing."""


@dataclass(frozen=True)
class PartRecord:
    """Part of a body that never moves. `pose` is in the world."""

    id: str
    colour: str
    shape: Shape
    pose: Pose
    holes: tuple[Hole, ...] = ()
    """Holes of a box, from its top face."""


@dataclass(frozen=True)
class Scene:
    """Scene: one message of `/scene/objects` or `/truth/objects`."""

    bodies: tuple[BodyRecord, ...]
    fixed: tuple[PartRecord, ...]
