"""AskForHelp: what a person is asked, and what comes of the answer; the mission is rehearsed with both."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.authoring import check_mission
from picktree.authoring.rehearsal import rehearse_files
from picktree.files.yaml import read_document
from picktree.robot.operator_desk import OperatorQuestion, OperatorRequests

MISSION = """\
picktree: 1
kind: mission
name: asking
scene: sort_small
trees:
  Main:
    Sequence:
      - AskForHelp: {reason: may it go on?, answer: "{answer}"}
      - Switch:
          variable: "{answer}"
          cases:
            set aside: AlwaysFailure
          default: {GoTo: {pose: home}}
"""
CASES = """\
picktree: 1
kind: cases
mission: asking.yaml
cases:
  go_on:
    leaves: {AskForHelp: {outputs: {answer: go on}}}
    expect: {status: SUCCESS, order: [AskForHelp, GoTo]}
  set_aside:
    leaves: {AskForHelp: {outputs: {answer: set aside}}}
    expect: {status: FAILURE, order: [AskForHelp]}
  given_up:
    leaves: {AskForHelp: tree.given_up}
    expect: {status: FAILURE, cause: tree.given_up, order: [AskForHelp]}
"""


def test_a_rehearsal_answers_as_its_cases_say(tmp_path: Path) -> None:
    (tmp_path / "asking.yaml").write_text(MISSION)
    (tmp_path / "cases.yaml").write_text(CASES)
    rehearsal = rehearse_files(tmp_path / "asking.yaml", tmp_path / "cases.yaml")
    assert [(case.name, case.passed) for case in rehearsal.cases] == [
        ("go_on", True),
        ("set_aside", True),
        ("given_up", True),
    ]


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ("[]", "a person needs at least one answer to choose, and none is empty"),
        ("[go on, '']", "a person needs at least one answer to choose, and none is empty"),
        ("[go on, Go  on]", "'go on' is there twice"),
    ],
)
def test_choices_that_are_none(choices: str, said: str) -> None:
    text = MISSION.replace("answer: ", f"choices: {choices}, answer: ", 1)
    check = check_mission(read_document(Path("asking.yaml"), "mission", text))
    errors = [fault.message for fault in check.faults if fault.severity == "error"]
    assert any(said in error for error in errors), errors


@pytest.mark.parametrize(
    ("said", "choice"),
    [
        ("go on", "go on"),
        ("  GO   ON ", "go on"),
        ("3", "give up"),
        ("s", "set aside"),
        ("g", None),
        ("4", None),
        ("", None),
    ],
)
def test_what_a_person_types(said: str, choice: str | None) -> None:
    assert OperatorQuestion("Main/Ask", "why", ("go on", "set aside", "give up")).choice(said) == choice


def test_an_answer_is_taken_once_by_who_asked() -> None:
    desk, question = OperatorRequests(), OperatorQuestion("Main/Ask", "why", ("yes", "no"))
    desk.ask(question)
    assert (desk.pending, desk.waits("Main/Ask"), desk.waits("Main/Other")) == (question, True, False)
    with pytest.raises(ValueError, match="nobody waits for the answer 'perhaps'"):
        desk.answer("perhaps")
    desk.answer("yes")
    assert (desk.pending, desk.answered) == (None, True)
    assert desk.take("Main/Other") is None
    assert (desk.take("Main/Ask"), desk.take("Main/Ask"), desk.answered) == ("yes", None, False)


def test_a_question_that_is_withdrawn_needs_no_answer() -> None:
    desk = OperatorRequests()
    desk.ask(OperatorQuestion("Main/Ask", "why", ("yes",)))
    desk.withdraw("Main/Other")
    assert desk.pending is not None
    desk.withdraw("Main/Ask")
    assert desk.pending is None
