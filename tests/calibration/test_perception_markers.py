"""The squares of a target in rendered pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.robot.calibration.target_detection import (
    area_and_centroid,
    average_tiles,
    detect_tiles,
    pixels_of,
)
from picktree.simulation.physics import CameraRenderer, Client
from picktree.simulation.physics.bodies import add_scenery
from picktree.world import Box, ObjectId, Pose, RgbdImage, Vector3
from picktree.world.scene import Fixture, SceneDescription, parse_scene
from picktree.world.scene.scene_entries import look_at_frame

SCENE = """
picktree: 1
kind: scene
robot: panda
fixtures:
  table: {box: [1.2, 1.6, 0.04], at: [0.5, 0, -0.02], colour: light_grey}
  target: {marker: [180 mm, 160 mm, 50 mm], at: [0.5, 0, 0.025], yaw: 20 deg}
cameras:
  near: {at: [0.45, 0.1, 0.33], look_at: [0.5, 0, 0.05]}
"""


@pytest.fixture(scope="module")
def scene() -> SceneDescription:
    return parse_scene(SCENE, Path("scene.yaml"))


def picture(scene: SceneDescription, at: Vector3 = (0.45, 0.1, 0.33), *added: Fixture) -> RgbdImage:
    """From `at` towards the target, with whatever is added."""
    optical = look_at_frame(at, (0.5, 0.0, 0.05), None)
    assert optical is not None
    client = Client()
    add_scenery((*scene.fixtures, *added), scene.bins, client.id)
    (camera,) = scene.cameras
    seen = CameraRenderer(camera).render(client.id, optical)
    depth = np.where(np.isfinite(seen.depth), seen.depth, np.float32(0.0))
    return RgbdImage("near", seen.colour, depth, 0.0, camera.intrinsics, optical)


def body(name: str, colour: str, size: Vector3, at: Vector3) -> Fixture:
    return Fixture(ObjectId(name), Box(size), Pose(at), colour)


def test_squares_are_found_to_a_fraction_of_a_pixel(scene: SceneDescription) -> None:
    image, target = picture(scene), scene.fixture("target")
    seen = detect_tiles(image, target.tiles)
    assert [tile.index for tile in seen] == [0, 1, 2, 3, 4, 5]
    in_camera = image.camera_in_world.inverse() @ target.pose
    for tile in seen:
        outline = pixels_of(in_camera.apply(target.tiles[tile.index].corners()), image.intrinsics)
        area, centroid = area_and_centroid(outline[None])
        assert float(np.abs(centroid[0] - tile.pixel).max()) < 0.2
        assert tile.area == pytest.approx(abs(area[0]), rel=0.04)
        assert tile.depth == pytest.approx(
            in_camera.apply(np.array(target.tiles[tile.index].centre))[2], abs=1e-3
        )


def test_a_square_behind_something_is_left_out(scene: SceneDescription) -> None:
    red = scene.fixture("target").pose.apply(np.array(scene.fixture("target").tiles[0].centre))
    x, y, z = (float(c) for c in red)
    finger = body("finger", "light_grey", (0.012, 0.012, 0.1), (x, y + 0.02, z + 0.1))
    seen = detect_tiles(picture(scene, (0.45, 0.1, 0.33), finger), scene.fixture("target").tiles)
    assert 0 not in [tile.index for tile in seen]
    assert len(seen) >= 4


def test_things_of_the_same_colours_are_not_taken_for_squares(scene: SceneDescription) -> None:
    tiles = scene.fixture("target").tiles
    alone = detect_tiles(picture(scene), tiles)
    litter = [
        body(colour, colour, (0.04, 0.04, 0.04), (0.36 + 0.05 * n, -0.13, 0.02))
        for n, colour in enumerate(("red", "yellow", "blue"))
    ]
    among = detect_tiles(picture(scene, (0.45, 0.1, 0.33), *litter), tiles)
    assert [tile.pixel for tile in among] == [tile.pixel for tile in alone]


def test_without_a_target_there_is_none(scene: SceneDescription) -> None:
    bare = replace(scene, fixtures=scene.fixtures[:1])
    blocks = [
        body(colour, colour, (0.04, 0.04, 0.04), (0.42 + 0.03 * n, 0.07 * (n % 3) - 0.05, 0.02))
        for n, colour in enumerate(("red", "yellow", "blue", "green"))
    ]
    assert detect_tiles(picture(bare, (0.45, 0.1, 0.33), *blocks), scene.fixture("target").tiles) == ()


def test_pictures_from_one_place_are_averaged(scene: SceneDescription) -> None:
    one = detect_tiles(picture(scene), scene.fixture("target").tiles)
    other = tuple(replace(tile, pixel=(tile.pixel[0] + 0.2, tile.pixel[1]), depth_sigma=1e-3) for tile in one)
    both = average_tiles([one, other])
    assert both[2].pixel[0] == pytest.approx(one[2].pixel[0] + 0.1)
    assert average_tiles([one, other[:5], other[:5], other[:5]])[-1].index == 4
    assert average_tiles([one, (), ()]) == ()
