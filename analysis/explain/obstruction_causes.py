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
from picktree.world import BeliefObject, ObjectId, event_types, extents
from picktree.world.scene import Bin, CameraDescription, Fixture

from .body_tracks import horizontal_distance
from .case import Investigation
from .explanation import (
    FailureStory,
    Finding,
    RejectedCandidate,
    counted,
    distance,
    force,
    number,
    numbers,
    place,
    seconds,
    word,
    words,
)
from .held_items import pressed_from_below
from .item_causes import MIN_ERROR, displacement_since, size_of

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


def explain_contact(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding about the body near the stopped hand; None when the cause is no contact."""
    if (tool := case.once(_wrong_tool)) is not None and _stopped_from_below(failure):
        return tool
    stopped = failure.cause in STOP_FAILURES or pressed_from_below(failure)
    if not stopped and not (failure.cause.startswith("safety.") and case.obstacles_near(failure.time)):
        return None
    stops = case.events(event_types.SafetyStopEvent, start=case.visit(failure).start, end=failure.time)
    time = stops[-1].time if stops else failure.time
    hand = case.hand(time)
    felt = _felt(failure)
    reasons = [f"at {seconds(time)} with the hand at {place(hand)}"] if hand else []
    near: list[tuple[float, str]] = []
    held = case.bodies.at(case.pairs.get(failure.item, ""), time) if pressed_from_below(failure) else None
    for true in case.bodies.tracks:
        body = case.bodies.at(true, time)
        if body is not None and hand is not None and failure.item not in case.believed.get(true, ()):
            away = math.dist(hand, body.pose.position)
            if away < HAND_RANGE and (
                held is None or _reach(held) + _reach(body) > horizontal_distance(held, body)
            ):
                near.append((away, true))
    if case.run.info.backend == "kinematic":
        felt = ""  # a contact has no true force there
    met = "the arm met something" if failure.cause == "world.disturbed" else "the arm was stopped"
    verb = f"the arm met something with {felt}" if felt else met
    where = f" on its way with {failure.item}" if failure.item else ""
    unknown = next(iter(case.obstacles_near(time)), None)
    if unknown is not None and (not near or min(near)[0] > ITEM_RANGE):
        title = f"{verb}{where}: {unknown}, an obstacle that the robot did not know, was next to it"
        reasons.append(_when_seen(case, time))
        return Finding("contact.obstacle", unknown, title, tuple(reasons), failure.item, time)
    if near:
        away, true = min(near)
        name = case.name_of(true)
        moving = displacement_since(case, true, max(time - 2.0, 0.0), time)
        reasons.append(f"{name} was {distance(away)} from the hand")
        if moving is not None:
            reasons.append(f"{name} moved by {distance(moving.way)} at about that time")
        target = case.bin_at(case.bodies.tracks[true].before(time) or case.bodies.tracks[true].first)
        if target:
            doing = f"while {failure.item} was put there, " if failure.id == "Place" else ""
            title = f"{target} is too crowded: {doing}{verb}, next to {name}"
            return Finding("bin.crowded", target, title, tuple(reasons), failure.item, time)
        title = f"{verb}{where}: {name} lay next to it"
        return Finding("contact.item", true, title, tuple(reasons), failure.item, time)
    if pressed_from_below(failure):
        return None
    if (under := _under_the_hand(case, failure, verb, time)) is not None:
        return under
    title = f"{verb}{where}: nothing known was near"
    about = failure.item or failure.node
    return Finding(
        word(failure, "stopped_by") or failure.cause, about, title, tuple(reasons), failure.item, time
    )


MIN_UPWARD = 0.8
"""Vertical component of a contact's direction from which something below the hand was touched."""


def _stopped_from_below(failure: FailureStory) -> bool:
    """Whether a body below stopped the hand on its way down to an item."""
    direction = numbers(failure, "direction") or numbers(failure, "force")
    size = math.hypot(*direction)
    upward = len(direction) == 3 and size > 0.0 and direction[2] / size > MIN_UPWARD
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


MIN_ITEMS = 2
"""Least number of items that a hand meets from above where the tool, and no item, is the cause."""


def _under_the_hand(case: Investigation, failure: FailureStory, verb: str, time: float) -> Finding | None:
    """Return the finding, without truth, that a hand on its way down to an item met it at another place."""
    direction = numbers(failure, "direction")
    upward = len(direction) == 3 and direction[2] > MIN_UPWARD
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
    cameras = [c for c in case.scene.cameras if c.on == "world"] if case.scene else []
    found = [hides(case, camera, body, time) for camera in cameras]
    if not found or not all(found):
        return None
    title = f"{found[0]}, a body that the robot did not know, hides {item} from {cameras[0].name}"
    reasons = (f"{item} lies at {place(body.pose.position)}",)
    return Finding("scene.unknown_obstacle", found[0], title, reasons, item, time)


def obstacle_in(case: Investigation, bin_id: str, time: float) -> str:
    """Return the unknown obstacle that lies in a bin, or over it; empty without one."""
    target = case.bins.get(bin_id)
    for name, body in case.obstacles_at(time) if target is not None else ():
        assert target is not None
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


def _felt(failure: FailureStory) -> str:
    vector = numbers(failure, "force")
    size = math.hypot(*vector) if vector else number(failure, "force")
    if size is None and pressed_from_below(failure):
        size = -(number(failure, "load") or 0.0)
    return force(size) if size is not None else ""


CLEARANCE = 0.35
"""Height over a bin's rim, and width around an item, that hand and arm need, m."""


def fixture_above(case: Investigation, target: Bin) -> str:
    """Return the fixture that covers a bin, or reaches into the space over it; empty without one."""
    (x, y, z), (sx, sy, sz) = target.pose.position, target.size
    low, high = (x - sx / 2, y - sy / 2, z + sz), (x + sx / 2, y + sy / 2, z + sz + CLEARANCE)
    return next((name for name, fixture in case.fixtures.items() if _overlap(fixture, low, high)), "")


def _overlap(fixture: Fixture, low: Sequence[float], high: Sequence[float]) -> bool:
    least, most = extents(fixture.shape, fixture.pose.rotation())
    at = np.array(fixture.pose.position)
    return bool(np.all(at + least < np.array(high)) and np.all(at + most > np.array(low)))


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
    name, most = str(target.id), max(refused, key=lambda each: each.count)
    reasons = tuple(f"{each.count} of {total} grasps: {each.reason}" for each in refused[:3])
    if (full := explain_full_bin(case, failure, name, reasons)) is not None:
        return full
    if unknown := obstacle_in(case, name, failure.time):
        title = f"{unknown}, a body that the robot did not know, is in or over {name}"
        return failure.finding("scene.unknown_obstacle", unknown, title, reasons)
    by, track = most.by.split("/")[0], case.belief.tracks.get(most.by)
    over = by if by in case.fixtures else fixture_above(case, target)
    if over:
        title = f"{over} is in the way over {name}: {failure.item} cannot be put there"
        return failure.finding("scene.blocked", over, title, reasons)
    if track is not None and track.first.role == "obstacle":
        title = f"something unknown ({most.by}) is seen in the way over {name}"
        return failure.finding("scene.unknown_obstacle", most.by, title, reasons)
    if most.stage == pick_candidates.PLACE_STAGE and track is None:
        title = f"over {name} the arm would be in {by}" if by else f"the arm does not reach over {name}"
        title += f": {failure.item} cannot go there"
        return failure.finding("bin.out_of_reach", name, title, reasons)
    inside = [b.id for b in case.believed_at(failure.time) if b.place == target.id]
    if inside:
        title = f"{name} is too crowded for {failure.item}: the hand finds no place over it to let go"
        reasons = (*reasons, f"{name} contains {listed(inside, 5)}")
        return failure.finding("bin.crowded", name, title, reasons)
    title = f"{failure.item} cannot be let go over {name} without touching something"
    return failure.finding("bin.hemmed_in", name, title, reasons)


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
    title = (
        f"{bin_id} was full when {failure.item} was to go there: {counted(len(inside), 'item')} "
        f"{'lies' if len(inside) == 1 else 'lie'} in it, and it measures {size} cm"
    )
    evidence = (
        *reasons,
        f"in it at {seconds(failure.time)}: {listed([b.id for b in inside], 8) or 'nothing'}",
    )
    return failure.finding("bin.full", bin_id, title, evidence)


def _object(body: log_records.BodyRecord) -> BeliefObject:
    return BeliefObject(
        body.kind,
        body.form,
        body.shape,
        body.colour,
        body.pose,
        body.sigma_position,
        body.sigma_angle,
        body.confidence,
        body.last_seen,
        id=ObjectId(body.id),
        place=body.place,
    )


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
    far, nowhere = 0, list[RejectedCandidate]()
    for rejection in choice.rejections:
        reason, count = rejection.reason, rejection.count
        match = HAND_CONTACT.match(reason)
        if rejection.stage in PLACE_STAGES:
            nowhere.append(rejection)
        elif match:
            touched[(rejection.by or match.group(1)).split("/")[0]] += count
        elif rejection.stage or UNREACHABLE in reason:
            far += count
            if rejection.by:
                hindered[rejection.by.split("/")[0]] += count
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
    about = failure.item or failure.name
    most = [name for name, _ in touched.most_common()]
    tracks = case.belief.tracks
    if fixed := [name for name in most if name in case.fixtures]:
        title = f"{fixed[0]} is in the way of {_doing(failure)}"
        return failure.finding("scene.blocked", fixed[0], title, reasons)
    if unknown := [name for name in most if name in tracks and tracks[name].first.role == "obstacle"]:
        title = f"something unknown ({unknown[0]}) is seen in the way of {_doing(failure)}"
        return failure.finding("scene.unknown_obstacle", unknown[0], title, reasons)
    neighbours = [name for name in most if name in tracks and name != failure.item]
    if neighbours and failure.cause == "planning.start_in_collision":
        # The hand may just have let go of something there: where that lies is a guess.
        begun = failure.name_and_item
        title = f"by the belief, the hand was inside {listed(neighbours, 3)} when {begun} was about to start"
        return Finding("item.crowded", "hand", title, reasons, neighbours[0], failure.time)
    if neighbours:
        title = f"{about} lies too close to {listed(neighbours, 3)}: there is no room for the hand"
        return failure.finding("item.crowded", "", title, reasons)
    if walls := [name for name in most if name in case.bins]:
        title = f"{about} lies too close to {walls[0]}: its walls are in the way of the hand"
        return failure.finding("item.beside_bin", about, title, reasons)
    if "table" in most:
        return failure.finding(
            "scene.blocked", "table", f"the table is in the way of {_doing(failure)}", reasons
        )
    return None


def _doing(failure: FailureStory) -> str:
    verb = {"Grasp": "the hand at", "Place": "placing", "GoTo": "the arm on its way"}.get(
        failure.id, failure.id
    )
    return f"{verb} {failure.item}" if failure.item and failure.id in ("Grasp", "Place") else verb


def _far(
    case: Investigation, failure: FailureStory, far: int, total: int, hindered: Counter[str]
) -> Finding | None:
    """Return the finding about a grasp that the arm cannot reach. `hindered`: contacts of the arm, by
    body."""
    item, lies = failure.item, case.last_believed(failure)
    where = f" at {place(lies.pose.position)}" if lies else ""
    refused = f"{far} of {total} grasps were out of reach or in collision"
    reasons = tuple(f"in {n} of {total} grasps the arm would touch {by}" for by, n in hindered.most_common(3))
    if fixed := [name for name, _ in hindered.most_common() if name in case.fixtures]:
        title = f"{fixed[0]} is in the way of the arm at {item}"
        return failure.finding("scene.blocked", fixed[0], title, (refused, *reasons))
    if not any(name in case.bins or name in case.belief.tracks for name in hindered):
        title = f"{item} lies{where}, where the arm does not reach it from above"
        return failure.finding("item.out_of_reach", item, title, (refused, *reasons))
    title = f"the arm cannot get to {item}{where} without touching something"
    return failure.finding("item.hemmed_in", item, title, (refused, *reasons))


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
