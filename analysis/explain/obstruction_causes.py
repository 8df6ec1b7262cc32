"""Causes by obstruction of hand and arm, and by contact: fixtures, bins, neighbours, distance, budget."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from picktree.files import listed
from picktree.logs import ImageEvent, log_records
from picktree.robot.manipulation import pick_candidates, release_poses
from picktree.world import BeliefObject, ObjectId, Vector3, event_types, extents
from picktree.world.scene import Bin, CameraDescription

from .body_tracks import horizontal_distance
from .case import Investigation
from .explanation import (
    MIN_VERTICAL,
    FailureStory,
    Finding,
    RejectedCandidate,
    contact_of,
    number,
    numbers,
    word,
    words,
)  # fmt: skip
from .held_items import pressed_from_below
from .item_causes import MIN_ERROR, displacement_since, size_of
from .wording import counted, distance, force, place, seconds

STOP_FAILURES = frozenset(
    {"world.disturbed", "safety.force_limit", "safety.stop", "control.tracking", "control.timeout",
     "safety.torque_limit", "safety.watchdog", "planning.blocked"}
)  # fmt: skip
HAND_RANGE = 0.15
"""Distance from the fingers' joints within which fingers or held object may touch a body, m."""
TOUCH_MARGIN = 0.005
"""Margin around a body within which another body counts as touching it, m."""
ITEM_RANGE = 0.08
"""Distance from the hand within which an item was touched rather than an unknown obstacle next to it, m."""
MIN_ITEMS = 2
"""Least number of items that a hand meets from above where the tool, and no item, is the cause."""


def explain_contact(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding about the body near the stopped hand; None when the cause is no contact."""
    if (tool := case.once(_wrong_tool)) is not None and _stopped_from_below(failure):
        return tool
    pressed, item = pressed_from_below(failure), failure.item
    stopped = failure.cause in STOP_FAILURES or pressed
    if not stopped and not (failure.cause.startswith("safety.") and case.obstacles_near(failure.time)):
        return None
    stops = case.events(event_types.SafetyStopEvent, start=case.visit(failure).start, end=failure.time)
    time = stops[-1].time if stops else failure.time
    hand = case.hand(time)
    near = _items_near(case, failure, time, hand)
    verb = "the arm met something" if failure.cause == "world.disturbed" else "the arm was stopped"
    size, _ = contact_of(failure)
    if size is None and pressed:
        size = -(number(failure, "load") or 0.0)
    if size is not None and case.run.info.backend != "kinematic":  # a contact has no true force there
        verb = f"the arm met something with {force(size)}"
    where = f" on its way with {item}" if item else ""
    reasons = [f"at {seconds(time)} with the hand at {place(hand)}"] if hand else []

    def found(cause: str, about: str, title: str, *more: str) -> Finding:
        return Finding(cause, about, title, (*reasons, *more), item, time)

    unknown = next(iter(case.obstacles_near(time)), None)
    if unknown is not None and (not near or min(near)[0] > ITEM_RANGE):
        title = f"{verb}{where}: {unknown}, an obstacle that the robot did not know, was next to it"
        return found("contact.obstacle", unknown, title, _when_seen(case, time))
    if near:
        away, true = min(near)
        name, track = case.name_of(true), case.bodies.tracks[true]
        moving = displacement_since(case, true, max(time - 2.0, 0.0), time)
        reasons.append(f"{name} was {distance(away)} from the hand")
        if moving is not None:
            reasons.append(f"{name} moved by {distance(moving.way)} at about that time")
        if target := case.bin_at(track.before(time) or track.first):
            doing = f"while {item} was put there, " if failure.id == "Place" else ""
            return found("bin.crowded", target, f"{target} is too crowded: {doing}{verb}, next to {name}")
        return found("contact.item", true, f"{verb}{where}: {name} lay next to it")
    if pressed:
        return None
    if (under := _under_the_hand(case, failure, verb, time)) is not None:
        return under
    cause = word(failure, "stopped_by") or failure.cause
    return found(cause, item or failure.node, f"{verb}{where}: nothing known was near")


def _items_near(
    case: Investigation, failure: FailureStory, time: float, hand: Vector3 | None
) -> list[tuple[float, str]]:
    """Return the distances and true ids of other items near the hand, or of those next to the held one."""
    held = case.bodies.at(case.pairs.get(failure.item, ""), time) if pressed_from_below(failure) else None
    near: list[tuple[float, str]] = []
    for true in case.bodies.tracks if hand is not None else ():
        body = case.bodies.at(true, time)
        if body is None or hand is None or failure.item in case.believed.get(true, ()):
            continue
        reaches = held is None or _reach(held) + _reach(body) > horizontal_distance(held, body)
        if reaches and (away := math.dist(hand, body.pose.position)) < HAND_RANGE:
            near.append((away, true))
    return near


def _stopped_from_below(failure: FailureStory) -> bool:
    """Whether a body below stopped the hand on its way down to an item."""
    upward = contact_of(failure)[1] > MIN_VERTICAL
    return failure.id == "Grasp" and failure.cause in STOP_FAILURES and upward


def _wrong_tool(case: Investigation) -> Finding | None:
    """Return the finding that the hand is elsewhere than its model; else None.

    Items that were at their believed places stopped it from below.
    """
    found: dict[str, FailureStory] = {}
    for failure in case.failures:
        believed, true = case.last_believed(failure), case.pairs.get(failure.item, "")
        lies = case.bodies.at(true, case.visit(failure).start)
        if believed is None or lies is None or not _stopped_from_below(failure):
            continue
        if horizontal_distance(believed, lies) < MIN_ERROR and 0.9 < size_of(case, true, failure.time) < 1.1:
            found.setdefault(failure.item, failure)
    if len(found) < MIN_ITEMS:
        return None
    first = next(iter(found.values()))
    title = f"the hand is not where the robot's model has it: it met {listed(list(found), 3)} from above"
    reasons = ("they have the size of their kind, and were where they were believed to be",)
    return Finding("hand.off", "hand", title, reasons, "", first.time, "possible")


def _under_the_hand(case: Investigation, failure: FailureStory, verb: str, time: float) -> Finding | None:
    """Return the finding, without truth, that a hand on its way down to an item met it at another place."""
    upward = bool(numbers(failure, "direction")) and contact_of(failure)[1] > MIN_VERTICAL
    believed = case.last_believed(failure)
    if case.world.is_true or not upward or believed is None or believed.attached or failure.id != "Grasp":
        return None
    title = f"{failure.item} was not where it was believed to be: {verb} below the hand on its way down to it"
    reasons = (f"it was last seen at {seconds(believed.last_seen)}, at {place(believed.pose.position)}",)
    against = ("it may also be larger than its kind, or something unknown lies there",)
    return Finding("item.moved", failure.item, title, reasons, failure.item, time, "possible", against)


def hides(case: Investigation, camera: CameraDescription, body: log_records.BodyRecord, time: float) -> str:
    """Return the unknown obstacle on the ray from a camera to a body; empty without one."""
    origin, target = np.array(camera.pose.position), np.array(body.pose.position)
    for name, obstacle in case.obstacles_at(time):
        low, high = extents(obstacle.shape, np.eye(3))
        inverse = obstacle.pose.inverse()
        start, end = inverse.apply(origin), inverse.apply(target)
        way = np.where(np.abs(end - start) < 1e-9, 1e-9, end - start)
        enter, leave = (low - start) / way, (high - start) / way
        first, last = np.minimum(enter, leave).max(), np.maximum(enter, leave).min()
        if 0.0 <= first <= last and first <= 1.0:
            return name
    return ""


def explain_hidden(
    case: Investigation, item: str, body: log_records.BodyRecord, time: float
) -> Finding | None:
    """Return the finding that an unknown body hides an item from the fixed cameras; else None."""
    cameras = case.fixed_cameras
    found = [hides(case, camera, body, time) for camera in cameras]
    if not found or not all(found):
        return None
    title = f"{found[0]}, a body that the robot did not know, hides {item} from {cameras[0].name}"
    reasons = (f"{item} lies at {place(body.pose.position)}",)
    return Finding("scene.unknown_obstacle", found[0], title, reasons, item, time)


def obstacle_in(case: Investigation, bin_id: str, time: float) -> str:
    """Return the unknown obstacle that lies in a bin, or over it; empty without one."""
    target = case.bins.get(bin_id)
    if target is None:
        return ""
    for name, body in case.obstacles_at(time):
        x, y, z = (target.pose.inverse() @ body.pose).position
        low, high = extents(body.shape, body.pose.rotation())
        inside = abs(x) < target.size[0] / 2 + high[0] and abs(y) < target.size[1] / 2 + high[1]
        if inside and z + low[2] < target.size[2] + CLEARANCE:
            return name
    return ""


def _reach(body: log_records.BodyRecord) -> float:
    """Return the radius of the horizontal circle around a body, with a margin, m."""
    low, high = extents(body.shape, body.pose.rotation())
    return math.hypot(high[0] - low[0], high[1] - low[1]) / 2 + TOUCH_MARGIN


def _when_seen(case: Investigation, time: float) -> str:
    """Return a sentence about the last look before that time."""
    looks = case.events(ImageEvent, start=0.0, end=time)
    return (
        f"the camera looked for the last time at {seconds(looks[-1].time)}" if looks else "nobody had looked"
    )


CLEARANCE = 0.35
"""Height over a bin's rim, and width around an item, that hand and arm need, m."""


def fixture_above(case: Investigation, target: Bin) -> str:
    """Return the fixture that covers a bin, or reaches into the space over it; empty without one."""
    (x, y, z), (sx, sy, sz) = target.pose.position, target.size
    low, high = (x - sx / 2, y - sy / 2, z + sz), (x + sx / 2, y + sy / 2, z + sz + CLEARANCE)
    for name, fixture in case.fixtures.items():
        least, most = np.array(fixture.pose.position) + extents(fixture.shape, fixture.pose.rotation())
        if np.all(least < high) and np.all(most > low):
            return name
    return ""


OVERHANG = 0.1
"""Distance from a bin's side at which a link's centre still reaches over the bin, m."""


def explain_unreachable_bin(
    case: Investigation, failure: FailureStory, refused: Sequence[RejectedCandidate], total: int
) -> Finding | None:
    """Return the finding that no grasp leads to the item's bin: it is full, covered, or out of reach.

    `refused`: the `total` grasps, as far as the place or the way to it refused them.
    """
    lies = case.last_believed(failure)
    target = case.bins.get(case.destination(lies)) if lies else None
    if lies is None or target is None:
        return None
    name, most, item = str(target.id), max(refused, key=lambda each: each.count), failure.item
    reasons = tuple(f"{each.count} of {total} grasps: {each.reason}" for each in refused[:3])
    if (full := explain_full_bin(case, failure, name, reasons)) is not None:
        return full
    by, track = most.by.split("/")[0], case.belief.tracks.get(most.by)
    inside = [b.id for b in case.believed_at(failure.time) if b.place == target.id]
    cause, about = "bin.hemmed_in", name
    title = f"{item} cannot be let go over {name} without touching something"
    if unknown := obstacle_in(case, name, failure.time):
        cause, about = "scene.unknown_obstacle", unknown
        title = f"{unknown}, a body that the robot did not know, is in or over {name}"
    elif over := by if by in case.fixtures else fixture_above(case, target):
        cause, about = "scene.blocked", over
        title = f"{over} is in the way over {name}: {item} cannot be put there"
    elif track is not None and track.first.role == "obstacle":
        cause, about = "scene.unknown_obstacle", most.by
        title = f"something unknown ({most.by}) is seen in the way over {name}"
    elif most.stage == pick_candidates.PLACE_STAGE and track is None:
        cause = "bin.out_of_reach"
        title = f"over {name} the arm would be in {by}" if by else f"the arm does not reach over {name}"
        title += f": {item} cannot go there"
    elif inside:
        cause, reasons = "bin.crowded", (*reasons, f"{name} contains {listed(inside, 5)}")
        title = f"{name} is too crowded for {item}: the hand finds no place over it to let go"
    return failure.finding(cause, about, title, reasons)


def explain_full_bin(
    case: Investigation, failure: FailureStory, bin_id: str, reasons: tuple[str, ...] = ()
) -> Finding | None:
    """Return the finding that the believed items leave no free spot in the bin; else None."""
    target = case.bins.get(bin_id)
    if target is None:
        return None
    inside = [b for b in case.believed_at(failure.time) if b.place == bin_id]
    item = case.belief.at(failure.item, failure.time)
    if failure.cause != "place.full":
        heights = release_poses.heap_heights(target, [_object(b) for b in inside], None)
        if item is None or release_poses.free_cells(target, heights, item.shape, item.pose.rotation()):
            return None
    size = " × ".join(f"{s * 100:.0f}" for s in target.size)
    lie = f"{counted(len(inside), 'item')} {'lies' if len(inside) == 1 else 'lie'} in it"
    title = f"{bin_id} was full when {failure.item} was to go there: {lie}, and it measures {size} cm"
    content = f"in it at {seconds(failure.time)}: {listed([b.id for b in inside], 8) or 'nothing'}"
    return failure.finding("bin.full", bin_id, title, (*reasons, content))


def _object(body: log_records.BodyRecord) -> BeliefObject:
    kind = body.kind, body.form, body.shape, body.colour
    seen = body.pose, body.sigma_position, body.sigma_angle, body.confidence, body.last_seen
    return BeliefObject(*kind, *seen, id=ObjectId(body.id), place=body.place)


PLACE_STAGES = (pick_candidates.ROOM_STAGE, pick_candidates.PLACE_STAGE, pick_candidates.TRANSFER_STAGE)
HAND_CONTACT = re.compile(r"the hand would touch (.+)")
COLLISION_PAIR = re.compile(r"(\S+) (?:only )?[\d.]+ mm (?:deep in|from) (\S+)")
UNREACHABLE = "is out of reach or in collision"


def explain_obstruction(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding about a failed plan or choice of grasps; None for other causes, or without
    evidence."""
    item, message = failure.item, failure.message
    match failure.cause:
        case "grasp.no_candidate" if held := word(failure, "held"):
            title = f"the hand was not free for {item}: it still held {held}"
            return failure.finding("grasp.hand_not_free", held, title)
        case "grasp.no_candidate":
            return _no_grasp(case, failure)
        case "place.full":
            bin_id = word(failure, "bin")
            if unknown := obstacle_in(case, bin_id, failure.time):
                title = f"{unknown}, a body that the robot did not know, fills {bin_id}"
                return failure.finding("scene.unknown_obstacle", unknown, title)
            return explain_full_bin(case, failure, bin_id)
        case "perception.not_found" if lies := case.bodies.at(case.pairs.get(item, ""), failure.time):
            return explain_hidden(case, item, lies, failure.time)
        case "place.occupied":
            return _occupied(case, failure)
        case "planning.budget":
            return _budget(failure)
        case "planning.no_ik":
            title = f"{_doing(failure)} is out of the arm's reach: {message}"
            cause = "bin.out_of_reach" if failure.id == "Place" else "item.out_of_reach"
            return failure.finding(cause, item or failure.node, title)
        case "planning.no_path" if item and failure.evidence.get("joint"):
            joint = word(failure, "joint")
            title = f"the arm cannot move straight down to {item}: {joint} is at its limit there"
            return failure.finding("item.out_of_reach", item, title, (message,))
        case "feed.obstructed":
            return _under_arm(case, failure)
        case _ if failure.cause.startswith("planning."):
            return _touching(case, failure, _pairs(words(failure, "pairs")), ())
        case _:
            return None


def _under_arm(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that the arm stayed over a bin to be exchanged; None when the body is no bin."""
    bin_ = case.bins.get(word(failure, "bin"))
    links = case.links(failure.time)
    if bin_ is None or not len(links):
        return None
    x, y, _ = bin_.pose.inverse().apply(links).T
    over = links[(abs(x) < bin_.size[0] / 2 + OVERHANG) & (abs(y) < bin_.size[1] / 2 + OVERHANG)]
    if not len(over):
        return None
    height = over[:, 2].min() - (bin_.pose.position[2] + bin_.size[2])
    reason = f"at {seconds(failure.time)} it was {max(0.0, 1000.0 * height):.0f} mm above the rim"
    title = f"the arm stayed over {bin_.id}, which is exchanged when nothing is over it"
    return Finding("bin.under_arm", str(bin_.id), title, (reason,), "", failure.time)


def _no_grasp(case: Investigation, failure: FailureStory) -> Finding | None:
    choice = next((c for c in reversed(failure.choices) if c.purpose != "plan"), None)
    if choice is None or not choice.rejections:
        return None
    total = sum(r.count for r in choice.rejections)
    touched: Counter[str] = Counter()
    hindered: Counter[str] = Counter()
    nowhere = [r for r in choice.rejections if r.stage in PLACE_STAGES]
    far = 0
    for rejection in choice.rejections:
        match, by = HAND_CONTACT.match(rejection.reason), rejection.by.split("/")[0]
        if rejection.stage in PLACE_STAGES:
            continue
        if match:
            touched[by or match.group(1).split("/")[0]] += rejection.count
        elif rejection.stage or UNREACHABLE in rejection.reason:
            far += rejection.count
            hindered += Counter({by: rejection.count} if by else {})
    if nowhere and sum(each.count for each in nowhere) >= max(far, touched.total()):
        return explain_unreachable_bin(case, failure, nowhere, total)
    if far >= touched.total():
        return _far(case, failure, far, total, hindered)
    tried = tuple(
        f"in {count} of {total} grasps the hand would touch {name}" for name, count in touched.most_common(4)
    )
    return _touching(case, failure, touched, tried)


def _touching(
    case: Investigation, failure: FailureStory, touched: Counter[str], reasons: tuple[str, ...]
) -> Finding | None:
    """Return the finding by the kind of the body that would be touched: fixture, obstacle, neighbour, bin."""
    reasons = reasons or (failure.message,)
    about, doing, tracks = failure.item or failure.name, _doing(failure), case.belief.tracks
    most = [name for name, _ in touched.most_common()]
    fixed = [name for name in most if name in case.fixtures]
    unknown = [name for name in most if name in tracks and tracks[name].first.role == "obstacle"]
    neighbours = [name for name in most if name in tracks and name != failure.item]
    walls = [name for name in most if name in case.bins]
    table = ["table"] if "table" in most else []
    if fixed or (table and not (unknown or neighbours or walls)):
        blocked, name = (fixed[0], fixed[0]) if fixed else ("table", "the table")
        return failure.finding("scene.blocked", blocked, f"{name} is in the way of {doing}", reasons)
    if unknown:
        title = f"something unknown ({unknown[0]}) is seen in the way of {doing}"
        return failure.finding("scene.unknown_obstacle", unknown[0], title, reasons)
    if neighbours and failure.cause == "planning.start_in_collision":
        # The hand may just have let go of something there: where that lies is a guess.
        begun = failure.name_and_item
        title = f"by the belief, the hand was inside {listed(neighbours, 3)} when {begun} was about to start"
        return Finding("item.crowded", "hand", title, reasons, neighbours[0], failure.time)
    if neighbours:
        title = f"{about} lies too close to {listed(neighbours, 3)}: there is no room for the hand"
        return failure.finding("item.crowded", "", title, reasons)
    if walls:
        title = f"{about} lies too close to {walls[0]}: its walls are in the way of the hand"
        return failure.finding("item.beside_bin", about, title, reasons)
    return None


def _doing(failure: FailureStory) -> str:
    about = f" {failure.item}" if failure.item else ""
    verbs = {"Grasp": f"the hand at{about}", "Place": f"placing{about}", "GoTo": "the arm on its way"}
    return verbs.get(failure.id, failure.id)


def _far(
    case: Investigation, failure: FailureStory, far: int, total: int, hindered: Counter[str]
) -> Finding | None:
    """Return the finding about a grasp that the arm cannot reach. `hindered`: contacts of the arm, by
    body."""
    item, lies = failure.item, case.last_believed(failure)
    where = f" at {place(lies.pose.position)}" if lies else ""
    touched = (f"in {n} of {total} grasps the arm would touch {by}" for by, n in hindered.most_common(3))
    reasons = (f"{far} of {total} grasps were out of reach or in collision", *touched)
    fixed = [name for name, _ in hindered.most_common() if name in case.fixtures]
    cause, about = "item.hemmed_in", item
    title = f"the arm cannot get to {item}{where} without touching something"
    if fixed:
        cause, about, title = "scene.blocked", fixed[0], f"{fixed[0]} is in the way of the arm at {item}"
    elif not any(name in case.bins or name in case.belief.tracks for name in hindered):
        cause = "item.out_of_reach"
        title = f"{item} lies{where}, where the arm does not reach it from above"
    return failure.finding(cause, about, title, reasons)


def _occupied(case: Investigation, failure: FailureStory) -> Finding | None:
    by, at = word(failure, "by"), case.ports(failure.node).get("at", "")
    lies = case.last_believed(failure)
    belongs = "" if lies is None else case.destination(lies)
    if at and belongs in case.bins:
        title = f"the mission puts {failure.item} down at {at}, and it belongs into {belongs}"
        reasons = (f"{failure.node} has at: {at}", f"{by or 'something'} was there already")
        return failure.finding("mission.put_elsewhere", failure.node, title, reasons)
    cause = "scene.blocked" if by in case.fixtures else "place.occupied"
    title = f"{by or 'something'} stands where {failure.item} should go"
    return failure.finding(cause, by or failure.node, title)


def _budget(failure: FailureStory) -> Finding:
    checks = number(failure, "checks")
    used = f"{checks:.0f}" if checks is not None else "its"
    title = f"the planner ran out of its budget before it found a way: {failure.message}"
    reasons = (
        f"{used} collision checks were spent; they did not show whether the way is free",
        "the straight way was not free, so a way round had to be searched for",
    )
    return failure.finding("planner.budget", failure.node, title, reasons)


def _pairs(pairs: Sequence[str]) -> Counter[str]:
    """Return the number of contacts by body, from texts such as `panda_hand 3.2 mm deep in shelf`."""
    found = (COLLISION_PAIR.match(pair) for pair in pairs)
    return Counter(match.group(2).split("/")[0] for match in found if match)
