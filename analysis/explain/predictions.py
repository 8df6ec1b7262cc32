"""Predictions of hypotheses: what a log must have, or must not have, where a cause is the true one.

Each prediction is tested on the log. One that does not hold is evidence against its cause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from picktree.files import listed
from picktree.world import GRAVITY, event_types, matches

from .case import Investigation
from .device_causes import MIN_BIAS, WEAK_SHARE, met_something
from .explanation import FailureStory, Finding, between, counted, force, listed_times, number, seconds
from .held_items import MASS_RATIO, WEIGHING_NOISE, held_periods
from .identities import MAX_AGE

Refutation: TypeAlias = Callable[[Investigation, FailureStory, Finding], str]
"""Test on the log: the record that contradicts a finding on a failure, in words; empty without one."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """Record that the log must have, or must not have, where a cause is the true one."""

    causes: tuple[str, ...]
    """Patterns of the causes that predict it."""
    words: str
    refute: Refutation


def refutations(case: Investigation, failure: FailureStory, finding: Finding) -> tuple[str, ...]:
    """Return the records that contradict a finding on a failure, in words."""
    predicted = (p for p in PREDICTIONS if any(matches(pattern, finding.cause) for pattern in p.causes))
    return tuple(words for prediction in predicted if (words := prediction.refute(case, failure, finding)))


def _within(finding: Finding, time: float) -> bool:
    return any(start - MAX_AGE <= time <= end for start, end in finding.spans)


def _seen_without_fault(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    start = case.visit(failure).start
    seen = [each.time for each in case.identities.by_item.get(failure.item, ()) if each.time <= start + 1e-6]
    if not seen or _within(finding, seen[-1]):
        return ""
    return f"{failure.item} was last seen at {seconds(seen[-1])}, in an image without this fault"


def _gripped_as_seen(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    """Return the items that were gripped at once where an image with the fault showed them."""
    found: dict[str, None] = {}
    for at in case.events(event_types.PickEvent):
        item = at.record.object
        seen = [each.time for each in case.identities.by_item.get(item, ()) if each.time < at.time]
        if at.record.held and at.record.first_try and seen and _within(finding, seen[-1]):
            found[item] = None
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
    end = finding.spans[0][1]
    start = max(finding.spans[0][0], end - STUCK_TIME)
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
    found = [
        period.start
        for period in case.once(held_periods)
        if period.true == finding.about and period.left is None and period.end - period.start > 1.0
        and period.start >= (finding.time or 0.0)
    ]  # fmt: skip
    return f"the hand held it without slip at {listed_times(found)}" if found else ""


def _found_later(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    later = [
        each.time
        for item in case.believed.get(finding.about, ())
        for each in case.identities.by_item.get(item, ())
        if each.time > (finding.time or 0.0) + 2 * case.sampled + MAX_AGE and each.true == finding.about
    ]
    return f"it was seen at {seconds(min(later))}" if later else ""


def _gripped(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    picks = [
        at.time
        for at in case.events(event_types.PickEvent)
        if at.record.object == finding.item and at.record.held
    ]
    return f"the hand held it at {listed_times(picks)}" if picks else ""


def _hand_was_empty(case: Investigation, failure: FailureStory, finding: Finding) -> str:
    width = number(failure, "width")
    empty = failure.cause == "grasp.missed" and width is not None and width > case.least_width + 0.004
    return f"the fingers closed on something {1000 * (width or 0.0):.0f} mm wide" if empty else ""


PREDICTIONS: Final[tuple[Prediction, ...]] = (
    Prediction(
        ("camera.off", "camera.noisy", "camera.frozen"), "the item was last seen in an image with the fault",
        _seen_without_fault,
    ),
    Prediction(
        ("camera.noisy",), "no item is gripped at once where such an image shows it",
        _gripped_as_seen,
    ),
    Prediction(("wrist.biased",), "the readings are not small while the bias lasts", _feels_nothing),
    Prediction(("gripper.jammed",), "the fingers do not move", _fingers_move),
    Prediction(("gripper.weak",), "no pick has the commanded force", _presses_fully),
    Prediction(("joint.weak", "arm.stalled"), "nothing touches the arm when it stops", _arm_met_something),
    Prediction(("planner.refuses",), "no other path is found meanwhile", _finds_paths),
    Prediction(("item.heavy",), "no weighing agrees with the catalogue", _weighed_as_its_kind),
    Prediction(("item.slippery",), "no hold without slip follows", _held_well),
    Prediction(("item.gone",), "no look shows the item later", _found_later),
    Prediction(("item.gone",), "the fingers close on nothing", _hand_was_empty),
    Prediction(("perception.phantom",), "no grip holds the item", _gripped),
)  # fmt: skip
"""Predictions of all causes."""
