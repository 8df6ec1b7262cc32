"""A camera on the hand: it moves with the tool, sees from where it truly is, and is masked and corrected."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from picktree.robot.perception import Perception, PosedCamera, RobotMask
from picktree.robot.perception.camera_registration import register_hand_camera
from picktree.robot.perception.segmentation import downsample
from picktree.robot.planning import InverseKinematics
from picktree.simulation import TrueBody, noisy_depth
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.simulation.sensor_noise import MIN_DEPTH_DEVIATION
from picktree.world import Array, BeliefObject, Box, GripperCommand, Pose, RgbdImage
from picktree.world.scene import CatalogueEntry, SceneDescription, load_scene, parse_scene

from ..planning.motion_cell import HOME, MODEL, down

OVER = np.array([0.0, 0.25, 0.0, -2.05, 0.0, 2.3, 0.785])
"""The hand low over the middle of the table, rad."""
OFF = Pose.from_rpy((0.005, -0.005, 0.0037), (0.02, -0.018, 0.022))
"""An error of the mounting: 8 mm and 2°."""


@cache
def scene(error: Pose = Pose()) -> SceneDescription:  # noqa: B008  a frozen value
    """`three_bins_wrist` with an error of the mounting."""
    whole = load_scene("three_bins_wrist")
    overhead, wrist = whole.cameras
    return replace(whole, cameras=(overhead, replace(wrist, error=error)))


def posed(error: Pose = OFF, q: Array = OVER) -> KinematicHardware:
    """The kinematic cell with the arm at q and the fingers half open."""
    hardware = KinematicHardware(scene(error), MODEL.description, 4)
    hardware.arm.set(q, np.zeros(7))
    hardware.gripper.command(GripperCommand(0.06, 10.0))
    for _ in range(120):
        hardware.step()
    return hardware


def shot(hardware: KinematicHardware) -> RgbdImage:
    return hardware.cameras["wrist"].capture()


def believed(bodies: tuple[TrueBody, ...], shift: tuple[float, float]) -> list[BeliefObject]:
    """Return the bodies as a miscalibrated camera reports them: shifted, turned by 2°."""
    turn = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, math.radians(2)))
    objects: list[BeliefObject] = []
    for b in bodies:
        x, y, z = b.pose.position
        pose = Pose((x + shift[0], y + shift[1], z), (turn @ Pose((0, 0, 0), b.pose.orientation)).orientation)
        objects.append(BeliefObject(b.kind, b.form, b.shape, b.colour, pose, 0.001, 0.01, 0.9, 0.0, id=b.id))
    return objects


def test_the_grammar_of_a_camera_on_the_hand() -> None:
    text = """\
picktree: 1
kind: scene
base: three_bins
cameras:
  wrist: {on: hand, at: [70 mm, 0, -60 mm], look_at: [0, 0, 70 mm]}
"""
    overhead, wrist = parse_scene(text, Path("scene.yaml")).cameras
    assert (overhead.on, wrist.on) == ("world", "hand")
    assert wrist.pose.position == (0.07, 0.0, -0.06)
    forward = wrist.pose.rotation()[:, 2]
    assert forward == pytest.approx(np.array([-0.07, 0.0, 0.13]) / math.hypot(0.07, 0.13))


def test_it_is_believed_where_the_encoders_say_and_sees_from_where_it_truly_is() -> None:
    exact, off = posed(Pose()), posed(OFF)
    one, other = shot(exact), shot(off)
    mount = scene().cameras[1].pose
    assert one.camera_in_world.distance(MODEL.tcp(OVER) @ mount) < 1e-9
    assert other.camera_in_world == one.camera_in_world
    assert not np.array_equal(one.colour, other.colour)
    exact.arm.set(HOME, np.zeros(7))
    assert shot(exact).camera_in_world.distance(MODEL.tcp(HOME) @ mount) < 1e-9


def test_the_table_is_where_the_picture_shows_it() -> None:
    image = shot(posed(Pose()))
    sight = PosedCamera.at(image.intrinsics, image.camera_in_world)
    height = sight.heights(image.depth.astype(np.float64))
    assert float(np.median(np.abs(height[image.depth > 0.2]))) < 3e-4


def test_what_is_nearer_than_it_can_measure_has_no_depth() -> None:
    camera = replace(scene().cameras[1], near=0.08)
    near = replace(scene(), cameras=(scene().cameras[0], camera))
    hardware = KinematicHardware(near, MODEL.description, 4)
    depth = shot(hardware).depth
    assert depth[depth > 0].min() >= 0.08
    assert (depth == 0).sum() > 500  # the fingers


def test_depth_has_a_floor_of_noise_from_near() -> None:
    camera = scene().cameras[1]
    rng = np.random.default_rng(1)
    near, far = (np.full((100, 100), z, dtype=np.float32) for z in (0.1, 0.7))
    assert float(np.std(noisy_depth(near, camera, rng))) == pytest.approx(MIN_DEPTH_DEVIATION, rel=0.05)
    assert float(np.std(noisy_depth(far, camera, rng))) == pytest.approx(0.002, rel=0.05)
    assert np.array_equal(noisy_depth(near, replace(camera, depth_noise=0.0), rng), near)


def test_the_same_pictures_come_after_a_checkpoint() -> None:
    hardware = PhysicsHardware(scene(), MODEL.description, 5)
    camera = hardware.cameras["wrist"]
    camera.capture()
    resumed = PhysicsHardware.resume(scene(), MODEL.description, 5, hardware.checkpoint())
    mine, theirs = camera.capture(), resumed.cameras["wrist"].capture()
    assert np.array_equal(mine.colour, theirs.colour)
    assert np.array_equal(mine.depth, theirs.depth)
    assert mine.camera_in_world == theirs.camera_in_world


@pytest.mark.parametrize("error", [Pose(), OFF])
def test_the_fingers_show_how_the_camera_is_mounted(error: Pose) -> None:
    hardware = posed(error)
    image = shot(hardware)
    tcp = MODEL.tcp(OVER)
    true = PosedCamera.at(image.intrinsics, tcp @ scene(error).cameras[1].pose @ error)
    # Height and tilt are the table's to tell: here they are right already.
    turn = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, 0.02 if error is OFF else 0.0)).rotation()
    shift = np.array([0.006, -0.005, 0.0]) if error is OFF else np.zeros(3)
    before = PosedCamera.along(image.intrinsics, true.origin + shift, turn @ true.rotation)
    fingers = RobotMask(MODEL).fingers(OVER, hardware.gripper.width)
    after = register_hand_camera(before, image.depth.astype(np.float64), fingers)
    assert np.linalg.norm(after.origin - true.origin) < 3e-4
    assert after.apart(true, 0.2) < 6e-4


def test_without_fingers_in_view_nothing_is_corrected() -> None:
    image = shot(posed())
    sight = PosedCamera.at(image.intrinsics, image.camera_in_world)
    assert register_hand_camera(sight, image.depth.astype(np.float64), ()) is sight
    far = np.full(image.depth.shape, 0.5)
    assert register_hand_camera(sight, far, RobotMask(MODEL).fingers(OVER, 0.06)) is sight


@pytest.mark.parametrize("error", [Pose(), OFF])
def test_known_items_are_followed_to_where_they_truly_are(error: Pose) -> None:
    hardware = posed(error)
    image = shot(hardware)
    perception = Perception(scene(error), MODEL)
    objects = believed(hardware.truth(), (0.006, -0.005))
    found = perception.track(image, OVER, hardware.gripper.width, None, objects)
    true = {body.id: body.pose for body in hardware.truth()}
    seen = [s for s in found if math.isfinite(s.misfit)]
    assert len({s.object for s in seen}) >= 3
    for one in {o.id for o in objects if any(s.object == o.id for s in seen)}:
        away = min(s.pose.distance(true[one]) for s in seen if s.object == one)
        assert away < 1.5e-3, one


def test_the_hand_is_nothing_that_stands_in_the_way() -> None:
    hardware = posed(OFF)
    perception = Perception(scene(OFF), MODEL)
    view = perception.detect(shot(hardware), OVER, hardware.gripper.width, None)
    true = [body.pose for body in hardware.truth()]
    assert view.detections
    for found in view.detections:
        assert min(found.pose.distance(pose) for pose in true) < 2e-3
    for thing in view.unexplained:
        assert min(thing.pose.distance(pose) for pose in true) < 0.03, thing


def test_an_answer_does_not_depend_on_what_was_asked_before() -> None:
    hardware = posed(OFF)
    image, width = shot(hardware), hardware.gripper.width
    fresh = Perception(scene(OFF), MODEL).detect(image, OVER, width, None)
    hardware.arm.set(HOME, np.zeros(7))
    used = Perception(scene(OFF), MODEL)
    used.detect(shot(hardware), HOME, width, None)
    again = used.detect(image, OVER, width, None)
    assert again.detections == fresh.detections
    assert np.array_equal(again.reach, fresh.reach)


def test_a_near_picture_is_taken_as_coarse_as_recognising_needs() -> None:
    image = shot(posed())
    near = replace(image, depth=np.full(image.depth.shape, 0.2, dtype=np.float32))
    coarse = downsample(near)
    assert (coarse.intrinsics.fx, coarse.intrinsics.cx) == (near.intrinsics.fx / 2, near.intrinsics.cx / 2)
    assert np.array_equal(coarse.colour, near.colour[::2, ::2])
    far = replace(image, depth=np.full(image.depth.shape, 0.8, dtype=np.float32))
    assert downsample(far) is far


def test_items_that_fill_the_picture_do_not_tilt_it() -> None:
    carton = CatalogueEntry("carton", "box", Box((0.09, 0.09, 0.04)), 0.15, 0.6)
    spawn = replace(scene().spawn[0], counts={"carton": 4}, area=((0.42, -0.11), (0.62, 0.11)), gap=0.004)
    crowded = replace(scene(OFF), catalogue=(carton,), spawn=(spawn,))
    hardware = KinematicHardware(crowded, MODEL.description, 1)
    low = InverseKinematics(MODEL).descend(down(0.5, 0.0, 0.12), OVER)
    assert low is not None
    hardware.arm.set(low, np.zeros(7))
    view = Perception(crowded, MODEL).detect(shot(hardware), low, hardware.gripper.width, None)
    true = MODEL.tcp(low) @ crowded.cameras[1].pose @ OFF
    assert view.sight.apart(PosedCamera.at(view.sight.intrinsics, true), 0.2) < 1.5e-3
