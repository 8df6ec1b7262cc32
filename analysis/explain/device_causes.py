"""Causes in devices: wrist sensor, joints, gripper, planner and cameras; several failures may share them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from picktree.logs import Stamped
from picktree.world import Array, Plan, event_types, matches

from .camera_causes import camera_frozen, camera_noisy, camera_silent, colours_mistaken, displaced_cameras
from .case import Investigation
from .explanation import Confidence, FailureStory, Finding, Spans, number, words
from .wording import between, counted, force, listed_spans, listed_times, seconds


@dataclass(frozen=True, slots=True)
class DeviceEffect:
    """Failures that a faulty device may cause."""

    failures: tuple[str, ...]
    """Patterns of their causes."""
    after: float
    """Time after the fault within which such a failure may begin, s."""

    def covers(self, finding: Finding, failure: FailureStory, start: float) -> bool:
        """Whether a failure of a visit that began at `start` may come from the device."""
        if not any(matches(pattern, failure.cause) for pattern in self.failures):
            return False
        if failure.evidence.get("joint") == finding.about:
            return failure.time >= finding.spans[0][0]
        return any(a <= failure.time + 1e-6 and start <= b + self.after for a, b in finding.spans)


PLACE_FAILURES = (
    "grasp.*", "world.*", "safety.*", "planning.start_in_collision", "planning.goal_in_collision",
    "control.*", "place.*", "perception.not_found", "push.*", "insert.*", "feed.*",
)  # fmt: skip
"""Failures that an item at a wrong place may cause."""
FORCE_FAILURES = (
    "world.disturbed", "grasp.*", "safety.*", "control.*", "place.*", "insert.*", "push.*",
    "planning.start_in_collision",
)  # fmt: skip
"""Failures that a wrong force reading of the wrist may cause."""
MOTION_FAILURES = ("control.*", "safety.*", "world.disturbed", "grasp.*", "place.*", "insert.*", "push.*")
"""Failures that a joint or an arm which does not follow may cause."""
EFFECTS: Final[Mapping[str, DeviceEffect]] = {
    "camera.silent": DeviceEffect(("perception.*", "tree.timeout"), 0.5),
    "camera.frozen": DeviceEffect((*PLACE_FAILURES, "perception.*", "tree.timeout"), 0.5),
    "camera.noisy": DeviceEffect((*PLACE_FAILURES, "perception.*", "planning.*"), 0.5),
    "camera.off": DeviceEffect(PLACE_FAILURES, 0.5),
    "perception.mistaken": DeviceEffect(
        ("perception.not_found", "world.unknown_object", "perception.ambiguous"), 3.0
    ),
    "wrist.silent": DeviceEffect(FORCE_FAILURES, 1.0),
    "wrist.biased": DeviceEffect(FORCE_FAILURES, 1.0),
    "joint.weak": DeviceEffect(MOTION_FAILURES, 10.0),
    "arm.stalled": DeviceEffect((*MOTION_FAILURES, "tree.timeout"), 3.0),
    "gripper.jammed": DeviceEffect(("control.gripper", "grasp.*", "place.*", "insert.*", "push.*"), 5.0),
    "gripper.weak": DeviceEffect(("control.gripper", "grasp.*", "place.missed", "insert.*"), 3.0),
    "planner.refuses": DeviceEffect(("planning.no_path", "grasp.no_candidate", "safety.no_retreat"), 1.0),
}
"""Effects of each faulty device, by its cause."""


def _device(
    cause: str, about: str, title: str, spans: Spans, *reasons: str, sure: Confidence = "likely"
) -> Finding:
    """Return the finding about a faulty device, from the beginning of its first span on."""
    return Finding(cause, about, title, reasons, "", spans[0][0], sure, spans=spans)


def device_findings(case: Investigation) -> tuple[Finding, ...]:
    """Return the findings about faulty devices, the most specific first."""
    return tuple(found for detect in DETECTORS for found in detect(case))


def devices_behind(case: Investigation, failure: FailureStory) -> list[Finding]:
    """Return the findings about faulty devices from which a failure may come, the most specific first."""
    start = case.visit(failure).start
    found = case.once(device_findings)
    return [each for each in found if EFFECTS[each.cause].covers(each, failure, start)]


def wrist_silent(case: Investigation) -> Iterator[Finding]:
    """Find spans without new readings of the wrist sensor: reading or time stamp does not change."""
    wrenches = case.run.wrenches
    stops = case.events(event_types.SafetyStopEvent)
    stale = {at.time for at in stops if at.record.cause == "safety.stale_sensor"}
    stale |= {f.time for f in case.failures if f.cause == "safety.stale_sensor"}
    spans: Spans = ()
    if case.run.info.backend == "physics" and len(wrenches.times) > 2:  # else it is without noise
        same = np.abs(np.diff(np.linalg.norm(wrenches.forces, axis=1))) < 1e-6
        spans = _lasting(_spans(wrenches.times[1:], same))
        spans = spans or _lasting(smooth_spans(wrenches.times, wrenches.forces))
    if stale:
        spans = spans or _spans(np.array(sorted(stale)), np.ones(len(stale), dtype=bool), 2.0)
    if spans:
        title = f"the wrist sensor was silent {listed_spans(spans)}: it gave no new readings"
        reason = "a reading always has noise, but these did not change"
        if stale:
            reason = f"the safety monitor saw no new reading at {listed_times(sorted(stale))}"
        yield _device("wrist.silent", "wrist", title, spans, reason)


def smooth_spans(times: Array, forces: Array) -> Spans:
    """Return the spans in which the readings (n, 3) have no noise.

    The last reading of a silent sensor only turns with the hand, in the axes of the world.
    """
    bends = np.asarray(np.linalg.norm(np.diff(forces, 2, axis=0), axis=1), np.float64)
    noise = bends[bends > MIN_NOISE]
    least = NOISE_SHARE * float(np.quantile(noise, REST_SHARE)) if len(noise) else 0.0
    return _spans(times[:-2], bends < least)


MIN_NOISE = 0.01
"""Second difference of readings below which they are without noise, N."""
REST_SHARE = 0.2
"""Quantile of the second differences that is due to noise alone: most of the others are accelerations."""
NOISE_SHARE = 0.1
"""Share of that quantile below which readings have lost their noise."""
MIN_SILENCE = 0.25
"""Time without a new reading that counts as silence, s."""
MIN_BIAS, SWING_FORCE = 5.0, 7.0
"""Least error of the wrist's force that counts as a bias, N: at rest, and during motions."""
MAX_JUMP = 2.0
"""Change between two readings above which a force is no bias but a swing, N."""
REST_SPEED = 0.1
"""Speed of the fastest joint below which the arm is at rest, rad/s."""


def wrist_biased(case: Investigation) -> Iterator[Finding]:
    """Find a biased wrist sensor: a hand that is far from everything feels more than what it holds, and feels
    it wherever it goes."""
    readings, gripper, joints = case.run.wrenches, case.gripper, case.run.joints
    times = readings.times
    if len(times) < 5 or not len(gripper.times):
        return
    felt = np.stack([_median_of_neighbours(axis) for axis in readings.forces.T], axis=1)
    fastest: Array = np.abs(joints.velocities).max(axis=1, initial=0.0)
    speed: Array = np.interp(times, joints.times, fastest)
    pressing = np.interp(times, gripper.times, gripper.forces) > 1.0
    holding = pressing | (not gripper.forces.any())  # a log without finger forces has none
    excess: Array = np.linalg.norm(felt, axis=1)
    steady = np.linalg.norm(np.diff(felt, axis=0, prepend=felt[:1]), axis=1) < MAX_JUMP
    holds = list(_holds(case))
    for start, end in holds:
        here = (times >= start - 0.1) & (times <= end + 0.3) & holding
        if here.any():
            load = np.median(felt[here], axis=0)
            swung = np.linalg.norm(felt[here] - load, axis=1) - float(np.linalg.norm(load))
            excess[here] = np.minimum(excess[here], swung)  # the item may leave the hand
        pressing = pressing & ~here
    for visit in case.family.visits:
        if visit.id in CONTACT_SKILLS:
            pressing |= (times >= visit.start) & (times <= visit.end)
    silent = [span for find in (wrist_silent, joint_weak) for found in find(case) for span in found.spans]
    beyond = excess > np.where(speed < REST_SPEED, MIN_BIAS, SWING_FORCE)
    lasting = [
        span for span in _lasting(_spans(times, beyond & steady & ~pressing)) if not _overlaps(span, silent)
    ]
    sizes = {span: float(np.median(excess[(times >= span[0]) & (times <= span[1])])) for span in lasting}
    sure = [
        span
        for span in lasting
        if _goes_far(case, *span)
        # What is held may be held fast, or touch something.
        or (not _overlaps(span, holds) and _steps_at_rest(span[0], times, speed))
    ]
    if sure:
        most = sizes[sure[0]]
        spans = [span for span in lasting if abs(sizes[span] - most) < SAME_BIAS * most]
        start = spans[0][0]
        title = f"the wrist sensor read {force(most)} that were not there, from {seconds(start)} on"
        reasons = (f"the hand felt this wherever it went, beyond what it held, {listed_spans(spans)}",)
        covered = ((start - 0.5, spans[-1][1]),)
        yield Finding("wrist.biased", "wrist", title, reasons, "", start, spans=covered)


def _overlaps(span: tuple[float, float], others: Iterable[tuple[float, float]]) -> bool:
    return any(start <= span[1] and span[0] <= end for start, end in others)


def _holds(case: Investigation) -> Iterator[tuple[float, float]]:
    """Yield the periods in which the robot believed that it held something."""
    for at in case.belief.tracks.values():
        held = [t for t, body in zip(at.times, at.bodies, strict=True) if body.attached]
        if held:
            yield from _spans(np.array(held), np.ones(len(held), dtype=bool), HOLD_GAP)


HOLD_GAP = 1.2
"""Interval between two messages of the belief up to which an item is held throughout, s."""
CONTACT_SKILLS = frozenset({"Push", "Insert", "Extract", "MakeRoom", "Probe", "Jog", "Stir"})
"""Skills whose hand touches things on purpose."""
SAME_BIAS = 0.2
"""Difference of two forces, as a share, up to which they are the same bias."""
FAR_WAY = 0.05
"""Motion of the hand during which no contact keeps its force, m."""
REST_TIME, STILL_SPEED = 0.16, 0.02
"""Time before a force, s, in which no joint was faster than this, rad/s, when no contact caused it."""


def _steps_at_rest(start: float, times: Array, speed: Array) -> bool:
    """Whether the arm was at rest when a force began: nothing can have been touched."""
    before = (times > start - REST_TIME) & (times <= start + 1e-6)
    return bool(before.any()) and float(speed[before].max()) < STILL_SPEED


def _goes_far(case: Investigation, start: float, end: float) -> bool:
    """Whether the hand moved far between two times."""
    hands = [hand for time in np.linspace(start, end, 8) if (hand := case.hand(float(time))) is not None]
    return any(math.dist(hands[0], hand) > FAR_WAY for hand in hands)


def _median_of_neighbours(values: Array) -> Array:
    padded = np.pad(values, 1, mode="edge")
    return np.median(np.stack([padded[:-2], padded[1:-1], padded[2:]]), axis=0)


MIN_LAG = 0.012
"""Least tracking error of a lagging joint, rad."""
LAG_RATIO = 3.0
"""Ratio of a joint's error to the largest other error above which only this joint lags."""


def joint_weak(case: Investigation) -> Iterator[Finding]:
    """Find a weak joint: it lags behind its set point, or sags, while the others follow theirs."""
    controls, joints = case.run.controls, case.run.joints
    if not controls.errors.size:
        return
    error = np.nan_to_num(np.abs(controls.errors))
    order = np.sort(error, axis=1)
    alone = (order[:, -1] > MIN_LAG) & (order[:, -1] > LAG_RATIO * order[:, -2])
    which = error.argmax(axis=1)
    arm = case.run.joint_names[0]
    for joint in sorted({int(each) for each in which[alone]}):
        here = alone & (which == joint)
        if int(here.sum()) < 2 or joint >= len(arm):
            continue
        spans = _spans(controls.times, here, 0.5)
        efforts = np.interp(controls.times[here], joints.times, joints.efforts[:, joints.column(arm[joint])])
        flat = float(np.ptp(efforts)) < 0.05 * max(float(np.abs(efforts).max()), 1.0)
        sure: Confidence = "likely" if flat else "possible"
        lagged = f"it lagged by up to {float(np.degrees(error[here, joint].max())):.1f} degrees"
        title = f"{arm[joint]} was too weak: {lagged} while the others followed"
        alone_by = f"more than {LAG_RATIO:.0f} times that of any other joint"
        reasons = [f"its error was {alone_by} {listed_spans(spans)}"]
        if flat:
            reasons.append(f"its torque stayed at {abs(float(np.median(efforts))):.0f} Nm all that time")
        yield _device("joint.weak", arm[joint], title, spans, *reasons, sure=sure)


def joint_saturated(case: Investigation) -> Iterator[Finding]:
    """Find a weak joint under torque control: its torque stays at one value while those of others change."""
    controls, joints = case.run.controls, case.run.joints
    arm = [name for name in case.run.joint_names[0] if name in joints.names]
    if not controls.errors.size or len(joints.times) < 3 or case.run.info.backend == "kinematic":
        return  # without physics torques have no limit
    compliant = np.isnan(controls.errors).all(axis=1).astype(float)
    soft = np.interp(joints.times[1:], controls.times, compliant) > 0.5
    efforts = joints.efforts[:, [joints.column(name) for name in arm]]
    change = np.abs(np.diff(efforts, axis=0))
    flat = (change < 1e-6 * np.abs(efforts).max(axis=0)) & (np.abs(efforts[1:]) > MIN_TORQUE)
    for joint, name in enumerate(arm):
        others = np.delete(change, joint, axis=1).max(axis=1) > 1e-3
        spans = _lasting(_spans(joints.times[1:], soft & flat[:, joint] & others, 0.15))
        if spans:
            torque = abs(float(np.interp(spans[0][0] + 0.05, joints.times, efforts[:, joint])))
            title = f"{name} was too weak: its torque stayed at {torque:.1f} Nm while the arm was compliant"
            reason = f"its torque did not change {listed_spans(spans)}, and those of the others did"
            yield _device("joint.weak", name, title, spans, reason)


MIN_TORQUE = 0.3
"""Torque below which a joint may be at rest without being weak, Nm."""


def arm_stalled(case: Investigation) -> Iterator[Finding]:
    """Find stalls: no joint moves although it should, and no body is in the way."""
    joints = case.run.joints
    arm = [joints.column(name) for name in case.run.joint_names[0] if name in joints.names]
    if not case.run.controls.errors.size or not arm or len(joints.times) < 3:
        return
    for find in (_stalled_on_path, _stalled_softly):
        if (found := find(case, arm)) is not None:
            start, end, reasons = found
            commanded = "though it was commanded to: no drive followed"
            title, span = f"the arm did not move from {seconds(start)} on {commanded}", (start - 0.1, end)
            yield Finding("arm.stalled", "arm", title, reasons, "", start, spans=(span,))


def _stalled_on_path(case: Investigation, arm: list[int]) -> tuple[float, float, tuple[str, ...]] | None:
    """Return start, end and evidence of a stop on a trajectory that no brake of the controller made."""
    controls, joints = case.run.controls, case.run.joints
    speeds = joints.velocities[:, arm]
    speed = np.abs(speeds)
    moving, fast = speed[:-1] > 0.04, speed[:-1] > 0.2
    drop = np.abs(np.diff(speeds, axis=0)) / np.maximum(np.diff(joints.times), 1e-3)[:, None]
    slowed = fast & (speed[1:] < 0.75 * speed[:-1])
    halted = (moving.sum(axis=1) >= MIN_JOINTS) & (slowed.sum(axis=1) >= fast.sum(axis=1) - 1)
    hard = halted & (((drop > MAX_BRAKING) & moving).sum(axis=1) >= 2)
    errors: Array = np.nan_to_num(np.abs(controls.errors))
    tracking = np.array([name == "Track" for name in controls.controllers])
    lagging: Array = ((errors > MIN_ERROR).sum(axis=1) >= MIN_JOINTS).astype(float) * tracking
    behind: Array = np.interp(joints.times[1:], controls.times, lagging)
    error = np.asarray(np.interp(joints.times[1:], controls.times, errors.max(axis=1)), dtype=np.float64)
    stuck: NDArray[np.bool_] = halted & (error > 2e-3) & (speed[1:].max(axis=1) < 2e-3)
    stops = [
        at.time for at in case.events(event_types.SafetyStopEvent) if at.record.cause == "control.tracking"
    ]
    stops += [f.time for f in case.failures if f.cause.startswith("control.t")]
    for tick in np.flatnonzero(stuck | hard | (behind > 0.5)):
        time = float(joints.times[tick + 1])
        if not stuck[tick] and not any(-0.11 < stop - time < 0.4 for stop in stops):
            continue
        if case.run.info.backend != "kinematic" and met_something(case, time):
            continue  # without physics nothing stops the arm
        rest = np.flatnonzero(speed[tick + 20 :].max(axis=1) > MIN_SPEED)
        end = float(joints.times[tick + 20 + rest[0]]) if len(rest) else case.end
        near = "nothing was near the arm" if case.world.is_true else "nothing known was near the arm"
        stopped = f"{int(moving[tick].sum())} joints stopped together, faster than they brake"
        return time, max(end, time), (stopped, f"{case.truly}{near}")
    return None


def _stalled_softly(case: Investigation, arm: list[int]) -> tuple[float, float, tuple[str, ...]] | None:
    """Return start, end and evidence of a compliant arm that rests though it is to follow a path."""
    controls, joints = case.run.controls, case.run.joints
    soft = np.array([name in SOFT_CONTROLLERS for name in controls.controllers]).astype(float)
    follows = np.array([name == "SoftTrack" for name in controls.controllers])
    still = np.abs(np.diff(joints.positions[:, arm], axis=0)).max(axis=1) < STILL_WAY
    wanted = np.interp(joints.times[1:], controls.times, soft) > 0.5
    for start, end in _spans(joints.times[1:], still & wanted, 0.5):
        tracked = follows[(controls.times >= start) & (controls.times <= end)]
        if end - start < MIN_STALL or not tracked.any() or met_something(case, (start + end) / 2):
            continue
        moved = f"did not move {between(start, end)}"
        return start, end, (f"it was to follow a path compliantly, felt nothing, and {moved}",)
    return None


SOFT_CONTROLLERS = ("Comply", "SoftTrack")
"""Controllers that give way, by their names in the log."""
STILL_WAY, MIN_STALL = 2e-5, 1.0
"""Motion of a joint within a tick below which it is at rest, rad; least duration of a stall, s."""


def met_something(case: Investigation, time: float) -> bool:
    """Whether a body stopped the arm: an obstacle near it, or an item at a hand that feels it."""
    readings = case.run.wrenches
    here = np.abs(readings.times - time) < CONTACT_TIME
    felt = float(np.linalg.norm(readings.forces[here], axis=1).max()) if bool(here.any()) else 0.0
    return bool(case.obstacles_near(time)) or (felt > CONTACT_FORCE and case.something_near(time))


CONTACT_TIME, CONTACT_FORCE = 0.2, 4.0
"""Time around a stop in which the wrist feels a contact at the hand, s, and the least force of one, N."""
MIN_JOINTS = 3
"""Least number of joints in motion before a stall."""
MIN_SPEED = 0.3
"""Speed above which a joint follows its commands again, rad/s."""
MIN_ERROR = 0.01
"""Least tracking error of a stalled joint, rad."""
MAX_BRAKING = 18.0
"""Deceleration that no brake of the arm's controller commands, rad/s²."""


def gripper_faulty(case: Investigation) -> Iterator[Finding]:
    """Find gripper failures: the fingers do not follow the command, or press with too little force."""
    for failure in case.failures:
        if failure.cause != "control.gripper":
            continue
        commanded, pressed = number(failure, "told"), number(failure, "force") or 0.0
        cause, title = "gripper.jammed", _are_stuck(number(failure, "width") or 0.0)
        if commanded is not None and (number(failure, "moved") or 0.0) > 2e-3:
            felt = f"{force(pressed)} instead of {force(commanded)}"
            cause, title = "gripper.weak", f"the gripper is too weak: its fingers press with {felt}"
        span = (case.visit(failure).start, failure.time)
        yield Finding(cause, "gripper", title, (failure.message,), "", failure.time, spans=(span,))


def _are_stuck(width: float) -> str:
    return f"the fingers are stuck at {1000 * width:.0f} mm: they did not follow the command"


def fingers_stuck(case: Investigation) -> Iterator[Finding]:
    """Find fingers that do not move in a step that closes or opens them."""
    gripper, spans = case.gripper, list[tuple[float, float]]()
    for step in sorted((*case.steps("close"), *case.steps("release")), key=lambda step: step.start):
        here = (gripper.times >= step.start - 1e-6) & (gripper.times <= step.end + 1e-6)
        widths, forces = gripper.widths[here], gripper.forces[here]
        long = step.end - step.start > MIN_STEP_TIME and len(widths) > 2
        presses = step.name == "close" and len(forces) and float(forces[-1]) > 1.0
        if long and float(np.ptp(widths)) < 1e-3 and not presses:
            spans.append((step.start, step.end))
    if spans:
        title = _are_stuck(float(np.interp(spans[0][0], gripper.times, gripper.widths)))
        reason = f"the command was to move, and they did not {listed_spans(spans)}"
        yield _device("gripper.jammed", "gripper", title, tuple(spans), reason)


MIN_STEP_TIME = 0.4
"""Least duration of a step in which fingers must have moved, s."""


def fingers_press_too_little(case: Investigation) -> Iterator[Finding]:
    """Find a weak gripper by its picks, each of which names the commanded force.

    A log without any finger force has none, such as that of some fingers with a linkage.
    """
    gripper, found = case.gripper, list[tuple[float, float]]()
    for at in case.events(event_types.PickEvent) if gripper.forces.any() else ():
        here = (gripper.times > at.time - 0.3) & (gripper.times <= at.time + 1e-6)
        told, width = at.record.force, at.record.width or 0.0
        if told and width > case.least_width + 0.004 and here.any():
            share = float(np.median(gripper.forces[here])) / told
            found += [(at.time, share)] if share < WEAK_SHARE else []
    if found:
        share = float(np.median([share for _, share in found]))
        title = f"the gripper presses with {100 * share:.0f} % of the commanded force"
        reasons = (f"its fingers held something with that force at {listed_times([t for t, _ in found])}",)
        spans = tuple((time - 1.0, time) for time, _ in found)
        yield Finding("gripper.weak", "gripper", title, reasons, "", found[0][0], spans=spans)


WEAK_SHARE = 0.6
"""Share of the commanded finger force below which a gripper is weak."""
SAME_PLACE = 0.2
"""Distance below which two start configurations count as equal for a planner, rad."""


def planner_refuses(case: Investigation) -> Iterator[Finding]:
    """Find planner refusals: no path, and no body that blocks it."""

    def request(text: str) -> str:
        return re.sub(r"[\d.]+", "#", text)

    def same(one: Stamped[Plan], other: Stamped[Plan]) -> bool:
        a, b = one.record, other.record
        if len(a.start) != len(b.start) or request(a.request) != request(b.request):
            return False
        return float(np.abs(np.subtract(a.start, b.start)).max()) < SAME_PLACE

    blind = any(
        failure.cause == "planning.no_path"
        and not (words(failure, "pairs") or failure.evidence.get("joint"))
        and (number(failure, "fraction") or 0.0) <= 0.02
        for failure in case.failures
    )
    refused = [at for at in case.run.plans if at.record.outcome == "planning.no_path"]
    if not blind or not refused:
        return
    found = [at for at in case.run.plans if at.record.outcome == "found" and at.record.start]
    again = any(at.time > before.time and same(before, at) for before in refused for at in found)
    span = (refused[0].time, refused[-1].time)
    often = counted(len(refused), "time")
    title = f"the planner found no way {often} {between(*span)}, though nothing was in the way"
    reasons = ["the planner names nothing that the arm or the hand would touch"]
    if again:
        reasons.append("the planner later found the paths that it had refused, from the same place")
    sure: Confidence = "likely" if again else "possible"
    yield _device("planner.refuses", "planner", title, (span,), *reasons, sure=sure)


DETECTORS: tuple[Callable[[Investigation], Iterable[Finding]], ...] = (
    wrist_silent, arm_stalled, wrist_biased, joint_weak, joint_saturated, gripper_faulty, fingers_stuck,
    fingers_press_too_little, camera_silent, planner_refuses, camera_frozen, camera_noisy, displaced_cameras,
    colours_mistaken,
)  # fmt: skip


def _lasting(spans: Spans) -> Spans:
    return tuple(span for span in spans if span[1] - span[0] > MIN_SILENCE)


def _spans(times: Array, where: NDArray[np.bool_], gap: float = 0.3) -> Spans:
    """Return the spans in which a condition held, joined over gaps."""
    found: list[tuple[float, float]] = []
    for time in times[where]:
        if found and time - found[-1][1] <= gap:
            found[-1] = (found[-1][0], float(time))
        else:
            found.append((float(time), float(time)))
    return tuple(found)
