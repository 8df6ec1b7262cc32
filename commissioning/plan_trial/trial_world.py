"""A robot's world in a scene as it stands when a run begins, believed exactly as it is."""

from __future__ import annotations

from pathlib import Path

from ...cell.world import World
from ...robots.loading import load_robot
from ...session.assembly import assemble
from ...simulation.backends import build_hardware
from ...simulation.scoring.truth import TrueBody
from ...world.belief.planning_scene import BeliefObject
from ...world.scene.loading.scene_loading import load_scene

SIGMA = 1e-4
"""Of what is believed exactly: positions, m, and angles, rad."""


def build(scene: str, robot: str | None, seed: int, *, verify: bool) -> World:
    """The world of a shipped scene or a scene file, with what is spawned by that seed believed where it is.

    `robot`: a shipped robot or a robot file instead of the scene's. Raises PicktreeError.
    """
    description = load_scene(scene, Path.cwd())
    beside = Path.cwd() if robot else Path(description.source).parent
    arm = load_robot(robot or description.robot, beside)
    hardware = build_hardware("kinematic", description, arm, seed)
    world = assemble(hardware, description, arm, seed, verify=verify)
    for body in hardware.truth():
        if body.present:
            world.scene.put(_believed(world, body), "believed as it is")
    world.scene.take_changes()
    return world


def _believed(world: World, body: TrueBody) -> BeliefObject:
    """Named as perception names what it finds."""
    return BeliefObject(
        world.scene.new_id(f"{body.colour}_{body.kind}"),
        "item",
        body.kind,
        body.form,
        body.shape,
        body.colour,
        body.pose,
        SIGMA,
        SIGMA,
        1.0,
        world.clock.now,
    )
