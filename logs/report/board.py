"""What the blackboard and the belief held at each moment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import orjson

from ...world.values import Pose
from ..records import Body
from ..run import Run
from .packing import Packable, Section, quantised
from .tick_table import TickTable, tick_table
from .truths import TruthAt, truths_of
from .words import Words

_STILL: Final = 2e-4
"""A change of a believed position below this is none, m."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """An object as it is believed from a moment on; `body` is None when it is believed no more."""

    time: float
    id: str
    body: Body | None


def pack_board(run: Run) -> Section:
    table = tick_table(run)
    seen = sightings(run)
    truths = tuple(truths_of(run))
    if not table.writes and not seen:
        return Section("board", {"empty": "The log holds neither a blackboard nor a belief."})
    return Section("board", {"writes": _writes(table), "belief": _belief(seen), "truth": _truth(truths, run)})


def sightings(run: Run) -> tuple[Sighting, ...]:
    """Every change of the belief in an item, in the order of time."""
    found: list[Sighting] = []
    present: dict[str, Body] = {}
    for at in run.log.beliefs():
        now = {body.id: body for body in at.record.bodies}
        for name in [name for name in present if name not in now]:
            del present[name]
            found.append(Sighting(at.time, name, None))
        for name, body in now.items():
            before = present.get(name)
            if before is None or _differs(before, body):
                present[name] = body
                found.append(Sighting(at.time, name, body))
    return tuple(found)


def _differs(before: Body, after: Body) -> bool:
    moved = math.dist(before.pose.position, after.pose.position) > _STILL
    turned = before.pose.orientation != after.pose.orientation and _angle(before.pose, after.pose) > 0.005
    return moved or turned or any(
        getattr(before, name) != getattr(after, name)
        for name in ("kind", "colour", "role", "place", "attached", "confidence", "last_seen")
    )  # fmt: skip


def _angle(a: Pose, b: Pose) -> float:
    """Between two orientations, rad."""
    dot = abs(sum(p * q for p, q in zip(a.orientation, b.orientation, strict=True)))
    return 2.0 * math.acos(min(dot, 1.0))


def yaw_and_tilt(pose: Pose) -> tuple[float, float]:
    """About the vertical, and of the object's own z axis from it; rad."""
    x, y, z, w = pose.orientation
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return yaw, math.acos(max(-1.0, min(1.0, 1 - 2 * (x * x + y * y))))


def _writes(table: TickTable) -> Packable:
    words = Words()
    return {
        "tick": np.array([written.tick for written in table.writes], dtype=np.uint32),
        "key": words.numbers([written.write.key for written in table.writes]),
        "value": words.numbers([_json(written.write.value) for written in table.writes]),
        "node": words.numbers([written.write.node for written in table.writes]),
        "words": list(words.texts),
    }


def _json(value: object) -> str:
    return orjson.dumps(value).decode()


def _belief(seen: Sequence[Sighting]) -> Packable:
    """Column by column: positions in m, angles in rad, NaN for an object that is believed no more."""
    words = Words()
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
        **{name: quantised(numbers[:, k], steps[k]) for k, name in enumerate(names)},
        "words": list(words.texts),
    }


def _numbers(body: Body) -> tuple[float, ...]:
    return (*body.pose.position, *yaw_and_tilt(body.pose), body.confidence, body.last_seen)


def _truth(truths: Sequence[TruthAt], run: Run) -> Packable:
    words = Words()
    rows = [(at.time, deviation) for at in truths for deviation in at.deviations]
    return {
        "time": np.array([time for time, _ in rows], dtype=np.float64),
        "object": words.numbers([deviation.object for _, deviation in rows]),
        "true": words.numbers([deviation.true for _, deviation in rows]),
        "distance": quantised(np.array([1000.0 * deviation.distance for _, deviation in rows]), 0.1),
        "unknown": [
            {"time": at.time, "bodies": [f"{body.colour} {body.kind} {body.id}" for body in at.unknown]}
            for at in _changes(truths)
        ],
        "times": np.array([at.time for at in truths], dtype=np.float64),
        "words": list(words.texts),
    }


def _changes(truths: Sequence[TruthAt]) -> Iterator[TruthAt]:
    """Those at which other bodies are unknown to the robot than before."""
    before: tuple[str, ...] | None = None
    for at in truths:
        names = tuple(body.id for body in at.unknown)
        if names != before:
            before = names
            yield at
