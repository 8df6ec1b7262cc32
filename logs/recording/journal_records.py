"""Conversion of journal entries, bodies, joints, fixtures and settings into records of the log, and of ticks
into messages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from picktree.logs import BeliefEvent, log_records
from picktree.simulation import TrueBody, TrueObstacle
from picktree.world import (
    BeliefChange,
    BeliefObject,
    ConvexMesh,
    GripperState,
    JointState,
    NodeState,
    Shape,
    greatest_length,
)
from picktree.world.scene import Bin, Fixture, tile_body

TILE_THICKNESS = 0.001
"""Thickness of the tiles of a calibration target in pictures, m."""


def belief_record(o: BeliefObject, *, measured: bool = False) -> log_records.BodyRecord:
    """Return the record of a body of the planning scene. `measured`: rules ask for measures of items."""
    record = log_records.BodyRecord(
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
        blocks=tuple(log_records.BlockRecord(block.size, block.at) for block in o.blocks),
    )
    if o.role == "item" and (measured or o.kind == "unknown"):
        return log_records.ThingRecord(**vars(record), mass=o.mass, size=o.size, tag=o.tag)
    return record


def truth_record(body: TrueBody | TrueObstacle, *, measured: bool = False) -> log_records.BodyRecord:
    """Return the record of a body of the simulation, with its seating when it is at a hole. `measured`: rules
    ask for measures of items."""
    shape = _portable(body.shape)
    seat = body.seat if isinstance(body, TrueBody) else None
    record = log_records.BodyRecord(
        body.kind, body.form, shape, body.colour, body.pose, role=body.role, id=body.id, seat=seat
    )
    if isinstance(body, TrueBody) and (measured or body.kind == "unknown"):
        return log_records.ThingRecord(
            **vars(record), mass=body.mass, size=greatest_length(body.shape), tag=body.tag
        )
    return record


def belief_event(change: BeliefChange) -> BeliefEvent:
    """Return the event of a change of the belief, with the object before and after it."""
    known = change.after or change.before
    subject = "" if known is None else str(known.id)
    return BeliefEvent(
        f"{subject}: {change.reason}",
        version=change.version,
        object=subject,
        reason=change.reason,
        before=None if change.before is None else belief_record(change.before),
        after=None if change.after is None else belief_record(change.after),
    )


def joints_record(
    names: Sequence[str],
    state: JointState,
    fingers: Sequence[str],
    gripper: GripperState | None,
    fingers_at: Sequence[float],
) -> log_records.Joints:
    """Return the record of the joints of arm and fingers, without fingers when `gripper` is None.

    Fingers are at `fingers_at`, or each at half of the gripper's width when that is empty.
    """
    position, velocity, effort = (a.tolist() for a in (state.position, state.velocity, state.effort))
    if gripper is not None:
        position += fingers_at or [gripper.width / 2] * len(fingers)
        for _ in fingers:
            velocity.append(gripper.speed)
            effort.append(gripper.force)
        names = (*names, *fingers)
    return log_records.Joints(tuple(names), tuple(position), tuple(velocity), tuple(effort))


def failure_origins(failing: Sequence[NodeState]) -> list[NodeState]:
    """Return the failing nodes without a failing node below: the origins of the failure."""
    return [n for n in failing if not any(other.path.startswith(n.path + "/") for other in failing)]


def bin_parts(bins: Iterable[Bin]) -> Iterator[log_records.PartRecord]:
    """Yield the walls and the floor of each bin."""
    for each in bins:
        for k, (box, pose) in enumerate(each.parts()):
            yield log_records.PartRecord(f"{each.id}/{k}", each.colour, box, pose)


def fixture_parts(fixtures: Iterable[Fixture]) -> Iterator[log_records.PartRecord]:
    """Yield each fixture, and the tiles of its calibration target."""
    for fixture in fixtures:
        yield log_records.PartRecord(fixture.id, fixture.colour, fixture.shape, fixture.pose, fixture.holes)
        for tile in fixture.tiles:
            box, inner = tile_body(tile, TILE_THICKNESS)
            yield log_records.PartRecord(
                f"{fixture.id}/{tile.colour}", tile.colour, box, fixture.pose @ inner
            )


def run_metadata(run: log_records.RunInfo) -> dict[str, str]:
    """Return the run's settings as text, for the metadata record `picktree`."""
    return {
        "format": str(log_records.FORMAT),
        "mission": run.mission,
        "scene": run.scene,
        "robot": run.robot,
        "seed": str(run.seed),
        "backend": run.backend,
        "tick": repr(run.tick),
        "revision": run.revision,
        "verify": str(run.verify).lower(),
        **({} if run.limit is None else {"limit": repr(run.limit)}),
        "own_scene": str(run.own_scene).lower(),
        **({"variant": run.variant.words()} if run.variant else {}),
        **({"nominal": "\n".join(run.nominal)} if run.nominal else {}),
    }


def _portable(shape: Shape) -> Shape:
    """Return the shape without machine-dependent parts: a mesh keeps only its file's name."""
    return replace(shape, source=Path(shape.source).name) if isinstance(shape, ConvexMesh) else shape
