"""Causes by contact: bodies that the arm touched when a force stopped it."""

from __future__ import annotations

import math

from ...logs.schema.event_records import ImageEvent
from ...logs.schema.records import BodyRecord
from ...world.shapes import extents
from ...world.skill_events import SafetyStopEvent
from .body_tracks import horizontal_distance
from .case import Investigation
from .explanation import FailureStory, Finding, number, numbers, word
from .held_items import pressed_from_below
from .item_whereabouts import way_since
from .number_wording import distance, force, place, seconds

STOPPED = frozenset(
    {"world.disturbed", "safety.force_limit", "safety.stop", "control.tracking", "control.timeout",
     "safety.torque_limit", "safety.watchdog", "planning.blocked"}
)  # fmt: skip
AROUND = 0.15
"""Distance from the fingers' joints within which they, or the held object, may touch something, m."""
TOUCHING = 0.005
"""Margin around a body within which another one may touch it, m."""
CLOSE = 0.08
"""An item nearer to the hand than that was touched rather than an unknown thing beside it, m."""


def touched(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the body truly near the hand when it was stopped; None when the cause is no touch."""
    stopped = failure.cause in STOPPED or pressed_from_below(failure)
    if not stopped and not (failure.cause.startswith("safety.") and case.obstacles_near(failure.time)):
        return None
    stops = case.events(SafetyStopEvent, start=case.visit(failure).start, end=failure.time)
    time = stops[-1].time if stops else failure.time
    hand = case.hand(time)
    felt = _felt(failure)
    reasons = [f"at {seconds(time)} with the hand at {place(hand)}"] if hand else []
    near: list[tuple[float, str]] = []
    held = case.truth.at(case.pairs.get(failure.item, ""), time) if pressed_from_below(failure) else None
    for true in case.truth.tracks:
        body = case.truth.at(true, time)
        if body is not None and hand is not None and failure.item not in case.believed.get(true, ()):
            away = math.dist(hand, body.pose.position)
            if away < AROUND and (
                held is None or _reach(held) + _reach(body) > horizontal_distance(held, body)
            ):
                near.append((away, true))
    verb = f"the arm met something with {felt}" if felt else "the arm was stopped"
    where = f" on its way with {failure.item}" if failure.item else ""
    unknown = next(iter(case.obstacles_near(time)), None)
    if unknown is not None and (not near or min(near)[0] > CLOSE):
        title = f"{verb}{where}: {unknown}, which nobody had told the robot of, stood next to it"
        reasons.append(_when_seen(case, time))
        return Finding("contact.obstacle", unknown, title, tuple(reasons), failure.item, time)
    if near:
        away, true = min(near)
        name = case.name_of(true)
        moving = way_since(case, true, max(time - 2.0, 0.0), time)
        reasons.append(f"{name} was {distance(away)} from the hand")
        if moving is not None:
            reasons.append(f"{name} moved by {distance(moving.way)} about then")
        target = case.bin_at(case.truth.tracks[true].before(time) or case.truth.tracks[true].first)
        if target:
            doing = f"while {failure.item} was put there, " if failure.id == "Place" else ""
            title = f"{target} is too crowded: {doing}{verb}, next to {name}"
            return Finding("bin.crowded", target, title, tuple(reasons), failure.item, time)
        title = f"{verb}{where}: {name} lay next to it"
        return Finding("contact.item", true, title, tuple(reasons), failure.item, time)
    if pressed_from_below(failure):
        return None
    title = f"{verb}{where}: nothing known was near"
    about = failure.item or failure.node
    return Finding(
        word(failure, "stopped_by") or failure.cause, about, title, tuple(reasons), failure.item, time
    )


def _reach(body: BodyRecord) -> float:
    """Return the radius of the horizontal circle around a body, with a margin, m."""
    low, high = extents(body.shape, body.pose.rotation())
    return math.hypot(high[0] - low[0], high[1] - low[1]) / 2 + TOUCHING


def _when_seen(case: Investigation, time: float) -> str:
    """Return when the robot last looked before it."""
    looks = case.events(ImageEvent, start=0.0, end=time)
    return f"it was looked for the last time at {seconds(looks[-1].time)}" if looks else "nobody had looked"


def _felt(failure: FailureStory) -> str:
    vector = numbers(failure, "force")
    size = math.hypot(*vector) if vector else number(failure, "force")
    if size is None and pressed_from_below(failure):
        size = -(number(failure, "load") or 0.0)
    return force(size) if size is not None else ""
