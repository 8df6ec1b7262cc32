"""Where things were over a run: as the robot believed, and as they truly were, for the analyst only."""

from __future__ import annotations

import bisect
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ....logs.run_log import Stamped
from ....logs.schema.records import BodyRecord, Scene

NEAR = 0.08
"""Greatest distance between a detection and the true item that it can be, m."""
OTHER_KIND = 0.03
"""Distance that a difference in kind is worth, m: it may have been misjudged."""


@dataclass(frozen=True, slots=True)
class BodyTrack:
    """One body over time. `times` are those of the messages that had it, s."""

    id: str
    times: tuple[float, ...]
    bodies: tuple[BodyRecord, ...]

    @property
    def first(self) -> BodyRecord:
        return self.bodies[0]

    @property
    def last_speed(self) -> float:
        """Between the last two messages, m/s; 0 when there is only one."""
        if len(self.times) < 2:
            return 0.0
        way = math.dist(self.bodies[-1].pose.position, self.bodies[-2].pose.position)
        return way / max(self.times[-1] - self.times[-2], 1e-3)

    def before(self, time: float) -> BodyRecord | None:
        """As of the last message at `time` or before that had it."""
        number = bisect.bisect_right(self.times, time + 1e-6)
        return self.bodies[number - 1] if number else None

    def after(self, time: float) -> BodyRecord | None:
        """As of the first message at `time` or after that had it."""
        number = bisect.bisect_left(self.times, time - 1e-6)
        return self.bodies[number] if number < len(self.bodies) else None


class BodyTracks:
    """All bodies of one topic, or those of one role."""

    def __init__(self, scenes: Sequence[Stamped[Scene]], role: str | None = None) -> None:
        self.times = tuple(at.time for at in scenes)
        collected: dict[str, list[tuple[float, BodyRecord]]] = defaultdict(list)
        for at in scenes:
            for body in at.record.bodies:
                if role in (None, body.role):
                    collected[body.id].append((at.time, body))
        self.tracks: Mapping[str, BodyTrack] = {
            id_: BodyTrack(id_, tuple(t for t, _ in found), tuple(b for _, b in found))
            for id_, found in collected.items()
        }

    def at(self, id_: str, time: float) -> BodyRecord | None:
        """The body as of the last message at `time` or before; None when that did not have it."""
        track = self.tracks.get(id_)
        number = bisect.bisect_right(self.times, time + 1e-6)
        if track is None or number == 0:
            return None
        last = self.times[number - 1]
        found = bisect.bisect_left(track.times, last - 1e-6)
        return track.bodies[found] if found < len(track.times) and track.times[found] <= last + 1e-6 else None

    def gone(self, id_: str) -> tuple[float, float] | None:
        """Between which times a body vanished for good, s; None when it is there at the end."""
        track = self.tracks.get(id_)
        if track is None or not self.times or track.times[-1] >= self.times[-1] - 1e-6:
            return None
        return track.times[-1], next(t for t in self.times if t > track.times[-1] + 1e-6)


def horizontal_distance(a: BodyRecord, b: BodyRecord) -> float:
    """Horizontal distance of two bodies' centres, m."""
    return math.dist(a.pose.position[:2], b.pose.position[:2])


def paired(belief: BodyTracks, truth: BodyTracks) -> Mapping[str, str]:
    """Return the id of the true item by that of the believed one.

    Judged where it was first seen: a true item near that place, of its colour if there is one.
    """
    pairs: dict[str, str] = {}
    for track in belief.tracks.values():
        if track.first.role != "item":
            continue
        here = [(_unlike(track.first, body), id_) for id_, body in _there(truth, track.times[0])]
        cost, found = min(here, default=(math.inf, ""))
        if cost < NEAR:
            pairs[track.id] = found
    return pairs


def _there(truth: BodyTracks, time: float) -> list[tuple[str, BodyRecord]]:
    found = [(id_, truth.at(id_, time)) for id_ in truth.tracks]
    return [(id_, body) for id_, body in found if body is not None]


def _unlike(seen: BodyRecord, true: BodyRecord) -> float:
    distance = math.dist(seen.pose.position, true.pose.position)
    if seen.colour != true.colour:
        return math.inf if distance > NEAR / 4 else distance + 2 * OTHER_KIND
    return distance + (OTHER_KIND if seen.kind != true.kind else 0.0)
