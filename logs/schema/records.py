"""Everything that a log holds, as values: what the recorder takes and what the reader gives back.

Times are simulated seconds, wall times (only in `Timing`) are seconds of the wall clock. The classes have no
slots, because orjson writes those eight times as slowly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from ...simulation.scoring.truth import HoleSeating
from ...world.scene.description import Hole
from ...world.shapes import Shape
from ...world.values import Pose, Vector3
from .arithmetic_record import Arithmetic

FORMAT = 2
"""Of the log as a whole. Raised when an older reader could no longer make sense of it."""

Values: TypeAlias = Mapping[str, object]
"""Plain JSON values by name."""


def _no_values() -> Values:
    return {}


def _no_words() -> Mapping[str, str]:
    return {}


@dataclass(frozen=True)
class ResumedFrom:
    """Of a run that goes on from a checkpoint of another."""

    log: str
    """Path of the other's log when this run began."""
    checkpoint: str
    """Name of the checkpoint in it."""
    time: float
    """Simulated s. What this log holds of that moment only says how things stood."""
    items_done: int
    digest: str
    """Of the other run up to there. The digest of this one goes on from it."""
    as_it_stands: bool = False
    """The simulation is as the other log told of it last, at rest, while the robot knows what it knew at the
    checkpoint: it looks first."""

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
        """The inverse of `words`. Raises KeyError or ValueError."""
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
    """What a run was started with. All of it stands in the log's metadata."""

    mission: str
    scene: str
    robot: str
    seed: int
    backend: str
    tick: float
    """Length of a tick, s."""
    parameters: Mapping[str, str] = field(default_factory=_no_words)
    """Of the mission, as given by `--set`."""
    physics: Mapping[str, str] = field(default_factory=_no_words)
    """Settings of the simulation, thinking costs among them."""
    versions: Mapping[str, str] = field(default_factory=_no_words)
    revision: str = ""
    """Git revision of picktree, empty outside a checkout."""
    verify: bool = False
    limit: float | None = None
    """Simulated seconds after which the run is ended; None in older logs."""
    own_scene: bool = True
    """The scene is the one that the mission names, not another that was given."""
    machine: Mapping[str, str] = field(default_factory=_no_words)
    """The computer that it ran on; empty in older logs."""
    arithmetic: Arithmetic = field(default_factory=Arithmetic)
    """Libraries and kernels that it was computed with; empty in older logs."""
    files: Mapping[str, str] = field(default_factory=_no_words)
    """By name of the attachment: SHA-256 in hex and path of the file that it was made from."""
    continues: ResumedFrom | None = None


@dataclass(frozen=True)
class TreeNode:
    """One node of the tree as it was loaded. `parent` is empty for the root."""

    path: str
    id: str
    """Registered name, such as `Grasp`."""
    name: str
    parent: str
    children: tuple[str, ...] = ()
    """Paths, in order."""
    ports: Mapping[str, str] = field(default_factory=_no_words)
    """As written in the mission."""


@dataclass(frozen=True)
class Tree:
    """All nodes, parents before their children."""

    nodes: tuple[TreeNode, ...]


@dataclass(frozen=True)
class NodeStatusRecord:
    """One node after a tick."""

    path: str
    id: str
    status: str
    """IDLE, RUNNING, SUCCESS, FAILURE or SKIPPED."""
    ticked: bool
    """Whether this tick reached the node."""
    message: str = ""
    cause: str = ""
    evidence: Values = field(default_factory=_no_values)


@dataclass(frozen=True)
class WriteRecord:
    """One write to the blackboard."""

    key: str
    value: object
    node: str


@dataclass(frozen=True)
class TransitionRecord:
    """A node begins (RUNNING) or has ended (SUCCESS, FAILURE, SKIPPED; IDLE: it was halted)."""

    path: str
    status: str
    inputs: Values = field(default_factory=_no_values)
    """Of a node that begins: what it read through references, by port."""
    subject: str = ""
    """Of a node that begins: the object that its first port of type `object` names, if any."""
    cause: str = ""
    origin: str = ""
    """Of a failure: path of the node that it came from."""
    message: str = ""
    evidence: Values = field(default_factory=_no_values)


@dataclass(frozen=True)
class Tick:
    """The whole tree after one tick. `tip` is the path of the deepest running node."""

    root_status: str
    tip: str
    nodes: tuple[NodeStatusRecord, ...]
    writes: tuple[WriteRecord, ...] = ()
    transitions: tuple[TransitionRecord, ...] = ()
    """Which nodes began and ended in this tick, in order. Empty in logs of format 1."""


@dataclass(frozen=True)
class NodeTime:
    path: str
    seconds: float


@dataclass(frozen=True)
class Timing:
    """Wall seconds that one tick took, in all and by part."""

    total: float
    physics: float = 0.0
    control: float = 0.0
    planning: float = 0.0
    perception: float = 0.0
    rendering: float = 0.0
    recording: float = 0.0
    nodes: tuple[NodeTime, ...] = ()


@dataclass(frozen=True)
class Vector:
    """Components as a viewer's plot names them: `/wrench.force.z`."""

    x: float
    y: float
    z: float


@dataclass(frozen=True)
class WrenchReading:
    """External force (N) and torque (Nm) at the wrist, in the world's axes."""

    force: Vector
    torque: Vector
    magnitude: float


@dataclass(frozen=True)
class Plan:
    """One request to the planner and its answer; see `world.journal.PlanMade`. Older logs lack what has a
    default."""

    request: str
    planner: str
    checks: int
    thinking: float
    outcome: str
    message: str
    duration: float
    path: tuple[tuple[float, ...], ...] = ()
    tool_path: tuple[tuple[float, float, float], ...] = ()
    start: tuple[float, ...] = ()
    version: int = 0
    length: float = 0.0
    way: float = 0.0
    singular: float = 0.0


@dataclass(frozen=True)
class StageCount:
    """How many candidates reached a stage of a choice."""

    name: str
    count: int


@dataclass(frozen=True)
class Candidate:
    name: str
    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]
    score: float
    verdict: str
    place: str = ""
    stage: str = ""
    by: str = ""
    gap: float = 0.0
    count: int = 1


@dataclass(frozen=True)
class Candidates:
    """The trail of a choice; see `world.journal.CandidatesRanked`. Older logs lack what has a default."""

    purpose: str
    object: str
    stages: tuple[StageCount, ...]
    tried: tuple[Candidate, ...]
    into: str = ""


@dataclass(frozen=True)
class Event:
    """Something worth a line: item done, fault injected, recovery, checkpoint, operator answer, belief."""

    kind: str
    message: str
    node: str = ""
    data: Values = field(default_factory=_no_values)


@dataclass(frozen=True)
class LogLine:
    """A line for people. `level` is DEBUG, INFO, WARNING, ERROR or FATAL; `name` is the node's path."""

    level: str
    message: str
    name: str = ""


@dataclass(frozen=True)
class Joints:
    """By joint: rad or m, rad/s or m/s, Nm or N."""

    names: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]


@dataclass(frozen=True)
class TrueState:
    """Of the simulation at a tick: all of it, or what is otherwise than in the message before."""

    whole: bool
    state: Mapping[str, Any]


@dataclass(frozen=True)
class Control:
    """What the arm's servo had been told for the moment at which the tick's joints were read."""

    controller: str
    """Who commands: `Hold`, `Track`, `Brake`, …"""
    reference: tuple[float, ...] = ()
    """By joint of the arm, rad; empty while torques are commanded."""
    error: tuple[float, ...] = ()
    """Reference less position, rad."""


@dataclass(frozen=True)
class Transform:
    """The frame `child` given in the frame `parent`."""

    parent: str
    child: str
    pose: Pose


@dataclass(frozen=True)
class LinkMesh:
    """What a link of the robot looks like: a binary glTF file (Y up), in the link's own frame."""

    link: str
    glb: bytes


@dataclass(frozen=True)
class BlockRecord:
    """A box along the axes of its body's frame: edge lengths and centre, m."""

    size: Vector3
    at: Vector3


@dataclass(frozen=True)
class BodyRecord:
    """A movable body as it is believed, or as it truly is. `pose` is in the world."""

    id: str
    kind: str
    form: str
    colour: str
    shape: Shape
    pose: Pose
    role: str = "item"
    place: str = ""
    attached: bool = False
    confidence: float = 1.0
    sigma_position: float = 0.0
    sigma_angle: float = 0.0
    last_seen: float = 0.0
    blocks: tuple[BlockRecord, ...] = ()
    """Of an obstacle: the boxes in its frame that it takes up; `shape` is then the box about all."""
    seat: HoleSeating | None = None
    """Of a true item that is at a hole: how."""


@dataclass(frozen=True)
class PartRecord:
    """A piece of a body that never moves: `pose` is in the world."""

    id: str
    colour: str
    shape: Shape
    pose: Pose
    holes: tuple[Hole, ...] = ()
    """In a box, from its top face."""


@dataclass(frozen=True)
class Scene:
    """One message of `/scene/objects` or `/truth/objects`."""

    bodies: tuple[BodyRecord, ...]
    fixed: tuple[PartRecord, ...]
