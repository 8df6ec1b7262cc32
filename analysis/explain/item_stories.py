"""Item stories: the events of each item, as the robot believed."""

from __future__ import annotations

import math
from typing import Literal

from ...logs.run_log import Stamped
from ...logs.schema.event_records import BeliefEvent
from ...simulation.scoring.scorer import ItemScore
from ...world.belief.facts import RODE_ON, TAKEN_AWAY
from ...world.events.run_events import HandledEvent
from ...world.events.skill_events import ItemDoneEvent, PickEvent, SetAsideEvent
from ...world.journal import JournalEvent
from ...world.scene.destinations import is_at
from .investigation.case import Investigation
from .investigation.explanation import ItemEvent, ItemStory
from .investigation.number_wording import distance, place

AGAIN = 0.02
"""An item that is seen this far from where it was believed has moved, m."""


TOLD = 1.0
"""A failure this soon after the item left the hand tells of it, s."""
_LOST = "no longer in the hand"


def items_of(case: Investigation) -> tuple[ItemStory, ...]:
    """Every item that was ever believed in, and then those that were never seen."""
    found = [_story(case, id_) for id_, track in case.belief.tracks.items() if track.first.role == "item"]
    unseen = [true for true in case.truth.tracks if true not in case.believed]
    return (*found, *(_unseen(case, true) for true in unseen))


def _story(case: Investigation, item: str) -> ItemStory:
    body = case.belief.tracks[item].bodies[-1]
    true = case.pairs.get(item)
    failed = [f.time for f in case.failures if f.item == item]
    events = [
        event
        for at in case.run.events
        for event in _events(at, item)
        if not event.what.startswith(_LOST) or not any(0.0 <= f - at.time < TOLD for f in failed)
    ]
    events += [
        ItemEvent(f.time, f"{f.name} failed: {f.cause}", f.node, f.number)
        for f in case.failures
        if f.item == item
    ]
    return ItemStory(
        item,
        body.kind,
        body.colour,
        _state(case, item),
        tuple(sorted(events, key=lambda event: event.time)),
        "" if true is None else _truth(case, true),
    )


def _unseen(case: Investigation, true: str) -> ItemStory:
    body = case.truth.tracks[true].first
    score = case.scores.get(true)
    state = "done" if score is not None and score.verdict == "sorted" else "left"
    return ItemStory(true, body.kind, body.colour, state, (), f"{_truth(case, true)}; never seen")


def _state(case: Investigation, item: str) -> Literal["done", "held", "left", "gone"]:
    body = case.belief.at(item, case.end)
    if body is None:
        last = case.belief.tracks[item].bodies[-1]
        if case.departed.get(case.pairs.get(item, "")) != last.place:
            return "gone"
        return "done" if is_at(last.place, case.destination(last)) else "left"
    if body.attached:
        return "held"
    destination = case.destination(body)
    return "done" if destination and is_at(body.place, destination) else "left"


def _truth(case: Investigation, true: str) -> str:
    """Where it really is in the end, in the scorer's words."""
    score: ItemScore | None = case.scores.get(true)
    if case.gone(true) is not None:
        return "truly nowhere any more"
    body = case.truth.tracks[true].bodies[-1]
    lies = case.bin_at(body)
    where = f"in {lies}" if lies else f"at {place(body.pose.position)}"
    if lies and score is not None and score.seat is not None and not score.reason:
        where += f", {1000 * score.seat.depth:.1f} mm deep"
    if score is not None and score.seat is not None and score.reason:
        where += f": {score.reason}"
    elif score is not None and score.verdict == "sorted":
        where += ", where it belongs"
    elif score is not None and score.destination and score.destination == lies:
        where += ", where it belongs, but does not rest in it"
    elif score is not None and score.destination:
        where += f"; it belongs into {score.destination}"
    return f"truly {where}, and was taken away with it" if true in case.departed else f"truly {where}"


def _events(at: Stamped[JournalEvent], item: str) -> list[ItemEvent]:
    event = at.record
    match event:
        case HandledEvent() if event.element == item:
            return [ItemEvent(at.time, "passed over", event.node)]
        case PickEvent() if event.object == item and event.held:
            return [ItemEvent(at.time, f"held{_felt(event)}", event.node)]
        case ItemDoneEvent() if event.object == item:
            told = f"placed into {event.into}" if event.into else "put down"
            return [ItemEvent(at.time, told, event.node)]
        case SetAsideEvent() if event.object == item:
            return [ItemEvent(at.time, "set aside: left where it lies", event.node)]
        case BeliefEvent() if event.object == item:
            told = _change(event)
            return [ItemEvent(at.time, told)] if told else []
        case _:
            return []


def _felt(pick: PickEvent) -> str:
    if pick.width is None or pick.load is None:
        return ""
    return f" ({pick.width * 1000:.0f} mm between the fingers, {pick.load:.2f} N on the wrist)"


def _change(event: BeliefEvent) -> str:
    """A change of the belief in words; empty for one that is not worth a line, or told by another event."""
    before, after, reason = event.before, event.after, event.reason
    if after is None:
        return reason if reason in (RODE_ON, TAKEN_AWAY) else f"given up: {reason}"
    if before is None:
        return f"seen for the first time, at {place(after.pose.position)}"
    if reason == "seen":
        moved = math.dist(before.pose.position[:2], after.pose.position[:2])
        return f"seen again, {distance(moved)} from where it was believed" if moved > AGAIN else ""
    if before.attached and not after.attached and reason != "placed":
        return f"{_LOST}: {reason}"
    return ""
