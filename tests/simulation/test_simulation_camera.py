"""The simulated camera: where pixels look, what is lost, what is noisy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.simulation.physics import PhysicsHardware
from picktree.world import Array, Box, ObjectId, Pose, RgbdImage
from picktree.world.scene import CameraDescription, Fixture, SceneDescription

from .simulated_cell import cell, looking_down, panda

BLOCK = Fixture(ObjectId("block"), Box((0.1, 0.06, 0.05)), Pose((0.6, 0.0, 0.025)), "white")


def noiseless(view: Pose) -> CameraDescription:
    return CameraDescription("overhead", view, size=(320, 240), fov=1.0472, depth_noise=0.0, edge_dropout=0.0)


def one_block(block: Fixture, camera: CameraDescription) -> SceneDescription:
    """The table with a known block, the arm far behind."""
    table = cell().fixtures[0]
    return cell(fixtures=(table, block), bins=(), spawn=(), cameras=(camera,))


def top_of_block(image: RgbdImage) -> Array:
    """Points (n, 2) of BLOCK's top."""
    points = world_points(image)
    top = points[points[:, :, 2] > 0.045][:, :2]
    return top[np.abs(top - (0.6, 0.0)).max(axis=1) < 0.1]


def world_points(image: RgbdImage) -> Array:
    """Every pixel back-projected by the image's own intrinsics and believed pose, (h, w, 3) m."""
    k = image.intrinsics
    v, u = np.mgrid[: k.height, : k.width].astype(float)
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones_like(u)], axis=2)
    return image.camera_in_world.apply((rays * image.depth[:, :, None]).reshape(-1, 3)).reshape(*u.shape, 3)


def capture(scene: SceneDescription, seed: int = 0) -> RgbdImage:
    return PhysicsHardware(scene, panda(), seed).cameras["overhead"].capture()


@pytest.mark.parametrize(
    "view",
    [
        looking_down(0.6, 0.1, 0.75),
        Pose.from_rpy((0.75, 0.0, 0.9), (np.pi - 0.35, 0.0, 0.0)),
        Pose.from_rpy((0.65, -0.2, 0.7), (np.pi, -0.3, 0.8)),
    ],
)
def test_the_pixels_of_a_known_block_lie_on_its_top(view: Pose):
    block = Fixture(ObjectId("block"), Box((0.12, 0.08, 0.05)), Pose((0.62, 0.05, 0.025)), "white")
    points = world_points(capture(one_block(block, noiseless(view))))
    near = np.abs(points[:, :, :2] - (0.62, 0.05)).max(axis=2) < 0.1
    height = points[:, :, 2]
    top = points[near & (np.abs(height - 0.05) < 1e-4)]
    assert len(top) > 400
    centre = (top[:, :2].min(axis=0) + top[:, :2].max(axis=0)) / 2
    pixel = float(np.median(np.linalg.norm(np.diff(points[near.any(axis=1)], axis=1), axis=2)))
    assert np.abs(centre - (0.62, 0.05)).max() < pixel / 2
    beside = near & (np.abs(points[:, :, 0] - 0.62) > 0.08)
    assert (np.abs(height[beside]) < 1e-4).mean() > 0.95


def test_the_mean_of_the_covered_pixels_is_the_middle_of_the_block():
    top = top_of_block(capture(one_block(BLOCK, noiseless(looking_down(0.6, 0.0, 0.75)))))
    assert np.abs(top.mean(axis=0) - (0.6, 0.0)).max() < 0.0005


def test_depth_noise_has_its_deviation_and_grows_with_the_square_of_the_depth():
    for height, deviation in ((0.7, 0.002), (1.05, 0.0045)):
        camera = CameraDescription("overhead", looking_down(0.75, 0.0, height), size=(160, 120), fov=0.5)
        depth = capture(cell(spawn=(), bins=(), cameras=(camera,))).depth
        assert np.median(depth) == pytest.approx(height, abs=0.0002)
        assert np.std(depth) == pytest.approx(deviation, rel=0.05)


def test_half_of_the_pixels_on_edges_are_lost_and_none_elsewhere():
    block = Fixture(ObjectId("block"), Box((0.12, 0.08, 0.05)), Pose((0.75, 0.0, 0.025)), "white")
    camera = CameraDescription("overhead", looking_down(0.75, 0.0, 0.75), size=(320, 240), fov=0.6)
    lost = capture(one_block(block, camera)).depth == 0.0
    rows, columns = np.nonzero(lost)
    clear = capture(one_block(block, replace(camera, edge_dropout=0.0))).depth
    assert not (clear == 0.0).any()
    steps = np.zeros(clear.shape, dtype=bool)
    down, right = np.abs(np.diff(clear, axis=0)) > 0.02, np.abs(np.diff(clear, axis=1)) > 0.02
    steps[1:] |= down
    steps[:-1] |= down
    steps[:, 1:] |= right
    steps[:, :-1] |= right
    assert steps[rows, columns].mean() > 0.99
    assert 0.4 < lost.sum() / steps.sum() < 0.6


def test_each_shot_has_noise_of_its_own_and_the_same_in_every_run():
    one, other = PhysicsHardware(cell(), panda(), 3), PhysicsHardware(cell(), panda(), 3)
    first, second = (one.cameras["overhead"].capture().depth for _ in range(2))
    assert not np.array_equal(first, second)
    for _ in range(2):
        again = other.cameras["overhead"].capture().depth
    assert np.array_equal(second, again)


def test_a_camera_that_is_off_still_reports_the_pose_that_everybody_believes():
    camera = noiseless(looking_down(0.6, 0.0, 0.75))
    image = capture(one_block(BLOCK, replace(camera, error=Pose((0.008, 0.0, 0.0)))))
    assert image.camera_in_world == camera.pose
    shift = camera.pose.rotation() @ np.array([-0.008, 0.0, 0.0])
    assert top_of_block(image).mean(axis=0) == pytest.approx(np.array([0.6, 0.0]) + shift[:2], abs=0.001)


def test_items_show_their_colour_and_the_rest_of_the_world_is_grey():
    hardware = PhysicsHardware(cell(), panda(), 1)
    image = hardware.cameras["overhead"].capture()
    colour = image.colour.astype(float)
    saturation = (colour.max(axis=2) - colour.min(axis=2)) / np.maximum(1.0, colour.max(axis=2))
    points = world_points(image)
    for body in hardware.truth():
        x, y, _ = body.pose.position
        near = np.hypot(points[:, :, 0] - x, points[:, :, 1] - y) < 0.008
        red, _, blue = colour[near].mean(axis=0)
        assert saturation[near].min() > 0.6
        assert bool(red > blue) is (body.colour == "red")
    flat = np.abs(points[:, :, 2]) < 0.001
    assert np.percentile(saturation[flat], 95) < 0.1
    above = replace(cell().cameras[0], pose=looking_down(0.2, 0.0, 1.6))
    image = capture(cell(spawn=(), cameras=(above,)))
    robot = (world_points(image)[:, :, 2] > 0.15) & (image.depth > 0.0)
    assert robot.sum() > 2000
    colour = image.colour[robot].astype(float)
    assert np.percentile((colour.max(axis=1) - colour.min(axis=1)) / colour.max(axis=1), 99) < 0.15


def test_an_image_is_a_copy_and_carries_the_time():
    hardware = PhysicsHardware(cell(), panda(), 1)
    for _ in range(24):
        hardware.step()
    camera = hardware.cameras["overhead"]
    image = camera.capture()
    assert image.stamp == pytest.approx(0.1)
    assert image.colour.shape == (240, 320, 3) and image.colour.dtype == np.uint8
    assert image.depth.shape == (240, 320) and image.depth.dtype == np.float32
    image.depth[:] = -1.0
    image.colour[:] = 0
    assert camera.capture().depth.min() >= 0.0
    assert camera.capture().colour.mean() > 50
