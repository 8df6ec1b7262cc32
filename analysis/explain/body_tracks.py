"""Tracks of bodies over a run: believed ones, and true ones for the analyst only."""

from __future__ import annotations

import bisect
import itertools
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from picktree.logs import Stamped, log_records
from picktree.world import Vector3

R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class BodyTrack:
    """Track of one body over time. `times` are those of the messages that had it, s."""

    id: str
    times: tuple[float, ...]
    bodies: tuple[log_records.BodyRecord, ...]

    @property
    def first(self) -> log_records.BodyRecord:
        return self.bodies[0]

    @property
    def last(self) -> log_records.BodyRecord:
        return self.bodies[-1]

    @property
    def last_speed(self) -> float:
        """Speed between the last two messages, m/s; 0 when there is only one."""
        if len(self.times) < 2:
            return 0.0
        way = math.dist(self.bodies[-1].pose.position, self.bodies[-2].pose.position)
        return way / max(self.times[-1] - self.times[-2], 1e-3)

    def before(self, time: float) -> log_records.BodyRecord | None:
        """Return the body as of the last message at `time` or before that had it."""
        number = bisect.bisect_right(self.times, time + 1e-6)
        return self.bodies[number - 1] if number else None

    def after(self, time: float) -> log_records.BodyRecord | None:
        """Return the body as of the first message at `time` or after that had it."""
        number = bisect.bisect_left(self.times, time - 1e-6)
        return self.bodies[number] if number < len(self.bodies) else None

    def since(self, start: float, end: float = math.inf) -> Iterator[tuple[float, log_records.BodyRecord]]:
        """Yield the messages between two times, both inclusive, s."""
        first = bisect.bisect_left(self.times, start - 1e-6)
        for time, body in zip(self.times[first:], self.bodies[first:], strict=True):
            if time > end + 1e-6:
                return
            yield time, body


class BodyTracks:
    """All bodies of one topic, or those of one role."""

    def __init__(self, scenes: Sequence[Stamped[log_records.Scene]], role: str | None = None) -> None:
        self.times = tuple(at.time for at in scenes)
        self._scenes = scenes
        collected: dict[str, list[tuple[float, log_records.BodyRecord]]] = defaultdict(list)
        for at in scenes:
            for body in at.record.bodies:
                if role in (None, body.role):
                    collected[body.id].append((at.time, body))
        self.tracks: Mapping[str, BodyTrack] = {
            id_: BodyTrack(id_, tuple(t for t, _ in found), tuple(b for _, b in found))
            for id_, found in collected.items()
        }
        self._order = {id_: number for number, id_ in enumerate(self.tracks)}
        """Index of each body in order of its first appearance."""

    @property
    def spacing(self) -> float:
        """Longest interval between two messages without the last one, s: the precision of an event's time."""
        steps = [b - a for a, b in itertools.pairwise(self.times)]
        return max(steps, default=0.0) + 0.05

    def at(self, id_: str, time: float) -> log_records.BodyRecord | None:
        """Return the body in the last message at `time` or before; None when the message lacks it."""
        track = self.tracks.get(id_)
        number = bisect.bisect_right(self.times, time + 1e-6)
        if track is None or number == 0:
            return None
        last = self.times[number - 1]
        found = bisect.bisect_left(track.times, last - 1e-6)
        return track.bodies[found] if found < len(track.times) and track.times[found] <= last + 1e-6 else None

    def there(self, time: float) -> list[tuple[str, log_records.BodyRecord]]:
        """Return all bodies as of the last message at `time` or before."""
        number = bisect.bisect_right(self.times, time + 1e-6)
        if number == 0:
            return []
        first = bisect.bisect_left(self.times, self.times[number - 1] - 1e-6)
        ids = {body.id for at in self._scenes[first:number] for body in at.record.bodies}
        known = sorted(ids & self._order.keys(), key=self._order.__getitem__)
        found = ((id_, self.at(id_, time)) for id_ in known)
        return [(id_, body) for id_, body in found if body is not None]

    def about(self, time: float) -> list[tuple[str, log_records.BodyRecord]]:
        """Return all bodies as of `there`, and those that came between that message and the next one."""
        number = bisect.bisect_right(self.times, time + 1e-6)
        following = self.there(self.times[number]) if number < len(self.times) else []
        came = (self.tracks[id_] for id_, _ in following)
        return [*self.there(time), *((t.id, t.first) for t in came if t.times[0] > time + 1e-6)]

    def gone(self, id_: str) -> tuple[float, float] | None:
        """Return the times between which a body vanished for good, s; None when it is there at the end."""
        track = self.tracks.get(id_)
        if track is None or not self.times or track.times[-1] >= self.times[-1] - 1e-6:
            return None
        return track.times[-1], next(t for t in self.times if t > track.times[-1] + 1e-6)


def between(found: Sequence[Stamped[R]], start: float, end: float) -> list[Stamped[R]]:
    """Return the records of `found`, in order of time, between two times, both inclusive, s."""
    first = bisect.bisect_left(found, start - 1e-6, key=_time)
    return list(found[first : bisect.bisect_right(found, end + 1e-6, key=_time)])


def _time(at: Stamped[Any]) -> float:
    return at.time


def horizontal_distance(a: log_records.BodyRecord, b: log_records.BodyRecord) -> float:
    """Return the horizontal distance of two bodies' centres, m."""
    return math.dist(a.pose.position[:2], b.pose.position[:2])


def offset(seen: log_records.BodyRecord, true: log_records.BodyRecord) -> Vector3:
    """Return the vector from the believed centre to the true one, m."""
    (a, b, c), (x, y, z) = seen.pose.position, true.pose.position
    return (x - a, y - b, z - c)


@dataclass(frozen=True, slots=True)
class DeviceState:
    """True state of the items at one moment, as far as no sample of their places has it."""

    time: float
    masses: Mapping[str, float]
    """Masses of items that differ from the catalogue's, kg."""
    frictions: Mapping[str, float]
    """Frictions of items that differ from the catalogue's for good."""
    motions: Mapping[str, tuple[Vector3, Vector3]]
    """Velocity (m/s) and spin (rad/s) of each item; empty without physics."""
