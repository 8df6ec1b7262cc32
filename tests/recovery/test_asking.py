"""AskForHelp in a cell: the arm stands, the question is put once, the answer goes on or gives up."""

from __future__ import annotations

import pytest

from ..skills.cell import Cell, items, mission

ASK = 'AskForHelp: {reason: "the {what} slips", object: red_block_1, answer: "{answer}"%s}'
TREE = "Sequence: [{SetBlackboard: {value: %s, output_key: '{what}'}}, {%s}]"


def asking(ports: str = "", what: str = "can") -> Cell:
    return Cell(mission(TREE % (what, ASK % ports)), items(block=1))


def test_it_asks_once_and_goes_on_with_the_answer() -> None:
    cell = asking()
    desk = cell.world.operator
    for _ in range(6):
        cell.tick()
        assert cell.running
    (wanted,) = (e for e in cell.events if e.kind == "help_wanted")
    assert wanted.message == "help is wanted: the can slips"
    assert wanted.data["choices"] == ["go on", "set aside", "give up"]
    assert (wanted.data["object"], wanted.data["reason"]) == ("red_block_1", "the can slips")
    assert desk.pending is not None
    assert desk.pending.reason == "the can slips"
    desk.answer("set aside")
    assert cell.finish().value == "SUCCESS"
    assert cell.tree.blackboard.save()["Main/answer"] == "set aside"
    assert len(cell.happened("help_wanted")) == 1
    assert desk.pending is None


@pytest.mark.parametrize(
    ("ports", "answer", "told"),
    [
        ("", "give up", "tree.given_up: help was asked for, and given up: the can slips"),
        ("", "go on", ""),
        (
            ", choices: [yes, no], give_up: no",
            "no",
            "tree.given_up: help was asked for, and given up: the can slips",
        ),
        (", choices: [yes, no], give_up: no", "yes", ""),
    ],
)
def test_one_of_the_answers_gives_up(ports: str, answer: str, told: str) -> None:
    cell = asking(ports)
    while cell.world.operator.pending is None:
        cell.tick()
        assert cell.running
    cell.world.operator.answer(answer)
    cell.finish()
    failure = cell.tree.failure
    assert (f"{failure.cause}: {failure.message}" if failure else "") == told
    if failure:
        assert failure.evidence == {"object": "red_block_1"}


def test_a_moving_arm_is_braked_before_anybody_is_asked() -> None:
    cell = Cell(mission("GoTo: {pose: rest}"), items(block=1))
    for _ in range(12):
        cell.tick()
    assert cell.speed > 0.1
    cell.halt()
    cell.start(mission(TREE % ("can", ASK % "")))
    while cell.world.operator.pending is None:
        cell.tick()
        assert cell.running
    assert cell.speed < 0.02


def test_a_reason_without_its_value_is_a_failure_and_nobody_is_asked() -> None:
    cell = Cell(mission(ASK % ""), items(block=1))
    cell.finish()
    failure = cell.failure
    assert f"{failure.cause}: {failure.message}" == (
        "tree.missing_input: in 'reason' of AskForHelp: nothing has written {what} yet"
    )
    assert failure.evidence == {"port": "reason", "reference": "{what}"}
    assert cell.world.operator.pending is None


def test_who_is_halted_withdraws_the_question() -> None:
    cell = asking()
    while cell.world.operator.pending is None:
        cell.tick()
    cell.halt()
    assert cell.world.operator.pending is None
    for _ in range(3):
        cell.tick()
    assert len(cell.happened("help_wanted")) == 2


def test_who_is_halted_while_the_arm_brakes_gives_it_back() -> None:
    cell = Cell(mission("GoTo: {pose: rest}"), items(block=1))
    while cell.speed < 0.1:
        cell.tick()
    cell.halt()
    cell.start(mission(TREE % ("can", ASK % "")))
    cell.tick()
    assert cell.world.operator.pending is None
    cell.halt()
    cell.start(mission("GoTo: {pose: home}"))
    assert cell.finish().value == "SUCCESS"


def test_it_can_be_saved_once_it_has_asked_and_asks_again_when_it_is_started_again() -> None:
    cell = asking()
    asks = cell.tree.find("Main/Sequence/AskForHelp")
    saved = list[bool]()
    for _ in range(2):
        while cell.world.operator.pending is None:
            cell.tick()
            saved.append(asks.saveable)
        cell.world.operator.answer("go on")
        cell.finish()
    assert (saved[0], saved[-1]) == (False, True)
    assert len(cell.happened("help_wanted")) == 2
