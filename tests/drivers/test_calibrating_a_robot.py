"""Calibration of a robot in another process, whose cameras and tool are not where they are believed."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from picktree.apps.commissioning import CalibrationRequest, calibrate
from picktree.logs import RunLog
from picktree.robot.calibration import calibration_targets
from picktree.simulation import cell_file
from picktree.skills import touch_target
from picktree.world import Array, Pose, Vector3, event_types
from picktree.world.robot_model import load_robot
from picktree.world.scene import SceneDescription, load_scene

from .served_cell import served

pytest.importorskip("mujoco")
TRUTH = """\
picktree: 1
kind: scene
base: calibrating
tool_error: [2 mm, -1.5 mm, 2 mm]
cameras:
  overhead: {error: {offset: [5 mm, -4 mm, 4 mm], rpy: [1 deg, -1 deg, 1 deg]}}
  wrist: {error: {offset: [5 mm, -4 mm, 4 mm], rpy: [1 deg, -1 deg, 1 deg]}}
"""


def off(scene: SceneDescription, truth: SceneDescription, camera: str) -> tuple[float, float]:
    """Return the errors of a believed camera, m and rad."""
    believed = next(each for each in scene.cameras if each.name == camera)
    true = next(each for each in truth.cameras if each.name == camera)
    poses = believed.pose, true.pose @ true.error
    if true.on == "hand":
        poses = scene.tool @ poses[0], truth.tool_error @ poses[1]
    return poses[0].distance(poses[1]), poses[0].angle(poses[1])


def test_cameras_that_are_elsewhere_are_found_and_the_target_is_felt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arm takes positions only."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "truth.yaml").write_text(TRUTH)
    truth = load_scene("truth.yaml", tmp_path)
    file = tmp_path / "cell.json"
    file.write_text(json.dumps(cell_file(truth, load_robot("panda", tmp_path), 0)))
    points = calibration_targets.touch_points

    def few_points(
        target: Pose, size: Vector3, at_tips: Array, turned: float
    ) -> tuple[calibration_targets.TouchPoint, ...]:
        return points(target, size, at_tips, turned)[4:8:3]

    monkeypatch.setattr(calibration_targets, "touch_points", few_points)
    monkeypatch.setattr(touch_target, "MIN_TOUCHES", 2)
    monkeypatch.setattr(touch_target, "RIGID_TOUCH_SPEED", 0.015)  # less of the robot's time
    with served(file) as cell:
        request = CalibrationRequest("calibrating", views=4, robot_at=cell.address, out=tmp_path / "runs")
        answer = calibrate(request)
    assert answer.output is not None, answer.why_not
    found, stated = load_scene(str(answer.output)), load_scene("calibrating", tmp_path)
    for camera in ("overhead", "wrist"):
        assert off(stated, truth, camera)[0] > 0.005
        distance, angle = off(found, truth, camera)
        assert distance < 3e-3 and angle < math.radians(0.3), camera
    with RunLog(next((tmp_path / "runs").glob("*/log.mcap"))) as log:
        touches = [
            at.record for at in log.events() if isinstance(at.record, event_types.CalibrationTouchEvent)
        ]
    assert len(touches) == 2
    assert all(0.5 < touch.force < 20.0 for touch in touches)
    assert cell.score["greatest_force"] < 60.0
