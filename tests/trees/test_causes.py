"""Causes travel to the root: which failure a control node fails with, and what cannot be hidden."""

from __future__ import annotations

import pytest

from picktree.trees import NodeStatus
from picktree.world import FailureReport

from .scripted import Run, letters, start


def leaf(name: str, script: str) -> str:
    return f"{{Scripted: {{name: {name}, script: '{script}'}}}}"


def failed(body: str) -> tuple[Run, FailureReport]:
    started = start(body)
    assert started.to_end()[-1] is NodeStatus.FAILURE
    report = started.failure
    return started, report


def test_a_sequence_fails_with_its_failing_child() -> None:
    _, report = failed(f"Main: {{Sequence: [{leaf('A', 'S')}, {leaf('B', 'RR grasp.missed')}]}}")
    assert (str(report.cause), report.message, report.node) == (
        "grasp.missed", "B was told to", "Main/Sequence/B",
    )  # fmt: skip
    assert report.evidence == {"turn": 0}


@pytest.mark.parametrize("control", ["Fallback", "ReactiveFallback"])
def test_a_fallback_fails_with_its_last_child_and_attaches_the_others(control: str) -> None:
    _, report = failed(
        f"Main: {{{control}: [{leaf('A', 'grasp.missed')}, {{AlwaysSuccess: {{_skipIf: 'true'}}}}, "
        f"{leaf('C', 'control.timeout')}]}}"
    )
    assert (str(report.cause), report.node) == ("control.timeout", f"Main/{control}/C")
    assert [str(other.cause) for other in report.attached] == ["grasp.missed"]


def test_a_false_condition_is_no_report_and_hides_none() -> None:
    started = start("Main: {Condition: {if: 1 > 2}}")
    assert letters(started.to_end()) == "F"
    assert started.tree.failure is None
    _, report = failed(f"Main: {{Fallback: [{leaf('A', 'grasp.missed')}, {{Condition: {{if: 1 > 2}}}}]}}")
    assert str(report.cause) == "grasp.missed"


def test_a_parallel_fails_with_the_first_that_failed() -> None:
    _, report = failed(
        f"Main: {{Parallel: {{failure_count: 2, success_count: 1, do: "
        f"[{leaf('A', 'RR grasp.missed')}, {leaf('B', 'R control.timeout')}]}}}}"
    )
    assert str(report.cause) == "control.timeout"
    assert [str(other.cause) for other in report.attached] == ["grasp.missed"]


def test_a_timeout_halts_and_says_what_still_ran() -> None:
    started, report = failed(f"Main: {{Timeout: {{msec: 100 ms, do: {leaf('A', 'RRRR')}}}}}")
    assert (str(report.cause), report.message, report.node) == (
        "tree.timeout", "A still ran after 0.1 s", "Main/Timeout",
    )  # fmt: skip
    assert report.evidence == {"seconds": 0.1, "running": "Main/Timeout/A"}
    assert started.trace[-1] == "leave A"


def test_a_retry_fails_with_the_last_failure_and_attaches_the_earlier() -> None:
    retry = "Main: {RetryUntilSuccessful: {num_attempts: 3, do: %s}}"
    _, report = failed(retry % leaf("A", "grasp.missed | grasp.slipped | control.timeout"))
    assert str(report.cause) == "control.timeout"
    assert [str(other.cause) for other in report.attached] == ["grasp.missed", "grasp.slipped"]
    _, report = failed(retry % "{Condition: {if: 1 > 2}}")
    assert (str(report.cause), report.message) == ("tree.attempts", "3 attempts are used up")


def test_a_fault_of_the_program_is_not_tried_again() -> None:
    started, report = failed(f"Main: {{RetryUntilSuccessful: {{num_attempts: 3, do: {leaf('A', 'crash')}}}}}")
    assert str(report.cause) == "internal.error"
    assert started.trace.count("start A") == 1


@pytest.mark.parametrize("hider", ["ForceSuccess", "Inverter"])
@pytest.mark.parametrize(
    ("script", "end"),
    [("grasp.missed", "S"), ("safety.force_limit", "F"), ("safety.stop", "F"), ("crash", "F")],
)
def test_no_decorator_makes_a_success_of_a_safety_stop(hider: str, script: str, end: str) -> None:
    started = start(f"Main: {{{hider}: {leaf('A', script)}}}")
    assert letters(started.to_end()) == end
    assert (started.tree.failure is None) is (end == "S")


def test_the_failure_is_gone_after_a_success() -> None:
    started = start(
        f"Main: {{RetryUntilSuccessful: {{num_attempts: 2, do: {leaf('A', 'grasp.missed | R S')}}}}}"
    )
    started.tick()
    assert started.tree.find("Main/RetryUntilSuccessful/A").failure is not None
    started.tick()
    assert started.tree.find("Main/RetryUntilSuccessful/A").failure is None
    assert started.tick() is NodeStatus.SUCCESS
    assert {n.cause for n in started.report.nodes} == {""}


def test_a_cause_that_was_not_declared_is_noted() -> None:
    started, report = failed(f"Main: {leaf('A', 'insert.jammed')}")
    assert str(report.cause) == "insert.jammed"
    assert [n.message for n in started.notes("undeclared_cause")] == [
        "Scripted failed with insert.jammed, which it does not declare"
    ]
