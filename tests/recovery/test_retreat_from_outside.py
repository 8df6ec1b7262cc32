"""SafeRetreat from beyond joint limits and from outside of the workspace, on both backends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.simulation import Backend
from picktree.world import Bounds
from picktree.world.robot_model import load_robot
from picktree.world.scene import SceneDescription

from ..skills.cell import Cell, items, mission

BACKENDS = pytest.mark.parametrize("backend", ["kinematic", "physics"])
LOW = (-0.8, 0.35, 0.0, -2.2, 0.0, 2.55, 0.785)


def cell(
    backend: Backend, home: tuple[float, ...], scene: SceneDescription, body: str = "SafeRetreat: {pose: low}"
) -> Cell:
    """A cell whose arm starts at `home`."""
    robot = load_robot(scene.robot)
    robot = replace(robot, named={**robot.named, "home": home, "low": LOW})
    return Cell(mission(body), scene, backend, robot=robot)


def low_ceiling(by: float) -> SceneDescription:
    """A workspace that ends below the tool of a Panda at home by that much, m."""
    scene = items(block=1)
    box = scene.limits.workspace
    top = 0.4853 - by
    return replace(scene, limits=replace(scene.limits, workspace=Bounds(box.min, (*box.max[:2], top))))


def at_low(one: Cell) -> bool:
    return float(np.abs(one.world.control.state.position - np.array(LOW)).max()) < 2e-3


@BACKENDS
def test_a_joint_beyond_its_limit_comes_back(backend: Backend) -> None:
    home = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 2.95)
    one = cell(backend, home, items(block=1))
    one.finish()
    assert one.told == ""
    assert at_low(one)
    (said,) = one.happened("safety_acknowledged")
    assert said.startswith(
        "safety_acknowledged: safety.joint_limit: panda_joint7 at 169.0 deg is 3.0 deg beyond"
    )


@BACKENDS
def test_a_tool_far_outside_of_the_workspace_comes_back_in_and_never_goes_further_out(
    backend: Backend,
) -> None:
    one = cell(backend, load_robot("panda").named["home"], low_ceiling(0.25))
    heights = [one.world.control.tcp.position[2]]
    one.tick()
    while one.running:
        one.tick()
        heights.append(one.world.control.tcp.position[2])
    assert one.told == ""
    assert at_low(one)
    assert max(heights) < heights[0] + 1e-3
    said = one.happened("safety_acknowledged")
    assert "safety.workspace: the tool is 250 mm outside the workspace: z = 485 mm, at most 235 mm" in said[0]


@BACKENDS
def test_out_of_a_believed_contact_outside_of_the_workspace(backend: Backend) -> None:
    one = cell(backend, load_robot("panda").named["home"], low_ceiling(0.25))
    x, y, z = one.world.control.tcp.position
    one.believe("ghost", (0.08, 0.08, 0.08), (x + 0.02, y + 0.06, z))
    assert one.world.plan.contacts()
    one.finish()
    assert one.told == ""
    assert at_low(one)


def test_another_skill_is_refused_with_joint_limit_and_excess() -> None:
    home = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 2.95)
    one = cell("kinematic", home, items(block=1), "GoTo: {pose: low}")
    one.finish()
    failure = one.failure
    assert str(failure.cause) == "safety.joint_limit"
    assert failure.message == "panda_joint7 at 169.0 deg is 3.0 deg beyond its limit of 166.0 deg"
