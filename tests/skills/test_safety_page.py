"""docs/safety.md: its mission is right and runs, its skill works as it stands, its causes exist."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from picktree.authoring import check_mission
from picktree.files.yaml import read_document
from picktree.robot.control.jog_motion import StoppedBy
from picktree.trees.loading import NodeRegistry, load_mission, parse_mission
from picktree.world import all_causes

from .cell import Cell, items

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "safety.md").read_text("utf-8")


def block(language: str) -> str:
    (text,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return str(text)


def test_its_mission_goes_down_to_the_table_and_up() -> None:
    text = block("yaml")
    faults = check_mission(read_document(Path("mission.yaml"), "mission", text)).faults
    assert [str(fault) for fault in faults] == []
    cell = Cell(parse_mission(text, Path("mission.yaml"), NodeRegistry()), items(block=1))
    assert cell.finish().value == "SUCCESS"
    assert cell.tree.blackboard.save()["Main/end"] == "collision"
    assert cell.world.control.tcp.position[2] == pytest.approx(0.1, abs=0.02)


def test_its_skill_draws_a_circle(tmp_path: Path) -> None:
    (tmp_path / "circle.py").write_text(block("python"))
    path = tmp_path / "mission.yaml"
    path.write_text(
        "picktree: 1\nkind: mission\nplugins: [circle.py]\ntrees:\n"
        '  Main: {Circle: {radius: 30 mm, travelled: "{way}"}}\n'
    )
    cell = Cell(load_mission(path, NodeRegistry()), items(block=1))
    begin = cell.world.control.tcp
    assert cell.finish().value == "SUCCESS"
    assert float(str(cell.tree.blackboard.save()["Main/way"])) == pytest.approx(2 * 3.14159 * 0.03, rel=0.05)
    assert cell.world.control.tcp.distance(begin) < 0.01


def test_it_names_what_there_is() -> None:
    known = {cause.name for cause in all_causes()}
    assert set(re.findall(r"`((?:safety|planning|world|control)\.[a-z_]+)`", PAGE)) - known == {"world.move"}
    for reason in get_args(StoppedBy):
        assert f"| `{reason}` |" in PAGE
