"""Items that the fingers could not hold: slippery, heavy, or gripped with too little force."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ....world.values import GRAVITY, Array
from ..investigation.case import Finding, Investigation
from ..investigation.explanation import FailureStory, number, numbers
from ..investigation.number_wording import force

SQUEEZING = 0.5
"""Share of the greatest finger force above which the fingers are taken to press on something."""
STEADY = 3
"""Readings over which the load is averaged, so that a jolt does not count as weight."""
CLOSING = 0.002
"""Decrease of the opening beyond which the fingers count as closing, m."""
RESTING = 3
"""Readings in a row without motion that count as standing."""
STILL = 0.001
"""Motion of the fingers that is noise, m."""


@dataclass(frozen=True, slots=True)
class GripPeriod:
    """One closing of the fingers on something."""

    closed: float
    """When the fingers began to close, s."""
    force: float
    """The greatest force of a finger, N."""
    load: float
    """The greatest steady pull downwards while the fingers pressed on something, N; 0 when they never did."""
    width: float
    """Opening at the end, m."""


def grip_within(case: Investigation, start: float, end: float) -> GripPeriod | None:
    """The last closing between two times, s; None when the fingers did not close then."""
    joints, wrenches = case.run.joints, case.run.wrenches
    fingers = [n for n, name in enumerate(joints.names) if "finger" in name]
    if not fingers or not len(joints.times):
        return None
    here = np.flatnonzero((joints.times >= start - 1e-6) & (joints.times <= end + 1e-6))
    if not len(here):
        return None
    width = joints.positions[here][:, fingers].sum(axis=1)
    efforts = joints.efforts[here][:, fingers].max(axis=1)
    closed = _closing(width, efforts)
    if closed is None:
        return None
    times = joints.times[here][closed:]
    effort = efforts[closed:]
    force = float(effort.max())
    pressing = effort > SQUEEZING * force
    load = 0.0
    if force > 0.0 and bool(pressing.any()):
        steady = _steady(-wrenches.forces[:, 2])
        felt = np.interp(times, wrenches.times, steady) if len(wrenches.times) else np.zeros(len(times))
        load = max(float(felt[pressing].max()), 0.0)
    return GripPeriod(float(times[0]), force, load, float(width[-1]))


def _closing(width: Array, effort: Array) -> int | None:
    """Index at which the fingers last stood open, at rest and pressing on nothing, before they closed."""
    free = effort < SQUEEZING * max(float(effort.max()), 1.0)
    for k in range(len(width) - 1, RESTING - 1, -1):
        still = float(np.ptp(width[k - RESTING : k + 1])) < STILL
        if still and free[k] and width[k] > float(width[k:].min()) + CLOSING:
            return k
    return None


def _steady(values: Array) -> Array:
    """The least of neighbouring readings: what did not last is left out."""
    if len(values) < STEADY:
        return values
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, STEADY // 2, mode="edge"), STEADY)
    return windows.min(axis=1)


SLIPPERY = 0.5
"""Share of what the fingers should hold below which an item that slips must be slippery."""
HEAVY = 3.0
"""A pull of this many times the catalogue's weight is that of another weight."""
JOLT = 3.0
"""Force that lifting and braking may add to a weight, N."""
DOWNWARDS = -0.8
"""Component along z of a contact's direction below which it pulls straight down."""
MARGIN = 1.3
"""The fingers should hold this many times the weight."""


def grip_loss_cause(case: Investigation, failure: FailureStory) -> Finding | None:
    """Why an item that was between the fingers got away; None when it was not, or nothing tells."""
    if failure.cause != "grasp.slipped":
        return None
    entry, grip = case.entry(failure.item), _grip(case, failure)
    if grip is None or entry is None or grip.force <= 0.0:
        return None
    true = case.pairs.get(failure.item, failure.item)
    weight = entry.mass * GRAVITY
    holds = 2.0 * entry.friction * grip.force
    pressed = f"the fingers pressed with {force(grip.force)} and it slid out under at most {force(grip.load)}"
    should = f"with the catalogue's friction of {entry.friction:g} they would hold {force(holds)}"
    if holds < MARGIN * weight:
        title = f"{failure.item} was gripped with too little force: {force(grip.force)} a finger"
        reasons = (
            f"two fingers at {force(grip.force)} and a friction of {entry.friction:g} hold {force(holds)}, "
            f"and a {entry.kind} weighs {force(weight)}",
        )
        # The force is the mission's: all items that are gripped so are one cause.
        return Finding("grasp.weak", failure.node, title, reasons, failure.item, grip.closed)
    if grip.load > HEAVY * weight + JOLT:
        title = f"{failure.item} is heavier than its kind: it slipped under {force(grip.load)}"
        reasons = (f"by the catalogue a {entry.kind} weighs {force(weight)}", pressed, should)
        return Finding("item.heavy", true, title, reasons, failure.item, grip.closed)
    if grip.load < SLIPPERY * holds:
        most = (grip.load + 0.05) / (2.0 * grip.force)
        title = f"{failure.item} is slipperier than its kind: its friction is at most {most:.2f}"
        return Finding("item.slippery", true, title, (pressed, should), failure.item, grip.closed)
    return None


def _grip(case: Investigation, failure: FailureStory) -> GripPeriod | None:
    """Return the period from the last grip of the item until its slip, which may be in another visit."""
    attached = [
        at.time
        for at in case.changes(failure.item, end=failure.time)
        if at.record.reason == "attached to the gripper"
    ]
    if not attached:
        return None
    around = [
        v.start for v in case.family.visits if v.start <= attached[-1] <= v.end and v.item == failure.item
    ]
    picked = [
        p.time for p in case.run.picks if p.object == failure.item and p.time > attached[-1] and not p.held
    ]
    return grip_within(case, max(around, default=0.0), min([*picked, failure.time]))


def too_heavy(case: Investigation, failure: FailureStory) -> Finding | None:
    """Whether what the hand held, or was about to lift, pulled it down much harder than it should weigh."""
    if failure.cause not in ("world.disturbed", "safety.force_limit", "control.tracking"):
        return None
    held = next((b for b in case.believed_at(failure.time) if b.attached), None)
    entry = None if held is None else case.entry(held.id)
    if held is None or entry is None:
        return None
    pull, down = _pull(failure)
    weight = entry.mass * GRAVITY
    if not down or pull < HEAVY * weight + JOLT:
        return None
    title = f"{held.id} is heavier than its kind: it pulled the hand down with {force(pull)}"
    reasons = (
        f"by the catalogue a {entry.kind} weighs {force(weight)}",
        "the hand held it then, and the force came straight from below: it hung on the fingers "
        "or was held fast",
    )
    return Finding("item.heavy", case.pairs.get(held.id, held.id), title, reasons, held.id, failure.time)


def _pull(failure: FailureStory) -> tuple[float, bool]:
    """Force of a contact in N, and whether it pulls down."""
    vector = numbers(failure, "force")  # of a safety stop
    if len(vector) == 3:
        size = math.hypot(*vector)
        return size, size > 0.0 and vector[2] / size < DOWNWARDS
    size, direction = number(failure, "force"), numbers(failure, "direction")
    return (size, direction[2] < DOWNWARDS) if size is not None and len(direction) == 3 else (0.0, False)
