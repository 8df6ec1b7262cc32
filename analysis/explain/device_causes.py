"""Causes in devices: camera, wrist sensor, joint, gripper or planner; several failures may share them."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from picktree.files import listed
from picktree.logs import CameraImage, Stamped
from picktree.robot.perception import PosedCamera, depth_noise, noise_factor
from picktree.world import Array, event_types, extents

from .case import ARM_RANGE, Investigation
from .explanation import (
    Confidence,
    DeviceFinding,
    Finding,
    between,
    counted,
    distance,
    force,
    listed_spans,
    listed_times,
    number,
    place,
    seconds,
    words,
)
from .identities import MAX_AGE, Sighting

PLACE_FAILURES = (
    "grasp.*", "world.*", "safety.*", "planning.start_in_collision", "planning.goal_in_collision",
    "control.*", "place.*", "perception.not_found", "push.*", "insert.*",
)  # fmt: skip
"""Failures that an item at a wrong place may cause."""


def camera_silent(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a camera that returns no image, the same image again, or an image that is too noisy."""
    for failure in case.failures:
        if failure.cause != "perception.no_image":
            continue
        name = str(failure.evidence.get("camera", "")) or case.camera
        start = case.visit(failure).start
        cause, title = "camera.silent", f"no image came from the camera {name}, from {seconds(start)} on"
        if (still := number(failure, "frozen")) is not None:
            start = max(failure.time - still, 0.0)
            cause, title = "camera.frozen", _stands_still(name, start)
        elif (factor := number(failure, "noise")) is not None:
            cause, title = "camera.noisy", _is_noisy(name, factor)
        yield DeviceFinding(
            Finding(cause, name, title, (failure.message,), "", start),
            ((start, failure.time),), ("perception.*", "tree.timeout"), 0.5,
        )  # fmt: skip


def _stands_still(camera: str, start: float) -> str:
    return f"the image of the camera {camera} was frozen, from {seconds(start)} on"


def _is_noisy(name: str, factor: float) -> str:
    return f"the camera {name} is {factor:.0f} times as noisy as it should be"


MAX_IMAGES = 24
"""Maximum number of examined images of a run."""


def looks(case: Investigation) -> tuple[Stamped[CameraImage], ...]:
    """Return images of the fixed cameras, spread over the run."""
    shots = case.run.images
    fixed = {c.name for c in case.scene.cameras if c.on != "hand"} if case.scene else set[str]()
    theirs = [n for n, camera in enumerate(shots.cameras) if camera in fixed]
    chosen = sorted({int(n) for n in np.linspace(0, len(theirs) - 1, min(len(theirs), MAX_IMAGES))})
    return tuple(shots[theirs[n]] for n in chosen)


MIN_HEIGHT = 0.1
"""Height above an item's top from which a body in the image hides the item, m."""


def explain_hidden_by_arm(case: Investigation, true: str) -> Finding | None:
    """Return the finding that the arm hid an item from the fixed cameras in all images of its place."""
    cameras = {c.name: c for c in case.scene.cameras} if case.scene else {}
    found: list[tuple[Stamped[CameraImage], float]] = []
    for shot in case.once(looks):
        body, image = case.truth.at(true, shot.time), shot.record
        if body is None:
            continue
        sight = PosedCamera.at(image.intrinsics, cameras[image.camera].pose)
        top = np.array(body.pose.position)
        top[2] += extents(body.shape, body.pose.rotation())[1][2]
        ((column, row),) = pixels = np.rint(sight.pixels(top[None])).astype(np.int64)
        if not (0 <= column < image.intrinsics.width and 0 <= row < image.intrinsics.height):
            continue
        depth = float(image.depth[row, column])
        shown = sight.origin + sight.directions(pixels.astype(np.float64))[0] * depth
        links = case.links(shot.time)
        arm = len(links) > 0 and float(np.linalg.norm(links - shown, axis=1).min()) < ARM_RANGE
        if depth <= 0.0 or shown[2] < top[2] + MIN_HEIGHT or not arm:
            return None
        found.append((shot, float(shown[2] - top[2])))
    if not found:
        return None
    shot, height = found[0]
    camera, robot = shot.record.camera, case.run.info.robot
    title = f"the arm hides items on the table from the camera {camera}"
    at = case.truth.tracks[true].first.pose.position
    reasons = (
        f"{case.name_of(true)} lies at {place(at)}: the image of {seconds(shot.time)} shows the arm there, "
        f"{distance(height)} above it",
        f"{counted(len(found), 'image')} of its place, but none shows the item",
        "what to change: the arm's pose during the look, mostly 'home' under 'poses:' in the robot file of "
        f"{robot}; `picktree robot test` measures what the arm hides",
    )
    return Finding("arm.hides_items", camera, title, reasons, case.name_of(true), shot.time)


LEAST_NOISE = 5e-4
"""Noise of a depth image above which no two logged images are equal, m: the log has steps of 1 mm."""
IMAGE_DELAY = 0.5
"""Time after its capture within which an image is in the log, s."""
MIN_SHIFT = 0.02
"""Least displacement of an item that changes an image, m."""


def camera_frozen(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a frozen camera: it repeats an image despite its noise, or despite moved items."""
    shots: dict[str, list[Stamped[CameraImage]]] = defaultdict(list)
    for shot in case.once(looks):
        shots[shot.record.camera].append(shot)
    for name, taken in shots.items():
        same = [(a, b) for a, b in pairwise(taken) if np.array_equal(a.record.depth, b.record.depth)]
        noisy = [(a, b) for a, b in same if depth_noise(a.record.depth)[0] > LEAST_NOISE]
        frozen = noisy or [pair for pair in same if _shifted(case, pair[0].time, pair[1].time)]
        if frozen:
            start, end = frozen[0][0].time, frozen[-1][1].time
            why = "and the camera has noise" if noisy else "though items were moved"
            reasons = (f"its images of {seconds(start)} and {seconds(end)} are the same, {why}",)
            yield DeviceFinding(
                Finding("camera.frozen", name, _stands_still(name, start), reasons, "", start),
                ((start, end),), (*PLACE_FAILURES, "perception.*", "tree.timeout"), 20.0,
            )  # fmt: skip


def _shifted(case: Investigation, start: float, end: float) -> bool:
    """Whether an item of one image was truly at another place at the time of the next image."""
    shown = {each.true for each in case.identities.sightings if -IMAGE_DELAY <= each.time - start < MAX_AGE}
    moved = ((case.truth.at(true, start), case.truth.at(true, end)) for true in shown - {""})
    return any(a and (not b or math.dist(a.pose.position, b.pose.position) > MIN_SHIFT) for a, b in moved)


def camera_noisy(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a noisy camera: its depth images scatter far more than its specified noise."""
    cameras = {c.name: c for c in case.scene.cameras} if case.scene else {}
    spans: dict[str, list[tuple[float, float]]] = defaultdict(list)
    worst: dict[str, float] = {}
    for shot in case.once(looks):
        camera = cameras[shot.record.camera]
        if factor := noise_factor(shot.record.depth, camera.depth_noise):
            spans[camera.name].append((shot.time, shot.time))
            worst[camera.name] = max(worst.get(camera.name, 0.0), factor)
    for name, times in spans.items():
        title = _is_noisy(name, worst[name])
        reasons = (
            f"its depth was as noisy as this in {counted(len(times), 'image')}, {listed_spans(times)}",
        )
        yield DeviceFinding(
            Finding("camera.noisy", name, title, reasons, "", times[0][0]), tuple(times),
            (*PLACE_FAILURES, "perception.*", "planning.*"), 20.0,
        )  # fmt: skip


MIN_OFFSET = 0.006
"""Mean offset of belief from truth above which the camera is the cause, m."""
MAX_SCATTER = 0.5
"""Maximum scatter of the offsets of single items, as a share of their mean."""


def camera_off(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a displaced camera: all items appear with the same offset."""
    seen = [each for each in case.identities.sightings if each.true]
    looks: dict[float, list[Sighting]] = defaultdict(list)
    for each in seen:
        looks[each.time].append(each)
    found: list[tuple[float, list[Sighting]]] = []
    for time, sightings in sorted(looks.items()):
        ways = np.array([each.off for each in sightings])
        mean = np.median(ways, axis=0)
        size = float(np.linalg.norm(mean))
        scatter = float(np.median(np.linalg.norm(ways - mean, axis=1)))
        before = found[-1][1] if found else []
        alike = len(ways) > 1 or any(math.dist(b.off, ways[0]) < MAX_SCATTER * size for b in before)
        if size > MIN_OFFSET and scatter < MAX_SCATTER * size and alike:
            found.append((time, sightings))
    ways = np.array([each.off for _, sightings in found for each in sightings])
    items = sorted({each.item for _, sightings in found for each in sightings})
    if len(items) < 2:
        return
    x, y = np.median(ways, axis=0)
    times = [time for time, _ in found]
    spans = _runs(times, sorted(looks))
    title = (
        f"every object is believed {distance(math.hypot(x, y))} from its true place: the true pose of the "
        f"camera {case.camera} differs from the believed one"
    )
    reasons = (
        f"{len(items)} items lay {distance(abs(float(x)))} in x and {distance(abs(float(y)))} in y "
        f"from where they were seen, in the same direction ({listed(items, 4)})",
    )
    yield DeviceFinding(
        Finding("camera.off", f"the camera {case.camera}", title, reasons, "", times[0]),
        spans,
        PLACE_FAILURES,
        0.5,
    )


def cameras_off(case: Investigation) -> tuple[DeviceFinding, ...]:
    """Return the findings about cameras that are not at their believed poses."""
    return tuple(camera_off(case))


def explain_displaced_camera(case: Investigation, item: str, time: float) -> Finding | None:
    """Return the finding about a displaced camera whose image was the last of the item before that time."""
    seen = [each for each in case.identities.by_item.get(item, ()) if each.time <= time + 1e-6]
    if not seen or math.hypot(*seen[-1].off) < MIN_OFFSET:
        return None
    last = seen[-1].time
    return next(
        (off.finding for off in case.once(cameras_off) if any(abs(a - last) < 1e-6 for a, _ in off.spans)),
        None,
    )


def _runs(times: Iterable[float], looks: list[float]) -> tuple[tuple[float, float], ...]:
    """Return the span from each time to the next look; the belief does not change in between."""
    found: list[tuple[float, float]] = []
    for time in times:
        after = next((look for look in looks if look > time + 1e-6), math.inf)
        found.append((time, after))
    return tuple(found)


COLOUR_FAILURES = ("perception.not_found", "world.unknown_object", "perception.ambiguous")
"""Failures that a wrong colour may cause."""


def colours_mistaken(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a camera that shows items of one colour in another."""
    wrong: dict[tuple[str, str], list[Sighting]] = defaultdict(list)
    for each in case.identities.sightings:
        if each.body is not None and each.body.colour != each.seen.colour:
            wrong[each.body.colour, each.seen.colour].append(each)
    for (colour, shown), sightings in wrong.items():
        items = list(dict.fromkeys(each.item for each in sightings))
        first, start = sightings[0].body, sightings[0].time
        assert first is not None
        title = (
            f"{listed(items, 5)} {'was' if len(items) == 1 else 'were'} taken for {shown} and "
            f"{'is' if len(items) == 1 else 'are'} {colour}"
        )
        reasons = (
            f"the camera {case.camera} showed {colour} as {shown} {between(start, sightings[-1].time)}",
        )
        yield DeviceFinding(
            Finding("perception.mistaken", f"{colour} as {shown}", title, reasons, items[0], start),
            ((start, sightings[-1].time),), COLOUR_FAILURES, 3.0,
        )  # fmt: skip


FORCE_FAILURES = (
    "world.disturbed",
    "grasp.*",
    "safety.*",
    "control.*",
    "place.*",
    "planning.start_in_collision",
)
"""Failures that a wrong force reading of the wrist may cause."""


def device_findings(case: Investigation) -> tuple[DeviceFinding, ...]:
    """Return the findings about faulty devices, the most specific first."""
    return tuple(found for detect in DETECTORS for found in detect(case))


def wrist_silent(case: Investigation) -> Iterator[DeviceFinding]:
    """Find spans without new readings of the wrist sensor: reading or time stamp does not change."""
    wrenches = case.run.wrenches
    stale = [
        at.time for at in case.events(event_types.SafetyStopEvent) if at.record.cause == "safety.stale_sensor"
    ]
    stale += [f.time for f in case.failures if f.cause == "safety.stale_sensor"]
    spans: tuple[tuple[float, float], ...] = ()
    if case.run.info.backend == "physics" and len(wrenches.times) > 2:  # else it is without noise
        same = np.abs(np.diff(np.linalg.norm(wrenches.forces, axis=1))) < 1e-6
        spans = _lasting(_spans(wrenches.times[1:], same))
        spans = spans or _lasting(smooth_spans(wrenches.times, wrenches.forces))
    if stale:
        spans = spans or _spans(np.array(sorted(set(stale))), np.ones(len(set(stale)), dtype=bool), 2.0)
    if not spans:
        return
    title = f"the wrist sensor was silent {listed_spans(spans)}: it gave no new readings"
    reasons = ("a reading always has noise, but these did not change",) if not stale else (
        f"the safety monitor saw no new reading at {listed_times(sorted(set(stale)))}",
    )  # fmt: skip
    yield DeviceFinding(
        Finding("wrist.silent", "wrist", title, reasons, "", spans[0][0]), spans, FORCE_FAILURES
    )


def smooth_spans(times: Array, forces: Array) -> tuple[tuple[float, float], ...]:
    """Return the spans in which the readings (n, 3) have no noise.

    The last reading of a silent sensor only turns with the hand, in the axes of the world.
    """
    bends = np.asarray(np.linalg.norm(np.diff(forces, 2, axis=0), axis=1), np.float64)
    noise = bends[bends > MIN_NOISE]
    return (
        _spans(times[:-2], bends < NOISE_SHARE * float(np.quantile(noise, REST_SHARE))) if len(noise) else ()
    )


MIN_NOISE = 0.01
"""Second difference of readings below which they are without noise, N."""
REST_SHARE = 0.2
"""Quantile of the second differences that is due to noise alone: most of the others are accelerations."""
NOISE_SHARE = 0.1
"""Share of that quantile below which readings have lost their noise."""
MIN_SILENCE = 0.25
"""Time without a new reading that counts as silence, s."""
MIN_BIAS = 5.0
"""Least error of the wrist's force that counts as a bias, N."""


def wrist_biased(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a biased wrist sensor: a lasting step between its readings and the true forces."""
    states = [s for s in case.devices if s.wrench]
    readings, gripper = case.run.wrenches, case.run.gripper
    at_rest = case.run.info.continues is None and case.run.log.part == 1
    if len(states) < 5 or not len(readings.times) or not at_rest:
        return
    times = np.array([s.time for s in states])
    here = np.clip(np.searchsorted(readings.times, times - 1e-6), 0, len(readings.times) - 1)
    true = np.array([s.wrench[:3] for s in states])
    read = readings.forces[here] - (true - true[0])  # the arm begins at rest, with an empty hand
    pressing = np.interp(times, gripper.times, gripper.forces) > 1.0 if len(gripper.times) else times < 0.0
    learnt = np.array([s.learnt for s in states])
    knows: NDArray[np.bool_] = np.abs(learnt).max(axis=1) > 0.0
    first = int(np.argmax(knows))  # the sensor's own bias, learnt at the start
    off = _sizes(read + learnt - np.where(knows[:, None], learnt[first], 0.0), pressing)
    still = np.array([s.speed < REST_SPEED for s in states])
    silent = [span for found in wrist_silent(case) for span in found.spans]
    lasting = _lasting(_spans(times, (off > MIN_BIAS) & (still | (off > SWING_FORCE))))
    spans = [(a, b) for a, b in lasting if not any(x <= b and a <= y for x, y in silent)]
    if spans:
        start, end = spans[0]
        most = float(np.median(off[(times >= start) & (times <= end)]))
        title = f"the wrist sensor read {force(most)} that were not there, from {seconds(start)} on"
        reasons = (f"its reading differed by this much from the true force {listed_spans(spans)}",)
        yield DeviceFinding(
            Finding("wrist.biased", "wrist", title, reasons, "", start),
            ((start - 0.5, spans[-1][1]),),
            FORCE_FAILURES,
        )


SWING_FORCE = 7.0
"""Error of the wrist's force that counts as a bias even during motions, N."""


def _sizes(error: Array, pressing: NDArray[np.bool_]) -> Array:
    """Return the sizes of lasting errors, N. Mutual displacement of pressing fingers is no error."""
    error = np.stack([median_of_neighbours(axis) for axis in error.T], axis=1)
    sizes: Array = np.linalg.norm(error, axis=1)
    sizes[pressing] = np.abs(error[pressing, 2])
    return sizes


def median_of_neighbours(values: Array) -> Array:
    """Return the median of each value and its neighbours."""
    padded = np.pad(values, 1, mode="edge")
    return np.median(np.stack([padded[:-2], padded[1:-1], padded[2:]]), axis=0)


REST_SPEED = 0.1
"""Speed of the fastest joint below which the arm is at rest, rad/s."""
MIN_LAG = 0.012
"""Least tracking error of a lagging joint, rad."""
LAG_RATIO = 3.0
"""Ratio of a joint's error to the largest other error above which only this joint lags."""


def joint_weak(case: Investigation) -> Iterator[DeviceFinding]:
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
        spans = _spans(controls.times, alone & (which == joint), 0.5)
        here = alone & (which == joint)
        if int(here.sum()) < 2 or joint >= len(arm):
            continue
        efforts = np.interp(controls.times[here], joints.times, joints.efforts[:, joints.column(arm[joint])])
        flat = float(np.ptp(efforts)) < 0.05 * max(float(np.abs(efforts).max()), 1.0)
        sure: Confidence = "likely" if flat else "possible"
        lagged = float(np.degrees(error[here, joint].max()))
        title = (
            f"{arm[joint]} was too weak: it lagged by up to {lagged:.1f} degrees while the others followed"
        )
        reasons = [
            f"its error was more than {LAG_RATIO:.0f} times that of any other joint {listed_spans(spans)}"
        ]
        if flat:
            reasons.append(f"its torque stayed at {abs(float(np.median(efforts))):.0f} Nm all that time")
        yield DeviceFinding(
            Finding("joint.weak", arm[joint], title, tuple(reasons), "", spans[0][0], sure),
            spans, ("control.*", "safety.*", "world.disturbed", "grasp.*"), 10.0,
        )  # fmt: skip


def arm_stalled(case: Investigation) -> Iterator[DeviceFinding]:
    """Find stalls: no joint moves during a trajectory, and no body is in the way."""
    controls, joints = case.run.controls, case.run.joints
    arm = [joints.column(name) for name in case.run.joint_names[0] if name in joints.names]
    if not controls.errors.size or not arm or len(joints.times) < 3:
        return
    speeds = joints.velocities[:, arm]
    speed = np.abs(speeds)
    moving, fast = speed[:-1] > 0.04, speed[:-1] > 0.2
    drop = np.abs(np.diff(speeds, axis=0)) / np.maximum(np.diff(joints.times), 1e-3)[:, None]
    slowed = fast & (speed[1:] < 0.75 * speed[:-1])
    halted = (moving.sum(axis=1) >= MIN_JOINTS) & (slowed.sum(axis=1) >= fast.sum(axis=1) - 1)
    hard = halted & (((drop > MAX_BRAKING) & moving).sum(axis=1) >= 2)
    errors: Array = np.nan_to_num(np.abs(controls.errors))
    worst: Array = np.max(errors, axis=1)
    tracking = np.array([name == "Track" for name in controls.controllers])
    lagging: Array = ((errors > MIN_ERROR).sum(axis=1) >= MIN_JOINTS).astype(float) * tracking
    behind: Array = np.interp(joints.times[1:], controls.times, lagging)
    error = np.asarray(np.interp(joints.times[1:], controls.times, worst), dtype=np.float64)
    stuck: NDArray[np.bool_] = halted & (error > 2e-3) & (speed[1:].max(axis=1) < 2e-3)
    stops = [
        at.time for at in case.events(event_types.SafetyStopEvent) if at.record.cause == "control.tracking"
    ]
    stops += [f.time for f in case.failures if f.cause.startswith("control.t")]
    for tick in np.flatnonzero(stuck | hard | (behind > 0.5)):
        time = float(joints.times[tick + 1])
        if not stuck[tick] and not any(-0.11 < stop - time < 0.4 for stop in stops):
            continue
        if case.something_near(time):
            continue
        rest = np.flatnonzero(speed[tick + 20 :].max(axis=1) > MIN_SPEED)
        end = float(joints.times[tick + 20 + rest[0]]) if len(rest) else case.end
        title = f"the arm did not move from {seconds(time)} on though it was commanded to: no drive followed"
        reasons = (
            f"{int(moving[tick].sum())} joints stopped together, faster than they brake",
            *(("truly nothing was near the arm",) if case.truth.times else ()),
        )
        yield DeviceFinding(
            Finding("arm.stalled", "arm", title, reasons, "", time),
            ((time - 0.1, max(end, time)),), STALL_FAILURES, 3.0,
        )  # fmt: skip
        return


MIN_JOINTS = 3
"""Least number of joints in motion before a stall."""
MIN_SPEED = 0.3
"""Speed above which a joint follows its commands again, rad/s."""
STALL_FAILURES = ("control.*", "safety.*", "world.disturbed", "tree.timeout")
"""Failures that a stalled arm may cause."""
MIN_ERROR = 0.01
"""Least tracking error of a stalled joint, rad."""
MAX_BRAKING = 18.0
"""Deceleration that no brake of the arm's controller commands, rad/s²."""


def gripper_faulty(case: Investigation) -> Iterator[DeviceFinding]:
    """Find gripper failures: the fingers do not follow the command, or press with too little force."""
    for failure in case.failures:
        if failure.cause != "control.gripper":
            continue
        commanded, pressed = number(failure, "told"), number(failure, "force") or 0.0
        moved, width = number(failure, "moved") or 0.0, 1000 * (number(failure, "width") or 0.0)
        start = case.visit(failure).start
        cause, placing = "gripper.jammed", "place.*"
        title = f"the fingers are stuck at {width:.0f} mm: they did not follow the command"
        if commanded is not None and moved > 2e-3:
            cause, placing = "gripper.weak", "place.missed"
            felt = f"{force(pressed)} instead of {force(commanded)}"
            title = f"the gripper is too weak: its fingers press with {felt}"
        yield DeviceFinding(
            Finding(cause, "gripper", title, (failure.message,), "", failure.time),
            ((start, failure.time),), ("control.gripper", "grasp.*", placing), 5.0,
        )  # fmt: skip


def fingers_stuck(case: Investigation) -> Iterator[DeviceFinding]:
    """Find fingers that do not open on command, although nothing can hold them."""
    gripper, states = case.run.gripper, case.devices
    if not len(gripper.times) or len(states) < 2:
        return
    times = np.array([s.time for s in states])
    width = np.interp(times, gripper.times, gripper.widths)
    before = np.interp(times - 0.2, gripper.times, gripper.widths)
    commanded = np.array([s.told_width for s in states])
    stuck = (commanded > width + MIN_JAM) & (np.abs(width - before) < 5e-4)
    spans = _lasting(_spans(times, stuck))
    if spans:
        at, wanted = float(width[stuck][0]), float(commanded[stuck][0])
        title = f"the fingers are stuck at {1000 * at:.0f} mm: they did not follow the command"
        reasons = (f"the command was {1000 * wanted:.0f} mm, and they did not move {listed_spans(spans)}",)
        yield DeviceFinding(
            Finding("gripper.jammed", "gripper", title, reasons, "", spans[0][0]), spans,
            ("control.gripper", "grasp.*", "place.*"), 5.0,
        )  # fmt: skip


MIN_JAM = 0.006
"""Least difference between commanded and measured opening of stuck fingers, m."""


def fingers_press_too_little(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a weak gripper: fingers at rest on an item press with too little force in several readings."""
    gripper = case.run.gripper
    states = [s for s in case.devices if s.told_force > 0.0]
    if not len(gripper.times) or not states:
        return
    times = np.array([s.time for s in states])
    width = np.interp(times, gripper.times, gripper.widths)
    pressed = np.interp(times, gripper.times, gripper.forces)
    before = np.interp(times - 0.2, gripper.times, gripper.widths)
    commanded = np.array([s.told_force for s in states])
    closing = width > np.array([s.told_width for s in states]) + 0.004
    resting = closing & (np.abs(width - before) < 5e-4) & (width > 0.004)
    moved = width < float(gripper.widths.max()) - 0.004
    weak = resting & moved & (pressed < WEAK_SHARE * commanded)
    spans = _lasting(_spans(times, weak))
    if spans:
        most = float(np.median(pressed[weak] / commanded[weak]))
        title = f"the gripper presses with {100 * most:.0f} % of the commanded force"
        reasons = (f"its fingers rested on something with that force {listed_spans(spans)}",)
        yield DeviceFinding(
            Finding("gripper.weak", "gripper", title, reasons, "", spans[0][0]), spans,
            ("control.gripper", "grasp.*", "place.missed"), 3.0,
        )  # fmt: skip


WEAK_SHARE = 0.6
"""Share of the commanded finger force below which a gripper is weak."""
SAME_PLACE = 0.2
"""Distance below which two start configurations count as equal for a planner, rad."""


def planner_refuses(case: Investigation) -> Iterator[DeviceFinding]:
    """Find planner refusals: no path, and no body that blocks it."""
    answers_by_request: dict[str, list[tuple[float, bool, tuple[float, ...], int]]] = defaultdict(list)
    for at in case.run.plans:
        plan = at.record
        answers_by_request[re.sub(r"[\d.]+", "#", plan.request)].append(
            (at.time, plan.outcome == "found", plan.start, plan.version)
        )
    times: list[float] = []
    for failure in case.failures:
        limited = bool(failure.evidence.get("joint")) or (number(failure, "fraction") or 0.0) > 0.02
        if failure.cause != "planning.no_path" or words(failure, "pairs") or limited:
            continue
        times.append(failure.time)
    refused = [at for at in case.run.plans if at.record.outcome == "planning.no_path"]
    again = [
        at.time
        for at in refused
        for time, found, start, _ in answers_by_request[re.sub(r"[\d.]+", "#", at.record.request)]
        if found and time > at.time and start and len(start) == len(at.record.start)
        and float(np.abs(np.subtract(start, at.record.start)).max()) < SAME_PLACE
    ]  # fmt: skip
    if not times or not refused:
        return
    spans = ((refused[0].time, refused[-1].time),)
    often = counted(len(refused), "time")
    title = f"the planner found no way {often} {between(*spans[0])}, though nothing was in the way"
    sure: Confidence = "likely" if again else "possible"
    reasons = ["the planner names nothing that the arm or the hand would touch"]
    if again:
        reasons.append("the planner later found the paths that it had refused, from the same place")
    yield DeviceFinding(
        Finding("planner.refuses", "planner", title, tuple(reasons), "", spans[0][0], sure),
        spans, ("planning.no_path", "grasp.no_candidate", "safety.no_retreat"),
    )  # fmt: skip


DETECTORS: tuple[Callable[[Investigation], Iterator[DeviceFinding]], ...] = (
    wrist_silent, arm_stalled, wrist_biased, joint_weak, gripper_faulty, fingers_stuck,
    fingers_press_too_little, camera_silent, planner_refuses, camera_frozen, camera_noisy, camera_off,
    colours_mistaken,
)  # fmt: skip


def _lasting(spans: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    return tuple(span for span in spans if span[1] - span[0] > MIN_SILENCE)


def _spans(times: Array, where: NDArray[np.bool_], gap: float = 0.3) -> tuple[tuple[float, float], ...]:
    """Return the spans in which a condition held, joined over gaps."""
    found: list[tuple[float, float]] = []
    for time in times[where]:
        if found and time - found[-1][1] <= gap:
            found[-1] = (found[-1][0], float(time))
        else:
            found.append((float(time), float(time)))
    return tuple(found)
