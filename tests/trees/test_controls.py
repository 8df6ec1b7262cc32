"""Control nodes against BT.CPP's semantics: statuses over ticks, and which child was ticked in which."""

from __future__ import annotations

import itertools
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.trees import NodeStatus

from .scripted import Run, letters, start


def leaf(name: str, script: str) -> str:
    return f"{{Answer: {{name: {name}, script: {script}}}}}"


def begun(control: str, *scripts: str) -> Run:
    """A control node over leaves A, B, C … with these scripts."""
    leaves = ", ".join(leaf(name, script) for name, script in zip("ABCD", scripts, strict=False))
    return start(f"Main: {{{control}: [{leaves}]}}")


def run(control: str, *scripts: str) -> tuple[str, str]:
    """Return the statuses of the root to its end, and the trace."""
    started = begun(control, *scripts)
    return letters(started.to_end()), " ".join(started.trace)


@pytest.mark.parametrize(
    ("control", "scripts", "statuses", "trace"),
    [
        # The tick ends behind a child that has ended at once.
        ("AsyncSequence", ("S", "S", "S"), "RRS", "A:S B:S C:S"),
        ("AsyncSequence", ("RS", "S"), "RS", "A:R A:S B:S"),
        ("AsyncSequence", ("K", "S", "F"), "RF", "A:K B:S C:F"),
        ("AsyncSequence", ("K", "K"), "K", "A:K B:K"),
        ("AsyncFallback", ("F", "F", "S"), "RRS", "A:F B:F C:S"),
        ("AsyncFallback", ("RF", "S"), "RS", "A:R A:F B:S"),
        # The last child cleans up after a failure.
        ("TryCatch", ("S", "RS", "S"), "RS", "A:S B:R B:S"),
        ("TryCatch", ("S", "F", "S"), "F", "A:S B:F C:S"),
        ("TryCatch", ("F", "RF"), "RF", "A:F B:R B:F"),
        ("TryCatch", ("K", "S"), "K", "A:K"),
    ],
)
def test_statuses_and_order_of_ticks(
    control: str, scripts: tuple[str, ...], statuses: str, trace: str
) -> None:
    """The nodes that are not in `semantics.yaml`; after a halt they begin anew."""
    assert run(control, *scripts) == (statuses, trace)
    halted = begun(control, *scripts)
    halted.tick()
    halted.tree.halt()
    for node in halted.tree.nodes:
        vars(node).pop("asked", None)
    halted.trace.clear()
    assert (letters(halted.to_end()), " ".join(halted.trace)) == (statuses, trace)


CONTROLS = ["Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "Parallel"]


@given(st.sampled_from(CONTROLS), st.lists(st.text("SFRK", min_size=1, max_size=4), min_size=1, max_size=4))
def test_whatever_the_children_do_nothing_runs_below_what_has_ended(control: str, scripts: list[str]) -> None:
    started = begun(control, *scripts)
    for _ in range(7):
        started.tick()
        for node in started.tree.nodes:
            if node.state is not NodeStatus.RUNNING:
                assert not [b.path for b in node.below if b.state is NodeStatus.RUNNING]
            if node.state is NodeStatus.IDLE:
                assert {b.state for b in node.below} <= {NodeStatus.IDLE}


@pytest.mark.parametrize(("first", "second"), list(itertools.product("SFK", repeat=2)))
def test_a_reactive_sequence_of_leaves_that_answer_at_once_is_a_sequence(first: str, second: str) -> None:
    assert run("ReactiveSequence", first, second) == run("Sequence", first, second)
    assert run("ReactiveFallback", first, second) == run("Fallback", first, second)


def test_statuses_of_the_round_before_are_gone_when_a_new_one_starts() -> None:
    started = start(
        """
        Main:
          Repeat:
            num_cycles: 2
            do:
              - Answer: {name: A, script: SR}
              - Answer: {name: B, script: S}
        """
    )
    started.tick()
    assert started.status("Main/Repeat/Sequence/B") is NodeStatus.SUCCESS
    started.tick()
    assert started.status("Main/Repeat/Sequence/A") is NodeStatus.RUNNING
    assert started.status("Main/Repeat/Sequence/B") is NodeStatus.IDLE


def test_repeat_asks_its_condition_before_each_round() -> None:
    started = start("Main: {Repeat: {while: items_left, do: {Answer: {name: A, script: RSS}}}}")
    started.world.known["items_left"] = True
    assert letters([started.tick(), started.tick()]) == "RR"
    started.world.known["items_left"] = False
    assert started.tick() is NodeStatus.SUCCESS
    assert started.trace == ["A:R", "A:S"]


SWITCH = """
Main:
  Sequence:
    - SetBlackboard: {value: %s, output_key: "{v}"}
    - Switch:
        variable: "{v}"
        cases:
          red: {Answer: {name: A, script: R}}
          1: {Answer: {name: B, script: S}}
          true: [{Answer: {name: C, script: S}}, {Answer: {name: D, script: S}}]
"""


@pytest.mark.parametrize(
    ("value", "trace"), [("red", "A:R"), ("1", "B:S"), ("1.0", "B:S"), ("true", "C:S D:S")]
)
def test_switch_takes_the_case_of_the_value(value: str, trace: str) -> None:
    started = start(SWITCH % value)
    started.tick()
    assert " ".join(started.trace) == trace


def test_switch_without_a_case_fails_and_says_so() -> None:
    started = start(SWITCH % "green")
    assert started.tick() is NodeStatus.FAILURE
    report = started.failure
    assert str(report.cause) == "tree.no_case"
    assert report.message == "no case for 'green', and no default"
    assert report.evidence == {"value": "green", "cases": ["red", "1", "true"]}


def test_switch_leaves_the_case_that_runs_when_the_value_changes() -> None:
    started = start(SWITCH % "red")
    started.tick()
    started.tree.blackboard.write("Main/v", 1, "test")
    assert started.tick() is NodeStatus.SUCCESS
    assert started.trace == ["A:R", "halt A", "B:S"]


def test_run_once_is_skipped_afterwards_or_repeats_its_answer() -> None:
    text = "Main: {Repeat: {num_cycles: 2, do: [%s, {Answer: {name: B, script: S}}]}}"
    skipping = start(text % "{RunOnce: {Answer: {name: A, script: S}}}")
    assert letters(skipping.to_end()) == "RS"
    assert skipping.trace == ["A:S", "B:S", "B:S"]
    failing = start("Main: {Repeat: {num_cycles: -1, do: {ForceSuccess: {RunOnce: "
                    "{then_skip: false, do: {Scripted: {name: A, script: grasp.missed}}}}}}}")  # fmt: skip
    assert letters([failing.tick(), failing.tick()]) == "RR"
    once = failing.tree.find("Main/Repeat/ForceSuccess/RunOnce")
    assert once.failure is not None
    assert (once.state, str(once.failure.cause)) == (NodeStatus.FAILURE, "grasp.missed")
    assert failing.trace == ["start A", "leave A"]


def test_for_each_reads_its_list_once_and_rests_between_elements() -> None:
    started = start(
        """
        Main:
          Sequence:
            - Find: {ids: [red_1, blue_1, red_2], found: "{items}"}
            - ForEach: {in: "{items}", out: "{item}", do: {Take: {object: "{item}"}}}
        """
    )
    assert letters([started.tick() for _ in range(3)]) == "RRR"
    assert started.tree.quiescent
    started.tree.blackboard.write("Main/items", [], "test")
    assert letters(started.to_end()) == "RRRS"
    assert started.trace == ["take red_1  30", "take blue_1  30", "take red_2  30"]


def for_each(on_failure: str, script: str, elements: str = "[1, 2, 3]") -> Run:
    return start(
        f"Main: {{ForEach: {{in: {elements}, out: '{{n}}', on_failure: {on_failure}, "
        f"do: {{Scripted: {{name: A, script: '{script}'}}}}}}}}"
    )


def test_for_each_passes_over_what_fails_and_tells_the_journal() -> None:
    started = for_each("continue", "S | grasp.missed | S")
    assert letters(started.to_end()) == "RRS"
    notes = started.notes("handled")
    assert [n.message for n in notes] == [
        "element 2 of 3 failed and is passed over: grasp.missed: A was told to"
    ]
    assert notes[0].data == {
        "cause": "grasp.missed", "by": "ForEach", "element": 2, "failed": "Main/ForEach/A",
    }  # fmt: skip


def test_for_each_fails_with_the_first_failure_when_told_so() -> None:
    started = for_each("fail", "S | grasp.missed")
    assert letters(started.to_end()) == "RF"
    assert str(started.failure.cause) == "grasp.missed"


@pytest.mark.parametrize(
    ("stopped", "script", "statuses"),
    [
        (True, "safety.force_limit | S", "F"),
        (False, "safety.force_limit | S", "RRS"),
        (False, "crash | S", "F"),
    ],
)
def test_for_each_passes_over_a_safety_stop_only_when_it_is_acknowledged(
    stopped: bool, script: str, statuses: str
) -> None:
    started = for_each("continue", script)
    started.world.known["stopped"] = stopped
    assert letters(started.to_end()) == statuses


def test_for_each_over_nothing_and_over_what_is_skipped() -> None:
    assert letters(for_each("fail", "S", "[]").to_end()) == "S"
    skipped = start("Main: {ForEach: {in: [1, 2], out: '{n}', do: {Answer: {name: A, script: K}}}}")
    assert letters(skipped.to_end()) == "RK"


@pytest.mark.parametrize(
    ("caught", "cleaning", "trace"),
    [
        ("true", "S", "guard:S A:R guard:F halt A B:S"),
        ("true", "R", "guard:S A:R guard:F halt A B:R halt B"),
        ("false", "S", "guard:S A:R guard:F halt A"),
    ],
)
def test_a_halt_of_a_try_catch_ticks_its_last_child_once(caught: str, cleaning: str, trace: str) -> None:
    inside = f"{{catch_on_halt: {caught}, do: [{leaf('A', 'R')}, {leaf('B', cleaning)}]}}"
    started = start(f"Main: {{ReactiveSequence: [{leaf('guard', 'SF')}, {{TryCatch: {inside}}}]}}")
    assert letters([started.tick(), started.tick()]) == "RF"
    assert " ".join(started.trace) == trace
    assert started.status("Main/ReactiveSequence/TryCatch/B") is NodeStatus.IDLE


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
