"""Causes in items: wrong place, size, number or identity of an item."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from picktree.logs import ImageEvent, log_records
from picktree.robot.perception import depth_noise
from picktree.world import Pose, Shape, convex_hull, corners, event_types, extents
from picktree.world.scene import CameraDescription

from .body_tracks import horizontal_distance
from .camera_causes import explain_displaced_camera, looks
from .case import Investigation
from .explanation import FailureStory, Finding, number
from .held_items import grip_within, held_periods, holds_of, item_deviation
from .seen_world import EMPTY_WIDTH
from .wording import between, counted, distance, force, place, seconds

MIN_MOVE = 0.015
"""Distance from its last seen place above which a true item has moved, m."""
MOVE_START = 0.008
"""Distance beyond which an item counts as moving already, m."""
MIN_ERROR = 0.012
"""Distance between belief and truth of a visible item above which the belief is wrong, m."""
PUSH_RANGE = 0.12
"""Distance from the hand within which it may have pushed an item, m."""
TOUCH_FORCE = 6.0
"""Force on the wrist that indicates a contact, N: more than the swinging hand's own weight causes."""
CARRIED_WAY, CARRIED_RANGE = 0.06, 0.07
"""Least motion of an item that the arm carried off, and its greatest distance from the hand then, m."""
LOSS_MARGIN = 0.6
"""Time around a loss from the hand in which the item's motion is its fall, s."""
BEFORE_HELD = 0.05
"""Time before the belief has an item in the hand at which it lies where the hand goes, beside a sample, s."""
SAMPLE_TIME = 0.1
"""Interval between two samples of the hand's position, s."""
SEEK_FAILURES = frozenset(
    {
        "grasp.missed", "grasp.slipped", "grasp.no_candidate", "world.unknown_object", "world.disturbed",
        "perception.not_found", "perception.stale", "place.missed",
        "push.lost_contact", "push.stalled", "push.missed", "insert.missed", "insert.not_found",
    }
)  # fmt: skip
"""Causes of failure that an item at another place may have."""


@dataclass(frozen=True, slots=True)
class ItemDisplacement:
    """Displacement of an item between two samples of the truth."""

    start: float
    end: float
    way: float
    """Distance from the place where it was last seen to its place in the end, m."""


def explain_wrong_place(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that the item was not at its believed place when the hand needed it; else None."""
    true = case.pairs.get(failure.item)
    if failure.cause not in SEEK_FAILURES or true is None:
        return None
    reached = _reached(case, failure)
    return _taken(case, failure, true, reached) or _moved(case, failure, true, reached)


def _reached(case: Investigation, failure: FailureStory) -> float:
    """Return the time at which the fingers closed on the item, or else of the failure, s."""
    if failure.cause.startswith("insert."):
        holds = holds_of(case, case.pairs.get(failure.item, ""))
        held = [p.start for p in holds if p.start <= failure.time <= p.end]
        return held[-1] - case.sampled - BEFORE_HELD if held else failure.time
    start = case.visit(failure).start
    grip = grip_within(case, start, failure.time) if failure.cause.startswith("grasp.") else None
    return failure.time if grip is None else grip.closed


def _taken(case: Investigation, failure: FailureStory, true: str, reached: float) -> Finding | None:
    gone = case.gone(true)
    if gone is None or gone[1] > max(reached, failure.time) + case.sampled:
        return None
    item = failure.item
    lost = (p.left for p in holds_of(case, true) if p.left is not None)
    if not case.world.is_true and any(left[0] > gone[0] for left in lost):
        return None  # it left the hand after it was last seen
    was = case.belief.at(item, gone[0])
    how = "out of the hand" if was is not None and was.attached else "away"
    return taken_item(case, true, item, how, *_felt_nothing(failure), *_seen_empty(case, item, gone[0]))


def taken_item(case: Investigation, true: str, item: str, how: str, *reasons: str) -> Finding:
    """Return the finding about an item that vanished, with further reasons. `how`: a phrase after "taken"."""
    start, end = case.gone(true) or (case.end, case.end)
    last = case.bodies.tracks[true].last.pose.position
    until = f"the log has its true place until {seconds(start)} ({place(last)}), and not after that"
    title = f"{item} was taken {how} {between(start, end)}: the robot's belief does not contain it any more"
    return Finding("item.gone", true, title, (until, *reasons), item, start)


def _moved(case: Investigation, failure: FailureStory, true: str, reached: float) -> Finding | None:
    item = failure.item
    believed = case.belief.tracks[item].before(reached)
    if believed is None or believed.attached or failure.cause == "grasp.slipped":
        return None
    moving = displacement_since(case, true, _settled(case, item, reached), reached)
    if moving is None or any(
        p.left is not None and p.left[0] - LOSS_MARGIN <= moving.start <= p.end + LOSS_MARGIN
        for p in holds_of(case, true)
    ):
        return None  # it did not move, or fell out of the hand
    now = case.bodies.tracks[true].before(max(moving.end, reached))
    if now is None or horizontal_distance(now, believed) < MIN_ERROR:
        return None
    pushed, evidence = moved_by_arm(case, true, moving)
    hand, nature = case.hand(moving.end), item_deviation(case, item, true, moving.end)
    near = hand is not None and math.dist(hand, now.pose.position) < PUSH_RANGE
    if near and nature is not None and nature.cause == "item.slippery":
        return nature  # it slid away from the fingers
    when = between(moving.start, moving.end)
    cause, verb = ("item.pushed_by_arm", "the arm pushed it") if pushed else ("item.moved", "it had moved")
    title = f"{item} was not where it was believed to be: {verb} by {distance(moving.way)} {when}"
    lay = case.bodies.tracks[true].before(moving.start)
    inside = "" if lay is None or pushed else case.bin_at(lay)
    if inside and case.bin_at(now) != inside:
        cause = "item.left_bin"
        title = f"{item} left {inside} again after it had been placed, {when}"
    away = distance(horizontal_distance(now, believed))
    reasons = (
        f"it was last seen at {seconds(believed.last_seen)}, and believed at {place(believed.pose.position)} "
        f"when the hand got there at {seconds(reached)}",
        f"{case.truly}it was at {place(now.pose.position)}, {away} away",
        evidence,
        *_felt_nothing(failure),
    )
    return Finding(cause, true, title, reasons, item, moving.start)


def _settled(case: Investigation, item: str, until: float) -> float:
    """Return the time from which the belief has had the item at its place of that time, s."""
    changes = [at.time for at in case.changes(item, end=until)]
    return changes[-1] if changes else 0.0


def displacement_since(case: Investigation, true: str, seen: float, until: float) -> ItemDisplacement | None:
    """Return the displacement of a true item between two times; None without one, or for a carried item."""
    track = case.bodies.tracks[true]
    bodies = [(t, b) for t, b in track.since(seen, until + case.sampled) if t >= seen]
    carried = max((t for t, _ in bodies if _carried(case, true, t)), default=None)
    start = track.before(seen) if carried is None else track.after(carried + case.sampled / 2)
    if start is None:
        return None
    samples = [(t, horizontal_distance(start, b)) for t, b in bodies if carried is None or t > carried]
    far = next((d for _, d in samples if d > MIN_MOVE), None)
    if far is None:
        return None
    begun = next(t for t, way in samples if way > MOVE_START)
    rested = max((t for t, _ in samples if t < begun), default=seen)
    way = next((d for t, d in reversed(samples) if t <= until), far)
    return ItemDisplacement(rested, max(begun, rested), max(way, far))


def moved_by_arm(case: Investigation, true: str, moving: ItemDisplacement) -> tuple[bool, str]:
    """Return whether the arm moved the item, and the evidence for it."""
    if not case.world.is_true:
        return False, "no look shows what moved it"
    track, others = case.bodies.tracks[true], "something else than the arm moved it"
    body, after = track.before(moving.start) or track.first, track.after(moving.end) or track.bodies[-1]
    times = np.arange(moving.start, moving.end + 1e-6, SAMPLE_TIME)
    hands = [(float(time), hand) for time in times if (hand := case.hand(float(time))) is not None]
    if not hands:
        return False, "the log does not show where the hand was then"
    ways = [math.dist(hand, body.pose.position) for _, hand in hands]
    if min(ways) > PUSH_RANGE:
        return False, f"{others}: the hand was at least {distance(min(ways))} away"
    wrenches = case.run.wrenches
    # Elsewhere on its way the hand is swung, and feels its own weight.
    beside = np.array([time for (time, _), way in zip(hands, ways, strict=True) if way <= PUSH_RANGE])
    here = (np.abs(wrenches.times[:, None] - beside) <= SAMPLE_TIME / 2).any(axis=1)
    felt = float(np.linalg.norm(wrenches.forces[here], axis=1).max()) if bool(here.any()) else 0.0
    left = min(math.dist(hand, after.pose.position) for _, hand in hands)
    if horizontal_distance(body, after) > CARRIED_WAY and left < CARRIED_RANGE:
        return True, f"the hand went with it, and was {distance(left)} from it in the end"
    if felt < TOUCH_FORCE:
        return False, f"{others}: the hand felt no more than {force(felt)} then"
    if left > 2 * PUSH_RANGE and body.form not in ("sphere", "cylinder"):
        return False, f"{others}: the hand did not move with it ({distance(left)} away)"
    return True, f"the hand was {distance(min(ways))} from it then, and felt {force(felt)}"


def explain_misjudged_place(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that a resting item was believed elsewhere all the time; else None."""
    true = case.pairs.get(failure.item)
    if true is None or failure.cause not in SEEK_FAILURES or failure.cause == "grasp.slipped":
        return None
    reached, item = _reached(case, failure), failure.item
    believed, body = case.belief.tracks[item].before(reached), case.bodies.at(true, reached)
    if believed is None or body is None or believed.attached:
        return None
    if (away := horizontal_distance(body, believed)) < MIN_ERROR:
        return None
    if (camera := explain_displaced_camera(case, item, reached)) is not None:
        return camera
    settled, off = _settled(case, item, reached), distance(away)
    reasons = (f"believed at {place(believed.pose.position)}, {case.truly}at {place(body.pose.position)}",)
    cause, title = "perception.misjudged", f"{item} was seen, but believed {off} from its true place"
    if any(p.item == item and believed.last_seen < p.end <= reached for p in case.once(held_periods)):
        cause, title = (
            "item.fell_elsewhere",
            f"{item} lay {off} from where it was believed to have come to rest",
        )
        reasons = (*reasons, f"it had been let go at {seconds(settled)} and had not been seen since")
    return Finding(cause, true, title, reasons, item, settled)


def _carried(case: Investigation, true: str, time: float) -> bool:
    """Whether the robot believed at that time that it held the item."""
    bodies = (case.belief.at(item, time) for item in case.believed.get(true, ()))
    return any(body is not None and body.attached for body in bodies)


def _felt_nothing(failure: FailureStory) -> list[str]:
    width = number(failure, "width")
    met = width is not None and width <= EMPTY_WIDTH
    return [f"the fingers met ({max(width or 0.0, 0.0) * 1000:.1f} mm) and hold nothing"] if met else []


def _seen_empty(case: Investigation, item: str, since: float) -> list[str]:
    given_up = [at for at in case.changes(item, since) if at.record.after is None]
    return [f"at {seconds(at.time)} {at.record.reason}, and the robot gave it up" for at in given_up[:1]]


def explain_never_seen(case: Investigation, true: str) -> Finding:
    """Return the finding about a true item that was never believed to be there."""
    body, item = case.bodies.tracks[true].first, case.name_of(true)
    looks = len(case.events(ImageEvent))
    if not looks:
        return explain_no_look()
    low, high = extents(body.shape, body.pose.rotation())
    if (noisy := noisy_camera(case, item, float(high[2] - low[2]))) is not None:
        return noisy
    outside = [camera.name for camera in case.fixed_cameras if not in_picture(camera, body)]
    views = [f"it lies outside the picture of {name}" for name in outside]
    hidden = (f"it lies within the picture of {c.name}, hidden or not recognised" for c in case.fixed_cameras)
    title = f"{item} was never seen: it lies at {place(body.pose.position)}"
    reasons = (*(views or hidden), f"the robot looked {counted(looks, 'time')}")
    return Finding("item.never_seen", true, title, reasons, true, None)


def explain_no_look() -> Finding:
    """Return the finding that no camera took an image."""
    title = "the mission never looks: no camera took an image, and no item is known"
    return Finding("mission.no_look", "", title, (), "", 0.0)


def noisy_camera(case: Investigation, item: str, height: float) -> Finding | None:
    """Return the finding that an item of that height, m, drowns in the noise of a fixed camera; else None."""
    for shot in case.once(looks):
        scatter, away = depth_noise(shot.record.depth)
        if scatter > max(NOISE_SHARE * height, MAX_ORDINARY_NOISE * (away / 0.7) ** 2):
            name = shot.record.camera
            title = f"the camera {name} is too noisy: its depth scatters by {distance(scatter)}"
            reasons = (f"{item or 'the lowest item'} is {distance(height)} high, and was never seen",)
            return Finding("camera.noisy", name, title, reasons, item, shot.time)
    return None


MAX_ORDINARY_NOISE = 0.003
"""Greatest scatter of an ordinary camera at 0.7 m, m; it grows with the square of the distance."""
NOISE_SHARE = 0.3
"""Share of an item's height above which noise of the depth hides the item."""


def in_picture(camera: CameraDescription, body: log_records.BodyRecord) -> bool:
    """Whether the body's centre is within the image, if the camera is at its believed pose."""
    x, y, z = (camera.pose.inverse() @ body.pose).position
    (width, height), across = camera.size, np.tan(camera.fov / 2)
    return bool(z > 0.0 and abs(y / z) <= across and abs(x / z) <= across * width / height)


SIZE_RATIO = 1.08
"""Ratio of the true size to the catalogue's above which the item differs from its kind."""
SIZE_INDEPENDENT_CAUSES = (
    "control.", "tree.", "internal.", "planning.budget", "perception.no_image", "safety.stale_sensor",
)  # fmt: skip
"""Beginnings of causes that do not depend on an item's size."""


def size_of(case: Investigation, true: str, time: float) -> float:
    """Return the size of a true item as a multiple of its kind's; 1 when the catalogue has no size."""
    entry, body = case.entry_of(true), case.bodies.tracks[true].before(time)
    if entry is None or body is None:
        return 1.0
    (low, high), (least, most) = (extents(s, np.eye(3)) for s in (body.shape, entry.shape))
    return float(np.median((high - low) / np.maximum(most - least, 1e-6)))


def explain_too_wide(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that the hand does not open wide enough for an item; else None."""
    if failure.cause != "grasp.no_candidate" or number(failure, "candidates") != 0:
        return None
    body, most = case.belief.at(failure.item, failure.time), float(case.gripper.widths.max(initial=0.0))
    width = 0.0 if body is None else _least_width(body.shape, body.pose)
    if width < most or most <= 0.0:
        return None
    title = f"{failure.item} is too wide for the hand: {1000 * width:.0f} mm at its narrowest"
    reasons = (f"the fingers were {1000 * most:.0f} mm open at most", "no grasp fits its width")
    return failure.finding("item.too_wide", failure.item, title, reasons)


def _least_width(shape: Shape, pose: Pose) -> float:
    """Return the least width of a body seen from above, m: across an edge of its outline."""
    outline = (corners(shape) @ pose.rotation().T)[:, :2]
    across = convex_hull(outline).equations[:, :2]
    return float(np.ptp(outline @ across.T, axis=0).min())


def explain_wrong_size(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that the item, or one in the way of its grasp, differs in size from its kind."""
    if failure.cause.startswith(SIZE_INDEPENDENT_CAUSES):
        return None
    items = ((item, case.pairs.get(item)) for item in (failure.item, *_touched(failure)))
    sizes = (_another_size(case, true, item, failure.time) for item, true in items if true is not None)
    return next((found for found in sizes if found is not None), None)


def explain_unrecognised_size(case: Investigation, true: str) -> Finding | None:
    """Return the finding that an item was not recognised because its size differs from its kind."""
    track = case.bodies.tracks[true]
    if not any(in_picture(camera, track.first) for camera in case.fixed_cameras):
        return None
    return _another_size(case, true, case.name_of(true), track.times[-1])


def _another_size(case: Investigation, true: str, item: str, time: float) -> Finding | None:
    factor = size_of(case, true, time)
    if 1 / SIZE_RATIO <= factor <= SIZE_RATIO:
        return None
    body, names = case.bodies.tracks[true].last, case.believed.get(true, ())
    title = f"{item} is {case.truly}{factor:.2g} times as large as a {body.kind} of the catalogue"
    kinds = sorted({b.kind for name in names for b in case.belief.tracks[name].bodies} - {body.kind})
    reasons = [f"it is a {body.colour} {body.kind}"]
    reasons += [f"it was taken for a {' and a '.join(kinds)}"] if kinds else []
    if len(names) > 1:
        reasons.append(f"it was believed to be {counted(len(names), 'item')}: {', '.join(names[:4])}")
    return Finding("item.larger", true, title, tuple(reasons), item, None)


def explain_missing_item(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that the failure's item, or one that it touched, never existed; else None."""
    phantoms = case.identities.phantoms
    if failure.cause.startswith(SIZE_INDEPENDENT_CAUSES):
        return None
    held = [body.id for body in case.believed_at(failure.time) if body.attached]
    item = next((name for name in (failure.item, *held, *_touched(failure)) if name in phantoms), "")
    if not item:
        return None
    sighting = case.identities.by_item[item][0]
    near, seen, at = phantoms[item], sighting.seen, seconds(sighting.time)
    cause, about, looked = "perception.phantom", item, f"a {seen.colour} {seen.kind}"
    if near:
        of = case.bodies.tracks[near].first
        names = [name for name in case.believed.get(near, ()) if name not in phantoms]
        known = f", as is {names[0]}" if names else ""
        cause, about, part = "perception.twin", near, f"a part of the {of.colour} {of.kind} ({near}){known}"
        title = f"{item} does not exist: the camera saw it in {part}"
        reason = f"at {at} the camera took this part for {looked}"
    elif stands := case.obstacle_at(seen):
        unknown = f"{stands}, which the robot did not know, was taken for a {seen.kind}"
        title, reason = f"{item} is not an item: {unknown}", f"the camera saw it so at {at}"
    else:
        title = f"{item} does not exist: nothing lies at {place(seen.pose.position)}"
        reason = f"the camera took something for {looked} at {at}"
    return Finding(cause, about, title, (reason,), item, sighting.time)


def _touched(failure: FailureStory) -> dict[str, None]:
    """Return the bodies that the refused candidates of a failure would touch."""
    refused = (rejection.by for choice in failure.choices for rejection in choice.rejections)
    return dict.fromkeys(by.split("/")[0] for by in refused if by)


def explain_late_arrival(case: Investigation, true: str) -> Finding | None:
    """Return the finding that a true item appeared after the last look, without the feed; else None."""
    first = case.bodies.tracks[true].times[0]
    if first <= case.bodies.times[0] + 1e-6 or case.believed.get(true):
        return None
    fed = any(abs(at.time - first) < 2.0 for at in case.events(event_types.DeliveryEvent))
    looks = [at.time for at in case.events(ImageEvent)]
    before = case.bodies.times[max(case.bodies.times.index(first) - 1, 0)]
    later = sum(time > first for time in looks)
    lies = place(case.bodies.tracks[true].first.pose.position)
    title = f"{case.name_of(true)} came {between(before, first)}, at {lies}"
    title += ", after the last look" if not later else ", and was not seen"
    looked = "the robot never looked"
    if looks:
        last = f"the last time at {seconds(looks[-1])}"
        looked = f"the robot looked {counted(later, 'time')} after that, {last}"
    came = "the scene's feed brought it" if fed else "it was not there at the start"
    return Finding("item.appeared", true, title, (looked, came), true, first)
