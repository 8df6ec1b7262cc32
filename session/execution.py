"""Execution of a mission: hardware, world, tree, faults and counters, advanced tick by tick. It records and
shows nothing; `Session` does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any

from picktree.files import PicktreeError
from picktree.logs import CellMotion, RunStatus, log_records
from picktree.logs.recording import RecordingState
from picktree.recovery import ResyncReport, last_look, resync_belief
from picktree.robot import HandlingParameters, Vision, World
from picktree.robot.control import ArmMotion, ControlLoop, GripperControl, SafetyMonitor
from picktree.robot.manipulation import opening_force
from picktree.robot.perception import Perception
from picktree.robot.planning import (
    JogCollisionCheck,
    PlanService,
    SceneQueries,
    TrajectoryGate,
    standing_pairs,
)
from picktree.simulation import (
    FaultInjector,
    Simulation,
    build_hardware,
    make_nominal,
    nominal_scene,
    require_known,
)
from picktree.trees import MAIN, Mission, NodeStatus, build, runner
from picktree.world import (
    ComputeTimeAccount,
    Entry,
    Failure,
    Hardware,
    Journal,
    PlanningScene,
    RandomStreams,
    Recogniser,
    Stopwatch,
    Tick,
    Vector3,
    heap_geometry,
    planner_names,
    world_facts,
)
from picktree.world.robot_model import RobotDescription, RobotModel
from picktree.world.scene import SceneDescription, destinations

from .checkpoints import NOTHING_RECORDED, RunState, restore_checkpoint, take_checkpoint
from .run_recipe import Recipe, StartCheckpoint
from .run_tally import RunCounters
from .stage import Stage

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
    recogniser: Recogniser | None = None,
) -> World:
    """Return a world on the given hardware with an empty belief: fixtures and bins are known, objects are
    not.

    `planning_worker`: whether a second process plans ahead. `recogniser`: process that recognises items;
    None: perception does, by colour.
    """
    watch = stopwatch or Stopwatch()
    model = RobotModel(replace(robot, tool=scene.tool))
    belief = PlanningScene(
        scene.fixtures,
        scene.bins,
        destinations.destination_rule(scene.destinations),
        heap_geometry.heap_regions(scene),
    )
    belief.allow_mounting(standing_pairs(model, belief))
    journal = Journal()
    streams = RandomStreams(seed)
    thinking = ComputeTimeAccount(TICK_LENGTH)
    attempts = world_facts.AttemptMemory()
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
        planner=scene.planner or robot.planner or planner_names.AUTO,
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
        at_rest=lambda: control.at_rest,
        doubted=lambda: attempts.objects,
        stopwatch=watch,
        recogniser=recogniser,
    )
    return World(
        description=scene,
        robot=model,
        clock=hardware.clock,
        scene=belief,
        journal=journal,
        attempts=attempts,
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


@dataclass(frozen=True)
class _Built:
    """Hardware of a recipe."""

    hardware: Hardware
    simulation: Simulation | None = None
    """The hardware as a simulation; None: it is a robot."""
    wrench_noise: float | None = None
    """Measured noise of the robot's wrist, N; None: not measured."""
    recogniser: Recogniser | None = None


def _build(recipe: Recipe) -> _Built:
    """Build the hardware of a recipe.

    Raises PicktreeError for a robot or a recogniser that cannot be reached or does not fit, and for faults
    beside a robot.
    """
    if recipe.robot_at:
        from picktree.drivers import (
            ExternalHardware,
            ShadowHardware,
            measurement_path,
            read_measurement,
        )

        if recipe.faults is not None:
            raise PicktreeError("faults are injected into a simulation; a robot has its own")
        measured = read_measurement(measurement_path(recipe.robot))
        hardware = ShadowHardware if recipe.shadow else ExternalHardware
        robot = hardware(
            recipe.scene, recipe.robot, recipe.robot_at, recipe.speed, measured, recipe.perception_at
        )
        noise = robot.measured.wrench_noise if robot.measured else None
        return _Built(robot, None, noise, robot.recogniser)
    start = recipe.start.state.simulation if recipe.start else None
    scene = nominal_scene(recipe.scene, recipe.nominal)
    simulation = build_hardware(recipe.backend, scene, recipe.robot, recipe.seed, start)
    require_known(recipe.nominal, recipe.scene, recipe.robot.joints)
    return _Built(simulation, simulation)


def _slowed(robot: RobotDescription, share: float) -> RobotDescription:
    """Return the robot with a share of its speeds and accelerations as limits: no motion exceeds them."""
    if share == 1.0:
        return robot
    limits = (
        replace(each, velocity=share * each.velocity, acceleration=share * each.acceleration)
        for each in robot.limits
    )
    return replace(robot, limits=tuple(limits))


_MAX_BRAKING_TICKS = 40
"""Upper bound of the number of ticks in which any motion comes to rest."""
_MAX_SETTLING_TICKS = 100
"""Greatest number of ticks after the end of a run in which items may come to rest. An upright can rocks in
its bin for 1.2 s; a ball rolls on."""


class Execution:
    """Mission of a recipe on its hardware: `tick`, then `pass_time`, until `status` is not None.

    The constructor builds everything before anything moves. Raises PicktreeError for a checkpoint that does
    not fit, and for values that the mission does not take.
    """

    def __init__(
        self,
        recipe: Recipe,
        *,
        after: Execution | None = None,
        stopwatch: Stopwatch | None = None,
        planning_worker: bool = False,
        kill: Callable[[], None] | None = None,
    ) -> None:
        """Build hardware and world, or continue with those of another execution of the same scene.

        `after`: that other execution, which has ended. `planning_worker`: whether a second process plans
        ahead, which changes nothing but the time that the run takes. `kill` is called by a fault that kills
        the process; None: such a fault has no effect.
        """
        self.recipe = recipe
        self.mission: Mission = recipe.mission
        """Present version of the mission."""
        start = recipe.start
        if after is None:
            self.stopwatch = stopwatch or Stopwatch()
            built = _build(recipe)
            self.hardware, simulation = built.hardware, built.simulation
            self.world = assemble_world(
                self.hardware,
                recipe.scene,
                _slowed(recipe.robot, recipe.speed),
                recipe.seed,
                verify=recipe.verify,
                planning_worker=planning_worker,
                stopwatch=self.stopwatch,
                recogniser=built.recogniser,
            )
            if built.wrench_noise is not None:
                self.world.control.wrist.least_noise = built.wrench_noise
        else:
            self.stopwatch, self.hardware, self.world = after.stopwatch, after.hardware, after.world
            simulation = after.stage.simulation if after.stage else None
        self.limit = recipe.limit + (after.world.clock.now if after else 0.0)
        """Time at which the run is ended, simulated s."""
        self.tree = build(self.mission, self.world, recipe.parameters)
        self.stage: Stage | None = None
        """Ground truth, faults and saved states of a simulation; None on a robot."""
        if simulation is not None:
            injector = FaultInjector(
                recipe.faults,
                simulation,
                self._object_place,
                seed=recipe.seed,
                program=lambda: self.tree,
                kill=kill,
                nominal=recipe.nominal,
            )
            self.world.plan.finds_nothing = injector.no_plan
            self.stage = Stage(simulation, injector)
        self.tally = RunCounters()
        self._disagreed = -len(self.world.plan.disagreements)
        self.adoption: runner.StateTransfer | None = None
        """Transfer of node states from a checkpoint of another mission; None: the mission is the same."""
        if start is not None:
            self._take_up(start)
        if self.stage is not None:
            make_nominal(self.stage.simulation, recipe.scene, recipe.nominal)
        self._vary_streams()
        self._first = resync_belief(self.world) if start and start.continues.as_it_stands else None
        """Resynchronisation of the belief before the tree resumes; None: not needed, or over."""
        self._checkpointed = self.tally.done
        if self.stage is not None:
            self.tree.on_start.append(self.stage.injector.node_started)
        self.tally.follow(self.tree.structure())
        self.tally.figures.fixed = frozenset(
            str(each.id) for each in (*recipe.scene.fixtures, *recipe.scene.bins)
        )
        self.items_total = self._count_items()
        """Number of items that have come so far; on a robot, of those that it has seen."""

    def tick(self) -> tuple[Tick, tuple[Entry, ...]]:
        """Tick the tree and the faults; return the report of the tree and the tick's journal entries."""
        self._vary_streams()
        with self.stopwatch.measure("tree"):
            report = self._look_first() or self.tree.tick()
        for happened in self.stage.tick() if self.stage else ():
            self.world.journal.note(happened)
        return self._reported(report)

    def last_look(self) -> Generator[tuple[Tick, tuple[Entry, ...]]]:
        """Let the fixed cameras of a robot look once more after the end of the tree: its score is what they
        see. Yields what `tick` returns, for each tick."""
        for _ in last_look(self.world):
            yield self._reported(self.tree.look())
            self.pass_time()
        yield self._reported(self.tree.look())

    def _reported(self, report: Tick) -> tuple[Tick, tuple[Entry, ...]]:
        """Count what has happened in a tick, and return its report with its journal entries."""
        self.items_total = self._count_items()
        entries = self.world.journal.take()
        decisions = self.tally.take(
            self.world.clock.now, entries, self.tree.leaves, report.edges, self._motion()
        )
        return report, (*entries, *decisions)

    def _motion(self) -> CellMotion:
        """Return the motion of arm and fingers, as the log of this tick has it."""
        width = self.hardware.gripper.read().width
        return CellMotion(self.world.control.controller, math.fsum(self.world.robot.fingers.positions(width)))

    def pass_time(self) -> None:
        """Advance control and simulation by one tick."""
        self.world.control.step_tick(TICK_LENGTH)
        self.world.scene.carry(self.world.control.tcp)

    @property
    def status(self) -> RunStatus | None:
        """End of the run by its tree or its limit; None while the run is in progress."""
        if self._first is None and self.tree.status is not NodeStatus.RUNNING:
            return "success" if self.tree.status is NodeStatus.SUCCESS else "failure"
        return "timeout" if self.world.clock.now >= self.limit else None

    def come_to_rest(self) -> None:
        """Halt the tree and pass time until the arm rests."""
        self.tree.halt()
        for _ in range(_MAX_BRAKING_TICKS):
            if self.world.control.at_rest:
                break
            self.pass_time()

    def let_items_rest(self) -> None:
        """Pass time until no item moves, except those on belts: the score of an ended run is that of items at
        rest."""
        for _ in range(_MAX_SETTLING_TICKS if self.stage else 0):
            if self.stage is None or not self.stage.items_move(self.recipe.scene):
                return
            self.pass_time()

    @property
    def quiet(self) -> bool:
        """Whether no skill runs, the arm is at rest, and the hand is empty.

        An answer or a change of the blackboard by the operator must not wait for the next tick, either.
        """
        world = self.world
        free = world.scene.held is None and not world.operator.answered and not self.tree.blackboard.written
        return self._first is None and self.tree.quiescent and world.control.at_rest and free

    @property
    def checkpoint_due(self) -> bool:
        """Whether enough items are done for a checkpoint and the run is quiescent. A robot has none."""
        every = self.recipe.scene.checkpoint_every
        return self.stage is not None and self.tally.done - self._checkpointed >= every and self.quiet

    def checkpoint(self, recording: RecordingState) -> RunState:
        """Take a checkpoint; `recording` is the state of the log. The simulation continues from it.

        Raises PicktreeError for a run on a robot, whose state cannot be saved.
        """
        if self.stage is None:
            raise PicktreeError("a run on a robot has no checkpoints")
        self._checkpointed = self.tally.done
        with self.stopwatch.measure("physics"):
            return take_checkpoint(
                self.world,
                self.tree,
                self.stage.simulation,
                self.stage.injector,
                self.tally,
                recording,
                self.disagreements,
            )

    def start_here(self) -> None:
        """Make the present state the start of the run, so that its log can be run again, if it is quiescent.

        For an execution that uses the world of another one. Its limit becomes an absolute time.
        """
        if self.stage is None or not self.quiet:
            return
        now, done = self.world.clock.now, self.world.journal.items_done
        state = replace(self.checkpoint(NOTHING_RECORDED), items_done=done)
        continues = log_records.ResumedFrom("", "", now, done, NOTHING_RECORDED.digest)
        self.recipe = replace(self.recipe, limit=self.limit, start=StartCheckpoint(state, continues))

    def true_state(self, departed: int = 0) -> dict[str, Any]:
        """Return the present state of the simulation as plain values, see `Stage.true_state`; empty on a
        robot."""
        if self.stage is None:
            return {}
        return self.stage.true_state(departed, list(self.world.control.wrist.learnt))

    @property
    def disagreements(self) -> int:
        """Number of trajectories that the verifier has rejected, earlier sessions of the run included."""
        return self._disagreed + len(self.world.plan.disagreements)

    def adopt(self, mission: Mission) -> runner.StateTransfer:
        """Continue with another version of the mission; belief, blackboard and attempts do not change."""
        tree = build(mission, self.world, self.recipe.parameters)
        adoption = tree.adopt(self.tree.save())
        tree.on_start.extend(self.tree.on_start)
        tree.on_end.extend(self.tree.on_end)
        self.mission, self.tree = mission, tree
        self.tally.follow(tree.structure())
        return adoption

    def _vary_streams(self) -> None:
        """Draw noise and planner seeds from the recipe's variant, from its time on."""
        variant = self.recipe.variant
        if variant is not None and self.stage is not None and self.world.clock.now >= variant.since - 1e-9:
            self.world.streams.variant = variant.number
            self.stage.simulation.vary_noise(variant.number)

    def _count_items(self) -> int:
        if self.stage is not None:
            return self.stage.simulation.item_count
        items = sum(each.role == "item" for each in self.world.scene.objects)
        return max(items, self.tally.count("bin"))

    def _take_up(self, start: StartCheckpoint) -> None:
        """Restore world, tree, faults and counters from a checkpoint."""
        state = start.state
        restore_checkpoint(self.world, state)
        if start.adopt:
            self.adoption = self.tree.adopt(state.tree)
            self._read_parameters(start.changed)
        else:
            self.tree.restore(state.tree)
        if self.stage is not None:
            self.stage.injector.restore(state.faults)
        if state.tally is not None:
            self.tally = RunCounters.resumed(state.tally)
        self._disagreed = state.disagreements

    def _read_parameters(self, names: tuple[str, ...]) -> None:
        try:
            self.tree.read_again({f"{MAIN}/{name}" for name in names})
        except Failure as failure:
            raise PicktreeError(
                f"the running mission does not accept the new value: {failure.message}"
            ) from None

    def _look_first(self) -> Tick | None:
        """Run one step of the resynchronisation and return the report of an idle tick; None when it is
        over."""
        if self._first is None:
            return None
        try:
            next(self._first)
        except StopIteration as end:
            stock: ResyncReport = end.value
            self._first = None
            self.tree.pass_over({*stock.done, *stock.gone})
            self._checkpointed = self.tally.done = self.world.journal.items_done
            return None
        return self.tree.look()

    def _object_place(self, path: str) -> Vector3 | None:
        """Return the believed position of the object that a node's port `object` names, in the world, m.

        None when the node has no such port, or the belief has no such object.
        """
        node = self.tree.find(path)
        if node.declaration.port("object") is None:
            return None
        belief = self.world.scene.find(str(node.input("object")))
        return belief.pose.position if belief else None
