"""Each YAML block of the pages passes `picktree check`: whole files as they stand, parts in a whole one.

Files that a page names in a first line, such as `# plugins/probe.py`, lie beside those that name them.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from textwrap import indent
from typing import Any

import pytest
import trimesh
import yaml

from picktree.apps.cli.file_schemas import CHECKS
from picktree.files.file_checks import UnsavedText, check_files
from picktree.files.yaml import file_models
from picktree.trees import library_names
from picktree.world.robot_model.robot_schema import RobotFile
from picktree.world.scene import SceneFile

from ..pages import Block, blocks, pages
from ..rooms import ROOT

SCENES = ("three_bins", "three_bins_wrist", "tote", "totes")
"""Scenes on which a part of a scene file, or of a mission, may stand."""
QUARANTINE = """picktree: 1
kind: scene
base: sort_small
fixtures:
  quarantine: {bin: [0.25, 0.20, 0.10], wall: 5 mm, at: [0.12, -0.48, 0]}
"""
"""A scene for rejects, `quarantine.yaml`."""
ROBOTS = ("panda", "xarm6", "iiwa")
ITEMS = {"item", "peg"}
"""Keys of the blackboard that an example takes for given: items."""
TREES = """
  SortAll: {ports: {rounds: {type: int}}, Repeat: {num_cycles: '{rounds}', do: SafeRetreat}}
"""
"""Sub-trees that examples call and do not show."""
SHOWN = [
    block for page in pages() if page.name not in ("nodes.md", "ci.md") for block in blocks(page, "yaml")
]
"""All but the examples of nodes, which tests/authoring/test_reference.py checks where they are declared, and
files of other programs, which tests/cli/test_ci_page.py checks."""


def wholes(block: Block) -> Iterator[str]:
    """Yield the files in which the block may stand; one of them must be without an error."""
    text = block.text
    value: Any = yaml.safe_load(text)
    keys: set[str] = set(value) if isinstance(value, dict) else set()  # pyright: ignore[reportUnknownArgumentType]
    if "picktree" in keys:
        yield text
    elif "trees" in keys:
        yield f"picktree: 1\nkind: mission\nscene: three_bins\n{text}"
    elif keys and keys <= set(file_models.keys_of(SceneFile)):
        for scene in SCENES:
            yield f"picktree: 1\nkind: scene\nbase: {scene}\n{text}"
    elif keys and keys <= set(file_models.keys_of(RobotFile)):
        for robot in ROBOTS:
            whole = yaml.safe_load((ROOT / f"world/robots/{robot}.yaml").read_text())
            yield yaml.safe_dump(merged(whole, value), sort_keys=False)
    else:
        if keys == {"when"}:
            text = f"Recover:\n  do: [{{Grasp: {{object: '{{item}}'}}}}]\n{indent(text, '  ')}"
        for scene in (*SCENES, "quarantine.yaml"):
            yield mission(text, scene)


def merged(whole: Any, part: Any) -> Any:
    if not (isinstance(whole, dict) and isinstance(part, dict)):
        return part
    return {**whole, **{key: merged(whole.get(key), each) for key, each in part.items()}}  # pyright: ignore[reportUnknownVariableType, reportUnknownMemberType]


def mission(nodes: str, scene: str) -> str:
    """Return a mission of these nodes."""
    ports = {name: {"type": "object"} for name in ITEMS & set(re.findall(r"\{(\w+)", nodes))}
    head = f"picktree: 1\nkind: mission\nscene: {scene}\n"
    head += f"include: [{', '.join(f'library/{name}' for name in library_names())}]\n"
    head += "plugins: [plugins/weigh.py]\n" if "Weigh" in nodes else ""
    return f"{head}trees:{TREES}  Main:\n    ports: {ports}\n    Sequence:\n{indent(listed(nodes), ' ' * 6)}"


def listed(nodes: str) -> str:
    return nodes if nodes.lstrip("\n").startswith("- ") else f"- {indent(nodes, '  ').lstrip()}"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folder with the examples, beside which a page's files lie."""
    shutil.copytree(ROOT / "examples", tmp_path, dirs_exist_ok=True)
    shutil.copy(ROOT / "examples/reference/robot.yaml", tmp_path / "my_arm.yaml")
    shutil.copy(ROOT / "examples/faults/slip.yaml", tmp_path / "slips.yaml")
    (tmp_path / "quarantine.yaml").write_text(QUARANTINE)
    trimesh.creation.box((20, 20, 20)).export(tmp_path / "ring.stl")
    return tmp_path


@pytest.mark.parametrize("block", SHOWN, ids=lambda block: block.where)
def test_a_block_is_without_an_error(block: Block, folder: Path) -> None:
    if not yaml.safe_load(block.text):
        return  # a comment, as an editor's modeline
    for other in blocks(block.page):
        if other.file is not None:
            (folder / other.file).parent.mkdir(exist_ok=True)
            (folder / other.file).write_text(other.text, encoding="utf-8")
    said: list[str] = []
    for whole in wholes(block):
        found = check_files([UnsavedText(folder / (block.file or "shown.yaml"), whole.encode())], CHECKS)
        errors = [str(fault) for fault in found.faults if fault.severity == "error"]
        if not errors:
            return
        said += errors
    pytest.fail("\n".join(said))
