"""Taking stock: what is felt, put down, seen and counted before a run goes on as things stand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from picktree.recovery.belief_restart import ResyncReport, resync_belief
from picktree.simulation.fault_files.device_entries import AtTime, CameraDrop, GripperJam
from picktree.simulation.kinematic.backend import KinematicHardware
from picktree.world.journal import JournalEvent
from picktree.world.values import ObjectId, Pose

from ..skills.cell import LIMIT, Cell, items, mission

FIRST = "the run goes on as things stand: it looks first, with the belief of before"


def cell(**counts: int) -> tuple[Cell, KinematicHardware]:
    made = Cell(mission("Observe: {camera: overhead}"), items(**counts))
    made.finish()
    made.events.clear()
    assert isinstance(made.hardware, KinematicHardware)
    return made, made.hardware


def stock(cell: Cell, watch: Callable[[], object] = lambda: None) -> tuple[ResyncReport, list[str]]:
    """What is found, and what is said on the way. `watch` is called after each tick."""
    taking = resync_belief(cell.world)
    cell.world.journal.take()
    while cell.world.clock.now < LIMIT:
        try:
            next(taking)
        except StopIteration as end:
            found = end.value
            assert isinstance(found, ResyncReport)
            break
        cell.wait()
        watch()
    else:
        raise AssertionError("it hangs")
    events = [e for e in cell.world.journal.take() if isinstance(e, JournalEvent)]
    return found, [e.message for e in events if e.kind == "took_stock"]


def at_home(cell: Cell) -> bool:
    return float(np.abs(cell.world.control.state.position - cell.world.robot.named("home")).max()) < 2e-3


def grasped(cell: Cell) -> str:
    item = str(next(o.id for o in cell.world.scene.objects))
    cell.start(mission(f"Sequence: [{{Grasp: {{object: {item}, onward: false}}}}, {{GoTo: {{pose: rest}}}}]"))
    cell.finish()
    assert cell.tree.failure is None
    return item


def forget_the_hand(cell: Cell, item: str) -> None:
    """The older belief: the item still lay where it was seen."""
    held = cell.world.scene.get(item)
    cell.world.scene.put(
        replace(held, object_in_tcp=None, pose=Pose((0.5, 0.1, 0.02)), place="table"), "as it was"
    )


def test_with_an_empty_hand_it_goes_home_and_looks() -> None:
    made, _ = cell(block=1, can=1)
    made.start(mission("GoTo: {pose: rest}"))
    made.finish()
    looks = made.world.eyes.looks
    found, notes = stock(made)
    assert found == ResyncReport((), (), False)
    assert notes == [FIRST, "looked: nothing more is done; 2 to be done"]
    assert at_home(made)
    assert made.world.eyes.looks > looks
    assert made.world.grip.width > 0.07


def test_what_is_in_the_hand_is_felt_put_down_and_known_again() -> None:
    made, hardware = cell(block=1)
    item = grasped(made)
    forget_the_hand(made, item)
    made.world.attempts.failed("Main/Grasp", item, "top 0")
    width, before = 1000 * made.world.grip.width, made.world.attempts.state()
    found, notes = stock(made)
    assert found == ResyncReport((), (), True)
    assert notes == [
        FIRST,
        f"something is in the hand: opening {width:.1f} mm, load 0.98 N",
        "looked: nothing more is done; 1 to be done",
    ]
    assert hardware.bodies.held is None
    assert made.world.scene.held is None
    (body,) = hardware.truth()
    (known,) = made.world.scene.objects
    assert (known.id, known.place) == (item, "table")
    assert known.pose.distance(body.pose) < 0.005
    assert at_home(made)
    assert made.world.attempts.state() == before


def test_what_was_done_meanwhile_counts_and_what_is_gone_does_not() -> None:
    made, hardware = cell(block=1, can=1)
    block, can = (next(o.id for o in made.world.scene.objects if o.kind == k) for k in ("block", "can"))
    into = made.world.scene.destination(block)
    assert into is not None
    (there,) = (b for b in made.world.scene.bins.values() if b.id == into)
    (body,) = (b for b in hardware.bodies.items if b.entry.kind == "block")
    hardware.bodies.put(replace(body, pose=there.pose.shifted((0.0, 0.0, there.wall + 0.02))))
    hardware.remove(next(b.id for b in hardware.bodies.items if b.entry.kind == "can"))
    made.world.journal.items_done = 3
    found, notes = stock(made)
    assert found == ResyncReport((block,), (can,), False)
    assert made.world.journal.items_done == 4
    assert notes == [
        FIRST,
        f"looked: {block} is done; {can} is seen nowhere, and not counted as done; 0 to be done",
    ]


def test_of_several_that_are_alike_the_nearest_is_the_same() -> None:
    made, hardware = cell(block=1)
    (block,) = made.world.scene.objects
    far = replace(block, id=ObjectId("red_block_8"), pose=Pose((0.5, -0.3, 0.02)))
    other = replace(block, id=ObjectId("red_can_1"), kind="can", pose=Pose((0.5, 0.19, 0.02)))
    near = replace(block, id=ObjectId("red_block_9"), pose=Pose((0.45, 0.2, 0.02)))
    scene = made.world.scene
    scene.remove(block.id, "test")
    for one in (far, other, near):
        scene.put(one, "as it was")
    (body,) = hardware.bodies.items
    hardware.bodies.put(replace(body, pose=Pose((0.45, 0.24, 0.02)), colour=block.colour))
    stock(made)
    assert [o.id for o in scene.objects if o.role == "item"] == ["red_block_9"]


def test_fingers_that_do_not_close_have_something_between_them() -> None:
    """Jammed they seem to hold something that weighs nothing: it is let down, and the hand told to open."""
    made, hardware = cell(block=1)
    hardware.gripper.width = hardware.gripper.target = 0.03
    hardware.afflict(0, GripperJam(AtTime(0.0)))
    heights = [made.world.control.tcp.position[2]]
    found, notes = stock(made, lambda: heights.append(made.world.control.tcp.position[2]))
    assert found == ResyncReport((), (), True)
    said = (
        "something is between the fingers, and weighs next to nothing: opening 30.0 mm, load 0.00 N",
        "the arm does not get home: the fingers opened 30 mm of 80 mm",
    )
    assert notes == [FIRST, *said, *said, "looked: nothing more is done; 1 to be done"]
    assert made.world.scene.find("in_hand") is None
    # Twice it is let down, as nothing is touched by as much as is allowed.
    assert min(heights) == pytest.approx(heights[0] - 0.3, abs=0.02)


def test_what_is_held_is_not_held_any_more_gently_while_it_is_felt() -> None:
    made, hardware = cell(block=1)
    forget_the_hand(made, grasped(made))
    pressed = hardware.gripper.force
    assert pressed > 5.0
    forces: list[float] = []

    def watch() -> None:
        if hardware.bodies.held is not None and hardware.gripper.target < hardware.gripper.width:
            forces.append(hardware.gripper.force)

    stock(made, watch)
    assert min(forces) >= pressed - 1e-9


def test_fingers_that_close_have_nothing_between_them() -> None:
    made, hardware = cell(block=1)
    hardware.gripper.width = hardware.gripper.target = 0.03
    forces = set[float]()
    found, notes = stock(made, lambda: forces.add(hardware.gripper.force))
    assert found == ResyncReport((), (), False)
    assert forces == {5.0}
    assert notes == [FIRST, "looked: nothing more is done; 1 to be done"]


def test_a_camera_that_shows_nothing_is_told() -> None:
    made, hardware = cell(block=1)
    hardware.afflict(0, CameraDrop(AtTime(0.0)))
    found, notes = stock(made)
    assert found == ResyncReport((), (), False)
    assert notes[1].startswith("overhead shows nothing: ")
    assert notes[2] == "looked: nothing more is done; 1 to be done"
