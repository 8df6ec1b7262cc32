"""Jogging: twists that move the arm, slower where they must, and what stops them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.robot.control import JogFeedback, JogResult, Twist
from picktree.robot.control.velocity_controller import JogSetpointGenerator, JogState, SpeedRestriction
from picktree.simulation import Backend
from picktree.world import Array, Bounds, Failure

from ..planning.test_gate import Cell
from .control_cell import HOME, MODEL

WIDE = Bounds((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0))
TIP = MODEL.description.gripper.tip


def jog(cell: Cell, twist: Twist, **until: float) -> JogResult:
    return cell.run(cell.world.move.jog(twist, node="test", **until))


def way(result: JogResult) -> Array:
    return np.subtract(result.pose.position, MODEL.tcp(HOME).position)


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_a_distance_straight_on_and_the_orientation_stays(backend: Backend) -> None:
    result = jog(Cell(backend), Twist((0.0, 0.2, -0.1)), distance=0.15)
    assert result.stopped_by == "done"
    assert result.failure() is None
    np.testing.assert_allclose(way(result), np.array([0.0, 2.0, -1.0]) / math.sqrt(5) * 0.15, atol=1e-3)
    assert result.travelled == pytest.approx(0.15, abs=1e-3)
    assert result.pose.angle(MODEL.tcp(HOME)) < 2e-3


def test_a_time_in_the_axes_of_the_tool() -> None:
    result = jog(Cell(), Twist((0.0, 0.0, 0.1), frame="tool"), duration=1.0)
    assert (result.stopped_by, round(result.elapsed, 2)) == ("done", 1.1)
    np.testing.assert_allclose(way(result), [0.0, 0.0, -0.0975], atol=2e-3)


def test_turning_about_the_tool_s_centre_point() -> None:
    result = jog(Cell(), Twist(angular=(0.0, 0.0, 0.5)), duration=1.0)
    assert np.linalg.norm(way(result)) < 1e-3
    assert result.pose.angle(MODEL.tcp(HOME)) == pytest.approx(0.47, abs=0.03)


def test_down_until_the_table_stops_it_and_up_again() -> None:
    cell = Cell()
    for speed in (0.5, 0.1):
        result = jog(cell, Twist((0.0, 0.0, -speed)))
        pads = "panda_leftfinger at table, panda_rightfinger at table"
        assert (result.stopped_by, result.detail) == ("collision", pads)
        assert 0.0005 < result.pose.position[2] - TIP < 0.004
        assert abs(cell.world.control.wrist.force[2]) < 2.0
        failure = result.failure()
        assert failure is not None
        after = f"{result.travelled * 1000:.0f} mm of a jog"
        assert str(failure) == f"planning.blocked: stopped before a collision ({pads}) after {after}"
        assert jog(cell, Twist((0.0, 0.0, 0.2)), distance=0.1).stopped_by == "done"


def test_it_slows_down_before_what_is_in_the_way() -> None:
    cell = Cell()
    cell.put(0.307, 0.45, 0.5, 0.2)
    shares: list[float] = []

    def on(status: JogFeedback) -> Twist | None:
        shares.append(status.share)
        return Twist((0.0, 0.3, 0.0)) if status.elapsed < 3.0 else None

    result = cell.run(cell.world.move.jog(on, node="test"))
    assert shares[5] == 1.0
    assert shares[-1] == 0.0
    assert sorted(shares[5:], reverse=True)[::4] == pytest.approx(shares[5:][::4], abs=0.06)
    assert result.stopped_by == "done"
    assert way(result)[1] < 0.35 - 0.1


def test_an_unseen_table_is_felt() -> None:
    cell = Cell()
    jog(cell, Twist((0.0, 0.0, -0.3)), distance=0.45)
    with cell.world.scene.allow(("gripper", "table")):
        result = jog(cell, Twist((0.0, 0.0, -0.03)), guard=8.0)
    assert result.stopped_by == "contact"
    assert result.force > 8.0
    failure = result.failure()
    assert failure is not None
    assert str(failure).startswith(f"world.disturbed: touched something at {result.force:.0f} N after ")
    above = replace(result, limit=5.0).failure()
    assert above is not None
    assert f"{result.force:.0f} N, above the limit of 5 N after " in above.message
    assert cell.world.control.monitor.stopped is None


def test_singularities_joints_and_the_workspace_stop_it_and_are_left_again() -> None:
    cases = [
        (Twist((0.2, 0.0, 0.0)), "safety.singularity: the arm came to a singular configuration after 4"),
        (Twist((-0.2, 0.0, 0.0)), "safety.joint_limit: panda_joint2 came to its limit after 3"),
        (Twist(angular=(0.0, 0.0, 0.8), frame="tool"), "safety.joint_limit: panda_joint7 came to its limit"),
    ]
    for twist, text in cases:
        cell = Cell()
        result = jog(cell, twist)
        failure = result.failure()
        assert failure is not None
        assert str(failure).startswith(text)
        back = jog(cell, twist.scaled(-1.0), duration=0.5)
        assert back.stopped_by == "done"
        assert max(back.travelled, back.pose.angle(result.pose)) > 0.03


def test_the_edge_of_the_workspace() -> None:
    cell = Cell()
    limits = cell.world.control.monitor.limits
    edge = limits.workspace.max[1]
    law = JogSetpointGenerator(MODEL, Bounds(limits.workspace.min, (1.0, 0.2, 1.5)))
    state = JogState(HOME.copy(), np.zeros(7), np.zeros(6))
    for _ in range(600):
        law.step(state, Twist((0.0, 0.3, 0.0)), 1 / 240)
    assert law.restriction == SpeedRestriction("workspace")
    assert 0.19 < MODEL.tcp(state.q).position[1] < 0.2 < edge


def test_a_stream_is_asked_each_tick_and_ends_when_it_says_so() -> None:
    cell = Cell()
    told: list[JogFeedback] = []

    def circle(status: JogFeedback) -> Twist | None:
        told.append(status)
        angle = 2.0 * math.pi * status.elapsed / 2.0
        return Twist((0.0, 0.1 * math.cos(angle), 0.1 * math.sin(angle))) if status.elapsed < 1.99 else None

    result = cell.run(cell.world.move.jog(circle, node="test"))
    assert len(told) == 41
    assert [round(status.elapsed, 2) for status in told[:3]] == [0.0, 0.05, 0.1]
    assert told[20].travelled == pytest.approx(0.1, abs=0.02)
    assert np.linalg.norm(way(result)) < 0.03
    assert result.stopped_by == "done"


def test_commands_that_stay_away_brake() -> None:
    cell = Cell()
    doing = cell.world.move.jog(Twist((0.0, 0.2, 0.0)), node="test")
    for _ in range(10):
        next(doing)
        cell.world.control.step_tick(0.05)
    for _ in range(10):
        cell.world.control.step_tick(0.05)
    assert float(np.abs(cell.world.control.state.velocity).max()) < 1e-3
    with pytest.raises(Failure, match=r"^control.timeout: a jog has had no command in time"):
        cell.run(doing)


def test_no_limit_is_exceeded_whatever_is_asked() -> None:
    """Twists at random, each for a while: speeds, accelerations and positions of the joints stay within."""
    rng = np.random.default_rng(9)
    law = JogSetpointGenerator(MODEL, WIDE)
    state = JogState(HOME.copy(), np.zeros(7), np.zeros(6))
    dt = 1 / 240
    for k in range(2400):
        if k % 120 == 0:
            x, y, z, a, b, c = rng.uniform(-1.0, 1.0, 6)
            twist = Twist((0.3 * x, 0.3 * y, 0.3 * z), (a, b, c), "tool" if k % 240 else "world")
        before = state.v
        law.step(state, twist, dt)
        assert (np.abs(state.v) <= MODEL.velocity_limit).all()
        assert (np.abs(state.v - before) <= MODEL.acceleration_limit * dt * (1 + 1e-9)).all()
        assert (state.q >= MODEL.lower).all() and (state.q <= MODEL.upper).all()


@pytest.mark.parametrize(
    ("twist", "until", "text"),
    [
        (
            Twist((0.9, 0.0, 0.0)),
            {},
            "a jog goes at most 0.5 m/s and turns at most 2 rad/s, not 0.9 m/s and 0 rad/s",
        ),
        (
            Twist((math.nan, 0.0, 0.0)),
            {},
            "a twist needs three m/s and three rad/s, not (nan, 0.0, 0.0, 0.0, 0.0, 0.0)",
        ),
        (Twist(), {"duration": 0.0}, "a jog needs a guard, a duration and a distance above 0"),
    ],
)
def test_nonsense_is_refused(twist: Twist, until: dict[str, float], text: str) -> None:
    with pytest.raises(PicktreeError) as caught:
        jog(Cell(), twist, **until)
    assert str(caught.value) == text


def test_the_state_of_a_servo_is_where_it_begins() -> None:
    """No step of velocity at the start: the first set-points grow by what may be gained in a period."""
    cell = Cell()
    doing = cell.world.move.jog(Twist((0.0, 0.3, 0.0)), node="test")
    next(doing)
    speeds: list[float] = []
    for _ in range(12):
        cell.world.control.step()
        state = cell.world.control.hardware.arm.read()
        speeds.append(float(np.linalg.norm((MODEL.jacobian(state.position) @ state.velocity)[:3])))
    assert np.diff(speeds).max() <= 1.0 / 240 * 1.05
    doing.close()
