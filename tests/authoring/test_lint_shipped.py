"""What comes with picktree passes its own linter, and a large mission passes it quickly."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.apps.cli.file_schemas import CHECKS
from picktree.authoring.lint import lint
from picktree.files.file_checks import check_files
from picktree.trees import LIBRARY
from picktree.trees.loading import parse_mission

from ..effort import counted

ROOT = Path(__file__).parents[2]
SHIPPED = sorted([*(ROOT / "examples").glob("*.yaml"), *LIBRARY.glob("*.yaml")])


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_a_shipped_mission_or_library_has_no_finding(file: Path) -> None:
    assert [str(fault) for fault in check_files([file], CHECKS).faults] == []


def station(number: int) -> str:
    """Fourteen nodes with recovery, and what calls them."""
    return f"""
  Station{number}:
    ports: {{item: object}}
    Recover:
      do:
        - Fallback: [{{Condition: {{if: holding}}}}, {{Grasp: {{object: "{{item}}"}}}}]
        - Place: {{object: "{{item}}", into: "{{item.destination}}"}}
      when:
        grasp.missed: [SafeRetreat, {{Observe: {{camera: overhead}}}}]
        control.*: SafeRetreat
      otherwise: [SafeRetreat]
      give_up: {{SafeRetreat: {{hand: open}}}}
"""


def test_a_thousand_nodes_and_a_sub_tree_used_a_hundred_times() -> None:
    names = [f"Station{n % 70}" for n in range(100)]
    loop = (
        '      - ForEach: {in: "{items}", out: "{item}", on_failure: continue, do: {%s: {item: "{item}"}}}\n'
    )
    calls = "".join(loop % name for name in names)
    text = "picktree: 1\nkind: mission\ntrees:\n  Main:\n    Sequence:\n"
    text += '      - Observe: {camera: overhead, objects: "{items}"}\n' + calls
    text += "".join(station(number) for number in range(70))
    mission = parse_mission(text, Path("large.yaml"))
    assert sum(1 for tree in mission.trees.values() for _ in tree.root.iterate()) > 1000
    found, calls = counted(lambda: lint(mission))
    assert found == ()
    assert calls < 3_000_000


def test_sub_trees_in_sub_trees_do_not_multiply() -> None:
    """Each uses the next ten times: a thousand uses of the last, of which each is looked at once."""
    levels = "".join(f"  Level{n}: {{Sequence: [{', '.join([f'Level{n + 1}'] * 10)}]}}\n" for n in range(3))
    text = f"picktree: 1\nkind: mission\ntrees:\n  Main: Level0\n{levels}  Level3: {{OpenGripper: {{}}}}\n"
    mission = parse_mission(text, Path("deep.yaml"))
    found, calls = counted(lambda: lint(mission))
    assert found == ()
    assert calls < 50_000


def test_many_nodes_that_fill_the_hand_do_not_multiply() -> None:
    """What each of them took may be held at the end, so that every set of them would be a state."""
    pick = """
      - Recover:
          do: [{Grasp: {object: a}}, {Place: {object: a, into: red_bin}}]
          when: {planning.*: [{Observe: {camera: overhead}}]}
          otherwise: [SafeRetreat]"""
    text = f"picktree: 1\nkind: mission\ntrees:\n  Main:\n    Sequence:{pick * 60}\n"
    mission = parse_mission(text, Path("grasps.yaml"))
    found, calls = counted(lambda: lint(mission))
    assert [fault.code for fault in found] == ["P330"] * 60
    assert calls < 1_000_000
