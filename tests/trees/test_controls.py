"""Control nodes against BT.CPP's semantics: statuses over ticks, and which child was ticked in which."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.trees import NodeStatus

from .scripted import Run, letters, start


def leaf(name: str, script: str) -> str:
    return f"{{Answer: {{name: {name}, script: {script}}}}}"


def run(control: str, *scripts: str, ticks: int | None = None) -> tuple[str, str, Run]:
    """Statuses of the root, and the trace without spaces, for leaves A, B, C … with these scripts."""
    leaves = ", ".join(leaf(name, script) for name, script in zip("ABCD", scripts, strict=False))
    ports, _, identity = control.rpartition(" ")
    body = f"{{{ports}, do: [{leaves}]}}" if ports else f"[{leaves}]"
    started = start(f"Main: {{{identity}: {body}}}")
    statuses = started.to_end() if ticks is None else [started.tick() for _ in range(ticks)]
    return letters(statuses), " ".join(started.trace), started


CASES = [
    # with memory: a child that ended is not asked again
    ("Sequence", ("S", "S"), "S", "A:S B:S"),
    ("Sequence", ("S", "RS", "S"), "RS", "A:S B:R B:S C:S"),
    ("Sequence", ("S", "F", "S"), "F", "A:S B:F"),
    ("Sequence", ("K", "S"), "S", "A:K B:S"),
    ("Sequence", ("K", "K"), "K", "A:K B:K"),
    ("Sequence", ("S", "K"), "S", "A:S B:K"),
    ("Fallback", ("F", "S", "S"), "S", "A:F B:S"),
    ("Fallback", ("F", "RS"), "RS", "A:F B:R B:S"),
    ("Fallback", ("F", "RF", "S"), "RS", "A:F B:R B:F C:S"),
    ("Fallback", ("F", "F"), "F", "A:F B:F"),
    ("Fallback", ("K", "F"), "F", "A:K B:F"),
    ("Fallback", ("F", "K"), "F", "A:F B:K"),
    ("Fallback", ("K", "K"), "K", "A:K B:K"),
    # the tick ends behind a child that has ended at once
    ("AsyncSequence", ("S", "S", "S"), "RRS", "A:S B:S C:S"),
    ("AsyncSequence", ("RS", "S"), "RS", "A:R A:S B:S"),
    ("AsyncSequence", ("K", "S", "F"), "RF", "A:K B:S C:F"),
    ("AsyncFallback", ("F", "F", "S"), "RRS", "A:F B:F C:S"),
    ("AsyncFallback", ("RF", "S"), "RS", "A:R A:F B:S"),
    # the last child cleans up after a failure
    ("TryCatch", ("S", "RS", "S"), "RS", "A:S B:R B:S"),
    ("TryCatch", ("S", "F", "S"), "F", "A:S B:F C:S"),
    ("TryCatch", ("F", "RF"), "RF", "A:F B:R B:F"),
    ("TryCatch", ("K", "S"), "K", "A:K"),
    # reactive: every child is asked anew; the new branch is ticked before the old one is halted
    ("ReactiveSequence", ("S", "RRS"), "RRS", "A:S B:R A:S B:R A:S B:S"),
    ("ReactiveSequence", ("SSF", "R"), "RRF", "A:S B:R A:S B:R A:F halt B"),
    ("ReactiveSequence", ("SR", "R"), "RR", "A:S B:R A:R halt B"),
    ("ReactiveSequence", ("K", "S"), "S", "A:K B:S"),
    ("ReactiveSequence", ("K", "K"), "K", "A:K B:K"),
    ("ReactiveSequence", ("S", "S", "RS"), "RS", "A:S B:S C:R A:S B:S C:S"),
    ("ReactiveFallback", ("FFS", "R"), "RRS", "A:F B:R A:F B:R A:S halt B"),
    ("ReactiveFallback", ("FR", "R"), "RR", "A:F B:R A:R halt B"),
    ("ReactiveFallback", ("F", "RF"), "RF", "A:F B:R A:F B:F"),
    ("ReactiveFallback", ("K", "K"), "K", "A:K B:K"),
    ("ReactiveFallback", ("K", "F"), "F", "A:K B:F"),
    # parallel: by default all must succeed, and one failure ends it
    ("Parallel", ("S", "RS"), "RS", "A:S B:R B:S"),
    ("Parallel", ("RR", "F"), "F", "A:R B:F halt A"),
    ("Parallel", ("F", "S"), "F", "A:F"),
    ("Parallel", ("K", "RS"), "RS", "A:K B:R A:K B:S"),
    ("Parallel", ("K", "K"), "K", "A:K B:K"),
    ("success_count: 1 Parallel", ("RR", "S", "R"), "S", "A:R B:S halt A"),
    ("success_count: 1, failure_count: 2 Parallel", ("F", "RS"), "RS", "A:F B:R B:S"),
    ("success_count: -2, failure_count: 2 Parallel", ("F", "S", "S"), "S", "A:F B:S C:S"),
    ("failure_count: 2 Parallel", ("F", "S"), "F", "A:F"),
    # branches
    ("IfThenElse", ("S", "RS", "S"), "RS", "A:S B:R B:S"),
    ("IfThenElse", ("F", "S", "RF"), "RF", "A:F C:R C:F"),
    ("IfThenElse", ("RS", "S"), "RS", "A:R A:S B:S"),
    ("IfThenElse", ("F", "S"), "F", "A:F"),
    ("IfThenElse", ("K", "S"), "K", "A:K"),
    ("IfThenElse", ("S", "K"), "K", "A:S B:K"),
    ("WhileDoElse", ("SSF", "RR", "S"), "RRS", "A:S B:R A:S B:R A:F halt B C:S"),
    ("WhileDoElse", ("FS", "S", "R"), "RS", "A:F C:R A:S halt C B:S"),
    ("WhileDoElse", ("SF", "R"), "RF", "A:S B:R A:F halt B"),
    ("WhileDoElse", ("RS", "S"), "RS", "A:R A:S B:S"),
    # decorators; a loop ends its tick between two rounds
    ("Inverter", ("RS",), "RF", "A:R A:S"),
    ("Inverter", ("F",), "S", "A:F"),
    ("Inverter", ("K",), "K", "A:K"),
    ("ForceSuccess", ("RF",), "RS", "A:R A:F"),
    ("ForceSuccess", ("K",), "K", "A:K"),
    ("ForceFailure", ("RS",), "RF", "A:R A:S"),
    ("ForceFailure", ("K",), "K", "A:K"),
    ("num_cycles: 3 Repeat", ("S",), "RRS", "A:S A:S A:S"),
    ("num_cycles: 2 Repeat", ("RS",), "RRS", "A:R A:S A:S"),
    ("num_cycles: 2 Repeat", ("SF",), "RF", "A:S A:F"),
    ("num_cycles: 2 Repeat", ("K",), "K", "A:K"),
    ("num_cycles: 0 Repeat", ("S",), "S", ""),
    ("KeepRunningUntilFailure", ("SSRF",), "RRRF", "A:S A:S A:R A:F"),
    ("num_attempts: 3 RetryUntilSuccessful", ("FFS",), "RRS", "A:F A:F A:S"),
    ("num_attempts: 2 RetryUntilSuccessful", ("F",), "RF", "A:F A:F"),
    ("num_attempts: 2 RetryUntilSuccessful", ("K",), "K", "A:K"),
    ("msec: 100 Timeout", ("RRRR",), "RRF", "A:R A:R halt A"),
    ("msec: 0.1 s Timeout", ("RS",), "RS", "A:R A:S"),
    ("msec: 0 Timeout", ("RRRRRS",), "RRRRRS", "A:R A:R A:R A:R A:R A:S"),
    ("delay_msec: 100 Delay", ("RS",), "RRRS", "A:R A:S"),
    ("delay_msec: 0 Delay", ("S",), "S", "A:S"),
    ("RunOnce", ("RF",), "RF", "A:R A:F"),
]


@pytest.mark.parametrize(("control", "scripts", "statuses", "trace"), CASES)
def test_statuses_and_order_of_ticks(
    control: str, scripts: tuple[str, ...], statuses: str, trace: str
) -> None:
    seen, done, _ = run(control, *scripts, ticks=len(statuses))
    assert (seen, done) == (statuses, trace)


@pytest.mark.parametrize(("control", "scripts", "statuses", "trace"), CASES)
def test_halted_after_any_tick_everything_is_idle_and_a_new_start_is_like_the_first(
    control: str, scripts: tuple[str, ...], statuses: str, trace: str
) -> None:
    for ticks in range(1, len(statuses) + 1):
        _, _, started = run(control, *scripts, ticks=ticks)
        running = [n.name for n in started.tree.nodes if n.state is NodeStatus.RUNNING and not n.children]
        started.trace.clear()
        report = started.tree.halt()
        assert started.trace == [f"halt {name}" for name in running]
        assert {node.status for node in report.nodes} == {NodeStatus.IDLE}
        assert not any(node.cause for node in report.nodes)
        if control == "RunOnce":
            continue  # it is to remember
        for node in started.tree.nodes:
            if hasattr(node, "asked"):
                setattr(node, "asked", 0)  # noqa: B010
        started.trace.clear()
        again = letters([started.tick() for _ in statuses])
        assert (again, " ".join(started.trace)) == (statuses, trace)


CONTROLS = ["Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "Parallel"]


@given(st.sampled_from(CONTROLS), st.lists(st.text("SFRK", min_size=1, max_size=4), min_size=1, max_size=4))
def test_whatever_the_children_do_nothing_runs_below_what_has_ended(control: str, scripts: list[str]) -> None:
    _, _, started = run(control, *scripts, ticks=1)
    for _ in range(6):
        for node in started.tree.nodes:
            if node.state is not NodeStatus.RUNNING:
                assert not [b.path for b in node.below if b.state is NodeStatus.RUNNING]
            if node.state is NodeStatus.IDLE:
                assert {b.state for b in node.below} <= {NodeStatus.IDLE}
        started.tick()


@pytest.mark.parametrize(("first", "second"), list(itertools.product("SFK", repeat=2)))
def test_a_reactive_sequence_of_leaves_that_answer_at_once_is_a_sequence(first: str, second: str) -> None:
    assert run("ReactiveSequence", first, second)[:2] == run("Sequence", first, second)[:2]
    assert run("ReactiveFallback", first, second)[:2] == run("Fallback", first, second)[:2]


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
    report = started.tree.failure
    assert report is not None
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
    assert started.tree.failure is not None
    assert str(started.tree.failure.cause) == "grasp.missed"


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
