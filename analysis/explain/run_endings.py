"""Causes in the run or the mission itself: time limits, a kill, conditions, errors of code."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

import numpy as np

from picktree.files import PicktreeError, listed
from picktree.files.yaml import read
from picktree.logs import ImageEvent, log_records, node_visits
from picktree.world import Array, Shape, event_types, extents

from .case import Investigation
from .explanation import ExplainedOutcome, FailureStory, Finding, number, word
from .held_items import holds_of
from .item_causes import explain_no_look, noisy_camera
from .unsorted_items import skip_condition
from .wording import counted, seconds


def explain_run_end(case: Investigation, outcome: ExplainedOutcome) -> Finding | None:
    """Return the finding about a run's end that the mission did not decide; else None."""
    recovered = (case.run.recovered,) if case.run.recovered else ()
    match outcome.status:
        case "timeout":
            running = [v for v in case.family.visits if v.outcome == "RUNNING"]
            if (hung := _first_hung(case, _leaves(case, running))) is not None:
                return hung
            title = f"the run was ended at its limit of simulated time, {seconds(outcome.end)}"
            cause, reasons = "run.limit", _under_way(case)
        case "paused":
            cause, title = "run.paused", "help was wanted, and nobody was there to answer"
            reasons = _pending_question(case)
        case "crashed":
            cause, title, reasons = "run.crashed", outcome.sentence, recovered
        case status if status in ENDINGS:
            cause, title = ENDINGS[status]
            reasons = (*_under_way(case), *recovered)
        case status:
            return _condition(case) if status == "failure" else None
    return Finding(cause, "", title, reasons, "", outcome.end)


ENDINGS = {
    "interrupted": ("run.interrupted", "the run was interrupted by hand"),
    "stopped": ("run.stopped", "the robot's own side ended the run"),
    "running": ("run.going_on", "the run is still in progress: its log is being written"),
    "killed": ("run.killed", "the process that ran it was killed: its log has no end"),
}
"""Cause and title of the ends that no node decided, by the status of the outcome."""


def goal_of(case: Investigation) -> str:
    """Return the goal of the mission, else that of the scene; empty without one."""
    name, log = "mission.yaml", case.run.log
    own = (case.scene.goal if case.scene else "") or ""
    if name not in log.attachments:
        return own
    try:
        goal = read(log.attachment(name).decode("utf-8", "replace"), name).root.child("goal")
    except PicktreeError:
        return own
    return own if goal is None else str(goal.value)


def explain_missed_goal(case: Investigation, outcome: ExplainedOutcome) -> Finding | None:
    """Return the finding that the goal is missed although every item is at its destination; else None."""
    if outcome.status != "incomplete":
        return None
    if (unseen := explain_nothing_seen(case)) is not None:
        return unseen
    goal = goal_of(case)
    number, right = len(case.verdicts), sum(each.is_in_place for each in case.verdicts.values())
    title = "every item is where it belongs" if right == number else f"{right} of {number} items are in place"
    why = f"`{goal}` does not hold" if goal else "the scene's feed still had items to bring"
    title, reasons = f"{title}, and the goal is missed: {why}", (f"there were {counted(number, 'item')}",)
    return Finding("goal.beyond_items", "", title, reasons, "", outcome.end)


def explain_nothing_seen(case: Investigation) -> Finding | None:
    """Return the finding that no look showed any item: the mission never looks, or a body covers the view."""
    if any(track.first.role == "item" for track in case.belief.tracks.values()):
        return None
    if not case.events(ImageEvent):
        return explain_no_look()
    catalogue = case.scene.catalogue if case.scene else ()
    lowest = min((float(_sizes(entry.shape).min()) for entry in catalogue), default=0.0)
    if lowest and (noisy := noisy_camera(case, "", lowest)) is not None:
        return noisy
    covers = next(iter(case.obstacles.tracks.values()), None)
    if covers is None:
        return None
    if (odd := _odd_sized(case, covers.first)) is not None:
        return odd
    title = f"no item was seen: {covers.id}, a body that the robot did not know, covers a part of the view"
    return Finding("scene.unknown_obstacle", covers.id, title, (), "", covers.times[0], "possible")


def _odd_sized(case: Investigation, body: log_records.BodyRecord) -> Finding | None:
    """Return the finding that a body in the colour of an item is an item of another size; else None."""
    if case.scene is None or body.colour in ("grey", "unknown", ""):
        return None
    seen = _sizes(body.shape)
    ratios = {entry.kind: seen / _sizes(entry.shape) for entry in case.scene.catalogue}
    kind, ratio = min(ratios.items(), key=lambda each: float(np.ptp(each[1])), default=("", np.ones(3)))
    factor = float(ratio[2])
    if float(np.ptp(ratio)) > MAX_SIZE_SCATTER * factor or 1 / MIN_FACTOR < factor < MIN_FACTOR:
        return None
    title = f"{body.id} looks like a {body.colour} {kind}, {factor:.2g} times as large as in the catalogue"
    reasons = ("it was taken for no item", f"the camera shows {_text(seen)}")
    return Finding("item.larger", body.id, title, reasons, body.id, None, "possible")


MAX_SIZE_SCATTER, MIN_FACTOR = 0.25, 1.15
"""Greatest difference of the sides' ratios of an item of another size, as a share of its height's ratio.
The second value is the least ratio of its height."""


def _sizes(shape: Shape) -> Array:
    """Return the sides of a shape's box, the shorter horizontal one first, and the height, (3,), m."""
    low, high = extents(shape, np.eye(3))
    x, y, z = high - low
    return np.array([min(x, y), max(x, y), z])


def _text(sizes: Array) -> str:
    return " × ".join(f"{1000 * side:.0f}" for side in sizes) + " mm"


MISSION_ERRORS = {
    "tree.missing_input": "{name} had no value to work with: {message}",
    "tree.no_case": "{name} has no case for this value: {message}",
    "internal.error": "the code of {id} has a fault of its own: {message}",
}
"""Titles of the failures that the mission, or the program, caused by itself."""


def explain_mission_error(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding about a failure that the mission, or the program, caused by itself; else None."""
    if failure.cause == "tree.timeout":
        return _timeout(case, failure)
    if (words := MISSION_ERRORS.get(failure.cause)) is None:
        return None
    title = words.format(name=failure.name, id=failure.id, message=failure.message)
    return failure.finding(failure.cause, failure.node, title, _end_of_trace(failure))


def _end_of_trace(failure: FailureStory) -> tuple[str, ...]:
    """Return the last frame of a traceback and the exception, without marks below the text."""
    trace = word(failure, "traceback").strip().splitlines()
    last = max((k for k, line in enumerate(trace) if line.startswith('  File "')), default=len(trace) - 3)
    return tuple(line.strip() for line in trace[max(last, 0) :] if line.strip(" ^~"))


def explain_missing_grasp(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that a node was to place an item that no node had grasped; else None."""
    if failure.cause != "grasp.slipped" or failure.evidence.get("held", "") is not None:
        return None
    holds = holds_of(case, case.pairs.get(failure.item, ""))
    if any(period.start < failure.time for period in holds):
        return None
    grasps = [v for v in case.family.visits if v.id == "Grasp" and v.item == failure.item]
    skipped = skip_condition(case)
    why = "nothing was in the hand"
    if skipped is not None and skipped[0].startswith("Grasp"):
        why = f"{skipped[0]} has {skipped[1]}"
    title = f"{failure.name} was run before anything was grasped: {why}"
    tried = any(v.end <= failure.time for v in grasps)
    before = "no grasp had held the item" if tried else "no node had grasped the item"
    reasons = (f"{before} before {seconds(failure.time)}",)
    return failure.finding("mission.order", failure.node, title, reasons)


def _under_way(case: Investigation) -> tuple[str, ...]:
    lost = [f for f in case.failures if not (f.cured or f.done_instead)]
    spent = sum(f.seconds_lost for f in case.failures)
    failed = f"until then {counted(len(case.failures), 'failure')} had cost {spent:.1f} s"
    reasons = [f"{failed}, and {len(lost)} of them were not cured"] if case.failures else []
    running = [v for v in case.family.visits if v.outcome == "RUNNING" and not case.family.children(v)]
    last = case.run.log.tick_at(case.run.last_tick)
    messages = {} if last is None else {node.path: node.message for node in last.record.nodes}
    spans = {v.number: [f"for {v.duration:.1f} s", messages.get(v.path, "")] for v in running}
    nodes = [f"{v.name_and_item} ({', '.join(filter(None, spans[v.number]))})" for v in running]
    return (*reasons, f"what ran then: {listed(nodes, 5)}") if nodes else tuple(reasons)


def _pending_question(case: Investigation) -> tuple[str, ...]:
    """Return the operator question that the run waits for, and the way to answer it."""
    result = case.run.result
    if result is None or result.asked is None:
        return ()
    question = result.asked
    return (
        f"{question.node} asks: {question.reason}",
        f"the request takes one of these answers: {', '.join(question.choices)}",
        f"continue with: {result.resume_command()}",
    )


def _condition(case: Investigation) -> Finding | None:
    """Return the finding that a false condition ended the mission; None for any other end."""
    root = next((v for v in case.family.visits if v.parent is None and v.outcome == "FAILURE"), None)
    if root is None or root.cause:
        return None
    while below := [v for v in case.family.children(root) if v.outcome == "FAILURE" and not v.cause]:
        root = below[-1]
    condition = case.ports(root.path).get("if", "") or root.message or root.name
    title = f"a condition did not hold, and the mission ends there: {condition}"
    reasons = (f"{root.path} was checked at {seconds(root.end)}",)
    return Finding("tree.condition", root.path, title, reasons, root.item, root.end)


WAIT_SKILLS = frozenset({"AwaitItems", "ExchangeBin", "Delay", "AskOperator", "Jog", "Survey"})
"""Skills whose long waits are no hang."""
HANG_TIME = 5.0
"""Time without activity after which a skill hangs, s."""
MIN_MOTION = 1e-3
"""Least motion of a joint within a tick that counts as activity, rad or m."""


def explain_hang(case: Investigation, visit: node_visits.Visit) -> Finding | None:
    """Return the finding that a skill showed no activity long before it was halted; else None."""
    if visit.id in WAIT_SKILLS or case.family.children(visit) or visit.duration < HANG_TIME:
        return None
    joints = case.run.joints
    here = (joints.times > visit.start) & (joints.times <= visit.end)
    moving = np.abs(np.diff(joints.positions[here], axis=0)).max(axis=1, initial=0.0) > MIN_MOTION
    signs = [visit.start, *(float(t) for t in joints.times[here][1:][moving][-1:])]
    logged = (
        *case.run.plans,
        *case.run.candidates,
        *(at for at in case.run.events if at.record.node == visit.path),
    )
    signs += [at.time for at in logged if visit.start <= at.time < visit.end - 0.06]
    alive = max(signs)
    if visit.end - alive < HANG_TIME:
        return None
    alike = (v for v in case.family.visits if v.id == visit.id and v.outcome == "SUCCESS")
    usual = [v.duration for v in alike if v.duration > 0]
    reasons = [f"from {seconds(alive)} on it moved no joint, planned nothing and looked at nothing"]
    if usual:
        took = f"it took {median(usual):.1f} s ({counted(len(usual), 'time')})"
        reasons.append(f"where {visit.id} succeeded {took}, and here {visit.duration:.1f} s")
    until = "the log ends" if visit.outcome == "RUNNING" else "it was stopped"
    title = f"{visit.name_and_item} hung: it did nothing for {visit.end - alive:.0f} s, until {until}"
    return Finding("skill.hangs", visit.path, title, tuple(reasons), visit.item, alive)


def _timeout(case: Investigation, failure: FailureStory) -> Finding:
    visit, allowed = case.visit(failure), number(failure, "seconds")
    halted = case.halted_with(visit)
    leaves = _leaves(case, halted) or [visit]
    if (hung := _first_hung(case, leaves)) is not None:
        return hung
    reasons = [f"stopped were: {listed([v.name_and_item for v in leaves], 5)}"] if halted else []
    others = (f for f in case.failures if f.number != failure.number)
    within = [f.cause for f in others if case.family.within(case.visit(f), visit)]
    if within:
        reasons.append(f"{counted(len(within), 'earlier failure')} took time: {listed(within, 5)}")
    path = word(failure, "running") or visit.path
    name, limit = path.rsplit("/", 1)[-1], f"{allowed:g} s" if allowed is not None else "its time"
    placed = case.events(event_types.ItemDoneEvent, visit.start, visit.end)
    at_work = [at for at in placed if at.record.node.startswith(visit.path)]
    if at_work and not within:
        done = counted(len(at_work), "item")
        title = f"the mission stops {name} after {limit}, as {visit.name} says: {done} had been done by then"
        return failure.finding("mission.time_is_up", visit.path, title, tuple(reasons))
    done = [v.duration for v in case.family.visits if v.path == path and v.outcome == "SUCCESS"]
    title = f"{name} was given {limit}, and needs longer"
    if done:
        reasons.append(f"where it succeeded it took {median(done):.1f} s ({counted(len(done), 'time')})")
        if allowed is not None and median(done) < allowed / 2:
            title = f"{name} was stopped after {limit}, and takes {median(done):.1f} s where it succeeds"
    return failure.finding("tree.timeout", visit.path, title, tuple(reasons))


def explain_unacknowledged_stop(case: Investigation, failure: FailureStory) -> Finding | None:
    """Return the finding that an unacknowledged safety stop blocked a motion; else None."""
    stops = case.events(event_types.SafetyStopEvent, end=failure.time)
    if failure.cause != "safety.stop" or not stops:
        return None
    stop, item = stops[-1], failure.item
    if stop.record.cause == "safety.payload" and item:
        title = f"{item} weighs more than the hand may carry: {stop.record.message}"
        reasons = (f"the safety monitor stopped the arm for it at {seconds(stop.time)}",)
        return Finding("item.heavy", case.pairs.get(item, ""), title, reasons, item, stop.time)
    at = f" at {item}" if item else ""
    title = f"the safety monitor stopped the arm{at}: {stop.record.message}"
    reasons = (f"at {seconds(stop.time)}; every motion is refused until a SafeRetreat acknowledges the stop",)
    return Finding(stop.record.cause, item or failure.node, title, reasons, item, stop.time)


def _first_hung(case: Investigation, visits: Sequence[node_visits.Visit]) -> Finding | None:
    found = (explain_hang(case, visit) for visit in visits)
    return next((hung for hung in found if hung is not None), None)


def _leaves(case: Investigation, visits: list[node_visits.Visit]) -> list[node_visits.Visit]:
    return [v for v in visits if not case.family.children(v)] or visits[-1:]
