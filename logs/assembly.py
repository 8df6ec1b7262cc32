"""Putting a robot's world together: hardware below, beliefs, planning, control and eyes on top of it."""

from __future__ import annotations

from dataclasses import replace

from ..world.attempts import Attempts
from ..world.control.grip import Grip
from ..world.control.loop import ControlLoop
from ..world.control.monitor import SafetyMonitor
from ..world.control.motion import Motions
from ..world.eyes import Eyes
from ..world.handling import Handling
from ..world.journal import Journal
from ..world.manipulation.pressing import opening_force
from ..world.motion.fcl_queries import SceneQueries
from ..world.motion.gate import Gate
from ..world.motion.lookout import Lookout
from ..world.motion.service import PlanService
from ..world.perception.pipeline import Perception
from ..world.protocols import Hardware
from ..world.robot.description import RobotDescription
from ..world.robot.model import RobotModel
from ..world.scene.description import SceneDescription
from ..world.scene.destinations import destination_rule
from ..world.scene.planning_scene import PlanningScene
from ..world.stopwatch import Stopwatch
from ..world.streams import Streams
from ..world.thinking import ThinkingAccount
from ..world.world import World

TICK = 0.05
"""Seconds between two ticks of a tree."""


def assemble(
    hardware: Hardware,
    scene: SceneDescription,
    robot: RobotDescription,
    seed: int,
    *,
    verify: bool = False,
    stopwatch: Stopwatch | None = None,
) -> World:
    """A world on that hardware with an empty belief: fixtures and bins are known, objects are not."""
    watch = stopwatch or Stopwatch()
    model = RobotModel(replace(robot, tool=scene.tool))
    belief = PlanningScene(scene.fixtures, scene.bins, destination_rule(scene.destinations))
    journal = Journal()
    streams = Streams(seed)
    thinking = ThinkingAccount(TICK)
    control = ControlLoop(hardware, model, SafetyMonitor(model, scene.limits, journal), watch)
    grip = Grip(hardware.gripper, hardware.clock, robot.gripper, opening_force(scene.catalogue))
    queries = SceneQueries(model, belief)
    plan = PlanService(
        model,
        belief,
        queries,
        streams,
        journal,
        thinking,
        scene.thinking.collision_check,
        configuration=lambda: control.held_position,
        width=lambda: grip.width,
        now=lambda: hardware.clock.now,
        workspace=scene.limits.workspace,
        verify=verify,
        stopwatch=watch,
    )
    eyes = Eyes(
        hardware.cameras,
        Perception(scene, model),
        belief,
        hardware.clock,
        journal,
        thinking,
        scene.thinking.image,
        joints=lambda: control.state.position,
        width=lambda: grip.width,
        stopwatch=watch,
    )
    return World(
        description=scene,
        robot=model,
        clock=hardware.clock,
        scene=belief,
        journal=journal,
        attempts=Attempts(),
        streams=streams,
        thinking=thinking,
        control=control,
        plan=plan,
        move=Motions(
            control,
            model,
            hardware.clock,
            journal,
            Gate(model, plan, scene.limits.workspace),
            Lookout(plan),
            TICK,
        ),
        grip=grip,
        eyes=eyes,
        queries=queries,
        feed=hardware.feed,
        handling=Handling(),
        tick=TICK,
    )
