"""Pictures in which only some things move, what is written into them, and from where they are taken."""

import math

import numpy as np
import pytest

from picktree.analysis.render import Caption, CaptionFailure, PictureView, parse_size, parse_view, write
from picktree.analysis.render.renderer import MeshRenderer, render
from picktree.files import PicktreeError
from picktree.logs.triangle_meshes import Mesh, join_meshes, shape_mesh
from picktree.world import Box, Pose, Sphere

VIEW = PictureView(target=(0.0, 0.0, 0.0), distance=2.0, elevation=math.radians(40), fov=math.radians(60))
SIZE = (240, 160)
TABLE = shape_mesh(Box((1.2, 1.2, 0.04)), (0.7, 0.7, 0.7)).placed(Pose((0.0, 0.0, -0.02)))
WALL = shape_mesh(Box((0.05, 0.5, 0.3)), (0.2, 0.3, 0.8)).placed(Pose((-0.3, 0.0, 0.15)))
BALL = shape_mesh(Sphere(0.12), (0.9, 0.1, 0.1))
PLACES = (Pose((0.1, 0.1, 0.12)), Pose((-0.15, -0.2, 0.4)), Pose((0.5, 0.3, 0.12)))


def whole(place: Pose) -> Mesh:
    return join_meshes([TABLE, WALL, BALL.placed(place)])


def test_what_stands_still_need_not_be_drawn_again() -> None:
    studio = MeshRenderer(join_meshes([TABLE, WALL]), VIEW, SIZE)
    ball = studio.model(BALL)
    for place in PLACES:  # in one studio, so that nothing of a picture may stay for the next
        drawn = studio.picture([(ball, place)]).astype(int)
        anew = MeshRenderer(whole(place), VIEW, SIZE).picture([]).astype(int)
        difference = np.abs(drawn - anew).max(axis=2)
        assert difference.max() < 40
        assert (difference > 3).mean() < 0.0015
        assert difference.mean() < 0.03


def test_a_picture_is_drawn_again_to_the_last_bit() -> None:
    studio = MeshRenderer(join_meshes([TABLE, WALL]), VIEW, SIZE)
    ball = studio.model(BALL)
    first = studio.picture([(ball, PLACES[0])])
    studio.picture([(ball, PLACES[1])])
    np.testing.assert_array_equal(first, studio.picture([(ball, PLACES[0])]))


def test_edges_are_smooth() -> None:
    box = shape_mesh(Box((0.5, 0.5, 0.5)), (0.1, 0.1, 0.1)).placed(Pose((0.0, 0.0, 0.5)))
    rough, smooth = (render(box, VIEW, SIZE, fine=fine).astype(int).sum(axis=2) for fine in (1, 2))
    # Where the rough picture jumps from background to box, the smooth one has shades between.
    jumps = np.abs(np.diff(rough, axis=1)) > 400
    assert jumps.sum() > 40
    assert (np.abs(np.diff(smooth, axis=1))[jumps] < 400).mean() > 0.4


def test_a_point_is_projected_to_where_it_is_drawn() -> None:
    place = Pose((0.3, -0.2, 0.2))
    ball = shape_mesh(Sphere(0.03), (0.9, 0.05, 0.05)).placed(place)
    picture = render(ball, VIEW, SIZE).astype(int)
    rows, columns = np.nonzero(picture[:, :, 0] > picture[:, :, 1] + 60)
    column, row, depth = VIEW.project(np.array([place.position]), SIZE)[0]
    assert (columns.mean() + 0.5, rows.mean() + 0.5) == pytest.approx((column, row), abs=0.7)
    assert depth == pytest.approx(np.linalg.norm(VIEW.eye() - place.position), rel=0.05)


def test_a_caption_leaves_the_picture_above_it_alone() -> None:
    picture = np.full((300, 480, 3), 200, np.uint8)
    write(picture, Caption(12.3, "Grasp", "red_block_1", "3 of 12 items done"))
    changed = np.flatnonzero((picture != 200).any(axis=(1, 2)))
    assert changed[0] > 270 and changed[-1] == 299
    ink = (picture.sum(axis=2) < 300).any(axis=0)
    assert ink[:240].any() and ink[300:].any() and not ink[:8].any() and not ink[-8:].any()


@pytest.mark.parametrize("time", [0.5, 9999.9, 86_400.0, 1_000_000.0])
def test_a_time_of_any_length_is_apart_from_what_follows(time: float) -> None:
    alone, followed = (np.full((600, 960, 3), 200, np.uint8) for _ in range(2))
    write(alone, Caption(time))
    write(followed, Caption(time, "Grasp"))
    begin = np.flatnonzero((followed != alone).any(axis=(0, 2)))[0]
    end = np.flatnonzero((alone.sum(axis=2) < 300).any(axis=0))[-1]
    assert 5 < begin - end < 90


def test_a_failure_stands_in_red_above_the_line_and_on_the_bar() -> None:
    plain, failed = (np.full((300, 480, 3), 200, np.uint8) for _ in range(2))
    write(plain, Caption(1.0, elapsed=0.5))
    write(failed, Caption(1.0, trouble=CaptionFailure("grasp.missed", "x" * 500), elapsed=0.5, marks=(0.25,)))

    def red(picture: np.ndarray) -> np.ndarray:
        return (picture[:, :, 0] > 150) & (picture[:, :, 1] < 90)

    assert not red(plain).any()
    rows, columns = np.nonzero(red(failed[:278]))
    assert rows.min() > 200 and np.ptp(columns) > 300 and columns.max() < 472
    assert set(np.flatnonzero(red(failed)[-1])) == {120, 121}


def test_a_view_has_a_name_or_is_given_in_degrees_and_metres() -> None:
    assert parse_view("corner") == PictureView()
    view = parse_view("-30, 25, 2.4")
    assert view.azimuth == pytest.approx(math.radians(-30)) and view.distance == 2.4
    with pytest.raises(PicktreeError) as raised:
        parse_view("above")
    assert str(raised.value) == (
        "view 'above': write corner, front, left, right, top, close, or AZIMUTH,ELEVATION,DISTANCE "
        "in degrees and metres, as in -30,25,2.4"
    )
    with pytest.raises(PicktreeError) as raised:
        parse_view("0,95,2")
    assert str(raised.value) == (
        "view '0,95,2': the elevation goes from -89 to 89 degrees, the distance from 0.3 to 15 m"
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("wide", "size 'wide': write WIDTHxHEIGHT in pixels, as in 960x600"),
        ("9600x600", "size '9600x600': each side goes from 64 to 4096 pixels"),
    ],
)
def test_a_size_is_given_in_pixels(text: str, said: str) -> None:
    assert parse_size("320x200") == (320, 200)
    with pytest.raises(PicktreeError) as raised:
        parse_size(text)
    assert str(raised.value) == said
