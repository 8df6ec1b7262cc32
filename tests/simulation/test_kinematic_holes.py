"""Holes in the backend without physics: what stands over one goes in, what is off stays on top."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from picktree.simulation.kinematic.bodies import KinematicBodies, KinematicBody, Prism
from picktree.world import ObjectId, Pose
from picktree.world.scene import parse_scene

SCENE = """\
picktree: 1
kind: scene
robot: panda
fixtures:
  table: {box: [1.2, 1.6, 0.04], at: [0.5, 0, -0.02]}
  board:
    box: [0.20, 0.12, 0.04]
    at: [0.5, 0.1, 0.02]
    yaw: 30 deg
    holes:
      left: {round: 31 mm, at: [-50 mm, 10 mm], depth: 30 mm, chamfer: 1 mm}
      right: {slot: [52 mm, 20 mm], at: [50 mm, 0], yaw: 20 deg, depth: 25 mm}
catalogue:
  dowel: {cylinder: {radius: 15 mm, height: 60 mm}, mass: 80 g, friction: 0.5}
  key: {box: [18 mm, 50 mm, 60 mm], mass: 80 g, friction: 0.5}
"""
MOUTHS = {"dowel": 0.01, "key": 0.015}
"""Heights of the bottoms."""


def dropped(kind: str, along: float = 0.0, turned: float = 0.0, above: float = 0.002) -> Pose:
    """Where an item comes to rest that is let go `above` the mouth of its hole, so far off along its x."""
    scene = parse_scene(SCENE, Path("scene.yaml"))
    board = scene.fixture("board")
    hole = board.holes[0 if kind == "dowel" else 1]
    # The key's longer side is its own y: turned by 90 deg it lies along the slot.
    yaw = turned + (math.pi / 2 if kind == "key" else 0.0)
    pose = board.pose @ hole.pose @ Pose.from_rpy((along, 0.0, 0.03 + above), (0.0, 0.0, yaw))
    item = ObjectId("item_00")
    bodies = KinematicBodies(scene, [KinematicBody(item, scene.entry(kind), "red", pose, 0.5)])
    bodies.drop(item)
    return bodies[item].pose


@pytest.mark.parametrize("kind", ["dowel", "key"])
def test_an_item_over_its_hole_falls_to_the_bottom(kind: str) -> None:
    assert dropped(kind).position[2] == pytest.approx(MOUTHS[kind] + 0.03)


def test_the_chamfer_helps_and_the_walls_centre() -> None:
    """Half the slack of 1 mm, and 1 mm of chamfer."""
    within, beyond = dropped("dowel", along=0.0014), dropped("dowel", along=0.0016)
    assert within.position[2] == pytest.approx(0.04)
    assert within.distance(dropped("dowel")) == pytest.approx(0.0005)
    assert beyond.position[2] == pytest.approx(0.07)


def test_a_box_must_be_turned_as_its_slot() -> None:
    """2 mm of slack over 52 mm are 2.2 deg; either long side may lie along it."""
    assert dropped("key", turned=math.radians(2)).position[2] == pytest.approx(0.045)
    assert dropped("key", turned=math.radians(2)).angle(dropped("key")) == pytest.approx(0.0, abs=1e-6)
    assert dropped("key", turned=math.pi).position[2] == pytest.approx(0.045)
    assert dropped("key", turned=math.radians(3)).position[2] == pytest.approx(0.07)


def test_what_is_in_a_hole_stays_there_when_others_settle_and_fills_it() -> None:
    scene = parse_scene(SCENE, Path("scene.yaml"))
    mouth = scene.fixture("board").pose @ scene.fixture("board").holes[0].pose
    pose = mouth @ Pose((0.0, 0.0, 0.031))
    one, other = ObjectId("item_00"), ObjectId("item_01")
    bodies = KinematicBodies(scene, [KinematicBody(one, scene.entry("dowel"), "red", pose, 0.5)])
    bodies.drop(one)
    lies = bodies[one].pose
    bodies.put(KinematicBody(other, scene.entry("dowel"), "red", mouth @ Pose((0.0, 0.0, 0.08)), 0.5))
    bodies.drop(other)
    bodies.settle()
    assert bodies[one].pose.distance(lies) < 1e-12
    # It stands on the first, whose top is 70 mm high.
    assert bodies[other].pose.position[2] == pytest.approx(0.1)


def test_a_held_item_feels_the_bottom_over_its_hole_and_the_face_beside_it() -> None:
    scene = parse_scene(SCENE, Path("scene.yaml"))
    mouth = scene.fixture("board").pose @ scene.fixture("board").holes[0].pose
    item, entry = ObjectId("item_00"), scene.entry("dowel")
    bodies = KinematicBodies(scene, [KinematicBody(item, entry, "red", mouth, 0.5)])
    bodies.held = item

    def highest(along: float, up: float) -> float:
        pose = mouth @ Pose((along, 0.0, 0.03 + up))
        bodies.carry(pose)
        return max(top for _, top in bodies.tops_below(Prism.of(item, entry.shape, pose)))

    assert highest(0.0, 0.001) == pytest.approx(0.01)
    assert highest(0.003, 0.001) == pytest.approx(0.04)
    # Once it is in, the walls are taken to hold it.
    assert highest(0.003, -0.01) == pytest.approx(0.01)
