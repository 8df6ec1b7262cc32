"""The picture shows what the log says, where it says it."""

import math
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from picktree.analysis.render import PictureView, bin_tints, draw, draw_robot, snapshot
from picktree.analysis.render.films import FrameSetup, FrameWorkers
from picktree.analysis.render.frames import moments
from picktree.analysis.render.renderer import LightingSetup, render
from picktree.analysis.render.viewpoint import VIEWS
from picktree.files import PicktreeError
from picktree.logs import RunLog
from picktree.logs.triangle_meshes import join_meshes, shape_mesh
from picktree.world import Box, Pose, Sphere
from picktree.world.robot_model import load_robot

ABOVE = PictureView(
    target=(0.0, 0.0, 0.0), distance=2.0, azimuth=0.0, elevation=math.radians(89.9), fov=math.radians(60)
)


def red(picture: np.ndarray) -> np.ndarray:
    r, g, b = (picture[:, :, k].astype(int) for k in range(3))
    return (r > 90) & (r > 2 * g) & (r > 2 * b)


def test_a_box_is_where_the_pinhole_says() -> None:
    box = shape_mesh(Box((0.2, 0.4, 0.1)), (0.9, 0.05, 0.05)).placed(Pose((0.3, 0.0, -0.05)))
    picture = render(box, ABOVE, (200, 200), LightingSetup(floor=-0.1))
    rows, columns = np.nonzero(red(picture))
    # Seen from above with +x down the picture's up axis: 1 m at 2 m distance is 100/(2·tan 30°) pixels.
    metre = 100 / (2 * math.tan(math.radians(30)))
    assert np.ptp(columns) + 1 == pytest.approx(0.4 * metre, abs=2)
    assert abs(rows.mean() - 99.5) == pytest.approx(0.3 * metre, abs=1.5)
    assert columns.mean() == pytest.approx(99.5, abs=0.6)


def test_what_is_nearer_hides_what_is_behind() -> None:
    below = shape_mesh(Box((0.2, 0.2, 0.1)), (0.9, 0.05, 0.05))
    above = shape_mesh(Sphere(0.3), (0.05, 0.9, 0.05)).placed(Pose((0.0, 0.0, 0.5)))
    for order in ((below, above), (above, below)):
        assert not red(render(join_meshes(order), ABOVE, (80, 80))).any()
    assert red(render(below, ABOVE, (80, 80))).any()


def test_a_shadow_falls_away_from_the_sun() -> None:
    ball = shape_mesh(Sphere(0.15)).placed(Pose((0.0, 0.0, 0.15)))
    picture = (
        render(ball, ABOVE, (120, 120), LightingSetup(floor=0.0, sun=(0.0, 1.0, 1.0))).astype(int).sum(axis=2)
    )
    left, right = picture[60, 43:50].mean(), picture[60, 70:77].mean()
    # In this view +y lies to the right, so the shadow lies to the left.
    assert left < right - 50


def test_an_object_that_was_removed_is_not_drawn(log_path: Path) -> None:
    with RunLog(log_path) as log:
        before, after = draw(log, 1.9, (320, 200), caption=False), draw(log, 2.1, (320, 200), caption=False)
    blue = [(p[:, :, 2] > 2.0 * p[:, :, 0]).sum() for p in (before, after)]
    assert blue[0] > 20
    assert blue[1] == 0


def test_a_bin_has_a_tint_of_its_items_in_pictures_and_films(troubled_log: Path, tmp_path: Path) -> None:
    size = (320, 240)
    view, found = VIEWS["top"], dict[str, set[int]]()
    with RunLog(troubled_log) as log:
        (moment,) = moments(log, [1.0], (0.0, 2.0))
        film_setup = FrameSetup(log.robot_model(), view, size, bin_tints(log))
        with FrameWorkers(film_setup, 1) as workers:
            (frame,) = workers.pictures([moment])
        still = draw(log, 1.0, size, view, caption=False)
        floors = [part for part in moment.shown.solid.fixed if part.id.endswith("_bin/0")]
    for part in floors:
        ((column, row, _),) = view.project(np.array([part.pose.position]), size)
        for picture in (still, frame):
            pixel = picture[int(row), int(column)].astype(int)
            found.setdefault(part.id, set()).add(int(np.argmax(pixel)) if np.ptp(pixel) > 30 else -1)
    strongest = {"red_bin/0": {0}, "green_bin/0": {1}, "blue_bin/0": {2}}
    assert found == {name: strongest[name] for name in found}
    assert len(found) >= 2


def test_a_moment_that_never_was_is_refused(log_path: Path, tmp_path: Path) -> None:
    with pytest.raises(PicktreeError) as raised:
        snapshot(log_path, 3.5, tmp_path / "picture.png")
    assert str(raised.value) == f"{log_path}: the run lasted 2.95 s; there is no moment 3.5 s"


def test_a_picture_of_an_unknown_kind_is_refused(log_path: Path, tmp_path: Path) -> None:
    output = tmp_path / "picture.xyz"
    with pytest.raises(PicktreeError, match=f"^{output}: the picture cannot be written: "):
        snapshot(log_path, 1.0, output, (64, 48))


def test_a_run_without_a_belief_has_no_picture(sample: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    from picktree.logs.recording import Recorder

    with Recorder(path, sample.RUN) as recorder:
        recorder.tick(0.0, sample.tick(0))
    with pytest.raises(PicktreeError) as raised:
        snapshot(path, 0.0, tmp_path / "picture.png")
    assert str(raised.value) == f"{path}: the log holds no belief at 0 s or before"


@pytest.mark.parametrize("name", ["panda", "xarm6", "ur10e"])
def test_a_robot_fills_its_picture_and_is_not_cut(name: str, tmp_path: Path) -> None:
    draw_robot(load_robot(name), tmp_path / "robot.png")
    read = cv2.imread(str(tmp_path / "robot.png"))
    assert read is not None
    picture = read.astype(int)
    away = np.abs(picture - picture[:, :1]).max(axis=2) > 12  # the background is even from left to right
    rows, columns = np.nonzero(away)
    spans = np.array([np.ptp(rows), np.ptp(columns)]) / picture.shape[:2]
    assert 0.75 < spans.max() < 1.0
    assert not away[[0, -1]].any() and not away[:, [0, -1]].any()
