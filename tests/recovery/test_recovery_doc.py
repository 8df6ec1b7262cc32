"""docs/recovery.md: what it names exists."""

from __future__ import annotations

import re
from pathlib import Path

from picktree.files.yaml import read_document
from picktree.trees.loading import NodeRegistry, examine
from picktree.world import all_causes, matches

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "recovery.md").read_text("utf-8")
INCLUDE = "include: [library/recovery, library/sorting, library/feeding]"


def test_the_nodes_and_trees_that_it_names_exist() -> None:
    text = f"picktree: 1\nkind: mission\n{INCLUDE}\ntrees: {{Main: AlwaysSuccess}}\n"
    registry = NodeRegistry()
    mission = examine(read_document(Path("m.yaml"), "mission", text), registry).mission
    assert mission is not None
    known = {*mission.trees, *registry.ids()}
    named = set(re.findall(r"`([A-Z][a-z]+(?:[A-Z][a-z]*)*)`", PAGE))
    assert len(named) > 30
    assert named - known == set()


def test_the_causes_that_it_names_exist() -> None:
    families = sorted({cause.name.split(".")[0] for cause in all_causes()})
    named = set(re.findall(rf"`((?:{'|'.join(families)})\.(?:\w+|\*))`", PAGE))
    assert len(named) > 15
    assert {one for one in named if not any(matches(one, cause) for cause in all_causes())} == set()
