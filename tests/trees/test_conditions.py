"""Postconditions, and how they go with preconditions, halting and SKIPPED: as BehaviorTree.CPP has them."""

from __future__ import annotations

import pytest

from picktree.files.expression_syntax import ExpressionError
from picktree.trees import NodeStatus
from picktree.trees.loading.port_reader import MAX_ASSIGNMENTS, parse_assignments

from .scripted import Run, letters, start

MARKS = (
    '_onSuccess: "log := log + 1", _onFailure: "log := log + 10", '
    '_onHalted: "log := log + 100", _post: "log := log + 1000"'
)


def logged(run: Run) -> object:
    return run.tree.blackboard.save().get("Main/log")


def started(body: str) -> Run:
    run = start(body)
    run.tree.blackboard.write("Main/log", 0, "test")
    return run


@pytest.mark.parametrize(
    ("script", "statuses", "log"),
    [
        ("S", "S", 1001),
        ("F", "F", 1010),
        ("RRS", "RRS", 1001),
        ("RF", "RF", 1010),
        ("K", "K", 0),
        ("RK", "RK", 0),
    ],
)
def test_what_is_assigned_fits_the_end(script: str, statuses: str, log: int) -> None:
    run = started(f"Main: {{Answer: {{script: {script}, {MARKS}}}}}")
    for status in statuses[:-1]:
        assert letters([run.tick()]) == status
        assert logged(run) == 0
    assert letters([run.tick()]) == statuses[-1]
    assert logged(run) == log


@pytest.mark.parametrize(
    ("precondition", "status", "log"),
    [("_failureIf: true", "F", 1010), ("_successIf: true", "S", 1001),
     ("_skipIf: true", "K", 0), ("_while: false", "K", 0)],
)  # fmt: skip
def test_an_end_by_a_precondition_is_an_end(precondition: str, status: str, log: int) -> None:
    run = started(f"Main: {{Answer: {{script: R, {precondition}, {MARKS}}}}}")
    assert letters([run.tick()]) == status
    assert run.trace == []
    assert logged(run) == log


def test_a_halted_node_assigns_what_belongs_to_halting_and_nothing_else() -> None:
    run = started(
        f"Main: {{Parallel: [{{Answer: {{name: A, script: RR, {MARKS}}}}}, {{Answer: {{script: RF}}}}]}}"
    )
    assert run.tick() is NodeStatus.RUNNING
    assert logged(run) == 0
    assert run.tick() is NodeStatus.FAILURE
    assert run.trace == ["A:R", "Answer:R", "A:R", "Answer:F", "halt A"]
    assert logged(run) == 100


def test_a_node_that_ended_assigns_nothing_when_it_is_halted() -> None:
    run = started(f"Main: {{Sequence: [{{Answer: {{script: S, {MARKS}}}}}, {{Answer: {{script: R}}}}]}}")
    run.tick()
    run.tree.halt()
    assert logged(run) == 1001


def test_while_that_no_longer_holds_halts_and_skips() -> None:
    run = started(f"Main: {{Answer: {{name: A, script: RRR, _while: log < 1 and go, {MARKS}}}}}")
    run.world.known["go"] = True
    assert run.tick() is NodeStatus.RUNNING
    run.world.known["go"] = False
    assert run.tick() is NodeStatus.SKIPPED
    assert run.trace == ["A:R", "halt A"]
    assert logged(run) == 100


def test_what_is_below_is_halted_before_the_node_assigns() -> None:
    run = start(
        """
        Main:
          Sequence:
            - {SetBlackboard: {value: "", output_key: "{order}"}}
            - Timeout:
                msec: 50
                _onFailure: "order := [order, 'outer']"
                do: {Answer: {script: R, _onHalted: "order := 'inner'"}}
        """
    )
    assert letters(run.to_end()) == "RF"
    assert run.tree.blackboard.read("Main/order") == ["inner", "outer"]


def test_assignments_see_what_those_before_them_wrote_and_the_outputs_of_the_node() -> None:
    run = start(
        """
        Main:
          Find:
            ids: [a, b]
            found: "{ids}"
            _onSuccess: "n := len(ids); twice := n * 2; text := 'n; = 2'; n = n + twice"
        """
    )
    run.to_end()
    assert run.tree.blackboard.save() == {
        "Main/ids": ["a", "b"], "Main/n": 6, "Main/twice": 4, "Main/text": "n; = 2",
    }  # fmt: skip
    assert [(w.key, w.node) for w in run.report.writes][-1] == ("Main/n", "Main/Find")


def test_the_order_of_the_ends_is_btcpp_s() -> None:
    run = start('Main: {AlwaysSuccess: {_post: "b := a", _onSuccess: "a := 1"}}')
    run.tick()
    assert run.tree.blackboard.save() == {"Main/a": 1, "Main/b": 1}


def test_each_activation_assigns_anew() -> None:
    run = started(
        'Main: {RetryUntilSuccessful: {num_attempts: 5, do: {AlwaysFailure: {_onFailure: "log = log + 1"}}}}'
    )
    assert letters(run.to_end()) == "RRRRF"
    assert logged(run) == 5


def test_a_sub_tree_assigns_in_its_caller() -> None:
    run = start(
        """
        Main: {Sub: {_onSuccess: "done := true", _skipIf: "false"}}
        Sub: {SetBlackboard: {value: 1, output_key: "{own}", _onSuccess: "own = own + 1"}}
        """
    )
    run.tick()
    assert run.tree.blackboard.save() == {"Main/Sub/own": 2, "Main/done": True}


def test_a_postcondition_without_a_value_fails_a_success() -> None:
    run = start('Main: {AlwaysSuccess: {_onSuccess: "a := nothing + 1"}}')
    assert run.tick() is NodeStatus.FAILURE
    failure = run.failure
    assert (failure.cause.name, failure.message, failure.node) == (
        "tree.missing_input",
        "_onSuccess: the expression 'nothing + 1': unknown name 'nothing'; known: time",
        "Main/AlwaysSuccess",
    )


def test_a_postcondition_without_a_value_does_not_hide_a_failure() -> None:
    run = start('Main: {Scripted: {script: grasp.missed, _onFailure: "a := b", _post: "c := 1"}}')
    assert letters(run.to_end()) == "F"
    failure = run.failure
    assert (failure.cause.name, failure.message) == ("grasp.missed", "Scripted was told to")
    (attached,) = failure.attached
    assert attached.message == "_onFailure: the expression 'b': unknown name 'b'; known: time"
    assert run.tree.blackboard.read("Main/c") == 1


def test_a_no_with_a_wrong_postcondition_says_what_is_wrong() -> None:
    run = start('Main: {Condition: {if: "false", _post: "a := 1 / 0"}}')
    assert run.tick() is NodeStatus.FAILURE
    failure = run.failure
    assert failure.message == "_post: the expression '1 / 0': division by zero"


def test_a_wrong_postcondition_of_a_halted_node_is_noted_and_halts_the_others() -> None:
    child = '{Answer: {name: A, script: R, _onHalted: "a := b"}}'
    run = start(f"Main: {{Parallel: [{child}, {{Answer: {{name: B, script: R}}}}]}}")
    run.tick()
    run.tree.halt()
    assert run.trace == ["A:R", "B:R", "halt A", "halt B"]
    (note,) = run.notes("postcondition_failed")
    assert (note.node, note.message, note.data) == (
        "Main/Parallel/A",
        "_onHalted: the expression 'b': unknown name 'b'; known: time",
        {"cause": "tree.missing_input"},
    )


def test_a_key_that_is_not_there_is_made_by_colon_equals_only() -> None:
    run = start('Main: {AlwaysSuccess: {_onSuccess: "a = 1"}}')
    assert run.tick() is NodeStatus.FAILURE
    assert run.failure.message == "_onSuccess: nothing has written 'a' yet; ':=' writes it anew"
    assert run.tree.blackboard.save() == {}


def test_the_linter_and_the_record_see_them() -> None:
    run = start('Main: {AlwaysSuccess: {_post: "a := 1; b := a", breakpoint: after}}')
    wiring = run.tree.find("Main/AlwaysSuccess").wiring
    assert [(a.key, str(a.value), a.new, a.at) for a in wiring.postconditions["_post"]] == [
        ("a", "1", True, 5), ("b", "a", True, 13),
    ]  # fmt: skip
    assert wiring.breakpoint == "after"


@pytest.mark.parametrize(
    ("text", "message", "offset"),
    [
        ("", "there is no assignment; as 'key := expression'", 0),
        (" ; ", "there is no assignment; as 'key := expression'", 0),
        ("done", "an assignment is 'key := expression'", 0),
        ("a := 1; b == 2", "an assignment is 'key := expression'", 8),
        ("{a} := 1", "an assignment is 'key := expression'", 0),
        ("item.colour := 'red'", "an assignment is 'key := expression'", 0),
        ("a := 1; n +=", "a value is missing after '+='", 10),
        ("a := 1; n %= 2", "an assignment is 'key := expression'", 8),
        ("a := 1; n :=", "a value is missing after ':='", 10),
        ("a := 1; n := 2 +", "not an expression: a value is missing after '+'", 15),
        ("a := 'x; b := 2", "not an expression: the text is not closed by another '", 5),
        ("a := b := 2",
         "not an expression: an assignment is allowed only in a postcondition; compare with '=='", 7),
        ("a := 1;" * (MAX_ASSIGNMENTS + 1), "more than 20 assignments", 140),
        ("a := 1;" * 1000, "the assignments are longer than 4000 characters", 0),
    ],
)  # fmt: skip
def test_assignments_that_are_none(text: str, message: str, offset: int) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_assignments(text)
    assert (str(caught.value), caught.value.offset) == (message, offset)
