"""A moving arm goes from one skill to the next without braking, and never on by itself."""

from __future__ import annotations

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.world import Array, Failure, Pose, Trajectory, grasp

from .control_cell import DOWN, HOME, MODEL, TICK, Cell, reach, swing

ASIDE = HOME + np.array([0.8, 0.3, -0.4, 0.3, 0.2, -0.3, 0.5])


class Watched(Cell):
    """Keeps every velocity that the servo was told."""

    def __init__(self, force: float = 60.0) -> None:
        super().__init__(force=force)
        self.velocities: list[Array] = []
        follow = self.hardware.arm.follow

        def listening(position: Array, velocity: Array) -> None:
            self.velocities.append(velocity.copy())
            follow(position, velocity)

        self.hardware.arm.follow = listening

    def steps(self) -> Array:
        """Greatest change of the commanded velocity against what the joints' limits allow."""
        told = np.array(self.velocities)
        change = np.abs(np.diff(told, axis=0)) / self.loop.period / MODEL.acceleration_limit
        return change.max(axis=1)


def handed_over(cell: Cell, at: float = 0.5) -> None:
    cell.run(cell.move.along(swing(HOME, ASIDE, 2.0), node="first", guard=25.0, hand_over=at))


def test_the_next_skill_goes_on_without_braking() -> None:
    cell = Watched()
    handed_over(cell)
    going = cell.move.ongoing
    assert going is not None
    assert (going.node, going.guard) == ("first", 25.0)
    assert 0.5 <= going.elapsed < 0.5 + TICK + 1e-9
    assert np.array_equal(going.trajectory.end, ASIDE)
    begin = cell.loop.now
    cell.run(cell.move.finish(node="second"))
    assert cell.loop.now - begin == pytest.approx(1.55, abs=2 * TICK)
    np.testing.assert_allclose(cell.loop.state.position, ASIDE, atol=1e-6)
    assert cell.steps().max() < 0.8
    assert cell.move.ongoing is None


def test_it_may_be_handed_on_again() -> None:
    cell = Watched()
    handed_over(cell)
    cell.run(cell.move.finish(node="second", hand_over=1.2))
    going = cell.move.ongoing
    assert going is not None and going.node == "second" and going.elapsed >= 1.2
    cell.run(cell.move.finish(node="third"))
    np.testing.assert_allclose(cell.loop.state.position, ASIDE, atol=1e-6)
    assert cell.steps().max() < 0.8


def test_one_tick_without_anybody_is_no_matter() -> None:
    cell = Watched()
    handed_over(cell)
    cell.loop.step_tick(TICK)
    cell.run(cell.move.finish(node="second"))
    np.testing.assert_allclose(cell.loop.state.position, ASIDE, atol=1e-6)
    assert cell.steps().max() < 0.8


def test_when_nobody_takes_it_the_arm_brakes_on_its_path_within_its_limits() -> None:
    cell = Watched()
    handed_over(cell)
    for _ in range(3):
        cell.loop.step_tick(TICK)
    assert cell.move.ongoing is None
    cell.rest()
    assert cell.steps().max() < 1.05
    back = cell.move.way_back()
    assert back is not None and np.abs(back.start - cell.loop.held_position).max() < 1e-6
    with pytest.raises(Failure) as caught:
        cell.run(cell.move.finish(node="second"))
    assert str(caught.value).startswith(
        "control.timeout: nobody went on in time with the motion that first handed over: it ended after 3"
    )


def test_whoever_else_takes_the_arm_brakes_it() -> None:
    cell = Watched()
    handed_over(cell)
    cell.run(cell.move.rest())
    assert cell.move.ongoing is None
    assert cell.steps().max() < 1.05
    cell.run(cell.move.along(swing(cell.loop.held_position, HOME, 2.0)))
    np.testing.assert_allclose(cell.loop.state.position, HOME, atol=1e-6)


def test_halting_whoever_finishes_it_brakes() -> None:
    cell = Watched()
    handed_over(cell)
    doing = cell.move.finish(node="second")
    cell.ticks(doing, 4)
    doing.close()
    cell.rest()
    assert cell.steps().max() < 1.05
    assert np.abs(cell.loop.state.position - ASIDE).max() > 0.1


def test_the_first_skill_cannot_brake_what_it_handed_over() -> None:
    cell = Watched()
    first = cell.move.along(swing(HOME, ASIDE, 2.0), node="first", hand_over=0.5)
    cell.run(first)
    second = cell.move.finish(node="second")
    cell.ticks(second, 2)
    first.close()
    cell.run(second)
    np.testing.assert_allclose(cell.loop.state.position, ASIDE, atol=1e-6)


def test_the_way_back_leads_to_where_the_first_skill_began() -> None:
    cell = Watched()
    handed_over(cell)
    doing = cell.move.finish(node="second")
    cell.ticks(doing, 10)
    doing.close()
    cell.rest()
    back = cell.move.way_back()
    assert back is not None
    cell.run(cell.move.along(back))
    np.testing.assert_allclose(cell.loop.state.position, HOME, atol=1e-6)


def test_a_late_hand_over_is_an_arrival() -> None:
    cell = Watched()
    handed_over(cell, at=9.0)
    assert cell.loop.at_rest and cell.move.ongoing is None
    with pytest.raises(PicktreeError, match=r"^second finishes a motion, but none was handed over$"):
        cell.run(cell.move.finish(node="second"))


@pytest.mark.parametrize(
    ("guard", "limit", "told"),
    [
        (25.0, 60.0, r"^world\.disturbed: touched something at"),
        (None, 25.0, r"^safety\.force_limit: "),
    ],
)
def test_a_contact_while_nobody_attends_stops_the_arm_and_is_told(
    guard: float | None, limit: float, told: str
) -> None:
    def into_table() -> tuple[Watched, Trajectory]:
        cell = Watched(limit)
        cell.go(0.5, 0.0, 0.05)
        start = cell.loop.held_position
        return cell, swing(start, reach(Pose((0.5, 0.0, -0.05), DOWN), start), 1.0)

    cell, motion = into_table()
    doing, contact = cell.move.along(motion, guard=guard), 0.0
    begin = cell.loop.now
    with pytest.raises(Failure, match=told):
        while True:
            next(doing)
            cell.loop.step_tick(TICK)
            if cell.loop.controller == "Track":
                contact = cell.loop.now - begin

    cell, motion = into_table()
    cell.run(cell.move.along(motion, node="first", guard=guard, hand_over=contact - 1.5 * TICK))
    assert cell.move.ongoing is not None
    for _ in range(2):
        cell.loop.step_tick(TICK)
    assert cell.move.ongoing is None
    with pytest.raises(Failure, match=told):
        cell.run(cell.move.finish(node="second"))
    cell.rest()


def test_a_watch_brakes_and_is_raised_at_rest() -> None:
    cell = Watched()
    asked: list[float] = []

    def watch() -> Failure | None:
        asked.append(cell.loop.now)
        return Failure(grasp.SLIPPED, "gone", width=0.0) if cell.loop.now > 0.6 else None

    with pytest.raises(Failure) as caught:
        cell.run(cell.move.along(swing(HOME, ASIDE, 2.0), node="a", watch=watch))
    assert caught.value.cause == grasp.SLIPPED
    assert asked[-1] == pytest.approx(0.65) and np.diff(asked) == pytest.approx(TICK)
    assert cell.loop.at_rest and cell.steps().max() < 1.05
    assert 0.05 < np.abs(cell.loop.state.position - HOME).max() < 0.7


def test_whoever_finishes_watches_too() -> None:
    cell = Watched()
    handed_over(cell)
    lost = Failure(grasp.SLIPPED, "gone", width=0.0)
    with pytest.raises(Failure) as caught:
        cell.run(cell.move.finish(node="second", watch=lambda: lost))
    assert caught.value is lost
    assert cell.loop.at_rest
