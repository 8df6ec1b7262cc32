"""What the linter says of a text, each finding as its code, place and sentence."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from textwrap import dedent

from picktree.authoring import check_mission
from picktree.files.yaml import read_document
from picktree.trees.loading import NodeRegistry

MISSION = "picktree: 1\nkind: mission\n"


@cache
def _registry() -> NodeRegistry:
    registry = NodeRegistry()
    registry.ids()
    return registry


def main(*nodes: str) -> str:
    """Trees of a mission that does these one after the other; the first stands on line 4."""
    return "trees:\n  Main:\n    Sequence:\n" + "".join(f"      - {node}\n" for node in nodes)


def lint(text: str, *codes: str, head: str = MISSION, folder: Path = Path()) -> list[str]:
    """The findings of these codes, or all; lines count from the text's own first. Errors of the language
    raise."""
    path = folder / "mission.yaml"
    checked = check_mission(read_document(path, "mission", head + dedent(text).strip("\n")), _registry())
    assert checked.mission is not None, "\n".join(map(str, checked.faults))
    lines = head.count("\n")
    return [
        f"{fault.code} {fault.mark.line - lines}:{fault.mark.column} "
        + str(fault).removeprefix(f"{fault.mark}: ")
        for fault in checked.faults
        if (not codes or fault.code in codes) and fault.mark.file == str(path)
    ]
