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
from picktree.robot.perception import BackgroundModel, PosedCamera, depth_noise, noise_factor, table_of
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
    "control.*", "place.*", "perception.not_found", "push.*", "insert.*", "feed.*",
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
        body, image = case.bodies.at(true, shot.time), shot.record
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
    at = case.bodies.tracks[true].first.pose.position
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
        shown = next((a.time for a, b in same if _shifted(case, a.time, b.time)), math.inf)
        frozen = noisy or [pair for pair in same if pair[0].time >= shown]
        if frozen:
            start, end = frozen[0][0].time, frozen[-1][1].time
            why = "and the camera has noise" if noisy else "though items were moved"
            reasons = (f"its images of {seconds(start)} and {seconds(end)} are the same, {why}",)
            yield DeviceFinding(
                Finding("camera.frozen", name, _stands_still(name, start), reasons, "", start),
                _runs([shot.time for pair in frozen for shot in pair], [shot.time for shot in taken]),
                (*PLACE_FAILURES, "perception.*", "tree.timeout"), 0.5,
            )  # fmt: skip


def _shifted(case: Investigation, start: float, end: float) -> bool:
    """Whether an item of one image was truly at another place at the time of the next image."""
    shown = {each.true for each in case.identities.sightings if -IMAGE_DELAY <= each.time - start < MAX_AGE}
    moved = ((case.bodies.at(true, start), case.bodies.at(true, end)) for true in shown - {""})
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
            Finding("camera.noisy", name, title, reasons, "", times[0][0]),
            _runs([time for time, _ in times], sorted(case.run.images.times)),
            (*PLACE_FAILURES, "perception.*", "planning.*"), 0.5,
        )  # fmt: skip


MIN_OFFSET = 0.006
"""Mean offset of belief from truth above which the camera is the cause, m."""
MAX_SCATTER = 0.5
"""Maximum scatter of the offsets of single items, as a share of their mean."""


def camera_displaced(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a displaced camera by its images: bins and fixtures appear beside their places."""
    scene = case.scene
    table = None if scene is None else table_of(scene)
    if scene is None:
        return
    cameras = {c.name: c for c in scene.cameras}
    expected: dict[str, tuple[Array, float]] = {}
    found: dict[str, list[tuple[float, tuple[float, float]]]] = defaultdict(list)
    times: dict[str, list[float]] = defaultdict(list)
    for shot in case.once(looks):
        image, name = shot.record, shot.record.camera
        if name not in expected:
            sight = PosedCamera.at(image.intrinsics, cameras[name].pose)
            top = 0.0 if table is None else table.pose.position[2] + extents(table.shape, np.eye(3))[1][2]
            expected[name] = BackgroundModel.of(scene, sight, table, top).depth, image.intrinsics.fx
        times[name].append(shot.time)
        if (shift := background_shift(image.depth.astype(np.float64), *expected[name])) is not None:
            found[name].append((shot.time, shift))
    for name, shifts in found.items():
        ways = np.array([shift for _, shift in shifts])
        across, down = np.median(ways, axis=0)
        size, start = math.hypot(across, down), shifts[0][0]
        title = (
            f"the camera {name} is {distance(size)} from its believed pose: every object is believed "
            "at a wrong place"
        )
        reasons = (
            f"bins and fixtures appear {distance(abs(float(across)))} across and "
            f"{distance(abs(float(down)))} down in its image from where the scene has them, "
            f"at {listed_times([time for time, _ in shifts])}",
        )
        spans = _runs([time for time, _ in shifts], sorted(times[name]))
        yield DeviceFinding(
            Finding("camera.off", f"the camera {name}", title, reasons, "", start), spans, PLACE_FAILURES, 0.5
        )


MAX_PIXELS = 20
"""Greatest shift of the image that is looked for, pixels."""
MIN_PIXELS = 1.5
"""Least shift that counts as a displacement, pixels."""
EDGE_STEP = 0.01
"""Step of the expected depth that makes an edge, m."""
MAX_DEPTH_ERROR = 0.05
"""Error of a pixel's depth above which it counts no more: something hides the edge, m."""
MAX_COST_SHARE = 0.6
"""Share of the error at the believed pose below which another pose is the true one."""
MAX_EDGE_PIXELS = 3000
"""Number of pixels at edges that are compared."""


def background_shift(depth: Array, expected: Array, focal: float) -> tuple[float, float] | None:
    """Return the shift between a depth image and the expected one of the empty scene (h, w): right and down
    at the edges' depth, m. None without a clear shift."""
    model = np.where(np.isfinite(expected), expected, 0.0)
    steps = np.maximum(
        np.abs(np.diff(model, axis=1, prepend=model[:, :1])),
        np.abs(np.diff(model, axis=0, prepend=model[:1])),
    )
    edge = steps > EDGE_STEP
    near = edge.copy()
    for by in (-2, -1, 1, 2):
        near |= np.roll(edge, by, 0) | np.roll(edge, by, 1)
    inside = np.zeros_like(near)
    inside[MAX_PIXELS:-MAX_PIXELS, MAX_PIXELS:-MAX_PIXELS] = True
    rows, columns = np.nonzero(near & inside & (model > 0.0))
    every = max(1, len(rows) // MAX_EDGE_PIXELS)
    rows, columns = rows[::every], columns[::every]
    wanted = model[rows, columns]
    if len(rows) < 100:
        return None

    def cost(down: int, right: int) -> float:
        shown = depth[rows + down, columns + right]
        seen = shown > 0.0
        if int(seen.sum()) < len(rows) // 2:
            return MAX_DEPTH_ERROR
        return float(np.minimum(np.abs(shown - wanted), MAX_DEPTH_ERROR)[seen].mean())

    reach = range(-MAX_PIXELS, MAX_PIXELS + 1)
    here = cost(0, 0)
    best, down, right = min((cost(v, u), v, u) for v in reach for u in reach)
    if math.hypot(down, right) < MIN_PIXELS or best > MAX_COST_SHARE * here:
        return None
    scale = float(np.median(wanted)) / focal
    return right * scale, down * scale


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
    """Return the findings about cameras that are not at their believed poses: by their images, else by the
    items."""
    return tuple(camera_displaced(case)) or tuple(camera_off(case))


def explain_displaced_camera(case: Investigation, item: str, time: float) -> Finding | None:
    """Return the finding about a displaced camera whose image was the last of the item before that time."""
    seen = [each for each in case.identities.by_item.get(item, ()) if each.time <= time + 1e-6]
    if not seen or (case.world.is_true and math.hypot(*seen[-1].off) < MIN_OFFSET):
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
    "insert.*",
    "push.*",
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
    if not states:
        yield from _bias_of_empty_hand(case)
        return
    readings, gripper = case.run.wrenches, case.gripper
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
        yield _biased(spans, most, "its reading differed by this much from the true force")


def _biased(spans: list[tuple[float, float]], most: float, reason: str) -> DeviceFinding:
    """Return the finding on a wrist sensor that read `most` N too much in the spans."""
    start = spans[0][0]
    title = f"the wrist sensor read {force(most)} that were not there, from {seconds(start)} on"
    reasons = (f"{reason} {listed_spans(spans)}",)
    finding = Finding("wrist.biased", "wrist", title, reasons, "", start)
    return DeviceFinding(finding, ((start - 0.5, spans[-1][1]),), FORCE_FAILURES)


def _bias_of_empty_hand(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a biased wrist sensor without true forces: an empty hand that is far from everything feels a
    force, and feels it wherever it goes."""
    readings, gripper, joints = case.run.wrenches, case.gripper, case.run.joints
    times = readings.times
    if len(times) < 5 or not len(gripper.times):
        return
    size = np.linalg.norm(
        np.stack([median_of_neighbours(axis) for axis in readings.forces.T], axis=1), axis=1
    )
    fastest: Array = np.abs(joints.velocities).max(axis=1, initial=0.0)
    speed: Array = np.interp(times, joints.times, fastest)
    pressing = np.interp(times, gripper.times, gripper.forces) > 1.0
    for visit in case.family.visits:
        if visit.id in CONTACT_SKILLS:
            pressing |= (times >= visit.start) & (times <= visit.end)
    for at in case.belief.tracks.values():  # what the hand holds is felt
        held = np.array([t for t, body in zip(at.times, at.bodies, strict=True) if body.attached])
        if len(held):
            pressing |= (times >= held[0] - 0.1) & (times <= held[-1] + 0.3)
    felt = (size > np.where(speed < REST_SPEED, MIN_BIAS, SWING_FORCE)) & ~pressing
    silent = [span for find in (wrist_silent, joint_weak) for found in find(case) for span in found.spans]
    lasting = [
        span
        for span in _lasting(_spans(times, felt, 0.5))
        if not any(x <= span[1] and span[0] <= y for x, y in silent)
    ]
    sizes = {span: float(np.median(size[(times >= span[0]) & (times <= span[1])])) for span in lasting}
    sure = [span for span in lasting if _goes_far(case, *span) or _steps_at_rest(span[0], times, speed)]
    if sure:
        most = sizes[sure[0]]
        spans = [span for span in lasting if abs(sizes[span] - most) < SAME_BIAS * most]
        yield _biased(spans, most, "the empty hand felt this wherever it went")


CONTACT_SKILLS = frozenset({"Push", "Insert", "Extract", "MakeRoom", "Probe", "Jog", "Stir"})
"""Skills whose empty hand touches things on purpose."""
SAME_BIAS = 0.2
"""Difference of two forces, as a share, up to which they are the same bias."""
FAR_WAY = 0.05
"""Motion of the hand during which no contact keeps its force, m."""


def _steps_at_rest(start: float, times: Array, speed: Array) -> bool:
    """Whether the arm was at rest when a force began: nothing can have been touched."""
    before = (times > start - REST_TIME) & (times <= start + 1e-6)
    return bool(before.any()) and float(speed[before].max()) < STILL_SPEED


REST_TIME, STILL_SPEED = 0.16, 0.02
"""Time before a force, s, in which no joint was faster than this, rad/s, when no contact caused it."""


def _goes_far(case: Investigation, start: float, end: float) -> bool:
    """Whether the hand moved far between two times."""
    hands = [hand for time in np.linspace(start, end, 8) if (hand := case.hand(float(time))) is not None]
    return any(math.dist(hands[0], hand) > FAR_WAY for hand in hands)


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
            spans, JOINT_FAILURES, 10.0,
        )  # fmt: skip


def joint_saturated(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a weak joint under torque control: its torque stays at one value while those of others change."""
    controls, joints = case.run.controls, case.run.joints
    arm = [name for name in case.run.joint_names[0] if name in joints.names]
    if not controls.errors.size or len(joints.times) < 3:
        return
    compliant = np.isnan(controls.errors).all(axis=1).astype(float)
    soft = np.interp(joints.times[1:], controls.times, compliant) > 0.5
    efforts = joints.efforts[:, [joints.column(name) for name in arm]]
    change = np.abs(np.diff(efforts, axis=0))
    flat = (change < 1e-6 * np.abs(efforts).max(axis=0)) & (np.abs(efforts[1:]) > MIN_TORQUE)
    for joint, name in enumerate(arm):
        others = np.delete(change, joint, axis=1).max(axis=1) > 1e-3
        spans = _lasting(_spans(joints.times[1:], soft & flat[:, joint] & others, 0.15))
        if not spans:
            continue
        torque = abs(float(np.interp(spans[0][0] + 0.05, joints.times, efforts[:, joint])))
        title = f"{name} was too weak: its torque stayed at {torque:.1f} Nm while the arm was compliant"
        reasons = (f"its torque did not change {listed_spans(spans)}, and those of the others did",)
        yield DeviceFinding(
            Finding("joint.weak", name, title, reasons, "", spans[0][0]), spans,
            JOINT_FAILURES, 3.0,
        )  # fmt: skip


JOINT_FAILURES = ("control.*", "safety.*", "world.disturbed", "grasp.*", "place.*", "insert.*", "push.*")
"""Failures that a weak joint may cause."""
MIN_TORQUE = 0.3
"""Torque below which a joint may be at rest without being weak, Nm."""


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
        if case.run.info.backend != "kinematic" and _met_something(case, time):
            continue  # without physics nothing stops the arm
        rest = np.flatnonzero(speed[tick + 20 :].max(axis=1) > MIN_SPEED)
        end = float(joints.times[tick + 20 + rest[0]]) if len(rest) else case.end
        title = f"the arm did not move from {seconds(time)} on though it was commanded to: no drive followed"
        reasons = (
            f"{int(moving[tick].sum())} joints stopped together, faster than they brake",
            f"{case.truly}nothing was near the arm"
            if case.world.is_true
            else "nothing known was near the arm",
        )
        yield DeviceFinding(
            Finding("arm.stalled", "arm", title, reasons, "", time),
            ((time - 0.1, max(end, time)),), STALL_FAILURES, 3.0,
        )  # fmt: skip
        return


def arm_stalled_softly(case: Investigation) -> Iterator[DeviceFinding]:
    """Find stalls of a compliant arm: it is to follow a path, feels nothing, and no joint moves."""
    controls, joints = case.run.controls, case.run.joints
    arm = [joints.column(name) for name in case.run.joint_names[0] if name in joints.names]
    if not controls.errors.size or not arm or len(joints.times) < 3:
        return
    soft = np.array([name in SOFT_CONTROLLERS for name in controls.controllers]).astype(float)
    follows = np.array([name == "SoftTrack" for name in controls.controllers])
    still = np.abs(np.diff(joints.positions[:, arm], axis=0)).max(axis=1) < STILL_WAY
    wanted = np.interp(joints.times[1:], controls.times, soft) > 0.5
    for start, end in _spans(joints.times[1:], still & wanted, 0.5):
        tracked = follows[(controls.times >= start) & (controls.times <= end)]
        if end - start < MIN_STALL or not tracked.any() or _met_something(case, (start + end) / 2):
            continue
        title = f"the arm did not move from {seconds(start)} on though it was commanded to: no drive followed"
        reasons = (
            f"it was to follow a path compliantly, felt nothing, and did not move {between(start, end)}",
        )
        yield DeviceFinding(
            Finding("arm.stalled", "arm", title, reasons, "", start),
            ((start - 0.1, end),), (*STALL_FAILURES, "grasp.*"), 3.0,
        )  # fmt: skip
        return


SOFT_CONTROLLERS = ("Comply", "SoftTrack")
"""Controllers that give way, by their names in the log."""
STILL_WAY, MIN_STALL = 2e-5, 1.0
"""Motion of a joint within a tick below which it is at rest, rad; least duration of a stall, s."""


def _met_something(case: Investigation, time: float) -> bool:
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
STALL_FAILURES = ("control.*", "safety.*", "world.disturbed", "tree.timeout", "insert.*", "push.*")
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
            ((start, failure.time),), ("control.gripper", "grasp.*", placing, "insert.*"), 5.0,
        )  # fmt: skip


def fingers_stuck(case: Investigation) -> Iterator[DeviceFinding]:
    """Find fingers that do not open on command, or stay open and press on nothing when they should close."""
    gripper, states = case.gripper, case.devices
    if not len(gripper.times) or len(states) < 2:
        yield from _stuck_in_steps(case)
        return
    times = np.array([s.time for s in states])
    width = np.interp(times, gripper.times, gripper.widths)
    before = np.interp(times - 0.2, gripper.times, gripper.widths)
    pressed = np.interp(times, gripper.times, gripper.forces)
    commanded = np.array([s.told_width for s in states])
    told = np.array([s.told_force for s in states])
    still = np.abs(width - before) < 5e-4
    open_ = (commanded < width - MIN_JAM) & (width > float(gripper.widths.max()) - 1e-3)
    stuck = still & ((commanded > width + MIN_JAM) | (open_ & (pressed < WEAK_SHARE * told)))
    spans = _lasting(_spans(times, stuck))
    if spans:
        at, wanted = float(width[stuck][0]), float(commanded[stuck][0])
        title = f"the fingers are stuck at {1000 * at:.0f} mm: they did not follow the command"
        reasons = (f"the command was {1000 * wanted:.0f} mm, and they did not move {listed_spans(spans)}",)
        yield DeviceFinding(
            Finding("gripper.jammed", "gripper", title, reasons, "", spans[0][0]), spans,
            ("control.gripper", "grasp.*", "place.*", "insert.*", "push.*"), 5.0,
        )  # fmt: skip


def _stuck_in_steps(case: Investigation) -> Iterator[DeviceFinding]:
    """Find fingers that do not move in a step that closes or opens them."""
    gripper = case.gripper
    spans: list[tuple[float, float]] = []
    for step in (*case.steps("close"), *case.steps("release")):
        here = (gripper.times >= step.start - 1e-6) & (gripper.times <= step.end + 1e-6)
        widths, forces = gripper.widths[here], gripper.forces[here]
        long = step.end - step.start > MIN_STEP_TIME and len(widths) > 2
        presses = step.name == "close" and len(forces) and float(forces[-1]) > 1.0
        if long and float(np.ptp(widths)) < 1e-3 and not presses:
            spans.append((step.start, step.end))
    if spans:
        spans.sort()
        at = float(np.interp(spans[0][0], gripper.times, gripper.widths))
        title = f"the fingers are stuck at {1000 * at:.0f} mm: they did not follow the command"
        reasons = (f"the command was to move, and they did not {listed_spans(spans)}",)
        yield DeviceFinding(
            Finding("gripper.jammed", "gripper", title, reasons, "", spans[0][0]), tuple(spans),
            ("control.gripper", "grasp.*", "place.*", "insert.*", "push.*"), 5.0,
        )  # fmt: skip


MIN_STEP_TIME = 0.4
"""Least duration of a step in which fingers must have moved, s."""
MIN_JAM = 0.006
"""Least difference between commanded and measured opening of stuck fingers, m."""


def fingers_press_too_little(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a weak gripper: fingers at rest on an item press with too little force in several readings."""
    gripper = case.gripper
    states = [s for s in case.devices if s.told_force > 0.0]
    if not len(gripper.times) or not states:
        yield from _weak_picks(case)
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
            ("control.gripper", "grasp.*", "place.missed", "insert.*"), 3.0,
        )  # fmt: skip


def _weak_picks(case: Investigation) -> Iterator[DeviceFinding]:
    """Find a weak gripper by its picks: each names the commanded force."""
    gripper, found = case.gripper, list[tuple[float, float]]()
    for at in case.events(event_types.PickEvent):
        here = (gripper.times > at.time - 0.3) & (gripper.times <= at.time + 1e-6)
        told, width = at.record.force, at.record.width or 0.0
        if told and width > case.least_width + 0.004 and here.any():
            share = float(np.median(gripper.forces[here])) / told
            found += [(at.time, share)] if share < WEAK_SHARE else []
    if found:
        share = float(np.median([share for _, share in found]))
        title = f"the gripper presses with {100 * share:.0f} % of the commanded force"
        reasons = (f"its fingers held something with that force at {listed_times([t for t, _ in found])}",)
        yield DeviceFinding(
            Finding("gripper.weak", "gripper", title, reasons, "", found[0][0]),
            tuple((time - 1.0, time) for time, _ in found),
            ("control.gripper", "grasp.*", "place.missed", "insert.*"), 3.0,
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


DETECTORS: tuple[Callable[[Investigation], Iterable[DeviceFinding]], ...] = (
    wrist_silent, arm_stalled, arm_stalled_softly, wrist_biased, joint_weak, joint_saturated,
    gripper_faulty, fingers_stuck,
    fingers_press_too_little, camera_silent, planner_refuses, camera_frozen, camera_noisy, cameras_off,
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
