"""Logs of format 1 tell no beginnings and ends: what is derived from their statuses is what was told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from picktree.analysis import Run
from picktree.analysis.explain import FailureStory, explain
from picktree.analysis.explain.run_explanation import failures_of
from picktree.logs import Stamped, account_of
from picktree.logs.log_records import NodeStatusRecord, Tick
from picktree.logs.node_visits import VisitTree, with_transitions


def told(story: FailureStory) -> tuple[object, ...]:
    return (
        round(story.time, 6), story.node, story.item, story.cause, story.message, story.fate, story.fate_by,
        story.because_of, tuple(handling.handler for handling in story.handled_by),
    )  # fmt: skip


def test_the_same_failures_follow_from_the_statuses(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        known = [told(story) for story in run.failures]
        derived = account_of(run.log, run.events, derived=True)
        assert [told(story) for story in failures_of(run, derived)] == known
        assert len(known) > 1
        leaves = [
            (v.path, v.outcome, v.first, v.last) for v in run.visits if not VisitTree(run.visits).children(v)
        ]
        found = {(v.path, v.outcome, v.first, v.last) for v in derived.visits}
        assert [leaf for leaf in leaves if leaf not in found] == []


def status(path: str, status: str, *, ticked: bool = True, cause: str = "") -> NodeStatusRecord:
    return NodeStatusRecord(path, path.rsplit("/", 1)[-1], status, ticked, "no luck" if cause else "", cause)


def test_beginnings_ends_halts_and_origins_of_statuses() -> None:
    ticks = [
        Tick("RUNNING", "", (status("Main", "RUNNING"), status("Main/A", "RUNNING"))),
        Tick("RUNNING", "", (status("Main", "RUNNING"), status("Main/A", "IDLE", ticked=False))),
        Tick(
            "FAILURE", "", (status("Main", "FAILURE", cause="x.y"), status("Main/A", "FAILURE", cause="x.y"))
        ),
    ]
    found = [
        [(t.path, t.status, t.origin) for t in at.record.transitions]
        for at in with_transitions(Stamped(0.05 * k, tick) for k, tick in enumerate(ticks))
    ]
    assert found == [
        [("Main", "RUNNING", ""), ("Main/A", "RUNNING", "")],
        [("Main/A", "IDLE", "")],
        [("Main/A", "RUNNING", ""), ("Main/A", "FAILURE", "Main/A"), ("Main", "FAILURE", "Main/A")],
    ]


def test_a_log_of_format_1_is_explained(log_path: Path, sample: object) -> None:
    del sample
    with Run(log_path) as run:
        run.log.format = 1
        found = explain(run)
    (failure,) = found.failures
    assert (failure.time, failure.node, failure.cause, failure.fate) == (
        1.5,
        "/Main/Grasp",
        "grasp.missed",
        "ended",
    )
    assert replace(found.outcome, sentence="").status == "killed"
