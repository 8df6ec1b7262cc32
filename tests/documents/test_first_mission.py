"""docs/first-mission.md as its reader does it: each command, each edit, and what the page says comes out."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from ..pages import Reader, blocks, pattern
from ..rooms import ROOT

PAGE = ROOT / "docs" / "first-mission.md"
SETUP = """make setup                                  # about a minute: an environment in .venv, 1.4 GB
export PATH="$PWD/.venv/bin:$PATH"          # so that you can type picktree
"""


def commands() -> Iterator[str]:
    for block in blocks(PAGE, "sh"):
        if block.text != SETUP:
            yield from block.text.splitlines()


def test_page_begins_with_the_set_up() -> None:
    first = blocks(PAGE, "sh")[0]
    assert first.text == SETUP
    assert re.search(r"^setup:", (ROOT / "Makefile").read_text(), re.MULTILINE)


def test_page_goes_through_all_steps() -> None:
    verbs = [line.split()[1] for line in commands() if line.startswith("picktree ")]
    steps = ["render", "run", "explain", "rehearse", "new", "check", "explain-code", "nodes", "snapshot"]
    assert list(dict.fromkeys(verbs)) == steps
    assert {block.language for block in blocks(PAGE)} == {"sh", "text", "diff"}


def test_what_differs_from_run_to_run_is_passed_over() -> None:
    shown = pattern("a\n…\nb … c\n")
    assert re.fullmatch(shown, "a\nx\ny\nb 12 c\n")
    assert not re.fullmatch(shown, "a\nx\nb 12 d\n")


@pytest.mark.slow
def test_a_newcomer_gets_what_the_page_says(tmp_path: Path) -> None:
    reader = Reader(tmp_path)
    for block in blocks(PAGE):
        match block.language:
            case "sh" if block.text != SETUP:
                reader.type(block)
            case "diff":
                reader.edit(block)
            case "text":
                reader.compare(block)
            case _:
                pass
    assert (reader.folder / "moment.png").read_bytes().startswith(b"\x89PNG")
