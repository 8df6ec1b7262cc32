"""Rows of each table, made from a run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict

import orjson

from ...logs.schema.records import BodyRecord
from ...world.events.skill_events import ItemDoneEvent, PickEvent
from ..explain.investigation.explanation import ItemStory
from ..run import Run
from . import row_types
from .table_files import row_of


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


def picks(run: Run) -> Iterator[row_types.PickRow]:
    for at in run.events:
        if isinstance(at.record, PickEvent):
            pick = at.record
            yield row_types.PickRow(
                time=at.time,
                object=pick.object,
                held=pick.held,
                node=pick.node,
                form=pick.form,
                candidate=pick.candidate,
                first_try=pick.first_try,
                width=pick.width,
                load=pick.load,
            )


def failures(run: Run) -> Iterator[row_types.FailureRow]:
    for f in run.failures:
        handlers = _json([handling.handler for handling in f.handled_by])
        yield row_of(row_types.FailureRow, f, failure=f.number, handlers=handlers, evidence=_json(f.evidence))


def items(run: Run) -> Iterator[row_types.ItemRow]:
    done = {at.record.object: at.time for at in run.events if isinstance(at.record, ItemDoneEvent)}
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


def run_rows(run: Run) -> Iterator[row_types.RunRow]:
    """Yield the settings of the run and its result."""
    told = asdict(run.info)
    groups = {"parameter": "parameters", "physics": "physics", "version": "versions"}
    for key, value in told.items():
        if key not in groups.values():
            yield row_types.RunRow(key, str(value))
    for prefix, group in groups.items():
        for key, value in told[group].items():
            yield row_types.RunRow(f"{prefix}.{key}", str(value))
    yield row_types.RunRow("format", str(run.log.format))
    yield row_types.RunRow("end", repr(run.end))
    yield row_types.RunRow("recovered", run.recovered)
    yield row_types.RunRow("status", "killed" if run.result is None else run.result.status)
    if run.result is not None:
        yield row_types.RunRow("message", run.result.message)
        yield row_types.RunRow("items.total", str(run.result.items.total))
        yield row_types.RunRow("items.sorted", str(run.result.items.sorted))
        yield row_types.RunRow("digest", run.result.digest)


def _object(time: float, source: str, body: BodyRecord) -> row_types.ObjectRow:
    return row_types.ObjectRow(
        time, source, body.id, body.kind, body.colour, body.place, body.attached, body.confidence,
        *body.pose.position, *body.pose.orientation,
    )  # fmt: skip


def _first_event_time(story: ItemStory) -> float | None:
    return min((event.time for event in story.events), default=None)


def _json(value: Mapping[str, object] | object) -> str:
    return orjson.dumps(value, option=orjson.OPT_NON_STR_KEYS).decode()
