"""RoundRobin: what it fails with, and that a saved state keeps whose turn it is."""

from __future__ import annotations

import json

from picktree.trees import NodeStatus

from .scripted import letters, start

TURNS = """
Main:
  Repeat:
    num_cycles: 4
    do:
      RoundRobin:
        wrap_around: true
        do:
          - Scripted: {name: A}
          - Scripted: {name: B}
          - Scripted: {name: C}
"""


def test_a_round_robin_fails_with_its_last_child_and_attaches_the_others() -> None:
    run = start(
        """
        Main:
          RoundRobin:
            - Scripted: {name: A, script: grasp.missed}
            - Scripted: {name: B, script: R grasp.slipped}
            - Scripted: {name: C, script: control.timeout}
        """
    )
    assert letters(run.to_end()) == "RF"
    report = run.failure
    assert (str(report.cause), report.node) == ("control.timeout", "Main/RoundRobin/C")
    assert [str(other.cause) for other in report.attached] == ["grasp.missed", "grasp.slipped"]


def test_a_round_robin_whose_turns_are_over_says_so() -> None:
    run = start("Main: {RoundRobin: [{Scripted: {name: A}}]}")
    assert letters([run.tick(), run.tick()]) == "SF"
    report = run.failure
    assert (str(report.cause), report.message) == ("tree.attempts", "every child has had its turn")
    assert run.tick() is NodeStatus.SUCCESS


def test_whose_turn_it_is_is_part_of_the_saved_state() -> None:
    run = start(TURNS)
    run.tick()
    run.tick()
    assert run.tree.quiescent
    other = start(TURNS)
    other.tree.restore(json.loads(json.dumps(run.tree.save())))
    other.tick()
    other.tick()
    assert other.trace == ["start C", "end C", "start A", "end A"]
