"""`picktree check` and `explain-code` as they are called: formats, exit codes, stdin, folders."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from picktree.apps.cli import answer
from picktree.world.scene import load_scene

SCENE = "picktree: 1\nkind: scene\nrobot: panda\n"
WRONG = SCENE + "goal: sorted = total\n"
IDLE = SCENE + "goal: left == 0  # picktree: allow P131\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def check(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    code = answer(["check", *words])
    out, err = capsys.readouterr()
    assert err == ""
    return code, out


def test_a_right_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "a.yaml").write_text(SCENE)
    assert check(capsys, "a.yaml") == (0, "1 file, no errors or warnings\n")
    assert check(capsys, "a.yaml", "./a.yaml", str(folder / "a.yaml")) == (
        0,
        "1 file, no errors or warnings\n",
    )


def test_files_come_in_the_order_in_which_they_are_given(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "a.yaml").write_text(WRONG)
    (folder / "b.yaml").write_text(WRONG)
    code, out = check(capsys, "b.yaml", "nothing.yaml", "a.yaml")
    assert code == 2
    assert out == (
        "b.yaml:4:14: error P419: goal: not an expression: compare with '=='\n"
        "    4 | goal: sorted = total\n"
        "      |              ^\n"
        "nothing.yaml:1:1: error P124: there is no such file\n"
        "a.yaml:4:14: error P419: goal: not an expression: compare with '=='\n"
        "    4 | goal: sorted = total\n"
        "      |              ^\n"
        "3 errors in 3 files; `picktree explain-code P419` explains the first\n"
    )


def test_a_file_that_another_names_comes_behind_it_or_at_its_own_place(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "base.yaml").write_text(WRONG)
    (folder / "a.yaml").write_text("picktree: 1\nkind: scene\nbase: base.yaml\nlimits: {forse: 3}\n")
    own = "a.yaml:4:10: error P104: limits.forse: unknown key 'forse' (did you mean 'force'?)"
    other = "base.yaml:4:14: error P419: goal: not an expression: compare with '=='"

    def heads(*words: str) -> list[str]:
        return [line for line in check(capsys, *words)[1].splitlines() if " error " in line]

    assert heads("a.yaml") == [own, other]
    assert heads("base.yaml", "a.yaml") == [other, own]
    (folder / "c.yaml").write_text(WRONG)
    third = other.replace("base", "c")
    assert heads("a.yaml", "c.yaml") == [own, other, third]
    assert heads("a.yaml", "c.yaml", "base.yaml") == [own, third, other]


def test_warnings_fail_only_when_strict(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "a.yaml").write_text(IDLE)
    assert check(capsys, "a.yaml") == (
        0,
        "a.yaml:4:18: warning P130: there is no warning P131 on this line (leave the comment out)\n"
        "    4 | goal: left == 0  # picktree: allow P131\n"
        "      |                  ^\n"
        "1 warning in 1 file; `picktree explain-code P130` explains it\n",
    )
    assert check(capsys, "--strict", "a.yaml")[0] == 1


def test_json_is_one_object(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "a.yaml").write_text(WRONG)
    (folder / "b.yaml").write_text(IDLE)
    code, out = check(capsys, "a.yaml", "b.yaml", "--format", "json")
    assert code == 2
    report = json.loads(out)
    faults = report.pop("faults")
    assert report == {"files": ["a.yaml", "b.yaml"], "left_out": [], "errors": 1, "warnings": 1}
    assert {" ".join(fault) for fault in faults} == {
        "file line column severity code title where message hint detail"
    }
    assert [list(fault.values()) for fault in faults] == [
        ["a.yaml", 4, 14, "error", "P419", "A goal that cannot be read", "goal",
         "not an expression: compare with '=='", "", ""],
        ["b.yaml", 4, 18, "warning", "P130", "A comment that allows nothing", "",
         "there is no warning P131 on this line", "leave the comment out", ""],
    ]  # fmt: skip


def test_annotations_of_github_are_escaped(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = "50%, a:b.yaml"
    (folder / name).write_text(SCENE + '"5%\\n": 1\n')
    assert check(capsys, name, "--format", "github") == (
        2,
        "::error file=50%25%2C a%3Ab.yaml,line=4,col=1,title=P104 Unknown key"
        "::5%25\\n: unknown key '5%25\\n' (known: base, robot, limits, thinking, planner, sensors, "
        "checkpoint_every, goal, exchange, tool_error, assortment, calibration, fixtures, unknown, cameras, "
        "catalogue, spawn, feed, destinations)\n"
        "1 error in 1 file; `picktree explain-code P104` explains it\n",
    )


def stdin(monkeypatch: pytest.MonkeyPatch, raw: bytes) -> None:
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(raw)))


def test_what_an_editor_has_not_saved_yet_is_checked_in_its_place(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "scenes").mkdir()
    (folder / "scenes" / "base.yaml").write_text(SCENE)
    (folder / "scenes" / "mine.yaml").write_text("as it was saved\n")
    stdin(monkeypatch, b"picktree: 1\nkind: scene\nbase: base.yaml\nlimits: {forse: 1}\n")
    assert check(capsys, "-", "--stdin-filename", "scenes/mine.yaml") == (
        2,
        "scenes/mine.yaml:4:10: error P104: limits.forse: unknown key 'forse' (did you mean 'force'?)\n"
        "    4 | limits: {forse: 1}\n"
        "      |          ^\n"
        "1 error in 1 file; `picktree explain-code P104` explains it\n",
    )


def test_stdin_without_a_name(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    stdin(monkeypatch, b"kind: scene\nrobot: panda\n")
    code, out = check(capsys, "-")
    assert code == 2
    assert out.startswith("<stdin>:1:1: error P102: 'picktree: 1' is missing (every file begins with it)\n")


def test_a_folder_stands_for_all_its_files_that_are_ours(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("b/c.yml", "b/a.yaml", "z.yaml", ".hidden/x.yaml", "b/.y.yaml"):
        (folder / "all" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "all" / name).write_text(WRONG)
    (folder / "all" / "compose.yaml").write_text("services: {}\nkind: Deployment\n")
    (folder / "all" / "headless.yaml").write_text("kind: scene\nrobot: panda\n")
    (folder / "all" / "notes.txt").write_text(WRONG)
    os.mkfifo(folder / "all" / "pipe.yaml")
    code, out = check(capsys, "all", "--format", "json")
    report = json.loads(out)
    assert code == 2
    assert report["files"] == ["all/headless.yaml", "all/z.yaml", "all/b/a.yaml", "all/b/c.yml"]
    assert report["left_out"] == ["all/compose.yaml"]
    assert [fault["code"] for fault in report["faults"]] == ["P102", "P419", "P419", "P419"]
    summary = check(capsys, "all")[1].splitlines()[-1]
    assert summary == (
        "4 errors in 4 files; 1 YAML file without 'picktree:' left out; "
        "`picktree explain-code P102` explains the first"
    )


def test_a_folder_without_files_is_a_fault(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "empty").mkdir()
    assert check(capsys, "empty") == (
        2,
        "empty:1:1: error P124: there is no file of picktree's in this folder "
        "(a file begins with 'picktree: 1')\n"
        "1 error in 0 files; `picktree explain-code P124` explains it\n",
    )


def test_a_terminal_is_given_colours(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "a.yaml").write_text(WRONG)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    coloured = check(capsys, "a.yaml")[1]
    assert coloured.startswith("\x1b[1ma.yaml:4:14:\x1b[0m \x1b[31m\x1b[1merror P419:\x1b[0m goal: ")
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in check(capsys, "a.yaml")[1]


def test_names_do_not_command_the_terminal(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "a.yaml").write_text(SCENE + '"\\e[31mred\\nline": 1\n' + f"{'k' * 900}: 1\n")
    code, out = check(capsys, "a.yaml")
    assert code == 2
    assert r"a.yaml:4:1: error P104: \x1b[31mred\nline: unknown key '\x1b[31mred\nline'" in out
    assert "\x1b" not in out
    assert max(map(len, out.splitlines())) < 700


@pytest.mark.parametrize(
    ("line", "shown", "caret"),
    [
        ("goal: left = 0", "goal: left = 0", 11),
        ("goal: 'é' = 0", "goal: 'é' = 0", 10),
        ("goal: '日本' = 0", "goal: '日本' = 0", 13),
        ("goal:\tleft = 0", "goal: left = 0", 11),
    ],
)
def test_the_caret_stands_under_the_fault(
    line: str, shown: str, caret: int, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "a.yaml").write_text(SCENE + line + "\n")
    assert check(capsys, "a.yaml")[1].splitlines()[1:3] == [f"    4 | {shown}", f"      | {' ' * caret}^"]


def test_of_a_long_line_the_part_at_the_fault_is_shown(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "a.yaml").write_text(SCENE + f"goal: {'left + ' * 60}= 0\n")
    _, line, caret, _ = check(capsys, "a.yaml")[1].splitlines()
    assert line[:9] == "    4 | …"
    assert len(line) < 132
    assert line[len(caret) - 1] == "="


def test_a_run_shows_the_faults_of_its_files_in_the_same_way(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "a.yaml").write_text(WRONG)

    class Session:
        def __init__(self, request: dict[str, Any], *watchers: object, **others: object) -> None:
            load_scene(request["scene"])

    monkeypatch.setattr("picktree.session.Session", Session)
    monkeypatch.setattr("picktree.session.RunRequest", dict)
    assert answer(["run", "m.yaml", "--scene", "a.yaml"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == (
        "a.yaml:4:14: error P419: goal: not an expression: compare with '=='\n"
        "    4 | goal: sorted = total\n"
        "      |              ^\n"
    )


# Bad arguments.


def test_nothing_to_check(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["check"]) == 2
    assert "Missing argument 'FILE…'" in capsys.readouterr().err


# explain-code.


def explain(capsys: pytest.CaptureFixture[str], *words: str) -> Any:
    code = answer(["explain-code", *words])
    out, err = capsys.readouterr()
    return code, out, err


def test_a_page_is_printed_as_it_is_written(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = explain(capsys, "P104")
    assert (code, err) == (0, "")
    assert out.startswith("# P104 Unknown key\n\nThis key has no meaning here")
    assert out.endswith("limits: {force: 50 N}\n```\n")


def test_all_codes_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = explain(capsys)
    assert (code, err) == (0, "")
    assert out.splitlines()[:2] == ["P101  Not valid YAML", "P102  No format, or an unknown one"]
