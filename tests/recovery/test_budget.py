"""Budget with scripted leaves: what recovery may cost, for an item and for everything."""

from __future__ import annotations

from textwrap import indent

import pytest

from picktree.trees import NodeStatus
from picktree.world import Plain

from ..trees.scripted import FakeWorld, Run, letters
from .scripted_recovery import faults, start


def causes(run: Run) -> list[str]:
    """Of the failure, outermost first, along the first attached."""
    found: list[str] = []
    report = run.tree.failure
    while report is not None:
        found.append(f"{report.cause} {report.node}")
        report = report.attached[0] if report.attached else None
    return found


TRIES = """\
Budget:
  tries: %d
  do:
    Recover:
      attempts: 9
      do: {Scripted: {name: Do, script: "%s"}}
      otherwise: {Scripted: {name: Cure, script: "%s"}}
      give_up: {Scripted: {name: Leave, script: R S}}
"""


def test_a_handler_more_than_it_allows_is_refused_and_give_up_runs() -> None:
    run = start(TRIES % (2, "grasp.missed", "S"))
    assert letters(run.to_end())[-1] == "F"
    assert (run.trace.count("start Do"), run.trace.count("start Cure")) == (3, 2)
    assert run.trace.count("end Leave") == 1
    assert causes(run) == ["tree.budget Main/Budget", "grasp.missed Main/Budget/Recover/Do"]
    assert run.tree.failure.message == ("the budget is used up (2 of 2 handlers, 0.2 s): Do was told to")
    assert [e.data["tries"] for e in run.notes("budget")] == [2]


def test_without_a_failure_it_costs_nothing() -> None:
    run = start(TRIES % (0, "RRRR S", "S"))
    assert letters(run.to_end()) == "RRRRS"
    assert run.notes("budget") == []


def test_a_budget_of_no_handler_refuses_the_first_one() -> None:
    run = start(TRIES % (0, "grasp.missed", "S"))
    assert letters(run.to_end())[-1] == "F"
    assert (run.trace.count("start Do"), run.trace.count("start Cure")) == (1, 0)
    assert run.tree.failure.message == "the budget is used up (0 of 0 handlers, 0.0 s): Do was told to"


def test_time_counts_from_the_first_failure_and_a_handler_that_runs_is_finished() -> None:
    body = TRIES.replace("tries: %d", "time: %g") % (0.5, "R" * 40 + " grasp.missed", "R" * 6 + " S")
    run = start(body)
    assert run.to_end()[-1] is NodeStatus.FAILURE
    # The first attempt, of 2 s, is no recovery; the handler is; the second attempt uses the rest up.
    assert run.trace.count("start Do") == 2
    assert run.trace.count("end Cure") == 1
    assert causes(run)[0] == "tree.budget Main/Budget"


def test_a_used_up_budget_is_passed_over_by_nobody_below_it() -> None:
    body = """\
Budget:
  tries: 1
  do:
    ForEach:
      in: [1, 2, 3]
      out: "{n}"
      on_failure: continue
      do:
        Fallback:
          - Recover:
              do: {Scripted: {name: Do, script: grasp.missed}}
              otherwise: {Scripted: {name: Cure}}
          - Log: {message: passed over, value: "{n}"}
"""
    run = start(body)
    assert run.to_end()[-1] is NodeStatus.FAILURE
    assert (run.trace.count("start Do"), run.trace.count("start Cure")) == (2, 1)
    assert causes(run)[0] == "tree.budget Main/Budget"


def test_a_recover_between_gives_up_too_before_the_budget_ends() -> None:
    body = """\
Budget:
  tries: 1
  do:
    Recover:
      do:
        Recover:
          do: {Scripted: {name: Do, script: grasp.missed}}
          otherwise: {Scripted: {name: Cure}}
          give_up: {Scripted: {name: Inner, script: RR S}}
      otherwise: {Scripted: {name: Other}}
      give_up: {Scripted: {name: Outer, script: RR S}}
"""
    run = start(body)
    assert run.to_end()[-1] is NodeStatus.FAILURE
    assert [line for line in run.trace if line.startswith("end")] == ["end Cure", "end Inner", "end Outer"]


ITEMS = """\
Budget:
  tries: 9
  do:
    Repeat:
      num_cycles: 3
      do:
        ForEach:
          in: [a, b]
          out: "{item}"
          on_failure: continue
          do:
            Fallback:
              - Budget:
                  of: "{item}"
                  tries: 2
                  do:
                    Recover:
                      do: {Scripted: {name: Do, script: "%s"}}
                      otherwise: {Scripted: {name: Cure}}
              - Log: {message: left, value: "{item}"}
"""


def test_an_account_of_an_object_is_kept_from_one_round_to_the_next() -> None:
    run = start(ITEMS % "grasp.missed")
    assert run.to_end()[-1] is NodeStatus.SUCCESS
    # Two handlers for each; in later rounds one attempt without any.
    assert run.trace.count("start Cure") == 4
    assert run.trace.count("start Do") == 2 * (3 + 1 + 1)
    assert [e.data["object"] for e in run.notes("budget")] == ["a", "b"] * 2


def test_an_account_is_closed_when_the_child_has_succeeded() -> None:
    run = start(ITEMS % "|".join(["grasp.missed|grasp.missed|S"] * 6))
    assert run.to_end()[-1] is NodeStatus.FAILURE  # nine in all are allowed
    assert run.trace.count("start Cure") == 9
    assert causes(run)[0] == "tree.budget Main/Budget"


def test_accounts_are_saved_and_restored() -> None:
    world = FakeWorld()
    run = start(ITEMS % "grasp.missed", world)
    seen: list[dict[str, Plain]] = []
    for _ in range(6):
        run.tick()
        if run.tree.quiescent:
            seen.append(run.tree.save())
    other = start(ITEMS % "grasp.missed", world)
    other.tree.restore(seen[-1])
    assert other.to_end()[-1] is NodeStatus.SUCCESS
    assert world.trace.count("start Cure") == 4


def test_what_was_given_up_before_does_not_end_the_next_start() -> None:
    run = start(
        "RetryUntilSuccessful:\n  num_attempts: 2\n  do:\n"
        + indent(TRIES % (0, "grasp.missed|R S", "S"), "    ")
    )
    assert run.to_end()[-1] is NodeStatus.SUCCESS
    assert run.trace.count("start Do") == 2


TIMED = """\
Budget:
  %s
  do:
    Recover:
      attempts: 9
      do: {Scripted: {name: Do, script: "%s"}}
      otherwise: {Scripted: {name: Cure, script: "%s"}}
"""


def timed(run: Run) -> NodeStatus:
    """To the end, each tick a quarter of a second after the last, so that the clock has no rounding."""
    for number in range(100):
        run.world.clock.now = 40.0 + 0.25 * number
        run.tree.tick()
        if run.tree.status is not NodeStatus.RUNNING:
            break
    return run.tree.status


@pytest.mark.parametrize(
    ("time", "cures", "seconds"), [(0.5, 1, 0.5), (0.75, 2, 1.25), (1.25, 2, 1.25), (1.5, 3, 2.0)]
)
def test_a_budget_of_time_is_used_up_when_that_time_is(time: float, cures: int, seconds: float) -> None:
    """A cure takes a tick and the attempt after it two, the last of which is counted when it is over; the
    time before the first failure is not counted, whatever the clock says."""
    run = start(TIMED % (f"time: {time}", "RRR grasp.missed|R grasp.slipped", "S"))
    assert timed(run) is NodeStatus.FAILURE
    assert run.trace.count("start Cure") == cures
    (note,) = run.notes("budget")
    assert note.data["tries"] == cures
    assert note.data["seconds"] == seconds


@pytest.mark.parametrize(
    ("ports", "told"),
    [
        ("tries: 1", "is used up (1 of 1 handlers, 0.5 s): Do was told to"),
        ("time: 0.5", "is used up (1 handlers, 0.5 of 0.5 s): Do was told to"),
        ("tries: 1\n  time: 9", "is used up (1 of 1 handlers, 0.5 of 9 s): Do was told to"),
        ("tries: 1\n  of: a", "of a is used up (1 of 1 handlers, 0.5 s): Do was told to"),
    ],
)
def test_a_used_up_budget_says_what_was_spent_for_what(ports: str, told: str) -> None:
    run = start(TIMED % (ports, "grasp.missed|R grasp.slipped", "S"))
    assert timed(run) is NodeStatus.FAILURE
    whose = "a" if "of: a" in ports else ""
    (note,) = run.notes("budget")
    assert note.message == f"the budget {told}"
    assert note.data == {
        "cause": "grasp.slipped", "failed": "Main/Budget/Recover/Do", "object": whose, "tries": 1,
        "seconds": 0.5,
    }  # fmt: skip
    failure = run.tree.failure
    assert failure.message == f"the budget {told}"
    assert failure.evidence == {"object": whose, "tries": 1, "seconds": 0.5, "cause": "grasp.slipped"}
    # What nobody paid for, then what was cured before.
    assert [str(each.cause) for each in failure.attached] == ["grasp.slipped", "grasp.missed"]


def test_of_two_hundred_other_objects_the_accounts_are_kept() -> None:
    body = """\
ForEach:
  in: [%s]
  out: "{item}"
  on_failure: continue
  do:
    Budget:
      of: "{item}"
      tries: 1
      do: {Recover: {do: {Scripted: {name: Do, script: grasp.missed}}, otherwise: {Scripted: {name: Cure}}}}
"""
    for others, again in ((200, 0), (201, 1)):
        names = ["a", *(f"b{number}" for number in range(others)), "a"]
        run = start(body % ", ".join(names))
        assert run.to_end(2000)[-1] is not NodeStatus.RUNNING
        assert run.trace.count("start Cure") == others + 1 + again


def test_a_budget_that_bounds_nothing_is_refused() -> None:
    wrong = ["without `tries` or `time` nothing is bounded"]
    for ports in ("", "tries: -1,", "time: 0 s,", "tries: -1, time: 0,"):
        assert [f.message for f in faults(f"Budget: {{{ports} do: AlwaysSuccess}}\n")] == wrong, ports
    for ports in ("tries: 0", "time: 1 s", "tries: -1, time: 1 s", "tries: 2, time: 0 s"):
        assert faults(f"Budget: {{{ports}, do: AlwaysSuccess}}\n") == (), ports
