"""What handlers ask and take: guards for the cause that is handled, another value for each attempt."""

from __future__ import annotations

import pytest

from picktree.recovery import NODES as RECOVERY
from picktree.trees import NodeStatus
from picktree.world import all_causes, matches

from .scripted_recovery import faults, start

WOULD = [node for node in RECOVERY if node.declaration.id.startswith("Would")]


GUARDED = """\
Recover:
  attempts: 2
  cause: "{cause}"
  do: {Scripted: {name: Do, script: "%s|S"}}
  otherwise:
    IfThenElse:
      - %s
      - Scripted: {name: Yes}
      - Scripted: {name: No}
"""


@pytest.mark.parametrize(
    ("guard", "yes", "no"),
    [
        ("WouldLookingHelp", "grasp.missed", "control.timeout"),
        ("WouldARetreatHelp", "safety.force_limit", "grasp.no_candidate"),
        ("WouldAnotherGraspHelp", "grasp.slipped", "perception.stale"),
        ("WouldAGripperResetHelp", "control.gripper", "perception.stale"),
        ("WouldReplanningHelp", "safety.singularity", "grasp.missed"),
        ("WouldPushingHelp", "grasp.no_candidate", "grasp.missed"),
        ("WouldWaitingHelp", "perception.no_image", "grasp.missed"),
    ],
)
def test_a_guard_answers_for_the_cause_that_is_handled(guard: str, yes: str, no: str) -> None:
    assert guard in [node.declaration.id for node in WOULD]
    for cause, branch in ((yes, "start Yes"), (no, "start No")):
        run = start(GUARDED % (cause, f'{guard}: {{cause: "{{cause}}"}}'))
        assert run.to_end()[-1] is NodeStatus.SUCCESS
        assert branch in run.trace


def test_what_guards_name_are_causes() -> None:
    for node in WOULD:
        for pattern in node.helps:  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType, reportUnknownVariableType]
            found = [cause for cause in all_causes() if matches(str(pattern), cause)]  # pyright: ignore[reportUnknownArgumentType]
            assert found, (node, pattern)


def test_cause_is_takes_families_and_knows_their_names() -> None:
    for cause, branch in (("grasp.slipped", "start Yes"), ("control.timeout", "start No")):
        run = start(GUARDED % (cause, 'CauseIs: {cause: "{cause}", of: ["grasp.*", safety.stop]}'))
        run.to_end()
        assert branch in run.trace
    body = GUARDED % ("S", 'CauseIs: {cause: "{cause}", of: ["grasp.*", grasp.mised]}')
    found = faults(body)
    assert [f.message for f in found] == [
        "port 'of': 'grasp.mised' is neither a cause nor a family of causes"
    ]
    assert [f.hint for f in found] == ["did you mean 'grasp.missed'?"]


def test_for_attempt_takes_the_value_of_the_attempt_and_then_the_last() -> None:
    body = """\
Recover:
  attempts: 4
  attempt: "{attempt}"
  do:
    - ForAttempt: {attempt: "{attempt}", values: [30.0, 20.0], value: "{force}"}
    - Take: {object: a, force: "{force}"}
    - Scripted: {name: Do, script: "grasp.missed|grasp.missed|S"}
  otherwise: AlwaysSuccess
"""
    run = start(body)
    assert run.to_end()[-1] is NodeStatus.SUCCESS
    assert [line for line in run.trace if line.startswith("take")] == [
        "take a  30",
        "take a  20",
        "take a  20",
    ]


def test_for_attempt_without_a_value_is_a_failure() -> None:
    run = start("ForAttempt: {attempt: 1, values: '{values}', value: '{force}'}\n")
    run.tree.blackboard.write("Main/values", [], "test")
    assert run.to_end()[-1] is NodeStatus.FAILURE
    assert run.tree.failure is None  # no fault: there is nothing to report
    run.tree.blackboard.write("Main/values", [30.0], "test")
    assert run.to_end()[-1] is NodeStatus.SUCCESS


def test_values_of_another_type_than_the_port_s_are_found_before_anything_runs() -> None:
    body = """\
Sequence:
  - ForAttempt: {attempt: 1, values: [30 N, 20 N], value: "{force}"}
  - Take: {object: a, force: "{force}"}
"""
    found = faults(body)
    assert len(found) == 1
    assert "port 'force'" in found[0].message
    empty = "ForAttempt: {attempt: 1, values: [], value: '{force}'}\n"
    assert [f.message for f in faults(empty) if f.severity == "error"] == ["port 'values': there is no value"]
