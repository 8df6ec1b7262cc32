"""A sorting cell on either backend that a test drives tick by tick, halts, and lets go on."""

from __future__ import annotations

import math
import os
import pickle
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from textwrap import indent

import numpy as np

from picktree.session import assemble_world
from picktree.session.execution import TICK_LENGTH
from picktree.simulation import Backend, build_hardware, score
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.simulation.scorer import Score
from picktree.trees import Mission, NodeStatus, build
from picktree.trees.loading import NodeRegistry, load_mission, parse_mission
from picktree.world import BeliefObject, Box, FailureReport, JournalEvent, ObjectId, Pose, Tick, Vector3
from picktree.world.robot_model import RobotDescription, load_robot
from picktree.world.scene import SceneDescription, load_scene

EXAMPLES = Path(__file__).parents[2] / "examples"
LIMIT = 240.0
"""Simulated seconds after which a mission counts as hung."""
REST_LIMIT = 1.0
"""Simulated seconds within which an arm that was halted must stand."""
STILL = 0.02
"""rad/s over all joints."""
EVERYDAY_PERIOD = 1 / 240
FALL, ROLL = 15, 80
"""Ticks after the end in which what was let go in the air comes to rest: at least, at most."""


def items(**counts: int) -> SceneDescription:
    """The scene `sort_small` with these items of the catalogue instead of its own."""
    scene = load_scene("sort_small")
    return replace(scene, spawn=(replace(scene.spawn[0], counts=counts),))


@cache
def sorting() -> Mission:
    return load_mission(EXAMPLES / "sort_by_colour.yaml", NodeRegistry())


def mission(body: str) -> Mission:
    """A mission whose tree `Main` is the given text."""
    text = f"picktree: 1\nkind: mission\ntrees:\n  Main:\n{indent(body, '    ')}\n"
    return parse_mission(text, Path("mission.yaml"), NodeRegistry())


class Cell:
    """Hardware, world and a mission's tree. `tick` lets one tick of simulated time pass."""

    def __init__(
        self,
        mission: Mission,
        scene: SceneDescription,
        backend: Backend = "kinematic",
        seed: int = 3,
        robot: RobotDescription | None = None,
    ) -> None:
        self.scene = scene
        robot = robot or load_robot(scene.robot)
        self.hardware = build_hardware(backend, scene, robot, seed)
        self.world = assemble_world(self.hardware, scene, robot, seed)
        self.events: list[JournalEvent] = []
        self.tree = build(mission, self.world)

    def start(self, mission: Mission) -> None:
        """Another mission in the same world: what stands where, and what is believed, stay."""
        self.tree = build(mission, self.world)

    def do(self, body: str) -> str:
        """Do another mission in the same world to its end; what it is `told` to have failed of."""
        self.start(mission(body))
        self.finish()
        return self.told

    @property
    def told(self) -> str:
        """Cause and message of the mission's failure; empty when there is none."""
        return "" if self.tree.failure is None else f"{self.failure.cause}: {self.failure.message}"

    @property
    def failure(self) -> FailureReport:
        assert self.tree.failure is not None
        return self.tree.failure

    @property
    def kinematic(self) -> KinematicHardware:
        assert isinstance(self.hardware, KinematicHardware)
        return self.hardware

    def believe(self, name: str, size: Vector3, at: Vector3) -> None:
        """An obstacle of that size, m, which is not there."""
        known = ("unknown", "unknown", Box(size), "grey", Pose(at), 0.002, 0.0, 1.0, 0.0)
        self.world.scene.put(BeliefObject(*known, id=ObjectId(name), role="obstacle"), "test")

    def tick(self) -> Tick:
        report = self.tree.tick()
        self._note()
        if self.running:
            self.wait()
        return report

    def wait(self) -> None:
        """A tick of time in which no node is ticked."""
        self.world.control.step_tick(TICK_LENGTH)
        self.world.scene.carry(self.world.control.tcp)

    @property
    def running(self) -> bool:
        return self.tree.status is NodeStatus.RUNNING

    @property
    def leaf(self) -> str:
        """ID of the first leaf that runs; empty when none does."""
        nodes = (n for n in self.tree.nodes if n.state is NodeStatus.RUNNING and not n.children)
        return next((n.wiring.id for n in nodes), "")

    def halt(self) -> None:
        self.tree.halt()
        self._note()

    def rest(self) -> float:
        """Let time pass until the arm stands; the simulated seconds that it took."""
        began = self.world.clock.now
        while not self.world.control.at_rest:
            assert self.world.clock.now - began < REST_LIMIT, f"still moving: {self.speed:.3f} rad/s"
            self.wait()
        return self.world.clock.now - began

    @property
    def speed(self) -> float:
        """Of the arm, over all joints, rad/s."""
        return float(np.linalg.norm(self.hardware.arm.read().velocity))

    def finish(self) -> NodeStatus:
        """Tick until the mission ends."""
        while True:
            self.tick()
            if not self.running:
                return self.tree.status
            assert self.world.clock.now < LIMIT, f"hangs in {self.leaf}"

    def score(self) -> Score:
        return score(self.hardware.truth(), self.scene)

    def happened(self, *kinds: str) -> list[str]:
        return [f"{e.kind}: {e.message}" for e in self.events if e.kind in kinds]

    def _note(self) -> None:
        self.events += [e for e in self.world.journal.take() if isinstance(e, JournalEvent)]
        self.world.scene.take_changes()


def looked(**counts: int) -> tuple[Cell, list[str]]:
    """A cell whose items were seen, and their ids, the nearest first."""
    cell = Cell(mission('Observe: {camera: overhead, objects: "{items}"}'), items(**counts))
    cell.finish()
    found = cell.tree.blackboard.save()["Main/items"]
    assert isinstance(found, list)
    return cell, [str(item) for item in found]


def holding() -> tuple[Cell, str]:
    """A cell whose hand holds its block above the table."""
    cell, (block,) = looked(block=1)
    assert cell.do(f"Grasp: {{object: {block}, onward: false}}") == ""
    return cell, block


@dataclass(frozen=True)
class Halted:
    """What came of halting a mission at one tick and running the whole sorting mission afterwards."""

    tick: int
    leaf: str
    to_rest: float
    """Simulated seconds until the arm stood."""
    speed: float
    status: str
    sorted: int
    total: int
    believed: bool
    """Whether something was believed to be in the hand when the arm stood."""
    complaints: tuple[str, ...] = ()
    """Faults of the program, and what else must not be."""
    recoveries: tuple[str, ...] = ()
    """On the way to the end; they are allowed."""

    @property
    def fine(self) -> bool:
        done = self.status == "SUCCESS" and self.sorted == self.total
        return done and self.speed < STILL and not self.complaints


def halt_and_finish(cell: Cell, tick: int, then: Mission | None = None) -> Halted:
    """Halt the cell's mission, wait for rest, run `then` in the same world to its end: `sort_by_colour`
    unless given."""
    leaf = cell.leaf
    cell.events.clear()
    cell.halt()
    complaints = [f"{n.path} is {n.state}" for n in cell.tree.nodes if n.state is not NodeStatus.IDLE]
    to_rest = cell.rest()
    speed = cell.speed
    cell.wait()
    complaints += left_over(cell)
    stop = cell.world.control.monitor.stopped
    if stop is not None:
        complaints.append(f"safety stop: {stop.message}")
    held = cell.world.scene.held
    if held is not None:
        tcp = cell.hardware.true_tcp()
        nearest = min(cell.hardware.truth(), key=lambda body: body.pose.distance(tcp))
        if held.kind != nearest.kind or nearest.pose.distance(held.pose) > 0.03:
            complaints.append(
                f"{held.id} is believed to be held, but {nearest.id} is "
                f"{nearest.pose.distance(held.pose) * 1000:.0f} mm away from there"
            )
    cell.start(then or sorting())
    status = cell.finish()
    for waited in range(ROLL):
        if waited >= FALL and all(math.hypot(*body.velocity) < 0.01 for body in cell.hardware.truth()):
            break
        cell.wait()
    complaints += cell.happened("internal_error", "undeclared_cause")
    verdict = cell.score()
    return Halted(
        tick,
        leaf,
        to_rest,
        speed,
        status.value + (f" {cell.tree.failure.message}" if cell.tree.failure else ""),
        verdict.count.sorted,
        verdict.count.total,
        held is not None,
        tuple(complaints),
        tuple(cell.happened("recovery")),
    )


def left_over(cell: Cell) -> list[str]:
    """What must not remain of a contact once the arm stands: torques, a finer step, numbers that are none."""
    control, found = cell.world.control, list[str]()
    if control.controller != "Hold":
        found.append(f"{control.controller} commands the arm at rest")
    if isinstance(cell.hardware, PhysicsHardware) and cell.hardware.arm.mode != "follow":
        found.append("joint torques stay applied")
    if control.period != EVERYDAY_PERIOD:
        found.append(f"control goes on with a period of {control.period} s")
    state, wrench = control.state, control.hardware.wrench.read()
    if not np.isfinite([*state.position, *state.velocity, *wrench.force, *wrench.torque]).all():
        found.append("a sensor says what is no number")
    return found


def branch(doing: Callable[[], Halted]) -> Halted:
    """`doing` in a copy of this process: the world here stays as it is. Raises what it raised, as text."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            answer: object = doing()
        except BaseException:  # noqa: BLE001 - the child must end here, whatever happened
            answer = traceback.format_exc()
        with os.fdopen(writing, "wb") as pipe:
            pipe.write(pickle.dumps(answer))
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        data = pipe.read()
    os.waitpid(child, 0)
    answer = pickle.loads(data) if data else "the branch died without a word"
    assert isinstance(answer, Halted), answer
    return answer


class Phases:
    """Ticks in which to halt: these of each phase of a run, as far as it lasts, counted from 1.

    A phase lasts while the same leaf runs, the same controller commands the arm, and the hand holds what it
    held.
    """

    def __init__(self, cell: Cell, ticks: tuple[int, ...], leaves: tuple[str, ...] = ()) -> None:
        self._cell, self._ticks, self._leaves = cell, ticks, leaves
        self._phase: tuple[object, ...] = ()
        self._ran = 0

    def __call__(self, tick: int) -> bool:
        cell = self._cell
        held = cell.world.scene.held
        phase = (cell.leaf, cell.world.control.controller, held and held.id)
        self._ran = self._ran + 1 if phase == self._phase else 1
        self._phase = phase
        return self._ran in self._ticks and (not self._leaves or cell.leaf in self._leaves)


def halted_at(
    cell: Cell, wanted: Callable[[int], bool], then: Mission | None = None, limit: float = LIMIT
) -> list[Halted]:
    """The cell's mission run once; at each wanted tick a branch in which it is halted and `then` (sorting,
    unless given) is done from there. The first tick is 1; the mission is halted when the tick's time has
    passed."""
    answers: list[Halted] = []
    tick = 0
    while cell.world.clock.now < limit:
        cell.tick()
        if not cell.running:
            break
        tick += 1
        if wanted(tick):
            answers.append(branch(lambda at=tick: halt_and_finish(cell, at, then)))
    return answers
