"""From what the floors below note to the records that a log keeps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Protocol

from ...simulation.scoring.truth import TrueBody as SimulatedBody
from ...world.belief.planning_scene import BeliefChange, BeliefObject
from ...world.journal import CandidateSearchEntry, PlanEntry
from ...world.shapes import ConvexMesh, Shape
from ...world.values import ObjectId, Pose
from ..schema.records import BlockRecord, BodyRecord, Candidate, Candidates, Event, Plan, StageCount


class SpawnedBody(Protocol):
    """What the simulation says of a body that it spawned."""

    @property
    def id(self) -> ObjectId | str: ...
    @property
    def kind(self) -> str: ...
    @property
    def form(self) -> str: ...
    @property
    def colour(self) -> str: ...
    @property
    def shape(self) -> Shape: ...
    @property
    def pose(self) -> Pose: ...
    @property
    def role(self) -> str: ...


def belief_record(o: BeliefObject) -> BodyRecord:
    """What the planning scene has there."""
    return BodyRecord(
        id=o.id,
        kind=o.kind,
        form=o.form,
        colour=o.colour,
        shape=_portable(o.shape),
        pose=o.pose,
        role=o.role,
        place=o.place,
        attached=o.attached,
        confidence=o.confidence,
        sigma_position=o.sigma_position,
        sigma_angle=o.sigma_angle,
        last_seen=o.last_seen,
        blocks=tuple(BlockRecord(block.size, block.at) for block in o.blocks),
    )


def truth_record(body: SpawnedBody) -> BodyRecord:
    """What the simulation has there."""
    shape = _portable(body.shape)
    seat = body.seat if isinstance(body, SimulatedBody) else None
    return BodyRecord(body.id, body.kind, body.form, body.colour, shape, body.pose, body.role, seat=seat)


def changed(change: BeliefChange) -> Event:
    """A change of the belief, with what was believed before and after."""
    known = change.after or change.before
    subject = "" if known is None else str(known.id)
    return Event(
        "belief",
        f"{subject}: {change.reason}",
        "",
        {
            "version": change.version,
            "object": subject,
            "reason": change.reason,
            "before": None if change.before is None else belief_record(change.before),
            "after": None if change.after is None else belief_record(change.after),
        },
    )


def plan_record(made: PlanEntry) -> Plan:
    """A request to the planner and its answer."""
    return Plan(
        made.request,
        made.planner,
        made.checks,
        made.thinking,
        made.outcome,
        made.message,
        made.duration,
        made.path,
        made.tool_path,
        made.start,
        made.version,
        made.length,
        made.way,
        made.singular,
    )


def candidates_record(choice: CandidateSearchEntry) -> Candidates:
    """The trail of a choice."""
    return Candidates(
        choice.purpose,
        choice.object,
        tuple(StageCount(name, count) for name, count in choice.stages.items()),
        tuple(
            Candidate(
                c.name,
                c.pose.position,
                c.pose.orientation,
                c.score,
                c.verdict,
                c.place,
                c.stage,
                c.by,
                c.gap,
                c.count,
            )
            for c in choice.tried
        ),
        choice.into,
    )


def _portable(shape: Shape) -> Shape:
    """The same shape on every machine: of the file of a mesh only the name."""
    return replace(shape, source=Path(shape.source).name) if isinstance(shape, ConvexMesh) else shape
