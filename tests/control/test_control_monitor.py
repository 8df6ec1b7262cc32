"""The safety monitor: latched, acknowledged by one voice, and no trap."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.files import PicktreeError
from picktree.world import Failure, Pose

from .control_cell import DOWN, HOME, Cell, reach, swing


def crashed() -> Cell:
    """A cell whose arm has run into the table: a stop is latched."""
    cell = Cell(force=30.0)
    cell.go(0.5, 0.1, 0.08)
    start = cell.loop.held_position
    into_table = reach(Pose((0.5, 0.1, -0.02), DOWN), start)
    with pytest.raises(Failure, match=r"^safety.force_limit: \d+ N at the wrist, above the limit of 30 N$"):
        cell.run(cell.move.along(swing(start, into_table, 1.0)))
    return cell


def test_latched_stop_refuses_motion_until_acknowledged() -> None:
    cell = crashed()
    events = [e for e in cell.events() if e.kind == "safety_stop"]
    assert [e.data["cause"] for e in events] == ["safety.force_limit"]
    cell.run(cell.move.rest())
    assert abs(cell.loop.wrist.force[2]) < 10.0
    start = cell.loop.held_position
    up = swing(start, reach(Pose((0.5, 0.1, 0.1), DOWN), start))
    guarded = cell.move.guarded((0.0, 0.0, 1.0), 0.05, force=5.0, speed=0.05)
    for motion in (cell.move.along(up), guarded):
        with pytest.raises(Failure, match=r"^safety.stop: a safety stop is not acknowledged: \d+ N at"):
            cell.run(motion)
    cell.run(cell.move.rest())
    cell.monitor.acknowledge()
    cell.run(cell.move.along(up))
    assert cell.loop.tcp.position[2] == pytest.approx(0.1, abs=1e-6)
    assert cell.monitor.stopped is None and cell.monitor.stops == 1


def test_save_and_restore_at_rest() -> None:
    cell = crashed()
    cell.run(cell.move.rest())
    cell.loop.tare()
    saved = cell.loop.save()
    twin = Cell(force=30.0)
    twin.hardware.restore(cell.hardware.checkpoint())
    twin.loop.restore(saved)
    assert twin.loop.save() == saved
    assert twin.monitor.stopped == cell.monitor.stopped
    for one in (cell, twin):
        one.monitor.acknowledge()
        start = one.loop.held_position
        one.run(one.move.along(swing(start, HOME)))
    assert twin.hardware.checkpoint() == cell.hardware.checkpoint()
    assert twin.loop.save() == cell.loop.save()


def test_no_saving_while_moving() -> None:
    cell = Cell()
    cell.ticks(cell.move.along(swing(HOME, HOME + 0.1)), 5)
    with pytest.raises(PicktreeError, match="only be saved while the arm is held at rest"):
        cell.loop.save()


def test_a_lease_from_before_a_restore_is_stale() -> None:
    cell = Cell()
    cell.loop.step_tick(0.05)
    saved = replace(cell.loop.save())
    lease = cell.loop.acquire("before")
    cell.loop.restore(saved)
    assert not lease.valid
