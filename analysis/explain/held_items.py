"""Items in the hand: whether they truly were there, when they left it, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from picktree.logs import ImageEvent, log_records
from picktree.world import GRAVITY, Array, event_types, extents, matches
from picktree.world.scene import CatalogueEntry

from .camera_causes import explain_displaced_camera
from .case import Investigation
from .explanation import MIN_VERTICAL, Confidence, FailureStory, Finding, contact_of, number
from .seen_world import EMPTY_WIDTH, felt_departure
from .wording import between, distance, force, listed_times, place, seconds

GRIP_SHARE = 0.5
"""Share of the greatest finger force above which the fingers are taken to press on something."""
LOAD_WINDOW = 3
"""Readings over which the load is averaged, so that a jolt does not count as weight."""
MIN_CLOSING = 0.002
"""Decrease of the opening beyond which the fingers count as closing, m."""
REST_WINDOW = 3
"""Number of successive readings without motion that count as rest."""
FINGER_NOISE = 0.001
"""Motion of the fingers that is noise, m."""


@dataclass(frozen=True, slots=True)
class GripPeriod:
    """Period from one closing of the fingers on something."""

    closed: float
    """Time at which the fingers began to close, s."""
    force: float
    """Maximum force of a finger, N."""
    load: float
    """Maximum steady downward load during the grip, N; 0 without a grip."""


def grip_within(case: Investigation, start: float, end: float) -> GripPeriod | None:
    """Return the last closing between two times (s); None when the fingers did not close."""
    gripper, wrenches = case.gripper, case.run.wrenches
    here = np.flatnonzero((gripper.times >= start - 1e-6) & (gripper.times <= end + 1e-6))
    closed = _closing(gripper.widths[here], gripper.forces[here]) if len(here) else None
    if closed is None:
        return None
    times, effort = gripper.times[here][closed:], gripper.forces[here][closed:]
    force, load = float(effort.max()), 0.0
    pressing = effort > GRIP_SHARE * force
    if force > 0.0 and bool(pressing.any()) and len(wrenches.times):
        felt = np.interp(times, wrenches.times, _steady(-wrenches.forces[:, 2]))
        load = max(float(felt[pressing].max()), 0.0)
    return GripPeriod(float(times[0]), force, load)


def _closing(width: Array, effort: Array) -> int | None:
    """Return the last index before the closing at which the fingers were open, at rest and without force."""
    free = effort < GRIP_SHARE * max(float(effort.max()), 1.0)
    for k in range(len(width) - 1, REST_WINDOW - 1, -1):
        still = float(np.ptp(width[k - REST_WINDOW : k + 1])) < FINGER_NOISE
        if still and free[k] and width[k] > float(width[k:].min()) + MIN_CLOSING:
            return k
    return None


def _steady(values: Array) -> Array:
    """Return the minimum of neighbouring readings, which suppresses short peaks."""
    if len(values) < LOAD_WINDOW:
        return values
    padded = np.pad(values, LOAD_WINDOW // 2, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, LOAD_WINDOW).min(axis=1)


SLIP_SHARE = 0.5
"""Share of the load that the fingers should hold below which a slipping item must be slippery."""
WEIGHT_RATIO = 3.0
"""Ratio of a pull to the catalogue's weight above which the item has another weight."""
MASS_RATIO = 1.5
"""Ratio of the true mass to the catalogue's above which the item differs from its kind."""
FRICTION_RATIO = 0.7
"""Ratio of the true friction to the catalogue's below which the item differs from its kind."""
JOLT_FORCE = 3.0
"""Force that lifting and braking may add to a weight, N."""
WEIGHT_SHARE = 0.6
"""Share of a pull that stopped the arm from which on the item's known weight explains it."""
GRIP_FACTOR = 1.3
"""Ratio of the weight that the fingers should hold to the item's weight."""
MIN_SEPARATION = 0.015
"""Increase of the distance between item centre and fingers since closing above which it has left them, m."""
IMPACT_SPEED = 0.5
"""Speed relative to the hand, without gravity, that no item reaches by sliding out, m/s."""
HOLD_FAILURES = (
    "grasp.slipped", "grasp.missed", "place.missed", "world.unknown_object", "perception.not_found",
    "safety.payload", "control.gripper", "insert.*", "world.disturbed",
)  # fmt: skip
"""Failures that the loss of an item from the hand may cause."""


@dataclass(frozen=True, slots=True)
class HeldPeriod:
    """Time during which the robot believed that it held an item, with what truly became of the item."""

    item: str
    true: str
    start: float
    end: float
    left: tuple[float, float] | None
    """Times between which the item left the fingers although believed in them, s; None: it stayed."""
    flung: bool = False
    """Whether it left faster than it can fall."""
    unclear: bool = False
    """Whether the speed at which it left is unknown."""


def held_periods(case: Investigation) -> tuple[HeldPeriod, ...]:
    """Return the periods in which an item was believed in the hand, in order of time."""
    found: list[HeldPeriod] = []
    for item, true in case.pairs.items():
        start: float | None = None
        for at in (*case.changes(item), None):
            after = at.record.after if at is not None else None
            now = after is not None and after.attached
            time = case.end if at is None else at.time
            if now and start is None:
                start = time
            elif start is not None and not now:
                found.append(_period(case, item, true, start, time))
                start = None
    return tuple(sorted(found, key=lambda period: period.start))


def holds_of(case: Investigation, true: str) -> list[HeldPeriod]:
    """Return the periods in which a true item was believed in the hand, in order of time."""
    return [period for period in case.once(held_periods) if period.true == true]


def _period(case: Investigation, item: str, true: str, start: float, end: float) -> HeldPeriod:
    period = HeldPeriod(item, true, start, end, None)
    if not case.world.is_true:
        return replace(period, left=felt_departure(case, item, start, end), unclear=True)
    gone = case.gone(true)
    base, before, moving = None, start, False
    for time, body in case.bodies.tracks[true].since(start, case.opens(start, end)):
        hand = case.hand(time)
        if hand is None:
            continue
        away = math.dist(hand, body.pose.position)
        if base is None and away > reach_of(body) and time < start + 1.0:
            return replace(period, left=(start, start), unclear=True)
        base = away if base is None else min(base, away)
        if away > base + MIN_SEPARATION:
            flung = _flung(case, true, before, time)
            return replace(period, left=(before, time), flung=flung is True, unclear=flung is None)
        before, moving = time, True
    taken = gone is not None and start - 1e-6 <= gone[1] <= end + case.sampled and moving
    return replace(period, left=gone) if taken else period


def reach_of(body: log_records.BodyRecord) -> float:
    """Return the greatest distance from the fingers to the centre of an item that they hold, m."""
    low, high = extents(body.shape, np.eye(3))
    return float(np.linalg.norm(high - low)) / 2 + 0.05


def _flung(case: Investigation, true: str, before: float, time: float) -> bool | None:
    """Whether an item left the fingers by a blow; None where the log has no velocities."""
    state = next((s for s in case.devices if abs(s.time - time) < 0.03), None)
    here, there = case.hand(before), case.hand(time)
    if state is None or true not in state.motions or here is None or there is None:
        return None
    velocity, _ = state.motions[true]
    body = case.bodies.at(true, time)
    if body is None or not case.in_the_air(body):
        return None
    hand = np.subtract(there, here) / max(time - before, 1e-3)
    sideways = float(np.linalg.norm(np.subtract(velocity[:2], hand[:2])))
    fall = -velocity[2] - GRAVITY * (time - before)
    return sideways > IMPACT_SPEED + 0.5 * float(np.linalg.norm(hand)) or fall > IMPACT_SPEED


def explain_drop(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return why an item that was believed in the hand is not there; None when it is, or was never."""
    if not any(matches(pattern, failure.cause) for pattern in HOLD_FAILURES):
        return None
    true = case.pairs.get(failure.item)
    periods = [p for p in holds_of(case, true or "") if p.start <= failure.time + 1e-6]
    period = periods[-1] if periods else None
    if period is None or period.end < failure.time - LOSS_TIME:
        return None
    if period.left is None or period.left[0] > failure.time + case.sampled:
        return _let_go(case, failure, period)
    seen = _seen_since(case, period.true, period.end, failure.time)
    return None if seen else explain_departure(case, period)


LOSS_TIME = 10.0
"""Time after the loss of an item within which a failure may come from it, s."""


def _seen_since(case: Investigation, true: str, since: float, until: float) -> bool:
    """Whether an item was seen at rest between two times, so that its place was known again."""
    sightings = (s for item in case.believed.get(true, ()) for s in case.identities.by_item.get(item, ()))
    return any(since + 0.1 < s.time < until and _rests(case, true, s.time) for s in sightings)


def _rests(case: Investigation, true: str, time: float) -> bool:
    track = case.bodies.tracks[true]
    before, after = track.before(time), track.after(time + 0.2) or track.last
    return before is not None and math.dist(before.pose.position, after.pose.position) < MIN_SEPARATION


def _let_go(case: Investigation, failure: FailureStory, period: HeldPeriod) -> Finding | None:
    """Return the finding that the robot gave up an item which was still between its fingers; else None."""
    time = min(failure.time, period.end)
    hand, body = case.hand(time), case.bodies.at(period.true, time) if case.world.is_true else None
    soon = failure.time - period.end < (REPORT_TIME if failure.cause == "grasp.slipped" else LOSS_TIME)
    unfelt = failure.cause == "grasp.slipped" or _given_up_unfelt(case, period, failure)
    if not soon or not unfelt or hand is None or body is None or pressed_from_below(failure):
        return None
    if math.dist(hand, body.pose.position) > reach_of(body):
        return None
    if (nature := item_deviation(case, failure.item, period.true, time)) is not None:
        return nature
    load = number(failure, "load")
    felt = "" if load is None else f": the wrist felt {force(max(load, 0.0))} of its weight"
    title = f"{failure.item} was still in the hand and counted as lost{felt}"
    reasons = (
        f"{case.truly}its centre was {distance(math.dist(hand, body.pose.position))} from the fingers",
    )
    return Finding("grasp.not_felt", failure.node, title, reasons, failure.item, time)


def _given_up_unfelt(case: Investigation, period: HeldPeriod, failure: FailureStory) -> bool:
    """Whether the robot released an item that it did not feel, and then did not find it at its old place."""
    change = next((at for at in case.changes(period.item) if abs(at.time - period.end) < 1e-6), None)
    unfelt = change is not None and change.record.reason == "not felt in the hand"
    missed = unfelt and failure.cause == "grasp.missed"
    return missed and not _seen_since(case, period.true, period.end, failure.time)


FALL_TIME = 0.5
"""Time after the loss of an item from which a picture shows where it lies, s."""
REPORT_TIME = 2.0
"""Time within which a failure reports the loss of the item, s."""

MIN_PUSH = 2.0
"""Negative load above which a body pushes from below, N."""


def pressed_from_below(failure: FailureStory) -> bool:
    """Whether an item reported as slipped is still between the fingers, and another body bears its weight."""
    width, load = number(failure, "width"), number(failure, "load")
    return failure.cause == "grasp.slipped" and (width or 0.0) > EMPTY_WIDTH and (load or 0.0) < -MIN_PUSH


def explain_departure(case: Investigation, period: HeldPeriod) -> Finding | None:
    """Return why an item left the fingers; None where it was taken away."""
    item, true = period.item, period.true
    assert period.left is not None
    start, end = period.left
    gone = case.gone(true)
    if gone is not None and gone[0] <= end + 1e-6 and case.world.is_true:
        return None
    lies = case.bodies.tracks[true].before(end + 1.0)
    where = "" if lies is None else f"; it came to lie at {place(lies.pose.position)}"
    departure = f"{case.truly}it left the fingers {between(start, end)}{where}"
    believed = f"the robot believed the item in the hand until {seconds(period.end)}"
    until = [believed] if period.end - end > 1.0 else []
    found = item_deviation(case, item, true, end) or _weak_grip(case, period)
    if found is not None:
        return replace(found, reasons=(*found.reasons, departure, *until), item=item, time=start)
    others = [p for p in holds_of(case, true) if p.left is None and p is not period]
    well = [f"the hand held it without slip at {listed_times([p.start for p in others])}"] if others else []
    if period.flung:
        title = f"{item} was knocked out of the hand {between(start, end)}"
        reasons = (departure, "it left the hand faster than a falling item", *well, *until)
        return Finding("item.struck", true, title, reasons, item, start)
    if (camera := explain_displaced_camera(case, item, period.start)) is not None:
        return camera  # it was gripped beside its middle
    sure: Confidence = "likely" if case.devices else "possible"
    title = f"{item} slid out of the fingers {between(start, end)}"
    title += ", though its mass and friction are those of its kind" if case.devices else ""
    blow = "the log does not show how fast the item left: something may have knocked it out"
    if not case.world.is_true and gone is not None and case.events(ImageEvent, end + FALL_TIME):
        title = f"{item} left the fingers {between(start, end)} and was not seen again"
        against = ("it may have slid out, and have come to lie where no camera sees it",)
        return Finding("item.gone", true, title, tuple(until), item, start, "possible", against)
    against = (blow,) if period.unclear else ()
    return Finding("item.slipped", true, title, (departure, *well, *until), item, start, sure, against)


def item_deviation(case: Investigation, item: str, true: str, time: float) -> Finding | None:
    """Return the finding that the item's true mass or friction differs from the catalogue; else None."""
    entry = case.entry_of(true)
    state = next((s for s in reversed(case.devices) if s.time <= time + 0.25), None)
    if entry is None or state is None:
        return None if entry is None or case.world.is_true else _weighed_deviation(case, true, entry, time)
    mass, friction = state.masses.get(true, entry.mass), state.frictions.get(true, entry.friction)
    if mass > MASS_RATIO * entry.mass:
        return _heavy(item, true, f"is heavier than its kind: it weighs {mass:.2f} kg", entry, time)
    if friction < FRICTION_RATIO * entry.friction:
        title = f"{item} is slipperier than its kind: its friction is {friction:.2f}"
        reasons = (f"by the catalogue a {entry.kind} has {entry.friction:.2f}",)
        return Finding("item.slippery", true, title, reasons, item, time)
    return None


def _heavy(item: str, about: str, words: str, entry: CatalogueEntry, time: float) -> Finding:
    reasons = (f"by the catalogue a {entry.kind} weighs {entry.mass:.2f} kg",)
    return Finding("item.heavy", about, f"{item} {words}", reasons, item, time)


def _weighed_deviation(case: Investigation, true: str, entry: CatalogueEntry, time: float) -> Finding | None:
    """Return the finding that the wrist weighed more than the catalogue says of the kind; else None."""
    names = case.believed.get(true, ())
    picks = [at for at in case.events(event_types.PickEvent, end=time + 0.25) if at.record.object in names]
    loads = [(at.record.load, at) for at in picks if at.record.held and at.record.load is not None]
    load, at = max(loads, key=lambda each: each[0], default=(0.0, None))
    if at is None or load < MASS_RATIO * entry.mass * GRAVITY + WEIGHING_NOISE:
        return None
    words = f"is heavier than its kind: the wrist weighed {load / GRAVITY:.2f} kg"
    return _heavy(at.record.object, true, words, entry, at.time)


LOAD_FAILURES = (
    "world.disturbed", "safety.force_limit", "control.tracking", "safety.payload", "insert.*", "push.*",
)  # fmt: skip
"""Failures that an item's weight may cause."""
WEIGHING_NOISE = 0.4
"""Error of a weighing in the hand, N."""


def _weak_grip(case: Investigation, period: HeldPeriod) -> Finding | None:
    """Return the finding that the grip force was too small for the item; else None."""
    entry = case.entry_of(period.true)
    assert period.left is not None
    grasps = [v for v in case.family.visits if v.id == "Grasp" and v.start <= period.start]
    around = max((v.start for v in grasps if period.start <= v.end), default=0.0)
    grip = grip_within(case, around, period.left[1])
    if grip is None or entry is None or grip.force <= 0.0:
        return None
    item, weight, holds = period.item, entry.mass * GRAVITY, 2.0 * entry.friction * grip.force
    weighs = f"a {entry.kind} weighs {force(weight)}"
    if holds < GRIP_FACTOR * weight:
        title = f"{item} was gripped with too little force: {force(grip.force)} per finger"
        fingers = f"two fingers at {force(grip.force)} and a friction of {entry.friction:g}"
        reasons = (f"{fingers} hold {force(holds)}, and {weighs}",)
        # The force is the mission's: all items that are gripped so are one cause.
        return Finding("grasp.weak", grasps[-1].path if grasps else "", title, reasons, item, grip.closed)
    if case.devices:
        return None  # mass and friction are known: they are those of its kind
    slid = f"the fingers pressed with {force(grip.force)} and the item slid out"
    pressed = f"{slid} under a load of at most {force(grip.load)}"
    should = f"with the catalogue's friction of {entry.friction:g} they would hold {force(holds)}"
    if grip.load > WEIGHT_RATIO * weight + JOLT_FORCE:
        title = f"{item} is heavier than its kind: it slipped under {force(grip.load)}"
        reasons = (f"by the catalogue {weighs}", pressed, should)
        return Finding("item.heavy", period.true, title, reasons, item, grip.closed, "possible")
    others = [p for p in holds_of(case, period.true) if p is not period]
    often = case.world.is_true or any(p.left is not None for p in others)
    if grip.load < SLIP_SHARE * holds and often and all(p.left is not None for p in others):
        most = (grip.load + 0.05) / (2.0 * grip.force)
        title = f"{item} is slipperier than its kind: its friction is at most {most:.2f}"
        return Finding("item.slippery", period.true, title, (pressed, should), item, grip.closed, "possible")
    return None


def explain_overweight(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that the held or lifted item pulled harder than its catalogue weight; else None."""
    if not any(matches(pattern, failure.cause) for pattern in LOAD_FAILURES):
        return None
    if failure.cause.startswith("push."):  # what is pushed is not in the hand
        true = case.pairs.get(failure.item, "")
        return item_deviation(case, failure.item, true, failure.time) if true else None
    held = next((b for b in case.believed_at(failure.time - 1e-3) if b.attached), None)
    entry = None if held is None else case.entry(held.id)
    if held is None or entry is None or held.id in case.identities.phantoms:
        return None
    true = case.pairs.get(held.id, held.id)
    nature = item_deviation(case, held.id, true, failure.time)
    if nature is not None and nature.cause == "item.heavy":
        return nature
    size, vertical = contact_of(failure)
    pull, down = size or 0.0, size is not None and vertical < -MIN_VERTICAL
    weight = entry.mass * GRAVITY
    if failure.cause == "safety.payload" and not down:
        words = f"weighs more than the hand may carry: {failure.message}"
        return _heavy(held.id, held.id, words, entry, failure.time)
    if down and weight > WEIGHT_SHARE * pull:
        weighs = f"{held.id} weighs {force(weight)} by the catalogue"
        title = f"{weighs}, and pulled the hand down with {force(pull)}"
        return Finding("item.heavy", held.id, title, (failure.message,), held.id, failure.time)
    if not down or pull < WEIGHT_RATIO * weight + JOLT_FORCE or (case.devices and nature is None):
        return None
    title = f"{held.id} is heavier than its kind: it pulled the hand down with {force(pull)}"
    fast = "the item was heavy or something held it fast"
    reasons = (
        f"by the catalogue a {entry.kind} weighs {force(weight)}",
        f"the hand held the item then, and the force pulled straight down: {fast}",
    )
    return Finding("item.heavy", held.id, title, reasons, held.id, failure.time, "possible")
