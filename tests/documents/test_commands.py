"""Each command in README.md and docs/ is one: its words pass the parser, its programs and targets exist.

What takes less than two seconds and needs only files that the page shows is run, too.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from picktree.apps.cli.app import _command  # pyright: ignore[reportPrivateUsage]

from ..commands import call
from ..pages import TypedCommand, blocks, pages, prose, typed
from ..rooms import PROJECT, ROOT

SHELL = {"cd", "export", "head", "printf", "pip", "ray", "rerun", "cmake", "cp", "code"}
"""Programs that are not ours. What they do is not tested."""
QUICK = {"check", "nodes", "explain-code", "schema", "render", "convert", "cache"}
"""Commands that take less than two seconds."""
FOLLOWED = {"README.md", "commands.md", "first-mission.md", "cookbook.md"}
"""Pages whose commands all run, each in a test of its own."""
MENTIONED = {"MissingParameter", "BadOptionUsage"}
"""What keeps a command that the prose only names from being complete."""
KINDS = {("run",): "mission", ("rehearse",): "mission", ("batch", "run"): "plan", ("batch", "plan"): "plan"}
"""Kind of file that a command takes as its argument."""
TARGETS = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def parse(words: Sequence[str]) -> None:
    """Parse a command line without running it. Raises what the command would raise."""
    command: Any = _command()
    context: Any = command.make_context("picktree", list(words))
    while hasattr(context.command, "resolve_command"):
        rest = [*context._protected_args, *context.args]
        name, command, rest = context.command.resolve_command(context, rest)
        context = command.make_context(name, rest, parent=context)


def refusal(words: Sequence[str], *, mentioned: bool = False) -> str:
    """Return why a command line is refused; empty when it is not."""
    try:
        parse(words)
    except Exception as error:  # noqa: BLE001 - typer has the classes of its parser to itself
        if type(error).__name__ == "Exit" or (mentioned and type(error).__name__ in MENTIONED):
            return ""
        return f"{type(error).__name__}: {error}"
    return ""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Checkout as the reader of a page sees it, for files of the reader's own."""
    for name in ("examples", "benchmarks"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def wrong_kind(words: Sequence[str]) -> str:
    """Return why the shipped file that a command names is refused by it; empty when it is not."""
    for verb, kind in KINDS.items():
        rest = words[len(verb) :]
        if tuple(words[: len(verb)]) == verb and rest and rest[0].endswith(".yaml"):
            text = Path(rest[0]).read_text(encoding="utf-8")
            if text and f"kind: {kind}\n" not in text:
                return f"{rest[0]} is no {kind}"
    return ""


def provide(words: Sequence[str]) -> None:
    """Make empty files for names that stand for the reader's own."""
    for word in words:
        if re.fullmatch(r"[\w-]+\.(yaml|urdf)|MISSION|FAULTS|PLAN|FILE", word):
            Path(word).touch()


def ours(page: Path) -> list[TypedCommand]:
    return [each for block in blocks(page, "sh", "console") for each in typed(block)]


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_commands_of_a_page_pass_the_parser(page: Path, folder: Path) -> None:
    refused: list[str] = []
    for command in ours(page):
        provide(command.words)
        if command.arguments is not None and (
            reason := refusal(command.arguments) or wrong_kind(command.arguments)
        ):
            refused.append(f"{command.where}: {command.text}: {reason}")
    for text in re.findall(r"`((?:\.venv/bin/)?picktree [^`…]+)`", prose(page)):
        words = shlex.split(text.partition(" < ")[0])[1:]
        provide(words)
        if reason := refusal(words, mentioned=True):
            refused.append(f"{page.name}: `{text}`: {reason}")
    assert refused == []


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_other_programs_of_a_page_exist(page: Path) -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    for command in ours(page):
        program, *words = command.words
        where = f"{command.where}: {command.text}"
        if command.arguments is not None or "=" in program:
            continue
        if program == "make":
            assert {word for word in words if "=" not in word} <= TARGETS, where
        elif program == "python":
            if words[0] == "-W":
                continue  # a program of the reader's own
            named = words[0] if words[0] != "-m" else f"{words[1].replace('.', '/')}"
            assert words[0] == "-c" or (ROOT / named).exists(), where
        elif program == "pip":
            assert set(re.findall(r"picktree\[(\w+)\]", " ".join(words))) <= extras.keys(), where
        else:
            assert program in SHELL, where
    for target in re.findall(r"`make (\w+)", prose(page)):
        assert target in TARGETS, f"{page.name}: make {target}"


def quick(page: Path) -> list[TypedCommand]:
    if page.name in FOLLOWED:
        return []
    return [each for each in ours(page) if each.arguments and each.arguments[0] in QUICK]


@pytest.mark.parametrize("page", [page for page in pages() if quick(page)], ids=lambda page: page.name)
def test_quick_commands_of_a_page_run(page: Path, folder: Path) -> None:
    for block in blocks(page):
        if block.file is not None:
            (folder / block.file).parent.mkdir(exist_ok=True)
            (folder / block.file).write_text(block.text)
    for command in quick(page):
        assert command.arguments is not None
        files = [word for word in command.arguments if word.endswith(".yaml")]
        if "." in command.arguments or not all(Path(file).exists() for file in files):
            continue  # files of the reader's own
        ran = call(command.arguments, folder)
        assert ran.returncode == command.exit_code, f"{command.where}: {command.text}\n{ran.stderr}"
