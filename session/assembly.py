"""Putting a robot's world together: hardware below, beliefs, planning, control and eyes on top of it."""

from __future__ import annotations

from dataclasses import replace

from ..cell.vision import Eyes
from ..cell.world import Handling, World
from ..control.execution.control_loop import ControlLoop
from ..control.execution.gripper_motion import Grip
from ..control.execution.motions import Motions
from ..control.safety.safety_monitor import SafetyMonitor
from ..manipulation.grasp.grip_force import opening_force
from ..perception.pipeline import Perception
from ..planning.collision.scene_queries import SceneQueries
from ..planning.service.contact_lookahead import Lookout
from ..planning.service.plan_service import PlanService
from ..planning.service.trajectory_gate import Gate
from ..robots.description import RobotDescription
from ..robots.model import RobotModel
from ..world.belief.attempts import Attempts
from ..world.belief.planning_scene import PlanningScene
from ..world.journal import Journal
from ..world.protocols import Hardware
from ..world.random_streams import Streams
from ..world.scene.description import SceneDescription
from ..world.scene.destinations import destination_rule
from ..world.stopwatch import Stopwatch
from ..world.thinking_time import ThinkingAccount

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
