"""docs/first-mission.md as its reader does it: each command, each edit, and what the page says comes out."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from .commands import call

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "first-mission.md").read_text(encoding="utf-8")
SETUP = """make setup                                  # about a minute: an environment in .venv, 1.4 GB
export PATH="$PWD/.venv/bin:$PATH"          # so that you can type picktree
"""


@dataclass(frozen=True)
class Block:
    language: str
    text: str


def blocks() -> list[Block]:
    found = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    return [Block(language, text) for language, text in found]


class Reader:
    """Stands in a folder, types the commands, edits the files."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.said = ""

    def type(self, text: str) -> None:
        """All commands of a block; `# exit code 2` behind one says how it ends."""
        self.said = ""
        for line in text.splitlines():
            command, _, remark = line.partition(" # ")
            wanted = int(remark.removeprefix("exit code ")) if remark.startswith("exit code ") else 0
            if command.startswith("cd "):
                self.folder = self.folder / command.removeprefix("cd ").strip()
                continue
            program, *words = shlex.split(command)
            assert program == "picktree"
            ran = call(words, self.folder, one_stream=True)
            assert ran.returncode == wanted, f"{command}\n{ran.stdout}"
            self.said += ran.stdout

    def edit(self, diff: str) -> None:
        head, *lines = diff.splitlines()
        file = self.folder / head.removeprefix("--- ")
        before = "".join(f"{line[1:]}\n" for line in lines if line[0] in " -")
        after = "".join(f"{line[1:]}\n" for line in lines if line[0] in " +")
        text = file.read_text(encoding="utf-8")
        assert text.count(before) == 1, f"{file.name} has these lines {text.count(before)} times:\n{before}"
        file.write_text(text.replace(before, after), encoding="utf-8")


def pattern(shown: str) -> str:
    """`…` on a line of its own stands for any lines, elsewhere for the rest of its line."""
    lines = shown.splitlines()
    parts = [r"(?:.*\n)*" if line == "…" else f"{re.escape(line).replace('…', '.*')}\n" for line in lines]
    return "".join(parts)


def commands() -> Iterator[str]:
    for block in blocks():
        if block.language == "sh" and block.text != SETUP:
            yield from block.text.splitlines()


def test_page_begins_with_the_set_up() -> None:
    first = next(block for block in blocks() if block.language == "sh")
    assert first.text == SETUP
    assert re.search(r"^setup:", (ROOT / "Makefile").read_text(), re.MULTILINE)


def test_page_goes_through_all_steps() -> None:
    verbs = [line.split()[1] for line in commands() if line.startswith("picktree ")]
    steps = ["new", "render", "check", "explain-code", "nodes", "rehearse", "run", "explain", "snapshot"]
    assert list(dict.fromkeys(verbs)) == steps
    assert {block.language for block in blocks()} == {"sh", "text", "diff"}


def test_links_of_the_page_lead_somewhere() -> None:
    targets = re.findall(r"\]\(([^)#:]+)\)", PAGE)
    assert [target for target in targets if not (ROOT / "docs" / target).exists()] == []


def test_what_differs_from_run_to_run_is_passed_over() -> None:
    shown = pattern("a\n…\nb … c\n")
    assert re.fullmatch(shown, "a\nx\ny\nb 12 c\n")
    assert not re.fullmatch(shown, "a\nx\nb 12 d\n")


@pytest.mark.slow
def test_a_newcomer_gets_what_the_page_says(tmp_path: Path) -> None:
    reader = Reader(tmp_path)
    for block in blocks():
        match block.language:
            case "sh" if block.text != SETUP:
                reader.type(block.text)
            case "diff":
                reader.edit(block.text)
            case "text":
                assert re.fullmatch(pattern(block.text), reader.said), f"{block.text}\n---\n{reader.said}"
            case _:
                pass
    assert (reader.folder / "moment.png").read_bytes().startswith(b"\x89PNG")
    assert (reader.folder / "tree.html").read_text(encoding="utf-8").startswith("<!doctype html>")
