"""Items on a belt are seen as on a table: where they are, and where they no longer are."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.robot.perception import Perception, update_belief
from picktree.simulation.physics import PhysicsHardware
from picktree.world import PlanningScene
from picktree.world.robot_model import RobotModel

from ..simulation.belt_cell import belt_scene, on_belt, positions, ride
from ..simulation.simulated_cell import panda

KINDS = ("plate", "block", "ball", "can")


def observe(hardware: PhysicsHardware, perception: Perception, scene: PlanningScene) -> None:
    joints, width = hardware.arm.read().position, hardware.gripper.read().width
    view = perception.detect(hardware.cameras["overhead"].capture(), joints, width, scene.held)
    assert view.unexplained == ()
    update_belief(scene, view, hardware.clock.now)


def believed(scene: PlanningScene) -> dict[str, tuple[float, ...]]:
    return {o.id: o.pose.position for o in scene.objects}


def test_items_on_a_belt_are_found_and_found_again_when_it_has_run() -> None:
    description = belt_scene(*KINDS, length=0.9)
    hardware = on_belt(description, [0.36, 0.14, -0.10, -0.34])
    perception = Perception(description, RobotModel(panda()))
    scene = PlanningScene(description.fixtures, description.bins)
    observe(hardware, perception, scene)
    first = believed(scene)
    assert [name.rsplit("_", 1)[0] for name in sorted(first)] == [
        "red_ball2", "red_block1", "red_can3", "red_plate0"
    ]  # fmt: skip
    plate, *others = (f"red_{kind}{n}_1" for n, kind in enumerate(KINDS))
    truth = dict(zip((plate, *others), positions(hardware), strict=True))
    # Little of the table is in sight beside the belt: its tilt leaves up to 2 mm, alike for all items.
    assert {name: pytest.approx(truth[name], abs=3e-3) for name in first} == first
    scene.put(replace(scene.get(others[0]), place="aside"), "given up")  # type: ignore[arg-type]

    ride(hardware, 0.12)
    observe(hardware, perception, scene)
    truth = dict(zip((plate, *others), positions(hardware), strict=True))
    assert truth[plate][2] < 0.0
    assert {name: pytest.approx(truth[name], abs=2e-3) for name in others} == believed(scene)
    assert {o.place for o in scene.objects} == {"table"}
