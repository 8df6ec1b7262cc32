"""Assembly of a robot's world: hardware, belief, planning, control and perception."""

from __future__ import annotations

from dataclasses import replace

from ..robot.control.control_loop import ControlLoop
from ..robot.control.gripper_motion import GripperControl
from ..robot.control.motions import ArmMotion
from ..robot.control.safety_monitor import SafetyMonitor
from ..robot.manipulation.compliant_closing import opening_force
from ..robot.perception.pipeline import Perception
from ..robot.planning.plan_service import PlanService
from ..robot.planning.scene_queries import SceneQueries
from ..robot.planning.standing_links import standing_pairs
from ..robot.planning.trajectory_gate import JogCollisionCheck, TrajectoryGate
from ..robot.vision import Vision
from ..robot.world import HandlingParameters, World
from ..world.belief.facts import AttemptMemory
from ..world.belief.planning_scene import PlanningScene
from ..world.computing_time import ComputeTimeAccount, Stopwatch
from ..world.journal import Journal
from ..world.planner_names import AUTO
from ..world.protocols import Hardware
from ..world.random_streams import RandomStreams
from ..world.robot_model.description import RobotDescription
from ..world.robot_model.model import RobotModel
from ..world.scene.description import SceneDescription
from ..world.scene.destinations import destination_rule
from ..world.scene.heap_regions import heap_regions

TICK_LENGTH = 0.05
"""Length of a tick, simulated s."""


def assemble_world(
    hardware: Hardware,
    scene: SceneDescription,
    robot: RobotDescription,
    seed: int,
    *,
    verify: bool = False,
    planning_worker: bool = False,
    stopwatch: Stopwatch | None = None,
) -> World:
    """Return a world on the given hardware with an empty belief: fixtures and bins are known, objects are
    not.

    `planning_worker`: whether a second process plans ahead.
    """
    watch = stopwatch or Stopwatch()
    model = RobotModel(replace(robot, tool=scene.tool))
    belief = PlanningScene(
        scene.fixtures, scene.bins, destination_rule(scene.destinations), heap_regions(scene)
    )
    belief.let_stand(standing_pairs(model, belief))
    journal = Journal()
    streams = RandomStreams(seed)
    thinking = ComputeTimeAccount(TICK_LENGTH)
    control = ControlLoop(hardware, model, SafetyMonitor(model, scene.limits, journal), watch)
    gripper = GripperControl(hardware.gripper, hardware.clock, robot.gripper, opening_force(scene.catalogue))
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
        width=lambda: gripper.widest(),
        now=lambda: hardware.clock.now,
        workspace=scene.limits.workspace,
        planner=scene.planner or robot.planner or AUTO,
        verify=verify,
        worker=planning_worker,
        stopwatch=watch,
    )
    vision = Vision(
        hardware.cameras,
        Perception(scene, model),
        belief,
        hardware.clock,
        journal,
        thinking,
        scene.thinking.image,
        joints=lambda: control.state.position,
        width=lambda: gripper.width,
        stopwatch=watch,
    )
    return World(
        description=scene,
        robot=model,
        clock=hardware.clock,
        scene=belief,
        journal=journal,
        attempts=AttemptMemory(),
        streams=streams,
        thinking=thinking,
        control=control,
        plan=plan,
        move=ArmMotion(
            control,
            model,
            hardware.clock,
            journal,
            TrajectoryGate(model, plan, scene.limits.workspace),
            JogCollisionCheck(plan),
            TICK_LENGTH,
        ),
        gripper=gripper,
        vision=vision,
        queries=queries,
        feed=hardware.feed,
        handling=HandlingParameters(),
        tick=TICK_LENGTH,
    )
