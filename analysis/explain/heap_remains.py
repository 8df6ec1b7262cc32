"""Things that are left in a tote, and why no grasp reached them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from ...files.value_wording import listed
from ...logs.schema.records import BodyRecord
from ...world.belief.height_map import heap_id
from ...world.causes import grasp
from ...world.run_events import BinExchangedEvent
from ...world.scene.description import Bin
from ...world.shapes import extents
from ...world.skill_events import PickEvent
from ...world.values import Pose
from .case import Investigation
from .explanation import FailureStory, Finding
from .number_wording import counted, distance, place, seconds, times

NEAR_THING = 0.035
"""Distance from a thing's middle up to which grasps and failed closings are its own, m."""
LOW = 0.0125
"""Height above the tote's floor below which the pads get no hold, m."""
COVERED = 0.012
"""Depth below the seen surface from which on a thing is hidden, m: columns have steps of 6 mm."""
FINGER_ROOM = 0.021
"""Distance from a wall below which no finger fits between, m."""
SEARCH_TIME = 3.0
"""Time before a failure within which its search among grasps is in the log, s."""


@dataclass(frozen=True, slots=True)
class Remainder:
    """Thing that is left in a tote."""

    true: str
    name: str
    """Colour and kind, with the id."""
    at: str
    state: str
    """State of it in words: hidden, flat, at a wall, or free."""
    tried: str
    """Results of the grasps near it, in words."""

    def __str__(self) -> str:
        return f"{self.name} at {self.at}: {self.state}; {self.tried}"


def left_in_tote(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return what was left in the tote when the last search for grasps in it failed, before it was exchanged.

    None when the failure is no such search.
    """
    if failure.cause != grasp.NO_CANDIDATE.name:
        return None
    return case.once(_left_in_totes).get(_delivery(case, failure))


def why_left(case: Investigation, true: str) -> Finding | None:
    """Return why a thing that nobody picked is left in a tote: from the last search for grasps there."""
    found = reversed(case.once(_left_in_totes).values())
    return next((one for one in found if any(f"({true})" in reason for reason in one.reasons)), None)


def _delivery(case: Investigation, failure: FailureStory) -> tuple[str, int]:
    """Return the tote of a search for grasps, and how often it had been exchanged by then."""
    tote = str(failure.evidence.get("object"))
    exchanges = (at.time for at in case.events(BinExchangedEvent) if at.record.bin == tote)
    return tote, sum(time <= failure.time for time in exchanges)


def _left_in_totes(case: Investigation) -> dict[tuple[str, int], Finding]:
    """Return what was left of each delivery, by its tote and number, in the order of the last searches."""
    last: dict[tuple[str, int], float] = {}
    for failure in case.failures:
        tote = case.bins.get(str(failure.evidence.get("object")))
        if failure.cause == grasp.NO_CANDIDATE.name and tote is not None and tote.is_tote:
            delivery = _delivery(case, failure)
            last.pop(delivery, None)
            last[delivery] = failure.time
    return {delivery: _left(case, *delivery, time) for delivery, time in last.items()}


def _left(case: Investigation, tote: str, number: int, time: float) -> Finding:
    left = remains(case, tote, time)
    if not left:
        reasons = (f"truly nothing was left in it at {seconds(time)}",)
        return Finding("heap.empty", tote, f"{tote} was empty", reasons, "", time)
    states = Counter(one.state.split(",")[0] for one in left)
    title = (
        f"{counted(len(left), 'thing')} in {tote} got no grasp: "
        f"{listed([f'{n} {state}' for state, n in states.most_common()], 5)}"
    )
    about, reasons = f"{tote} {number}", tuple(str(one) for one in left)
    return Finding("heap.out_of_reach", about, title, reasons, "", time)


def remains(case: Investigation, tote: str, time: float) -> list[Remainder]:
    """Return the things that truly lie in a tote at that time."""
    bins = {str(bin_.id): bin_ for bin_ in case.scene.bins} if case.scene else {}
    bin_ = bins.get(tote)
    if bin_ is None or not bin_.is_tote:
        return []
    scene = case.run.at(time).belief
    heap = next((body for body in scene.bodies if body.id == heap_id(tote)), None) if scene else None
    refused, vain = _refused(case, tote, time), _vain(case, time)
    bodies = ((true, case.truth.at(true, time)) for true in case.truth.tracks)
    return [
        Remainder(
            true,
            f"the {body.colour} {'thing' if body.kind == 'unknown' else body.kind} ({true})",
            place(body.pose.position),
            lying(bin_, heap, body),
            _tried(refused, vain, body),
        )
        for true, body in bodies
        if body is not None and case.bin_at(body) == tote
    ]


def lying(tote: Bin, heap: BodyRecord | None, body: BodyRecord) -> str:
    """Return how a thing lies in a tote, in words. `heap`: the columns that were seen."""
    inverse = tote.pose.inverse()
    low, high = extents(body.shape, (inverse @ body.pose).rotation())
    x, y, z = (inverse @ body.pose).position
    inner_low, inner_high = tote.inside()
    top = z + float(high[2])
    over = -math.inf if heap is None else _column(heap, body.pose.position) - body.pose.position[2]
    if over - float(high[2]) > COVERED:
        return "hidden below other things"
    if top - inner_low[2] < LOW:
        return f"flat, {1000 * max(0.0, top - inner_low[2]):.0f} mm high"
    sides = ((x, low[0], high[0], 0), (y, low[1], high[1], 1))
    gap = min(min(inner_high[k] - at - far, at + near - inner_low[k]) for at, near, far, k in sides)
    gap = max(0.0, float(gap))
    return f"at a wall, {distance(gap)} from it" if gap < FINGER_ROOM else "seen and away from the walls"


def _column(heap: BodyRecord, point: Sequence[float]) -> float:
    """Return the height of the heap's columns at a point of the world, m; of none -inf."""
    x, y, _ = (heap.pose.inverse() @ Pose((point[0], point[1], point[2]))).position
    tops = (
        block.at[2] + block.size[2] / 2
        for block in heap.blocks
        if abs(x - block.at[0]) <= block.size[0] / 2 and abs(y - block.at[1]) <= block.size[1] / 2
    )
    return heap.pose.position[2] + max(tops, default=-math.inf)


def _refused(case: Investigation, tote: str, time: float) -> list[tuple[Sequence[float], str]]:
    """Return place and reason of the grasps that the last search before that time refused."""
    found = [
        at
        for at in case.run.candidates
        if at.record.object == heap_id(tote) and time - SEARCH_TIME <= at.time <= time
    ]
    tried = (one for at in found for one in at.record.tried)
    return [(one.position, f"would touch {one.by}" if one.by else one.verdict) for one in tried]


def _vain(case: Investigation, time: float) -> list[Sequence[float]]:
    """Return the places of the closings before that time that held nothing."""
    found: list[Sequence[float]] = []
    for at in case.events(PickEvent, end=time):
        if not at.record.held:
            searches = (one for one in case.run.candidates if one.time <= at.time)
            tried = [c for one in searches for c in one.record.tried if c.name == at.record.candidate]
            found += [tried[-1].position] if tried else []
    return found


def _tried(
    refused: Sequence[tuple[Sequence[float], str]], vain: Sequence[Sequence[float]], body: BodyRecord
) -> str:
    def near(position: Sequence[float]) -> bool:
        return math.dist(position[:2], body.pose.position[:2]) < NEAR_THING

    reasons = Counter(reason for position, reason in refused if near(position))
    failed = sum(near(position) for position in vain)
    words = [f"closed on it in vain {times(failed)}"] if failed else []
    if reasons:
        why = listed([f"{n} {reason}" for reason, n in reasons.most_common()], 3)
        words.append(f"{counted(reasons.total(), 'grasp')} refused: {why}")
    return ", ".join(words) or "no grasp was found on it"
