"""What a stroke does by what it feels."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from picktree.robot.control import ContactState
from picktree.robot.manipulation.closed_loop_pushing import (
    PlanarEstimate,
    estimate_from_camera,
    fuse_estimates,
)
from picktree.robot.manipulation.stroke_execution import (
    BACK_OFF_TRAVEL,
    MAX_SINK,
    VERTICAL_DRAG_STIFFNESS,
    DragMotion,
    PushMotion,
)
from picktree.robot.manipulation.stroke_planning import ArcPath, straight
from picktree.world.planar_geometry import PlanarPose

PERIOD = 1 / 240
START = np.array([0.5, 0.0, 0.02])
TOOL = PlanarPose(-0.03, 0.0)
DOWN = np.diag([1.0, -1.0, -1.0])


def stroke(
    force: Callable[[float], float], way: float = 0.05, curvature: float = 0.0, *, through: bool = False
) -> PushMotion:
    """A stroke along x with the tool where it is told; `force` (N) against it by the carrier's way (m)."""
    path = (
        straight(PlanarPose(0.54, 0.0), way)
        if not curvature
        else ArcPath(PlanarPose(0.54, 0.0), ((way, curvature),))
    )
    course = PushMotion(path, TOOL, 0.01, 0.05, 8.0, 0.8, through=through)
    course.start(START.copy(), DOWN.copy())
    turn = 0.0
    for k in range(2000):
        against = -force(course.reached) * np.array([math.cos(turn), math.sin(turn), 0.0])
        felt = np.array([against[0], against[1], 0.0]) - 0.8 * course.acceleration
        course.advance(
            ContactState(
                k * PERIOD, PERIOD, felt, np.zeros(3), course.position.copy(), course.rotation.copy()
            )
        )
        turned = course.rotation @ DOWN.T
        turn = math.atan2(turned[1, 0], turned[0, 0])
        if course.finished:
            return course
    raise AssertionError("never finished")


def test_a_push_ends_where_its_way_ends_and_leaves_the_object() -> None:
    course = stroke(lambda way: 0.4 if way > 0.0 else 0.0)
    assert (course.blocked, course.lost, course.in_contact) == (False, False, True)
    assert course.touched_at == pytest.approx(0.002, abs=0.002)
    assert course.carrier.x == pytest.approx(0.59, abs=1e-4)
    assert course.position[0] == pytest.approx(0.56 - BACK_OFF_TRAVEL, abs=5e-4)


def test_what_does_not_move_stops_the_push() -> None:
    course = stroke(lambda way: max(0.0, 1500 * (way - 0.02)))
    assert course.blocked
    assert course.reached == pytest.approx(0.0253, abs=1e-3)


def test_contact_that_is_lost_ends_the_push() -> None:
    course = stroke(lambda way: 0.4 if 0.0 < way < 0.02 else 0.0)
    assert (course.lost, course.in_contact) == (True, False)
    assert 0.027 < course.reached < 0.045


def test_what_is_never_there_is_not_felt() -> None:
    course = stroke(lambda way: 0.0)
    assert (course.touched_at, course.in_contact, course.lost) == (None, False, False)
    assert course.reached == pytest.approx(0.05)


def test_the_tool_turns_with_its_way() -> None:
    course = stroke(lambda way: 0.4 if way > 0.0 else 0.0, curvature=10.0)
    assert course.carrier.yaw == pytest.approx(0.5, abs=1e-3)
    assert course.in_contact


def test_touch_counts_for_more_than_sight_until_the_two_contradict() -> None:
    touch = PlanarEstimate(PlanarPose(0.5, 0.0, 0.0), np.diag([2e-4**2, 1e-3**2]), 0.004)
    near = fuse_estimates(touch, estimate_from_camera(PlanarPose(0.5005, 0.0005, 0.01)), math.pi / 2)
    assert near.at.x == pytest.approx(0.50007, abs=1e-5)
    assert near.at.y == pytest.approx(0.0004, abs=1e-5)
    assert near.at.yaw < 0.003
    far = fuse_estimates(touch, estimate_from_camera(PlanarPose(0.51, 0.0, 0.0)), math.pi / 2)
    assert far.at == PlanarPose(0.51, 0.0, 0.0)


def drag(top: float) -> tuple[DragMotion, list[float], list[float]]:
    """A drag along x over a stiff level at height `top` (m), with the forces and the heights of the tool."""
    course = DragMotion(straight(PlanarPose(0.5, 0.0), 0.05), 0.05, 8.0, 6.0, 0.8)
    course.start(START.copy(), DOWN.copy())
    forces, heights = list[float](), list[float]()
    for k in range(4000):
        position = course.position.copy()
        position[2] = max(top, position[2])
        up = VERTICAL_DRAG_STIFFNESS * (position[2] - course.position[2])
        felt = np.array([-0.3 if up else 0.0, 0.0, up]) - 0.8 * course.acceleration
        course.advance(ContactState(k * PERIOD, PERIOD, felt, np.zeros(3), position, course.rotation.copy()))
        forces.append(up)
        heights.append(float(position[2]))
        if course.finished:
            return course, forces, heights
    raise AssertionError("never finished")


def test_a_drag_sinks_onto_the_thing_presses_on_it_and_ends_above_it() -> None:
    course, forces, heights = drag(START[2] - 0.01)
    assert course.reached == pytest.approx(0.05, abs=1e-3)
    assert not course.blocked
    assert max(forces) == pytest.approx(6.0, abs=0.2)
    assert heights[0] == pytest.approx(START[2], abs=1e-3)
    assert min(heights) == pytest.approx(START[2] - 0.01)
    assert heights[-1] > START[2] - 0.01
    assert course.position[0] == pytest.approx(0.55, abs=1e-3)


def test_a_drag_over_nothing_sinks_no_further_than_it_may() -> None:
    course, forces, heights = drag(-1.0)
    assert max(forces) == 0.0
    assert min(heights) == pytest.approx(START[2] - MAX_SINK, abs=1e-3)
    assert course.touched_at is None


def test_a_stroke_through_a_heap_goes_on_when_it_touches_nothing_any_more() -> None:
    def felt(way: float) -> float:
        return 0.5 if way < 0.01 else 0.0

    lost, through = stroke(felt), stroke(felt, through=True)
    assert (lost.lost, through.lost) == (True, False)
    assert lost.reached < 0.03
    assert through.reached == pytest.approx(0.05, abs=1e-3)
