"""The rows of each table. Times are simulated seconds from the run's start; paths name nodes of the tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from .columns import Says

Time: TypeAlias = Annotated[float, Says("simulated time", "s")]
Tick: TypeAlias = Annotated[int, Says("number of the tick, 0 for the first of the log")]
Item: TypeAlias = Annotated[str, Says("id of the object that it is about, empty when there is none")]
Path: TypeAlias = Annotated[str, Says("path of the node in the tree")]
Cause: TypeAlias = Annotated[
    str, Says("cause of the failure, such as grasp.missed; empty when it did not fail")
]
Message: TypeAlias = Annotated[str, Says("what it said, for people")]
X: TypeAlias = Annotated[float, Says("position in the world, x", "m")]
Y: TypeAlias = Annotated[float, Says("position in the world, y", "m")]
Z: TypeAlias = Annotated[float, Says("position in the world, z", "m")]
Qx: TypeAlias = Annotated[float, Says("orientation in the world: quaternion, x")]
Qy: TypeAlias = Annotated[float, Says("orientation in the world: quaternion, y")]
Qz: TypeAlias = Annotated[float, Says("orientation in the world: quaternion, z")]
Qw: TypeAlias = Annotated[float, Says("orientation in the world: quaternion, w")]


@dataclass(frozen=True, slots=True)
class TickRow:
    tick: Tick
    time: Time
    root_status: Annotated[str, Says("RUNNING, SUCCESS or FAILURE")]
    tip: Annotated[str, Says("path of the deepest running node, empty when none runs")]
    tip_id: Annotated[str, Says("registered name of that node, such as Grasp")]
    tip_message: Annotated[str, Says("what that node said")]
    running: Annotated[int, Says("nodes that run after the tick")]
    began: Annotated[int, Says("nodes that began in the tick; 0 in logs of format 1")]
    ended: Annotated[int, Says("nodes that ended in the tick; 0 in logs of format 1")]
    writes: Annotated[int, Says("writes to the blackboard")]


@dataclass(frozen=True, slots=True)
class VisitRow:
    visit: Annotated[int, Says("number of the visit, in the order of the beginnings")]
    path: Path
    id: Annotated[str, Says("registered name of the node, such as Grasp")]
    item: Item
    attempt: Annotated[int, Says("visits of this node for this item so far, this one included")]
    parent: Annotated[int | None, Says("number of the visit of the parent; empty for the root")]
    start: Annotated[float, Says("simulated time at which it began", "s")]
    end: Annotated[float, Says("simulated time at which it ended, or the log did", "s")]
    duration: Annotated[float, Says("simulated time from beginning to end", "s")]
    first_tick: Annotated[int, Says("number of the tick in which it began")]
    last_tick: Annotated[int, Says("number of the tick in which it ended")]
    outcome: Annotated[str, Says("SUCCESS, FAILURE, SKIPPED, HALTED; RUNNING when the log ends before")]
    cause: Cause
    origin: Annotated[str, Says("path of the node that the failure came from")]
    message: Message
    inputs: Annotated[str, Says("what it read through references, by port: a JSON object")]
    evidence: Annotated[str, Says("evidence of the failure: a JSON object")]


@dataclass(frozen=True, slots=True)
class PlanRow:
    time: Time
    request: Annotated[str, Says("what was asked for")]
    planner: Annotated[str, Says("who answered")]
    outcome: Annotated[str, Says("found, or why not")]
    message: Message
    checks: Annotated[int, Says("collision checks")]
    thinking: Annotated[float, Says("simulated time that the checks cost", "s")]
    duration: Annotated[float, Says("of the motion", "s")]
    waypoints: Annotated[int, Says("of the path in joint space")]
    tool_length: Annotated[float, Says("way of the tool's centre point", "m")]
    path: Annotated[str, Says("waypoints, joint positions in rad: a JSON list of lists")]
    tool_path: Annotated[str, Says("points of the tool in the world, m: a JSON list of lists")]


@dataclass(frozen=True, slots=True)
class CandidateRow:
    time: Time
    purpose: Annotated[str, Says("what was chosen, and by which node")]
    object: Annotated[str, Says("id of the object")]
    name: Annotated[str, Says("of the candidate")]
    verdict: Annotated[str, Says("accepted, or why not")]
    score: Annotated[float, Says("by which candidates were ranked, the lowest first")]
    place: Annotated[str, Says("where the object would have been put; empty when it did not come that far")]
    stage: Annotated[str, Says("that it did not pass, or the last that it passed; empty in older logs")]
    by: Annotated[str, Says("what was in the way")]
    gap: Annotated[float, Says("distance to it, negative when it is a depth; 0 when not known", "m")]
    count: Annotated[int, Says("how many places of the grasp dropped out alike")]
    x: X
    y: Y
    z: Z
    qx: Qx
    qy: Qy
    qz: Qz
    qw: Qw


@dataclass(frozen=True, slots=True)
class PickRow:
    time: Time
    object: Annotated[str, Says("id of the object that the fingers closed on")]
    held: Annotated[bool, Says("whether it was held, as the robot felt it")]
    node: Path
    form: Annotated[str, Says("box, cylinder, …")]
    candidate: Annotated[str, Says("name of the grasp that was tried")]
    first_try: Annotated[bool | None, Says("whether the object had not been tried before")]
    width: Annotated[float | None, Says("opening of the fingers after they closed", "m")]
    load: Annotated[float | None, Says("force at the wrist after the lift, against the empty hand", "N")]


@dataclass(frozen=True, slots=True)
class FailureRow:
    failure: Annotated[int, Says("number of the failure")]
    time: Time
    tick: Tick
    visit: Annotated[int, Says("number of the visit that failed")]
    node: Path
    id: Annotated[str, Says("registered name of the node")]
    item: Item
    attempt: Annotated[int, Says("of that node for that item")]
    cause: Cause
    message: Message
    fate: Annotated[str, Says("cured, passed_over, branched, ended or open")]
    fate_by: Annotated[str, Says("path of the node that decided it")]
    fate_at: Annotated[float | None, Says("simulated time at which that was", "s")]
    seconds_lost: Annotated[float | None, Says("simulated time from the failure until then", "s")]
    because_of: Annotated[int | None, Says("number of the failure that it follows from")]
    handlers: Annotated[str, Says("what recovery tried, in order: a JSON list")]
    evidence: Annotated[str, Says("a JSON object")]


@dataclass(frozen=True, slots=True)
class ItemRow:
    item: Annotated[str, Says("id, as the robot believed")]
    kind: Annotated[str, Says("of the catalogue")]
    colour: Annotated[str, Says("as the robot saw it")]
    state: Annotated[str, Says("done, held, left or gone, at the end")]
    picks: Annotated[int, Says("times that the fingers closed on it")]
    held: Annotated[int, Says("times that it was then held")]
    failures: Annotated[int, Says("failures about it")]
    first_seen: Annotated[float | None, Says("simulated time", "s")]
    done: Annotated[float | None, Says("simulated time at which it was done", "s")]


@dataclass(frozen=True, slots=True)
class EventRow:
    time: Time
    kind: Annotated[str, Says("pick, recovery, item_done, fault, belief, image, …")]
    message: Message
    node: Path
    data: Annotated[str, Says("what belongs to the kind: a JSON object")]


@dataclass(frozen=True, slots=True)
class ObjectRow:
    """The belief and the truth in one table, to be compared by id and time."""

    time: Time
    source: Annotated[str, Says("belief, or truth, which the robot did not know")]
    id: Annotated[str, Says("of the object; belief and truth have names of their own")]
    kind: Annotated[str, Says("of the catalogue")]
    colour: Annotated[str, Says("its name")]
    place: Annotated[str, Says("where it is believed to be: table, hand, a bin; empty for the truth")]
    attached: Annotated[bool, Says("whether it is believed to be in the hand")]
    confidence: Annotated[float, Says("of the belief, 0 to 1")]
    x: X
    y: Y
    z: Z
    qx: Qx
    qy: Qy
    qz: Qz
    qw: Qw


@dataclass(frozen=True, slots=True)
class JointRow:
    """One joint at one tick: for a column a joint, pivot by `joint`."""

    time: Time
    joint: Annotated[str, Says("name in the URDF")]
    position: Annotated[float, Says("of a joint that slides: m", "rad or m")]
    velocity: Annotated[float, Says("of a joint that slides: m/s", "rad/s or m/s")]
    effort: Annotated[float, Says("of a joint that slides: N", "Nm or N")]


@dataclass(frozen=True, slots=True)
class WrenchRow:
    """What acts on the wrist from outside, in the world's axes."""

    time: Time
    fx: Annotated[float, Says("force, x", "N")]
    fy: Annotated[float, Says("force, y", "N")]
    fz: Annotated[float, Says("force, z", "N")]
    tx: Annotated[float, Says("torque, x", "Nm")]
    ty: Annotated[float, Says("torque, y", "Nm")]
    tz: Annotated[float, Says("torque, z", "Nm")]


@dataclass(frozen=True, slots=True)
class ControlRow:
    """What the arm's servo had been told for the moment at which the joint was read."""

    time: Time
    controller: Annotated[str, Says("who commands: Hold, Track, Brake, …")]
    joint: Annotated[str, Says("name in the URDF")]
    reference: Annotated[float | None, Says("position; empty while torques are commanded", "rad")]
    error: Annotated[float | None, Says("reference less position", "rad")]


@dataclass(frozen=True, slots=True)
class TimingRow:
    """Of the wall clock, which no run has twice."""

    time: Time
    total: Annotated[float, Says("wall time of the tick", "s")]
    physics: Annotated[float, Says("wall time of it", "s")]
    control: Annotated[float, Says("wall time of it", "s")]
    planning: Annotated[float, Says("wall time of it", "s")]
    perception: Annotated[float, Says("wall time of it", "s")]
    rendering: Annotated[float, Says("wall time of it", "s")]
    recording: Annotated[float, Says("wall time of it", "s")]


@dataclass(frozen=True, slots=True)
class RunRow:
    key: Annotated[str, Says("such as seed, status, version.pybullet, parameter.speed")]
    value: Annotated[str, Says("as text")]
