"""ResetGripper: fingers that follow again, later, or never, in a cell without physics."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from picktree.simulation.fault_entries import AtTime, GripperJam
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import Box, Cause, Failure, control, safety

from ..skills.cell import Cell, holding, looked, mission

if TYPE_CHECKING:
    from picktree.trees import Doing


def cell(body: str) -> tuple[Cell, KinematicHardware]:
    made, _ = looked(block=1)
    made.start(mission(body))
    made.events.clear()
    return made, made.kinematic


def ended(cell: Cell) -> tuple[str, float]:
    """What a mission failed of, empty when it succeeded, and how long it took."""
    began = cell.world.clock.now
    cell.finish()
    return cell.told, cell.world.clock.now - began


def jam(hardware: KinematicHardware) -> None:
    hardware.afflict(0, GripperJam(AtTime(0.0)))


def test_fingers_that_follow_are_moved_to_and_fro_once() -> None:
    made, _ = cell("ResetGripper")
    told, seconds = ended(made)
    assert told == ""
    assert made.happened("gripper_reset") == ["gripper_reset: the fingers follow again, at try 1"]
    assert made.world.gripper.width == pytest.approx(0.08, abs=1e-3)
    assert 0.5 < seconds < 1.5


def test_it_closes_with_the_force_that_is_asked_for() -> None:
    made, hardware = cell("ResetGripper: {force: 12 N}")
    forces = set[float]()
    made.tick()
    while made.running:
        made.tick()
        if hardware.gripper.target == 0.0:
            forces.add(hardware.gripper.force)
    assert forces == {12.0}


def test_what_jams_may_come_free_between_two_tries() -> None:
    made, hardware = cell("ResetGripper: {wait: 3 s}")
    jam(hardware)
    for _ in range(int(3.0 / made.world.tick)):
        made.tick()
        assert made.running
    assert made.happened("gripper_reset") == []
    hardware.relieve(0)
    told, _ = ended(made)
    assert told == ""
    assert made.happened("gripper_reset") == ["gripper_reset: the fingers follow again, at try 2"]


@pytest.mark.parametrize("tries", [1, 3])
def test_fingers_that_never_follow_are_told(tries: int) -> None:
    made, hardware = cell(f"ResetGripper: {{tries: {tries}, wait: 2 s}}")
    jam(hardware)
    told, seconds = ended(made)
    assert told == (
        f"control.gripper: after {tries} tries the fingers still do not follow: they closed from 80 mm "
        "to 80 mm only"
    )
    assert made.failure.evidence == {"width": pytest.approx(0.08), "tries": tries}
    assert 2.0 * tries < seconds < 3.0 * tries


@pytest.mark.parametrize(
    ("wide", "told"),
    [
        (0.039, ""),
        (0.040, ""),
        (
            0.041,
            "control.gripper: after 1 tries the fingers still do not follow: they closed from 80 mm to 41 mm "
            "only",
        ),
    ],
)
def test_something_between_the_fingers_may_take_half_of_their_way(wide: float, told: str) -> None:
    made, hardware = cell("ResetGripper: {tries: 1}")
    (body,) = hardware.bodies.items
    entry = replace(body.entry, shape=Box((0.03, wide, 0.03)))
    hardware.bodies.put(replace(body, entry=entry, pose=hardware.true_tcp()))
    assert ended(made)[0] == told


def test_a_hand_that_holds_something_is_not_reset_unless_it_may_be_dropped() -> None:
    made, block = holding()
    assert made.do("ResetGripper") == f"grasp.no_candidate: the hand is not free: it holds {block}"
    assert made.failure.evidence == {"object": block, "held": block}
    assert made.kinematic.bodies.held is not None
    assert made.do("ResetGripper: {drop: true}") == ""
    assert made.kinematic.bodies.held is None
    assert made.world.scene.held is None


@pytest.mark.parametrize("cause", [control.GRIPPER, control.TIMEOUT, safety.STOP])
@pytest.mark.parametrize("move", ["open", "close"])
def test_a_refusal_of_the_gripper_is_tried_again_and_a_stop_is_not(
    cause: Cause, move: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, _ = cell("ResetGripper: {tries: 2, wait: 1 s}")
    refused, moves = list[Failure](), getattr(made.world.gripper, move)

    def moving(*given: Any) -> Any:
        if not refused:
            refused.append(Failure(cause, "it was refused"))
            raise refused[0]
        return moves(*given)

    monkeypatch.setattr(made.world.gripper, move, moving)
    told, _ = ended(made)
    if cause is safety.STOP:
        assert told == "safety.stop: it was refused"
    else:
        assert told == ""
        assert made.happened("gripper_reset") == ["gripper_reset: the fingers follow again, at try 2"]


@pytest.mark.parametrize(
    ("short", "told"), [(0.004, ""), (0.08 - 0.075, ""), (0.006, "they opened to 74 mm of 80 mm")]
)
def test_fingers_must_open_but_for_some_millimetres(
    short: float, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, hardware = cell("ResetGripper: {tries: 1, wait: 0 s}")

    def opens(*given: Any) -> Doing[None]:
        hardware.gripper.width = hardware.gripper.target = 0.08 - short
        yield

    monkeypatch.setattr("picktree.robot.manipulation.held_object.open_gripper", opens)
    if told:
        told = f"control.gripper: after 1 tries the fingers still do not follow: {told}"
    assert ended(made)[0] == told


def test_the_fingers_wait_until_the_arm_stands() -> None:
    made, hardware = cell("GoTo: {pose: rest}")
    while made.speed < 0.1:
        made.tick()
        assert made.running
    made.halt()
    made.start(mission("ResetGripper"))
    before = hardware.gripper.target
    for _ in range(100):
        made.tick()
        if hardware.gripper.target != before:
            break
    assert hardware.gripper.target != before
    assert made.world.control.at_rest
    assert made.speed < 1e-3


@pytest.mark.parametrize("wait", [0.0, 0.5])
def test_between_two_tries_it_waits_that_long(wait: float, monkeypatch: pytest.MonkeyPatch) -> None:
    made, hardware = cell(f"ResetGripper: {{tries: 2, wait: {wait}}}")
    jam(hardware)
    began, closes = list[float](), made.world.gripper.close

    def closing(force: float) -> Any:
        began.append(made.world.clock.now)
        result = yield from closes(force)
        began.append(made.world.clock.now)
        return result

    monkeypatch.setattr(made.world.gripper, "close", closing)
    ended(made)
    assert wait <= began[2] - began[1] < wait + 0.3  # and opened again
    assert made.world.clock.now - began[-1] == pytest.approx(wait, abs=1e-6)
