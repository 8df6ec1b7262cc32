"""README.md and docs/commands.md as their reader does it: each command with its exit code and its output."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path

import pytest

from ..commands import call
from ..pages import Block, Reader, blocks, typed
from ..rooms import ROOT

PAGE = ROOT / "README.md"
COMMANDS = ROOT / "docs" / "commands.md"
DEVELOPMENT = ROOT / "docs" / "development.md"
TEXT = PAGE.read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
SHELL = [*blocks(PAGE, "sh"), *blocks(COMMANDS, "sh")]
(MISSION,) = blocks(PAGE, "yaml")
FEWER = {"0:20": "0:8", "items=40": "items=4"}
"""Numbers of the pages, and the smaller ones that the tests run."""
SMALL = """\
picktree: 1
kind: scene
base: sort_small
spawn: [{of: {can: 1}, colours: [red], area: {min: [0.4, -0.1], max: [0.6, 0.1]}}]
"""
"""Scene of the tests in place of `sort_small`, which has four items."""
ONE_WORKER = ("batch", "run")
"""Command that would have a worker for each core of the machine."""
DEMO = re.search(r'^demo:.*\n\t@"\$\(BIN\)/picktree" (.*?) \|\|', MAKEFILE, re.MULTILINE)


def shortened(words: Sequence[str]) -> list[str]:
    """Return a command of the page of commands as it is run here: with a smaller number, without physics."""
    fewer = [FEWER.get(word, word) for word in words]
    if tuple(words[:2]) == ONE_WORKER:
        one = ["small.yaml" if word == "sort_small" else word for word in fewer]
        return [*one, "--workers", "1", "--backend", "kinematic"]
    simulated = words[0] == "run" and not {"--backend", "--resume", "--help"} & set(words)
    return [*fewer, "--backend", "kinematic"] if simulated else fewer


def shown_after(block: Block) -> Block | None:
    """Return the output that the page shows of a block: the next one, when that is text."""
    every = blocks(block.page)
    following = every[every.index(block) + 1 : every.index(block) + 2]
    return following[0] if following and following[0].language == "text" else None


def demo(block: Block) -> Block:
    """Return the block with the command behind `make demo`, and without `make setup`."""
    assert DEMO is not None
    return Block(block.page, block.line, "sh", f"picktree {DEMO[1]}\n")


def test_it_shows_only_make_and_picktree() -> None:
    programs = {command.words[0] for block in blocks(PAGE, "sh") for command in typed(block)}
    assert programs == {"make", ".venv/bin/picktree"}
    assert {command.words[0] for block in blocks(COMMANDS, "sh") for command in typed(block)} == {"picktree"}


def test_it_is_short() -> None:
    assert len(TEXT.splitlines()) <= 150


def test_pages_name_every_verb_of_the_makefile_and_every_shipped_example() -> None:
    verbs = MAKEFILE.splitlines()[0].removeprefix("# The verbs: ").removesuffix(".").split(", ")
    shell = [*blocks(PAGE, "sh"), *blocks(DEVELOPMENT, "sh")]
    commands = [command.words for block in shell for command in typed(block)]
    shown = {words[1] for words in commands if words[0] == "make"}
    assert set(verbs) - shown - {"dev", "page", "atlas"} == set()
    missing = [file.name for file in (ROOT / "examples").glob("*.yaml") if f"`{file.name}`" not in TEXT]
    assert missing == []


def test_the_page_of_commands_names_every_command() -> None:
    ran = call(["--help"], ROOT, one_stream=True).stdout
    shown = re.findall(r"^  ([a-z][\w-]*)  ", ran.partition("Commands:")[2], re.MULTILINE)
    assert len(shown) > 25
    text = COMMANDS.read_text(encoding="utf-8").partition("## All commands")[2]
    assert [name for name in shown if not re.search(rf"`{name}[ `]", text)] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "block",
    [each for each in SHELL if "picktree " in each.text or "make demo" in each.text],
    ids=lambda block: "_".join(shlex.split(block.text, comments=True)[1:3]),
)
def test_commands_run_and_print_what_it_says(block: Block, tmp_path: Path) -> None:
    (tmp_path / "first.yaml").write_text(MISSION.text, encoding="utf-8")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "small.yaml").write_text(SMALL, encoding="utf-8")
    reader = Reader(tmp_path)
    if block.page == COMMANDS:
        reader.type(block, shortened)
    else:
        reader.type(demo(block) if "make demo" in block.text else block)
    if (shown := shown_after(block)) is not None:
        reader.compare(shown)
    for name in re.findall(r"(?:-o|--picture) (\S+)", block.text):
        assert (tmp_path / name).stat().st_size > 1000


def test_its_links_lead_somewhere() -> None:
    for page in (PAGE, COMMANDS, DEVELOPMENT):
        targets = re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8"))
        assert [target for target in targets if not (page.parent / target).exists()] == []
