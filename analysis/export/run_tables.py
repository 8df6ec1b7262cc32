"""Tables of a run: rows of ticks, visits, plans, picks, failures, items and measurements."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Generic, TypeAlias, TypeVar

import orjson

from picktree.analysis import Run
from picktree.analysis.explain import FailureStory
from picktree.logs import ESTIMATES, log_records, node_visits
from picktree.world import Candidate, Plan, event_fields, event_types

from .table_files import Column, ColumnDoc, columns, row_of, row_type

Time: TypeAlias = Annotated[float, ColumnDoc("simulated time", "s")]
Tick: TypeAlias = Annotated[int, ColumnDoc("number of the tick, 0 for the first of the log")]
Item: TypeAlias = Annotated[str, ColumnDoc("id of the object concerned; empty without an object")]
NodePath: TypeAlias = Annotated[str, ColumnDoc("path of the node in the tree")]
Cause: TypeAlias = Annotated[
    str, ColumnDoc("cause of the failure, such as grasp.missed; empty when it did not fail")
]
Message: TypeAlias = Annotated[str, ColumnDoc("message for people")]


X: TypeAlias = Annotated[float, ColumnDoc("position in the world, x", "m")]


Y: TypeAlias = Annotated[float, ColumnDoc("position in the world, y", "m")]


Z: TypeAlias = Annotated[float, ColumnDoc("position in the world, z", "m")]
Qx: TypeAlias = Annotated[float, ColumnDoc("orientation in the world: quaternion, x")]
Qy: TypeAlias = Annotated[float, ColumnDoc("orientation in the world: quaternion, y")]
Qz: TypeAlias = Annotated[float, ColumnDoc("orientation in the world: quaternion, z")]
Qw: TypeAlias = Annotated[float, ColumnDoc("orientation in the world: quaternion, w")]


@dataclass(frozen=True, slots=True)
class TickRow:
    tick: Tick
    time: Time
    root_status: Annotated[str, ColumnDoc("RUNNING, SUCCESS or FAILURE")]
    tip: Annotated[str, ColumnDoc("path of the deepest running node, empty when none runs")]
    tip_id: Annotated[str, ColumnDoc("registered name of that node, such as Grasp")]
    tip_message: Annotated[str, ColumnDoc("message of that node")]
    running: Annotated[int, ColumnDoc("nodes that run after the tick")]
    began: Annotated[int, ColumnDoc("nodes that began in the tick")]
    ended: Annotated[int, ColumnDoc("nodes that ended in the tick")]
    writes: Annotated[int, ColumnDoc("writes to the blackboard")]


def _json_of(meaning: str) -> Any:
    return Annotated[str, ColumnDoc(f"{meaning}: a JSON object")]


VisitRow = row_type(
    node_visits.Visit,
    "visit path id item attempt parent start end duration first_tick last_tick outcome cause origin message "
    "inputs evidence",
    visit=Annotated[int, ColumnDoc("number of the visit, in order of the starts")],
    duration=Annotated[float, ColumnDoc("simulated time from start to end", "s")],
    first_tick=Annotated[int, ColumnDoc("number of the first tick")],
    last_tick=Annotated[int, ColumnDoc("number of the last tick")],
    inputs=_json_of("values read through references, by port"),
    evidence=_json_of("evidence of the failure"),
)
StepRow = row_type(node_visits.SkillStep, "visit node item name start end outcome cause")
PlanRow = row_type(
    Plan,
    "time request planner outcome message checks thinking duration waypoints tool_length path tool_path",
    waypoints=Annotated[int, ColumnDoc("number of waypoints in joint space")],
    tool_length=Annotated[float, ColumnDoc("length of the TCP's path", "m")],
    path=Annotated[str, ColumnDoc("waypoints, joint positions in rad: a JSON list of lists")],
    tool_path=Annotated[str, ColumnDoc("positions of the TCP in the world, m: a JSON list of lists")],
)
CandidateRow = row_type(
    Candidate,
    "time purpose object name verdict score place stage by gap count x y z qx qy qz qw",
    purpose=Annotated[str, ColumnDoc("purpose of the search, and its node")],
    object=Annotated[str, ColumnDoc("id of the object")],
    x=X,
    y=Y,
    z=Z,
    qx=Qx,
    qy=Qy,
    qz=Qz,
    qw=Qw,
)
_PICK_FIELDS = (each.name for each in event_fields(event_types.PickEvent))
PickRow = row_type(
    event_types.PickEvent,
    " ".join(dict.fromkeys(("time", "object", "held", "node", *_PICK_FIELDS))),
    node=NodePath,
)


FailureRow = row_type(
    FailureStory,
    "failure time tick visit node id item attempt cause step message fate fate_by fate_at seconds_lost "
    "because_of handlers evidence",
    failure=Annotated[int, ColumnDoc("number of the failure")],
    handlers=Annotated[str, ColumnDoc("handlers that were tried, in order: a JSON list")],
    evidence=_json_of("evidence of the failure"),
)


@dataclass(frozen=True, slots=True)
class ItemRow:
    item: Annotated[str, ColumnDoc("id of the item in the robot's belief")]
    kind: Annotated[str, ColumnDoc("kind in the scene's catalogue")]
    colour: Annotated[str, ColumnDoc("colour, as the robot saw it")]
    state: Annotated[str, ColumnDoc("done, held, left or gone, at the end")]
    picks: Annotated[int, ColumnDoc("number of times that the fingers closed on the item")]
    held: Annotated[int, ColumnDoc("number of these closings that held the item")]
    failures: Annotated[int, ColumnDoc("failures about it")]
    first_seen: Annotated[float | None, ColumnDoc("simulated time", "s")]
    done: Annotated[float | None, ColumnDoc("simulated time at which it was done", "s")]


@dataclass(frozen=True, slots=True)
class EventRow:
    time: Time
    kind: Annotated[str, ColumnDoc("pick, recovery, item_done, fault, belief, image, …")]
    message: Message
    node: NodePath
    data: Annotated[str, ColumnDoc("values of the kind: a JSON object")]


@dataclass(frozen=True, slots=True)
class ObjectRow:
    """Objects of the belief and of the ground truth in one table, to be compared by id and time."""

    time: Time
    source: Annotated[str, ColumnDoc("belief, or truth, which the robot did not know")]
    id: Annotated[
        str, ColumnDoc("id of the object; the same object has one id in the belief and another in the truth")
    ]
    kind: Annotated[str, ColumnDoc("kind in the scene's catalogue")]
    colour: Annotated[str, ColumnDoc("name of the colour")]
    place: Annotated[str, ColumnDoc("believed place: table, hand, a bin; empty for the truth")]
    attached: Annotated[bool, ColumnDoc("true when believed to be in the hand")]
    confidence: Annotated[float, ColumnDoc("confidence of the belief, 0 to 1")]
    x: X
    y: Y
    z: Z
    qx: Qx
    qy: Qy
    qz: Qz
    qw: Qw


@dataclass(frozen=True, slots=True)
class JointRow:
    """Joint at a tick: for a column for each joint, pivot by `joint`."""

    time: Time
    joint: Annotated[str, ColumnDoc("name in the URDF")]
    position: Annotated[float, ColumnDoc("position; m for a prismatic joint", "rad or m")]
    velocity: Annotated[float, ColumnDoc("velocity; m/s for a prismatic joint", "rad/s or m/s")]
    effort: Annotated[float, ColumnDoc("effort; N for a prismatic joint", "Nm or N")]


@dataclass(frozen=True, slots=True)
class WrenchRow:
    """External wrench at the wrist, in world axes."""

    time: Time
    fx: Annotated[float, ColumnDoc("force, x", "N")]
    fy: Annotated[float, ColumnDoc("force, y", "N")]
    fz: Annotated[float, ColumnDoc("force, z", "N")]
    tx: Annotated[float, ColumnDoc("torque, x", "Nm")]
    ty: Annotated[float, ColumnDoc("torque, y", "Nm")]
    tz: Annotated[float, ColumnDoc("torque, z", "Nm")]


@dataclass(frozen=True, slots=True)
class ControlRow:
    """Set point of the arm's servo at the moment at which the joint was read."""

    time: Time
    controller: Annotated[str, ColumnDoc("commanding controller: Hold, Track, Brake, …")]
    joint: Annotated[str, ColumnDoc("name in the URDF")]
    reference: Annotated[float | None, ColumnDoc("position; empty while torques are commanded", "rad")]
    error: Annotated[float | None, ColumnDoc("reference less position", "rad")]


TimingRow = row_type(log_records.Timing, "time total physics control planning perception rendering recording")


@dataclass(frozen=True, slots=True)
class RunRow:
    key: Annotated[str, ColumnDoc("name, such as seed, status, version.pybullet, parameter.speed")]
    value: Annotated[str, ColumnDoc("value as text")]


def run_rows(run: Run) -> Iterator[RunRow]:
    """Yield the settings of the run and its result."""
    settings = asdict(run.info)
    groups = {"parameter": "parameters", "physics": "physics", "version": "versions"}
    for key, value in settings.items():
        if key not in groups.values():
            yield RunRow(key, str(value))
    for prefix, group in groups.items():
        for key, value in settings[group].items():
            yield RunRow(f"{prefix}.{key}", str(value))
    yield RunRow("format", str(run.log.format))
    yield RunRow("end", repr(run.end))
    yield RunRow("recovered", run.recovered)
    yield RunRow("status", run.status)
    if run.result is not None:
        yield RunRow("message", run.result.message)
        yield RunRow("items.total", str(run.result.items.total))
        yield RunRow("items.sorted", str(run.result.items.sorted))
        yield RunRow("digest", run.result.digest)
    figures = run.operator_figures
    for name in ESTIMATES:
        yield RunRow(f"figures.{name}", repr(getattr(figures, name).value))
    yield RunRow("figures.first_pass_yield", repr(figures.first_pass_yield.share))
    for use, share in figures.utilisation.items():
        yield RunRow(f"figures.utilisation.{use}", repr(share.value))


R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class TableSpec(Generic[R]):
    """Table; `row` is a dataclass whose fields are its columns."""

    name: str
    meaning: str
    """Meaning of a row."""
    row: type[R]
    rows: Callable[[Run], Iterable[R]]

    @property
    def columns(self) -> tuple[Column, ...]:
        return columns(self.row)


def ticks(run: Run) -> Iterator[TickRow]:
    for tick in run.ticks:
        record = tick.record
        tip = next((n for n in record.nodes if n.path == record.tip), None)
        began = sum(1 for edge in record.edges if edge.starts)
        yield TickRow(
            tick=tick.number,
            time=tick.time,
            root_status=record.root_status,
            tip=record.tip,
            tip_id=tip.id if tip else "",
            tip_message=tip.message if tip else "",
            running=sum(1 for n in record.nodes if n.status == "RUNNING"),
            began=began,
            ended=len(record.edges) - began,
            writes=len(record.writes),
        )


def visits(run: Run) -> Iterator[Any]:
    for v in run.visits:
        yield row_of(
            VisitRow, v, visit=v.number, first_tick=v.first, last_tick=v.last,
            inputs=_json(v.inputs), evidence=_json(v.evidence),
        )  # fmt: skip


def steps(run: Run) -> Iterator[Any]:
    for step in run.steps:
        yield row_of(StepRow, step)


def plans(run: Run) -> Iterator[Any]:
    for at in run.plans:
        plan = at.record
        yield row_of(
            PlanRow,
            plan,
            time=at.time,
            waypoints=len(plan.path),
            tool_length=sum(map(math.dist, plan.tool_path, plan.tool_path[1:])),
            path=_json(plan.path),
            tool_path=_json(plan.tool_path),
        )


def candidates(run: Run) -> Iterator[Any]:
    for at in run.candidates:
        for c in at.record.tried:
            yield CandidateRow(
                at.time, at.record.purpose, at.record.object, c.name, c.verdict, c.score,
                c.place, c.stage, c.by, c.gap, c.count,
                *c.position, *c.orientation,
            )  # fmt: skip


def picks(run: Run) -> Iterator[Any]:
    for at in run.events:
        if isinstance(at.record, event_types.PickEvent):
            yield row_of(PickRow, at.record, time=at.time)


def failures(run: Run) -> Iterator[Any]:
    for f in run.failures:
        handlers = _json([handling.handler for handling in f.handled_by])
        yield row_of(FailureRow, f, failure=f.number, handlers=handlers, evidence=_json(f.evidence))


def items(run: Run) -> Iterator[ItemRow]:
    done = {
        at.record.object: at.time for at in run.events if isinstance(at.record, event_types.ItemDoneEvent)
    }
    for story in run.explanation.items:
        picked = [pick for pick in run.picks if pick.object == story.id]
        yield row_of(
            ItemRow,
            story,
            item=story.id,
            picks=len(picked),
            held=sum(1 for pick in picked if pick.held),
            failures=sum(1 for failure in run.failures if failure.item == story.id),
            first_seen=min((event.time for event in story.events), default=None),
            done=done.get(story.id),
        )


def events(run: Run) -> Iterator[EventRow]:
    for at in run.events:
        event = at.record
        yield EventRow(at.time, event.kind, event.message, event.node, _json(event.data))


def objects(run: Run) -> Iterator[ObjectRow]:
    for at in run.log.beliefs():
        yield from (_object(at.time, "belief", body) for body in at.record.bodies)
    for at in run.log.truths():
        yield from (_object(at.time, "truth", body) for body in at.record.bodies)


def joints(run: Run) -> Iterator[JointRow]:
    for at in run.log.joints():
        read = at.record
        for name, position, velocity, effort in zip(
            read.names, read.position, read.velocity, read.effort, strict=True
        ):
            yield JointRow(at.time, name, position, velocity, effort)


def wrenches(run: Run) -> Iterator[WrenchRow]:
    for at in run.log.wrenches():
        force, torque = at.record.force, at.record.torque
        yield WrenchRow(at.time, force.x, force.y, force.z, torque.x, torque.y, torque.z)


def controls(run: Run) -> Iterator[ControlRow]:
    for at in run.log.controls():
        control = at.record
        for k, joint in enumerate(run.joints.names[: run.controls.references.shape[1]]):
            reference = control.reference[k] if control.reference else None
            yield ControlRow(
                at.time, control.controller, joint, reference, control.error[k] if control.error else None
            )


def timings(run: Run) -> Iterator[Any]:
    for at in run.log.timings():
        yield row_of(TimingRow, at.record, time=at.time)


def _object(time: float, source: str, body: log_records.BodyRecord) -> ObjectRow:
    return ObjectRow(
        time, source, body.id, body.kind, body.colour, body.place, body.attached, body.confidence,
        *body.pose.position, *body.pose.orientation,
    )  # fmt: skip


def _json(value: Mapping[str, object] | object) -> str:
    return orjson.dumps(value, option=orjson.OPT_NON_STR_KEYS).decode()


TABLES: tuple[TableSpec[Any], ...] = (
    TableSpec(
        "run",
        "a setting or a result of the run",
        RunRow,
        run_rows,
    ),
    TableSpec("ticks", "a tick of the tree", TickRow, ticks),
    TableSpec("visits", "an activation of a node, from its beginning to its end", VisitRow, visits),
    TableSpec("steps", "a step of a skill, such as the closing of the fingers", StepRow, steps),
    TableSpec("failures", "a failure with a cause, and its outcome", FailureRow, failures),
    TableSpec("items", "an item, as the robot believed", ItemRow, items),
    TableSpec("picks", "a closing of the fingers on an object", PickRow, picks),
    TableSpec("plans", "a request to the planner, and its answer", PlanRow, plans),
    TableSpec("candidates", "a candidate of a choice that was tried", CandidateRow, candidates),
    TableSpec("events", "something worth a line", EventRow, events),
    TableSpec("objects", "an object, each second and whenever the belief changed", ObjectRow, objects),
    TableSpec("joints", "a joint at a tick", JointRow, joints),
    TableSpec("wrenches", "the wrist at a tick", WrenchRow, wrenches),
    TableSpec("controls", "a joint of the arm at a tick, as commanded", ControlRow, controls),
    TableSpec("timings", "wall times of a tick", TimingRow, timings),
)
"""Tables in the order of interest for a reader."""
