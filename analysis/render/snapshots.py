"""Snapshots: images of one moment of a run, from its log alone, and of a robot at its home configuration."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from picktree.files import PicktreeError, file_system
from picktree.logs import RunLog, triangle_meshes
from picktree.logs.recording import require_picture_name, write_picture
from picktree.world import Array, Pose, vector3
from picktree.world.robot_model import RobotDescription, RobotModel, link_shapes

from .captions import write
from .frames import moments
from .rasterizer import Picture
from .renderer import render
from .scene_view import SceneRenderer, Show, bin_tints
from .viewpoint import PictureView

ROBOT_PICTURE_SIZE = (1000, 900)
PICTURE_SHARE = 0.88
"""Share of a picture's sides that the robot fills."""
FRAME_AXIS_LENGTH = 0.08
"""Length of the axes of a frame, m."""
_AXIS_COLOURS = ((214, 60, 60), (52, 168, 83), (66, 110, 235))
"""Colours of x, y, z."""


def draw_robot(robot: RobotDescription, path: Path) -> None:
    """Write a PNG of the robot's collision geometry at `home` with the gripper open, with base, flange and
    TCP.

    Raises PicktreeError for a mesh that cannot be read.
    """
    model = RobotModel(robot)
    home = model.named("home")
    mesh = home_mesh(robot)
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    view = PictureView(
        target=vector3(middle),
        azimuth=math.radians(35.0),
        elevation=math.radians(18.0),
    )
    view = replace(view, distance=_filling_distance(view, mesh.vertices - middle))
    picture = np.ascontiguousarray(render(mesh, view, ROBOT_PICTURE_SIZE))
    frames = {"base": robot.base_in_world, "flange": model.flange(home), "TCP": model.tcp(home)}
    for name, pose in frames.items():
        _frame(picture, view, name, pose)
    if not cv2.imwrite(str(path), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)):
        raise PicktreeError(f"{path} cannot be written")


def home_mesh(robot: RobotDescription) -> triangle_meshes.Mesh:
    """Return the bodies with which the robot collides, at `home` with the gripper open, in the world.

    Raises PicktreeError for a mesh that cannot be read.
    """
    model = RobotModel(robot)
    poses = model.link_poses(model.named("home"), robot.gripper.max_width)
    return triangle_meshes.join_meshes(
        [
            triangle_meshes.shape_mesh(part.shape).placed(part.pose_in_link).placed(pose)
            for part in link_shapes(robot.urdf)
            if (pose := poses.get(part.link)) is not None
        ]
    )


def _filling_distance(view: PictureView, offsets: Array) -> float:
    """Return the distance from which all points, given as offsets (n, 3) from the target, fill the picture,
    m."""
    right, down, forward = (offsets @ view.axes().T).T
    width, height = (
        PICTURE_SHARE * side / 2 / view.focal(ROBOT_PICTURE_SIZE[1]) for side in ROBOT_PICTURE_SIZE
    )
    return float((np.maximum(np.abs(right) / width, np.abs(down) / height) - forward).max())


def _frame(picture: np.ndarray, view: PictureView, name: str, pose: Pose) -> None:
    ends: Array = np.vstack([np.zeros(3), np.eye(3) * FRAME_AXIS_LENGTH])
    pixels = np.round(view.project(pose.apply(ends), ROBOT_PICTURE_SIZE)[:, :2]).astype(int)
    start = (int(pixels[0, 0]), int(pixels[0, 1]))
    for colour, (x, y), letter in zip(_AXIS_COLOURS, pixels[1:].tolist(), "xyz", strict=True):
        cv2.line(picture, start, (x, y), colour, 3, cv2.LINE_AA)
        cv2.putText(picture, letter, (x + 3, y + 3), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
    place = (start[0] + 10, start[1] - 10)
    cv2.putText(picture, name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 4, cv2.LINE_AA)
    cv2.putText(picture, name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (30, 30, 30), 1, cv2.LINE_AA)


SNAPSHOT_SIZE = (1280, 800)
_SAMPLES_PER_PIXEL = 2


def snapshot(
    log: RunLog | str | Path,
    at: float,
    output: Path,
    size: tuple[int, int] = SNAPSHOT_SIZE,
    view: PictureView | None = None,
    *,
    show: Show = "belief",
    caption: bool = True,
) -> None:
    """Draw the moment `at` (simulated s) into a PNG file.

    `belief` shows the robot's belief, `truth` the ground truth of at most a second earlier, `both` the belief
    with outlines of the truth. Raises PicktreeError when the log holds nothing of that moment or the image
    cannot be written.
    """
    require_picture_name(output)
    if isinstance(log, RunLog):
        picture = draw(log, at, size, view, show=show, caption=caption)
    else:
        with RunLog(log) as opened:
            picture = draw(opened, at, size, view, show=show, caption=caption)
    with file_system.whole([output], output) as (beside,):
        output.parent.mkdir(parents=True, exist_ok=True)
        write_picture(str(beside), picture)


def draw(
    log: RunLog,
    at: float,
    size: tuple[int, int] = SNAPSHOT_SIZE,
    view: PictureView | None = None,
    *,
    show: Show = "belief",
    caption: bool = True,
) -> Picture:
    """Return the image as RGB (h, w, 3)."""
    if not 0 <= at <= log.end + 1e-9:
        raise PicktreeError(f"{log.path}: the run lasted {log.end:.2f} s; there is no moment {at:g} s")
    (moment,) = moments(log, [at], (at, at), show=show)
    scenery = SceneRenderer(
        log.robot_model(), view or PictureView(), size, bin_tints(log), fine=_SAMPLES_PER_PIXEL
    )
    picture = scenery.single(moment.shown)
    if caption:
        write(picture, moment.caption)
    return picture
