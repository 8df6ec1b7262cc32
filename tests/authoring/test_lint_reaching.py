"""Nodes that no way through the mission leads to."""

from __future__ import annotations

import pytest

from .linting import lint, main


def unreached(*nodes: str, rest: str = "") -> list[str]:
    found = [finding.replace("Main/Sequence/", "") for finding in lint(main(*nodes) + rest, "P320")]
    return [finding.replace("this node is never reached: ", "").split(" ", 2)[2] for finding in found]


LOG = "{Log: {message: a}}"


def test_what_follows_a_node_that_never_succeeds() -> None:
    assert unreached("AlwaysFailure", "Log: {message: a}", "GoTo: {pose: home}") == [
        "Log: AlwaysFailure before it never succeeds (nor what follows it: GoTo)"
    ]
    assert unreached("KeepRunningUntilFailure: {GoTo: {pose: home}}", "Log: {message: a}") == [
        "Log: KeepRunningUntilFailure before it never succeeds"
    ]
    assert unreached("AlwaysFailure: {_skipIf: holding}", "Log: {message: a}") == []


@pytest.mark.parametrize(
    ("node", "finding"),
    [
        (f"Fallback: [{LOG}, SafeRetreat]", "Fallback/SafeRetreat: Log before it never fails"),
        (f"ReactiveFallback: [AlwaysSuccess, {LOG}]",
         "ReactiveFallback/Log: AlwaysSuccess before it never fails"),
        (f"RoundRobin: [{LOG}, AlwaysSuccess]", "RoundRobin/AlwaysSuccess: Log before it never fails"),
        (f"IfThenElse: [{{Condition: {{if: 1 > 2}}}}, {LOG}, AlwaysSuccess]",
         "IfThenElse/Log: Condition before it never succeeds"),
        (f"WhileDoElse: [AlwaysSuccess, AlwaysSuccess, {LOG}]",
         "WhileDoElse/Log: AlwaysSuccess before it never fails"),
        (f"ForEach: {{in: [], do: {LOG}}}", "ForEach/Log: there is no element"),
        (f"Repeat: {{num_cycles: 3, while: 'false', do: {LOG}}}", "Repeat/Log: its while never holds"),
        (f"Repeat: {{num_cycles: 0, do: {LOG}}}", "Repeat/Log: num_cycles is 0"),
        (f"Parallel: [AlwaysFailure, {LOG}]", "Parallel/Log: Parallel already ends in the first tick"),
        (f"Switch: {{variable: red, cases: {{red: AlwaysSuccess, blue: {LOG}}}}}",
         "Switch/Log: the value is always 'red'"),
        ("Log: {message: a, _skipIf: 'true'}", "Log: it never starts: its _skipIf always holds"),
        (f"Sequence: {{_while: 'false', do: [{LOG}]}}", "Sequence: it never starts: its _while never holds"),
        (f"Recover: {{do: {LOG}, otherwise: SafeRetreat}}", "Recover/SafeRetreat: Log never fails"),
        (f"RecoveryNode: [{LOG}, SafeRetreat]", "RecoveryNode/SafeRetreat: Log never fails"),
        (f"RecoveryNode: {{number_of_retries: 0, do: [OpenGripper, {LOG}]}}",
         "RecoveryNode/Log: OpenGripper may run only once, so no second run follows"),
        (f"TryCatch: [AlwaysSuccess, {LOG}]", "TryCatch/Log: no child before it fails"),
        (f"TryCatch: {{catch_on_halt: true, do: [AlwaysSuccess, {LOG}]}}",
         "TryCatch/Log: no child before it fails"),
        (f"TryCatch: [AlwaysFailure, OpenGripper, {LOG}]",
         "TryCatch/OpenGripper: AlwaysFailure before it never succeeds"),
        (f"AsyncSequence: [AlwaysFailure, {LOG}]",
         "AsyncSequence/Log: AlwaysFailure before it never succeeds"),
        (f"AsyncFallback: [AlwaysSuccess, {LOG}]", "AsyncFallback/Log: AlwaysSuccess before it never fails"),
    ],
)  # fmt: skip
def test_a_branch_that_is_never_taken(node: str, finding: str) -> None:
    assert unreached(node) == [finding]


@pytest.mark.parametrize(
    "node",
    [
        f"Fallback: [{{Observe: {{camera: overhead}}}}, {LOG}]",  # it may lose sight of an object
        f"Fallback: [{{Inverter: {LOG}}}, {LOG}]",
        f"Fallback: [{{Log: {{message: a, _failureIf: holding}}}}, {LOG}]",
        f"Repeat: {{num_cycles: 2, do: {{Fallback: [{{RunOnce: {LOG}}}, {LOG}]}}}}",
        f"Repeat: {{num_cycles: 2, do: {{RoundRobin: [{LOG}, AlwaysSuccess]}}}}",
        f"Repeat: {{num_cycles: 2, do: {{RunOnce: {LOG}}}}}",
        f"IfThenElse: [{{Condition: {{if: holding}}}}, {LOG}, AlwaysSuccess]",
        f"ForEach: {{in: [1], do: {LOG}}}",
        f"TryCatch: {{catch_on_halt: true, do: [{{Sleep: {{msec: 100}}}}, {LOG}]}}",
        f"TryCatch: {{do: [OpenGripper, {LOG}]}}",
        f"AsyncFallback: [{{Condition: {{if: holding}}}}, {LOG}]",
        f"Parallel: [{{Observe: {{camera: overhead}}}}, {LOG}]",
        f"Parallel: {{failure_count: 2, do: [AlwaysFailure, {LOG}]}}",
        f"Timeout: {{msec: 0, do: {LOG}}}",
        f"Recover: {{do: OpenGripper, when: {{control.timeout: {LOG}}}, give_up: {LOG}}}",
        f"Sequence: [{{IfThenElse: [{{Condition: {{if: holding}}}}, AlwaysFailure, AlwaysSuccess]}}, {LOG}]",
    ],
)
def test_branches_that_some_way_takes(node: str) -> None:
    assert unreached(node) == []


def test_a_sub_tree_is_reached_when_any_of_its_uses_is() -> None:
    sub = "  Sub: {Sequence: [{Condition: {if: holding}}, {Log: {message: a}}]}\n"
    assert unreached("AlwaysFailure", "Sub", rest=sub) == ["Sub: AlwaysFailure before it never succeeds"]
    assert unreached("Sub", "AlwaysFailure", "Sub", rest=sub) == [
        "Sub#2: AlwaysFailure before it never succeeds"
    ]


def test_what_can_never_be_reached_in_a_sub_tree_is_said_once() -> None:
    sub = "  Sub: {Sequence: [AlwaysFailure, {Log: {message: a}}]}\n"
    found = unreached("ForceSuccess: Sub", "ForceSuccess: Sub", rest=sub)
    assert found == ["Sub/Sequence/Log: AlwaysFailure before it never succeeds"]
