"""Visual servoing of a hole: its pose, seen by the camera on the hand just before an insertion."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.robot.perception import detect_hole
from picktree.robot.planning import PoseGoal, Request
from picktree.world import Array, Failure, Intrinsics, ObjectId, Pose, corners, event_types, hole_geometry

from .replanning import follow_with_replanning

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing
    from picktree.world.scene import CameraDescription, Hole

MAX_MOUTH_OFFSET = 0.008
"""Greatest distance of a mouth from its believed place, m."""
LOOK_DISTANCES = (0.20, 0.24, 0.17)
"""Distances of the camera from the mouth, best first, m."""
FACE_MARGIN = 0.010
"""Width of the face around the mouth that the hand must not hide, m."""
HAND_MASK_MARGIN = 8
"""Margin around the hand's boxes in the picture, pixels."""
LOOK_TURNS = (0.0, 0.5, -0.5, 1.0, -1.0, 1.57, -1.57, 2.2, -2.2, 3.14)
"""Rotations of the hand about the hole's axis that are tried, rad, from the present one."""


def look_at_hole(world: World, hole_id: ObjectId, node: str) -> Doing[Pose | None]:
    """Return the pose of a hole's mouth in the world, as a camera on the hand sees it.

    z points out of the hole, x along a slot. None: the mouth is not recognised, or there is no such camera.
    The arm moves: it holds the camera over the hole so that fingers and held object are out of the way.
    Failures: those of motions; world.unknown_object when there is no such hole.
    """
    camera = next((c for c in world.description.cameras if c.on == "hand"), None)
    fixture, hole = hole_geometry.find_hole(world.scene, hole_id)
    if camera is None:
        return None
    believed = fixture.pose @ hole.pose
    if not (yield from _go(world, camera, hole, believed, node)):
        message = f"{hole_id}: nowhere within reach is it seen beside the hand"
        world.journal.note(event_types.ServoEvent(message, node, hole=hole_id))
        return None
    yield from world.control.settle()
    shot = yield from world.vision.capture(camera.name)
    seen = detect_hole(shot.image, hole, believed, MAX_MOUTH_OFFSET)
    if seen is None:
        message = f"{hole_id}: its mouth is not recognised from the hand"
        world.journal.note(event_types.ServoEvent(message, node, hole=hole_id))
        return None
    off, tilt = believed.distance(seen.pose), believed.angle(seen.pose)
    message = f"{hole_id}: seen {1000 * off:.1f} mm and {math.degrees(tilt):.1f}° from where it should be"
    world.journal.note(
        event_types.ServoEvent(message, node, hole=hole_id, off=off, turn=tilt, agreement=seen.agreement)
    )
    return seen.pose


def _go(world: World, camera: CameraDescription, hole: Hole, believed: Pose, node: str) -> Doing[bool]:
    """Move the arm to where the mouth is visible; False: there is no path to such a pose."""
    for distance in LOOK_DISTANCES:
        poses = views(world, camera, hole, believed, distance)
        if not poses:
            continue
        request = Request(PoseGoal(poses), scaling=world.handling.scaling(1.0))
        try:
            yield from follow_with_replanning(
                world,
                lambda request=request: world.plan.solve(request, node=node),
                guard=world.handling.guard,
                node=node,
            )
        except Failure as failure:
            if not failure.cause.name.startswith("planning."):
                raise
            continue
        return True
    return False


def views(
    world: World, camera: CameraDescription, hole: Hole, believed: Pose, distance: float
) -> tuple[Pose, ...]:
    """Return TCP poses in the world that show the mouth `distance` m from the camera, in the free part of the
    picture.

    The tool points into the hole. Empty: the part that the hand leaves free is too small.
    """
    intrinsics = _nominal_intrinsics(camera)
    hidden = _hand_mask(world, camera, intrinsics)
    room = cv2.distanceTransform((~hidden).astype(np.uint8), cv2.DIST_L2, 5)
    rows, columns = np.indices(hidden.shape)
    height, width = hidden.shape
    border = np.minimum(np.minimum(rows, height - 1 - rows), np.minimum(columns, width - 1 - columns)).astype(
        np.float64
    )
    room = np.minimum(np.asarray(room, dtype=np.float64), border)
    long = math.hypot(*hole.size) if hole.form != "round" else hole.size[0]
    needed = (long / 2 + MAX_MOUTH_OFFSET + FACE_MARGIN) * intrinsics.fx / distance
    row, column = (int(n) for n in np.unravel_index(int(room.argmax()), room.shape))
    if room[row, column] < needed:
        return ()
    ray = np.array([(column - intrinsics.cx) / intrinsics.fx, (row - intrinsics.cy) / intrinsics.fy, 1.0])
    in_tcp = camera.pose.apply(ray / np.linalg.norm(ray) * distance)
    return tuple(_tcp_over_mouth(believed, in_tcp, turn + _hand_yaw(world, believed)) for turn in LOOK_TURNS)


def _tcp_over_mouth(believed: Pose, in_tcp: Array, yaw: float) -> Pose:
    """Return the TCP pose that points into the hole, turned by `yaw` about its axis, with the mouth at
    `in_tcp`."""
    axes = believed.rotation() @ np.array(
        [[math.cos(yaw), math.sin(yaw), 0.0], [math.sin(yaw), -math.cos(yaw), 0.0], [0.0, 0.0, -1.0]]
    )
    return Pose.from_rotation(np.array(believed.position) - axes @ in_tcp, axes)


def _hand_yaw(world: World, believed: Pose) -> float:
    """Return the present rotation of the hand about the hole's axis, rad."""
    x = believed.rotation().T @ world.control.tcp.rotation()[:, 0]
    return math.atan2(float(x[1]), float(x[0]))


def _nominal_intrinsics(camera: CameraDescription) -> Intrinsics:
    """Return the camera's intrinsics by the scene file, accurate to a pixel."""
    width, height = camera.size
    focal = height / 2 / math.tan(camera.fov / 2)
    return Intrinsics(width, height, focal, focal, width / 2, height / 2)


def _hand_mask(world: World, camera: CameraDescription, intrinsics: Intrinsics) -> NDArray[np.bool_]:
    """Return the mask (h, w) of the hand, its fingers and the held object in the camera's picture."""
    robot, width = world.robot, world.gripper.width
    bodies = [pose.apply(corners(box)) for box, pose in robot.description.gripper.hand]
    bodies += [pose.apply(corners(box)) for box, pose in robot.finger_boxes(width)]
    held = world.scene.held
    if held is not None and held.object_in_tcp is not None:
        bodies.append(held.object_in_tcp.apply(corners(held.shape)))
    mask = np.zeros((intrinsics.height, intrinsics.width), dtype=np.uint8)
    to_camera = camera.pose.inverse()
    for points in bodies:
        seen = to_camera.apply(points)
        if (seen[:, 2] < camera.near / 2).all():
            continue
        seen[:, 2] = np.maximum(seen[:, 2], 0.01)
        pixels = seen[:, :2] / seen[:, 2:] * (intrinsics.fx, intrinsics.fy) + (intrinsics.cx, intrinsics.cy)
        rounded = np.clip(np.round(pixels), -8000, 8000).astype(np.int32)
        cv2.fillConvexPoly(mask, cv2.convexHull(rounded), 1)
    kernel = np.ones((2 * HAND_MASK_MARGIN + 1, 2 * HAND_MASK_MARGIN + 1), dtype=np.uint8)
    return cv2.dilate(mask, kernel).astype(np.bool_)
