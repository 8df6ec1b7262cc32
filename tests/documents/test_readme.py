"""README.md as its reader does it: each command with its exit code, and what the page says it prints."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path

import pytest

from ..pages import Block, Reader, blocks, typed
from ..rooms import ROOT

PAGE = ROOT / "README.md"
TEXT = PAGE.read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
SHELL = blocks(PAGE, "sh")
(MISSION,) = blocks(PAGE, "yaml")
FEWER = {"0:20": "0:8", "items=40": "items=4"}
"""Of what the README runs for the sake of numbers, less is run."""
ONE_WORKER = ("batch", "run")
"""Command that would have a worker for each core of the machine."""
DEMO = re.search(r'^demo:.*\n\t@"\$\(BIN\)/picktree" (.*?) \|\|', MAKEFILE, re.MULTILINE)


def shortened(words: Sequence[str]) -> list[str]:
    """Return a command of the README as it is run here: word by word the same, but for a number."""
    fewer = [FEWER.get(word, word) for word in words]
    return [*fewer, "--workers", "1"] if tuple(words[:2]) == ONE_WORKER else fewer


def shown_after(block: Block) -> Block | None:
    """Return the output that the page shows of a block: the next one, when that is text."""
    every = blocks(PAGE)
    following = every[every.index(block) + 1 : every.index(block) + 2]
    return following[0] if following and following[0].language == "text" else None


def demo(block: Block) -> Block:
    """Return the block with the command behind `make demo`, and without `make setup`."""
    assert DEMO is not None
    return Block(block.page, block.line, "sh", f"picktree {DEMO[1]}\n")


def test_it_shows_only_make_and_picktree() -> None:
    assert {command.words[0] for block in SHELL for command in typed(block)} == {"make", ".venv/bin/picktree"}


def test_it_names_every_verb_of_the_makefile_and_every_shipped_example() -> None:
    verbs = MAKEFILE.splitlines()[0].removeprefix("# The verbs: ").removesuffix(".").split(", ")
    commands = [command.words for block in SHELL for command in typed(block)]
    shown = {words[1] for words in commands if words[0] == "make"}
    assert set(verbs) - shown - {"dev", "page", "atlas"} == set()
    missing = [file.name for file in (ROOT / "examples").glob("*.yaml") if f"`{file.name}`" not in TEXT]
    assert missing == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "block",
    [each for each in SHELL if "picktree " in each.text or "make demo" in each.text],
    ids=lambda block: "_".join(shlex.split(block.text, comments=True)[1:3]),
)
def test_commands_run_and_print_what_it_says(block: Block, tmp_path: Path) -> None:
    (tmp_path / "first.yaml").write_text(MISSION.text, encoding="utf-8")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    reader = Reader(tmp_path)
    reader.type(demo(block) if "make demo" in block.text else block, shortened)
    if (shown := shown_after(block)) is not None:
        reader.compare(shown)
    for name in re.findall(r"(?:-o|--picture) (\S+)", block.text):
        assert (tmp_path / name).stat().st_size > 1000


def test_its_links_lead_somewhere() -> None:
    targets = re.findall(r"\]\(([^)#:]+)\)", TEXT)
    assert [target for target in targets if not (ROOT / target).exists()] == []
