"""The one guarded move, contact under impedance, and what the wrist feels."""

from __future__ import annotations

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.robot.control import CartesianStiffness
from picktree.world import Failure, Pose

from .control_cell import DOWN as LOOKING_DOWN
from .control_cell import HOME, ROBOT, Cell, reach, swing

DOWN = (0.0, 0.0, -1.0)
TIP = ROBOT.gripper.tip


def test_guarded_move_onto_the_table_stops_at_the_force() -> None:
    cell = Cell()
    cell.go(0.5, 0.1, 0.05)
    result = cell.run(cell.move.guarded(DOWN, 0.08, force=4.0, speed=0.05))
    assert result.contact
    assert 4.0 < result.force < 10.0
    assert result.travelled == pytest.approx(0.05 - TIP, abs=1e-3)
    assert cell.loop.at_rest
    assert abs(cell.loop.wrist.force[2]) < 2.0
    assert result.pose.angle(Pose((0.0, 0.0, 0.0), LOOKING_DOWN)) < 0.003
    assert result.pose.distance(Pose((0.5, 0.1, TIP))) < 1.5e-3


def test_guarded_move_presses_when_asked() -> None:
    cell = Cell()
    cell.go(0.5, 0.1, 0.03)
    result = cell.run(cell.move.guarded(DOWN, 0.08, force=4.0, speed=0.05, press=8.0))
    assert result.contact
    assert cell.loop.wrist.force[2] == pytest.approx(8.0, abs=1.5)


def test_guarded_move_in_free_space_does_its_distance_straight() -> None:
    cell = Cell()
    cell.go(0.45, -0.1, 0.3)
    begin = cell.loop.tcp
    direction = np.array([0.6, 0.0, -0.8])
    result = cell.run(cell.move.guarded(direction * 3, 0.06, force=4.0, speed=0.05))
    assert not result.contact
    assert result.travelled == pytest.approx(0.06, abs=3e-4)
    off = np.subtract(result.pose.position, begin.position) - direction * 0.06
    assert np.linalg.norm(off) < 5e-4
    assert result.pose.angle(begin) < 2e-3


def test_soft_impedance_carries_the_load_without_sagging() -> None:
    cell = Cell()
    cell.go(0.5, 0.0, 0.3)
    soft = CartesianStiffness(linear=300.0, angular=10.0)
    result = cell.run(cell.move.guarded((1.0, 0.0, 0.0), 0.02, force=4.0, speed=0.02, stiffness=soft))
    assert abs(result.pose.position[2] - 0.3) < 5e-4


def test_guarded_move_refuses_nonsense() -> None:
    with pytest.raises(PicktreeError, match=r"^a guarded move needs a direction, and a distance, force"):
        cell = Cell()
        cell.run(cell.move.guarded((0.0, 0.0, 0.0), 0.1, force=4.0, speed=0.05))


def onto_the_table(cell: Cell) -> Failure:
    """How a guarded motion to 2 cm below the table ends."""
    cell.go(0.5, 0.1, 0.08)
    start = cell.loop.held_position
    into_table = reach(Pose((0.5, 0.1, -0.02), LOOKING_DOWN), start)
    with pytest.raises(Failure) as caught:
        cell.run(cell.move.along(swing(start, into_table, 1.0), guard=25.0))
    return caught.value


@pytest.mark.parametrize(
    ("limit", "told"), [(25.1, " on a free way, above the limit of 25 N, "), (60.0, " on a free way, ")]
)
def test_a_touch_above_the_limit_says_so(limit: float, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hit of one control period is over before the monitor's mean exceeds its limit."""
    cell = Cell(force=limit)

    def unconcerned(*_: object) -> bool:
        return False

    monkeypatch.setattr(cell.monitor, "check", unconcerned)
    failure = onto_the_table(cell)
    assert failure.evidence["limit"] == limit
    assert failure.message.startswith(f"touched something at {failure.evidence['force']:.0f} N{told}")


def test_guard_on_a_free_way() -> None:
    cell = Cell()
    failure = onto_the_table(cell)
    assert failure.cause.name == "world.disturbed"
    evidence = failure.evidence
    assert isinstance(evidence["force"], float) and 25.0 < evidence["force"] < 60.0
    assert isinstance(evidence["fraction"], float) and 0.3 < evidence["fraction"] < 0.9
    assert evidence["direction"] == pytest.approx([0.0, 0.0, 1.0], abs=0.01)
    assert cell.loop.at_rest
    assert abs(cell.loop.wrist.force[2]) < 10.0
    assert cell.monitor.stopped is None


def test_tare_load_and_external_wrench() -> None:
    cell = Cell()
    cell.go(0.5, 0.0, 0.3)
    cell.run(cell.loop.settle())
    wrench = cell.loop.wrench_external()
    np.testing.assert_allclose((*wrench.force, *wrench.torque), np.zeros(6), atol=1e-4)
    turned = HOME + np.array([0.3, 0.2, 0.1, -0.2, 0.6, 0.4, 0.3])
    cell.run(cell.move.along(swing(cell.loop.held_position, turned)))
    cell.run(cell.loop.settle())
    wrench = cell.loop.wrench_external()
    np.testing.assert_allclose((*wrench.force, *wrench.torque), np.zeros(6), atol=1e-4)
