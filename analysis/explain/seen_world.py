"""Bodies as the robot saw and felt them, for a log without ground truth.

The world is known at the looks, and where the hand felt something. An item that two looks show at two places
was moved between them. Nothing here reads the simulation's state, its result or its faults.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from picktree.logs import BeliefEvent, Stamped, log_records
from picktree.world import GRAVITY, world_facts
from picktree.world.scene import destinations

from .body_tracks import BodyTrack, BodyTracks, DeviceState, horizontal_distance
from .explanation import FailureStory, ItemVerdict, number

if TYPE_CHECKING:
    from .case import Investigation

MIN_SHIFT = 0.015
"""Distance between two sightings of an item above which it has moved, m."""
SAME_PLACE = 0.02
"""Distance within which two sightings of a kind in other colours are one item, m."""
EMPTY_WIDTH = 0.002
"""Opening below which the fingers hold nothing, m."""
CARRIED_OFF = frozenset({world_facts.RODE_ON, world_facts.TAKEN_AWAY})
"""Reasons to remove an item from the belief that do not mean its absence."""


class SeenWorld:
    """Bodies at each look, with one name for each item."""

    is_true = False
    devices: tuple[DeviceState, ...] = ()
    sampled = 0.1
    """Maximum interval between an event and the sample that shows it, s."""

    def __init__(self, case: Investigation) -> None:
        self._belief = case.belief
        self.names: Mapping[str, str] = _first_names(case.belief)
        """First name of each believed item."""
        self._carried = {
            self.names.get(at.record.object, "")
            for at in case.events(BeliefEvent)
            if at.record.after is None and at.record.reason in CARRIED_OFF
        }
        scenes = list(self._scenes(case))
        self.items = BodyTracks(scenes, "item")
        """Items at the looks."""
        self.obstacles = BodyTracks(list(case.run.log.beliefs()), "obstacle")
        """Obstacles that the camera has shown."""

    def gone(self, item: str) -> tuple[float, float] | None:
        """Return the times between which an item vanished, s: not seen again, though its place was."""
        return None if item in self._carried else self.items.gone(item)

    def verdicts(self, case: Investigation) -> Mapping[str, ItemVerdict]:
        """Return where each item is by the belief; an item that vanished is left."""
        found: dict[str, ItemVerdict] = {}
        totes = {str(each.id) for each in case.scene.bins if each.is_tote} if case.scene else set[str]()
        for item, track in self.items.tracks.items():
            last, destination = track.last, case.destination(track.last)
            inside = "" if last.attached or last.place in totes else case.container(last.place)
            verdict = "left" if destination or case.gone(item) is not None else "no destination"
            if inside and case.gone(item) is None:
                right = bool(destination) and destinations.is_at(inside, destination)
                verdict = "sorted" if right else "misplaced"
            found[item] = ItemVerdict(destination, inside, verdict)
        return found

    def _scenes(self, case: Investigation) -> Iterator[Stamped[log_records.Scene]]:
        """Yield the items at each look, and at each closing of the fingers on nothing."""
        found: dict[float, dict[str, log_records.BodyRecord]] = {}
        newest, known = -math.inf, frozenset[str]()
        messages = list(case.run.log.beliefs())
        for at in messages:
            items = [b for b in at.record.bodies if b.role == "item"]
            ids = frozenset(b.id for b in items)
            latest = max((b.last_seen for b in items if not b.attached), default=newest)
            looked = latest > newest + 1e-6
            if looked or ids != known or at is messages[-1]:
                time = latest if looked else at.time
                found[round(time, 3)] = {self.names[b.id]: b for b in items}
            newest, known = max(newest, latest), ids
        for failure in case.failures:
            width = number(failure, "width") or 0.0
            if failure.cause == "grasp.missed" and width <= case.least_width + EMPTY_WIDTH:
                closing = (s.start for s in case.steps("close") if s.start < failure.time)
                self._felt_absent(found, failure, max(closing, default=failure.time))
        for time, bodies in sorted(found.items()):
            placed = (replace(body, id=name) for name, body in bodies.items())
            yield Stamped(time, log_records.Scene(tuple(placed), ()))

    def _felt_absent(
        self, found: dict[float, dict[str, log_records.BodyRecord]], failure: FailureStory, closed: float
    ) -> None:
        """Add the moment at which the fingers closed on nothing where an item was believed, s.

        The item was then already where the next look shows it.
        """
        item = self.names.get(failure.item, "")
        before = [time for time in sorted(found) if time < closed - 1e-6]
        after = [time for time in sorted(found) if time >= closed - 1e-6]
        if not before or not after or item not in found[before[-1]]:
            return
        old, bodies = found[before[-1]][item], dict(found[before[-1]])
        seen = (found[time].get(item) for time in after)
        later = next((b for b in seen if b is not None and b.last_seen > closed - 0.5), None)
        if later is not None and horizontal_distance(later, old) > MIN_SHIFT:
            found[round(closed, 3)] = bodies | {item: later}
        elif later is None and item not in found[after[-1]]:
            found[round(closed, 3)] = bodies
            for time in (*after, round(closed, 3)):
                found[time].pop(item, None)


def _first_names(belief: BodyTracks) -> Mapping[str, str]:
    """Return the first name of each item.

    An item that is not at its place and appears at another one, or at its place in another colour, gets a new
    name there.
    """
    tracks = [track for track in belief.tracks.values() if track.first.role == "item"]
    ends = {track.id for track in tracks if belief.gone(track.id) is not None}
    names: dict[str, str] = {}
    followed: set[str] = set()
    for track in sorted(tracks, key=lambda each: each.times[0]):
        lost = [
            other
            for other in tracks
            if other.id in ends
            and other.id not in followed
            and other.id != track.id
            and other.last.kind == track.first.kind
            and (other.last.colour == track.first.colour or _way(other, track) < SAME_PLACE)
            and other.times[0] < track.times[0]
            and other.last.last_seen < track.first.last_seen - 1e-6
        ]
        before = min(lost, key=lambda other: _way(other, track), default=None)
        if before is not None:
            followed.add(before.id)
        names[track.id] = track.id if before is None else names[before.id]
    return names


def _way(one: BodyTrack, other: BodyTrack) -> float:
    return horizontal_distance(one.last, other.first)


def felt_departure(case: Investigation, item: str, start: float, end: float) -> tuple[float, float] | None:
    """Return the times between which an item left the fingers although believed in them, s; None: it stayed.

    The fingers close once nothing is between them, or the wrist does not bear the item's weight.
    """
    gripper = case.gripper
    opens = case.opens(start, end)
    here = (gripper.times >= start - 1e-6) & (gripper.times <= opens + 1e-6)
    times, widths = gripper.times[here], gripper.widths[here]
    if len(times) < 4:
        return None
    settled = float(sorted(widths[:4])[1])
    if settled < case.least_width + EMPTY_WIDTH:
        return (start, start)
    for tick, (before, time) in enumerate(itertools.pairwise(times), 1):
        later = widths[tick:]
        closes = float(later[0]) < settled - max(MIN_CLOSING, CLOSING_SHARE * settled)
        if closes and float(later[:CLOSING_TICKS].min()) < CLOSED_SHARE * settled:
            return (float(before), float(time))
    return (start, opens) if _unloaded(case, item, start, end) else None


def _unloaded(case: Investigation, item: str, start: float, end: float) -> bool:
    """Whether a failure during the grip, or just after it, found the weight of the item missing."""
    entry = case.entry(item)
    weight = 0.0 if entry is None else entry.mass * GRAVITY
    loads = [
        load
        for f in case.failures
        if f.item == item and f.cause == "grasp.slipped" and start < f.time <= end + 1.0
        and (load := number(f, "load")) is not None
    ]  # fmt: skip
    return weight > MIN_WEIGHT and any(abs(load) < LOAD_SHARE * weight for load in loads)


MIN_CLOSING, CLOSING_SHARE = 0.003, 0.12
"""Decrease of the opening around an item, m and as a share, from which the item is no longer in between."""
CLOSING_TICKS, CLOSED_SHARE = 10, 0.6
"""Number of readings within which the fingers have closed, and the share of the opening that is left then."""
MIN_WEIGHT, LOAD_SHARE = 0.4, 0.35
"""Least weight whose absence is felt, N; share of it below which it is absent."""
