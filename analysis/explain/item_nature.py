"""Nature of items: beliefs of nothing, second names, other sizes than the catalogue's, late arrivals."""

from __future__ import annotations

import numpy as np

from ...logs.schema.event_records import ImageEvent
from ...world.run_events import DeliveryEvent
from ...world.shapes import Shape, convex_hull, corners, extents
from ...world.values import Pose
from .case import Investigation
from .explanation import FailureStory, Finding, number
from .item_whereabouts import in_picture
from .number_wording import between, counted, place, seconds

LARGER = 1.08
"""A true size of this many times the catalogue's is another one."""
CARRIED = ("control.", "tree.", "internal.", "planning.budget", "perception.no_image", "safety.stale_sensor")
"""Failures that an item's own size has nothing to do with."""


def size_of(case: Investigation, true: str, time: float) -> float:
    """Return the size of a true item as a multiple of its kind's; 1 where the catalogue does not tell."""
    entry, body = case.entry_of(true), case.truth.tracks[true].before(time)
    if entry is None or body is None:
        return 1.0
    (low, high), (least, most) = (extents(s, np.eye(3)) for s in (body.shape, entry.shape))
    return float(np.median((high - low) / np.maximum(most - least, 1e-6)))


def too_wide(case: Investigation, failure: FailureStory) -> Finding | None:
    """Whether the hand does not open wide enough for an item."""
    if failure.cause != "grasp.no_candidate" or number(failure, "candidates") != 0:
        return None
    body = case.belief.at(failure.item, failure.time)
    if body is None:
        return None
    width = _least_width(body.shape, body.pose)
    most = float(case.run.gripper.widths.max(initial=0.0))
    if width < most:
        return None
    title = f"{failure.item} is too wide for the hand: {1000 * width:.0f} mm at its narrowest"
    reasons = (f"the fingers were {1000 * most:.0f} mm open at most", "no grasp of its width exists")
    return Finding("item.too_wide", failure.item, title, reasons, failure.item, failure.time)


def _least_width(shape: Shape, pose: Pose) -> float:
    """Return the least width of a body seen from above, m: across an edge of its outline."""
    outline = (corners(shape) @ pose.rotation().T)[:, :2]
    across = convex_hull(outline).equations[:, :2]
    return float(np.ptp(outline @ across.T, axis=0).min())


def larger(case: Investigation, failure: FailureStory) -> Finding | None:
    """Whether the item, or one in the way of its grasp, truly has another size than its kind."""
    if failure.cause.startswith(CARRIED):
        return None
    touched = [by.split("/")[0] for choice in failure.choices for r in choice.rejections if (by := r.by)]
    for item in (failure.item, *dict.fromkeys(touched)):
        true = case.pairs.get(item)
        if true is None:
            continue
        factor = size_of(case, true, failure.time)
        if factor > LARGER or factor < 1 / LARGER:
            return _another_size(case, true, item, factor)
    return None


def another_size(case: Investigation, true: str) -> Finding | None:
    """Whether an item that a camera shows, and that was not recognised, has another size than its kind."""
    cameras = [camera for camera in case.scene.cameras if camera.on == "world"] if case.scene else []
    if not any(in_picture(camera, case.truth.tracks[true].first) for camera in cameras):
        return None
    factor = size_of(case, true, case.truth.tracks[true].times[-1])
    if 1 / LARGER <= factor <= LARGER:
        return None
    return _another_size(case, true, case.name_of(true), factor)


def _another_size(case: Investigation, true: str, item: str, factor: float) -> Finding:
    body = case.truth.tracks[true].last
    names = case.believed.get(true, ())
    title = f"{item} is truly {factor:.2g} times as large as a {body.kind} of the catalogue"
    kinds = sorted({b.kind for name in names for b in case.belief.tracks[name].bodies} - {body.kind})
    reasons = [f"it is a {body.colour} {body.kind}"]
    if kinds:
        reasons.append(f"it was taken for a {' and a '.join(kinds)}")
    if len(names) > 1:
        reasons.append(f"it was believed to be {counted(len(names), 'item')}: {', '.join(names[:4])}")
    return Finding("item.larger", true, title, tuple(reasons), item, None)


def nothing_there(case: Investigation, failure: FailureStory) -> Finding | None:
    """Whether the item that failed never was a true one of its own, or one that it touched was not."""
    phantoms = case.identities.phantoms
    if failure.cause.startswith(CARRIED):
        return None
    touched = [by.split("/")[0] for choice in failure.choices for r in choice.rejections if (by := r.by)]
    held = [body.id for body in case.believed_at(failure.time) if body.attached]
    item = next((name for name in (failure.item, *held, *touched) if name in phantoms), "")
    if not item:
        return None
    seen = case.identities.by_item[item][0]
    near = phantoms[item]
    if near:
        of = case.truth.tracks[near].first
        names = [name for name in case.believed.get(near, ()) if name not in phantoms]
        known = f", as is {names[0]}" if names else ""
        title = f"{item} does not exist by itself: it is seen in the {of.colour} {of.kind} ({near}){known}"
        reasons = (f"at {seconds(seen.time)} the camera took it for a {seen.seen.colour} {seen.seen.kind}",)
        return Finding("perception.twin", near, title, reasons, item, seen.time)
    stands = case.obstacle_at(seen.seen)
    if stands:
        title = (
            f"{item} is no item: {stands}, which the robot was not told of, was taken for a {seen.seen.kind}"
        )
        return Finding(
            "perception.phantom", item, title, (f"it was seen so at {seconds(seen.time)}",), item, seen.time
        )
    title = f"{item} does not exist: nothing lies at {place(seen.seen.pose.position)}"
    reasons = (
        f"the camera took something for a {seen.seen.colour} {seen.seen.kind} at {seconds(seen.time)}",
    )
    return Finding("perception.phantom", item, title, reasons, item, seen.time)


def appeared(case: Investigation, true: str) -> Finding | None:
    """Whether a true item came when nobody looked any more, without the feed."""
    first = case.truth.tracks[true].times[0]
    if first <= case.truth.times[0] + 1e-6 or case.believed.get(true):
        return None
    fed = any(abs(at.time - first) < 2.0 for at in case.events(DeliveryEvent))
    looks = [at.time for at in case.events(ImageEvent)]
    before = case.truth.times[max(case.truth.times.index(first) - 1, 0)]
    later = sum(time > first for time in looks)
    lies = place(case.truth.tracks[true].first.pose.position)
    title = f"{case.name_of(true)} came {between(before, first)}, at {lies}"
    title += ", after the last look" if not later else ", and was not seen"
    reasons = (
        f"the robot looked {counted(later, 'time')} after that, the last time at {seconds(looks[-1])}"
        if looks
        else "the robot never looked",
        "the scene's feed brought it" if fed else "it is none of those that lay there at the start",
    )
    return Finding("item.appeared", true, title, reasons, true, first)
