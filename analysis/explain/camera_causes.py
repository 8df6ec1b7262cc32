"""Cameras at fault: silent, noisy, hung elsewhere than believed, or wrong in a colour."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from ...files.value_wording import listed
from ...logs.run_log import CameraImage, Stamped
from ...robot.perception.camera_geometry import PosedCamera, depth_noise, noise_factor
from ...world.shapes import extents
from .case import NEAR_ARM, Investigation
from .explanation import DeviceFinding, Finding, number
from .identities import FRESH, Sighting
from .number_wording import between, counted, distance, listed_spans, place, seconds

REACHED = (
    "grasp.*", "world.*", "safety.*", "planning.start_in_collision", "planning.goal_in_collision",
    "control.*", "place.*", "perception.not_found", "push.*", "insert.*",
)  # fmt: skip
"""Failures that a wrong place of an item may have."""


def camera_silent(case: Investigation) -> Iterator[DeviceFinding]:
    """A camera gives no image when it is asked for one, the same one again, or one that is too noisy."""
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
    return f"the picture of the camera {camera} stood still, from {seconds(start)} on"


def _is_noisy(name: str, factor: float) -> str:
    return f"the camera {name} is {factor:.0f} times as noisy as it should be"


LOOKS = 24
"""Images of a run that are examined, at most."""


def looks(case: Investigation) -> tuple[Stamped[CameraImage], ...]:
    """Return images of the fixed cameras, spread over the run."""
    shots = case.run.shots
    fixed = {c.name for c in case.scene.cameras if c.on != "hand"} if case.scene else set[str]()
    theirs = [n for n, camera in enumerate(shots.cameras) if camera in fixed]
    chosen = sorted({int(n) for n in np.linspace(0, len(theirs) - 1, min(len(theirs), LOOKS))})
    return tuple(shots[theirs[n]] for n in chosen)


ABOVE = 0.1
"""Height above an item's top from which what an image shows at its place hides it, m."""


def hidden_by_arm(case: Investigation, true: str) -> Finding | None:
    """Whether the arm stood between the fixed cameras and an item in all images of its place."""
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
        arm = len(links) > 0 and float(np.linalg.norm(links - shown, axis=1).min()) < NEAR_ARM
        if depth <= 0.0 or shown[2] < top[2] + ABOVE or not arm:
            return None
        found.append((shot, float(shown[2] - top[2])))
    if not found:
        return None
    shot, height = found[0]
    camera, robot = shot.record.camera, case.run.info.robot
    title = f"the arm stands between the camera {camera} and items on the table"
    at = case.truth.tracks[true].first.pose.position
    reasons = (
        f"{case.name_of(true)} lies at {place(at)}: the image of {seconds(shot.time)} shows the arm there, "
        f"{distance(height)} above it",
        f"{counted(len(found), 'image')} of its place, and the item in none",
        "what to change: the pose from which it looks, mostly 'home' under 'poses:' in the robot file of "
        f"{robot}; `picktree robot test` measures what it hides",
    )
    return Finding("arm.hides_items", camera, title, reasons, case.name_of(true), shot.time)


LEAST_NOISE = 5e-4
"""Noise of a logged depth image from which no two images are the same, m: the log has steps of 1 mm."""
LATE = 0.5
"""Time after its capture within which an image is in the log, s."""
SHIFTED = 0.02
"""Way of an item that shows in a picture, m."""


def camera_frozen(case: Investigation) -> Iterator[DeviceFinding]:
    """A camera gives the same image again, though it has noise, or though items were moved."""
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
                ((start, end),), (*REACHED, "perception.*", "tree.timeout"), 20.0,
            )  # fmt: skip


def _shifted(case: Investigation, start: float, end: float) -> bool:
    """Return whether an item that an image showed truly lay elsewhere at the next one."""
    shown = {each.true for each in case.identities.sightings if -LATE <= each.time - start < FRESH}
    moved = ((case.truth.at(true, start), case.truth.at(true, end)) for true in shown - {""})
    return any(a and (not b or math.dist(a.pose.position, b.pose.position) > SHIFTED) for a, b in moved)


def camera_noisy(case: Investigation) -> Iterator[DeviceFinding]:
    """Depth images scatter far more than the camera's own noise."""
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
        reasons = (f"its depth scattered so in {counted(len(times), 'image')}, {listed_spans(times)}",)
        yield DeviceFinding(
            Finding("camera.noisy", name, title, reasons, "", times[0][0]), tuple(times),
            (*REACHED, "perception.*", "planning.*"), 20.0,
        )  # fmt: skip


OFF = 0.006
"""A mean offset of belief from truth beyond this is the camera's, m."""
ALIKE = 0.5
"""Share of the mean by which the offsets of single items may scatter."""


def camera_off(case: Investigation) -> Iterator[DeviceFinding]:
    """All items are seen off by the same way: that is the camera's fault, not theirs."""
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
        alike = len(ways) > 1 or any(math.dist(b.off, ways[0]) < ALIKE * size for b in before)
        if size > OFF and scatter < ALIKE * size and alike:
            found.append((time, sightings))
    ways = np.array([each.off for _, sightings in found for each in sightings])
    items = sorted({each.item for _, sightings in found for each in sightings})
    if len(items) < 2:
        return
    x, y = np.median(ways, axis=0)
    times = [time for time, _ in found]
    spans = _runs(times, sorted(looks))
    title = (
        f"everything is believed {distance(math.hypot(x, y))} from where it is: the camera {case.camera} "
        "hangs elsewhere than believed, or is turned"
    )
    reasons = (
        f"{len(items)} items lay {distance(abs(float(x)))} in x and {distance(abs(float(y)))} in y "
        f"from where they were seen, in the same direction ({listed(items, 4)})",
    )
    yield DeviceFinding(
        Finding("camera.off", f"the camera {case.camera}", title, reasons, "", times[0]), spans, REACHED, 0.5
    )


def cameras_off(case: Investigation) -> tuple[DeviceFinding, ...]:
    """Return what tells of cameras that hang elsewhere than believed."""
    return tuple(camera_off(case))


def seen_displaced(case: Investigation, item: str, time: float) -> Finding | None:
    """Return the finding about a camera that hung elsewhere when it last showed the item before that time."""
    seen = [each for each in case.identities.by_item.get(item, ()) if each.time <= time + 1e-6]
    if not seen or math.hypot(*seen[-1].off) < OFF:
        return None
    last = seen[-1].time
    return next(
        (off.finding for off in case.once(cameras_off) if any(abs(a - last) < 1e-6 for a, _ in off.spans)),
        None,
    )


def _runs(times: Iterable[float], looks: list[float]) -> tuple[tuple[float, float], ...]:
    """Spans from each look to the next one of any kind, until which the belief stays as it was seen."""
    found: list[tuple[float, float]] = []
    for time in times:
        after = next((look for look in looks if look > time + 1e-6), math.inf)
        found.append((time, after))
    return tuple(found)


MIXED_UP = ("perception.not_found", "world.unknown_object", "perception.ambiguous")
"""Failures that a wrong colour may have."""


def colours_mistaken(case: Investigation) -> Iterator[DeviceFinding]:
    """Items of one colour are shown in another."""
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
            ((start, sightings[-1].time),), MIXED_UP, 3.0,
        )  # fmt: skip
