"""What the control loop learns at rest: the wrist sensor's bias, the hand's load, what the joints bear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.control import HoldController
from picktree.robot.control.external_torque import EffortCheck
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import GRAVITY, Array, JointState

from .control_cell import HOME, MODEL, Cell
from .scripted_cell import ASIDE, STILL, FeelingHardware, flange_jacobian, moving, scripted, steps


@pytest.mark.parametrize(
    ("speed", "periods", "learnt"),
    [(0.0, 23, False), (0.0, 24, True), (0.019, 24, True), (0.021, 24, False)],
)
def test_the_bias_of_the_wrist_is_learnt_after_a_tenth_of_a_second_at_rest(
    speed: float, periods: int, learnt: bool
) -> None:
    cell, readings = scripted()
    readings.force = np.array([0.5, 2.0, -1.0])
    readings.velocity = speed * np.array([0.6, 0.0, -0.8, 0.0, 0.0, 0.0, 0.0])
    steps(cell, periods)
    assert cell.loop.wrist.zeroed is learnt
    assert cell.loop.wrist.force == pytest.approx((0.0, 0.0, 0.0) if learnt else (0.5, 2.0, -1.0))


def test_a_moment_of_motion_lets_the_rest_begin_anew() -> None:
    cell, readings = scripted()
    steps(cell, 20)
    readings.velocity = np.full(7, 0.1)
    steps(cell, 1)
    readings.velocity = STILL
    steps(cell, 23)
    assert not cell.loop.wrist.zeroed
    steps(cell, 1)
    assert cell.loop.wrist.zeroed


def test_what_is_moved_is_not_at_rest_however_slowly() -> None:
    cell, *_ = moving()
    steps(cell, 40)
    assert not cell.loop.wrist.zeroed


def test_a_hand_that_is_not_at_rest_is_only_tared() -> None:
    cell, readings = scripted()
    readings.force = np.array([0.0, 0.0, -2.0])
    steps(cell, 20)
    assert cell.loop.load() == pytest.approx(2.0)
    assert not cell.loop.zero()
    assert not cell.loop.wrist.zeroed
    assert cell.loop.load() == pytest.approx(0.0)


def borne(force: Array) -> Array:
    """Torques of the joints that bear a force (3,) on the hand, at HOME, Nm."""
    return -flange_jacobian(HOME)[:3].T @ force


def stop_of(cell: Cell) -> str:
    return "" if cell.monitor.stopped is None else cell.monitor.stopped.cause.name


@pytest.mark.parametrize(
    ("force", "stops"),
    [
        ((0.0, 0.0, -40.0), "safety.payload"),
        ((0.0, 0.0, -20.0), ""),
        ((0.0, 0.0, 40.0), ""),
        ((0.0, -40.0, 0.0), ""),
    ],
)
def test_a_load_is_weighed_at_rest(force: tuple[float, float, float], stops: str) -> None:
    """The drives tell nothing here: what the wrist says is believed."""
    cell, readings = scripted()
    readings.force = np.array(force)
    steps(cell, 23)
    assert cell.monitor.stopped is None
    steps(cell, 5)
    assert stop_of(cell) == stops
    if cell.monitor.stopped is not None:
        assert cell.monitor.stopped.evidence["mass"] == pytest.approx(40.0 / GRAVITY, abs=1e-3)


def test_a_load_that_no_joint_bears_is_a_bias() -> None:
    load = np.array([0.0, 0.0, -40.0])
    for share, stops in ((0.0, ""), (1.0, "safety.payload")):
        cell, readings = scripted(FeelingHardware)
        steps(cell, 30)
        assert cell.loop.wrist.zeroed
        readings.force, readings.torque = load, share * borne(load)
        steps(cell, 60)
        assert stop_of(cell) == stops
        felt = load if share else np.zeros(3)
        assert cell.loop.wrist.force == pytest.approx(felt.tolist(), abs=0.1)


def test_a_load_that_swings_is_not_weighed_yet() -> None:
    load = np.array([0.0, 0.0, -40.0])
    cell, readings = scripted(FeelingHardware)
    steps(cell, 30)
    for k in range(120):
        swinging = load + 2.0 * np.sin(2.0 * k) * np.eye(3)[0]
        readings.force, readings.torque = swinging, borne(swinging)
        steps(cell, 1)
    assert stop_of(cell) == ""
    readings.force, readings.torque = load, borne(load)
    steps(cell, 60)
    assert stop_of(cell) == "safety.payload"


@pytest.mark.parametrize(
    ("wrist", "joints", "stops"), [(0.0, 1.0, "safety.torque_limit"), (1.0, 0.0, ""), (1.0, 1.0, "")]
)
def test_a_push_at_the_arm_stops_and_a_wrist_that_lies_does_not(
    wrist: float, joints: float, stops: str
) -> None:
    """What only the wrist feels is its own fault, and is learnt when the arm comes to rest."""
    push = np.array([25.0, 15.0, 10.0])
    cell, readings = scripted(FeelingHardware)
    steps(cell, 30)
    readings.velocity = np.full(7, 0.03)  # not at rest
    readings.force, readings.torque = wrist * push, 1.3 * joints * borne(push) / max(1.0, 1.3 * wrist)
    controllers: list[str] = []
    for _ in range(120):
        steps(cell, 1)
        controllers.append(cell.loop.controller)
    assert stop_of(cell) == stops
    assert ("Comply" in controllers) is bool(stops)
    readings.velocity = STILL
    steps(cell, 40)
    assert cell.loop.wrist.force == pytest.approx((wrist * joints * push).tolist(), abs=0.5)


def test_what_the_hand_carries_is_known_after_a_twentieth_of_a_second_at_rest() -> None:
    weight = np.array([1.0, -2.0, -5.0])
    for periods, felt, known in (
        (11, weight, STILL[:3]),
        (12, weight, weight),
        (12, np.array([0.0, -11.9, -15.9]), np.array([0.0, -11.9, -15.9])),
        (12, np.array([0.0, -12.1, -16.1]), STILL[:3]),  # that is touched, not carried
    ):
        cell, readings = scripted()
        readings.force = felt
        steps(cell, periods)
        cell.loop.acquire("test").run(HoldController())
        assert cell.loop.save().carried[:3] == pytest.approx(known.tolist()), (periods, felt)
        assert cell.loop.save().carried[3:] == (0.0, 0.0, 0.0)


def test_efforts_are_looked_at_every_twentieth_of_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    cell, _ = scripted(FeelingHardware)
    elapsed: list[float] = []

    def explained(unexplained: Array, since: float) -> bool:
        elapsed.append(since)
        return True

    monkeypatch.setattr(cell.monitor, "explained", explained)
    steps(cell, 240)
    assert elapsed == pytest.approx([0.0625, *[0.05] * 18])  # a check of the tool apart


def test_where_the_drives_tell_no_efforts_none_are_looked_at() -> None:
    for backend, stops in ((KinematicHardware, ""), (FeelingHardware, "safety.torque_limit")):
        cell, readings = scripted(backend)
        readings.torque = 0.5 * MODEL.torque_limit
        steps(cell, 60)
        assert stop_of(cell) == stops


@pytest.mark.parametrize(("share", "believed"), [(0.49, False), (0.51, True)])
def test_the_joints_believe_what_they_bear_half_of(share: float, believed: bool) -> None:
    """In each direction, whatever hand and load weigh besides."""
    judge = EffortCheck(MODEL)
    load = np.array([0.5, -0.3, -12.0, 0.4, 0.2, 0.1])
    for axis in range(3):
        push = 8.0 * np.eye(6)[axis]
        jacobian = flange_jacobian(ASIDE)
        # Gravity of the whole arm holds the hand, too; what hangs on it and pushes comes on top.
        held = MODEL.gravity(ASIDE) - jacobian.T @ (load + share * push)
        assert judge.believes(JointState(ASIDE, STILL, held), push, load) is believed, axis
    moving_ = JointState(ASIDE, np.full(7, 0.5), MODEL.gravity(ASIDE) - flange_jacobian(ASIDE).T @ load)
    assert judge.believes(moving_, np.zeros(6), load)  # nothing is claimed


def test_without_the_wrist_the_hand_and_its_load_are_explained_by_what_they_weigh() -> None:
    """The hand's centre of mass is beside the sensor's axis in this posture, and no twist is made up."""
    judge = EffortCheck(MODEL)
    load = np.array([0.5, -0.3, -12.0, 0.4, 0.2, 0.1])
    q = HOME + np.array([0.3, 0.2, -0.4, 0.5, 0.7, -0.6, 0.8])
    state = JointState(q, STILL, MODEL.gravity(q) - flange_jacobian(q).T @ load)
    assert judge.without_wrist(state, STILL, load) == pytest.approx(STILL, abs=1e-4)
    pushed = replace(state, effort=state.effort + 3.0 * np.eye(7)[2])
    assert judge.without_wrist(pushed, STILL, load) == pytest.approx(3.0 * np.eye(7)[2], abs=1e-4)
