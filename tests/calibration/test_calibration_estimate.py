"""Calibration from views and touches whose truth is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.robot.calibration import CalibrationEstimate, estimate
from picktree.robot.calibration.calibration_targets import touch_points
from picktree.robot.calibration.estimation import camera_in_tcp, spread
from picktree.robot.calibration.observations import CalibrationData, DetectedTile, TargetImage, TargetTouch
from picktree.robot.calibration.target_detection import area_and_centroid, pixels_of
from picktree.robot.calibration.viewpoints import viewpoints
from picktree.world import Array, Intrinsics, Pose
from picktree.world.scene.description import tiles_on

SIZE = (0.18, 0.16, 0.05)
TILES = tiles_on(SIZE)
OPTICS = Intrinsics(320, 240, 207.8, 207.8, 160.0, 119.0)
TARGET = Pose.from_rpy((0.5, 0.02, 0.026), (0.01, -0.02, 0.4))
BELIEVED_TARGET = Pose.from_rpy((0.504, 0.017, 0.025), (0.0, 0.0, 0.37))
CAMERA = Pose.from_rpy((0.07, 0.0, -0.06), (-0.49, 0.0, 1.571))
"""Pose of the camera on the hand as believed, in the hand's frame."""
TRULY = CAMERA @ Pose.from_rpy((0.005, -0.004, 0.0048), (0.02, -0.02, 0.02))
OVERHEAD = Pose.from_rpy((0.5, 0.0, 0.8), (math.pi, 0.01, -1.55))
TOOL = Pose((0.002, -0.0015, 0.002))
TIPS = np.array([(x, y, z) for x in (-0.009, 0.009) for y in (-0.014, 0.014) for z in (-0.01, 0.007)])
NO_TIPS = np.zeros((1, 3))


def seen(optical: Pose, rng: np.random.Generator, pictures: int = 1) -> tuple[DetectedTile, ...]:
    """The squares through a camera that truly is there, with noise as in pictures."""
    target = optical.inverse() @ TARGET
    found: list[DetectedTile] = []
    for n, tile in enumerate(TILES):
        area, centroid = area_and_centroid(pixels_of(target.apply(tile.corners()), OPTICS)[None])
        size = int(abs(area[0]))
        u, v = (float(c) for c in centroid[0] + rng.normal(0.0, 0.05 + 0.3 / math.sqrt(size), 2))
        normal, on_top = target.rotation()[:, 2], target.apply(np.array(tile.centre))
        ray = np.array([(u - OPTICS.cx) / OPTICS.fx, (v - OPTICS.cy) / OPTICS.fy, 1.0])
        depth = float(normal @ on_top / (normal @ ray))
        sigma = 0.002 * (depth / 0.7) ** 2 / math.sqrt(size * pictures)
        found.append(DetectedTile(n, (u, v), depth + float(rng.normal(0.0, sigma)), (u, v), sigma, size))
    return tuple(found)


FROM_AFAR = seen(OVERHEAD, np.random.default_rng(5))


def shots(rng: np.random.Generator, count: int = 12) -> tuple[TargetImage, ...]:
    """Return images of the camera on the hand, which is not where it is believed to be."""
    places = [place.camera_in_world[0] for place in viewpoints(TARGET, SIZE, OPTICS, count)]
    return tuple(
        TargetImage("wrist", True, OPTICS, optical @ TRULY.inverse(), CAMERA, seen(optical, rng))
        for optical in places
    )


def touches(rng: np.random.Generator) -> tuple[TargetTouch, ...]:
    """Against the true faces with the true tool; the encoders say where it is believed to be."""
    found: list[TargetTouch] = []
    for n, contact in enumerate(touch_points(TARGET, SIZE, TIPS, 0.0)):
        truly, force = contact.tcp[0], 3.0 if n % 2 else 6.0
        given_way = -3e-5 * force + float(rng.normal(0.0, 2e-5))
        truly = truly.shifted(np.array(contact.normal) * given_way)
        found.append(TargetTouch(contact.face, truly @ TOOL.inverse(), force, contact.name))
    return tuple(found)


def known(evidence: CalibrationData) -> CalibrationEstimate:
    return estimate(evidence, TILES, SIZE, BELIEVED_TARGET)


def scores(found: Array, truly: Array, sigma: Array) -> Array:
    return np.abs(found - truly) / sigma


def test_a_camera_on_the_hand_and_the_tool_are_found() -> None:
    rng = np.random.default_rng(1)
    found = known(CalibrationData(shots(rng), touches(rng), TIPS))
    (camera,), tool = found.cameras, found.tool
    assert tool is not None
    assert math.dist(tool.offset, TOOL.position) < 1e-4
    # In the frame of the corrected TCP.
    assert (Pose(tool.offset) @ camera.pose).distance(TRULY) < 1e-4
    assert camera.pose.angle(TRULY) < math.radians(0.03)
    assert found.target.distance(TARGET) < 1e-4
    assert camera.before == CAMERA
    assert camera.turned == pytest.approx(camera.pose.angle(CAMERA))


def test_what_is_said_to_be_known_is_known() -> None:
    """Errors over their standard deviations, of cameras, tool and turn, over several draws."""
    all_of_them: list[Array] = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        afar = TargetImage("overhead", False, OPTICS, Pose(), OVERHEAD, seen(OVERHEAD, rng, pictures=50))
        found = known(CalibrationData((*shots(rng, 7), afar), touches(rng), TIPS))
        wrist, overhead = found.cameras
        tool = found.tool
        assert tool is not None
        undone = Pose(tool.offset) @ wrist.pose
        for camera, truly in ((replace(wrist, pose=undone), TRULY), (overhead, OVERHEAD)):
            here, there = np.array(camera.pose.position), np.array(truly.position)
            all_of_them.append(scores(here, there, np.array(camera.deviation.position)))
            turn = Pose(orientation=camera.pose.orientation) @ Pose(orientation=truly.orientation).inverse()
            x, y, z, w = turn.orientation
            turned = 2.0 * math.copysign(1.0, w) * np.array([x, y, z])
            all_of_them.append(scores(turned, np.zeros(3), np.array(camera.deviation.angle)))
        all_of_them.append(scores(np.array(tool.offset), np.array(TOOL.position), np.array(tool.deviation)))
    together = np.concatenate(all_of_them)
    assert (together < 2.0).mean() > 0.9
    # They do not say too much of themselves either.
    assert float(np.median(together)) > 0.15


def test_a_square_that_is_taken_for_another_does_no_harm() -> None:
    rng = np.random.default_rng(2)
    views = list(shots(rng))
    u, v = views[3].tiles[2].pixel
    wrong = replace(views[3].tiles[2], pixel=(u + 6.0, v - 4.0))
    views[3] = replace(views[3], tiles=(*views[3].tiles[:2], wrong, *views[3].tiles[3:]))
    (camera,) = known(CalibrationData(tuple(views), (), NO_TIPS)).cameras
    assert camera.pose.distance(TRULY) < 3e-4


def test_a_camera_that_hangs_still_sees_a_target_that_was_felt() -> None:
    rng = np.random.default_rng(3)
    afar = TargetImage(
        "overhead", False, OPTICS, Pose(), OVERHEAD.shifted((0.005, 0.004, 0.003)), seen(OVERHEAD, rng, 50)
    )
    (camera,) = known(CalibrationData((afar,), touches(rng), TIPS)).cameras
    assert camera.pose.distance(OVERHEAD) < 1.5e-3
    assert camera.pose.angle(OVERHEAD) < math.radians(0.3)
    assert camera.moved == pytest.approx(math.sqrt(50) * 1e-3, abs=1.5e-3)


def test_the_closed_form_is_near_by_itself() -> None:
    views = shots(np.random.default_rng(4))
    assert spread(views) > math.radians(60)
    start = camera_in_tcp(views, TILES)
    assert start.distance(TRULY) < 4e-3
    assert start.angle(TRULY) < math.radians(0.5)


@pytest.mark.parametrize(
    ("evidence", "message"),
    [
        (
            CalibrationData(shots(np.random.default_rng(5), 3), (), NO_TIPS),
            "wrist: the target was seen from 3 places; 4 are needed",
        ),
        (
            CalibrationData(shots(np.random.default_rng(5), 1) * 5, (), NO_TIPS),
            "wrist: the hand was turned about axes that are 0° apart at most; 30° are needed to tell where "
            "the camera is",
        ),
        (
            CalibrationData(
                (
                    TargetImage(
                        "overhead", False, OPTICS, Pose(), OVERHEAD, seen(OVERHEAD, np.random.default_rng(5))
                    ),
                ),
                (),
                NO_TIPS,
            ),
            "the pose of the target is unknown: nothing touched it, and overhead is fixed; calibrate a "
            "camera on the hand or the tool with it",
        ),
    ],
)
def test_what_cannot_be_told_is_said(evidence: CalibrationData, message: str) -> None:
    with pytest.raises(PicktreeError) as caught:
        known(evidence)
    assert str(caught.value) == message


def test_a_tool_that_touches_do_not_tell_is_left() -> None:
    rng = np.random.default_rng(6)
    from_above = tuple(touch for touch in touches(rng) if touch.name in ("top 1", "top 2", "top 3"))
    found = known(CalibrationData(shots(rng), from_above, TIPS))
    assert found.tool is not None
    assert not found.tool.sure
    assert found.cameras[0].pose.distance(TRULY) < 2e-4


def test_records_of_views_and_touches_come_back_as_they_were() -> None:
    rng = np.random.default_rng(7)
    shot, touch = shots(rng, 1)[0], touches(rng)[4]
    assert TargetImage.from_event(shot.to_event("", "")) == shot
    assert TargetTouch.from_event(touch.to_event("", "")) == touch


def test_tips_meet_the_face_that_they_are_to_touch() -> None:
    for contact in touch_points(TARGET, SIZE, TIPS, math.pi / 2):
        for pose in contact.tcp:
            corners = TARGET.inverse().apply(pose.apply(TIPS))
            ahead = corners @ np.array(contact.face)
            assert float(ahead.min()) == pytest.approx(
                float(np.abs(np.array(contact.face)) @ np.array(SIZE)) / 2, abs=1e-9
            )
            beside = contact.face[2] == 0.0
            pads_length = float(np.ptp(TIPS[:, 2]))
            low = max(-0.1 * SIZE[2], SIZE[2] / 2 - 0.8 * pads_length)
            assert not beside or float(corners[:, 2].min()) == pytest.approx(low)
