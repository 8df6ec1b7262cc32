"""docs/language.md: every file in it is right, and what it lists is what there is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from picktree.authoring.check import check_mission
from picktree.files.expressions.parser import FUNCTIONS
from picktree.files.yaml.document import read_document
from picktree.trees.declaration import COMMON_KEYS
from picktree.trees.loading.loader import load_mission
from picktree.trees.loading.tree_set import MAX_INCLUDED_FILES
from picktree.trees.mission import library_names
from picktree.trees.values.fault_collector import MAX_NODES
from picktree.trees.values.references import ATTRIBUTES
from picktree.world.belief.facts import FACTS

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "language.md").read_text("utf-8")
FILES = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("text", FILES, ids=range(len(FILES)))
def test_its_files_have_no_errors(text: str) -> None:
    whole = text if text.startswith("picktree:") else f"picktree: 1\nkind: mission\nscene: three_bins\n{text}"
    faults = check_mission(read_document(Path("mission.yaml"), "mission", whole)).faults
    assert [str(fault) for fault in faults if fault.severity == "error"] == []


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
