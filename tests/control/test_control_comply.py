"""Compliant courses in physics: force along an axis, a spring for each axis, a finer step in contact."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.robot.control import CartesianStiffness, CompliantMotion, ContactState
from picktree.robot.control.contact_motion import CompliantMotionResult
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Vector3

from .control_cell import TICK, Cell

DOWN_FREE = CartesianStiffness(linear=(600.0, 600.0, 0.0), angular=20.0)
"""No spring along the vertical: there the wrench alone decides."""


class Press(CompliantMotion):
    """Push down with so many newtons for a while."""

    def __init__(self, force: float, seconds: float, aside: float = 0.0) -> None:
        super().__init__()
        self.force, self.seconds, self.aside = force, seconds, aside
        self.felt: list[float] = []

    def step(self, felt: ContactState) -> None:
        self.wrench[2] = -self.force
        self.position = self.origin + np.array([self.aside * min(1.0, felt.elapsed), 0.0, 0.0])
        self.felt.append(float(felt.force[2]))
        self.finished = felt.elapsed >= self.seconds


def physics() -> Cell:
    return Cell(backend=PhysicsHardware)


def press(cell: Cell, course: CompliantMotion, rate: int) -> Generator[None, None, CompliantMotionResult]:
    with cell.loop.contact(rate):
        return (yield from cell.move.comply(course, 3.0, stiffness=DOWN_FREE))


@pytest.mark.parametrize("rate", [240, 1000])
def test_without_stiffness_along_an_axis_the_wrench_is_the_force(rate: int) -> None:
    cell = physics()
    cell.go(0.5, 0.1, 0.02)
    course = Press(8.0, 1.2)
    result = cell.run(press(cell, course, rate))
    assert result.finished
    assert len(course.felt) == pytest.approx(1.2 * rate, abs=2)
    assert float(np.mean(course.felt[len(course.felt) // 2 :])) == pytest.approx(8.0, abs=0.7)
    assert cell.monitor.stopped is None


def test_the_finer_step_ends_once_the_arm_is_held() -> None:
    cell = physics()
    cell.go(0.5, 0.1, 0.05)
    seen: list[float] = []

    def doing() -> Generator[None, None, None]:
        with cell.loop.contact(1000):
            seen.append(cell.loop.period)
            yield from cell.move.comply(Press(0.0, 0.2), 1.0, stiffness=DOWN_FREE)
        seen.append(cell.loop.period)
        yield

    before = cell.loop.now
    cell.run(doing())
    assert seen == [1 / 1000, 1 / 1000]
    assert cell.loop.period == 1 / 240
    ticks = (cell.loop.now - before) / TICK
    assert ticks == pytest.approx(round(ticks), abs=1e-9)


def test_halted_in_contact_it_comes_to_rest_and_back_to_the_everyday_step() -> None:
    cell = physics()
    cell.go(0.5, 0.1, 0.02)
    doing = press(cell, Press(12.0, 2.0, aside=0.03), 500)
    cell.ticks(doing, 15)
    assert cell.loop.controller == "CartesianImpedance"
    doing.close()
    cell.rest()
    cell.loop.step_tick(TICK)
    assert (cell.loop.period, cell.loop.controller) == (1 / 240, "Hold")
    assert np.isfinite(cell.loop.state.position).all()
    cell.go(0.5, 0.0, 0.2)
    assert cell.monitor.stopped is None


def test_taking_over_from_the_spring_makes_no_step() -> None:
    cell = physics()
    cell.go(0.5, 0.1, 0.05)
    doing = cell.move.comply(Press(0.0, 1.0, aside=0.05), 3.0, stiffness=DOWN_FREE)
    cell.ticks(doing, 12)
    speed = cell.loop.state.velocity
    assert float(np.abs(speed).max()) > 0.02
    lease = cell.loop.acquire("another")
    cell.loop.step()
    cell.loop.step()
    change = np.abs(cell.loop.state.velocity - speed) * 120.0
    assert (change < cell.model.acceleration_limit).all()
    lease.release()
    cell.rest()


def test_a_stiffness_for_each_axis_of_the_tool() -> None:
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    spring = CartesianStiffness(linear=(100.0, 200.0, 300.0), angular=5.0, frame="tool")
    in_world = spring.matrix(quarter)
    np.testing.assert_allclose(np.diag(in_world), [200.0, 100.0, 300.0, 5.0, 5.0, 5.0])
    assert spring.along(np.array([1.0, 0.0, 0.0]), quarter) == pytest.approx(200.0)


def test_stiffness_in_a_frame_that_stays_where_it_is() -> None:
    half = float(np.sqrt(0.5))
    spring = CartesianStiffness(linear=(100.0, 200.0, 300.0), frame=(half, 0.0, 0.0, half))
    np.testing.assert_allclose(np.diag(spring.matrix(np.eye(3)))[:3], [100.0, 300.0, 200.0])


PERIOD = 1 / 240


def test_damping_of_an_axis_is_its_share_of_the_critical() -> None:
    inertia = np.diag([4.0, 4.0, 4.0, 0.1, 0.1, 0.1])
    stiffness = CartesianStiffness(linear=(225.0, 400.0, 0.0), angular=10.0, damping=(1.0, 0.5, 0.7))
    spring, matrix = stiffness.sampled(inertia, np.eye(3), PERIOD)
    damping = np.diag(matrix)
    np.testing.assert_allclose(spring, stiffness.matrix(np.eye(3)))
    np.testing.assert_allclose(damping[:2], [2 * np.sqrt(225.0 * 4.0), 0.5 * 2 * np.sqrt(400.0 * 4.0)])
    assert damping[2] == pytest.approx(0.7 * 2 * np.sqrt(200.0 * 4.0))
    one, three = (
        CartesianStiffness(100.0, 10.0, share).sampled(inertia, np.eye(3), PERIOD)[1]
        for share in (0.9, (0.9, 0.9, 0.9))
    )
    np.testing.assert_allclose(one, three)


@pytest.mark.parametrize("damping", [0.9, (0.9, 0.9, 0.9)])
def test_a_light_tool_has_a_spring_that_the_period_can_damp(damping: float | Vector3) -> None:
    light = np.diag([4.0, 4.0, 1.0, 0.1, 0.1, 1e-4])
    stiffness = CartesianStiffness((1500.0, 0.0, 1500.0), 40.0, damping)
    spring, matrix = stiffness.sampled(light, np.eye(3), PERIOD)
    rates = np.diag(matrix) / np.diag(light)
    assert float(rates.max()) * PERIOD == pytest.approx(0.6)
    fastest = 0.6 / (2 * 0.9 * PERIOD)
    # The modes of the heavy axes, and the axis without a spring, stay as they were asked for.
    np.testing.assert_allclose(
        np.diag(spring), [1500.0, 0.0, 1500.0, 40.0, 40.0, 1e-4 * fastest**2], atol=1e-9
    )
    finer, _ = stiffness.sampled(light, np.eye(3), PERIOD / 2)
    assert finer[5, 5] == pytest.approx(4 * spring[5, 5])


def test_a_rate_that_does_not_divide_the_tick_is_refused() -> None:
    cell = physics()
    known = "240, 300, 400, 480, 500, 600, 800, 1000, 1200, 1500, 2000 Hz"
    message = f"^a step of 1/250 s is not possible; rates: {known}$"
    with pytest.raises(PicktreeError, match=message), cell.loop.contact(250):
        pass
    assert cell.loop.period == 1 / 240
