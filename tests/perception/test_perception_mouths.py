"""The mouths of holes in rendered pictures of a board that does not stand where it is believed to."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.robot.perception import detect_hole
from picktree.simulation import noisy_depth
from picktree.simulation.physics import CameraRenderer, Client
from picktree.simulation.physics.bodies import add_scenery
from picktree.world import Box, ObjectId, Pose, RgbdImage
from picktree.world.scene import Fixture, Hole, SceneDescription, parse_scene
from picktree.world.scene.scene_entries import look_at_frame

SCENE = """
picktree: 1
kind: scene
robot: panda
fixtures:
  table: {box: [1.2, 1.6, 0.04], at: [0.5, 0, -0.02], colour: light_grey}
  board:
    box: [0.2, 0.1, 0.04]
    at: [0.5, 0, 0.02]
    holes:
      hole: {round: 31 mm, at: [-60 mm, 0], depth: 30 mm, chamfer: 1 mm}
      square: {square: 32 mm, at: [0, 0], depth: 30 mm}
      slot: {slot: [40 mm, 18 mm], at: [60 mm, 0], yaw: 90 deg, depth: 30 mm, chamfer: 1 mm}
cameras:
  near: {at: [0.5, 0, 0.25], look_at: [0.5, 0, 0.04]}
"""
OFF = Pose.from_rpy((0.004, -0.005, 0.0), (0.015, -0.02, 0.03))
"""Where the board truly stands, in its frame."""


@pytest.fixture(scope="module")
def scene() -> SceneDescription:
    return parse_scene(SCENE, Path("scene.yaml"))


def picture(scene: SceneDescription, hole: Hole, believed: Pose, *added: Fixture) -> RgbdImage:
    """Of where a hole of the board, believed there, should be, from 20 cm, a little aslant, with noise."""
    board = scene.fixture("board")
    x, y, z = (believed @ hole.pose).position
    optical = look_at_frame((x + 0.04, y - 0.03, z + 0.2), (x + 0.01, y, z), (0.3, 1.0, 0.0))
    assert optical is not None
    client = Client()
    really = replace(board, pose=board.pose @ OFF)
    others = tuple(f for f in scene.fixtures if f is not board)
    add_scenery((*others, really, *added), scene.bins, client.id)
    (camera,) = scene.cameras
    seen = CameraRenderer(camera).render(client.id, optical)
    depth = np.where(np.isfinite(seen.depth), seen.depth, np.float32(0.0))
    noisy = noisy_depth(depth, camera, np.random.default_rng(3))
    return RgbdImage("near", seen.colour, noisy, 0.0, camera.intrinsics, optical)


@pytest.mark.parametrize("name", ["board/hole", "board/square", "board/slot"])
def test_a_mouth_is_found_where_it_truly_is(scene: SceneDescription, name: str) -> None:
    board = scene.fixture("board")
    hole = next(h for h in board.holes if h.id == name)
    found = detect_hole(picture(scene, hole, board.pose), hole, board.pose @ hole.pose, 0.008)
    assert found is not None
    miss = (board.pose @ OFF @ hole.pose).inverse() @ found.pose
    assert math.hypot(*miss.position) < 4e-4
    assert math.acos(min(1.0, float(miss.rotation()[2, 2]))) < math.radians(0.2)
    if hole.form != "round":
        turned = math.atan2(float(miss.rotation()[1, 0]), float(miss.rotation()[0, 0]))
        assert abs(turned) < math.radians(0.8)


def test_what_is_filled_or_hidden_is_no_mouth(scene: SceneDescription) -> None:
    board = scene.fixture("board")
    hole = board.holes[0]
    believed = board.pose @ hole.pose
    at = board.pose @ OFF @ hole.pose
    peg = Fixture(ObjectId("peg"), Box((0.029, 0.029, 0.03)), at.shifted((0.0, 0.0, -0.014)), "grey")
    assert detect_hole(picture(scene, hole, board.pose, peg), hole, believed, 0.008) is None
    finger = Fixture(ObjectId("finger"), Box((0.1, 0.02, 0.02)), at.shifted((0.0, 0.0, 0.05)), "grey")
    assert detect_hole(picture(scene, hole, board.pose, finger), hole, believed, 0.008) is None


def test_a_face_without_a_hole_has_no_mouth(scene: SceneDescription) -> None:
    board = scene.fixture("board")
    bare = replace(board, holes=())
    plain = replace(scene, fixtures=(scene.fixtures[0], bare))
    hole = board.holes[1]
    assert detect_hole(picture(plain, hole, board.pose), hole, board.pose @ hole.pose, 0.008) is None


def test_a_mouth_further_off_than_it_may_be_is_another(scene: SceneDescription) -> None:
    board = scene.fixture("board")
    hole = board.holes[1]
    elsewhere = (board.pose @ hole.pose).shifted((0.02, 0.0, 0.0))
    assert detect_hole(picture(scene, hole, board.pose), hole, elsewhere, 0.003) is None
