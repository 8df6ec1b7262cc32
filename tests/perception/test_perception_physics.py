"""Perception through the cameras of both simulations."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from picktree.robot.perception import Perception, update_belief
from picktree.simulation import Simulation
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Array, PlanningScene
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import load_scene

PANDA = load_robot("panda")
MODEL = RobotModel(PANDA)


def observe(hardware: Simulation, perception: Perception, scene: PlanningScene) -> None:
    joints, width = hardware.arm.read().position, hardware.gripper.read().width
    view = perception.detect(hardware.cameras["overhead"].capture(), joints, width, scene.held)
    assert view.unexplained == ()
    update_belief(scene, view, hardware.clock.now)


SHOWN = [("three_bins", 0), ("dense", 1), ("sort_small", 2), ("tall", 2100), ("light", 3), ("thin", 4)]


@pytest.mark.parametrize(("scene_name", "seed"), SHOWN)
def test_every_item_of_a_shipped_scene_is_found(scene_name: str, seed: int) -> None:
    description = load_scene(scene_name)
    hardware = PhysicsHardware(description, PANDA, seed)
    scene = PlanningScene(description.fixtures, description.bins)
    observe(hardware, Perception(description, MODEL), scene)
    truth = hardware.truth()
    assert Counter((o.kind, o.colour) for o in scene.objects) == Counter((b.kind, b.colour) for b in truth)
    errors = [min(o.pose.distance(b.pose) for o in scene.objects if o.kind == b.kind) for b in truth]
    assert np.median(errors) < 0.001
    assert max(errors) < 0.003


def test_an_ideal_camera_is_understood_too() -> None:
    description = load_scene("three_bins")
    hardware = KinematicHardware(description, PANDA, 0)
    scene = PlanningScene(description.fixtures, description.bins)
    observe(hardware, Perception(description, MODEL), scene)
    truth = hardware.truth()
    assert len(scene.objects) == len(truth)
    assert max(min(o.pose.distance(b.pose) for o in scene.objects) for b in truth) < 0.003


def test_the_arm_over_the_items_neither_adds_nor_removes_any() -> None:
    description = load_scene("three_bins")
    hardware = PhysicsHardware(description, PANDA, 1)
    perception = Perception(description, MODEL)
    scene = PlanningScene(description.fixtures, description.bins)
    observe(hardware, perception, scene)
    before = {o.id for o in scene.objects}
    over: Array = np.array([0.1, 0.2, 0.0, -2.0, 0.0, 2.2, 0.785])
    start = hardware.arm.read().position
    for k in range(240):
        share = (1 - np.cos(np.pi * (k + 1) / 240)) / 2
        hardware.arm.follow(start + (over - start) * share, np.zeros(7))
        hardware.step()
    joints, width = hardware.arm.read().position, hardware.gripper.read().width
    view = perception.detect(hardware.cameras["overhead"].capture(), joints, width, scene.held)
    summary = update_belief(scene, view, hardware.clock.now)
    assert len(summary.hidden) >= 3, "else the arm is not in the way"
    assert view.unexplained == ()
    assert {o.id for o in scene.objects} == before
    truth = hardware.truth()
    assert max(min(o.pose.distance(b.pose) for b in truth) for o in scene.objects) < 0.004
