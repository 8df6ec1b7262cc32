"""Looking at a hole from the hand, without physics: the arm goes there and sees where the mouth truly is."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import TypeVar

import pytest

from picktree.robot import World
from picktree.robot.manipulation.hole_servoing import look_at_hole
from picktree.session import assemble_world
from picktree.session.execution import TICK_LENGTH
from picktree.simulation import build_hardware, displace_fixtures
from picktree.world import Failure, ObjectId
from picktree.world.robot_model import load_robot
from picktree.world.scene import parse_scene

T = TypeVar("T")
SCENE = """
picktree: 1
kind: scene
robot: panda
fixtures:
  table: {box: [1.2, 1.6, 0.04], at: [0.5, 0, -0.02], colour: light_grey}
  board:
    box: [0.12, 0.12, 0.04]
    at: [0.5, 0, 0.02]
    holes: {left: {square: 32 mm, at: [-10 mm, 5 mm], depth: 30 mm}}
    uncertainty: {position: 5 mm, angle: 2 deg}
"""
WRIST = "cameras: {wrist: {on: hand, at: [70 mm, 0, -60 mm], look_at: [0, 0, 70 mm]}}\n"
FAR = SCENE.replace("at: [0.5, 0, 0.02]", "at: [1.0, 0.7, 0.02]")


def standing(text: str) -> World:
    scene, robot = parse_scene(text, Path("scene.yaml")), load_robot("panda")
    return assemble_world(build_hardware("kinematic", scene, robot, 4), scene, robot, 4)


def carried_out(world: World, steps: Generator[None, None, T]) -> T:
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value
        world.control.step_tick(TICK_LENGTH)


def test_the_mouth_is_seen_where_it_truly_is() -> None:
    world = standing(SCENE + WRIST)
    board = displace_fixtures(world.description, 4, level=True).fixture("board")
    truly = board.pose @ board.holes[0].pose
    believed = world.description.fixture("board").pose @ board.holes[0].pose
    seen = carried_out(world, look_at_hole(world, ObjectId("board/left"), "test"))
    assert seen is not None
    assert believed.distance(truly) > 1e-3
    assert seen.distance(truly) < 5e-4
    assert seen.angle(truly) < 0.015
    assert world.control.at_rest


def test_without_a_camera_on_the_hand_nothing_moves() -> None:
    world = standing(SCENE)
    assert carried_out(world, look_at_hole(world, ObjectId("board/left"), "test")) is None
    assert world.clock.now == 0.0


def test_a_hole_out_of_reach_is_not_told() -> None:
    world = standing(FAR + WRIST)
    assert carried_out(world, look_at_hole(world, ObjectId("board/left"), "test")) is None
    told = [entry.message for entry in world.journal.take() if hasattr(entry, "kind")]
    assert told[-1] == "board/left: nowhere within reach is it seen beside the hand"


def test_there_must_be_such_a_hole() -> None:
    world = standing(SCENE + WRIST)
    with pytest.raises(Failure, match="board/right"):
        carried_out(world, look_at_hole(world, ObjectId("board/right"), "test"))
