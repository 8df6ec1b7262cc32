"""Courses that search a hole: in a world of points, where nothing but the foot of a peg touches anything."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from picktree.robot.control import (
    BelievedHole,
    ContactState,
    HeldPeg,
    InsertionMotion,
    InsertionParameters,
    Search,
)
from picktree.robot.control.peg_insertion import (
    CLEAR_FOOT_HEIGHT,
    SettlingDetector,
    grid,
    rotation_about,
    spiral,
)

PERIOD = 1 / 240
LINEAR = 600.0
UP = np.array([0.0, 0.0, 1.0])
DOWN = np.diag([1.0, -1.0, -1.0])
FOOT = np.array([0.0, 0.0, 0.04])
"""In the frame of a TCP that points down."""
PEG = HeldPeg(FOOT, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.015, 0.0]), True)


@dataclass
class Board:
    """A level board with a hole beside its believed middle, into which the foot goes when it is near."""

    beside: tuple[float, float]
    near: float = 0.0006
    floor: float = 0.03
    """Depth at which the foot stands, m."""
    surface: float = 0.0
    furthest: float = 0.0
    """Greatest distance of the foot from the believed middle so far, m."""

    def height(self, foot: np.ndarray, before: float) -> float:
        """Of what is below the foot, which was at the height `before`."""
        self.furthest = max(self.furthest, math.hypot(foot[0], foot[1]))
        into = math.hypot(foot[0] - self.beside[0], foot[1] - self.beside[1]) <= self.near
        return self.surface - (self.floor if into or before < self.surface - 1e-6 else 0.0)


def played(course: InsertionMotion, board: Board, most: float = 60.0) -> tuple[np.ndarray, float]:
    """The TCP in the end, and when that was. It follows its anchor at once, and sinks where it is pressed."""
    position, rotation = np.array([0.0, 0.0, 0.052]), DOWN
    course.start(position.copy(), rotation.copy())
    force, time = np.zeros(3), 0.0
    while not course.finished and time < most:
        time += PERIOD
        course.advance(ContactState(time, PERIOD, force, np.zeros(3), position.copy(), rotation.copy()))
        wanted = course.position.copy()
        wanted[2] += course.wrench[2] / LINEAR
        rotation = course.rotation.copy()
        step = np.clip(wanted - position, -0.05 * PERIOD, 0.05 * PERIOD)
        before = float((position + rotation @ FOOT)[2])
        position = position + step
        foot = position + rotation @ FOOT
        below = board.height(foot, before) - foot[2]
        force = np.zeros(3)
        if below > 0.0:
            position[2] += below
            force = UP * LINEAR * max(0.0, float(position[2] - wanted[2]))
    return position, time


def searching(way: Search, board: Board, depth: float = 0.03, **touch: float) -> InsertionMotion:
    mouth = BelievedHole(np.zeros(3), UP, 0.031, depth, 0.008)
    course = InsertionMotion(PEG, mouth, InsertionParameters(**touch), way, LINEAR)  # type: ignore[arg-type]
    played(course, board)
    assert course.finished
    return course


@pytest.mark.parametrize("beside", [(0.0, 0.0), (0.003, -0.002), (-0.005, 0.005), (0.0, -0.0075)])
def test_a_spiral_finds_a_hole_within_its_radius(beside: tuple[float, float]) -> None:
    course = searching("spiral", Board(beside))
    assert (course.outcome, course.tried) == ("in", ["spiral"])
    assert course.depth == pytest.approx(0.03, abs=1e-3)
    assert course.searched == pytest.approx(math.hypot(*beside), abs=1.5e-3)


def test_the_surface_is_felt_wherever_it_is() -> None:
    course = searching("spiral", Board((0.002, 0.0), surface=0.003))
    assert (course.outcome, course.pulled) == ("in", 0)
    assert course.surface == pytest.approx(0.003, abs=3e-4)
    assert course.depth == pytest.approx(0.03, abs=1e-3)


def test_a_hole_further_away_is_not_found_and_the_peg_ends_above() -> None:
    mouth = BelievedHole(np.zeros(3), UP, 0.031, 0.03, 0.003)
    course = InsertionMotion(PEG, mouth, InsertionParameters(attempts=1), "spiral", LINEAR)
    tcp, _ = played(course, Board((0.006, 0.0)))
    assert course.outcome == "not found"
    assert course.searched == pytest.approx(0.003, abs=2e-4)
    assert (tcp + course.rotation @ FOOT)[2] > 0.9 * CLEAR_FOOT_HEIGHT


def test_a_drop_further_away_than_the_hole_can_be_is_another_hole_or_the_edge() -> None:
    mouth = BelievedHole(np.array([0.012, 0.0, 0.0]), UP, 0.031, 0.03, 0.008)
    course = InsertionMotion(PEG, mouth, InsertionParameters(attempts=1), "none", LINEAR)
    played(course, Board((0.0, 0.0)))
    assert course.outcome == "not found"


def test_a_leaning_peg_slides_no_further_than_the_furthest_wall_can_be() -> None:
    board = Board((1.0, 1.0))
    course = searching("tilt", board, attempts=1)
    assert course.outcome == "not found"
    assert board.furthest < 0.02  # m; its lowest point is 15 mm ahead of the foot


def test_without_a_search_only_a_hole_right_below_is_found() -> None:
    assert searching("none", Board((0.0, 0.0))).outcome == "in"
    beside = searching("none", Board((0.002, 0.0)), attempts=1)
    assert (beside.outcome, beside.tried) == ("not found", ["straight down"])


def test_after_a_tilt_that_finds_nothing_comes_a_spiral() -> None:
    # Nothing blocks a leaning peg here: this world has no walls.
    course = searching("tilt", Board((0.004, 0.0)))
    assert (course.outcome, course.tried) == ("in", ["tilt", "spiral"])


def test_a_peg_that_stands_too_high_is_pulled_back_and_at_last_drawn_out() -> None:
    mouth = BelievedHole(np.zeros(3), UP, 0.031, 0.03, 0.008)
    course = InsertionMotion(PEG, mouth, InsertionParameters(pulls=2, attempts=2), "spiral", LINEAR)
    tcp, _ = played(course, Board((0.002, 0.0), floor=0.012))
    assert (course.outcome, course.tried, course.pulled) == ("jammed", ["spiral", "spiral"], 4)
    assert course.deepest == pytest.approx(0.012, abs=1e-3)
    assert (tcp + course.rotation @ FOOT)[2] > 0.9 * CLEAR_FOOT_HEIGHT


def test_a_hole_without_a_bottom_is_none() -> None:
    course = searching("spiral", Board((0.002, 0.0), floor=0.06))
    assert course.outcome == "no bottom"


def test_less_deep_than_the_bottom_when_that_is_asked_for() -> None:
    assert searching("spiral", Board((0.002, 0.0), floor=0.010), depth=0.010).outcome == "in"


def test_turns_of_a_spiral_leave_no_more_than_the_pitch_between_them() -> None:
    points = np.array(list(spiral(0.001, 0.008, 0.0002)))
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert steps.max() < 0.00024
    assert np.linalg.norm(points, axis=1).max() <= 0.008
    for angle in np.linspace(0.0, 2 * math.pi, 24):
        for radius in np.linspace(0.0, 0.0074, 12):
            at = radius * np.array([math.cos(angle), math.sin(angle)])
            assert np.linalg.norm(points - at, axis=1).min() < 0.0006


@pytest.mark.parametrize(("spacing", "radius"), [(0.02, 0.008), (0.011, 0.012), (0.004, 0.012)])
def test_a_grid_leaves_nothing_far_from_its_points(spacing: float, radius: float) -> None:
    points = np.array(list(grid(spacing, radius)))
    assert tuple(points[0]) == (0.0, 0.0)
    assert np.linalg.norm(points, axis=1).max() <= radius
    for angle in np.linspace(0.0, 2 * math.pi, 36):
        for far in np.linspace(0.0, radius, 12):
            at = far * np.array([math.cos(angle), math.sin(angle)])
            assert np.linalg.norm(points - at, axis=1).min() < 0.65 * spacing


def test_what_changes_little_for_a_while_stands() -> None:
    stand = SettlingDetector(0.1, 0.001)

    def after(value: Callable[[float], float]) -> list[bool]:
        return [stand.since(k * 0.01, value(k * 0.01)) for k in range(1, 31)]

    told = after(lambda t: min(t, 0.1))
    assert told.index(True) * 0.01 == pytest.approx(0.19, abs=0.015)
    assert all(told[told.index(True) :])


def test_a_turn_is_a_rotation_about_its_axis() -> None:
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    turn = rotation_about(axis, 0.7)
    assert np.allclose(turn @ turn.T, np.eye(3))
    assert np.allclose(turn @ axis, axis)
    assert np.trace(turn) == pytest.approx(1.0 + 2.0 * math.cos(0.7))
    assert np.allclose(
        rotation_about(np.array([0.0, 0.0, 1.0]), math.pi / 2) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
    )
