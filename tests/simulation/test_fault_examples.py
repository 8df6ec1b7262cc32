"""There is an example of each kind of fault, and it says what would be right to say of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from picktree.simulation import load_faults
from picktree.simulation.fault_entries import KINDS

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples/faults").glob("*.yaml"))


def test_there_is_one_of_each_kind() -> None:
    assert [path.stem for path in EXAMPLES] == sorted(KINDS)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_shows_that_kind(path: Path) -> None:
    read = load_faults(path)
    assert [fault.fault for fault in read.faults] == [path.stem]
    assert read.expect is not None
    assert path.read_text().startswith("# yaml-language-server: $schema=../../schemas/faults.json\n# ")


def test_the_page_has_a_row_for_each_kind() -> None:
    page = (ROOT / "docs/faults.md").read_text()
    assert re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE) == list(KINDS)
