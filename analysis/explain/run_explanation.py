"""Explanation of a run from its log alone: its failures and the stories of its items."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from picktree.files import Expression, PicktreeError, listed
from picktree.logs import BeliefEvent, RunAccount, RunRecord, Stamped, log_files, log_records, node_visits
from picktree.robot.manipulation import pick_candidates
from picktree.world import (
    Candidates,
    JournalEvent,
    Plan,
    all_causes,
    event_types,
    heap_geometry,
    remedy_of,
    world_facts,
)
from picktree.world.scene import destinations

from .body_tracks import between, horizontal_distance
from .case import Investigation
from .explanation import (
    CandidateChoice,
    ExplainedOutcome,
    Explanation,
    FailureStory,
    ItemEvent,
    ItemState,
    ItemStory,
    KeyMoment,
    RejectedCandidate,
    RootCause,
    number,
)
from .held_items import held_periods
from .hypotheses import root_causes_of
from .item_causes import MIN_ERROR
from .run_endings import explain_nothing_seen, goal_of
from .seen_world import SeenWorld
from .wording import distance, place, seconds

if TYPE_CHECKING:
    from picktree.logs import RunResult, RunStatus


def choices_before(run: RunRecord, source: node_visits.Visit) -> tuple[CandidateChoice, ...]:
    """Return the choices of candidates of the failed visit for its item or heap, in order of time."""
    names = (source.item, heap_geometry.heap_id(source.item))
    candidates = between(run.candidates, source.start, source.end)
    found = [_of_candidates(at) for at in candidates if at.record.object in names]
    plans = between(run.plans, source.start, source.end)
    refused = [at for at in plans if at.record.outcome != "found"]
    if refused and plans[-1] is refused[-1]:
        found.append(_of_plans(refused, len(plans), source.item))
    return tuple(sorted(found, key=lambda choice: choice.time))


def _of_candidates(at: Stamped[Candidates]) -> CandidateChoice:
    record = at.record
    staged = pick_candidates.count_rejections(record.tried, record.into)
    refused = Counter(c.verdict for c in record.tried if c.verdict != "accepted")
    names = {c.verdict: c.name for c in reversed(record.tried)}
    rejections = [RejectedCandidate(f.name, f.words, f.count, f.stage, f.by) for f in staged] or [
        RejectedCandidate(names[reason], reason, count) for reason, count in refused.most_common()
    ]
    stages = tuple((stage.name, stage.count) for stage in record.stages)
    return CandidateChoice(at.time, record.purpose, record.object, stages, tuple(rejections))


def _of_plans(refused: list[Stamped[Plan]], plans: int, item: str) -> CandidateChoice:
    """Return the failed plans as one choice. Messages that differ in numbers only count as one."""
    alike: dict[str, list[Plan]] = {}
    for at in refused:
        words = re.sub(r"[\d.]+", "#", f"{at.record.outcome} {at.record.message}")
        alike.setdefault(words, []).append(at.record)
    rejections = tuple(
        RejectedCandidate(first.request, f"{first.outcome}: {first.message}", 1 + len(others))
        for first, *others in sorted(alike.values(), key=len, reverse=True)
    )
    counts = (("asked for", plans), ("found", plans - len(refused)))
    return CandidateChoice(refused[-1].time, "plan", item, counts, rejections)


_IN_MOTION = ("world.disturbed", "safety.", "control.")
FAULT_TIME = 5.0
"""Time before a failure in which events are listed with it, s."""


def failure_context(
    case: Investigation, failure: FailureStory, planted: Sequence[Stamped[event_types.FaultEvent]]
) -> Iterator[str]:
    """Yield sentences on the moment of a failure: belief, hand, stops, halted nodes, injected faults."""
    yield from _belief(case, failure)
    gripper, visit = case.gripper, case.visit(failure)
    known = number(failure, "width") is not None or not failure.cause.startswith(_IN_MOTION)
    if not known and len(gripper.times):
        width = gripper.widths[max(int((gripper.times <= failure.time + 1e-6).sum()) - 1, 0)]
        yield f"hand: the fingers were {max(float(width), 0.0) * 1000:.0f} mm open"
    for at in case.events(event_types.SafetyStopEvent, start=visit.start, end=failure.time):
        yield f"safety: the arm was stopped at {seconds(at.time)}: {at.record.message}"
    if stopped := case.halted_with(visit):
        yield f"stopped with it: {listed([v.name for v in reversed(stopped)], 4)}"
    true = case.pairs.get(failure.item)
    for at in between(planted, failure.time - FAULT_TIME, failure.time):
        if true is not None and at.record.item == true:
            yield f"planted: {at.record.message} ({failure.time - at.time:.1f} s before)"


def _belief(case: Investigation, failure: FailureStory) -> Iterator[str]:
    """Yield the believed and the true place of the item as text."""
    item = failure.item
    before = failure.time - 1e-3  # the belief of the moment before, which the failure may have changed
    believed, true = case.belief.at(item, before), case.pairs.get(item)
    if believed is None:
        if item and item not in case.bins:
            yield f"belief: {item} is not known"
        return
    where = "in the hand" if believed.attached else f"at {place(believed.pose.position)}"
    yield f"belief: {item} {where}, last seen at {seconds(believed.last_seen)}"
    if true is None:
        return
    gone, really = case.gone(true), _really(case, failure, true)
    if gone is not None and gone[1] <= failure.time + case.sampled:
        vanished = f"truth: {item} is nowhere any more"
        yield vanished if case.world.is_true else f"later: {item} was not seen again"
    elif really is not None and (away := horizontal_distance(really, believed)) > MIN_ERROR:
        word = "truth" if case.world.is_true else "seen later"
        yield f"{word}: {item} at {place(really.pose.position)}, {distance(away)} from the belief"


def _really(case: Investigation, failure: FailureStory, true: str) -> log_records.BodyRecord | None:
    """Return the true item just after the failure; None when the hand moved it."""
    later = next((t for t in case.bodies.times if t >= failure.time - 1e-6), case.end)
    then = case.belief.at(failure.item, later)
    carried = then is not None and then.attached
    return None if carried else case.bodies.at(true, later)


def failures_of(run: RunRecord, account: RunAccount) -> tuple[FailureStory, ...]:
    """Return every failure with a cause, in the order of their times, without false conditions."""
    causes = {cause.name: cause for cause in all_causes()}
    charged: set[int | None] = {None}
    found: list[FailureStory] = []
    before: list[node_visits.Visit] = []
    # The innermost step that fails together with its skill; a skill may go on after a failed step.
    steps = {(step.visit, step.end): step.name for step in reversed(run.steps) if step.outcome == "failure"}
    for failure in account.failures:
        source, cause, fate = failure.source, causes.get(failure.source.cause), failure.decided.fate
        follows = _follows(source, before, account.tree)
        helped = fate in ("cured", "done_instead") or follows is not None
        node = source.origin or source.path
        episode = account.recovery.of_failure(source.cause, source.end, node)
        lost = 0.0 if episode in charged or episode is None else account.recovery.episodes[episode].seconds
        charged.add(episode)
        story = FailureStory(
            number=len(found),
            time=source.end,
            tick=source.last,
            visit=source.number,
            node=node,
            id=next((n.id for n in run.tree_at(source.end).nodes if n.path == node), source.id),
            item=source.item,
            attempt=source.attempt,
            cause=source.cause,
            sentence=cause.sentence if cause else "",
            remedy=remedy_of(cause, source.evidence) if cause and not helped else "",
            step=steps.get((source.number, source.end), ""),
            message=source.message,
            evidence=source.evidence,
            chain=failure.chain,
            handled_by=failure.handled_by,
            fate=fate,
            fate_by=failure.decided.by,
            fate_at=failure.decided_at,
            because_of=follows,
            choices=choices_before(run, source),
            observed=(),
            episode=episode,
            seconds_lost=lost,
        )
        found.append(story)
        before.append(source)
    return tuple(found)


def _follows(
    source: node_visits.Visit, before: Sequence[node_visits.Visit], family: node_visits.VisitTree
) -> int | None:
    """Return the number of the earlier failure that this one follows from."""
    for earlier_number in reversed(range(len(before))):
        earlier = before[earlier_number]
        if _within_the_answer(source, earlier, family) or _consequence(source, earlier, family):
            return earlier_number
    return None


def _within_the_answer(
    source: node_visits.Visit, earlier: node_visits.Visit, family: node_visits.VisitTree
) -> bool:
    """Whether the node failed during the recovery from the earlier failure: in a handler or `give_up`."""
    lineage = {v.parent: v for v in (source, *family.above(source))}
    ours = earlier
    for above in family.above(earlier):
        if above.number in lineage:
            branch = lineage[above.number]
            answers = above.id in _RECOVERIES and branch.path != ours.path and branch.number > ours.number
            between = (v for v in family.children(above) if ours.number < v.number < branch.number)
            return answers and all(v.path != ours.path for v in between)
        ours = above
    return False


_RECOVERIES = frozenset({"Recover", "RecoveryNode"})


def _consequence(
    source: node_visits.Visit, earlier: node_visits.Visit, family: node_visits.VisitTree
) -> bool:
    """Whether the later failure follows from the earlier one: item lost, item still held, or no change."""
    if source.evidence.get("unchanged") is True:
        return (earlier.item, earlier.cause) == (source.item, source.cause)
    held = source.evidence.get("held")
    if isinstance(held, str) and held:
        return held == earlier.item != source.item
    if "held" in source.evidence and source.id != "Grasp":  # nothing was in the hand
        return earlier.id == "Grasp" and earlier.item == source.item
    if source.cause == "control.tracking" and earlier.cause == "tree.timeout":
        return source.end - earlier.end < BRAKING_TIME  # the arm had not come to rest when it was to go on
    if not source.item or source.item != earlier.item or source.cause == earlier.cause:
        return False
    if source.cause not in _MISSING_ITEM_CAUSES or earlier.cause not in _LOSS_CAUSES:
        return False
    shared = {v.number for v in family.above(earlier)} & {v.number for v in family.above(source)}
    return any(family.visits[n].item == source.item for n in shared)


BRAKING_TIME = 1.0
"""Time after a halt within which the arm comes to rest, s."""
_LOSS_CAUSES = frozenset(
    {"grasp.missed", "grasp.slipped", "world.disturbed", "place.missed", "world.unknown_object"}
)
_MISSING_ITEM_CAUSES = frozenset(
    {"world.unknown_object", "grasp.slipped", "perception.not_found", "grasp.no_candidate"}
)
MIN_MOVE = 0.02
"""Distance from its believed place above which a seen item has moved, m."""
REPORT_TIME = 1.0
"""Time after the loss of an item within which a failure reports it, s."""
_NO_LONGER_HELD = "no longer in the hand"


def items_of(case: Investigation) -> tuple[ItemStory, ...]:
    """Return a story for each item with all its names, then for the items that were never seen."""
    phantoms = case.identities.phantoms
    known: dict[str, list[str]] = {}
    for id_, track in case.belief.tracks.items():
        if track.first.role == "item":
            true = "" if id_ in phantoms else case.pairs.get(id_, "")
            known.setdefault(true or id_, []).append(id_)
    found = [_item_story(case, names) for names in known.values()]
    unseen = [true for true in case.bodies.tracks if true not in case.believed]
    return (*found, *(_unseen(case, true) for true in unseen))


def _item_story(case: Investigation, names: Sequence[str]) -> ItemStory:
    """Return the story of an item with all its names; the first is its id."""
    item, last = names[0], names[-1]
    body = case.belief.tracks[last].last
    failed = [f for f in case.failures if f.item in names]
    events = [
        event
        for name in names
        for at in case.once(_events_by_item).get(name, ())
        for event in _happened(at, "" if name == item else f" as {name}")
        if not event.what.startswith(_NO_LONGER_HELD)
        or not any(0.0 <= f.time - at.time < REPORT_TIME for f in failed)
    ]
    events += [ItemEvent(f.time, f"{f.name} failed: {f.cause}", f.node, f.number) for f in failed]
    dropped = [p for p in case.once(held_periods) if p.item in names and p.left is not None]
    events += [
        ItemEvent(p.left[1], f"{case.truly}not in the hand any more")
        for p in dropped
        if p.left and p.end - p.left[1] > REPORT_TIME
    ]
    true = "" if item in case.identities.phantoms else case.pairs.get(item, "")
    return ItemStory(
        item,
        body.kind,
        body.colour,
        _state(case, last),
        tuple(sorted(events, key=lambda event: event.time)),
        _truth(case, true) if true else _no_item(case, item),
        tuple(names),
    )


def _no_item(case: Investigation, item: str) -> str:
    """Return the truth about a believed item that is no true item; empty without ground truth in the log."""
    near = case.identities.phantoms.get(item)
    if near is None:
        return ""
    return f"truly a part of {case.name_of(near)}" if near else "truly nothing was there"


def _unseen(case: Investigation, true: str) -> ItemStory:
    body, score = case.bodies.tracks[true].last, case.verdicts.get(true)
    state = "done" if score is not None and score.is_in_place else "left"
    bin_ = case.bins.get(case.bin_at(body))
    unknown = "never taken out" if bin_ is not None and bin_.is_tote else "never seen"
    return ItemStory(true, body.kind, body.colour, state, (), f"{_truth(case, true)}; {unknown}")


def _state(case: Investigation, item: str) -> ItemState:
    body = case.belief.at(item, case.end)
    if body is None:
        last = case.belief.tracks[item].last
        if case.departed.get(case.pairs.get(item, "")) != last.place:
            return "gone"
        return "done" if destinations.is_at(last.place, case.destination(last)) else "left"
    if body.attached:
        return "held"
    aside = [at.time for at in case.events(event_types.SetAsideEvent) if at.record.object == item]
    placed = [at.time for at in case.events(event_types.ItemDoneEvent) if at.record.object == item]
    if aside and aside[-1] >= max(placed, default=-1.0):
        return "aside"
    score = case.verdicts.get(case.pairs.get(item, ""))
    if score is not None:
        return "done" if score.verdict == "sorted" else "left"
    destination = case.destination(body)
    return "done" if destination and destinations.is_at(body.place, destination) else "left"


def _truth(case: Investigation, true: str) -> str:
    """Return the true place of an item at the end, in the scorer's words."""
    if case.gone(true) is not None:
        return "truly nowhere any more" if case.world.is_true else "not seen again"
    score, body = case.verdicts.get(true), case.bodies.tracks[true].last
    lies = case.bin_at(body)
    where = f"truly {case.where(body)}" if case.world.is_true else f"by the belief {case.where(body)}"
    if score is not None and lies and score.depth is not None and not score.reason:
        where += f", {1000 * score.depth:.1f} mm deep"
    if score is not None and score.reason:
        where += f": {score.reason}"
    elif score is not None and score.is_in_place:
        where += ", where it belongs"
    elif score is not None and score.destination:
        there = ", where it belongs, but is not at rest in it"
        where += there if score.destination == lies else f"; it belongs into {score.destination}"
    return f"{where}, and was taken away with it" if true in case.departed else where


def _events_by_item(case: Investigation) -> dict[str, list[Stamped[JournalEvent]]]:
    found: dict[str, list[Stamped[JournalEvent]]] = {}
    for at in case.run.events:
        event = at.record
        if isinstance(event, event_types.HandledEvent) and isinstance(event.element, str):
            found.setdefault(event.element, []).append(at)
        elif isinstance(
            event, event_types.PickEvent | event_types.ItemDoneEvent | event_types.SetAsideEvent | BeliefEvent
        ):
            found.setdefault(event.object, []).append(at)
    return found


def _happened(at: Stamped[JournalEvent], known_as: str) -> list[ItemEvent]:
    """Return an event as events of an item. `known_as`: other name of the item in the event."""
    event, node = at.record, at.record.node
    match event:
        case event_types.HandledEvent():
            text = "passed over"
        case event_types.PickEvent() if event.held:
            text = f"held{known_as}"
            if event.width is not None and event.load is not None:
                felt = f"{event.width * 1000:.0f} mm between the fingers, {event.load:.2f} N on the wrist"
                text += f" ({felt})"
        case event_types.ItemDoneEvent():
            text = f"placed into {event.into}{known_as}" if event.into else f"put down{known_as}"
        case event_types.SetAsideEvent():
            text = "set aside: left where it lies"
        case BeliefEvent():
            text, node = _change(event), ""
            text += known_as if text else ""
        case _:
            text = ""
    return [ItemEvent(at.time, text, node)] if text else []


def _change(event: BeliefEvent) -> str:
    """Return a change of the belief as text; empty for a minor change, or one that another event
    describes."""
    before, after, reason = event.before, event.after, event.reason
    if after is None:
        return reason if reason in (world_facts.RODE_ON, world_facts.TAKEN_AWAY) else f"given up: {reason}"
    if before is None:
        return f"seen for the first time, at {place(after.pose.position)}"
    if reason == "seen":
        moved = math.dist(before.pose.position[:2], after.pose.position[:2])
        return f"seen again, {distance(moved)} from where it was believed" if moved > MIN_MOVE else ""
    if before.attached and not after.attached and reason != "placed":
        return f"{_NO_LONGER_HELD}: {reason}"
    return ""


def outcome_of(case: Investigation, visits: Sequence[node_visits.Visit]) -> ExplainedOutcome:
    """Return status, sentence and counts of a run's end, by the result or by the belief."""
    result, doing = case.run.result, _doing(visits)
    if result is None:
        return ExplainedOutcome(*_cut_off(case.run, doing), case.end, None, None)
    count = Counter(each.verdict for each in case.verdicts.values())
    judged = case.world.is_true or result.as_believed
    done, total = result.items.sorted, result.items.total
    if not judged:
        done, total = count["sorted"], count.total() - count["no destination"]
    counts = f"{done} of {total} items are where they belong"
    if homeless := sum(not verdict.destination for verdict in case.verdicts.values()):
        counts += f" (the scene's rules give {homeless} of all items no destination)"
    wrong = (("crushed", "crushed"), ("misplaced", "in a wrong bin"), ("left", "left"))
    counts += "".join(f", {count[verdict]} {words}" for verdict, words in wrong if count[verdict])
    counts += "" if case.world.is_true else ", as the robot believes"
    aside = {at.record.object for at in case.events(event_types.SetAsideEvent)}
    elsewhere = {at.record.object for at in case.events(event_types.ItemDoneEvent) if not at.record.into}
    others = [f"{len(aside)} set aside"] if aside else []
    others += [f"{len(elsewhere)} put down elsewhere"] if elsewhere else []
    counts += f" (the robot: {', '.join(others)})" if others else ""
    status, message = result.status if judged else _status_by_belief(case, result), result.message
    sentence = {
        "success": "the mission succeeded and its goal is reached:",
        "incomplete": "the mission ended in SUCCESS, but its goal is missed:",
        "failure": f"the mission ended in FAILURE: {message or 'a condition did not hold'};",
        "timeout": f"the run was ended at its limit of time{doing};",
        "paused": f"the run waits for help: {message};",
        "interrupted": f"the run was interrupted{doing};",
        "stopped": f"the robot's own side ended the run{doing}: {message};",
    }[status]
    return ExplainedOutcome(status, f"{sentence} {counts}", case.end, done, total)


def _status_by_belief(case: Investigation, result: RunResult) -> RunStatus:
    """Return the status without the scorer's part: whether the goal is reached by the belief."""
    if result.status not in ("success", "incomplete"):
        return result.status
    count = Counter(each.verdict for each in case.verdicts.values())
    total, goal = count.total() - count["no destination"], goal_of(case)
    if not goal:
        done = count["sorted"] == total and (total > 0 or explain_nothing_seen(case) is None)
        return "success" if done else "incomplete"
    known = {name: count[name] for name in ("sorted", "misplaced", "left")}
    reached = Expression.parse(goal).evaluate({"total": total, "outstanding": 0, **known})
    return "success" if reached else "incomplete"


def _cut_off(run: RunRecord, doing: str) -> tuple[str, str]:
    """Return status and sentence of the end of a log without a result. `doing`: the nodes that ran."""
    log, ends = run.log, f"{run.last_tick:.2f} s"
    error = log.result.get("ended", "")
    following = log.metadata.get(log_files.NEXT_METADATA, {}).get("part", "") if log.part > 1 else ""
    if error and error != "orderly":
        return "crashed", f"the run was ended at {ends} by an error of the program ({error}){doing}"
    if following:  # of a rotated log
        return "continued", f"this file of the log ends at {ends}{doing}; the run continues in {following}"
    if log.in_progress:
        return "running", f"the run is still in progress: its log has come to {ends}{doing}"
    if log.lacks_result:
        return "unknown", f"the log ends at {ends}, and the result of the run was left out{doing}"
    return "killed", f"the log ends at {ends} without a result: the process was killed{doing}"


def _doing(visits: Sequence[node_visits.Visit]) -> str:
    """Return the nodes that ran when the log ended, as a phrase."""
    running = [v for v in visits if v.outcome == "RUNNING"]
    if not running:
        return ""
    last = max(running, key=lambda v: (v.path.count("/"), v.number))
    return f" while {last.name_and_item} was running"


MAX_MOMENTS = 8
MIN_SPACING = 0.6
"""Time between two moments below which they count as one, s."""


def key_moments(
    causes: Sequence[RootCause], failures: Sequence[FailureStory], outcome: ExplainedOutcome
) -> tuple[KeyMoment, ...]:
    """Return the times at which each root cause happened and first showed, then the end of the run."""
    found: list[KeyMoment] = []

    def add(look: KeyMoment) -> None:
        if len(found) < MAX_MOMENTS and all(abs(look.time - other.time) > MIN_SPACING for other in found):
            found.append(look)

    for cause in causes:
        first = failures[cause.failures[0]] if cause.failures else None
        if cause.time is not None and cause.time > 0.0:
            add(KeyMoment(cause.time, cause.title, first.number if first else None))
        if first is not None:
            add(KeyMoment(first.time, f"{first.name_and_item} fails: {first.cause}", first.number))
    for failure in failures:
        if failure.fate == "ended":
            why = f"the failure that ended the mission: {failure.cause}"
            add(KeyMoment(failure.time, why, failure.number))
    if outcome.status != "success" and causes:
        add(KeyMoment(outcome.end, "the end: truth and belief of everything"))
    return tuple(found)


def _earlier(run: RunRecord, *, truth: bool) -> Explanation | None:
    """Return the explanation of the run that this one continues; None where its log is not here."""
    origin = run.info.continues
    if origin is None or origin.time <= 0.0 or not origin.log or not Path(origin.log).exists():
        return None
    try:
        with RunRecord(origin.log) as before:
            return explain(before, faults=False, items=False, truth=truth)
    except PicktreeError:
        return None


def investigation(
    run: RunRecord, account: RunAccount, failures: Sequence[FailureStory], *, truth: bool
) -> Investigation:
    """Return the investigation of a run, by the ground truth or by what the robot saw and felt."""
    if not truth:
        return Investigation(run, account.tree, failures, SeenWorld)
    from .true_world import TrueWorld  # it imports the simulation

    return Investigation(run, account.tree, failures, TrueWorld)


def has_truth(run: RunRecord) -> bool:
    """Whether the log has the ground truth of a simulation."""
    return next(iter(run.log.truths()), None) is not None


def explain(
    run: RunRecord, *, faults: bool = True, items: bool = True, truth: bool | None = None
) -> Explanation:
    """Return the explanation of a run: root causes, failures, stories of items, key moments.

    `faults`: injected faults are quoted where they concern the same items. The root causes follow from the
    rest of the log, with and without them. `items`: the stories of items are included. `truth`: the ground
    truth is used; None: where the log has it. Without it the explanation reads no checkpoint, fault or score.

    Raises PicktreeError where the log is damaged.
    """
    account = run.account
    failures = failures_of(run, account)
    truth = has_truth(run) if truth is None else truth
    faults = faults and truth
    case = investigation(run, account, failures, truth=truth)
    outcome = outcome_of(case, account.visits)
    planted = case.events(event_types.FaultEvent) if faults else []
    causes = root_causes_of(case, outcome, planted, _earlier(run, truth=truth))
    recovery = account.recovery
    return Explanation(
        outcome=outcome,
        failures=tuple(_with_run_facts(case, failure, causes, planted) for failure in failures),
        root_causes=causes,
        items=items_of(case) if items else (),
        with_truth=truth,
        look_at=key_moments(causes, failures, outcome),
        recovery=recovery if faults else replace(recovery, planted=()),
    )


def _with_run_facts(
    case: Investigation,
    failure: FailureStory,
    causes: Sequence[RootCause],
    planted: Sequence[Stamped[event_types.FaultEvent]],
) -> FailureStory:
    """Return the failure with the facts that need the whole run."""
    names = case.believed.get(case.pairs.get(failure.item, ""), ())
    done = [
        at.time
        for at in case.events(event_types.ItemDoneEvent, start=failure.time)
        if at.record.object in names
    ]
    return replace(
        failure,
        observed=tuple(failure_context(case, failure, planted)),
        made_good_at=done[0] if done and failure.fate in ("passed_over", "branched") else None,
        root_cause=next((n for n, cause in enumerate(causes) if failure.number in cause.failures), None),
    )
