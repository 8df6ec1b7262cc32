"""Command lines: exit codes, what goes to stdout and what to stderr, what is imported for it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from picktree.apps.cli import answer
from picktree.apps.cli.output import program
from picktree.apps.cli.run import HELP_GROUPS
from picktree.files import PicktreeError
from picktree.logs import RunResult
from picktree.logs.log_files import Rotation

HEAVY = {
    "coal", "cv2", "fcl", "google", "mcap", "numpy", "ompl", "pinocchio", "py_trees", "pybullet", "pydantic",
    "rich", "scipy", "toppra", "trimesh", "yaml",
}  # fmt: skip


@pytest.mark.parametrize(("option", "said"), [("--help", "Usage: "), ("--version", "picktree 0.1.0\n")])
def test_help_and_version_import_nothing_heavy(option: str, said: str) -> None:
    program = f"""
import sys
from picktree.apps.cli import answer
code = answer([{option!r}])
print(sorted({{name.split(".")[0] for name in sys.modules}}), file=sys.stderr)
sys.exit(code)
"""
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ran.returncode == 0
    assert said in ran.stdout
    imported = set(json.loads(ran.stderr.replace("'", '"')))
    assert "typer" in imported
    assert imported & HEAVY == set()


def test_unknown_command_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["rum"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "No such command 'rum'. Did you mean 'run'?" in err


def test_request_carries_every_option(stage: Any) -> None:
    line = "run m.yaml --scene dense --robot iiwa --seed 5 --set a=1 --set b=x=y --faults f.yaml --out o"
    rotating = ["--rotate-mb", "2", "--rotate-minutes", "1.5", "--limit", "90 min"]
    assert answer([*line.split(), "--verify", "--watch", "--backend", "kinematic", *rotating]) == 0
    assert stage.requests == [
        {
            "mission": Path("m.yaml"),
            "scene": "dense",
            "robot": "iiwa",
            "seed": 5,
            "parameters": {"a": "1", "b": "x=y"},
            "faults": Path("f.yaml"),
            "out": Path("o"),
            "backend": "kinematic",
            "verify": True,
            "watch": True,
            "limit": 5400.0,
            "rotation": Rotation(2_000_000, 90.0),
            "robot_at": "",
            "perception_at": "",
            "speed": 1.0,
            "shadow": False,
            "confirm": False,
        }
    ]


@pytest.mark.parametrize(
    ("status", "code"),
    [
        ("success", 0),
        ("incomplete", 1),
        ("failure", 1),
        ("timeout", 1),
        ("paused", 1),
        ("stopped", 1),
        ("interrupted", 130),
    ],
)
def test_status_becomes_exit_code(
    status: Any,
    code: int,
    stage: Any,
    result: RunResult,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "argv", [".venv/bin/picktree", "run"])
    ended = replace(result, status=status)
    stage.act = lambda: ended
    assert answer(["run", "m.yaml"]) == code
    out, err = capsys.readouterr()
    assert out == ended.to_text(".venv/bin/picktree") + "\n"
    assert err == ""


@pytest.mark.parametrize(
    ("called", "shown"),
    [
        ("{0}/picktree", "picktree"),
        (".venv/bin/picktree", ".venv/bin/picktree"),
        ("/my folder/picktree", "'/my folder/picktree'"),
        ("{0}/picktree/__main__.py", f"{sys.executable} -m picktree"),
    ],
)
def test_shown_commands_call_picktree_as_it_was_called(
    called: str, shown: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "picktree").touch(mode=0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "argv", [called.format(tmp_path)])
    assert program() == shown


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (
            PicktreeError("m.yaml:3:5: Main: unknown node 'Grap'"),
            2,
            r"m\.yaml:3:5: Main: unknown node 'Grap'\n",
        ),
        (
            ZeroDivisionError("a bug"),
            3,
            r"(?s)Traceback \(most recent call last\):\n.*ZeroDivisionError: a bug\n"
            r"This is a fault of picktree, not of your input; please report it with the lines above\.\n",
        ),
        (KeyboardInterrupt(), 130, ".*"),
    ],
)
def test_only_a_fault_of_ours_is_told_with_its_traceback(
    error: BaseException, code: int, said: str, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    def stumble() -> RunResult:
        raise error

    stage.act = stumble
    assert answer(["run", "m.yaml"]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(said, err)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--set", "colour"], "--set colour: write NAME=VALUE, as in --set colour=red\n"),
        (["--set", "=red"], "--set =red: write NAME=VALUE, as in --set colour=red\n"),
        (["--set", "a=1", "--set", "a=2"], "--set a=2: 'a' is set twice\n"),
        (
            ["--limit", "3 parsecs"],
            "--limit 3 parsecs: '3 parsecs': unknown unit 'parsecs' (s, ms, us, min, h)\n",
        ),
        (["--limit", "0 s"], "--limit 0 s: write a time above 0, as in --limit '90 min'\n"),
        (["--pace", "0"], "--pace 0: write a number above 0, as in --pace 1 for real time\n"),
    ],
)
def test_options_without_a_value_are_refused(
    options: list[str], said: str, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(["run", "m.yaml", *options]) == 2
    assert capsys.readouterr().err == said
    assert stage.requests == []


def test_a_run_ends_at_its_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mission = Path(__file__).parents[2] / "examples" / "one_pick.yaml"
    line = ["run", str(mission), "--backend", "kinematic", "--out", str(tmp_path), "--limit", "1500 ms"]
    assert answer(line) == 1
    shown = capsys.readouterr().out
    assert "timeout: the run was ended at its limit of simulated time" in shown
    assert "simulated   1.5 s" in shown


@pytest.mark.parametrize("command", ["run", "resim", "whatif"])
def test_the_help_names_what_set_takes(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer([command, "--help"]) == 0
    assert "--set NAME=VALUE" in " ".join(capsys.readouterr().out.split())


def test_json_is_alone_on_stdout_even_when_a_library_prints(result: RunResult, tmp_path: Path) -> None:
    program = f"""
import os, sys
from types import ModuleType
sys.path.insert(0, {str(Path(__file__).parent)!r})
from conftest import RESULT
from picktree.apps.cli import answer

class Session:
    def __init__(self, request, observers=(), planning_worker=False): pass
    def run(self):
        print("printed in Python")
        os.write(1, b"printed in C\\n")
        return RESULT

module = ModuleType("picktree.session.session")
module.RunRequest, module.Session = dict, Session
sys.modules["picktree.session.session"] = module
sys.exit(answer(["run", "m.yaml", "--json"]))
"""
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout == result.to_json_text()
    assert {"printed in Python", "printed in C"} <= set(ran.stderr.splitlines())


def test_the_help_of_run_has_its_options_in_groups(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["run", "--help"]) == 0
    groups = re.split(r"^(\S.*):$", capsys.readouterr().out, flags=re.MULTILINE)[1:]
    options = {
        heading: re.findall(r"^  (--[\w-]+)", text, re.MULTILINE)
        for heading, text in zip(groups[::2], groups[1::2], strict=True)
    }
    assert list(options) == ["Arguments", *HELP_GROUPS, "Other options"]
    assert options["Other options"] == ["--help"]
    assert options["Resuming a run"] == ["--resume", "--as-it-stands"]
    assert max(len(names) for names in options.values()) <= 7
