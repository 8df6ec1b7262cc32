"""Failures as stories, from logs that were made up for it: chains, handlings, fates, consequences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.explain import FailureStory
from picktree.analysis.explain.run_explanation import failures_of
from picktree.world import (
    BlackboardWrite,
    Candidate,
    Candidates,
    JournalEvent,
    ObjectId,
    Plan,
    StageCount,
    Transition,
)
from picktree.world.event_types import RecoveryEvent

from ..logs.scripted_log import Said, begins, ends, record, tree

LOOP, RECOVER = "Main", "Main/Recover"
DO, CURE, RESORT = "Main/Recover/Do", "Main/Recover/Cure", "Main/Recover/Resort"
GRASP = "Main/Recover/Do/Grasp"
NODES = tree("Main:ForEach", "Main/Recover", "Main/Recover/Do:Sequence", GRASP, "Main/Recover/Cure:Observe",
             "Main/Recover/Resort:SafeRetreat")  # fmt: skip
ITEM = "red_block_1"
START: Sequence[Said] = [
    begins(LOOP), BlackboardWrite("/item", ITEM, LOOP), begins(RECOVER), begins(DO), begins(GRASP, ITEM)
]  # fmt: skip


def fails(origin: str, *above: str, cause: str = "grasp.missed") -> list[Transition]:
    """The failure of a node, and of those above it that end with it."""
    first = ends(origin, "FAILURE", cause, width=0.0)
    return [first, *(Transition(p, "FAILURE", {}, "", cause, origin, first.message) for p in above)]


def recovery(cause: str = "grasp.missed", handler: str = "grasp.*", attempt: int = 1) -> JournalEvent:
    return RecoveryEvent(
        "a cure is tried", RECOVER, cause=cause, failed=GRASP, handler=handler, attempt=attempt
    )


MISSED: Mapping[int, Sequence[Said]] = {
    0: START,
    10: [*fails(GRASP, DO), recovery()],
    11: [begins(CURE)],
    15: [ends(CURE)],
    16: [begins(DO), begins(GRASP, ITEM)],
}


def stories(path: Path, script: Mapping[int, Sequence[Said]], ticks: int = 40) -> tuple[FailureStory, ...]:
    with Run(record(path / "log.mcap", NODES, ticks, script)) as run:
        return failures_of(run, run.account)


def links(story: FailureStory) -> list[tuple[str, str]]:
    return [(link.path, link.outcome) for link in story.chain]


def test_a_failure_that_recovery_cured(tmp_path: Path) -> None:
    (story,) = stories(tmp_path, {**MISSED, 24: [ends(GRASP), ends(DO), ends(RECOVER)], 25: [ends(LOOP)]})
    assert (story.time, story.tick, story.node, story.id) == (0.5, 10, GRASP, "Grasp")
    assert (story.item, story.attempt, story.cause) == (ITEM, 1, "grasp.missed")
    assert story.sentence == "The fingers closed and hold nothing."
    assert (story.message, story.evidence) == (f"{GRASP} failed", {"width": 0.0})
    assert links(story) == [(DO, "FAILURE"), (RECOVER, "RUNNING")]
    (handling,) = story.handled_by
    assert (handling.node, handling.handler, handling.attempt) == (RECOVER, "grasp.*", 1)
    assert (handling.time, handling.ended, handling.seconds) == (0.55, "SUCCESS", pytest.approx(0.2))
    assert (story.fate, story.fate_by, story.fate_at) == ("cured", RECOVER, 1.2)
    assert story.cured
    assert story.remedy == ""  # the mission has one
    assert story.seconds_lost == pytest.approx(0.8)


def test_a_failure_that_a_loop_passes_over_after_giving_up(tmp_path: Path) -> None:
    first, second = stories(
        tmp_path,
        {
            **MISSED,
            24: [*fails(GRASP, DO), begins(RESORT)],
            28: [ends(RESORT), *fails(GRASP, RECOVER)[1:], ends(LOOP)],
        },
    )
    assert links(first) == [(DO, "FAILURE"), (RECOVER, "RUNNING"), (RECOVER, "FAILURE"), (LOOP, "SUCCESS")]
    assert (first.fate, first.fate_by, first.fate_at) == ("passed_over", LOOP, 1.4)
    assert [(h.handler, h.ended) for h in first.handled_by] == [("grasp.*", "SUCCESS")]
    assert first.remedy == "observe again"
    assert links(second) == [(DO, "FAILURE"), (RECOVER, "FAILURE"), (LOOP, "SUCCESS")]
    assert [(h.handler, h.attempt, h.ended) for h in second.handled_by] == [("give_up", 2, "SUCCESS")]
    assert (second.attempt, second.fate, second.because_of) == (2, "passed_over", None)


def test_a_failing_handler_follows_from_what_it_handles(tmp_path: Path) -> None:
    first, second = stories(
        tmp_path,
        {
            0: START,
            10: [*fails(GRASP, DO), recovery()],
            11: [begins(CURE)],
            15: [*fails(CURE, cause="control.timeout"), *fails(GRASP, RECOVER, LOOP)[1:]],
        },
    )
    assert [(h.handler, h.ended) for h in first.handled_by] == [("grasp.*", "FAILURE")]
    assert (first.fate, first.fate_by, first.because_of) == ("ended", LOOP, None)
    assert (second.cause, second.because_of, second.fate) == ("control.timeout", 0, "ended")
    assert links(second) == [(RECOVER, "FAILURE"), (LOOP, "FAILURE")]


def test_an_item_that_is_unknown_after_it_was_missed_was_lost_by_that(tmp_path: Path) -> None:
    _, second = stories(tmp_path, {**MISSED, 16: [begins(DO), begins(GRASP, ITEM),
                        *fails(GRASP, DO, RECOVER, cause="world.unknown_object"), ends(LOOP)]})  # fmt: skip
    assert (second.cause, second.because_of, second.remedy) == ("world.unknown_object", 0, "")


def test_a_hand_that_is_not_free_follows_from_who_left_it_full(tmp_path: Path) -> None:
    other = "blue_ball_1"
    held = ends(GRASP, "FAILURE", "grasp.no_candidate", held=ITEM)
    _, second = stories(
        tmp_path,
        {
            0: START,
            10: [*fails(GRASP, DO, RECOVER, cause="control.timeout"), BlackboardWrite("/item", other, LOOP)],
            11: [begins(RECOVER), begins(DO), begins(GRASP, other)],
            12: [held, *(Transition(p, "FAILURE", {}, "", held.cause, GRASP, held.message) for p in
                 (DO, RECOVER)), ends(LOOP)],
        },
    )  # fmt: skip
    assert (second.item, second.because_of) == (other, 0)


def test_a_failure_that_the_log_leaves_open(tmp_path: Path) -> None:
    (story,) = stories(tmp_path, {0: START, 10: [*fails(GRASP, DO), recovery()], 11: [begins(CURE)]}, 20)
    assert (story.fate, story.fate_by, story.fate_at, story.seconds_lost) == ("open", "", None, 0.95)
    assert [(h.ended, h.seconds) for h in story.handled_by] == [("RUNNING", pytest.approx(0.4))]


def test_a_false_condition_is_no_failure(tmp_path: Path) -> None:
    script = {0: START, 10: [ends(path, "FAILURE") for path in (GRASP, DO, RECOVER, LOOP)]}
    assert stories(tmp_path, script) == ()


def test_a_timeout_stops_what_runs_and_fails_by_itself(tmp_path: Path) -> None:
    nodes = tree("Main:Fallback", "Main/Timeout", "Main/Timeout/Grasp", "Main/GoTo")
    stopped = ends("Main/Timeout", "FAILURE", "tree.timeout", seconds=2.0)
    script = {
        0: [begins("Main"), begins("Main/Timeout"), begins("Main/Timeout/Grasp", ITEM)],
        10: [ends("Main/Timeout/Grasp", "IDLE"), stopped, begins("Main/GoTo")],
        14: [ends("Main/GoTo"), ends("Main")],
    }
    with Run(record(tmp_path / "log.mcap", nodes, 15, script)) as run:
        (story,) = run.failures
        killed, late = run.explanation.root_causes
    assert (story.node, story.cause) == ("Main/Timeout", "tree.timeout")
    assert (story.fate, story.fate_by) == ("branched", "Main")
    assert story.observed == ("stopped with it: Grasp",)
    assert (killed.cause, killed.ended_run) == ("run.killed", True)
    assert (late.cause, late.title) == ("tree.timeout", "Timeout was given 2 s, and needs longer")
    assert late.reasons == ("stopped were: Grasp of red_block_1",)


def test_candidates_and_plans_that_were_refused(tmp_path: Path) -> None:
    tried = tuple(
        Candidate(
            f"yaw {n}",
            (0.0, 0.0, 0.0),
            (0.0, 0.0, 0.0, 1.0),
            0.5,
            "the hand would touch wall" if n < 3 else "out of reach",
        )
        for n in range(4)
    )
    path = tmp_path / "log.mcap"
    choice = Candidates(
        "grasp by Grasp", ObjectId(ITEM), (StageCount("ranked", 4), StageCount("hand fits", 1)), tried
    )
    plans = [
        Plan(f"to ({n})", "", 50, 0.1, "planning.no_path", f"only {n} % of the line is free", 0.0)
        for n in (10, 20)
    ]
    script: Mapping[int, Sequence[Said]] = {
        0: START,
        5: [choice, *plans],
        10: fails(GRASP, DO, RECOVER, LOOP, cause="planning.no_path"),
    }
    with Run(record(path, NODES, 12, script)) as run:
        (story,) = run.failures
    grasps, planned = story.choices
    assert grasps.stages == (("ranked", 4), ("hand fits", 1))
    assert [(r.name, r.reason, r.count) for r in grasps.rejections] == [
        ("yaw 0", "the hand would touch wall", 3), ("yaw 3", "out of reach", 1)
    ]  # fmt: skip
    assert planned.stages == (("asked for", 2), ("found", 0))
    assert [(r.reason, r.count) for r in planned.rejections] == [
        ("planning.no_path: only 10 % of the line is free", 2)
    ]
