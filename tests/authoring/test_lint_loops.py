"""Loops that nothing ends, and attempts that cannot turn out otherwise."""

from __future__ import annotations

import pytest

from .linting import lint, main

LOOK = "{Observe: {camera: overhead}}"
HOLDS = "{Condition: {if: holding}}"
BOUND = "(give a number of cycles or a 'while', or add a Timeout)"


def loops(node: str, rest: str = "") -> list[str]:
    found = lint(main(node) + rest, "P321", "P322", "P323")
    return [finding.replace("Main/Sequence/", "") for finding in found]


@pytest.mark.parametrize(
    ("node", "finding"),
    [
        ("KeepRunningUntilFailure: {Log: {message: a}}", "P321 4:9 KeepRunningUntilFailure: the loop "
         "never ends: Log cannot fail (use a Repeat with 'num_cycles' or 'while')"),
        ("KeepRunningUntilFailure: {ForceSuccess: OpenGripper}", "P321 4:9 KeepRunningUntilFailure: the loop "
         "never ends: ForceSuccess cannot fail (use a Repeat with 'num_cycles' or 'while')"),
        (f"Repeat: {{num_cycles: -1, do: {LOOK}}}",
         "P321 4:30 Repeat: the loop never ends: num_cycles is -1 and there is no 'while', and "
         "Observe cannot fail "
         f"{BOUND}"),
        ("Repeat: {num_cycles: -1, do: {GoTo: {pose: home}}}",
         "P321 4:30 Repeat: the loop ends only when GoTo fails: num_cycles is -1 and there is no 'while' "
         f"{BOUND}"),
        (f"Repeat: {{while: 'true', do: {LOOK}}}",
         f"P321 4:25 Repeat: the loop never ends: 'while' always holds, and Observe cannot fail {BOUND}"),
        ("RetryUntilSuccessful: {num_attempts: -1, do: {GoTo: {pose: home}}}",
         "P321 4:46 RetryUntilSuccessful: num_attempts is -1: the loop ends only when its child "
         "succeeds (give a "
         "number of attempts, or add a Timeout)"),
        ("RetryUntilSuccessful: {num_attempts: -1, do: {ForceFailure: {GoTo: {pose: home}}}}",
         "P321 4:46 RetryUntilSuccessful: the loop never ends: num_attempts is -1, and ForceFailure never "
         "succeeds (give a number of attempts, or add a Timeout)"),
        ("Parallel: [{Delay: {delay_msec: 1 s, do: AlwaysSuccess}}, "
         "{Repeat: {num_cycles: -1, do: {Log: {message: a}}}}]",
         "P321 4:89 Parallel/Repeat: the loop never ends: num_cycles is -1 and there is no "
         "'while', and Log cannot "
         f"fail {BOUND}"),
    ],
)  # fmt: skip
def test_a_loop_that_nothing_ends(node: str, finding: str) -> None:
    assert loops(node) == [finding]


@pytest.mark.parametrize(
    "node",
    [
        "KeepRunningUntilFailure: {GoTo: {pose: home}}",
        "KeepRunningUntilFailure: {Condition: {if: not holding}}",
        f"Repeat: {{num_cycles: 5, do: {LOOK}}}",
        f"Repeat: {{while: items_left, do: {LOOK}}}",
        "RetryUntilSuccessful: {num_attempts: 4, do: {GoTo: {pose: home}}}",
        f"Timeout: {{msec: 3 s, do: {{KeepRunningUntilFailure: {LOOK}}}}}",
        f"Timeout: {{msec: 3 s, do: {{Sequence: [{{Repeat: {{num_cycles: -1, do: {LOOK}}}}}]}}}}",
        f"Repeat: {{num_cycles: -1, _while: items_left, do: {LOOK}}}",
        f"Sequence: {{_while: items_left, do: [{{Repeat: {{num_cycles: -1, do: {LOOK}}}}}]}}",
        f"ReactiveSequence: [{{Condition: {{if: items_left}}}}, {{Repeat: {{num_cycles: -1, do: {LOOK}}}}}]",
        f"WhileDoElse: [{{Condition: {{if: items_left}}}}, {{Repeat: {{num_cycles: -1, do: {LOOK}}}}}]",
        f"Parallel: [{{GoTo: {{pose: home}}}}, {{Repeat: {{num_cycles: -1, do: {LOOK}}}}}]",
        "Parallel: {success_count: 1, do: [{Delay: {delay_msec: 1 s, do: AlwaysSuccess}}, "
        f"{{Repeat: {{num_cycles: -1, do: {LOOK}}}}}]}}",
    ],
)
def test_a_loop_that_something_ends(node: str) -> None:
    assert loops(node) == []


def test_a_loop_in_a_sub_tree_is_judged_where_the_sub_tree_stands() -> None:
    look = f"  Look: {{Repeat: {{num_cycles: -1, do: {LOOK}}}}}\n"
    assert loops("Timeout: {msec: 3 s, do: Look}", look) == []
    assert loops("Sequence: [{Timeout: {msec: 3 s, do: Look}}, Look]", look) == [
        "P321 5:31 Look/Repeat: the loop never ends: num_cycles is -1 and there is no 'while', and "
        "Observe cannot "
        f"fail {BOUND}"
    ]


def test_a_while_that_nothing_in_the_loop_changes() -> None:
    def loop(condition: str, *nodes: str) -> list[str]:
        loop = f"Repeat: {{while: {condition}, do: {{Sequence: [{', '.join(nodes)}]}}}}"
        trees = """
  Count:
    ports: {n: {type: int, direction: out}}
    SetBlackboard: {value: 1, output_key: "{n}"}
  Show:
    ports: {n: int}
    Log: {message: a, value: "{n}"}
  Look: {Observe: {camera: overhead}}
"""
        found = lint(main("SetBlackboard: {value: 0, output_key: '{n}'}", loop) + trees.lstrip("\n"), "P322")
        return [finding.replace("Main/Sequence/", "") for finding in found]

    log = "{Log: {message: a}}"
    assert loop("items_left", log) == [
        "P322 5:25 Repeat: nothing in Sequence changes 'items_left': once begun, the loop never ends "
        "(give a number of cycles, too)"
    ]
    assert len(loop("n < 3", log)) == len(loop("n < 3", f"{LOOK}")) == 1
    assert len(loop("n < 3", "{Show: {n: '{n}'}}")) == 1
    assert loop("n < 3", "{Log: {message: a, _onSuccess: 'n = n + 1'}}") == []
    assert loop("n < 3", "{Count: {n: '{n}'}}") == []
    assert loop("items_left", log, "Look") == []
    assert loop("time < 5", log) == []
    assert loop("items_left, num_cycles: 3", log) == []


def test_what_is_tried_again_although_nothing_changes() -> None:
    hint = "(put a node that acts, or a Delay, between two attempts)"
    says = "another attempt changes nothing: Condition gives the same result each time"
    assert loops(f"RetryUntilSuccessful: {{num_attempts: 9, do: {HOLDS}}}") == [
        f"P323 4:9 RetryUntilSuccessful: {says} {hint}"
    ]
    assert loops(f"Recover: {{do: {HOLDS}, otherwise: {{Log: {{message: a}}}}}}") == [
        f"P323 4:9 Recover: {says} {hint}"
    ]
    assert loops(f"RecoveryNode: [{HOLDS}, AlwaysSuccess]") == [f"P323 4:9 RecoveryNode: {says} {hint}"]
    steady = f"Sequence: [{{Log: {{message: a}}}}, {{Inverter: {HOLDS}}}]"
    assert loops(f"RetryUntilSuccessful: {{num_attempts: 9, do: {{{steady}}}}}") == [
        f"P323 4:9 RetryUntilSuccessful: {says.replace('Condition', 'Sequence')} {hint}"
    ]
    assert loops("RetryUntilSuccessful: {num_attempts: 9, do: Ask}", f"  Ask: {HOLDS}") == [
        f"P323 4:9 RetryUntilSuccessful: {says.replace('Condition', 'Ask')} {hint}"
    ]


@pytest.mark.parametrize(
    "node",
    [
        "RetryUntilSuccessful: {num_attempts: 9, do: {GoTo: {pose: home}}}",
        "RetryUntilSuccessful: {num_attempts: 9, do: {Condition: {if: time > 3}}}",
        f"RetryUntilSuccessful: {{num_attempts: 9, do: {{Delay: {{delay_msec: 1 s, do: {HOLDS}}}}}}}",
        f"RetryUntilSuccessful: {{num_attempts: 9, do: [{LOOK}, {HOLDS}]}}",
        f"RetryUntilSuccessful: {{num_attempts: 9, do: {{RoundRobin: [AlwaysFailure, {HOLDS}]}}}}",
        "RetryUntilSuccessful: {num_attempts: 9, do: {Condition: {if: n > 3, _onFailure: 'n = n + 1'}}}",
        f"Recover: {{do: {HOLDS}, otherwise: {LOOK}}}",
        "Recover: {do: {Condition: {if: n > 1}}, otherwise: {SetBlackboard: {value: 2, output_key: '{n}'}}}",
        f"RecoveryNode: [{HOLDS}, {{Delay: {{delay_msec: 1 s, do: SafeRetreat}}}}]",
        f"Parallel: [{{RetryUntilSuccessful: {{num_attempts: 9, do: {HOLDS}}}}}, SafeRetreat]",
        f"ReactiveFallback: [{{RetryUntilSuccessful: {{num_attempts: 9, do: {HOLDS}}}}}, SafeRetreat]",
    ],
)
def test_what_may_turn_out_otherwise_the_next_time(node: str) -> None:
    before = "SetBlackboard: {value: 0, output_key: '{n}'}\n      - Log: {message: a, value: '{n}'}\n      - "
    assert [f for f in loops(before + node) if f.startswith("P323")] == []


PASSING = """
include: [library/sorting]
trees:
  Main:
    Repeat:
      while: items_left and not stopped
%s      do:
        - Observe: {camera: overhead, objects: "{items}"}
        - ForEach: {in: "{items}", out: "{item}", on_failure: %s, do: {%s: {item: "{item}"}}}
"""


def test_a_loop_that_an_item_keeps_going() -> None:
    def found(bound: str, on_failure: str, tree: str) -> list[str]:
        return lint(PASSING % (bound, on_failure, tree), "P325")

    assert found("", "continue", "PickAndPlace") == [
        "P325 5:14 Main/Repeat: ForEach passes over failed items, and 'items_left and not stopped' still "
        "holds: an item that cannot be taken keeps the loop running for ever (give a number of cycles, "
        "or use SetAside)"
    ]
    assert found("      num_cycles: 5\n", "continue", "PickAndPlace") == []
    assert found("", "fail", "PickAndPlace") == []
    assert found("", "continue", "SortTirelessly") == []
