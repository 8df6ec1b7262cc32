"""What happened to each item, as the robot believed."""

from __future__ import annotations

from typing import Literal, cast

from ...logs.run_log import Stamped
from ...logs.schema.records import Event, Values
from ...simulation.scoring.scorer import ItemScore
from ...world.belief.facts import RODE_ON, TAKEN_AWAY
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
        ItemEvent(f.time, f"{f.node.rsplit('/', 1)[-1]} failed: {f.cause}", f.node, f.number)
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


def _events(at: Stamped[Event], item: str) -> list[ItemEvent]:
    record = at.record
    data = record.data
    if record.kind == "handled" and data.get("element") == item:
        return [ItemEvent(at.time, "passed over", record.node)]
    if data.get("object") != item:
        return []
    match record.kind:
        case "pick" if data.get("held"):
            return [ItemEvent(at.time, f"held{_felt(data)}", record.node)]
        case "item_done":
            into = data.get("into")
            return [ItemEvent(at.time, f"placed into {into}" if into else "put down", record.node)]
        case "set_aside":
            return [ItemEvent(at.time, "set aside: left where it lies", record.node)]
        case "belief":
            told = _change(data)
            return [ItemEvent(at.time, told)] if told else []
        case _:
            return []


def _felt(data: Values) -> str:
    width, load = data.get("width"), data.get("load")
    if not isinstance(width, int | float) or not isinstance(load, int | float):
        return ""
    return f" ({width * 1000:.0f} mm between the fingers, {load:.2f} N on the wrist)"


def _change(data: Values) -> str:
    """A change of the belief in words; empty for one that is not worth a line, or told by another event."""
    before, after = _body(data.get("before")), _body(data.get("after"))
    reason = str(data.get("reason", ""))
    if after is None:
        return reason if reason in (RODE_ON, TAKEN_AWAY) else f"given up: {reason}"
    if before is None:
        return f"seen for the first time, at {place(_position(after))}"
    if reason == "seen":
        moved = _apart(before, after)
        return f"seen again, {distance(moved)} from where it was believed" if moved > AGAIN else ""
    if before.get("attached") and not after.get("attached") and reason != "placed":
        return f"{_LOST}: {reason}"
    return ""


def _body(value: object) -> Values | None:
    return cast("Values", value) if isinstance(value, dict) else None


def _position(body: Values) -> list[float]:
    pose = cast("dict[str, list[float]]", body.get("pose") or {})
    return pose.get("position", [0.0, 0.0, 0.0])


def _apart(a: Values, b: Values) -> float:
    (ax, ay, _), (bx, by, _) = _position(a), _position(b)
    return ((ax - bx) ** 2 + (ay - by) ** 2) ** 0.5
