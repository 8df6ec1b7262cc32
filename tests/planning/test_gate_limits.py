"""The gate's limits, each from both sides, on polynomials that exceed them at one instant."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from picktree.robot.planning import HeldObject, JointGoal, PlanService, Request, TrajectoryGate
from picktree.world import Array, BeliefObject, Bounds, Box, Failure, ObjectId, Pose, Trajectory
from picktree.world.robot_model import RobotModel

from ..control.control_cell import HOME, MODEL, ROBOT, swing
from .test_gate import Cell, away

EVERYWHERE = Bounds((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0))
FREE = SimpleNamespace(requests=(), seen=SimpleNamespace(covers=lambda now, *, width_matters: True))
"""What is known of a trajectory that was just found free."""


def refusal(
    trajectory: Trajectory, workspace: Bounds = EVERYWHERE, *, robot: RobotModel = MODEL
) -> Failure | None:
    """Of a gate that need not check collisions."""
    plans = SimpleNamespace(made=SimpleNamespace(of=lambda _: FREE, now=lambda: None))
    gate = TrajectoryGate(robot, cast(PlanService, plans), workspace)
    try:
        for _ in gate.passes(trajectory):
            pass
    except Failure as failure:
        return failure
    return None


def cause(failure: Failure | None) -> str:
    return "" if failure is None else failure.cause.name


def curve(joint: int, coefficients: list[float], span: float, base: Array = HOME) -> Trajectory:
    """One joint along a polynomial of u = t / span, lowest power first, then to rest within 10 s."""
    p = np.polynomial.Polynomial(coefficients)
    v, a = p.deriv() / span, p.deriv(2) / span**2
    rows = np.zeros((3, 3, 7))
    rows[0] = base
    for k, u in enumerate((0.0, 1.0)):
        rows[0, k, joint] = p(u)
        rows[1, k, joint], rows[2, k, joint] = v(u), a(u)
    if abs(v(1.0)) < 1e-9:
        return Trajectory(np.array([0.0, span]), *rows[:, :2])
    rest = span + 0.4
    rows[0, 2, joint] = p(1.0) + 0.2 * v(1.0)
    return Trajectory(np.array([0.0, span, rest]), *rows)


def bump(peak: float, at: float, sharpness: float) -> list[float]:
    """Coefficients of peak − sharpness·(u − at)²."""
    return [peak - sharpness * at * at, 2 * sharpness * at, -sharpness]


def integral(coefficients: list[float], span: float, start: float) -> list[float]:
    return [start, *(span * c / (n + 1) for n, c in enumerate(coefficients))]


SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("share", SHARES[1:])
def test_a_joint_limit_is_kept_at_each_quarter_between_samples(share: float, sign: float) -> None:
    limit = float(MODEL.upper[5] if sign > 0 else MODEL.lower[5])
    for beyond in (-0.001, 0.001):
        way = [limit * (n == 0) + sign * c for n, c in enumerate(bump(beyond, share, 0.1))]
        failure = refusal(curve(5, way, 2.0))
        assert cause(failure) == ("safety.joint_limit" if beyond > 0 else "")
    assert failure is not None
    assert failure.evidence["joint"] == "panda_joint6"
    assert failure.evidence["time"] == pytest.approx(2.0 * share)
    assert failure.evidence["value"] == pytest.approx(limit + sign * 0.001)
    assert failure.evidence["beyond"] == pytest.approx(0.001, abs=2e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("share", SHARES)
def test_a_speed_limit_is_kept_at_each_quarter_between_samples(share: float, sign: float) -> None:
    """Up to two hundredths more."""
    limit = float(MODEL.velocity_limit[0])
    for times in (1.019, 1.021):
        speed = [sign * c for c in bump(times * limit, share, limit)]
        failure = refusal(curve(0, integral(speed, 0.2, -0.2 * sign), 0.2))
        assert (cause(failure) == "safety.speed_limit") is (times > 1.02)
    assert failure is not None
    assert failure.evidence["time"] == pytest.approx(0.2 * share)
    assert failure.evidence["fraction"] == pytest.approx(share / 3)
    assert failure.evidence["value"] == pytest.approx(sign * 1.021 * limit)
    assert failure.evidence["beyond"] == pytest.approx(0.021 * limit)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("share", SHARES)
def test_an_acceleration_limit_is_kept_at_each_quarter_between_samples(share: float, sign: float) -> None:
    """Up to two hundredths more; it lasts until the arm rests."""
    limit = float(MODEL.acceleration_limit[1])
    span = 0.2
    for times in (1.019, 1.021):
        braking = np.polynomial.Polynomial([sign * c for c in bump(times * limit, share, 2.0 * limit)])
        speed = braking.integ() * span
        speed -= speed(1.0)
        way = speed.integ() * span + float(HOME[1])
        rows = [np.tile(HOME, (2, 1)), np.zeros((2, 7)), np.zeros((2, 7))]
        for row, values in zip(rows, (way, speed, braking), strict=True):
            row[:, 1] = values(0.0), values(1.0)
        failure = refusal(Trajectory(np.array([0.0, span]), *rows))
        assert cause(failure) == ("safety.acceleration_limit" if times > 1.02 else "")
    assert failure is not None
    assert failure.evidence["time"] == pytest.approx(span * share)
    assert failure.evidence["value"] == pytest.approx(sign * 1.021 * limit)
    assert failure.evidence["beyond"] == pytest.approx(0.021 * limit)


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_what_is_refused_is_where_the_polynomial_is(derivative: int) -> None:
    """A polynomial of the fifth degree, each of whose powers counts, and a robot with one limit alone."""
    span = 0.8
    way = np.polynomial.Polynomial([0.1, -0.3, 0.5, 2.5, -4.0, 1.56])
    wanted = [way, way.deriv() / span, way.deriv(2) / span**2][derivative]
    peak = max(SHARES[1:], key=lambda u: abs(wanted(u)))
    most = 0.9 * abs(float(wanted(peak)))
    robot = RobotModel(ROBOT)
    robot.lower, robot.upper = np.full(7, -9.0), np.full(7, 9.0)
    robot.velocity_limit, robot.acceleration_limit = np.full(7, 1e3), np.full(7, 1e3)
    if derivative == 0:
        robot.lower[0], robot.upper[0] = -most, most
    else:
        (robot.velocity_limit if derivative == 1 else robot.acceleration_limit)[0] = most
    failure = refusal(curve(0, way.coef.tolist(), span), robot=robot)
    assert failure is not None
    assert failure.evidence["value"] == pytest.approx(float(wanted(peak)))
    assert failure.evidence["time"] == pytest.approx(span * peak)


def test_a_start_at_a_limit_or_beyond_it_may_be_left_and_not_be_made_worse() -> None:
    for side, limit in ((1.0, MODEL.upper[3]), (-1.0, MODEL.lower[3])):
        for beyond in (0.0, 0.05):
            start = HOME.copy()
            start[3] = limit + side * beyond
            for way, name in ((-0.1 * side, ""), (0.002 * side, "safety.joint_limit")):
                goal = start.copy()
                goal[3] += way
                assert cause(refusal(swing(start, goal))) == name, (side, beyond, way)
            stays = swing(start, start)
            assert refusal(stays) is None


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_tool_stays_in_the_workspace_on_each_side(axis: int, side: float) -> None:
    trajectory = away(0, 0.6)
    if axis == 2:
        trajectory = swing(HOME, HOME + np.array([0, 0.3, 0, 0.2, 0, 0, 0]))
    tool = np.array([MODEL.tcp(q).position for q in trajectory.position])
    worst = int((side * tool[:, axis]).argmax())
    start_is_worst = worst == 0
    low, high = [-2.0] * 3, [2.0] * 3
    for room, name in ((0.002, ""), (-0.002, "safety.workspace")):
        edge = float(tool[worst, axis]) + side * room
        (high if side > 0 else low)[axis] = edge
        failure = refusal(trajectory, Bounds((low[0], low[1], low[2]), (high[0], high[1], high[2])))
        # Where it starts outside it only comes back.
        assert cause(failure) == ("" if start_is_worst else name)
        if failure is not None:
            assert failure.evidence["beyond"] == pytest.approx(0.002, abs=5e-5)
            assert failure.evidence["time"] == pytest.approx(float(trajectory.times[worst]), abs=0.15)
            assert failure.evidence["fraction"] == pytest.approx(float(trajectory.times[worst]) / 2, abs=0.08)
            x, y, z = cast(list[float], failure.evidence["position"])
            assert [round(c, 4) for c in (x, y, z)] == [x, y, z]
            assert (x, y, z) == pytest.approx(tool[worst].tolist(), abs=4e-3)


def test_from_outside_of_the_workspace_the_tool_may_come_back_and_not_go_further() -> None:
    y = [MODEL.tcp(HOME + np.array([a, 0, 0, 0, 0, 0, 0])).position[1] for a in (0.4, 0.8)]
    inside = Bounds((-2.0, -2.0, -2.0), (2.0, y[0] - 0.05, 2.0))
    turned = [HOME + np.array([a, 0, 0, 0, 0, 0, 0]) for a in (0.4, 0.8)]
    assert refusal(swing(turned[1], turned[0]), inside) is None
    assert refusal(swing(turned[0], HOME), inside) is None
    failure = refusal(swing(turned[0], turned[1]), inside)
    assert cause(failure) == "safety.workspace"
    assert failure is not None
    assert failure.evidence["beyond"] == pytest.approx(y[1] - y[0] + 0.05)
    assert failure.evidence["fraction"] == 1.0


def test_an_unsound_trajectory_is_refused_whichever_row_is_wrong() -> None:
    sound = swing(HOME, HOME + 0.1)
    assert refusal(sound) is None
    still = Trajectory(np.zeros(1), HOME[None], np.zeros((1, 7)), np.zeros((1, 7)))
    assert refusal(still) is None

    def wrong(**changed: Array) -> str:
        return cause(refusal(replace(sound, **changed)))

    for name in ("position", "velocity", "acceleration"):
        rows = getattr(sound, name)
        assert wrong(**{name: rows[:-1]}) == "safety.trajectory"
        assert wrong(**{name: rows[:, :6]}) == "safety.trajectory"
        for value in (np.nan, np.inf, -np.inf):
            spoilt = rows.copy()
            spoilt[3, 2] = value
            assert wrong(**{name: spoilt}) == "safety.trajectory"
    times = sound.times.copy()
    times[-1] = np.inf
    assert wrong(times=times) == "safety.trajectory"
    assert wrong(times=sound.times[:, None]) == "safety.trajectory"
    assert wrong(times=sound.times + 1e-6) == "safety.trajectory"
    assert wrong(times=sound.times - 1e-6) == "safety.trajectory"
    times = sound.times.copy()
    times[5] = times[4]
    assert wrong(times=times) == "safety.trajectory"
    none = Trajectory(np.zeros(0), np.zeros((0, 7)), np.zeros((0, 7)), np.zeros((0, 7)))
    assert cause(refusal(none)) == "safety.trajectory"
    times = sound.times.copy()
    times[0] = 1e-9
    assert wrong(times=times) == ""
    for speed, name in (
        (1e-6, ""),
        (-1e-6, ""),
        (-1.1e-6, "safety.trajectory"),
        (1.1e-6, "safety.trajectory"),
    ):
        velocity = sound.velocity.copy()
        velocity[-1, 4] = speed
        assert wrong(velocity=velocity) == name


def checks(cell: Cell) -> int:
    return cell.world.plan.solver.collision.checks


def gate_of(cell: Cell) -> TrajectoryGate:
    return TrajectoryGate(MODEL, cell.world.plan, cell.world.description.limits.workspace)


def test_on_the_way_only_the_rest_is_checked_and_only_once_for_each_belief() -> None:
    cell = Cell()
    trajectory = away(0, 0.8)
    gate = gate_of(cell)
    assert gate.blocked(trajectory, 0.5) is None  # nobody has let it pass
    assert checks(cell) == 0
    cell.run(gate.passes(trajectory))
    before = checks(cell)
    assert gate.blocked(trajectory, 0.5) is None
    assert checks(cell) == before
    cell.put(0.8, -0.4, 0.04)
    assert gate.blocked(trajectory, 1.0) is None
    part = checks(cell) - before
    assert gate.blocked(trajectory, 1.0) is None
    assert checks(cell) - before == part
    cell.put(0.8, -0.45, 0.04)
    assert gate.blocked(trajectory, 0.0) is None
    assert checks(cell) - before - part > 1.5 * part > 20
    x, y, z = MODEL.tcp(trajectory.sample(0.4)[0]).position
    cell.put(x, y, z, 0.02, "behind")
    assert gate.blocked(trajectory, 1.4) is None
    cell.put(x, y, z, 0.021, "behind")
    failure = gate.blocked(trajectory, 0.2)
    assert failure is not None
    assert "behind" in failure.message


def test_what_stands_further_on_is_told_with_its_time_since_the_start() -> None:
    cell = Cell()
    trajectory = away(0, 0.8)
    gate = gate_of(cell)
    cell.run(gate.passes(trajectory))
    x, y, z = MODEL.tcp(trajectory.sample(1.5)[0]).position
    cell.put(x, y, z, 0.02, "ahead")
    for done in (0.0, 0.6):
        failure = gate.blocked(trajectory, done)
        assert failure is not None
        assert 1.1 < float(str(failure.evidence["time"])) < 1.5
        assert float(str(failure.evidence["fraction"])) == pytest.approx(
            float(str(failure.evidence["time"])) / 2
        )


def test_another_object_in_the_hand_than_the_plan_supposed_is_not_taken_for_it() -> None:
    """The plan supposes a beam in the hand, and there is a brick: it is checked with the beam."""
    cell = Cell()
    world = cell.world

    def thing(name: str, long: float) -> BeliefObject:
        pose = world.control.tcp @ Pose((0.0, 0.0, 0.02))
        shape = Box((long, 0.03, 0.03))
        return BeliefObject("box", "box", shape, "red", pose, 0.001, 0.01, 1.0, 0.0, id=ObjectId(name))

    world.scene.put(replace(thing("beam", 0.5), pose=Pose((0.4, 0.6, 0.3))), "test")
    world.scene.put(thing("brick", 0.04), "test")
    world.scene.attach("brick", Pose((0.0, 0.0, 0.2)))
    world.scene.carry(world.control.tcp)
    aside = HOME + np.array([0.5, 0, 0, 0, 0, 0, 0])
    request = Request(
        JointGoal(aside), holding=HeldObject(ObjectId("beam"), Pose((0.0, 0.0, 0.02))), width=0.04
    )
    plan = cell.run(world.plan.solve(request, node="test"))
    end = MODEL.tcp(aside)
    for name, place, free in (("far", (0.0, 0.0, 0.5), True), ("near", (0.2, 0.0, 0.02), False)):
        x, y, z = (end @ Pose(place)).position
        if name == "far":
            x, y, z = 0.8, -0.5, 0.04
        cell.put(x, y, z, 0.04, name)
        if free:
            cell.run(gate_of(cell).passes(plan.trajectory))
        else:
            with pytest.raises(Failure, match="near"):
                cell.run(gate_of(cell).passes(plan.trajectory))
    world.scene.remove("near", "test")
    world.scene.remove("beam", "test")
    with pytest.raises(Failure, match="its plan supposed that it is held") as caught:
        cell.run(gate_of(cell).passes(plan.trajectory))
    assert caught.value.cause.name == "planning.blocked"
