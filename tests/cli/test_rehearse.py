"""picktree rehearse: what it prints, and its exit codes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from picktree.apps.cli import answer
from picktree.world.robot_model.robot_file import SHIPPED

from ..commands import call

MISSION = """\
picktree: 1
kind: mission
name: to and fro
trees:
  Main:
    Recover:
      attempts: 2
      do: [GoTo, {GoTo: {name: back}}]
      when: {planning.*: [SafeRetreat], control.*: [SafeRetreat]}
"""
CASES = """\
picktree: 1
kind: cases
cases:
  blocked:
    doc: The way back is blocked for a while.
    leaves: {back: [{cause: planning.no_path, ticks: 2}, SUCCESS]}
    expect: {status: SUCCESS, handled: [planning.no_path]}
  for_ever:
    leaves: {back: planning.no_path}
    expect: {status: SUCCESS, order: [GoTo, back, SafeRetreat, GoTo, back, SafeRetreat]}
"""


SHOWN = """\
blocked: The way back is blocked for a while.
    1  GoTo                    SUCCESS
  1–3  back                    FAILURE planning.no_path: No path free of collision was found
    3  Recover                 takes up planning.no_path with 'planning.*'
    4  planning.*/SafeRetreat  SUCCESS
    5  GoTo                    SUCCESS
    5  back                    SUCCESS
passed  blocked: SUCCESS after 5 ticks, 0.25 s

for_ever
  1  GoTo                    SUCCESS
  1  back                    FAILURE planning.no_path: No path free of collision was found
  1  Recover                 takes up planning.no_path with 'planning.*'
  2  planning.*/SafeRetreat  SUCCESS
  3  GoTo                    SUCCESS
  3  back                    FAILURE planning.no_path: No path free of collision was found
FAILED  for_ever: FAILURE planning.no_path after 3 ticks, 0.15 s
    c.yaml:10:22: expect.status: SUCCESS is expected, but the mission is FAILURE: \
planning.no_path at Main/Recover/Sequence/back: No path free of collision was found (tick 3)
    c.yaml:10:76: expect.order[5]: SafeRetreat is expected, but no further leaf starts

coverage  75 %: 6 of 8 reached; what no case reaches:
    m.yaml:9:52: Main/Recover/control.*: 'when control.*' is never used, nor 1 below
recovery  50 %: 1 of 2 branches of recovery reached
causes    1 of N that leaves declare are raised by some case
to and fro: 1 of 2 cases passed
"""


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.yaml").write_text(MISSION)
    (tmp_path / "c.yaml").write_text(CASES)
    return tmp_path


def declared(out: str) -> str:
    """How many causes the skills declare is not the matter here."""
    return re.sub(r"of \d+ that", "of N that", out)


@pytest.mark.usefixtures("files")
def test_traces_verdicts_and_what_is_not_reached(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["rehearse", "m.yaml", "--cases", "c.yaml"]) == 1
    assert declared(capsys.readouterr().out) == SHOWN


@pytest.mark.usefixtures("files")
def test_one_case_without_its_trace(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["rehearse", "m.yaml", "--cases", "c.yaml", "--case", "blocked", "-q"]) == 0
    assert (
        capsys.readouterr().out
        == """\
passed  blocked: SUCCESS after 5 ticks, 0.25 s
to and fro: 1 of 1 case passed
"""
    )


@pytest.mark.usefixtures("files")
def test_another_robot_must_have_the_poses(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    panda = (SHIPPED / "panda.yaml").read_text(encoding="utf-8")
    (files / "lean.yaml").write_text(re.sub(r"  (observe|rest): .*\n", "", panda), encoding="utf-8")
    (files / "m.yaml").write_text(
        MISSION.replace("trees:", "scene: sort_small\ntrees:").replace("[GoTo,", "[{GoTo: {pose: observe}},")
    )
    order = ["rehearse", "m.yaml", "--cases", "c.yaml", "--case", "blocked", "-q", "--robot"]
    assert answer([*order, "iiwa"]) == 0
    assert answer([*order, "lean.yaml"]) == 2
    assert capsys.readouterr().err.startswith(
        "m.yaml:9:26: error P240: Main/Recover/Sequence/GoTo: port 'pose': the robot 'lean' has no pose "
        "'observe' (known: home)\n"
    )


def test_full_coverage_is_an_answer_too(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (files / "cases").mkdir()
    mended = CASES.partition("  for_ever")[0]
    (files / "cases" / "m.yaml").write_text(mended)
    assert answer(["rehearse", "m.yaml", "-q"]) == 0
    assert answer(["rehearse", "m.yaml", "-q", "--full-coverage"]) == 1
    assert "coverage  75 %" in capsys.readouterr().out
    more = "  held_up: {leaves: {GoTo: [control.timeout, SUCCESS]}, expect: {status: SUCCESS}}\n"
    (files / "cases" / "m.yaml").write_text(mended + more)
    assert answer(["rehearse", "m.yaml", "-q", "--full-coverage", "--causes"]) == 0
    out = declared(capsys.readouterr().out)
    assert "coverage  100 %: 8 of 8 reached\nrecovery  100 %: 2 of 2 branches of recovery reached\n" in out
    assert "causes    2 of N that leaves declare" in out
    assert "    m.yaml:8:12: Main/Recover/Sequence/GoTo: never fails with planning.no_ik\n" in out
    assert "Main/Recover/Sequence/back: never fails with planning.no_path" not in out


@pytest.mark.usefixtures("files")
def test_json_is_one_object_on_stdout() -> None:
    ran = call(["rehearse", "m.yaml", "--cases", "c.yaml", "--json"])
    assert (ran.returncode, ran.stderr) == (1, "")
    result = json.loads(ran.stdout)
    assert (result["mission"], result["file"], result["passed"], result["complete"]) == (
        "to and fro", "c.yaml", False, True,
    )  # fmt: skip
    blocked, for_ever = result["cases"]
    assert (blocked["passed"], for_ever["passed"]) == (True, False)
    assert (blocked["handled"][0]["tick"], blocked["handled"][0]["handler"]) == (3, "planning.*")
    assert (blocked["leaves"][1]["tick"], blocked["leaves"][1]["last"]) == (1, 3)
    assert for_ever["differences"][1] == {
        "place": {"file": "c.yaml", "line": 10, "column": 76}, "where": "expect.order[5]",
        "message": "SafeRetreat is expected, but no further leaf starts", "tick": None,
    }  # fmt: skip
    assert {"percent": 75, "reached": 6, "total": 8}.items() <= result["coverage"].items()
    assert result["coverage"]["missed"][0]["node"] == "Main/Recover/control.*"


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("m.yaml", "there are no cases cases/m.yaml; name the file with --cases"),
        ("none.yaml", "none.yaml:1:1: error P124: there is no such file"),
        ("m.yaml --cases none.yaml", "none.yaml:1:1: error P124: there is no such file"),
        (
            "m.yaml --cases m.yaml",
            "m.yaml:2:7: error P103: kind: this is a mission file; a cases file is wanted here",
        ),
        ("m.yaml --cases c.yaml --case blokked", "c.yaml has no case 'blokked'; did you mean 'blocked'?"),
    ],
)
@pytest.mark.usefixtures("files")
def test_bad_input(line: str, says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["rehearse", *line.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert says in err


def test_all_faults_of_the_cases_come_at_once(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (files / "c.yaml").write_text(CASES.replace("back:", "bak:").replace("GoTo", "Go"))
    assert answer(["rehearse", "m.yaml", "--cases", "c.yaml"]) == 2
    err = capsys.readouterr().err
    assert err.count("P703") == 4
    assert "c.yaml:6:14" in err and "c.yaml:10:39" in err


def test_what_may_be_meant_otherwise_is_told_unless_it_is_allowed(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = "cases:\n  it:\n    leaves: {GoTo: {then: {hand: ball}}}\n    expect: {ticks: 9}\n"
    (files / "c.yaml").write_text("picktree: 1\nkind: cases\n" + case)
    assert answer(["rehearse", "m.yaml", "--cases", "c.yaml", "-q"]) == 1
    out, err = capsys.readouterr()
    assert "this cannot be: Main/Recover/Sequence/GoTo: the hand is to hold 'ball'" in out
    assert err.startswith("c.yaml:5:34: warning P717: cases.it.leaves.GoTo.then.hand: no object 'ball'")
    allowed = case.replace("ball}}}", "ball}}}   # picktree: allow P717")
    (files / "c.yaml").write_text("picktree: 1\nkind: cases\n" + allowed)
    assert answer(["rehearse", "m.yaml", "--cases", "c.yaml", "-q"]) == 1
    assert capsys.readouterr().err == ""
