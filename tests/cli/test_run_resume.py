"""run --resume: what may be said besides, and a person at the terminal who answers."""

from __future__ import annotations

import io
from contextlib import nullcontext

import pytest

from picktree.apps.cli import answer
from picktree.apps.cli.progress import PersonAtTerminal
from picktree.robot.operator_desk import OperatorQuestion

QUESTION = OperatorQuestion("Main/Ask", "the can slips", ("go on", "give up"), "can_1", "the hand is empty")


@pytest.mark.parametrize(
    ("options", "shown"),
    [
        (["m.yaml"], "MISSION"),
        (["--seed", "3"], "--seed"),
        (["--set", "a=1"], "--set"),
        (["--watch"], "--watch"),
    ],
)
def test_what_the_log_says_is_not_said_again(
    options: list[str], shown: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(["run", *options, "--resume", "runs/a"]) == 2
    assert capsys.readouterr().err == (
        f"--resume and {shown} exclude each other: mission, scene, robot, seed, parameters, faults "
        "and backend are those of the resumed run (`picktree whatif` changes some of them)\n"
    )


def test_a_mission_or_a_log_is_needed(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["run"]) == 2
    assert "Missing argument 'MISSION'." in capsys.readouterr().err
    assert answer(["run", "m.yaml", "--as-it-stands"]) == 2
    said = "--as-it-stands needs a run to resume: give --resume LOG, too\n"
    assert capsys.readouterr().err == said


def test_a_log_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["run", "--resume", "nowhere"]) == 2
    assert capsys.readouterr().err == "nowhere: there is no such log\n"


def test_a_person_is_asked_until_the_answer_is_one() -> None:
    out, lines = io.StringIO(), iter(["", "g", "stop", "2"])
    assert PersonAtTerminal(out, nullcontext, lambda: next(lines)).answer(QUESTION) == "give up"
    assert out.getvalue() == (
        "\nHelp is wanted: the can slips\n  the hand is empty\n  1  go on\n  2  give up\n"
        "(answer) (answer) 'g' is not among the answers: write the number of an answer or its beginning\n"
        "(answer) 'stop' is not among the answers: write the number of an answer or its beginning\n(answer) "
    )


def test_a_person_who_leaves_does_not_answer() -> None:
    def leave() -> str:
        raise EOFError

    assert PersonAtTerminal(io.StringIO(), nullcontext, leave).answer(QUESTION) is None
