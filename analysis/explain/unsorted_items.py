"""Causes of unsorted items without a failure, and of things left in a tote."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import yaml

from picktree.files import listed
from picktree.logs import log_records
from picktree.world import Pose, event_types, extents, grasp, heap_geometry
from picktree.world.scene import Bin, destinations

from .camera_causes import explain_hidden_by_arm
from .case import Investigation
from .explanation import FailureStory, Finding, between, counted, distance, place, seconds, times
from .held_items import held_periods
from .item_causes import (
    displacement_since,
    explain_late_arrival,
    explain_never_seen,
    explain_unrecognised_size,
    taken_item,
)
from .obstruction_causes import explain_hidden

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
    if failure.cause != grasp.NO_CANDIDATE.name:
        return None
    return case.once(_left_in_totes).get(_delivery(case, failure))


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
    states = Counter(one.state.split(",")[0] for one in left)
    title = (
        f"{counted(len(left), 'thing')} in {tote} got no grasp: "
        f"{listed([f'{n} {state}' for state, n in states.most_common()], 5)}"
    )
    about, reasons = f"{tote} {number}", tuple(str(one) for one in left)
    return Finding("heap.out_of_reach", about, title, reasons, "", time)


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
    inverse = tote.pose.inverse()
    low, high = extents(body.shape, (inverse @ body.pose).rotation())
    x, y, z = (inverse @ body.pose).position
    inner_low, inner_high = tote.inside()
    top = z + float(high[2])
    over = -math.inf if heap is None else _column(heap, body.pose.position) - body.pose.position[2]
    if over - float(high[2]) > COVER_DEPTH:
        return "hidden below other things"
    if top - inner_low[2] < MIN_GRIP_HEIGHT:
        return f"flat, {1000 * max(0.0, top - inner_low[2]):.0f} mm high"
    sides = ((x, low[0], high[0], 0), (y, low[1], high[1], 1))
    gap = min(min(inner_high[k] - at - far, at + near - inner_low[k]) for at, near, far, k in sides)
    gap = max(0.0, float(gap))
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
    found = [
        at
        for at in case.run.candidates
        if at.record.object == heap_geometry.heap_id(tote) and time - SEARCH_TIME <= at.time <= time
    ]
    tried = (one for at in found for one in at.record.tried)
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
    time, item, into, node = done
    if not into:
        return (
            _put_elsewhere(case, true, item, node, time)
            if case.gone(true) is None
            else _taken(case, true, into)
        )
    return (
        _wrong_bin(case, true, item, into, node)
        or _taken(case, true, into)
        or _not_seated(case, true, item, into, time)
        or _left_bin(case, true, item, into, time)
    )


def explain_crushed_item(case: Investigation, true: str) -> Finding | None:
    """Return the finding that a finger crushed an item, which is lost at any place; else None."""
    found = [at.record for at in case.events(event_types.CrushedEvent) if at.record.object == true]
    if not found:
        return None
    first, item = found[0], case.name_of(true)
    force = max(each.force for each in found)
    title = (
        f"{item} was crushed: {first.finger} pressed with {force:.0f} N, and the item withstands "
        f"{first.limit:.0f} N"
    )
    gripped = any(p.true == true and p.start <= first.time <= p.end for p in case.once(held_periods))
    body = case.bodies.tracks[true].before(first.time)
    lay = f": it lay at {place(body.pose.position)}" if body is not None else ""
    how = "it was in the hand then" if gripped else f"it was not in the hand then{lay}"
    reasons = (f"a force above that was first measured at {seconds(first.time)}", how)
    return Finding("item.crushed", true, title, reasons, item, first.time)


def explain_wrong_bin(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that the item was placed in a wrong bin before the failure; else None."""
    true = case.pairs.get(failure.item)
    done = None if true is None else _placed(case, true, failure.time)
    return None if true is None or done is None else _wrong_bin(case, true, done[1], done[2], done[3])


def placed_at(case: Investigation, true: str) -> float | None:
    """Return the believed time of the item's last placement, s; None without one."""
    done = _placed(case, true)
    return None if done is None else done[0]


def _placed(case: Investigation, true: str, until: float = math.inf) -> tuple[float, str, str, str] | None:
    """Return the last placement of an item: time, believed item, bin, node."""
    names = set(case.believed.get(true, ()))
    found = [at for at in case.events(event_types.ItemDoneEvent, end=until) if at.record.object in names]
    if not found:
        return None
    done = found[-1].record
    return found[-1].time, done.object, done.into or "", done.node


def _gone_before_seen(case: Investigation, true: str) -> Finding | None:
    gone = case.gone(true)
    if gone is None:
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


def _put_elsewhere(case: Investigation, true: str, item: str, node: str, time: float) -> Finding:
    """Return the finding that the mission itself put the item down at a wrong place."""
    belongs = case.verdicts[true].destination
    lies = place(case.bodies.tracks[true].last.pose.position)
    title = f"the mission puts {item} down at {lies}, and it belongs into {belongs or 'no bin'}"
    ports = case.ports(node)
    reasons = (
        (f"{node} has at: {ports['at']}",) if "at" in ports else (f"{node} put it down at {seconds(time)}",)
    )
    return Finding("mission.put_elsewhere", node, title, reasons, item, time)


def _set_aside(case: Investigation, true: str) -> Finding | None:
    names = case.believed.get(true, ())
    found = [at for at in case.events(event_types.SetAsideEvent) if at.record.object in names]
    if not found:
        return None
    time, event = found[-1].time, found[-1].record
    title = f"the mission sets {event.object} aside: {event.node.rsplit('/', 1)[-1]} leaves it where it lies"
    return Finding("mission.set_aside", event.node, title, (f"at {seconds(time)}",), event.object, time)


def _wrong_bin(case: Investigation, true: str, item: str, into: str, node: str) -> Finding | None:
    real = case.bodies.tracks[true].bodies[-1]
    into_port = case.ports(node).get("into", "")
    believed = _believed_for(case, item, into if "{" in into_port else "")
    judged = case.verdicts.get(true)
    belongs = case.destination(real) if judged is None else judged.destination
    if not into or not belongs or destinations.is_at(into, belongs):
        return None
    if (believed.colour, believed.kind) != (real.colour, real.kind) and case.destination(believed) == into:
        title = (
            f"{item} was taken for a {believed.colour} {believed.kind} and is a {real.colour} {real.kind}: "
            f"it was placed into {into} and belongs into {belongs}"
        )
        about = f"{real.colour} as {believed.colour}" if real.colour != believed.colour else true
        return Finding("perception.mistaken", about, title, (), item, None)
    wrong = _mistaken_traits(case, believed, real) if case.destination(believed) == into else ()
    if wrong:
        title = f"{item} was placed into {into} and belongs into {belongs}: {listed(wrong, 3)}"
        reasons = (
            tuple(f"{each.to} for {each.where}" for each in case.scene.destinations) if case.scene else ()
        )
        later = case.belief.tracks[item].bodies[-1]
        if _mass(later) != _mass(believed):
            reasons = (*reasons, f"later {_mass(later)} were felt; its bin had been chosen by then")
        return Finding("perception.mistaken", wrong[0].split(",")[0], title, reasons, item, None)
    name = node.rsplit("/", 1)[-1]
    title = f"the mission takes items into {into} that belong into {belongs}: {name} of {item} says so"
    reasons = (
        f"{node} has into: {into_port}" if into_port else f"{node} placed it into {into}",
        f"by the scene's rules a {real.colour} {real.kind} belongs into {belongs}",
    )
    return Finding("mission.wrong_bin", node, title, reasons, item, None)


def _believed_for(case: Investigation, item: str, into: str) -> log_records.BodyRecord:
    """Return what was last believed of an item while it belonged into `into`; without such, at the end.

    A second weighing may change the destination of an item that is on its way.
    """
    bodies = case.belief.tracks[item].bodies
    return next((body for body in reversed(bodies) if into and case.destination(body) == into), bodies[-1])


def _mass(body: log_records.BodyRecord) -> str:
    return (
        f"{body.mass * 1000:.0f} g"
        if isinstance(body, log_records.ThingRecord) and body.mass is not None
        else ""
    )


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


def _not_seated(case: Investigation, true: str, item: str, into: str, time: float) -> Finding | None:
    """Return the finding that an item released at a hole is not in it by the scorer's measure; else None."""
    score = case.verdicts[true]
    if not any(str(hole.id) == into for fixture in case.fixtures.values() for hole in fixture.holes):
        return None
    if score.depth is not None and score.reason:
        title = f"{item} is not in {into}: {score.reason}"
        return Finding("insert.not_in", true, title, (), item, time)
    ends = case.bodies.tracks[true].bodies[-1].pose.position
    title = f"{item} is not in {into}, where it was let go: in the end it is at {place(ends)}"
    return Finding("insert.not_in", true, title, (), item, time)


def _left_bin(case: Investigation, true: str, item: str, into: str, time: float) -> Finding | None:
    """Return the finding that an item left its destination after the placement; else None."""
    track = case.bodies.tracks[true]
    later = list(track.since(time + 1e-3))
    inside = [at for at, body in later if case.bin_at(body) == into]
    lies, ends = track.last, case.bin_at(track.last)
    neighbours = [id_ for id_ in case.bodies.tracks if id_ != true]
    others = [
        case.name_of(id_)
        for id_ in neighbours
        if case.gone(id_) is None and case.bin_at(case.bodies.tracks[id_].last) == into
    ]
    where = f"in {ends}" if ends else f"at {place(lies.pose.position)}"
    placed = f"{item} was let go over {into} at {seconds(time)}, and {case.truly}lies {where}"

    def crowded(title: str, reason: str, at: float) -> Finding:
        return Finding("bin.crowded", into, title, (placed, reason), item, at)

    if ends == into and case.verdicts[true].moving:
        title = f"{item} still moved in {into} when the mission ended"
        moved = distance(math.dist(lies.pose.position, track.bodies[-2].pose.position))
        reasons = (placed, f"it moved {moved} {between(track.times[-2], track.times[-1])}")
        return Finding("place.not_at_rest", true, title, reasons, item, track.times[-1])
    then = (case.bodies.at(id_, time) for id_ in neighbours)
    if not inside and others and any(body is not None and case.bin_at(body) == into for body in then):
        title = f"{into} has no room for {item}: the item did not stay inside when it was placed"
        return crowded(title, f"in it lie {listed(others, 5)}", time)
    if not inside:
        title = f"{item} fell beside {into} when it was placed"
        return Finding("place.beside", true, title, (placed,), item, time)
    if ends == into:
        title = f"{item} lies above the rim of {into}, or does not come to rest there"
        if others:
            return crowded(title, f"beside it lie {listed(others, 5)}", time)
        return Finding("place.not_at_rest", true, title, (placed, "nothing else lies there"), item, time)
    out, outside = next((t, b) for t, b in later if t > inside[-1] and case.bin_at(b) != into)
    lay = next(b for t, b in later if t == inside[-1])
    placed += (
        f"; it lay in {into}, but later {distance(math.dist(lies.pose.position, lay.pose.position))} away"
    )
    placing = case.events(event_types.ItemDoneEvent, start=inside[-1] - PLACING_TIME, end=out + PLACING_TIME)
    pushed = math.dist(outside.pose.position, lay.pose.position) <= PUSH_RANGE
    names = [at.record.object for at in placing if pushed and at.record.into == into]
    came, when = [name for name in names if name != item], between(inside[-1], out)
    if came:
        title = f"{into} is too small for all its items: {item} left it again {when}"
        return crowded(
            title, f"{listed(came, 5)} came down into {into} about then and pushed it out", inside[-1]
        )
    if out - time < PLACING_TIME and others:
        title = f"{into} is too full for {item}: the item did not stay inside when it was placed, {when}"
        return crowded(title, f"in it lie {listed(others, 5)}", inside[-1])
    if out - time < PLACING_TIME:
        title = f"{item} bounced out of {into} when it was placed, {when}"
        return Finding("place.beside", true, title, (placed,), item, time)
    title = f"{item} left {into} again after it had been placed, {when}"
    reasons = (placed, "nothing was placed there about then: something else than the arm flung it out")
    return Finding("item.left_bin", true, title, reasons, item, inside[-1])


def _not_tried(case: Investigation, true: str) -> Finding | None:
    item = case.believed[true][-1]
    if any(v.item in case.believed[true] for v in case.family.visits if v.id == "Grasp"):
        return None
    result = case.run.result
    if result is None or result.status not in ("success", "incomplete"):
        return None  # the run was over before its turn came
    if case.run.log.lacks_something:
        return None  # it may have been tried in what the log lacks
    moving = displacement_since(case, true, case.belief.tracks[item].times[0], case.end)
    title = f"the mission never tried {item}"
    reasons = [f"the belief had it from {seconds(case.belief.tracks[item].times[0])} on"]
    if condition := skip_condition(case):
        node, text = condition
        title = f"the mission skips {item}: {node} has {text}"
        return Finding("mission.not_tried", node, title, tuple(reasons), item, None)
    if moving is not None:
        reasons.append(f"it was moved by {distance(moving.way)} {between(moving.start, moving.end)}")
    return Finding("mission.not_tried", "", title, tuple(reasons), item, None)


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
