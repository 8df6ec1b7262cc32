"""docs/language.md and the library: what is listed is what there is, and is explained."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.files.expression_syntax import FUNCTIONS
from picktree.files.yaml import read_document
from picktree.trees import COMMON_KEYS, LIBRARY, library_names
from picktree.trees.loading import NodeRegistry, examine, load_mission
from picktree.trees.loading.loader import MAX_INCLUDED_FILES
from picktree.trees.mission import MAX_NODES
from picktree.trees.references import ATTRIBUTES
from picktree.world.world_facts import FACTS

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "language.md").read_text("utf-8")


@pytest.mark.parametrize(
    "names", [COMMON_KEYS, ATTRIBUTES, FACTS, [f"library/{name}" for name in library_names()]]
)
def test_it_names_all_that_there_is(names: list[str]) -> None:
    assert [name for name in names if f"`{name}`" not in PAGE] == []


def test_it_names_all_functions_and_bounds() -> None:
    assert [name for name in FUNCTIONS if f"`{name}(" not in PAGE] == []
    assert f"{MAX_INCLUDED_FILES} included files" in PAGE
    assert f"{MAX_NODES:,} nodes" in PAGE


def test_it_names_the_trees_of_the_library(tmp_path: Path) -> None:
    mission = tmp_path / "m.yaml"
    included = ", ".join(f"library/{name}" for name in library_names())
    mission.write_text(f"picktree: 1\nkind: mission\ninclude: [{included}]\ntrees: {{Main: AlwaysSuccess}}\n")
    trees = set(load_mission(mission).trees) - {"Main"}
    assert {name for name in trees if f"`{name}`" not in PAGE} == set()


@pytest.mark.parametrize("name", library_names())
def test_ports_of_the_library_have_types_and_docs(name: str) -> None:
    mission = examine(read_document(LIBRARY / f"{name}.yaml", "mission"), NodeRegistry()).mission
    assert mission.library
    ports = [(tree.name, port) for tree in mission.trees.values() for port in tree.ports]
    assert [(tree, port.key) for tree, port in ports if not port.doc or str(port.type) == "any"] == []
