"""Predictions of hypotheses: what a log must have, or must not have, where a cause is the true one.

Each prediction is tested on the log. One that does not hold is evidence against its cause.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np

from picktree.files import listed
from picktree.world import GRAVITY, event_types, matches

from .case import Investigation
from .device_causes import MIN_BIAS, WEAK_SHARE, met_something
from .explanation import FailureStory, Finding, number
from .held_items import MASS_RATIO, WEIGHING_NOISE, holds_of
from .identities import MAX_AGE
from .wording import between, counted, force, listed_times, seconds

Refutation: TypeAlias = Callable[[Investigation, FailureStory, Finding], str]
"""Test on the log: the record that contradicts a finding on a failure, in words; empty without one."""


def refutations(case: Investigation, failure: FailureStory, finding: Finding) -> tuple[str, ...]:
    """Return the records that contradict a finding on a failure, in words."""
    predicted = (test for causes, test in PREDICTIONS if any(matches(each, finding.cause) for each in causes))
    return tuple(words for refute in predicted if (words := refute(case, failure, finding)))


def _within(finding: Finding, time: float) -> bool:
    return any(start - MAX_AGE <= time <= end for start, end in finding.spans)


def _last_seen(case: Investigation, item: str, until: float) -> float | None:
    seen = [each.time for each in case.identities.by_item.get(item, ()) if each.time < until]
    return seen[-1] if seen else None


def _seen_without_fault(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    seen = _last_seen(case, failure.item, case.visit(failure).start + 1e-6)
    if seen is None or _within(finding, seen):
        return ""
    return f"{failure.item} was last seen at {seconds(seen)}, in an image without this fault"


def _gripped_as_seen(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    """Return the items that were gripped at once where an image with the fault showed them."""
    found: dict[str, None] = {}
    for at in case.events(event_types.PickEvent):
        seen = _last_seen(case, at.record.object, at.time)
        if at.record.held and at.record.first_try and seen is not None and _within(finding, seen):
            found[at.record.object] = None
    words = "was gripped at once where such an image showed it"
    if len(found) > 1:
        words = "were gripped at once where such images showed them"
    return f"{listed(list(found), 3)} {words}" if found else ""


def _feels_nothing(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    readings, (start, end) = case.run.wrenches, finding.spans[0]
    sizes = np.linalg.norm(readings.forces, axis=1)[(readings.times > start + 0.5) & (readings.times < end)]
    if not len(sizes) or float(np.median(sizes)) >= MIN_BIAS / 2:
        return ""
    return f"the sensor mostly read less than {force(MIN_BIAS / 2)} {between(start + 0.5, end)}"


def _fingers_move(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    start, end = finding.spans[0]
    start = max(start, end - STUCK_TIME)
    here = (case.gripper.times >= start) & (case.gripper.times <= end)
    way = float(np.ptp(case.gripper.widths[here])) if here.any() else 0.0
    return f"the fingers moved by {1000 * way:.0f} mm {between(start, end)}" if way > MIN_FINGER_WAY else ""


STUCK_TIME, MIN_FINGER_WAY = 0.3, 5e-3
"""Last part of a jam in which its fingers do not move, s, and the least motion that counts, m."""


def _presses_fully(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    gripper, found = case.gripper, list[float]()
    for at in case.events(event_types.PickEvent, finding.spans[0][0], finding.spans[-1][1]):
        here = (gripper.times > at.time - 0.3) & (gripper.times <= at.time + 1e-6)
        told = at.record.force or 0.0
        if at.record.held and here.any() and float(np.median(gripper.forces[here])) > WEAK_SHARE * told > 0.0:
            found.append(at.time)
    return f"the fingers pressed with the commanded force at {listed_times(found)}" if found else ""


def _arm_met_something(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    time = finding.spans[0][0]
    if case.run.info.backend == "kinematic" or not met_something(case, time):
        return ""
    return f"something was at the arm or the hand at {seconds(time)}, and may have held the joint"


def _finds_paths(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    start, end = finding.spans[0]
    found = [at for at in case.run.plans if start < at.time < end and at.record.outcome == "found"]
    return f"the planner found {counted(len(found), 'other path')} meanwhile" if found else ""


def _weighed_as_its_kind(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    names = case.believed.get(finding.about, (finding.item,))
    entry = case.entry_of(finding.about)
    weight = 0.0 if entry is None else entry.mass * GRAVITY
    for at in case.events(event_types.PickEvent, start=finding.time or 0.0):
        load = at.record.load if at.record.object in names and at.record.held else None
        if load is not None and weight > 2 * WEIGHING_NOISE and load < MASS_RATIO * weight:
            return f"the wrist weighed {load / GRAVITY:.2f} kg at {seconds(at.time)}"
    return ""


def _held_well(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    stayed = (p for p in holds_of(case, finding.about) if p.left is None and p.end - p.start > 1.0)
    found = [period.start for period in stayed if period.start >= (finding.time or 0.0)]
    return f"the hand held it without slip at {listed_times(found)}" if found else ""


def _found_later(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    since, by_item = (finding.time or 0.0) + 2 * case.sampled + MAX_AGE, case.identities.by_item
    sightings = (each for item in case.believed.get(finding.about, ()) for each in by_item.get(item, ()))
    later = [each.time for each in sightings if each.time > since and each.true == finding.about]
    return f"it was seen at {seconds(min(later))}" if later else ""


def _gripped(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    picks = case.events(event_types.PickEvent)
    held = [at.time for at in picks if at.record.object == finding.item and at.record.held]
    return f"the hand held it at {listed_times(held)}" if held else ""


def _hand_was_empty(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    width = number(failure, "width")
    something = failure.cause == "grasp.missed" and width is not None and width > case.least_width + 0.004
    return f"the fingers closed on something {1000 * (width or 0.0):.0f} mm wide" if something else ""


PREDICTIONS: Final[tuple[tuple[tuple[str, ...], Refutation], ...]] = (
    (("camera.off", "camera.noisy", "camera.frozen"), _seen_without_fault),
    (("camera.noisy",), _gripped_as_seen),
    (("wrist.biased",), _feels_nothing),
    (("gripper.jammed",), _fingers_move),
    (("gripper.weak",), _presses_fully),
    (("joint.weak", "arm.stalled"), _arm_met_something),
    (("planner.refuses",), _finds_paths),
    (("item.heavy",), _weighed_as_its_kind),
    (("item.slippery",), _held_well),
    (("item.gone",), _found_later),
    (("item.gone",), _hand_was_empty),
    (("perception.phantom",), _gripped),
)
"""Patterns of the causes that predict something, and the test for its refutation."""
