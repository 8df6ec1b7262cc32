"""Code blocks of README.md and of docs/: one way to read them, and a reader who types them, for all tests."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from .commands import call
from .rooms import ROOT

_BLOCK = re.compile(
    r"^(?P<indent> *)```(?P<language>\w*)[^\n]*\n(?P<text>.*?)^ *```$", re.MULTILINE | re.DOTALL
)
_FILE = re.compile(r"# ([\w./-]+\.(?:py|yaml|toml|obj))\n")
_PROGRAMS = ("picktree", ".venv/bin/picktree")


@dataclass(frozen=True)
class Block:
    """Code block of a page: where it begins, its language, its text without the page's indentation."""

    page: Path
    line: int
    language: str
    text: str

    @property
    def where(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def file(self) -> str | None:
        """Name of the file that the block shows, from a first line such as `# plugins/probe.py`."""
        found = _FILE.match(self.text)
        return found[1] if found else None


@dataclass(frozen=True)
class TypedCommand:
    """Line of a shell block: its words, and the exit code that a remark `# exit code 1` names."""

    where: str
    text: str
    words: tuple[str, ...]
    exit_code: int

    @property
    def arguments(self) -> tuple[str, ...] | None:
        """Words behind `picktree`. None: another program."""
        return self.words[1:] if self.words[0] in _PROGRAMS else None


def pages() -> list[Path]:
    """Return README.md and the pages of docs/."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, *languages: str) -> list[Block]:
    """Return the blocks of a page in these languages, or all."""
    text = page.read_text(encoding="utf-8")
    found = [
        Block(
            page,
            text.count("\n", 0, match.start()) + 1,
            match["language"],
            re.sub(rf"^{match['indent']}", "", match["text"], flags=re.MULTILINE),
        )
        for match in _BLOCK.finditer(text)
    ]
    return [block for block in found if not languages or block.language in languages]


def recipes(page: Path) -> dict[str, list[Block]]:
    """Return the blocks of a page by the heading `##` above them."""
    headings = [
        (number, line.removeprefix("## "))
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1)
        if line.startswith("## ")
    ]
    found: dict[str, list[Block]] = {}
    for block in blocks(page):
        heading = max((each for each in headings if each[0] < block.line), default=(0, ""))
        found.setdefault(heading[1], []).append(block)
    return found


def typed(block: Block) -> Iterator[TypedCommand]:
    """Yield the commands of a shell block; those of a console block stand behind `$ `."""
    lines = block.text.replace("\\\n", " ").splitlines()
    if block.language == "console":
        lines = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
    for line in (re.sub(r"^\w+\$ +", "", line) for line in lines):
        words = shlex.split(line, comments=True)
        remark = re.search(r"# .*?exit code (\d+)", line)
        if words:
            yield TypedCommand(block.where, line, tuple(words), int(remark[1]) if remark else 0)


def pattern(shown: str) -> str:
    """Return the regular expression of shown output.

    `…` on a line of its own stands for any lines, elsewhere for any text.
    """
    lines = shown.splitlines()
    parts = [r"(?:.*\n)*" if line == "…" else f"{re.escape(line).replace('…', '.*')}\n" for line in lines]
    return "".join(parts)


class Reader:
    """Reader of a page: stands in a folder, types commands, edits files, and compares what is printed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.said = ""
        """Output of the last shell block."""

    def type(self, block: Block, shortened: Callable[[Sequence[str]], list[str]] = list) -> None:
        """Run the commands of a block; each must end with the exit code that its remark names, else 0.

        `shortened` returns the words behind `picktree` that are run in place of those that are shown.
        """
        self.said = ""
        for command in typed(block):
            if command.words[0] == "cd":
                self.folder = self.folder / command.words[1]
                continue
            assert command.arguments is not None, f"{command.where}: {command.text}"
            ran = call(shortened(command.arguments), self.folder, one_stream=True)
            code = 128 - ran.returncode if ran.returncode < 0 else ran.returncode
            assert code == command.exit_code, f"{command.where}: {command.text}: {code}\n{ran.stdout}"
            self.said += ran.stdout

    def compare(self, block: Block) -> None:
        """Compare what the last commands printed with what the page shows."""
        assert re.fullmatch(pattern(block.text), self.said), f"{block.where}\n{block.text}\n---\n{self.said}"

    def edit(self, block: Block) -> None:
        """Edit a file as a diff block shows it."""
        head, *lines = block.text.splitlines()
        file = self.folder / head.removeprefix("--- ")
        before = "".join(f"{line[1:]}\n" for line in lines if line[0] in " -")
        after = "".join(f"{line[1:]}\n" for line in lines if line[0] in " +")
        text = file.read_text(encoding="utf-8")
        assert text.count(before) == 1, f"{file.name} has these lines {text.count(before)} times:\n{before}"
        file.write_text(text.replace(before, after), encoding="utf-8")


def prose(page: Path) -> str:
    """Return the text of a page without its code blocks."""
    return _BLOCK.sub("", page.read_text(encoding="utf-8"))
