"""Second rule: contact is physical. What is held is held by friction, what is dropped falls."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
import pybullet as pb
import pytest

from picktree.simulation.physics import PhysicsHardware
from picktree.world import GripperCommand

from .skills.cell import Cell, items, mission, sorting

SETTING = ("resetBasePositionAndOrientation", "resetBaseVelocity", "resetJointState", "resetSimulation")
TYING = ("createConstraint", "removeConstraint", "removeBody", "createMultiBody", "applyExternalForce")
PICK = """\
Sequence:
  - Observe: {camera: overhead, objects: "{items}"}
  - ForEach:
      in: "{items}"
      out: "{item}"
      do: [{Grasp: {object: "{item}"}}, {Place: {object: "{item}", into: "{item.destination}"}}]
"""


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often pybullet was asked to set, tie or push something instead of simulating it."""
    counted: Counter[str] = Counter()

    def spied(name: str) -> Callable[..., object]:
        function = getattr(pb, name)

        def spy(*args: object, **options: object) -> object:
            if not (name == "resetBaseVelocity" and put_to_sleep(*args)):
                counted[name] += 1
            return function(*args, **options)

        return spy

    for name in (*SETTING, *TYING):
        monkeypatch.setattr(pb, name, spied(name))
    return counted


def put_to_sleep(body: int, linear: object, angular: object, client: int) -> bool:
    """Whether a body that stands still is told to stand still."""
    speeds = np.abs(pb.getBaseVelocity(body, client))
    return not (np.any(linear) or np.any(angular)) and bool(speeds[0].max() < 0.01 and speeds[1].max() < 0.1)


def held_until(cell: Cell, leaf: str) -> PhysicsHardware:
    """Drive until something is in the hand and `leaf` runs."""
    hardware = cell.hardware
    assert isinstance(hardware, PhysicsHardware)
    while cell.world.scene.held is None or cell.leaf != leaf:
        cell.tick()
        assert cell.running
    return hardware


def test_during_a_run_nothing_is_set_tied_or_pushed(calls: Counter[str]) -> None:
    """What already rests may be told to rest: that moves nothing."""
    cell = Cell(sorting(), items(block=1), "physics")
    assert calls["createConstraint"] == 1
    calls.clear()
    hardware = cell.hardware
    assert isinstance(hardware, PhysicsHardware)
    constraints: set[tuple[bool, int]] = set()
    while True:
        before = hardware.truth()
        cell.tree.tick()
        assert hardware.truth() == before, "a tick of the tree moved a body"
        if not cell.running:
            break
        cell.wait()
        held = cell.world.scene.held is not None
        constraints.add((held, pb.getNumConstraints(physicsClientId=hardware._client)))
    assert cell.score().count.sorted == 1
    assert calls == Counter()
    assert constraints == {(False, 1), (True, 1)}

    hardware.checkpoint()
    assert calls["resetSimulation"] == 1, "the spy sees nothing"


def test_the_only_constraint_is_the_gear_between_the_fingers() -> None:
    hardware = held_until(Cell(mission(PICK), items(block=1), "physics"), "Place")
    client = hardware._client
    (number,) = (pb.getConstraintUniqueId(n, client) for n in range(pb.getNumConstraints(client)))
    parent, parent_link, child, child_link, kind, *_ = pb.getConstraintInfo(number, client)
    assert kind == pb.JOINT_GEAR
    links = {
        pb.getJointInfo(body, link, client)[12] for body, link in ((parent, parent_link), (child, child_link))
    }
    assert links == {b"panda_leftfinger", b"panda_rightfinger"}


def test_an_item_hangs_on_the_fingers_alone_and_by_friction() -> None:
    hardware = held_until(Cell(mission(PICK), items(block=1), "physics"), "Place")
    touching = {
        c.other if c.one == "item_00" else c.one
        for c in hardware.true_contacts()
        if "item_00" in (c.one, c.other)
    }
    assert touching == {"panda_leftfinger", "panda_rightfinger"}


@pytest.mark.parametrize("accident", ["opened", "loosened", "oiled"])
def test_a_dropped_item_falls_and_the_skill_finds_out_by_feeling(accident: str) -> None:
    cell = Cell(mission(PICK), items(block=1), "physics")
    hardware = held_until(cell, "Place")
    (body,) = hardware.truth()
    assert body.pose.position[2] > 0.08
    if accident == "opened":
        hardware.gripper.command(GripperCommand(0.08, 20.0))
    elif accident == "loosened":
        hardware.gripper.command(GripperCommand(0.0, 0.1))
    else:
        hardware.change_dynamics(body.id, friction=0.005)
    held = cell.world.scene.held
    heights = [body.pose.position[2]]
    for _ in range(8):
        if cell.running:  # it may be noticed before the item has come to rest
            cell.tick()
        else:
            cell.wait()
        heights.append(hardware.truth()[0].pose.position[2])
    fall = -np.diff(heights) / 0.05
    assert heights[-1] < 0.03
    assert fall.max() > 0.3, "it sank instead of falling"
    assert held is not None

    if cell.running:
        cell.finish()
    assert cell.tree.failure is not None
    assert str(cell.tree.failure.cause) == "grasp.slipped"
    assert cell.tree.failure.message.startswith(f"{held.id} was lost on the way (opening ")
    assert cell.world.scene.held is None
