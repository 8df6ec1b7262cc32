"""Export of a run: to a folder of tables, or to one file for Rerun."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, TypeAlias, TypeVar

import orjson

from picktree.analysis import Run
from picktree.analysis.explain import ItemStory
from picktree.files import file_system
from picktree.logs import log_records, optional_import
from picktree.world import Plain, event_types

from . import row_types
from .table_files import Column, cells, columns, counts_text, row_of, write_tables

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


def ticks(run: Run) -> Iterator[row_types.TickRow]:
    for tick in run.ticks:
        record = tick.record
        tip = next((n for n in record.nodes if n.path == record.tip), None)
        began = sum(1 for t in record.transitions if t.status == "RUNNING")
        yield row_types.TickRow(
            tick=tick.number,
            time=tick.time,
            root_status=record.root_status,
            tip=record.tip,
            tip_id=tip.id if tip else "",
            tip_message=tip.message if tip else "",
            running=sum(1 for n in record.nodes if n.status == "RUNNING"),
            began=began,
            ended=len(record.transitions) - began,
            writes=len(record.writes),
        )


def visits(run: Run) -> Iterator[row_types.VisitRow]:
    for v in run.visits:
        yield row_of(
            row_types.VisitRow, v, visit=v.number, first_tick=v.first, last_tick=v.last,
            inputs=_json(v.inputs), evidence=_json(v.evidence),
        )  # fmt: skip


def plans(run: Run) -> Iterator[row_types.PlanRow]:
    for at in run.plans:
        plan = at.record
        yield row_of(
            row_types.PlanRow,
            plan,
            time=at.time,
            waypoints=len(plan.path),
            tool_length=sum(map(math.dist, plan.tool_path, plan.tool_path[1:])),
            path=_json(plan.path),
            tool_path=_json(plan.tool_path),
        )


def candidates(run: Run) -> Iterator[row_types.CandidateRow]:
    for at in run.candidates:
        for c in at.record.tried:
            yield row_types.CandidateRow(
                at.time, at.record.purpose, at.record.object, c.name, c.verdict, c.score,
                c.place, c.stage, c.by, c.gap, c.count,
                *c.position, *c.orientation,
            )  # fmt: skip


def picks(run: Run) -> Iterator[Any]:
    for at in run.events:
        if isinstance(at.record, event_types.PickEvent):
            yield row_of(row_types.PickRow, at.record, time=at.time)


def failures(run: Run) -> Iterator[row_types.FailureRow]:
    for f in run.failures:
        handlers = _json([handling.handler for handling in f.handled_by])
        yield row_of(row_types.FailureRow, f, failure=f.number, handlers=handlers, evidence=_json(f.evidence))


def items(run: Run) -> Iterator[row_types.ItemRow]:
    done = {
        at.record.object: at.time for at in run.events if isinstance(at.record, event_types.ItemDoneEvent)
    }
    for story in run.explanation.items:
        picked = [pick for pick in run.picks if pick.object == story.id]
        yield row_of(
            row_types.ItemRow,
            story,
            item=story.id,
            picks=len(picked),
            held=sum(1 for pick in picked if pick.held),
            failures=sum(1 for failure in run.failures if failure.item == story.id),
            first_seen=_first_event_time(story),
            done=done.get(story.id),
        )


def events(run: Run) -> Iterator[row_types.EventRow]:
    for at in run.events:
        event = at.record
        yield row_types.EventRow(at.time, event.kind, event.message, event.node, _json(event.data))


def objects(run: Run) -> Iterator[row_types.ObjectRow]:
    for at in run.log.beliefs():
        yield from (_object(at.time, "belief", body) for body in at.record.bodies)
    for at in run.log.truths():
        yield from (_object(at.time, "truth", body) for body in at.record.bodies)


def joints(run: Run) -> Iterator[row_types.JointRow]:
    for at in run.log.joints():
        read = at.record
        for name, position, velocity, effort in zip(
            read.names, read.position, read.velocity, read.effort, strict=True
        ):
            yield row_types.JointRow(at.time, name, position, velocity, effort)


def wrenches(run: Run) -> Iterator[row_types.WrenchRow]:
    for at in run.log.wrenches():
        force, torque = at.record.force, at.record.torque
        yield row_types.WrenchRow(at.time, force.x, force.y, force.z, torque.x, torque.y, torque.z)


def controls(run: Run) -> Iterator[row_types.ControlRow]:
    for at in run.log.controls():
        told = at.record
        for k, joint in enumerate(run.joints.names[: run.controls.references.shape[1]]):
            reference = told.reference[k] if told.reference else None
            yield row_types.ControlRow(
                at.time, told.controller, joint, reference, told.error[k] if told.error else None
            )


def timings(run: Run) -> Iterator[row_types.TimingRow]:
    for at in run.log.timings():
        yield row_of(row_types.TimingRow, at.record, time=at.time)


def _object(time: float, source: str, body: log_records.BodyRecord) -> row_types.ObjectRow:
    return row_types.ObjectRow(
        time, source, body.id, body.kind, body.colour, body.place, body.attached, body.confidence,
        *body.pose.position, *body.pose.orientation,
    )  # fmt: skip


def _first_event_time(story: ItemStory) -> float | None:
    return min((event.time for event in story.events), default=None)


def _json(value: Mapping[str, object] | object) -> str:
    return orjson.dumps(value, option=orjson.OPT_NON_STR_KEYS).decode()


TABLES: tuple[TableSpec[Any], ...] = (
    TableSpec(
        "run",
        "a word of the run: what it was started with, and what came of it",
        row_types.RunRow,
        row_types.run_rows,
    ),
    TableSpec("ticks", "a tick of the tree", row_types.TickRow, ticks),
    TableSpec(
        "visits",
        "an activation of a node, from its beginning to its end",
        row_types.VisitRow,
        visits,
    ),
    TableSpec("failures", "a failure with a cause, and what became of it", row_types.FailureRow, failures),
    TableSpec("items", "an item, as the robot believed", row_types.ItemRow, items),
    TableSpec("picks", "a closing of the fingers on an object", row_types.PickRow, picks),
    TableSpec("plans", "a request to the planner, and its answer", row_types.PlanRow, plans),
    TableSpec("candidates", "a candidate of a choice that was tried", row_types.CandidateRow, candidates),
    TableSpec("events", "something worth a line", row_types.EventRow, events),
    TableSpec(
        "objects",
        "an object, each second and whenever the belief changed",
        row_types.ObjectRow,
        objects,
    ),
    TableSpec("joints", "a joint at a tick", row_types.JointRow, joints),
    TableSpec("wrenches", "the wrist at a tick", row_types.WrenchRow, wrenches),
    TableSpec("controls", "a joint of the arm at a tick, as commanded", row_types.ControlRow, controls),
    TableSpec("timings", "a tick by the wall clock", row_types.TimingRow, timings),
)
"""Tables in the order of interest for a reader."""


Form: TypeAlias = Literal["csv", "parquet", "rerun"]


@dataclass(frozen=True, slots=True)
class Exported:
    """Written files. `rows` is the number of rows by file, only for tables."""

    form: Form
    output: Path
    rows: Mapping[Path, int]
    notes: tuple[str, ...] = ()
    """Sentences about data that the log lacks."""

    def to_text(self) -> str:
        lines = [f"note: {note}" for note in self.notes]
        if self.form == "rerun":
            return "\n".join([*lines, str(self.output)])
        return "\n".join([*lines, counts_text(self.rows, 7)])

    def to_json(self) -> dict[str, Plain]:
        return {
            "to": self.form,
            "output": str(self.output.absolute()),
            "tables": {path.stem: count for path, count in self.rows.items()},
            "notes": list(self.notes),
        }


def export(run: Run, form: Form, output: Path) -> Exported:
    """Write the run to `output`: a folder for tables, a file for Rerun.

    Raises PicktreeError when it cannot be written or a library is missing; no partial file remains.
    """
    notes = tuple(_notes(run))
    if form == "rerun":
        with optional_import("rerun", "rerun", "An export to Rerun"):
            from .rerun_recording import write_rerun
        with file_system.whole([output], output) as (beside,):
            write_rerun(run, beside)
        return Exported(form, output, {}, notes)
    counts = write_tables(form, output, TABLES, lambda table: map(cells, table.rows(run)))
    return Exported(form, output, counts, notes)


def _notes(run: Run) -> Iterator[str]:
    if run.recovered:
        yield run.recovered
    if run.log.format < 2:
        yield "a log of format 1 has no transitions: what nodes did and how they failed is told in part"
