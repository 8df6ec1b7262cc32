"""Descent onto flat objects where the fingers reach less far than the tool: at the edge of the workspace."""

from __future__ import annotations

from pathlib import Path

import picktree as pt

SCENE = """\
picktree: 1
kind: scene
base: self_test
limits: {force: 60 N, workspace: {min: [-0.2, -0.9, 7 mm], max: [0.9, 0.9, 1.2]}}
"""


def test_a_plate_is_grasped_where_the_workspace_ends_before_the_tips_touch(tmp_path: Path) -> None:
    (tmp_path / "low.yaml").write_text(SCENE, encoding="utf-8")
    with pt.Cell(tmp_path / "low.yaml", robot="xarm6", seed=1) as cell:
        cell.run(pt.Observe(camera="overhead"))
        result = cell.run(pt.Grasp(object=cell.belief.find(kind="plate").id))
    assert result, result
