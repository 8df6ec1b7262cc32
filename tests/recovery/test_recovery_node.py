"""RecoveryNode with scripted leaves: what it fails with, and what it tells the journal."""

from __future__ import annotations

from picktree.trees import NodeStatus
from picktree.world import FailureReport

from ..trees.scripted import CRASH_LINE, Run, letters
from . import scripted_recovery

TEXT = """\
RecoveryNode:
  number_of_retries: %s
  do:
    - Scripted: {name: Do, script: "%s"}
    - Scripted: {name: Cure, script: "%s"}
"""


def start(retries: int, tried: str, cure: str) -> Run:
    return scripted_recovery.start(TEXT % (retries, tried, cure))


def failed(run: Run) -> FailureReport:
    assert run.to_end()[-1] is NodeStatus.FAILURE
    return run.tree.failure


def test_a_recovery_node_fails_with_the_cause_that_was_not_cured() -> None:
    report = failed(start(2, "grasp.missed", "control.timeout"))
    assert (str(report.cause), report.node) == ("grasp.missed", "Main/RecoveryNode/Do")
    assert [str(other.cause) for other in report.attached] == ["control.timeout"]


def test_a_recovery_node_whose_retries_are_used_up_attaches_the_earlier_failures() -> None:
    run = start(2, "grasp.missed|grasp.slipped|control.timeout", "S")
    report = failed(run)
    assert str(report.cause) == "control.timeout"
    assert [str(other.cause) for other in report.attached] == ["grasp.missed", "grasp.slipped"]
    assert (run.trace.count("start Do"), run.trace.count("start Cure")) == (3, 2)


def test_a_recovery_node_does_not_cure_a_fault_of_the_program() -> None:
    run = start(2, "crash", "S")
    report = failed(run)
    assert str(report.cause) == "internal.error"
    assert (report.message, report.node) == (
        f"ZeroDivisionError while Scripted was ticked: scripted (scripted.py, line {CRASH_LINE})",
        "Main/RecoveryNode/Do",
    )  # fmt: skip
    assert "start Cure" not in run.trace


def test_a_recovery_node_tells_the_journal_what_it_tries() -> None:
    run = start(1, "grasp.missed|S", "S")
    assert letters(run.to_end()) == "RRS"
    notes = run.world.journal.take()
    assert [str(getattr(note, "message", "")) for note in notes] == [
        "grasp.missed in Main/RecoveryNode/Do: Cure is tried (attempt 1 of 2)",
    ]
