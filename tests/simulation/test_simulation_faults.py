"""Faults happen once, at their time or when their node starts, to the item that is meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.files import PicktreeError
from picktree.simulation import FaultInjector, parse_faults
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware

from .simulated_cell import cell, panda

Hardware = PhysicsHardware | KinematicHardware
FILE = """
picktree: 1
kind: faults
faults:
  - {fault: remove, when: {at: 100 ms}, target: {index: 3}}
  - {fault: friction, when: {node: Grasp, start: 2}, target: {kind: block}, friction: 0.05, mass: 0.5}
  - {fault: bump, when: {node: Observe, delay: 50 ms}, target: {form: sphere}, velocity: [0.3, 0, 0]}
  - {fault: remove, when: {node: Place}, target: {nearest_to: object}}
  - {fault: remove, when: {node: GoTo}, target: {colour: green}}
"""


def cell_with_faults(backend: type[Hardware] = KinematicHardware) -> tuple[Hardware, FaultInjector]:
    hardware = backend(cell(), panda(), 1)
    return hardware, injector(hardware)


def injector(hardware: Hardware) -> FaultInjector:
    near = hardware.truth()[7].pose.position
    file = parse_faults(FILE, Path("faults.yaml"))
    return FaultInjector(file, hardware, lambda path: near if path.endswith("Place") else None)


def wait(hardware: Hardware, seconds: float) -> None:
    for _ in range(round(seconds * 240)):
        hardware.step()


def test_a_fault_at_a_time_happens_once():
    hardware, faults = cell_with_faults()
    assert faults.tick() == ()
    wait(hardware, 0.1)
    (happened,) = faults.tick()
    assert happened.kind == "fault"
    assert happened.message == "item_03 is snatched away"
    assert happened.data["item"] == "item_03"
    assert not hardware.truth()[3].present
    wait(hardware, 0.1)
    assert faults.tick() == ()


def test_faults_without_an_occasion_are_known():
    hardware, faults = cell_with_faults()
    assert faults.never_due == ("remove", "friction", "bump", "remove", "remove")
    wait(hardware, 0.1)
    for path in ("Main/SortOne/Grasp", "Main/Observe", "Main/SortOne/Place"):
        faults.node_started(path)
    assert faults.never_due == ("friction", "remove")
    faults.node_started("Main/SortOne/Grasp")
    assert faults.never_due == ("remove",)


def test_a_fault_waits_for_the_second_start_of_its_node():
    _, faults = cell_with_faults()
    faults.node_started("Main/SortOne/Grasp")
    assert faults.tick() == ()
    faults.node_started("Main/SortOne/Grasp")
    (happened,) = faults.tick()
    assert happened.message == "item_00 has friction 0.05 now and weighs 0.5 kg"
    assert happened.node == "Main/SortOne/Grasp"


def test_a_bump_comes_after_its_delay_and_sets_the_item_in_motion():
    hardware, faults = cell_with_faults(PhysicsHardware)
    faults.node_started("Main/Observe")
    assert faults.tick() == ()
    wait(hardware, 0.05)
    (happened,) = faults.tick()
    assert happened.message == "item_06 is bumped to 0.30 m/s"
    start = hardware.truth()[6].pose
    wait(hardware, 0.2)
    assert hardware.truth()[6].pose.position[0] - start.position[0] > 0.03


@pytest.mark.parametrize(
    ("node", "said"),
    [("Main/SortOne/Place", "item_07 is snatched away"), ("GoTo", "remove: no item fits")],
)
def test_the_item_nearest_to_the_nodes_object_is_meant_and_none_that_does_not_fit(node: str, said: str):
    _, faults = cell_with_faults()
    faults.node_started(node)
    assert [happened.message for happened in faults.tick()] == [said]


def test_what_has_happened_does_not_happen_again_after_a_restore():
    hardware, faults = cell_with_faults()
    faults.node_started("Main/SortOne/Grasp")
    wait(hardware, 0.1)
    faults.tick()
    again = injector(hardware)
    again.restore(faults.state())
    assert again.tick() == ()
    again.node_started("Main/SortOne/Grasp")
    assert len(again.tick()) == 1
    with pytest.raises(PicktreeError, match="the checkpoint knows 5 faults, the file 0"):
        FaultInjector(None, hardware).restore(faults.state())
