"""Causes of unsorted items without a failure, and of things left in a tote."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import yaml

from picktree.files import listed
from picktree.logs import log_records
from picktree.world import Pose, event_types, extents, grasp, heap_geometry
from picktree.world.scene import Bin, destinations

from .body_tracks import between as records_between
from .camera_causes import explain_hidden_by_arm
from .case import Investigation
from .explanation import FailureStory, Finding
from .held_items import holds_of
from .item_causes import (
    displacement_since,
    explain_late_arrival,
    explain_never_seen,
    explain_unrecognised_size,
    taken_item,
)
from .obstruction_causes import explain_hidden
from .wording import between, counted, distance, place, seconds, times

THING_RADIUS = 0.035
"""Distance from a thing's centre within which grasps and failed closings belong to it, m."""
MIN_GRIP_HEIGHT = 0.0125
"""Height above the tote's floor below which the pads cannot grip, m."""
COVER_DEPTH = 0.012
"""Depth below the visible surface from which a thing is hidden, m: columns have steps of 6 mm."""
FINGER_ROOM = 0.021
"""Distance from a wall below which no finger fits in between, m."""
SEARCH_TIME = 3.0
"""Time before a failure within which the log has its search for a grasp, s."""


@dataclass(frozen=True, slots=True)
class Remainder:
    """Thing that is left in a tote."""

    true: str
    name: str
    """Colour and kind, with the id."""
    at: str
    state: str
    """State of it in words: hidden, flat, at a wall, or free."""
    tried: str
    """Results of the grasps near it, in words."""

    def __str__(self) -> str:
        return f"{self.name} at {self.at}: {self.state}; {self.tried}"


def explain_left_in_tote(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return what was left in the tote when the last search for grasps in it failed, before it was exchanged.

    None when the failure is no such search.
    """
    searched = failure.cause == grasp.NO_CANDIDATE.name
    return case.once(_left_in_totes).get(_delivery(case, failure)) if searched else None


def explain_left_thing(case: Investigation, true: str) -> Finding | None:
    """Return the finding about a thing left in a tote, from the last search for grasps there."""
    found = reversed(case.once(_left_in_totes).values())
    return next((one for one in found if any(f"({true})" in reason for reason in one.reasons)), None)


def _delivery(case: Investigation, failure: FailureStory) -> tuple[str, int]:
    """Return the tote of a search for grasps, and its number of exchanges before the search."""
    tote = str(failure.evidence.get("object"))
    exchanges = (at.time for at in case.events(event_types.BinExchangedEvent) if at.record.bin == tote)
    return tote, sum(time <= failure.time for time in exchanges)


def _left_in_totes(case: Investigation) -> dict[tuple[str, int], Finding]:
    """Return what was left of each delivery, by its tote and number, in the order of the last searches."""
    last: dict[tuple[str, int], float] = {}
    for failure in case.failures:
        tote = case.bins.get(str(failure.evidence.get("object")))
        if failure.cause == grasp.NO_CANDIDATE.name and tote is not None and tote.is_tote:
            delivery = _delivery(case, failure)
            last.pop(delivery, None)
            last[delivery] = failure.time
    return {delivery: _left(case, *delivery, time) for delivery, time in last.items()}


def _left(case: Investigation, tote: str, number: int, time: float) -> Finding:
    left = remains(case, tote, time)
    if not left:
        reasons = (f"{case.truly}nothing was left in it at {seconds(time)}",)
        return Finding("heap.empty", tote, f"{tote} was empty", reasons, "", time)
    states = Counter(one.state.split(",")[0] for one in left).most_common()
    counts = listed([f"{n} {state}" for state, n in states], 5)
    title = f"{counted(len(left), 'thing')} in {tote} got no grasp: {counts}"
    return Finding("heap.out_of_reach", f"{tote} {number}", title, tuple(map(str, left)), "", time)


def remains(case: Investigation, tote: str, time: float) -> list[Remainder]:
    """Return the things that truly lie in a tote at that time."""
    bin_ = case.bins.get(tote)
    if bin_ is None or not bin_.is_tote:
        return []
    scene = case.run.at(time).belief
    believed = scene.bodies if scene else ()
    heap = next((body for body in believed if body.id == heap_geometry.heap_id(tote)), None)
    refused, vain = _refused(case, tote, time), _failed_closings(case, time)
    bodies = ((true, case.bodies.at(true, time)) for true in case.bodies.tracks)
    return [
        Remainder(
            true,
            f"the {body.colour} {'thing' if body.kind == 'unknown' else body.kind} ({true})",
            place(body.pose.position),
            lying(bin_, heap, body),
            _tried(refused, vain, body),
        )
        for true, body in bodies
        if body is not None and case.bin_at(body) == tote
    ]


def lying(tote: Bin, heap: log_records.BodyRecord | None, body: log_records.BodyRecord) -> str:
    """Return how a thing lies in a tote, in words. `heap`: the columns that were seen."""
    pose = tote.pose.inverse() @ body.pose
    (low, high), (inner_low, inner_high) = extents(body.shape, pose.rotation()), tote.inside()
    height = pose.position[2] + float(high[2]) - inner_low[2]
    over = -math.inf if heap is None else _column(heap, body.pose.position) - body.pose.position[2]
    if over - float(high[2]) > COVER_DEPTH:
        return "hidden below other things"
    if height < MIN_GRIP_HEIGHT:
        return f"flat, {1000 * max(0.0, height):.0f} mm high"
    at = np.array(pose.position)
    walls = np.minimum(np.subtract(inner_high, at + high), at + low - inner_low)
    gap = max(0.0, float(walls[:2].min()))
    return f"at a wall, {distance(gap)} from it" if gap < FINGER_ROOM else "seen and away from the walls"


def _column(heap: log_records.BodyRecord, point: Sequence[float]) -> float:
    """Return the height of the heap's columns at a point of the world, m; -inf without a column."""
    x, y, _ = (heap.pose.inverse() @ Pose((point[0], point[1], point[2]))).position
    tops = (
        block.at[2] + block.size[2] / 2
        for block in heap.blocks
        if abs(x - block.at[0]) <= block.size[0] / 2 and abs(y - block.at[1]) <= block.size[1] / 2
    )
    return heap.pose.position[2] + max(tops, default=-math.inf)


def _refused(case: Investigation, tote: str, time: float) -> list[tuple[Sequence[float], str]]:
    """Return place and reason of the grasps that the last search before that time refused."""
    heap = heap_geometry.heap_id(tote)
    searches = records_between(case.run.candidates, time - SEARCH_TIME, time)
    tried = (one for at in searches if at.record.object == heap for one in at.record.tried)
    return [(one.position, f"would touch {one.by}" if one.by else one.verdict) for one in tried]


def _failed_closings(case: Investigation, time: float) -> list[Sequence[float]]:
    """Return the places of the closings before that time that held nothing."""
    found: list[Sequence[float]] = []
    for at in case.events(event_types.PickEvent, end=time):
        if not at.record.held:
            searches = (one for one in case.run.candidates if one.time <= at.time)
            tried = [c for one in searches for c in one.record.tried if c.name == at.record.candidate]
            found += [tried[-1].position] if tried else []
    return found


def _tried(
    refused: Sequence[tuple[Sequence[float], str]],
    vain: Sequence[Sequence[float]],
    body: log_records.BodyRecord,
) -> str:
    def near(position: Sequence[float]) -> bool:
        return math.dist(position[:2], body.pose.position[:2]) < THING_RADIUS

    reasons = Counter(reason for position, reason in refused if near(position))
    failed = sum(near(position) for position in vain)
    words = [f"closed on it without holding it {times(failed)}"] if failed else []
    if reasons:
        why = listed([f"{n} {reason}" for reason, n in reasons.most_common()], 3)
        words.append(f"{counted(reasons.total(), 'grasp')} refused: {why}")
    return ", ".join(words) or "no grasp was found on it"


PLACING_TIME = 1.0
"""Time around a placement within which the item pushes others, or bounces, s."""
PUSH_RANGE = 0.35
"""Greatest distance of an item pushed out of a bin one second later, m."""


def explain_unsorted(case: Investigation, true: str) -> Finding | None:
    """Return the finding about an item that the scorer calls left or misplaced; None without evidence."""
    if not case.believed.get(true):
        return (
            _gone_before_seen(case, true)
            or explain_left_thing(case, true)
            or explain_late_arrival(case, true)
            or explain_unrecognised_size(case, true)
            or explain_hidden(case, case.name_of(true), case.bodies.tracks[true].first, case.end)
            or explain_hidden_by_arm(case, true)
            or explain_never_seen(case, true)
        )
    done = _placed(case, true)
    if done is None:
        return _taken(case, true, "") or _set_aside(case, true) or _not_tried(case, true)
    if not done.into:
        return _taken(case, true, "") or _put_elsewhere(case, true, done)
    return (
        _wrong_bin(case, true, done)
        or _taken(case, true, done.into)
        or _not_seated(case, true, done)
        or _left_bin(case, true, done)
    )


def explain_crushed_item(case: Investigation, true: str) -> Finding | None:
    """Return the finding that a finger crushed an item, which is lost at any place; else None."""
    found = [at.record for at in case.events(event_types.CrushedEvent) if at.record.object == true]
    if not found:
        return None
    first, item = found[0], case.name_of(true)
    force = f"{max(each.force for each in found):.0f} N"
    withstands = f"the item withstands {first.limit:.0f} N"
    title = f"{item} was crushed: {first.finger} pressed with {force}, and {withstands}"
    body = case.bodies.tracks[true].before(first.time)
    how = "it was not in the hand then"
    if any(p.start <= first.time <= p.end for p in holds_of(case, true)):
        how = "it was in the hand then"
    elif body is not None:
        how += f": it lay at {place(body.pose.position)}"
    reasons = (f"a force above that was first measured at {seconds(first.time)}", how)
    return Finding("item.crushed", true, title, reasons, item, first.time)


def explain_wrong_bin(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that the item was placed in a wrong bin before the failure; else None."""
    true = case.pairs.get(failure.item, "")
    done = _placed(case, true, failure.time)
    return None if done is None else _wrong_bin(case, true, done)


def placed_at(case: Investigation, true: str) -> float | None:
    """Return the believed time of the item's last placement, s; None without one."""
    done = _placed(case, true)
    return None if done is None else done.time


@dataclass(frozen=True, slots=True)
class Placement:
    """Believed placement of an item."""

    time: float
    item: str
    into: str
    """Bin or hole; empty for any other place."""
    node: str


def _placed(case: Investigation, true: str, until: float = math.inf) -> Placement | None:
    """Return the last placement of an item."""
    names = case.believed.get(true, ())
    found = [at for at in case.events(event_types.ItemDoneEvent, end=until) if at.record.object in names]
    if not found:
        return None
    done = found[-1].record
    return Placement(found[-1].time, done.object, done.into or "", done.node)


def _gone_before_seen(case: Investigation, true: str) -> Finding | None:
    if (gone := case.gone(true)) is None:
        return None
    title = f"{case.name_of(true)} was taken away before it was ever seen"
    reasons = (f"the log has its true place until {seconds(gone[0])}, and not after that",)
    return Finding("item.gone", true, title, reasons, true, gone[0])


def _taken(case: Investigation, true: str, into: str) -> Finding | None:
    if case.gone(true) is None:
        return None
    item = case.believed[true][-1]
    where = f"away out of {into}, where it had been placed," if into else "away,"
    unnoticed = not any(f.item == item for f in case.failures)
    noted = "nothing failed: the robot still believed that it was there"
    return taken_item(case, true, item, where, noted if unnoticed else "the robot believed otherwise")


def _put_elsewhere(case: Investigation, true: str, done: Placement) -> Finding:
    """Return the finding that the mission itself put the item down at a wrong place."""
    belongs, item, node = case.verdicts[true].destination, done.item, done.node
    lies, at = place(case.bodies.tracks[true].last.pose.position), case.ports(node).get("at")
    title = f"the mission puts {item} down at {lies}, and it belongs into {belongs or 'no bin'}"
    reason = f"{node} put it down at {seconds(done.time)}" if at is None else f"{node} has at: {at}"
    return Finding("mission.put_elsewhere", node, title, (reason,), item, done.time)


def _set_aside(case: Investigation, true: str) -> Finding | None:
    names = case.believed.get(true, ())
    found = [at for at in case.events(event_types.SetAsideEvent) if at.record.object in names]
    if not found:
        return None
    time, event = found[-1].time, found[-1].record
    title = f"the mission sets {event.object} aside: {event.node.rsplit('/', 1)[-1]} leaves it where it lies"
    return Finding("mission.set_aside", event.node, title, (f"at {seconds(time)}",), event.object, time)


def _wrong_bin(case: Investigation, true: str, done: Placement) -> Finding | None:
    real, item, into = case.bodies.tracks[true].last, done.item, done.into
    into_port = case.ports(done.node).get("into", "")
    believed = _believed_for(case, item, into if "{" in into_port else "")
    judged = case.verdicts.get(true)
    belongs = case.destination(real) if judged is None else judged.destination
    if not into or not belongs or destinations.is_at(into, belongs):
        return None
    placed = f"it was placed into {into} and belongs into {belongs}"
    as_believed = case.destination(believed) == into
    if as_believed and (believed.colour, believed.kind) != (real.colour, real.kind):
        mistaken = f"taken for a {believed.colour} {believed.kind} and is a {real.colour} {real.kind}"
        about = f"{real.colour} as {believed.colour}" if real.colour != believed.colour else true
        return Finding("perception.mistaken", about, f"{item} was {mistaken}: {placed}", (), item, None)
    if as_believed and (wrong := _mistaken_traits(case, believed, real)):
        title = f"{item} was placed into {into} and belongs into {belongs}: {listed(wrong, 3)}"
        reasons = [f"{each.to} for {each.where}" for each in case.scene.destinations] if case.scene else []
        later = case.belief.tracks[item].last
        if _mass(later) != _mass(believed):
            reasons.append(f"later {_mass(later)} were felt; its bin had been chosen by then")
        return Finding("perception.mistaken", wrong[0].split(",")[0], title, tuple(reasons), item, None)
    name = done.node.rsplit("/", 1)[-1]
    title = f"the mission takes items into {into} that belong into {belongs}: {name} of {item} says so"
    reasons = (
        f"{done.node} has into: {into_port}" if into_port else f"{done.node} placed it into {into}",
        f"by the scene's rules a {real.colour} {real.kind} belongs into {belongs}",
    )
    return Finding("mission.wrong_bin", done.node, title, reasons, item, None)


def _believed_for(case: Investigation, item: str, into: str) -> log_records.BodyRecord:
    """Return what was last believed of an item while it belonged into `into`; without such, at the end.

    A second weighing may change the destination of an item that is on its way.
    """
    bodies = case.belief.tracks[item].bodies
    return next((body for body in reversed(bodies) if into and case.destination(body) == into), bodies[-1])


def _mass(body: log_records.BodyRecord) -> str:
    mass = body.mass if isinstance(body, log_records.ThingRecord) else None
    return "" if mass is None else f"{mass * 1000:.0f} g"


def _mistaken_traits(
    case: Investigation, believed: log_records.BodyRecord, real: log_records.BodyRecord
) -> tuple[str, ...]:
    """Return in words what the robot took a thing's tag, mass and size for, as far as rules ask for them."""
    if case.scene is None or not (
        isinstance(believed, log_records.ThingRecord) and isinstance(real, log_records.ThingRecord)
    ):
        return ()
    rules, found = case.scene.destinations, list[str]()
    if destinations.asks_for(rules, "tag") and believed.tag != real.tag:
        read = "its tag was not read" if believed.tag is None else f"tag {believed.tag} was read"
        found.append(f"{read}, and it has {'none' if real.tag is None else f'tag {real.tag}'}")
    if destinations.asks_for(rules, "mass") and real.mass is not None:
        weighed = "it was not weighed" if believed.mass is None else f"{believed.mass * 1000:.0f} g were felt"
        found.append(f"{weighed}, and it weighs {real.mass * 1000:.0f} g")
    if destinations.asks_for(rules, "size") and believed.size is not None and real.size is not None:
        found.append(f"the camera saw {distance(believed.size)} of it, and it is {distance(real.size)} long")
    return tuple(found)


def _not_seated(case: Investigation, true: str, done: Placement) -> Finding | None:
    """Return the finding that an item released at a hole is not in it by the scorer's measure; else None."""
    score, into = case.verdicts[true], done.into
    if into not in case.holes:
        return None
    title = f"{done.item} is not in {into}: {score.reason}"
    if score.depth is None or not score.reason:
        ends = place(case.bodies.tracks[true].last.pose.position)
        title = f"{done.item} is not in {into}, where it was let go: in the end it is at {ends}"
    return Finding("insert.not_in", true, title, (), done.item, done.time)


def _left_bin(case: Investigation, true: str, done: Placement) -> Finding | None:
    """Return the finding that an item left its destination after the placement; else None."""
    item, into, time = done.item, done.into, done.time
    track, lies = case.bodies.tracks[true], case.bodies.tracks[true].last
    later, ends = list(track.since(time + 1e-3)), case.bin_at(lies)
    inside = [(at, body) for at, body in later if case.bin_at(body) == into]
    neighbours = {id_: other for id_, other in case.bodies.tracks.items() if id_ != true}
    there = [id_ for id_, other in neighbours.items() if case.bin_at(other.last) == into]
    others = listed([case.name_of(id_) for id_ in there if case.gone(id_) is None], 5)
    placed = f"{item} was let go over {into} at {seconds(time)}, and {case.truly}lies {case.where(lies)}"
    lay_there = f"in it lie {others}"

    def found(cause: str, title: str, reason: str, at: float) -> Finding:
        about = into if cause == "bin.crowded" else true
        return Finding(cause, about, title, (placed, reason) if reason else (placed,), item, at)

    if ends == into and case.verdicts[true].moving:
        moved = distance(math.dist(lies.pose.position, track.bodies[-2].pose.position))
        reason = f"it moved {moved} {between(track.times[-2], track.times[-1])}"
        title = f"{item} still moved in {into} when the mission ended"
        return found("place.not_at_rest", title, reason, track.times[-1])
    if not inside:
        then = (case.bodies.at(id_, time) for id_ in neighbours)
        if others and any(body is not None and case.bin_at(body) == into for body in then):
            title = f"{into} has no room for {item}: the item did not stay inside when it was placed"
            return found("bin.crowded", title, lay_there, time)
        return found("place.beside", f"{item} fell beside {into} when it was placed", "", time)
    if ends == into:
        title = f"{item} lies above the rim of {into}, or does not come to rest there"
        if not others:
            return found("place.not_at_rest", title, "nothing else lies there", time)
        return found("bin.crowded", title, f"beside it lie {others}", time)
    last, lay = inside[-1]
    out, outside = next((t, b) for t, b in later if t > last and case.bin_at(b) != into)
    moved = distance(math.dist(lies.pose.position, lay.pose.position))
    placed += f"; it lay in {into}, but later {moved} away"
    placing = case.events(event_types.ItemDoneEvent, start=last - PLACING_TIME, end=out + PLACING_TIME)
    pushed = math.dist(outside.pose.position, lay.pose.position) <= PUSH_RANGE
    names = [at.record.object for at in placing if pushed and at.record.into == into]
    came, when = [name for name in names if name != item], between(last, out)
    if came:
        title = f"{into} is too small for all its items: {item} left it again {when}"
        reason = f"{listed(came, 5)} came down into {into} about then and pushed it out"
        return found("bin.crowded", title, reason, last)
    if out - time < PLACING_TIME and others:
        title = f"{into} is too full for {item}: the item did not stay inside when it was placed, {when}"
        return found("bin.crowded", title, lay_there, last)
    if out - time < PLACING_TIME:
        return found("place.beside", f"{item} bounced out of {into} when it was placed, {when}", "", time)
    title = f"{item} left {into} again after it had been placed, {when}"
    reason = "nothing was placed there about then: something else than the arm flung it out"
    return found("item.left_bin", title, reason, last)


def _not_tried(case: Investigation, true: str) -> Finding | None:
    names, result = case.believed[true], case.run.result
    item, seen = names[-1], case.belief.tracks[names[-1]].times[0]
    tried = any(v.item in names for v in case.family.visits if v.id == "Grasp")
    over = result is not None and result.status in ("success", "incomplete")  # else its turn had not come
    if tried or not over or case.run.log.lacks_something:
        return None
    reasons = (f"the belief had it from {seconds(seen)} on",)
    if condition := skip_condition(case):
        node, text = condition
        title = f"the mission skips {item}: {node} has {text}"
        return Finding("mission.not_tried", node, title, reasons, item, None)
    if (moving := displacement_since(case, true, seen, case.end)) is not None:
        moved = f"it was moved by {distance(moving.way)} {between(moving.start, moving.end)}"
        reasons = (*reasons, moved)
    return Finding("mission.not_tried", "", f"the mission never tried {item}", reasons, item, None)


def skip_condition(case: Investigation) -> tuple[str, str] | None:
    """Return the node around a grasp that its condition passes over, and the condition, by the mission's
    files."""
    for name in case.run.log.attachments:
        if name != "mission.yaml" and not name.startswith("include/"):
            continue
        try:
            trees = yaml.safe_load(case.run.log.attachment(name))
        except yaml.YAMLError:
            continue
        found = next((each for each in _conditions(trees) if "Grasp" in each[2] or "Sort" in each[2]), None)
        if found is not None:
            return found[0], found[1]
    return None


def _conditions(tree: object) -> Iterator[tuple[str, str, str]]:
    """Yield node, condition and text of the nodes below that have a condition."""
    if isinstance(tree, list):
        for each in cast("list[object]", tree):
            yield from _conditions(each)
    elif isinstance(tree, dict):
        for node, inside in cast("dict[object, object]", tree).items():
            ports = cast("dict[str, object]", inside) if isinstance(inside, dict) else {}
            for key in CONDITIONS:
                if key in ports:
                    yield str(node), f"{key}: {ports[key]}", f"{node} {ports}"
            yield from _conditions(cast("object", inside))


CONDITIONS = ("_skipIf", "_successIf", "_failureIf", "_while")
"""Keys of a node that may pass it over."""
