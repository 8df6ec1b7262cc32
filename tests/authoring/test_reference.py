"""The reference: what is said of each node, that its example holds, and that the page is up to date."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from picktree.apps.cli.author_commands import registry
from picktree.authoring import check_mission
from picktree.authoring.schema import markdown
from picktree.authoring.schema.node_reference import COMMON_DOCS, node_entry, page, table
from picktree.files import Expression
from picktree.files.yaml import Document, read_document
from picktree.trees import COMMON_KEYS, NodeDeclaration, NodeSpec
from picktree.trees.loading import examine
from picktree.trees.references import Reference
from picktree.world.world_facts import FACTS

ROOT = Path(__file__).parents[2]
SHIPPED = registry(shipped=True)
NODES = SHIPPED.declarations()
TYPES = {"item": "object", "thing": "object", "items": "list of object", "cause": "string", "attempt": "int"}
"""Of the keys that examples take as given."""


def mission(node: NodeDeclaration, given: dict[str, str]) -> Document:
    """The example as a mission whose parameters are the keys that are given."""
    ports = {key: {"type": kind} for key, kind in given.items()}
    body = "\n".join(f"    {line}" for line in node.example.splitlines())
    head = f"    ports: {ports}\n" if ports else ""
    scene = "calibrating" if "target:" in body else "tote" if "tote" in body else "three_bins"
    text = f"picktree: 1\nkind: mission\nscene: {scene}\ntrees:\n  Main:\n{head}{body}\n"
    return read_document(Path("example.yaml"), "mission", text)


def given_to(node: NodeDeclaration) -> dict[str, str]:
    """The keys that the example reads and does not write."""
    specs = list(examine(mission(node, {})).mission.main.root.iterate())
    written = {key for spec in specs for key in keys(spec, "out")}
    return {key: TYPES[key] for spec in specs for key in keys(spec, "in") if key not in written}


def keys(spec: NodeSpec, direction: str) -> set[str]:
    assert spec.node is not None
    found = set[str]()
    for name, bound in spec.ports.items():
        port = spec.node.declaration.port(name)
        if port is not None and port.direction == direction:
            if isinstance(bound, Reference):
                found.add(bound.key)
            elif isinstance(bound.value, Expression):
                found |= bound.value.names - set(FACTS)
    return found


def errors(document: Document) -> list[str]:
    """A warning may be: what is right in a whole mission can be strange by itself."""
    return [str(f) for f in check_mission(document, SHIPPED).faults if f.severity == "error"]


@pytest.mark.parametrize("node", NODES, ids=[node.id for node in NODES])
def test_example_shows_the_node_and_is_without_error(node: NodeDeclaration) -> None:
    assert re.search(rf"\b{node.id}\b", node.example)
    assert errors(mission(node, given_to(node))) == []


def test_a_wrong_example_would_be_found() -> None:
    good = next(node for node in NODES if node.id == "Grasp")
    bad = NodeDeclaration("Grasp", "", "action", example='Grasp: {objct: "{item}"}')
    assert errors(mission(good, given_to(good))) == []
    assert len(errors(mission(bad, {"item": "object"}))) == 2


def test_page_in_the_docs_is_up_to_date() -> None:
    made = markdown(
        [node_entry(node, SHIPPED.causes, SHIPPED.find(node.id)) for node in NODES], SHIPPED.causes
    )
    assert (ROOT / "docs/nodes.md").read_text(encoding="utf-8") == made, "renew it: make docs"


def test_every_word_of_a_declaration_is_there() -> None:
    for node in NODES:
        assert node.doc.strip(), node.id
        assert all(port.doc.strip() for port in node.ports), node.id
        assert all(slot.doc.strip() for slot in node.slots), node.id
    assert set(COMMON_DOCS) == set(COMMON_KEYS)


def test_table_of_all_nodes() -> None:
    lines = table([node_entry(node, ()) for node in NODES if node.id in ("GoTo", "Sequence")])
    assert lines == (
        "Actions\n"
        "  GoTo      Move the arm, free of collisions, to a named configuration of the robot file.\n"
        "\n"
        "Control nodes\n"
        "  Sequence  Ticks its children in order until one fails; resumes at the child that was RUNNING.\n"
    )


def test_page_of_one_node() -> None:
    gripper = next(node for node in NODES if node.id == "CloseGripper")
    assert page(node_entry(gripper, SHIPPED.causes)) == (
        """\
CloseGripper (action)

Close the fingers with a force and report the opening at which they stopped.

Inputs
  force: number in N, or as "20 N"; more than 0; default 30 N
      grip force of each finger

Outputs
  width: number in m; written to a key of the blackboard
      opening at which the fingers stopped

Fails with
  control.gripper: The fingers did not follow a command. First remedy: reset the gripper.

Uses gripper.

Example
  CloseGripper: {force: 20 N, width: "{gap}"}

As every node it also takes name, _failureIf, _successIf, _skipIf, _while, _onHalted, _onFailure,
_onSuccess, _post and breakpoint.
"""
    )
