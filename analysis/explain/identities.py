"""Identities of believed items: their true items at each look, phantoms and second names included."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from picktree.logs import log_records
from picktree.world import extents

from .body_tracks import BodyTracks, horizontal_distance, offset

MATCH_RANGE = 0.08
"""Greatest distance between a detection and the true item that it can be, m."""
OTHER_COLOUR_RANGE = 0.03
"""Greatest distance between a detection and a true item of another colour, m."""
COLOUR_COST, KIND_COST = 0.05, 0.02
"""Costs of a difference in colour and in kind, m: both may be misjudged."""
MAX_AGE = 0.16
"""Maximum age of a belief that shows the item as the camera saw it, s: perception takes up to three ticks."""
MAX_SCATTER = 0.35
"""Maximum scatter of offsets with one origin, as a share of their mean."""
MIN_COMMON = 0.006
"""Least offset that counts as common, m."""
NO_MATCH_COST = 10.0
UNSEEN_RANGE = 0.15
"""Greatest distance for an item that no camera saw at its believed place, m: held (mean) or placed."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """Believed item as a camera just saw it."""

    time: float
    item: str
    seen: log_records.BodyRecord
    true: str = ""
    """Id of the true item; empty without a similar item there, or when another name has it."""
    body: log_records.BodyRecord | None = None
    near: str = ""
    """Nearest true item at this place, of any name."""

    @property
    def off(self) -> tuple[float, float]:
        """Horizontal offset from the believed place to the true one, m; 0 without a true item."""
        if self.body is None:
            return (0.0, 0.0)
        return offset(self.seen, self.body)[:2]


class Identities:
    """Names of true items over the looks of a run.

    `names`: item of each believed one; None: it is the true one that lay where the believed one was seen.
    """

    def __init__(self, belief: BodyTracks, truth: BodyTracks, names: Mapping[str, str] | None = None) -> None:
        self._belief, self._truth, self._names = belief, truth, names

    @cached_property
    def sightings(self) -> Sequence[Sighting]:
        """All sightings in order of time, each look assigned one to one."""
        looks: dict[float, list[tuple[str, log_records.BodyRecord]]] = {}
        for track in self._belief.tracks.values():
            last = -math.inf
            for time, body in zip(track.times, track.bodies, strict=True):
                if body.role != "item" or body.attached or body.last_seen <= last + 1e-6:
                    continue
                last = body.last_seen
                if time - body.last_seen < MAX_AGE:
                    looks.setdefault(round(body.last_seen, 3), []).append((track.id, body))
        return [each for time in sorted(looks) for each in self._assigned(time, looks[time])]

    def _assigned(self, time: float, seen: list[tuple[str, log_records.BodyRecord]]) -> Iterator[Sighting]:
        true = self._truth.about(time)
        common = common_offset(seen, true)
        pairs = _matched(seen, true, common)
        for number, (item, body) in enumerate(seen):
            near = _touching(body, true, common)
            if number in pairs:
                name, other = true[pairs[number]]
                yield Sighting(time, item, body, name, other, near)
            else:
                yield Sighting(time, item, body, near=near)

    @cached_property
    def by_item(self) -> Mapping[str, tuple[Sighting, ...]]:
        """Sightings of each believed item."""
        found: dict[str, list[Sighting]] = {}
        for each in self.sightings:
            found.setdefault(each.item, []).append(each)
        return {item: tuple(each) for item, each in found.items()}

    @cached_property
    def pairs(self) -> Mapping[str, str]:
        """True item of each believed one: that of most of its sightings, the first of equals."""
        if self._names is not None:
            return self._names
        found: dict[str, str] = {}
        for item, sightings in self.by_item.items():
            counts = Counter(each.true for each in sightings if each.true)
            if counts:
                found[item] = counts.most_common(1)[0][0]
            elif near := [each.near for each in sightings if each.near]:
                found[item] = near[0]  # a second name of what another one is
        found |= self._seen_before(found)
        lifted = {
            id_: true for id_ in self._belief.tracks if id_ not in found and (true := self._carried(id_))
        }
        return {**found, **lifted}

    def _seen_before(self, found: Mapping[str, str]) -> Mapping[str, str]:
        """Return the true items of believed ones that were last seen before the log began, by place.

        The log is a later file of a rotated one, or that of a run which was taken up.
        """
        if not self._belief.times:
            return {}
        start = self._belief.times[0]
        seen = [
            (id_, body)
            for id_, body in self._belief.there(start)
            if id_ not in found and body.role == "item" and not body.attached and id_ not in self.by_item
        ]
        taken = set(found.values())
        true = [(name, body) for name, body in self._truth.about(start) if name not in taken]
        pairs = _matched(seen, true, (0.0, 0.0), UNSEEN_RANGE)
        return {seen[number][0]: true[other][0] for number, other in pairs.items()}

    def _carried(self, item: str) -> str:
        """Return the true item that moved along with a thing of a heap, which no camera saw before the lift.

        Empty: none did.
        """
        track = self._belief.tracks[item]
        if track.first.role != "item" or not track.first.attached:
            return ""
        away: dict[str, list[float]] = {}
        held = itertools.takewhile(lambda at: at[1].attached, zip(track.times, track.bodies, strict=True))
        for time, body in held:
            for true, other in self._truth.there(time):
                cost = math.dist(body.pose.position, other.pose.position)
                away.setdefault(true, []).append(cost + COLOUR_COST * (body.colour != other.colour))
        means = ((sum(costs) / len(costs), true) for true, costs in away.items())
        mean, nearest = min(means, default=(math.inf, ""))
        return nearest if mean < UNSEEN_RANGE else ""

    @cached_property
    def phantoms(self) -> Mapping[str, str]:
        """Believed items that were never a true one of their own, with the true item that reaches to them;
        empty: nothing was there. Without truth there are no phantoms."""
        if not self._truth.times or self._names is not None:
            return {}
        return {
            item: sightings[0].near
            for item, sightings in self.by_item.items()
            if not any(each.true for each in sightings)
        }


def common_offset(
    seen: Sequence[tuple[str, log_records.BodyRecord]], true: Sequence[tuple[str, log_records.BodyRecord]]
) -> tuple[float, float]:
    """Return the common offset of all seen items from the true ones, m; 0 without a common offset."""
    ways: list[tuple[float, float]] = []
    for _, body in seen:
        alike = [o for _, o in true if o.kind == body.kind and o.colour == body.colour]
        nearest = min(alike, key=lambda other, body=body: horizontal_distance(body, other), default=None)
        if nearest is not None and horizontal_distance(body, nearest) < 1.5 * MATCH_RANGE:
            ways.append(offset(body, nearest)[:2])
    if len(ways) < 2:
        return (0.0, 0.0)
    x, y = np.median(np.array(ways), axis=0)
    size = math.hypot(x, y)
    scatter = float(np.median(np.linalg.norm(np.array(ways) - (x, y), axis=1)))
    return (float(x), float(y)) if size > MIN_COMMON and scatter < MAX_SCATTER * size else (0.0, 0.0)


def _matched(
    seen: Sequence[tuple[str, log_records.BodyRecord]],
    true: Sequence[tuple[str, log_records.BodyRecord]],
    common: tuple[float, float],
    near: float = MATCH_RANGE,
) -> dict[int, int]:
    """Return a one-to-one assignment: index of the true item by index of the believed one."""
    cost = np.array([[_unlike(body, other, common, near) for _, other in true] for _, body in seen])
    if not cost.size:
        return {}
    rows, columns = linear_sum_assignment(cost)
    return {int(r): int(c) for r, c in zip(rows, columns, strict=True) if cost[r, c] < NO_MATCH_COST}


def _unlike(
    seen: log_records.BodyRecord, true: log_records.BodyRecord, common: tuple[float, float], near: float
) -> float:
    x, y, z = offset(seen, true)
    distance = math.hypot(x - common[0], y - common[1], z)
    if distance > (near if seen.colour == true.colour else OTHER_COLOUR_RANGE):
        return NO_MATCH_COST
    return distance + COLOUR_COST * (seen.colour != true.colour) + KIND_COST * (seen.kind != true.kind)


def _touching(
    seen: log_records.BodyRecord,
    true: Sequence[tuple[str, log_records.BodyRecord]],
    common: tuple[float, float],
) -> str:
    """Return the nearest true item whose horizontal circle holds the believed centre; empty for none."""
    away: list[tuple[float, str, log_records.BodyRecord]] = []
    for name, body in true:
        x, y, _ = offset(seen, body)
        away.append((math.hypot(x - common[0], y - common[1]), name, body))
    for distance, name, body in sorted(away, key=lambda each: each[:2]):
        low, high = extents(body.shape, body.pose.rotation())
        if distance < float(np.linalg.norm((high - low)[:2])) / 2 + 0.01:
            return name
    return ""
