"""Session: the one way to run a mission, for the command line, batches, replays and tests."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Protocol, TypedDict, Unpack

from ..trees.builder import build
from ..trees.loader import load_mission
from ..trees.registry import Registry
from ..trees.runner import NodeInfo, TickReport
from ..trees.status import NodeStatus
from ..world.errors import PicktreeError
from ..world.faults.load import load_faults
from ..world.journal import Happened
from ..world.robot.load import load_robot
from ..world.scene.load import load_scene
from ..world.simulation.backends import Backend, build_hardware
from ..world.simulation.faults import Injector
from ..world.simulation.scorer import score
from ..world.stopwatch import Stopwatch
from ..world.values import Vector3
from .assembly import TICK, assemble
from .checkpoints import take
from .records import NodeTime, Timing
from .result import FormCount, ItemCount, PickCount, RunResult, RunStatus, WallSeconds
from .scribe import Scribe
from .tally import Tally

LOG = "log.mcap"
RESULT = "result.json"
LIMIT = 3600.0
"""Simulated seconds after which a run is ended, unless told otherwise."""


@dataclass(frozen=True)
class RunRequest:
    """What is to be run, and how."""

    mission: Path
    scene: str | None = None
    """Instead of the mission's own."""
    seed: int = 0
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    faults: Path | None = None
    out: Path | None = None
    """Folder in which the run's folder is made; by default `runs`."""
    backend: Backend = "physics"
    verify: bool = False
    """Judge every trajectory by the second, independent collision checker."""
    limit: float = LIMIT
    """Simulated seconds."""


class RunOptions(TypedDict, total=False):
    """The fields of `RunRequest` besides the mission, for `run`."""

    scene: str | None
    seed: int
    parameters: Mapping[str, str]
    faults: Path | None
    out: Path | None
    backend: Backend
    verify: bool
    limit: float


class Watcher(Protocol):
    """Whoever looks on; nothing that it does changes the run."""

    def started(self, structure: tuple[NodeInfo, ...], folder: Path) -> None: ...
    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None: ...
    def finished(self, result: RunResult) -> None: ...


class Session:
    """One run: everything that it needs is checked and built here, before anything moves.

    Raises PicktreeError (FileError with all faults) for bad input.
    """

    def __init__(self, request: RunRequest, watcher: Watcher | None = None) -> None:
        self.request = request
        self._watcher = watcher
        registry = Registry()
        self.mission = load_mission(request.mission, registry)
        wanted = request.scene or self.mission.scene
        if wanted is None:
            raise PicktreeError(
                f"{request.mission}: the mission names no scene; add 'scene:' or give --scene"
            )
        beside = Path.cwd() if request.scene else request.mission.parent
        self.scene = load_scene(wanted, beside)
        self.robot = load_robot(self.scene.robot, Path(self.scene.source).parent)
        self.faults = load_faults(request.faults) if request.faults else None
        self._stopwatch = Stopwatch()
        self._began = time.perf_counter()
        self._cpu_began = time.process_time()
        self.hardware = build_hardware(request.backend, self.scene, self.robot, request.seed)
        self.world = assemble(
            self.hardware,
            self.scene,
            self.robot,
            request.seed,
            verify=request.verify,
            stopwatch=self._stopwatch,
        )
        self.tree = build(self.mission, self.world, request.parameters)
        self._injector = Injector(self.faults, self.hardware, self._object_place)
        self.tree.on_start.append(self._injector.node_started)
        self.tally = Tally()
        self.folder = _make_folder(request)
        self._checkpointed = 0

    def run(self) -> RunResult:
        """Run to the end and say what came of it. The log is finished on every way out; an interrupt
        (SIGINT, SIGTERM) ends the run with the status `interrupted`."""
        structure = self.tree.structure()
        leaves = frozenset(node.path for node in structure if not node.children)
        total = len(self.hardware.truth())
        with Scribe(self.folder / LOG, self, structure) as scribe:
            if self._watcher:
                self._watcher.started(structure, self.folder)
            try:
                status = self._loop(scribe, leaves, total)
            except KeyboardInterrupt:
                status = "interrupted"
            scribe.last(self.hardware)
            result = self._result(status, scribe.digest)
            scribe.finish(result)
        (self.folder / RESULT).write_text(result.to_json_text(), encoding="utf-8")
        if self._watcher:
            self._watcher.finished(result)
        return result

    def _loop(self, scribe: Scribe, leaves: frozenset[str], total: int) -> RunStatus:
        world, tree = self.world, self.tree
        while True:
            before, began = self._stopwatch.seconds(), time.perf_counter()
            with self._stopwatch.measure("tree"):
                report = tree.tick()
            for happened in self._injector.tick():
                world.journal.note(happened)
            entries = world.journal.take()
            self.tally.take(world.clock.now, entries, report.nodes, leaves)
            with self._stopwatch.measure("logging"):
                scribe.tick(report, entries, self.hardware)
            if self._watcher:
                self._watcher.ticked(world.clock.now, report, self.tally.done, total)
            if tree.status is not NodeStatus.RUNNING:
                return "success" if tree.status is NodeStatus.SUCCESS else "failure"
            if world.clock.now >= self.request.limit:
                tree.halt()
                return "timeout"
            if self._checkpoint_due():
                self._checkpoint(scribe)
            world.control.step_tick(TICK)
            world.scene.carry(world.control.tcp)
            with self._stopwatch.measure("logging"):
                scribe.timing(self._timing(before, began))

    def _object_place(self, path: str) -> Vector3 | None:
        """Where the belief has the object that the port `object` of a node names."""
        node = self.tree.find(path)
        if node.declaration.port("object") is None:
            return None
        belief = self.world.scene.find(str(node.input("object")))
        return belief.pose.position if belief else None

    def _checkpoint_due(self) -> bool:
        """Whether it is time for one, and nothing moves that could not be taken up again."""
        return (
            self.tally.done - self._checkpointed >= self.scene.checkpoint_every
            and self.tree.quiescent
            and self.world.control.at_rest
            and self.world.scene.held is None
        )

    def _checkpoint(self, scribe: Scribe) -> None:
        self._checkpointed = self.tally.done
        with self._stopwatch.measure("physics"):
            state = take(self.world, self.tree, self.hardware, self._injector, self.tally.done)
        with self._stopwatch.measure("logging"):
            scribe.checkpoint(state)
        self.world.journal.note(
            Happened("checkpoint", f"after {self.tally.done} items", "", {"items_done": self.tally.done})
        )

    def _timing(self, before: Mapping[str, float], began: float) -> Timing:
        now = self._stopwatch.seconds()
        spent = {part: seconds - before.get(part, 0.0) for part, seconds in now.items()}
        return Timing(
            time.perf_counter() - began,
            **{
                part: spent.get(part, 0.0)
                for part in ("physics", "control", "planning", "perception", "rendering")
            },
            recording=spent.get("logging", 0.0),
            nodes=tuple(NodeTime(path, seconds) for path, seconds in self.tree.seconds().items()),
        )

    def _result(self, status: RunStatus, digest: str) -> RunResult:
        verdict = score(self.hardware.truth(), self.scene)
        goal = self.mission.goal.text if self.mission.goal else self.scene.goal
        if status == "success" and not verdict.reached(goal):
            status = "incomplete"
        tally, failure = self.tally, self.tree.failure
        wall = self._stopwatch.seconds()
        return RunResult(
            status=status,
            seed=self.request.seed,
            digest=digest,
            items=ItemCount(
                verdict.total,
                verdict.sorted,
                verdict.misplaced,
                verdict.left,
                {form: FormCount(count.total, count.sorted) for form, count in verdict.by_form.items()},
            ),
            picks=PickCount(tally.tried, tally.held, len(tally.objects), len(tally.first_try)),
            failures=dict(tally.failures),
            recoveries=dict(tally.recovered),
            sim_seconds=self.world.clock.now,
            cpu_seconds=time.process_time() - self._cpu_began,
            wall_seconds=WallSeconds(
                total=time.perf_counter() - self._began,
                physics=wall.get("physics", 0.0),
                planning=wall.get("planning", 0.0),
                perception=wall.get("perception", 0.0) + wall.get("rendering", 0.0),
                logging=wall.get("logging", 0.0),
            ),
            log=(self.folder / LOG).absolute(),
            folder=self.folder.absolute(),
            message=failure.message if failure else "",
            thinking_charged=self.scene.thinking.collision_check > 0.0 and self.scene.thinking.image > 0.0,
            disagreements=len(self.world.plan.disagreements) if self.request.verify else None,
            moment=tally.first_failure,
        )


def run(mission: Path | str, **options: Unpack[RunOptions]) -> RunResult:
    """Run a mission in one call; the options are those of `RunRequest`."""
    return Session(RunRequest(mission=Path(mission), **options)).run()


def _make_folder(request: RunRequest) -> Path:
    """A new folder for the run. Raises PicktreeError when it cannot be made."""
    parent = request.out or Path("runs")
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    stem = f"{request.mission.stem}-{request.seed}-{stamp}"
    for number in range(1000):
        folder = parent / (stem if number == 0 else f"{stem}-{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            if not parent.is_dir():
                raise PicktreeError(f"{parent} is a file; --out takes a folder for runs") from None
            continue
        except OSError as error:
            raise PicktreeError(f"the folder {folder} cannot be made: {error.strerror}") from None
        return folder
    raise PicktreeError(f"{parent} has no room for another run named {stem}")
