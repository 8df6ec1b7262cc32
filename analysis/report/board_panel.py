"""Blackboard panel: values of the blackboard and of the belief at each moment."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import orjson

from picktree.analysis import Run
from picktree.logs import log_records
from picktree.world import Pose

from .body_motion import BeliefDeviation, SceneMotion, deviations, motion_of
from .packing import Packable, Section, StringTable, quantise
from .tick_table import TickTable, tick_table

_MIN_POSITION_CHANGE: Final = 2e-4
"""Smallest change of a believed position that counts, m."""


@dataclass(frozen=True, slots=True)
class BeliefSighting:
    """Believed object from a moment on; `body` is None when it has left the belief."""

    time: float
    id: str
    body: log_records.BodyRecord | None


def pack_board(run: Run) -> Section:
    table = tick_table(run)
    seen = sightings(run)
    if not table.writes and not seen:
        return Section("board", {"empty": "The log holds neither a blackboard nor a belief."})
    return Section(
        "board", {"writes": _writes(table), "belief": _belief(seen), "truth": _truth(motion_of(run))}
    )


def sightings(run: Run) -> tuple[BeliefSighting, ...]:
    """Return every change of a believed item, in order of time."""
    found: list[BeliefSighting] = []
    present: dict[str, log_records.BodyRecord] = {}
    for at in run.log.beliefs():
        now = {body.id: body for body in at.record.bodies}
        for name in [name for name in present if name not in now]:
            del present[name]
            found.append(BeliefSighting(at.time, name, None))
        for name, body in now.items():
            before = present.get(name)
            if before is None or _differs(before, body):
                present[name] = body
                found.append(BeliefSighting(at.time, name, body))
    return tuple(found)


def _differs(before: log_records.BodyRecord, after: log_records.BodyRecord) -> bool:
    moved = math.dist(before.pose.position, after.pose.position) > _MIN_POSITION_CHANGE
    turned = before.pose.orientation != after.pose.orientation and before.pose.angle(after.pose) > 0.005
    return moved or turned or any(
        getattr(before, name) != getattr(after, name)
        for name in ("kind", "colour", "role", "place", "attached", "confidence", "last_seen")
    )  # fmt: skip


def yaw_and_tilt(pose: Pose) -> tuple[float, float]:
    """Return the rotation about the vertical, and the angle of the object's own z axis from the vertical;
    rad."""
    x, y, z, w = pose.orientation
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return yaw, math.acos(max(-1.0, min(1.0, 1 - 2 * (x * x + y * y))))


def _writes(table: TickTable) -> Packable:
    words = StringTable()
    return {
        "tick": np.array([written.tick for written in table.writes], dtype=np.uint32),
        "key": words.numbers([written.write.key for written in table.writes]),
        "value": words.numbers([orjson.dumps(written.write.value).decode() for written in table.writes]),
        "node": words.numbers([written.write.node for written in table.writes]),
        "words": list(words.texts),
    }


def _belief(seen: Sequence[BeliefSighting]) -> Packable:
    """Pack the belief by column: positions in m, angles in rad, NaN for an object that has left the
    belief."""
    words = StringTable()
    bodies = [sighting.body for sighting in seen]
    nothing = (math.nan,) * 7
    numbers = np.array([nothing if body is None else _numbers(body) for body in bodies]).reshape(len(seen), 7)
    steps = (1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-2, 1e-2)
    names = ("x", "y", "z", "yaw", "tilt", "confidence", "last_seen")
    texts = {
        name: words.numbers(["" if body is None else str(getattr(body, name)) for body in bodies])
        for name in ("kind", "colour", "role", "place")
    }
    return {
        "time": np.array([sighting.time for sighting in seen], dtype=np.float64),
        "object": words.numbers([sighting.id for sighting in seen]),
        "there": np.array([body is not None for body in bodies], dtype=np.uint8),
        "attached": np.array([body is not None and body.attached for body in bodies], dtype=np.uint8),
        **texts,
        **{name: quantise(numbers[:, k], steps[k]) for k, name in enumerate(names)},
        "words": list(words.texts),
    }


def _numbers(body: log_records.BodyRecord) -> tuple[float, ...]:
    return (*body.pose.position, *yaw_and_tilt(body.pose), body.confidence, body.last_seen)


def _truth(motion: SceneMotion) -> Packable:
    """Pack the distances between truth and belief, and the unknown bodies.

    `distance` is in mm by object, NaN for a believed object that no longer exists. `unknown` are true bodies
    without a believed one, at each change.
    """
    changes = sorted(deviations(motion), key=lambda one: one.tick)
    believed = [one for one in changes if one.object]
    words = StringTable()
    return {
        "tick": np.array([one.tick for one in believed], dtype=np.uint32),
        "object": words.numbers([one.object for one in believed]),
        "true": words.numbers([one.body.id for one in believed]),
        "distance": quantise(np.array([1000.0 * one.distance for one in believed]), 0.1),
        "gone": _removed_objects(motion),
        "unknown": [
            {"tick": tick, "bodies": list(bodies)} for tick, bodies in unknown_bodies(changes, motion)
        ],
        "words": list(words.texts),
    }


def _removed_objects(motion: SceneMotion) -> list[Packable]:
    """Return the objects that still are in the belief after a fault has removed them, with the tick of the
    removal."""
    last = max((int(truth.ticks[-1]) for truth in motion.truths), default=0)
    return [
        {"object": motion.believed[partner].id, "tick": int(truth.ticks[-1])}
        for truth, partner in zip(motion.truths, motion.partners, strict=True)
        if partner is not None and int(truth.ticks[-1]) < last
    ]


def unknown_bodies(
    changes: Sequence[BeliefDeviation], motion: SceneMotion
) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Yield the ticks at which the set of unknown true bodies changes, with the new set."""
    ends = {truth.body.id: int(truth.ticks[-1]) for truth in motion.truths}
    last = max(ends.values(), default=0)
    unknown: dict[str, str] = {}
    before: tuple[str, ...] = ()
    for tick, group in itertools.groupby(changes, key=lambda one: one.tick):
        for one in group:
            unknown.pop(one.body.id, None)
            gone = tick == ends[one.body.id] < last
            if not one.object and not gone:
                unknown[one.body.id] = f"{one.body.colour} {one.body.kind} ({one.body.id})"
        bodies = tuple(unknown[name] for name in sorted(unknown))
        if bodies != before:
            before = bodies
            yield tick, bodies
