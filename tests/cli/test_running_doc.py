"""The page on running: its conversation is what the debugger says, its tables are what there is."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from picktree.apps.cli import answer
from picktree.apps.cli.app import app
from picktree.apps.cli.debug_prompt import DebugPrompt

ROOT = Path(__file__).parents[2]
PROMPT = DebugPrompt.text
PAGE = (ROOT / "docs" / "running.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    found = re.search(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


def test_its_conversation_is_what_the_debugger_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "pick.yaml").write_text(block("yaml"))
    shown = block("text")
    typed = [line.removeprefix(PROMPT) for line in shown.splitlines() if line.startswith(PROMPT)]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(typed) + "\n"))
    line = ["run", str(tmp_path / "pick.yaml"), "--backend", "kinematic", "--out", str(tmp_path), "--debug"]
    assert answer(line) == 0
    assert shown in capsys.readouterr().out


def test_its_tables_name_all_options_and_commands() -> None:
    running, debugging = PAGE.split("## Debug")
    told = re.findall(r"^\| (`--[^|]+) \|", running, re.MULTILINE)
    options = {option for cell in told for option in re.findall(r"`(--[\w-]+)", cell)}
    commands = [word.split()[0] for word in re.findall(r"^\| `([^`]+)` \|", debugging, re.MULTILINE)]
    shown = CliRunner().invoke(app, ["run", "--help"], prog_name="picktree").output
    assert {*options, "--help"} == set(re.findall(r"^  (--[\w-]+)", shown, re.MULTILINE))
    prompt = DebugPrompt(lambda _: "", io.StringIO())
    assert commands == [name.strip() for name in prompt.completions("")]


def test_its_python_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    exec(compile(block("python"), "running.md", "exec"), {})
    assert len([each for each in (tmp_path / "runs").iterdir() if each.is_dir()]) == 2
