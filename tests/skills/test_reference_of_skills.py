"""What docs/nodes.md says of a node that acts or recovers is what runs: its ports with bounds and defaults,
its causes, what it uses, how long it may take."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from picktree.apps.cli.author_commands import registry
from picktree.authoring.schema import markdown
from picktree.authoring.schema.node_reference import node_entry
from picktree.recovery import NODES as RECOVERY
from picktree.skills import NODES as SKILLS
from picktree.trees import Node, build
from picktree.trees.loading import NodeRegistry, parse_mission

from .cell import Cell, items, mission

PAGE = (Path(__file__).parents[2] / "docs" / "nodes.md").read_text(encoding="utf-8")
SHIPPED = registry(shipped=True)
GIVEN = {"item": ("object", ""), "cause": ("string", "grasp.missed")}
"""Type and value of what examples take as given; the item is the block."""


@pytest.fixture(scope="module")
def cell() -> Cell:
    made = Cell(mission("Observe: {camera: overhead}"), items(block=1))
    made.finish()
    return made


def section(text: str, heading: str) -> str:
    """From a heading to the next."""
    found = re.search(rf"^### {heading}\n.*?(?=^##)", text + "\n## end", re.DOTALL | re.MULTILINE)
    assert found is not None, heading
    return found[0].strip()


@pytest.mark.parametrize("node", [*SKILLS, *RECOVERY], ids=lambda node: node.declaration.id)
def test_the_reference_says_what_a_node_takes_and_its_example_starts(node: type[Node], cell: Cell) -> None:
    declared = node.declaration
    told = markdown([node_entry(declared, SHIPPED.causes, node)], SHIPPED.causes)
    assert section(told, declared.id) == section(PAGE, declared.id)
    text = declared.example
    (block,) = (o.id for o in cell.world.scene.objects)
    given = {key: value for key, value in GIVEN.items() if f"{{{key}}}" in text}
    ports = {key: kind for key, (kind, _) in given.items()}
    body = "".join(f"    {line}\n" for line in text.splitlines())
    whole = f"picktree: 1\nkind: mission\ntrees:\n  Main:\n    ports: {ports}\n{body}"
    values = {key: value or block for key, (_, value) in given.items()}
    cell.tree = build(parse_mission(whole, Path("example.yaml"), NodeRegistry()), cell.world, values)
    for _ in range(3):
        cell.tick()
    cell.halt()
    cell.rest()
    assert cell.happened("internal_error", "undeclared_cause") == []
