"""Items that the fingers could not hold: slippery, heavy, or gripped with too little force."""

from __future__ import annotations

import math

from ....world.values import GRAVITY
from ..investigation.case import Case, Finding
from ..investigation.evidence import number, numbers
from ..investigation.explanation import FailureStory
from ..investigation.number_wording import force
from .grip_history import Grip, grip_within

SLIPPERY = 0.5
"""Share of what the fingers should hold below which an item that slips must be slippery."""
HEAVY = 3.0
"""A pull of this many times the catalogue's weight is that of another weight."""
JOLT = 3.0
"""Force that lifting and braking may add to a weight, N."""
DOWNWARDS = -0.8
"""Of a contact's direction along z below which it pulls straight down."""
MARGIN = 1.3
"""The fingers should hold this many times the weight."""


def not_held(case: Case, failure: FailureStory) -> Finding | None:
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


def _grip(case: Case, failure: FailureStory) -> Grip | None:
    """From when the item was last gripped until it had slipped, which may be in another visit."""
    attached = [
        at.time
        for at in case.changes(failure.item, end=failure.time)
        if at.record.data.get("reason") == "attached to the gripper"
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


def too_heavy(case: Case, failure: FailureStory) -> Finding | None:
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
