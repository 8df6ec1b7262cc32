"""What a picture says of a body that is believed there: each limit from both sides, on made-up pictures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from picktree.robot.perception import BinView, segmentation
from picktree.robot.perception.view import BodyVisibility, Detection
from picktree.world import Array, Box, Pose, Sphere

from .synthetic_view import HEIGHT, HIGH, WIDE, painted, synthetic_view

BODY = Box((0.1, 0.1, 0.0002))
TOP = 0.95
"""Depth of its upper face; its sides are not seen."""


def at(x: float, y: float) -> Pose:
    return Pose((x, y, 0.0499))


def depth_of(body: float, rows: slice, columns: slice) -> Array:
    depth = np.full((HIGH, WIDE), HEIGHT)
    depth[rows, columns] = body
    return depth


@pytest.mark.parametrize(
    ("x", "y", "rows", "columns"),
    [
        (0.0, 0.0, slice(15, 26), slice(25, 36)),
        (0.152, -0.0665, slice(22, 33), slice(41, 52)),
        (-0.152, 0.076, slice(7, 18), slice(9, 20)),
    ],
)
def test_a_body_covers_its_pixels_and_no_others(x: float, y: float, rows: slice, columns: slice) -> None:
    """Its upper face is 10.5 pixels wide."""
    there = synthetic_view(depth_of(TOP, rows, columns)).look(BODY, at(x, y), "grey")
    assert there == BodyVisibility(121, 121, 0)
    gone = synthetic_view().look(BODY, at(x, y), "grey")
    assert gone == BodyVisibility(121, 121, 121)


@pytest.mark.parametrize(
    ("depth", "visible", "empty"),
    [
        (TOP - 0.011, 0, 0),  # behind something nearer
        (TOP - 0.009, 121, 0),
        (TOP + 0.009, 121, 0),
        (TOP + 0.011, 121, 121),
        (0.0, 0, 0),
    ],
)
def test_a_centimetre_of_depth_tells_what_is_there_from_what_is_not(
    depth: float, visible: int, empty: int
) -> None:
    assert synthetic_view(depth).look(BODY, at(0.0, 0.0), "grey") == BodyVisibility(121, visible, empty)


@pytest.mark.parametrize(
    ("depth", "colour", "visible", "empty"),
    [
        (TOP, "red", 121, 0),
        (TOP, "blue", 121, 121),
        (HEIGHT, "red", 121, 0),  # it may lie deeper than believed
        (TOP - 0.05, "red", 121, 0),
        (TOP - 0.009, "blue", 121, 121),
        (TOP - 0.011, "blue", 0, 0),
        (0.0, "red", 0, 0),
    ],
)
def test_of_a_colour_it_is_its_colour_that_tells(depth: float, colour: str, visible: int, empty: int) -> None:
    view = synthetic_view(depth, label=painted(colour))
    assert view.look(BODY, at(0.0, 0.0), "red") == BodyVisibility(121, visible, empty)


def test_pixels_that_tell_nothing_count_in_the_total_alone() -> None:
    blocked = np.zeros((HIGH, WIDE), dtype=np.bool_)
    blocked[15:20, 25:36] = True
    view = synthetic_view(HEIGHT, blocked=blocked)
    assert view.look(BODY, at(0.0, 0.0), "grey") == BodyVisibility(121, 66, 66)
    label = painted("red")
    label[15:18, 25:36] = segmentation.label_of("blue")
    view = synthetic_view(TOP, label=label)
    assert view.look(BODY, at(0.0, 0.0), "red") == BodyVisibility(121, 121, 33)


@pytest.mark.parametrize(
    ("x", "y", "visible"),
    [(0.285, 0.0, 5 * 11), (-0.285, 0.0, 6 * 11), (0.0, 0.19, 6 * 11), (0.0, -0.19, 5 * 11)],
)
def test_of_a_body_half_out_of_the_picture_the_rest_speaks(x: float, y: float, visible: int) -> None:
    look = synthetic_view(HEIGHT).look(BODY, at(x, y), "grey")
    assert look == BodyVisibility(110, visible, visible)


@pytest.mark.parametrize(("x", "y"), [(0.5, 0.0), (-0.5, 0.0), (0.0, 0.4), (0.0, -0.4)])
def test_of_a_body_out_of_the_picture_nothing_is_seen(x: float, y: float) -> None:
    look = synthetic_view(HEIGHT).look(BODY, at(x, y), "grey")
    assert look == BodyVisibility(110, 0, 0)
    assert look.hidden and not look.is_empty and not look.is_confirmed


def test_what_is_beside_or_behind_the_camera_is_too_near_to_judge() -> None:
    for z in (0.981, 1.0, 1.3):
        look = synthetic_view(HEIGHT).look(BODY, Pose((0.0, 0.0, z)), "grey")
        assert look == BodyVisibility(0, 0, 0)


def test_a_sphere_is_judged_by_its_surface() -> None:
    ball = Sphere(0.05)
    x, y = np.meshgrid(0.01 * (np.arange(WIDE) - 30), 0.01 * (20 - np.arange(HIGH)))
    # Rays (x, y, 1)·d meet the ball about depth 0.95.
    a, b, c = x * x + y * y + 1.0, -2 * 0.95, 0.95**2 - 0.05**2
    root = b * b - 4 * a * c
    depth = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0.0))) / (2 * a), HEIGHT)
    look = synthetic_view(depth).look(ball, Pose((0.0, 0.0, 0.05)), "grey")
    assert look == BodyVisibility(144, int((root > 0).sum()), 0)
    assert synthetic_view(HEIGHT).look(ball, Pose((0.0, 0.0, 0.05)), "grey").is_empty


@pytest.mark.parametrize(
    ("total", "visible", "empty", "seen_empty", "borne_out", "hidden"),
    [
        (10, 5, 5, False, False, True),
        (10, 6, 6, True, False, False),
        (100, 29, 29, False, False, True),
        (100, 30, 30, True, False, False),
        (100, 100, 69, False, False, False),
        (100, 100, 70, True, False, False),
        (100, 100, 11, False, False, False),
        (100, 100, 10, False, True, False),
        (100, 6, 0, False, True, True),
        (100, 5, 0, False, False, True),
        (10, 5, 0, False, False, True),
    ],
)
def test_what_is_to_be_said_of_a_place(
    total: int, visible: int, empty: int, seen_empty: bool, borne_out: bool, hidden: bool
) -> None:
    """Something with three tenths of it seen, and six pixels; empty with seven tenths of those."""
    look = BodyVisibility(total, visible, empty)
    assert (look.is_empty, look.is_confirmed, look.hidden) == (seen_empty, borne_out, hidden)


def test_what_is_not_seen_of_a_heap_is_as_it_was_before() -> None:
    nan = math.nan
    before, now = BinView(np.array([[0.1, 0.2], [nan, nan]])), BinView(np.array([[0.3, nan], [0.0, nan]]))
    np.testing.assert_equal(now.over(before).cells, [[0.3, 0.2], [0.0, nan]])
    assert now.over(None) is now
    assert (now.highest(), before.highest(), BinView(np.array([[nan]])).highest()) == (0.3, 0.2, 0.0)
    assert BinView(np.array([[-0.01, -0.02]])).highest() == -0.01


def test_a_detection_has_no_heading_and_lies_on_the_table_unless_it_is_said() -> None:
    seen = Detection("ball", "sphere", Sphere(0.02), "red", Pose(), 0.001, math.pi, 0.9)
    assert (seen.turn, seen.place) == (0.0, "table")
