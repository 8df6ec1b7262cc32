"""Motion in a run, tick by tick: frames of links and cameras, believed bodies, true bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....logs.schema.records import BodyRecord
from ....world.events.run_events import FaultEvent
from ....world.values import Array
from ...run import Run
from .poses import row

Flags = NDArray[np.bool_]
Span = tuple[int, int]
"""First and last tick, both inclusive."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Poses of all frames of `/tf` in the world at each tick, (n, 7); NaN where a frame is missing."""

    tracks: Mapping[str, Array]
    ticks: int

    def track(self, name: str) -> Array:
        found = self.tracks.get(name)
        return np.full((self.ticks, 7), np.nan) if found is None else found


@dataclass(frozen=True, slots=True, eq=False)
class BodyAppearance:
    """Believed shape, colour and role of a body from one tick on."""

    tick: int
    body: BodyRecord


@dataclass(frozen=True, slots=True, eq=False)
class BelievedBody:
    """Body of the belief over the run."""

    id: str
    track: Array
    """Poses in the world, (n, 7); NaN where it is not in the belief."""
    held: Flags
    looks: tuple[BodyAppearance, ...]

    @property
    def present(self) -> Flags:
        return ~np.isnan(self.track[:, 0])


@dataclass(frozen=True, slots=True, eq=False)
class TrueBodySamples:
    """True body at the times of the logged ground truth."""

    body: BodyRecord
    ticks: NDArray[np.int64]
    poses: Array
    """Poses in the world, (samples, 7)."""


def frames_of(run: Run) -> Frames:
    number = {time: k for k, time in enumerate(run.ticks.times)}
    tracks: dict[str, Array] = {}
    for at in run.log.transforms():
        tick = number.get(at.time)
        if tick is None:
            continue
        for transform in at.record:
            track = tracks.get(transform.child)
            if track is None:
                track = tracks[transform.child] = np.full((len(number), 7), np.nan)
            track[tick] = row(transform.pose)
    return Frames(tracks, len(number))


def believed_of(run: Run, frames: Frames) -> list[BelievedBody]:
    """Return the believed bodies in the order in which they entered the belief."""
    ticks = len(run.ticks)
    looks: dict[str, list[BodyAppearance]] = {}
    held: dict[str, Flags] = {}
    for at in run.log.beliefs():
        tick = run.ticks.number_at(at.time)
        for flags in held.values():
            flags[tick:] = False
        for body in at.record.bodies:
            seen = looks.setdefault(body.id, [])
            if not seen or _differs(seen[-1].body, body):
                seen.append(BodyAppearance(tick, body))
            held.setdefault(body.id, np.zeros(ticks, dtype=np.bool_))[tick:] = body.attached
    return [BelievedBody(name, frames.track(name), held[name], tuple(found)) for name, found in looks.items()]


def truths_of(run: Run) -> list[TrueBodySamples]:
    """Return the true bodies, each up to the tick at which a fault removed it."""
    bodies: dict[str, BodyRecord] = {}
    found: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
    taken = _removal_ticks(run)
    for at in run.log.truths():
        tick = run.ticks.number_at(at.time)
        for body in at.record.bodies:
            if tick > taken.get(body.id, tick):
                continue
            bodies[body.id] = body
            samples = found.setdefault(body.id, [])
            if samples and samples[-1][0] == tick:
                samples.pop()
            samples.append((tick, row(body.pose)))
    for name, tick in taken.items():
        if name in found and found[name][-1][0] < tick:
            found[name].append((tick, found[name][-1][1]))
    return [
        TrueBodySamples(
            bodies[name], np.array([tick for tick, _ in samples]), np.array([pose for _, pose in samples])
        )
        for name, samples in found.items()
    ]


def _removal_ticks(run: Run) -> dict[str, int]:
    """Return the tick of the removal by a fault, by the true body's id."""
    taken: dict[str, int] = {}
    for at in run.events:
        fault = at.record
        if isinstance(fault, FaultEvent) and (fault.fault == "remove" or fault.gone):
            taken[fault.item or fault.obstacle or ""] = run.ticks.number_at(at.time)
    return taken


def spans(flags: Flags) -> list[Span]:
    """Return the spans in which the flags are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(first), int(after) - 1) for first, after in zip(edges[::2], edges[1::2], strict=True)]


def _differs(a: BodyRecord, b: BodyRecord) -> bool:
    return _appearance_key(a) != _appearance_key(b)


def _appearance_key(body: BodyRecord) -> tuple[object, ...]:
    return body.shape, body.colour, body.kind, body.role, body.place, body.blocks
